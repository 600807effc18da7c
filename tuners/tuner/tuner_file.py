r"""One file a tuner: a line with a checksum, then arrays and JSON in safetensors form.

    yawrate-tuner 1 <sha256 of the rest>\n
    <xz: safetensors: arrays, and the settings as JSON in its metadata>

Nothing is unpacked or parsed before the checksum agrees, because a damaged booster can
bring down the process that reads it; no code is ever loaded from the file.
"""

import hashlib
import json
import lzma
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.trust.emulator import PREFIX
from yawrate_env.files import replacing
from yawrate_env.plant import entry, fingerprint
from yawrate_env.plant.plant import Plant

FORMAT = "yawrate-tuner"
VERSION = 1
SUFFIX = ".tuner"

_LARGEST = 2**28  # bytes


class TunerFileError(ValueError):
    """A file that is not a usable tuner."""


def write(
    path: str | os.PathLike[str], settings: dict[str, Any], arrays: dict[str, NDArray[Any]]
) -> None:
    """Write through a temporary file beside `path`, so that no half of it is ever seen."""
    from safetensors.numpy import save

    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    body = lzma.compress(save(contiguous, {"settings": json.dumps(settings, sort_keys=True)}))
    digest = hashlib.sha256(body).hexdigest()
    with replacing(path) as file:
        file.write(f"{FORMAT} {VERSION} {digest}\n".encode())
        file.write(body)


def read(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read settings and arrays, or raise `TunerFileError` with the reason."""
    try:
        from safetensors import SafetensorError
        from safetensors.numpy import load
    except ImportError:
        raise TunerFileError(
            f'{path} needs safetensors to be read: pip install "yawrate[tune]".'
        ) from None
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise TunerFileError(f"{path}: {error.strerror}. Check the path.") from None
    header, _, body = content.partition(b"\n")
    words = header[:200].decode("ascii", "replace").split(" ")
    if len(words) != 3 or words[0] != FORMAT:
        raise TunerFileError(f"{path} is not a tuner file. Make one with `yawrate train`.")
    if words[1] != str(VERSION):
        raise TunerFileError(
            f"{path} has format version {words[1]}; this program reads {VERSION}. Update it."
        )
    if hashlib.sha256(body).hexdigest() != words[2]:
        raise TunerFileError(f"{path} is damaged: its checksum does not agree. Copy it again.")
    try:
        packed = _unpacked(body)
        size = int.from_bytes(packed[:8], "little")
        metadata = json.loads(packed[8 : 8 + size])["__metadata__"]
        settings, arrays = dict(json.loads(metadata["settings"])), load(packed)
    except (
        SafetensorError, lzma.LZMAError, KeyError, ValueError, TypeError, RecursionError,
    ) as error:  # fmt: skip
        raise TunerFileError(f"{path} cannot be read: {error}. Train it again.") from None
    return settings, arrays


def _unpacked(body: bytes) -> bytes:
    """What is packed, or ``ValueError`` where it is cut short or larger than any tuner."""
    unpacking = lzma.LZMADecompressor()
    content = unpacking.decompress(body, _LARGEST)
    if not unpacking.eof:
        more = "more than any tuner has" if len(content) == _LARGEST else "and ends early"
        raise ValueError(f"it unpacks to {len(content)} bytes {more}.")
    return content


@contextmanager
def rebuilding(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say of contents that no tuner can be made of that they are the file's."""
    try:
        yield
    except TunerFileError:
        raise
    except (KeyError, TypeError) as error:
        raise TunerFileError(
            f"{path} lacks or misnames {error}: written by another version. Train it again."
        ) from None
    except (ValueError, AttributeError, IndexError, ArithmeticError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise TunerFileError(f"{path} cannot be used: {reason} Train it again.") from None


def save(
    path: str | os.PathLike[str],
    plant: Plant,
    settings: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
) -> None:
    """Write a tuner's settings and arrays, and where its plant is found again.

    ``ValueError`` for a path by which `tuners.load` would not know it for a file.
    """
    name = os.fsdecode(path)
    if not name.endswith(SUFFIX):
        raise ValueError(
            f"path = {name!r} must end in {SUFFIX}: tuners.load takes other names for those of "
            f"the package's tuners. Save it as {name + SUFFIX!r}."
        )
    described = {
        "entry": entry.named(plant, "A saved tuner"),
        "arguments": dict(plant.arguments),
        "fingerprint": fingerprint.fingerprint(plant),
    }
    emulator = {} if plant.emulator is None else plant.emulator.arrays()
    saved = {**arrays, **{f"{PREFIX}{key}": array for key, array in emulator.items()}}
    write(path, {"plant": described, **settings}, saved)


def plant_of(
    path: str | os.PathLike[str], settings: dict[str, Any], plant: Plant | None = None
) -> Plant:
    """The plant of a tuner's file, or the one given, if it has not changed since."""
    described = settings["plant"]
    try:
        found = plant or entry.find(described["entry"], Path(path).parent, described["arguments"])
    except ValueError as error:
        raise TunerFileError(f"{path} needs its plant. {error}") from None
    if other := fingerprint.changed(found, described["fingerprint"]):
        raise TunerFileError(
            f"{path} was trained for another {found.entry or 'plant'}: since then its {other} "
            "changed. Train again, or restore the description."
        )
    return found
