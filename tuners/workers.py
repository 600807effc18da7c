"""Run jobs in this process, in a pool of processes, or on a cluster.

Results come in any order, and a worker gets another job only when a result has been taken:
they do not pile up in memory where writing is slower than computing, as they would with
``joblib.Parallel``'s generators.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from threading import Thread
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Result = TypeVar("Result")
Size = Callable[[], int]

LOCAL = "local"
"""In place of a scheduler's address: start a cluster on this machine."""

_SECONDS = 30  # to reach a scheduler, and for a first worker to appear
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}


class WorkersError(ValueError):
    """Workers that cannot be reached, or that died."""


class Pool:
    """Does jobs in this process, or through an executor.

    Parameters
    ----------
    executor : Executor, optional
        Does them in this process if omitted.
    size : callable
        How many jobs the executor does at a time.
    """

    def __init__(self, executor: Executor | None = None, size: Size = lambda: 1) -> None:
        self._executor, self._size = executor, size

    def begin(self, work: Callable[[Job], Result], job: Job) -> Future[Result] | None:
        """Begin a job that is needed later; None where there is nobody else to do it."""
        return None if self._executor is None else self._executor.submit(work, job)

    def results(
        self, work: Callable[[Job], Result], jobs: Iterator[Job]
    ) -> Iterator[tuple[Job, Result]]:
        """Do `jobs`, each as ``work(job)``; pairs of job and result, in any order."""
        if self._executor is None:
            yield from ((job, work(job)) for job in jobs)
            return
        running: dict[Future[Result], Job] = {}
        while True:
            some = islice(jobs, max(2 * self._size() - len(running), 0))
            running |= {self._executor.submit(work, job): job for job in some}
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


def results(
    work: Callable[[Job], Result], jobs: Sequence[Job], workers: int, scheduler: str | None
) -> Iterator[tuple[Job, Result]]:
    """Do `jobs`, each as ``work(job)``, in a `pool` of their own, no larger than they need."""
    if jobs:
        with pool(min(workers, len(jobs)), scheduler) as some:
            yield from some.results(work, iter(jobs))


@contextmanager
def pool(workers: int, scheduler: str | None) -> Iterator[Pool]:
    """Workers, until they are no longer needed.

    Parameters
    ----------
    workers : int
        Processes on this machine; 1 is this one, with all its threads.
    scheduler : str, optional
        Address of a Dask scheduler, ``"tcp://host:8786"``, or `LOCAL`.

    Raises
    ------
    WorkersError
        The scheduler cannot be used, or a worker died.
    """
    if scheduler is None and workers == 1:
        yield Pool()
        return
    with _executor(workers, scheduler) as (executor, size):
        yield Pool(executor, size)


@contextmanager
def _executor(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, Size]]:
    """An executor, and how many jobs it does at a time; a cluster may grow."""
    if scheduler is not None:
        with _cluster(workers, scheduler) as found:
            yield found
        return
    from joblib.externals.loky import ProcessPoolExecutor

    try:
        with ProcessPoolExecutor(
            workers, env=_ONE_THREAD, initializer=_end_with, initargs=(os.getpid(),)
        ) as pool:
            yield pool, lambda: workers
    except BrokenExecutor:
        raise WorkersError(
            "A worker died, perhaps for want of memory. Choose fewer workers, or smaller jobs; "
            "what is finished stays."
        ) from None


def _end_with(parent: int) -> None:
    """End this worker soon after its parent: one that is killed cannot tell its workers."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def _cluster(workers: int, scheduler: str) -> Iterator[tuple[Executor, Size]]:
    from distributed import Client, KilledWorker

    try:
        if scheduler == LOCAL:
            client = Client(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
        else:
            client = Client(scheduler, timeout=_SECONDS)
            client.wait_for_workers(1, timeout=_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise WorkersError(
            f"scheduler {scheduler!r} cannot be used: {error}. Start `dask scheduler` and at "
            "least one `dask worker`, with this package installed, and name its tcp:// address."
        ) from None
    try:
        with client:
            _check_installed(client)
            yield client.get_executor(pure=False), lambda: max(sum(client.nthreads().values()), 1)
    except KilledWorker as error:
        raise WorkersError(
            f"One job brought down several workers, perhaps for want of memory: {error}. "
            "Choose smaller jobs; what is finished stays."
        ) from None


def _check_installed(client: "Client") -> None:
    """`WorkersError` where this package is missing: a worker would die of its job silently."""

    def has_it() -> bool:  # pickled by value, being local
        return find_spec("tuners") is not None

    found = {"the scheduler": client.run_on_scheduler(has_it), **client.run(has_it)}
    missing = [who for who, has in found.items() if not has]
    if missing:
        raise WorkersError(
            f"This package is not installed where {', '.join(missing)} runs. Install it there."
        )
