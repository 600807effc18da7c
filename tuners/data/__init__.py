"""Data sets of any size: features, gains and parameters in a folder of Parquet files.

``generate`` writes one in parallel and resumes it; ``verify``, ``Folder`` and ``train`` read one in
bounded memory (format: ``docs/datasets.md``).  How episodes are drawn, features computed and
learners trained does not belong here.
"""

from tuners.data.folder import Folder, verify
from tuners.data.generation import generate
from tuners.data.manifest import DatasetError
from tuners.data.minari_drives import DRIVE_BEHAVIOURS, export_drives
from tuners.data.minari_export import BEHAVIOURS, export_minari
from tuners.data.table import load_gains
from tuners.data.training import train

__all__ = [
    "BEHAVIOURS",
    "DRIVE_BEHAVIOURS",
    "DatasetError",
    "Folder",
    "export_drives",
    "export_minari",
    "generate",
    "load_gains",
    "train",
    "verify",
]
