"""Second stage: features to the controller's coordinates.

Each module has the settings of a learner, which `fit` trains, and the trained learner, which
predicts.  Learners see numbers alone: nothing here knows plants or recordings.
"""

from typing import Any

from tuners.learners.actor import Agent
from tuners.learners.feedforward import FeedForward, FeedForwardSettings
from tuners.learners.gbm import GBM, GBMSettings
from tuners.learners.trend import Trend, TrendSettings

Learner = FeedForward | GBM | Trend | Agent
Settings = FeedForwardSettings | GBMSettings | TrendSettings

LEARNERS: dict[str, Any] = {
    "gbm": GBM,
    "feedforward": FeedForward,
    "trend": Trend,
    "agent": Agent,
}
"""Trained second stages by the name that tuner files know."""
