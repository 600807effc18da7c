"""Studies behind `results/`: each module answers one question with a table and a picture.

The programs in `scripts/` run them.  What a user of the package needs does not belong here: the
wheel leaves this folder out.
"""
