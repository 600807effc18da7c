"""Recordings of real vehicles: files of many formats to evenly sampled SI arrays."""

from tuners.logs.columns import UNITS, Choice
from tuners.logs.log import Log, read_log
from tuners.logs.options import Options
from tuners.logs.table import LogError, SelectionError

__all__ = ["UNITS", "Choice", "Log", "LogError", "Options", "SelectionError", "read_log"]
