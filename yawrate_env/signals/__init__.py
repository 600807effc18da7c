"""Signals: excitation, white noise, random streams, decimation.

Functions of arrays and random integers.  Anything that knows a plant or a loop does not belong
here.
"""
