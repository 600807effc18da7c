"""Trust in gains: fitted plant, black box and its response, bound, checks, intervals, suspects.

Everything follows from the recording and the plant's simulator.  The methods that find gains,
and the presentation of results, do not belong here.
"""
