"""Compilation of the inner loops, and their distribution over the cores.

Numba was chosen over a C extension: a fresh machine needs no compiler, and the
kernels stay readable beside the equations.  Three choices shape every kernel:

* ``nogil`` kernels over Python threads instead of ``parallel=True``: Numba's own
  thread pools do not survive a fork, and ``AsyncVectorEnv`` forks.
* ``LANES`` episodes side by side in the innermost loop, so that the compiler fills
  the vector registers; below 16 LLVM unrolls that loop into scalar code instead.
  Blocks are padded to full lanes, so an episode's numbers never depend on how many
  others were computed with it.
* only the ``contract`` flag of fast-math (fused multiply-add): no reordering, and
  not-a-number stays not-a-number.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from typing import Any, TypeVar

from numba import njit
from numba.core import caching
from numba.core.runtime.nrt import rtsys

LANES = 16

_FunctionCache: Any = caching.FunctionCache  # typed in part

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile `function`, cached on disk where there is a place to write.

    A read-only installation without a writable home has no such place: Numba then
    raises at decoration, and the kernel is compiled afresh in every process.
    """
    return _compiled(function, {})


def subkernel(function: _Function) -> _Function:
    """A `kernel` that kernels call, and Python cannot: it compiles without that entry."""
    return _compiled(function, {"no_cpython_wrapper": True})


def _compiled(function: _Function, further: dict[str, Any]) -> _Function:
    options: dict[str, Any] = {
        "nogil": True,
        "fastmath": {"contract"},
        "error_model": "numpy",
        "no_cfunc_wrapper": True,  # nothing here is called from C
    }
    compiled: Any = njit(**options, **further)(function)
    with suppress(RuntimeError):
        compiled._cache = _Cache(function)
    return compiled  # type: ignore[no-any-return]


class _Cache(_FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk, quick to load from, and begun again where its files are damaged.

    Numba's own imports what compiling needs before it loads; that takes as long as all else that
    `yawrate tune` does before it reads a log.  What compiles imports it itself.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature; None if it is not there, or damaged."""
        rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:  # pickle raises all kinds on files that were cut short
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled function, if the files can be written."""
        try:
            super().save_overload(sig, data)
        except OSError:  # a full disk costs the cache only
            return


def inlined(function: _Function) -> _Function:
    """Compile `function` into the kernels that call it; a call would end vectorisation."""
    compiled: Any = njit(inline="always", error_model="numpy")(function)
    return compiled  # type: ignore[no-any-return]


def cores() -> int:
    """Processors that this process may use; joblib and Dask tell their workers by the variable."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    if limit.isdecimal() and int(limit) > 0:
        return min(int(limit), _processors())
    return _processors()


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def over_blocks(work: Callable[[int, int], None], items: int, block: int) -> None:
    """Call ``work(start, stop)`` on consecutive blocks of `items`, one thread a core.

    The caller's thread is one of them.  The others live for this call only: they cost tens of
    microseconds, and nothing is left behind that a forked child could trip over.
    """
    blocks = range(0, items, block)
    starts, errors = iter(blocks), list[BaseException]()  # a thread that asks gets the next start

    def some() -> None:
        try:
            for start in starts:
                work(start, min(start + block, items))
        except BaseException as error:
            errors.append(error)
            for _ in starts:  # so that no thread begins another block
                pass

    threads = [Thread(target=some) for _ in range(min(cores(), len(blocks)) - 1)]
    for thread in threads:
        thread.start()
    some()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
