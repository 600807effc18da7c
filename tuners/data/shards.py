"""One shard: consecutive episodes as a Parquet file, a function of its configuration alone.

| column | type | unit | |
|---|---|---|---|
| `episode` | int64 | 1 | number within the seed |
| `mu_s`, `M_delta`, `v_x` | float64 | 1, kg, m/s | the vehicle |
| `laguerre_1` ... or `armax_1` ... | float64 | | features |
| `usable` | bool | | compression converged and the target is reachable |
| `status` | int8 | | `yawrate_env.design.Status` of the design rule |
| `kp`, `Ti` | float64 | s, s | gains of the design rule |
| `log_gain`, `phase` | float64 | 1, rad | the same as loop coordinates |
| `steer`, `yaw_rate` | float32[N] | rad, rad/s | the recording, on request |
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tuners.compressors import COMPRESSORS, described
from tuners.data.manifest import Configuration, DatasetError, Shard, differences
from tuners.plants.coordinates import loop
from tuners.plants.data import Examples, compressed
from tuners.yaw_rate import context_of
from yawrate_env.batch import concatenate
from yawrate_env.design import Status
from yawrate_env.judge import Judge
from yawrate_env.vehicle import Context

Columns = dict[str, NDArray[Any]]

TARGETS = {"gains": ("kp", "Ti"), "loop": ("log_gain", "phase")}
SIGNALS = ("steer", "yaw_rate")
UNITS = {
    "mu_s": "1", "M_delta": "kg", "v_x": "m/s", "kp": "s", "Ti": "s", "log_gain": "1",
    "phase": "rad", "steer": "rad", "yaw_rate": "rad/s",
}  # fmt: skip
ROWS, RAW_ROWS = 8192, 512
"""At most so many rows are read at a time, without and with recordings."""


def made(configuration: dict[str, Any], shard: Shard) -> bytes:
    """Simulate a shard: the work of one process of a pool or a cluster.

    Parameters
    ----------
    configuration : dict
        `Configuration.to_json`, the versions of whoever writes the data set included.
    """
    recipe = Configuration.from_json(configuration)
    other = list(differences(recipe.to_json(), configuration))
    if other:
        raise DatasetError(f"A worker has other versions: {'; '.join(other)}. Install the same.")
    return written(columns(recipe, shard))


def columns(recipe: Configuration, shard: Shard) -> Columns:
    """Simulate a shard's episodes."""
    parts: list[Examples] = []
    N = recipe.task.experiment.N
    raw = {name: np.empty((shard.rows if recipe.raw else 0, N), np.float32) for name in SIGNALS}
    done = 0
    for rows, block in compressed(
        recipe.plant(),
        recipe.contexts.name,
        recipe.seed,
        shard.first,
        shard.rows,
        recipe.compressor,
    ):
        parts.append(rows)
        if recipe.raw:
            raw["steer"][done : done + len(rows)] = block.u
            raw["yaw_rate"][done : done + len(rows)] = block.y
        done += len(rows)
    return _of_examples(concatenate(parts), recipe) | (raw if recipe.raw else {})


def written(values: Columns) -> bytes:
    """Columns as a Parquet file; the same columns always give the same bytes."""
    fields, arrays = [], []
    for name, column in values.items():
        array = pa.array(np.ravel(column))
        if column.ndim == 2:
            array = pa.FixedSizeListArray.from_arrays(array, column.shape[1])
        unit = {"unit": UNITS[name]} if name in UNITS else None
        fields.append(pa.field(name, array.type, nullable=False, metadata=unit))
        arrays.append(array)
    sink = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields)),
        sink,
        row_group_size=_rows(values),
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
            if names is None:
                names = [name for name in file.schema_arrow.names if name not in SIGNALS]
            for batch in file.iter_batches(_rows(names), columns=list(names)):
                yield {name: _array(batch[name]) for name in names}
    except (OSError, KeyError, pa.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise DatasetError(f"{path} cannot be read: {reason} Verify the data set.") from None


def feature_names(names: Iterable[str]) -> list[str]:
    """Those of columns that are features."""
    stages = tuple(f"{stage}_" for stage in COMPRESSORS)
    return [name for name in names if name.startswith(stages)]


def examples(values: Columns) -> Examples:
    """Columns back to the record that training takes."""
    theta, features, gains = (
        np.stack([values[name] for name in names], axis=1)
        for names in (Context.__slots__, feature_names(values), TARGETS["gains"])
    )
    gains[values["status"] != Status.OK] = np.nan
    return Examples(values["episode"], theta, features, values["usable"], gains)


def _rows(names: Iterable[str]) -> int:
    return ROWS if set(SIGNALS).isdisjoint(names) else RAW_ROWS


def _of_examples(rows: Examples, recipe: Configuration) -> Columns:
    stage = described(recipe.compressor)["name"]
    features = {f"{stage}_{i}": column for i, column in enumerate(rows.features.T, start=1)}
    gains, status = _designed(rows, recipe)
    log_gain, phase = loop(recipe.task.target).encode(gains).T
    return {
        "episode": rows.number,
        **dict(zip(Context.__slots__, rows.theta.T, strict=True)),
        **features,
        "usable": rows.usable,
        "status": status,
        "kp": gains[:, 0],
        "Ti": gains[:, 1],
        "log_gain": log_gain,
        "phase": phase,
    }


def _designed(rows: Examples, recipe: Configuration) -> tuple[NDArray[Any], NDArray[Any]]:
    """The design rule's gains, those that miss the target too, and how far it came."""
    gains, status = rows.gains.copy(), np.zeros(len(rows), np.int8)
    missed = np.isnan(gains).any(axis=1)
    if missed.any():
        found = Judge.of(recipe.task, context_of(rows.theta[missed])).oracle()
        gains[missed] = np.stack([found.kp, found.Ti], axis=1)
        status[missed] = found.status
    return gains, status


def _array(column: Any) -> NDArray[Any]:
    if pa.types.is_fixed_size_list(column.type):
        flat = column.flatten().to_numpy(zero_copy_only=False)
        return np.asarray(flat).reshape(len(column), -1)
    return np.asarray(column.to_numpy(zero_copy_only=False))
