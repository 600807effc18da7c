"""Control loops: target, discretisation, simulation, the PI controller, margins, the design rule.

Pure functions over batches of linear plants.  Random episodes, plants' descriptions and vehicles do
not belong here.
"""
