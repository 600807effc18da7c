"""How measurements of size become a line, a table and a picture; and what importing loads."""

import graphlib
import json

import pytest
from imports import imported_names, modules_after
from recordings import ROOT

from studies import dataset_scale
from studies.dataset_scale import Size

SIZES = [Size(n, 2.0 + 1e-4 * n, 500.0, 120.0, 0.0) for n in (1000, 10_000, 100_000)]


def test_a_line_through_sizes_of_equal_weight():
    start, each, error = dataset_scale.fit(SIZES)
    assert start == pytest.approx(2.0) and each == pytest.approx(1e-4) and error < 1e-12
    start, each, error = dataset_scale.fit([*SIZES, Size(1_000_000, 112.2, 500.0, 120.0, 0.0)])
    assert abs(start + 1e3 * each - 2.1) < 0.05 * 2.1 and 0.03 < error < 0.1


def test_report_table_and_picture():
    result = dataset_scale.report([*SIZES, Size(1_000_000, 110.0, 600.0, 120.0, 1e-12)])
    assert json.loads(json.dumps(result)) == result
    text = dataset_scale.to_markdown(result)
    assert "| 100 000 | 12.0 | 8333 | 500 | 120 | equal |" in text
    assert "off by 1.0e-12" in text and "µs × episodes" in text
    left, right = dataset_scale.picture(result).axes
    assert left.get_xlabel() == right.get_xlabel() == "episodes"
    assert right.get_ylim()[1] > dataset_scale.MEMORY_LIMIT


@pytest.mark.slow
def test_a_size_is_measured(tmp_path):
    found = dataset_scale.measure(200, tmp_path)
    assert found.episodes == 200 and found.deviation == 0
    assert found.seconds > 0 and found.peak > 50 and 50 < found.stored < 1000
    assert list(tmp_path.iterdir()) == []


def test_imports_point_down_only():
    modules = sorted((ROOT / "tuners" / "data").glob("*.py"))
    names = {path.stem for path in modules}
    graph = {}
    for path in modules:
        parts = [name.split(".") for name in imported_names(path)]
        graph[path.stem] = {p[2] for p in parts if p[:2] == ["tuners", "data"] and len(p) > 2}
        graph[path.stem] &= names
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises on a cycle
    assert order.index("manifest") < order.index("folder") < order.index("generation")


def test_importing_is_light():
    loaded = modules_after("import tuners.data")
    assert "pyarrow" in loaded
    heavy = {"torch", "xgboost", "distributed", "dask", "joblib", "minari", "pandas", "h5py"}
    assert not loaded & (heavy | {"matplotlib", "tqdm"})
    assert "pyarrow" not in modules_after("import tuners")
