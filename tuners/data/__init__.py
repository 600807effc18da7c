"""Data sets of any size: features, gains and parameters in a folder of Parquet files.

``generate`` writes one, in parallel, and continues where it was interrupted; ``verify``
reads every byte again; ``Folder`` reads one, ``train`` learns from one, in bounded memory.
``docs/datasets.md`` has the format.
"""

from tuners.data.folder import Folder, verify
from tuners.data.generation import generate
from tuners.data.manifest import DatasetError
from tuners.data.minari_export import BEHAVIOURS, export_minari
from tuners.data.table import load_gains
from tuners.data.training import train

__all__ = [
    "BEHAVIOURS",
    "DatasetError",
    "Folder",
    "export_minari",
    "generate",
    "load_gains",
    "train",
    "verify",
]
