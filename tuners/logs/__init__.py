"""Recordings of any plant: log files of many formats to evenly sampled arrays in its units."""

from tuners.logs.log import Log, read_log
from tuners.logs.options import Options
from tuners.logs.table import LogError, SelectionError

__all__ = ["Log", "LogError", "Options", "SelectionError", "read_log"]
