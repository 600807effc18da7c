"""Files of every format with random damage: answered rightly, or refused in one line.

A valid file is cut, bits are flipped, parts are lost, repeated or zeroed; in text, cells and rows
are swapped or replaced, and the encoding changes.  Forbidden are a traceback, more than ten
seconds, more than two gigabytes, and a trusted answer that the undamaged file contradicts:
intervals that do not overlap, or gains that miss its fitted plant's target by 3 degrees or 0.15 Hz.
"""

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import tuners
from studies.log_files import log_files
from tuners.cli.tuning import DEFAULT, WITHOUT
from tuners.logs import MissingParameterError, Options, log_of, read_table
from tuners.tuner.result import Result

SOURCES = (
    "plain.csv", "preamble.csv", "units_row.csv", "two_line_names.csv", "utf16_big.csv",
    "two_columns.csv", "epoch_ns.csv", "clocks_apart.csv", "log.csv.gz", "log.csv.xz", "log.zip",
    "log.xlsx", "rounded.mf4", "structure.mat", "simulink.mat", "timetable.mat", "loop.h5",
    "units.h5", "log.feather", "log.parquet", "bag.mcap", "trace.blf",
)  # fmt: skip
"""Of `log_files`."""

RIGHT, REFUSED, UNTRUSTED = "right and trusted", "refused", "gains refused"
TRACEBACK, SLOW, LARGE = "traceback", "over 10 s", "over 2 GB"
WRONG, APART = "wrong and trusted", "trusted, intervals apart"
FORBIDDEN = TRACEBACK, SLOW, LARGE, WRONG, APART

PATIENCE, MEMORY = 10.0, 2 << 20  # s of the processor, KiB
MISSED = 3.0, 0.15  # deg and Hz
_CELLS = (
    "", "nan", "inf", "-1e999", "1e308", "x", "-", "0x10", "1,5", "1;2", '"', "\t", "-0.0",
    "12:00:01", "2024-01-01", "true", "µ", "18,000", "1e19", "999999",
)  # fmt: skip
_ENCODINGS = "utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp1252", "utf-7", "cp500"

Mutation = Callable[[bytes, np.random.Generator], bytes]


def mutated(content: bytes, seed: int) -> tuple[str, bytes]:
    """A file with one kind of damage or two, and their names."""
    rng = np.random.default_rng([seed, len(content)])
    kinds = [*_BINARY, *(_TEXT if _is_text(content) else ())]
    chosen = rng.choice(len(kinds), 1 + int(rng.random() < 0.4))
    for k in chosen:
        content = kinds[k](content, rng)
    return ", ".join(kinds[k].__name__.strip("_") for k in chosen), content


def _is_text(content: bytes) -> bool:
    return b"\x00" not in content and content[:1].isascii() and content[:2] not in (b"\x1f\x8b",)


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: rng.integers(len(content) + 1)]


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    if not content:
        return content
    values = bytearray(content)
    for at in rng.integers(len(values), size=rng.integers(1, 4)):
        values[at] ^= 1 << int(rng.integers(8))
    return bytes(values)


def _part(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    start = int(rng.integers(len(content) + 1))
    return start, min(len(content), start + int(rng.integers(1, 2000)))


def _lose(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _part(content, rng)
    return content[:start] + content[stop:]


def _repeat(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _part(content, rng)
    return content[:stop] + content[start:]


def _zero(content: bytes, rng: np.random.Generator) -> bytes:
    start, stop = _part(content, rng)
    return content[:start] + bytes(stop - start) + content[stop:]


def _insert(content: bytes, rng: np.random.Generator) -> bytes:
    start, _ = _part(content, rng)
    return content[:start] + rng.bytes(int(rng.integers(1, 50))) + content[start:]


def _lines(content: bytes) -> list[list[str]]:
    return [line.split(",") for line in content.decode("latin-1").split("\n")]


def _joined(lines: list[list[str]]) -> bytes:
    return "\n".join(",".join(cells) for cells in lines).encode("latin-1", "replace")


def _cell(content: bytes, rng: np.random.Generator) -> bytes:
    lines = _lines(content)
    for _ in range(int(rng.integers(1, 6))):
        cells = lines[rng.integers(len(lines))]
        cells[rng.integers(len(cells))] = str(rng.choice(_CELLS))
    return _joined(lines)


def _swap_cells(content: bytes, rng: np.random.Generator) -> bytes:
    lines = _lines(content)
    for _ in range(int(rng.integers(1, 6))):
        a, b = (lines[rng.integers(len(lines))] for _ in range(2))
        i, j = rng.integers(len(a)), rng.integers(len(b))
        a[i], b[j] = b[j], a[i]
    return _joined(lines)


def _swap_rows(content: bytes, rng: np.random.Generator) -> bytes:
    lines = _lines(content)
    i, j = rng.integers(len(lines), size=2)
    lines[i], lines[j] = lines[j], lines[i]
    return _joined(lines)


def _column(content: bytes, rng: np.random.Generator) -> bytes:
    lines, k, text = _lines(content), int(rng.integers(4)), str(rng.choice(_CELLS))
    for cells in lines[1:]:
        cells[min(k, len(cells) - 1)] = text
    return _joined(lines)


def _encode(content: bytes, rng: np.random.Generator) -> bytes:
    return content.decode("latin-1").encode(str(rng.choice(_ENCODINGS)), "replace")


def _newlines(content: bytes, rng: np.random.Generator) -> bytes:
    return content.replace(b"\n", (b"\r", b"\r\n", b"\n\n", b"\r\r\n")[rng.integers(4)])


_BINARY: tuple[Mutation, ...] = (_cut, _flip, _lose, _repeat, _zero, _insert)
_TEXT: tuple[Mutation, ...] = (_cell, _swap_cells, _swap_rows, _column, _encode, _newlines)


@cache
def _tuner(name: str) -> tuners.Tuner:
    return tuners.load(name)


def tuned(path: Path, dbc: Path | None = None) -> Result:
    """As `yawrate tune` answers, without its hints."""
    table, options = read_table(path, dbc), Options(dbc=dbc)
    try:
        log = log_of(table, _tuner(DEFAULT).plant, options)
    except MissingParameterError:
        log = log_of(table, _tuner(WITHOUT).plant, options)
        return _tuner(WITHOUT).tune(log.u, log.y, log.Ts, log.measured)
    return _tuner(DEFAULT).tune(log.u, log.y, log.Ts, log.measured)


def outcome(path: Path, dbc: Path | None, clean: Result) -> tuple[str, str]:
    """What became of a file, and the words of a refusal or an error."""
    try:
        result = tuned(path, dbc)
    except (ValueError, OSError) as error:
        text = str(error)
        return (REFUSED if text and "\n" not in text else TRACEBACK), text
    except BaseException as error:
        return TRACEBACK, f"{type(error).__name__}: {error}"
    if not result.trusted:
        return UNTRUSTED, "; ".join(result.reasons)
    return compared(result, clean), f"{result.gains}"


def compared(result: Result, clean: Result) -> str:
    """What a trusted answer is, beside that of the undamaged file.

    Intervals are of the margins that an answer's own gains give: the undamaged file has the same
    widths about what its fitted plant gives with these gains.
    """
    plant, target = clean.plant, clean.plant.loop_target
    assert target is not None and plant.evaluate is not None
    gains = np.array([[result.gains[name] for name in plant.gains]])
    theta = np.array([list(clean.fit.parameters.values())])
    margins = plant.evaluate(theta, gains)[0][0]
    aims = target.phase_margin, target.crossover
    apart = False
    for name, found, aim, most in zip(plant.counted, margins, aims, MISSED, strict=False):
        now, then = result.intervals[name], clean.intervals[name]
        half = (then.high - then.low) / 2
        if abs(found - aim) > most:
            return WRONG
        apart |= now.low > found + half or now.high < found - half
    return APART if apart else RIGHT


@dataclass(frozen=True, slots=True)
class Case:
    """One damaged file and what became of it."""

    source: str
    seed: int
    damage: str
    outcome: str
    words: str


def hunt(
    count: int, seed: int = 0, progress: Callable[[int], None] | None = None, first: int = 0
) -> Iterator[Case]:
    """Damage `count` files in turn, each in a process that is ended if it hangs.

    A hunt in parts, each from its `first` file on, damages the same files.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        contents = _written(folder)
        worker = Worker(folder)
        try:
            for k in range(first, first + count):
                source = SOURCES[k % len(SOURCES)]
                damage, content = mutated(contents[source], seed + k)
                found, words = worker(source, content)
                yield Case(source, seed + k, damage, found, words)
                if progress is not None:
                    progress(k + 1 - first)
        finally:
            worker.end()


def _written(folder: Path) -> dict[str, bytes]:
    """Contents of the undamaged files."""
    for file in log_files():
        if file.name in SOURCES:
            file.write(folder / file.name)
    return {name: (folder / name).read_bytes() for name in SOURCES}


class Worker:
    """A process that judges files, begun again when it hangs, dies or grows too large."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._begin()

    def __call__(self, source: str, content: bytes) -> tuple[str, str]:
        """What becomes of a file of this content, called as its source."""
        path = self.folder / f"damaged{''.join(Path(source).suffixes)}"
        path.write_bytes(content)
        self.pipe.send((path, self.folder / "trace.dbc" if source == "trace.blf" else None))
        if not self.pipe.poll(6 * PATIENCE):  # the machine may be busy with something else
            self.end()
            self._begin()
            return SLOW, f"{len(content)} bytes"
        try:
            found, words, seconds, memory = self.pipe.recv()
        except EOFError:
            self._begin()
            return TRACEBACK, "the process died"
        if seconds > PATIENCE:
            return SLOW, f"{seconds:.1f} s"
        if memory > MEMORY:
            self.end()
            self._begin()
            return LARGE, f"{memory} KiB"
        return found, words

    def end(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.join()

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        clean = self.folder / "plain.csv"
        self.process: Any = context.Process(target=_serve, args=(other, clean), daemon=True)
        self.process.start()
        other.close()
        self.pipe.recv()  # it is ready


def _serve(pipe: Connection, path: Path) -> None:
    import warnings

    warnings.simplefilter("ignore")
    clean = tuned(path)
    pipe.send(None)
    while True:
        damaged, dbc = pipe.recv()
        begun = time.process_time()
        found, words = outcome(damaged, dbc, clean)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        pipe.send((found, words, time.process_time() - begun, memory))
