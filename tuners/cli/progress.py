"""Progress bars of the commands, which the library calls as `progress`."""

from tuners.progress import Bars

__all__ = ["Bars"]
