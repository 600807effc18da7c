"""Benchmark of every stage's speed beside other libraries and the machine's limits.

`scripts/benchmark.py` runs it.  Accuracy is a matter of `scripts/studies`, and tests of speed
belong in neither.
"""
