import subprocess
import sys
import threading

import numpy as np
import pytest
from numba.core import caching

from yawrate_env import compiled


@pytest.mark.parametrize("cores", [1, 4])
@pytest.mark.parametrize("items", [0, 1, 15, 16, 17, 160])
def test_blocks_cover_every_item_once(monkeypatch, cores, items):
    monkeypatch.setattr(compiled, "cores", lambda: cores)
    counts, sizes = np.zeros(items, dtype=int), []

    def work(start, stop):
        counts[start:stop] += 1
        sizes.append(stop - start)

    compiled.over_blocks(work, items, 16)
    assert (counts == 1).all()
    assert max(sizes, default=1) <= 16


@pytest.mark.parametrize("cores", [1, 4])
def test_an_error_in_a_block_reaches_the_caller_and_no_thread_stays(monkeypatch, cores):
    monkeypatch.setattr(compiled, "cores", lambda: cores)
    before = threading.active_count()
    with pytest.raises(ZeroDivisionError):
        compiled.over_blocks(lambda i, j: 1 // (48 - i), 160, 16)
    assert threading.active_count() == before


def triangular(n):
    total = 0
    for k in range(n):
        total += k + 1
    return total


def test_kernel_compiles_afresh_where_there_is_no_place_for_a_cache(monkeypatch):
    # Numba raises this way for a read-only package and home: every locator declines.
    monkeypatch.setattr(caching.FunctionCache._impl_class, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="cannot cache function"):
        compiled.njit(cache=True)(triangular)
    assert compiled.kernel(triangular)(100) == 5050


@pytest.mark.slow  # every kernel is compiled again: 15 s
def test_the_environment_works_without_a_cache():
    program = """
from numba.core import caching
caching.FunctionCache._impl_class._locator_classes = []
import gymnasium, yawrate_env
env = gymnasium.make("yawrate/PITuning-v0", N=500)
env.reset(seed=0)
assert -5 <= env.step(env.action_space.sample())[1] <= 0
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("limit, found", [("1", 1), ("", None), ("0", None), ("4,2", None)])
def test_workers_are_told_how_many_cores_they_have(limit, found, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    processors = compiled.cores()
    monkeypatch.setenv("OMP_NUM_THREADS", limit)
    assert compiled.cores() == (found or processors)
    monkeypatch.setenv("OMP_NUM_THREADS", str(processors + 1))
    assert compiled.cores() == processors
