"""One shard: consecutive episodes as a Parquet file, a function of its configuration alone.

`tuners.data.columns` has the table of columns.
"""

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tuners.data.columns import (
    Columns,
    coordinate_names,
    feature_names,
    features_in,
    units,
)
from tuners.data.manifest import Configuration, DatasetError, Shard
from tuners.features import settings_of
from tuners.tuner.examples import Examples, examples_of
from yawrate_env.batch import concatenate
from yawrate_env.plant.channels import by_channel

ROWS, RAW_ROWS = 8192, 512
"""At most so many rows are read at a time, without and with recordings."""


def made(configuration: dict[str, Any], shard: Shard, home: Path | None = None) -> bytes:
    """Simulate a shard: the work of one process of a pool or a cluster.

    Parameters
    ----------
    configuration : dict
        `Configuration.to_json` of the process that writes the data set, with its versions.
    home : Path, optional
        Folder of the plant's module on the machine of that process.
    """
    try:
        recipe = Configuration.from_json(configuration, home)
    except DatasetError as error:
        raise DatasetError(f"A worker: {error} Give all workers the same module.") from None
    if other := recipe.differences(configuration):
        raise DatasetError(f"A worker has other versions: {other}. Install the same.")
    return written(columns(recipe, shard), units(recipe.plant))


def columns(recipe: Configuration, shard: Shard) -> Columns:
    """Simulate a shard's episodes."""
    parts: list[Examples] = []
    done = 0
    shape = shard.rows if recipe.raw else 0, recipe.plant.samples
    raw = {name: np.empty(shape, np.float32) for name in recipe.plant.columns}
    for rows, block in examples_of(
        recipe.plant, recipe.set, recipe.seed, shard.first, shard.rows, recipe.features
    ):
        parts.append(rows)
        if recipe.raw:
            signals = (*by_channel(block.u), *by_channel(block.y))
            for column, signal in zip(raw.values(), signals, strict=True):
                column[done : done + len(rows)] = signal
        done += len(rows)
    return _of_examples(concatenate(parts), recipe) | (raw if recipe.raw else {})


def written(values: Columns, units: Mapping[str, str]) -> bytes:
    """Columns as a Parquet file; the same columns always give the same bytes."""
    fields, arrays = [], []
    for name, column in values.items():
        array = pa.array(np.ravel(column))
        if column.ndim == 2:
            array = pa.FixedSizeListArray.from_arrays(array, column.shape[1])
        unit = {"unit": units[name]} if name in units else None
        fields.append(pa.field(name, array.type, nullable=False, metadata=unit))
        arrays.append(array)
    sink = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields)),
        sink,
        row_group_size=_rows(column.ndim == 2 for column in values.values()),
        compression="zstd",
        compression_level=3,
        use_dictionary=False,
        write_page_checksum=True,
    )
    return sink.getvalue()


def read(path: Path, names: Sequence[str] | None = None) -> Iterator[Columns]:
    """Columns of a shard, or all but the recordings, `ROWS` rows at a time or fewer."""
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            lists = {f.name: pa.types.is_fixed_size_list(f.type) for f in file.schema_arrow}
            if names is None:
                names = [name for name, is_list in lists.items() if not is_list]
            rows = _rows(lists[name] for name in names)
            for batch in file.iter_batches(rows, columns=list(names)):
                yield {name: _array(batch[name]) for name in names}
    except (OSError, KeyError, pa.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise DatasetError(f"{path} cannot be read: {reason} Verify the data set.") from None


def examples(values: Columns, recipe: Configuration) -> Examples:
    """Columns back to the record that training takes."""
    plant = recipe.plant
    theta, features, gains = (
        np.stack([values[name] for name in names], axis=1)
        for names in (plant.prior, features_in(values), plant.gains)
    )
    return Examples(values["episode"], theta, features, values["usable"], gains)


def _rows(recordings: Iterable[bool]) -> int:
    return RAW_ROWS if any(recordings) else ROWS


def _of_examples(rows: Examples, recipe: Configuration) -> Columns:
    plant, stage = recipe.plant, settings_of(recipe.features)["name"]
    coordinates = rows.targets(plant.parametrisation)
    return {
        "episode": rows.number,
        **dict(zip(plant.prior, rows.theta.T, strict=True)),
        **dict(zip(feature_names(stage, rows.features.shape[1]), rows.features.T, strict=True)),
        "usable": rows.usable,
        **dict(zip(plant.gains, rows.gains.T, strict=True)),
        **dict(zip(coordinate_names(plant), coordinates.T, strict=True)),
    }


def _array(column: Any) -> NDArray[Any]:
    if pa.types.is_fixed_size_list(column.type):
        flat = column.flatten().to_numpy(zero_copy_only=False)
        return np.asarray(flat).reshape(len(column), -1)
    return np.asarray(column.to_numpy(zero_copy_only=False))
