"""The configuration of a data set, and the manifest that holds it.

``_manifest.json`` holds the configuration, its hash, the seeds, and for every finished
shard its rows and sha256.  It is replaced after each shard, always as a whole; a shard
that it does not list does not count, whatever the folder holds.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from tuners.data import columns
from tuners.features import Features, check_features, features_named, settings_of
from yawrate_env import __version__, validation
from yawrate_env.files import write_text
from yawrate_env.plant import entry
from yawrate_env.plant.episodes import SETS, ranges_of
from yawrate_env.plant.fingerprint import OF_EPISODES, changed, fingerprint
from yawrate_env.plant.plant import Plant

FORMAT = "yawrate-dataset 1"
FILE = "_manifest.json"  # what begins so is no part of the table to Arrow, pandas and Spark
RAW_SHARD_SIZE, SHARD_SIZE, SHARDS = 512, 4096, 1024
"""Episodes a file with and without recordings, and how many files there are at most."""

LIBRARIES = ("numpy", "numba", "pyarrow")
"""Libraries that the last bits and bytes of a shard depend on."""


class DatasetError(ValueError):
    """A folder that cannot be written, resumed or read."""


@dataclass(frozen=True, slots=True)
class Shard:
    """Consecutive episodes in one file; without a checksum it is still to be made."""

    file: str
    first: int
    rows: int
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Everything that the content of a data set follows from.

    Attributes
    ----------
    plant : Plant
        Its entry is named in the manifest.
    set : str
        Which set of episodes (`yawrate_env.plant.episodes.SETS`).
    features : Armax, Laguerre, Regularised or FrequencyResponse
        First stage.
    seed, episodes : int
        Episodes ``0`` to ``episodes - 1`` of this seed.
    shard_size : int
        Episodes a file.
    raw : bool
        Whether the recordings are kept too.
    """

    plant: Plant
    set: str
    features: Features
    seed: int
    episodes: int
    shard_size: int
    raw: bool

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("episodes", 1), ("shard_size", 1)):
            value = validation.count(name, getattr(self, name), at_least=least)
            object.__setattr__(self, name, value)
        validation.instance("plant", self.plant, Plant, remedy="Describe one.")
        validation.one_of("set of episodes", self.set, tuple(SETS))
        check_features(self.features)
        object.__setattr__(self, "raw", validation.flag("raw", self.raw))
        entry.named(self.plant, "A data set")
        ranges_of(self.plant, self.set)
        columns.check(self.plant)

    def shards(self) -> Iterator[Shard]:
        """All of them, in order."""
        return map(self.shard, range(self.shard_count))

    @property
    def shard_count(self) -> int:
        """How many there are."""
        return -(-self.episodes // self.shard_size)

    def shard(self, number: int) -> Shard:
        """One of them."""
        first = number * self.shard_size
        rows = min(self.shard_size, self.episodes - first)
        return Shard(f"shard-{number:06d}.parquet", first, rows)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values, the versions in use among them."""
        now = fingerprint(self.plant)
        values = {
            "plant": self._named() | {"fingerprint": {name: now[name] for name in OF_EPISODES}},
            "set": self.set,
            "features": settings_of(self.features),
            "seed": self.seed,
            "episodes": self.episodes,
            "shard_size": self.shard_size,
            "raw": self.raw,
            "versions": {"yawrate": __version__} | {name: version(name) for name in LIBRARIES},
        }
        return json.loads(json.dumps(values))  # type: ignore[no-any-return]

    @classmethod
    def from_json(
        cls, values: dict[str, Any], folder: Path | None = None, plant: Plant | None = None
    ) -> Self:
        """Rebuild from `to_json`.

        Parameters
        ----------
        folder : Path, optional
            Where the plant's module may be, beside the usual places.
        plant : Plant, optional
            The plant, if not to be imported.

        Raises
        ------
        DatasetError
            The plant is missing or has changed.
        """
        described = values["plant"]
        found = cls(
            _found(described["entry"], described["arguments"], folder, plant),
            values["set"],
            features_named(**values["features"]),
            *(values[name] for name in ("seed", "episodes", "shard_size", "raw")),
        )
        if other := found._changes(described):
            raise DatasetError(
                f"The data set is not of the {described['entry']} that is found here: {other}. "
                "Restore its description, or generate another data set."
            )
        return found

    def differences(self, then: dict[str, Any]) -> str:
        """How another configuration differs; empty if it does not."""
        now = _flat({**self.to_json(), "plant": {}})
        then, plant = _flat({**then, "plant": {}}), then.get("plant", {})
        parts = [self._changes(plant)] + [
            f"{name} is {then.get(name)!r} there and {now.get(name)!r} here"
            for name in sorted(now.keys() | then.keys())
            if now.get(name) != then.get(name)
        ]
        return "; ".join(part for part in parts if part)

    def _named(self) -> dict[str, Any]:
        """Where the plant is found again, and settings of its episodes."""
        low, high = (ends.tolist() for ends in ranges_of(self.plant, self.set))
        return {
            "entry": self.plant.entry,
            "arguments": dict(self.plant.arguments),
            "coordinates": columns.coordinate_names(self.plant),
            "ranges": dict(zip(self.plant.prior, zip(low, high, strict=True), strict=True)),
        }

    def _changes(self, then: dict[str, Any]) -> str:
        """How the plant differs from what a manifest says of it."""
        now = json.loads(json.dumps(self._named()))
        before, after = (
            _flat({name: values.get(name) for name in now}, "plant.") for values in (then, now)
        )
        for name in after | before:
            if before.get(name) != after.get(name):
                return f"{name} is {before.get(name)!r} there and {after.get(name)!r} here"
        other = changed(self.plant, then.get("fingerprint", {}), OF_EPISODES)
        return f"the plant's {other} has changed" if other else ""


@dataclass(frozen=True, slots=True)
class Manifest:
    """A configuration as it was written, and the shards that are finished."""

    configuration: dict[str, Any]
    shards: tuple[Shard, ...] = ()

    def recipe(self, folder: Path | None = None, plant: Plant | None = None) -> Configuration:
        """The configuration as this program understands it; as `Configuration.from_json`."""
        try:
            return Configuration.from_json(self.configuration, folder, plant)
        except DatasetError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            made, reason = self.configuration.get("versions"), str(error).removesuffix(".")
            raise DatasetError(
                f"The manifest's configuration is another version's ({made}): {reason}. Read it "
                "with that version."
            ) from None

    def check_shards(self, folder: Path, recipe: Configuration) -> None:
        """Refuse shards that are not the recipe's, or not in its order; some may be missing."""
        last = -1
        for shard in self.shards:
            number = shard.first // recipe.shard_size if isinstance(shard.first, int) else -1
            known = last < number < recipe.shard_count
            if not (known and replace(shard, sha256="") == recipe.shard(number)):
                raise DatasetError(
                    f"{folder}: the manifest lists {shard.file!r} with episodes from "
                    f"{shard.first!r} on where its configuration has no such shard. Copy it again."
                )
            last = number

    def with_shard(self, shard: Shard) -> "Manifest":
        """One more is finished."""
        return replace(self, shards=tuple(sorted((*self.shards, shard), key=lambda s: s.first)))

    def grown(self, episodes: int) -> "Manifest":
        """The same data set on its way to more episodes, if these are more.

        All shards stay but a last one that is shorter than the others: it will be longer.
        """
        before, size = (self.configuration.get(name) for name in ("episodes", "shard_size"))
        if not (isinstance(before, int) and isinstance(size, int) and before < episodes):
            return self
        full = (s for s in self.shards if s.rows == size)
        return Manifest(self.configuration | {"episodes": episodes}, tuple(full))

    def write(self, folder: Path) -> None:
        """Replace the folder's manifest."""
        root, episodes = self.configuration["seed"], self.configuration["episodes"]
        content = {
            "format": FORMAT,
            "configuration": self.configuration,
            "configuration_sha256": _digest(self.configuration),
            "seeds": {
                "entropy": [SETS[self.configuration["set"]], root],
                "spawn_keys": [0, episodes],
            },
            "shards": [asdict(shard) for shard in self.shards],
        }
        write_text(folder / FILE, json.dumps(content, indent=1) + "\n")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a folder's manifest, or raise `DatasetError` with the reason."""
        path = folder / FILE
        try:
            content = json.loads(path.read_bytes())
            found = content["format"]
            configuration = dict(content["configuration"])
            intact = content["configuration_sha256"] == _digest(configuration)
            shards = tuple(Shard(**values) for values in content["shards"])
        except OSError as error:
            raise DatasetError(f"{path}: {error.strerror}. Name a data set's folder.") from None
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise DatasetError(
                f"{path} is damaged: {type(error).__name__} {error}. Copy it again; the shards "
                "themselves may be intact."
            ) from None
        if found != FORMAT:
            raise DatasetError(f"{path} has format {found!r}; this program reads {FORMAT!r}.")
        if not intact:
            raise DatasetError(
                f"{path} is damaged: its configuration and the hash of it disagree. Copy it again."
            )
        return cls(configuration, shards)


def shard_size(episodes: int, raw: bool) -> int:
    """A size that keeps shards in memory, and the manifest, replaced after each, short."""
    return RAW_SHARD_SIZE if raw else max(SHARD_SIZE, -(-episodes // SHARDS))


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values by dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _found(name: str, arguments: dict[str, Any], folder: Path | None, plant: Plant | None) -> Plant:
    """The plant given, which needs no entry, or that of the entry."""
    if plant is not None and plant.entry not in ("", name):
        raise DatasetError(
            f"The data set is of {name}, not of {plant.entry}. Give the plant that it is of, or "
            "generate another data set."
        )
    try:
        if plant is None:
            return entry.find(name, folder, arguments)
        return plant if plant.entry else entry.with_entry(plant, name, arguments)
    except ValueError as error:
        raise DatasetError(f"The data set needs its plant. {error}") from None


def _digest(configuration: dict[str, Any]) -> str:
    canonical = json.dumps(configuration, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
