"""A vehicle's TOML file: what it gives, and how it is refused."""

import pytest

from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.vehicle_file import VehicleFileError, example, read


@pytest.fixture
def edited(tmp_path):
    """The example with some text replaced, in a file."""

    def edit(old="", new=""):
        assert old in example()
        path = tmp_path / "car.toml"
        path.write_text(example().replace(old, new, 1))
        return path

    return edit


def test_the_example_is_the_papers_vehicle(edited):
    assert read(edited()) == Task()


def test_values_arrive(edited):
    assert read(edited("J_z = 2400.0", "J_z = 3000")).vehicle.J_z == 3000
    assert read(edited("v_x = 20.0", "v_x = [10, 33.0]")).prior.v_x == (10, 33)


def test_experiment_and_target_have_defaults(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(example().partition("[experiment]")[0])
    assert read(path) == Task()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("J_z = 2400.0", "", r"car\.toml: vehicle\.J_z: missing"),
        ("J_z", "J_zz", r"line 6: vehicle\.J_zz: unknown key; there are M_0, J_z"),
        ("J_z = 2400.0", 'J_z = "heavy"', r"line 6: vehicle\.J_z: .*'heavy' is not a number"),
        ("J_z = 2400.0", "J_z = -1", r"line 6: vehicle\.J_z: .* at least 2.4"),
        ("J_z = 2400.0", "J_z = nan", r"line 6: vehicle\.J_z: .* finite"),
        ("J_z = 2400.0", "J_z = true", r"line 6: vehicle\.J_z: .* not a number"),
        ("J_z = 2400.0", "J_z = {a = 1}", r"vehicle\.J_z: wanted a value"),
        ("[0.3, 1.1]", "[1.1, 0.3]", r"line 17: prior\.mu_s: .* low above high"),
        ("[0.3, 1.1]", "[1.1]", r"prior\.mu_s: .* a pair"),
        ("[0.3, 1.1]", "2024-01-01", r"prior\.mu_s: .* a pair"),
        ("[prior]", "[priors]", r"line 16: priors: unknown section; there are vehicle, prior"),
        ("[vehicle]", "", r"unknown section"),
        ('register = "same"', 'register = "other"', r"experiment\.register: .*same, random"),
        ("N = 10_000", "N = 150", r"less than two bits"),
        ("N = 10_000", "N = 1e4000", r"experiment\.N: .* finite"),
        ("crossover = 1.5", "crossover = 60", r"target\.crossover: .* at most 45"),
        ("[vehicle]", "[vehicle", r"is not TOML: .*line 4"),
        ("M_delta = [0.0,", "M_delta = [-5e3,", r"total mass .* above 0"),
    ],
)
def test_mistakes_are_named_with_their_place(edited, old, new, message):
    with pytest.raises(VehicleFileError, match=message) as caught:
        read(edited(old, new))
    assert "car.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_files_that_are_something_else_are_refused(tmp_path):
    with pytest.raises(VehicleFileError, match="No such file"):
        read(tmp_path / "absent.toml")
    (tmp_path / "empty.toml").write_text("")
    with pytest.raises(VehicleFileError, match="vehicle: the section is missing"):
        read(tmp_path / "empty.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleFileError, match="is not TOML"):
        read(tmp_path / "binary.toml")
