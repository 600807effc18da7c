"""Plants are found by their entry points, or the reason why not is one line."""

import sys

import pytest
from first_order import described, plant

from yawrate_env.plant.entry import find, home, named
from yawrate_env.vehicle.task import Task


def test_entry_points_that_lead_nowhere():
    for entry, words in (
        ("first_order", "no entry point"),
        ("first_order:a b", "no entry point"),
        ("nowhere:plant", "no module 'nowhere'"),
        ("first_order:nothing", "no such attribute"),
        ("first_order:TS", "float"),
        ("first_order:simulate", "-> Plant"),
    ):
        with pytest.raises(ValueError, match=words):
            find(entry)


@pytest.mark.parametrize(
    "code, words",
    [
        ("plant = (", "SyntaxError"),
        ("import sys\nsys.exit(3)", "SystemExit: 3"),
        ("import nowhere_at_all", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("from first_order import described\nplant = described(Ts=0.0)", "ValueError: Ts = 0"),
        ("import os\nos.nothing", "AttributeError"),
        ("raise ValueError('a\\nb')", "ValueError: a b"),
    ],
)
def test_a_module_that_cannot_be_imported_is_one_line(code, words, tmp_path):
    (tmp_path / "broken_plant.py").write_text(code)
    with pytest.raises(ValueError, match=r"\Aimporting broken_plant failed: [^\n]*\Z") as found:
        find("broken_plant:plant", tmp_path)
    assert words in str(found.value) and "broken_plant" not in sys.modules
    sys.path.remove(str(tmp_path))


def test_a_plant_is_found_under_an_entry_that_it_does_not_name(monkeypatch):
    import first_order

    monkeypatch.setattr(first_order, "nameless", described(entry=""), raising=False)
    found = find("first_order:nameless")
    assert found.entry == "first_order:nameless" and first_order.nameless.entry == ""
    assert found.prior == plant.prior and found.metrics == plant.metrics
    with pytest.raises(ValueError, match='entry="module:attribute"'):
        named(first_order.nameless, "A tuner")


def test_a_function_is_called_with_the_arguments():
    found = find("first_order:described", arguments={"noise": 0.5})
    assert (found.noise, found.arguments) == (0.5, {"noise": 0.5})
    with pytest.raises(ValueError, match="arguments"):
        find("first_order:plant", arguments={"noise": 0.5})
    with pytest.raises(ValueError, match="noises"):
        find("first_order:described", arguments={"noises": 0.5})


def test_two_modules_of_one_name_are_not_mistaken(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "clashing.py").write_text("from first_order import described as plant")
    assert home(find("clashing:plant", tmp_path / "a")) == tmp_path / "a"
    assert find("clashing:plant", tmp_path / "a").entry == "clashing:plant"
    with pytest.raises(ValueError, match=f"'clashing'.*{tmp_path / 'a'}.*{tmp_path / 'b'}"):
        find("clashing:plant", tmp_path / "b")
    del sys.modules["clashing"]
    for name in "ab":
        sys.path.remove(str(tmp_path / name))


def test_a_module_that_is_imported_already_is_used_where_the_folder_has_none(tmp_path):
    assert find("first_order:plant", tmp_path) is plant
    sys.path.remove(str(tmp_path))


def test_a_data_file_calls_no_function_that_gives_no_plant(tmp_path):
    there = tmp_path / "there"
    with pytest.raises(ValueError, match="-> Plant"):
        find("os:mkdir", arguments={"path": str(there)})
    assert not there.exists()


def test_an_installed_package_runs_in_the_folder_of_a_clone(tmp_path, monkeypatch):
    (tmp_path / "yawrate_env").mkdir()
    (tmp_path / "yawrate_env" / "__init__.py").write_text("raise RuntimeError")
    monkeypatch.chdir(tmp_path)
    assert find("yawrate_env.vehicle.yaw_rate:from_settings", arguments=Task().settings())
