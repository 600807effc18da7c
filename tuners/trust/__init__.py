"""Trust in gains: the fitted plant, the reference model, the bound, checks and intervals.

Everything asks the recording and the plant's simulator; which method found the gains, and how
they are shown, does not belong here.
"""
