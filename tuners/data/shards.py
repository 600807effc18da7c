"""One shard: consecutive episodes as a Parquet file, a function of its configuration alone.

| column | of vehicles | type | |
|---|---|---|---|
| `episode` | | int64 | number within the seed |
| the prior's parameters | `mu_s`, `M_delta`, `v_x` | float64 | the plant |
| `laguerre_1` ... or `armax_1` ... | | float64 | features; of what is measured beside, last |
| `usable` | | bool | compression converged and the design rule has gains |
| vehicles only | `status` | int8 | `yawrate_env.loop.design.Status` of the design rule |
| the gains | `kp`, `Ti` | float64 | of the design rule |
| the learner's targets | `log_gain`, `phase` | float64 | the same in the plant's coordinates |
| `u`, `y` | `steer`, `yaw_rate` | float32[N] | the recording, on request |
"""

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tuners.data.manifest import Configuration, DatasetError, Shard, differences
from tuners.data.subject import FEATURE, Columns, target_names
from tuners.features import described
from yawrate_env.batch import concatenate
from yawrate_env.plant.episodes import Examples, compressed

ROWS, RAW_ROWS = 8192, 512
"""At most so many rows are read at a time, without and with recordings."""


def made(configuration: dict[str, Any], shard: Shard, home: Path | None = None) -> bytes:
    """Simulate a shard: the work of one process of a pool or a cluster.

    Parameters
    ----------
    configuration : dict
        `Configuration.to_json`, the versions of whoever writes the data set included.
    home : Path, optional
        Where a plant's module is on the machine of whoever writes the data set.
    """
    try:
        recipe = Configuration.from_json(configuration, home)
    except DatasetError as error:
        raise DatasetError(f"A worker: {error} Give all workers the same module.") from None
    other = list(differences(recipe.to_json(), configuration))
    if other:
        raise DatasetError(f"A worker has other versions: {'; '.join(other)}. Install the same.")
    return written(columns(recipe, shard), recipe.subject.units)


def columns(recipe: Configuration, shard: Shard) -> Columns:
    """Simulate a shard's episodes."""
    parts: list[Examples] = []
    plant, signals, done = recipe.plant(), recipe.subject.signals, 0
    shape = shard.rows if recipe.raw else 0, len(plant.u)
    raw = {name: np.empty(shape, np.float32) for name in signals}
    for rows, block in compressed(
        plant,
        recipe.contexts.name,
        recipe.seed,
        shard.first,
        shard.rows,
        recipe.compressor,
    ):
        parts.append(rows)
        if recipe.raw:
            for name, signal in zip(signals, (block.u, block.y), strict=True):
                raw[name][done : done + len(rows)] = signal
        done += len(rows)
    return _of_examples(concatenate(parts), recipe) | (raw if recipe.raw else {})


def written(values: Columns, units: Mapping[str, str] | None = None) -> bytes:
    """Columns as a Parquet file; the same columns always give the same bytes."""
    units = units or {}
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


def feature_names(names: Iterable[str]) -> list[str]:
    """Those of columns that are features."""
    return [name for name in names if FEATURE.fullmatch(name)]


def examples(values: Columns, recipe: Configuration) -> Examples:
    """Columns back to the record that training takes."""
    plant = recipe.plant()
    theta, features, gains = (
        np.stack([values[name] for name in names], axis=1)
        for names in (plant.prior, feature_names(values), plant.gains)
    )
    gains[~recipe.subject.reached(values)] = np.nan
    return Examples(values["episode"], theta, features, values["usable"], gains)


def _rows(recordings: Iterable[bool]) -> int:
    return RAW_ROWS if any(recordings) else ROWS


def _of_examples(rows: Examples, recipe: Configuration) -> Columns:
    plant, stage = recipe.plant(), described(recipe.compressor)["name"]
    further, gains = recipe.subject.designed(rows)
    targets = plant.parametrisation.encode(gains)
    return {
        "episode": rows.number,
        **dict(zip(plant.prior, rows.theta.T, strict=True)),
        **{f"{stage}_{i}": column for i, column in enumerate(rows.features.T, start=1)},
        "usable": rows.usable,
        **further,
        **dict(zip(plant.gains, gains.T, strict=True)),
        **dict(zip(target_names(plant), targets.T, strict=True)),
    }


def _array(column: Any) -> NDArray[Any]:
    if pa.types.is_fixed_size_list(column.type):
        flat = column.flatten().to_numpy(zero_copy_only=False)
        return np.asarray(flat).reshape(len(column), -1)
    return np.asarray(column.to_numpy(zero_copy_only=False))
