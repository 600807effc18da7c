"""Log files of many formats, read as evenly sampled arrays in the plant's units.

Formats, columns, units, time bases and the choice of a stretch.  The plant names its signals and
what may stand for them; code for one plant, and tuning, do not belong here.
"""

from tuners.logs.log import Log, read_log
from tuners.logs.options import Options
from tuners.logs.table import LogError, MissingParameterError, SelectionError

__all__ = ["Log", "LogError", "MissingParameterError", "Options", "SelectionError", "read_log"]
