"""Second stage: learners that predict the controller's coordinates from features.

Each module has a learner's settings, whose `fit` trains it, and the trained learner, which
predicts.  Learners see arrays alone: plants and recordings do not belong here.
"""

from typing import Any

from tuners.learners.actor import Agent
from tuners.learners.feedforward import FeedForward, FeedForwardSettings
from tuners.learners.gbm import GBM, GBMSettings
from tuners.learners.polynomial import Polynomial, PolynomialSettings
from tuners.learners.trend import Trend, TrendSettings

Learner = FeedForward | GBM | Polynomial | Trend | Agent
Settings = FeedForwardSettings | GBMSettings | PolynomialSettings | TrendSettings

LEARNERS: dict[str, Any] = {
    "gbm": GBM,
    "feedforward": FeedForward,
    "polynomial": Polynomial,
    "trend": Trend,
    "agent": Agent,
}
"""Trained second stages by the name that tuner files know."""
