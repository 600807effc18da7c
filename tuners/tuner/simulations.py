"""Simulations of a slow plant: one plant a call, in processes or on a cluster, kept in a file.

Every answer is kept under its parameters and its input.  What is asked for twice is simulated
once, and a training that was killed finds what it had when it is called again: it takes the same
steps and ends with the same tuner.  Answers do not depend on who simulated them, nor on how many.
"""

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import lru_cache, partial
from hashlib import blake2b
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.simulation_store import Store
from tuners.workers import Pool, pool
from yawrate_env.compiled import cores
from yawrate_env.plant import entry
from yawrate_env.plant.calls import one_line
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
Job = tuple[bytes, bytes, Array, Array, Any]
Answer = tuple[Array, bool]

_LONG = 0.03  # seconds of a simulation that is called slow

STAGE = "simulating"
"""Name of the stage that reports count simulations under."""


class Simulations:
    """A simulator of many plants that calls a slow one's for each that it does not know yet.

    Parameters
    ----------
    plant : Plant
        The slow one.
    work : callable
        Simulates one job: output (N,), and whether it used the random generator.
    workers : Pool
        Who does the work.
    store : Store
        What is simulated already.
    report : callable
        Called with the number of simulations so far, and at the end of the present call.
    """

    batched = True

    def __init__(
        self,
        work: Callable[[Job], Answer],
        workers: Pool,
        store: Store,
        report: Callable[[int, int], None],
    ) -> None:
        self._work, self._pool, self._store, self._report = work, workers, store, report
        self._begun: dict[bytes, Future[Answer]] = {}

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p) for an input (N,), or (B, N)."""
        rngs = [None] * len(theta) if rng is None else rng.spawn(len(theta))
        inputs = np.atleast_2d(u)
        jobs = [_job(theta[i], inputs[i % len(inputs)], each) for i, each in enumerate(rngs)]
        self._wait([self._begun[job[0]] for job in jobs if job[0] in self._begun])
        missing = {job[1]: job for job in jobs if self._known(job) is None}
        end = len(self._store) + len(missing)
        for job, (y, random) in self._pool.results(self._work, iter(missing.values())):
            self._store.put(job[1] if random or job[-1] is None else job[0], y)
            self._report(len(self._store), end)
        return np.array([self._known(job) for job in jobs])

    def ahead(self, theta: Array, u: Array) -> None:
        """Begin simulations that will be asked for, of plants (B, p) with an input (N,)."""
        rng = np.random.default_rng(0)
        for i, each in enumerate(theta):
            job = _job(each, u, rng)
            if job[0] in self._begun or self._store.get(job[0]) is not None:
                continue
            begun = self._pool.begin(self._work, job)
            if begun is None or (i == 0 and begun.exception() is None and begun.result()[1]):
                return  # where random numbers count they must be those of the episode
            begun.add_done_callback(partial(self._keep, job[0]))
            self._begun[job[0]] = begun

    def cancel(self) -> None:
        """Give up what was begun ahead and not asked for."""
        for begun in self._begun.values():
            begun.cancel()

    def _keep(self, key: bytes, begun: "Future[Answer]") -> None:
        """Keep an output as soon as it is there; where it failed it fails when it is asked for."""
        if begun.cancelled() or begun.exception() is not None:
            return
        y, random = begun.result()
        if not random:
            self._store.put(key, y)

    def _wait(self, asked: "list[Future[Answer]]") -> None:
        """Wait for what was begun ahead."""
        for begun in asked:
            begun.exception()
            self._report(len(self._store), len(self._store))

    def _known(self, job: Job) -> Array | None:
        """The output, if it was simulated before: with these random numbers, or using none."""
        found = self._store.get(job[0])
        return self._store.get(job[1]) if found is None else found


def _job(theta: Array, u: Array, rng: Any) -> Job:
    """A plant to simulate, after its keys: where it used no random numbers, and with these."""
    key = blake2b(theta.tobytes(), digest_size=16)
    key.update(u.tobytes())
    drawn = key.copy()
    drawn.update(b"none" if rng is None else repr(rng.bit_generator.state).encode())
    return key.digest(), drawn.digest(), theta, u, rng


def slowness(plant: Plant) -> str:
    """A sentence for a plant that should be described as slow and is not; else nothing."""
    if plant.slow or plant.record is not None:
        return ""
    seconds = min(_seconds(plant) for _ in range(2))  # the first call may compile
    if seconds < _LONG:
        return ""
    return (
        f"simulate takes {1e3 * seconds:.0f} ms a plant, and training calls it more than 100,000 "
        "times: describe the plant with slow=True, and it takes a few thousand, in processes."
    )


def _seconds(plant: Plant) -> float:
    begun = perf_counter()
    plant.respond(plant.middle)
    return perf_counter() - begun


@contextmanager
def simulating(
    plant: Plant,
    workers: int | None = None,
    scheduler: str | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    expected: int = 0,
) -> Iterator[Plant]:
    """A slow plant whose simulations run in processes and are kept; any other as it is.

    Parameters
    ----------
    workers : int, optional
        Processes; all cores if omitted.
    scheduler : str, optional
        Address of a Dask scheduler, or ``"local"`` for a cluster of `workers` processes.
    checkpoint : path, optional
        Where simulations are kept, to go on after an interruption; a temporary file if omitted.
    progress : callable, optional
        Called with `STAGE`, how many simulations are done, and of how many.
    expected : int
        How many it will be, about.

    Raises
    ------
    ValueError
        The plant is not slow, and one of the other arguments is given; or the checkpoint cannot
        be used.
    """
    if not plant.slow:
        given = {"workers": workers, "scheduler": scheduler, "checkpoint": checkpoint}
        for name, value in given.items():
            if value is not None:
                raise ValueError(
                    f"{name} = {value!r} is for plants whose simulations take long. Describe the "
                    "plant with slow=True, or leave it out."
                )
        yield plant
        return
    count = cores() if workers is None else workers
    store = Store(checkpoint, plant)

    def report(done: int, end: int) -> None:
        if progress is not None:
            progress(STAGE, done, max(expected, end))

    try:
        with pool(count, scheduler) as some:
            alone = scheduler is None and count == 1
            work = partial(_alone, plant.simulate, plant.batched) if alone else _sent(plant)
            simulate = Simulations(work, some, store, report)
            try:
                yield plant.with_simulator(simulate)
                if progress is not None:
                    progress(STAGE, len(store), len(store))
            finally:
                simulate.cancel()
    finally:
        store.close()


def ahead(plant: Plant, theta: Array, u: Array) -> None:
    """Let the workers of a slow plant begin what it will be asked for, plants (B, p)."""
    begin = getattr(plant.simulate, "ahead", None)
    if begin is not None:
        begin(theta, u)


@contextmanager
def shown(plant: Plant, progress: Progress | None) -> Iterator[Progress | None]:
    """How a training reports: as it is asked to, of a slow plant by bars if it is not asked."""
    if progress is not None or not plant.slow:
        yield progress
        return
    from tuners.progress import Bars

    with Bars() as bars:
        yield bars


def of_others(plant: Plant, progress: Progress | None) -> Progress | None:
    """The same for stages that simulate nothing: of a slow plant its simulations are counted."""
    if progress is None or not plant.slow:
        return progress
    silent = STAGE, "calibrating"
    return lambda what, done, of: None if what in silent else progress(what, done, of)


def _sent(plant: Plant) -> Callable[[Job], Answer]:
    """What other processes do: the simulator is pickled, by value where no module has it."""
    import cloudpickle

    return partial(_unpacked, cloudpickle.dumps(plant.simulate), plant.batched, _places(plant))


def _places(plant: Plant) -> tuple[str, ...]:
    """Folders in which workers find the plant's module."""
    home = entry.home(plant) if plant.entry else None
    return () if home is None else (str(home),)


def _unpacked(simulate: bytes, batched: bool, places: tuple[str, ...], job: Job) -> Answer:
    return _alone(_function(simulate, places), batched, job)


@lru_cache(maxsize=8)
def _function(simulate: bytes, places: tuple[str, ...]) -> Callable[..., Any]:
    import pickle

    sys.path[:0] = [place for place in places if place not in sys.path]
    function: Callable[..., Any] = pickle.loads(simulate)
    return function


def _alone(simulate: Callable[..., Any], batched: bool, job: Job) -> Answer:
    """The output of one plant, and whether its random numbers were used."""
    *_, theta, u, rng = job
    before = None if rng is None else repr(rng.bit_generator.state)
    try:
        given = theta[None] if batched else theta
        y = np.asarray(simulate(given.copy(), u.copy(), rng), dtype=np.float64)
    except Exception as error:  # an author's own type may not reach another process
        raise RuntimeError(one_line(error)) from None
    shape = (1, len(u)) if batched else (len(u),)
    if y.shape != shape:
        raise RuntimeError(f"its answer has shape {y.shape}, not {shape}")
    return y.reshape(len(u)), rng is not None and repr(rng.bit_generator.state) != before
