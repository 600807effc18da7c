"""Trust in gains: the fitted plant, the reference model, the bound, checks and intervals.

Everything follows from the recording and the plant's simulator.  The methods that find gains,
and the presentation of results, do not belong here.
"""
