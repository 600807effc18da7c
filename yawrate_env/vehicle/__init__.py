"""The paper's plant: a single-track vehicle with uncertain friction and mass, and its twins.

`yaw_rate` describes it as a `Plant`; the rest are its equations.  Nothing here learns, and the
method never imports from here.
"""
