"""The tuner: recording in, gains and trust out; how it is trained, evaluated and saved.

A method finds the gains: the two stages, or a reference of `rivals`.  Code for one plant, for
log files or for pictures does not belong here.
"""
