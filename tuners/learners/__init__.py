"""The second stages by name, as model files know them."""

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
