"""One answer from several recordings of one plant: joint fit, agreement, shares, validation.

What one recording tells is `tuners.trust`'s; gains over a measured parameter are
`tuners.tuner.schedule`'s.
"""
