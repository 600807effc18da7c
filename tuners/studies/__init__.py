"""Studies: what the results on accuracy are made from, one a module."""
