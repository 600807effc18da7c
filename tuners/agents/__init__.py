"""Agents that learn from rewards, and around them the environments of `yawrate_env`.

``training.train`` gives a `Tuner` like any other: its second stage is the agent's actor.  How
environments draw episodes, and what tuners do with a recording, belongs elsewhere.
"""
