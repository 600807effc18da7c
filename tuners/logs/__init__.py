"""Log files of many formats, read as evenly sampled arrays in the plant's units.

Formats, columns, units, time bases and the choice of a stretch.  The plant names its signals and
what may stand for them; code for one plant, and tuning, do not belong here.
"""

from tuners.logs.formats import read_table
from tuners.logs.log import Log, log_of, read_log
from tuners.logs.options import Options
from tuners.logs.table import LogError, MissingParameterError, SelectionError, Table

__all__ = [
    "Log",
    "LogError",
    "MissingParameterError",
    "Options",
    "SelectionError",
    "Table",
    "log_of",
    "read_log",
    "read_table",
]
