import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numba.core import caching
from recordings import ROOT

from yawrate_env import compiled


@pytest.mark.parametrize("cores", [1, 4])
@pytest.mark.parametrize("items", [0, 1, 16, 17, 160])
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
    before, begun = threading.active_count(), []

    def work(start, stop):
        begun.append(start)
        time.sleep(0.001)
        return 1 // (48 - start)

    with pytest.raises(ZeroDivisionError):
        compiled.over_blocks(work, 1600, 16)
    assert threading.active_count() == before
    assert len(begun) <= 4 + 2 * cores  # each thread may have had one in hand


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


NOISE = """
import numpy as np
import yawrate_env
from yawrate_env.signals import noise
noise.standard_normal(np.ones((1, noise.KEY_WORDS), np.uint64), 10)
kernels = [k for k in vars(noise).values() if hasattr(k, "stats")]
print(yawrate_env.__file__)
print(sum(sum(k.stats.cache_misses.values()) for k in kernels))
"""


def compiled_in(installation, **environment):
    """How many kernels the package in a folder compiles afresh for one noise stream."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")}
    done = subprocess.run(
        [sys.executable, "-c", NOISE],
        cwd=installation,
        env=inherited | {"PYTHONPATH": str(installation)} | environment,
        check=True,
        capture_output=True,
        text=True,
    )
    where, count = done.stdout.split()
    assert Path(where).is_relative_to(installation)
    return int(count)


@pytest.fixture
def installation(tmp_path):
    """The package copied as an installer would, without caches."""
    source = Path(compiled.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(source, tmp_path / source.name, ignore=ignored)
    return tmp_path


def test_an_installed_package_compiles_once(installation):
    assert compiled_in(installation) > 0
    assert compiled_in(installation) == 0


def test_the_package_works_without_a_cache(installation):
    # Root may write to read-only folders, but nobody makes a folder where a file is.
    for folder in ("yawrate_env", "yawrate_env/signals"):
        (installation / folder / "__pycache__").touch()
    nowhere = "/dev/null/nowhere"
    assert compiled_in(installation, HOME=nowhere, XDG_CACHE_HOME=nowhere) > 0
    assert not list(installation.rglob("*.nb?"))


@pytest.mark.parametrize("limit, found", [("1", 1), ("", None), ("0", None), ("4,2", None)])
def test_workers_are_told_how_many_cores_they_have(limit, found, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    processors = compiled.cores()
    monkeypatch.setenv("OMP_NUM_THREADS", limit)
    assert compiled.cores() == (found or processors)
    monkeypatch.setenv("OMP_NUM_THREADS", str(processors + 1))
    assert compiled.cores() == processors


def test_an_answer_compiles_every_kernel_for_one_type():
    """Compiling is most of the time to a first answer."""
    program = (
        "import contextlib, sys; from numba.core.dispatcher import Dispatcher\n"
        "from tuners.cli import main\n"
        "with contextlib.suppress(SystemExit): main(['tune', 'examples/log.csv'])\n"
        "kernels = {id(k): k for m in list(sys.modules.values()) for k in vars(m).values()\n"
        "           if isinstance(k, Dispatcher) and m.__name__.startswith('yawrate_env')}\n"
        "used = {k.py_func.__name__: len(k.signatures) for k in kernels.values() if k.signatures}\n"
        "print('\\n', {name for name, count in used.items() if count > 1}, '_expm' in used)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert done.stdout.split("\n")[-2].strip() == "set() True"
