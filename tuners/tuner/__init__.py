"""The tuner: recording in, gains and trust out; how it is trained, evaluated and saved.

A method finds the gains: the two stages, a reference of `rivals`, or one of `direct`.  Code for
one plant, for log files or for pictures does not belong here.
"""
