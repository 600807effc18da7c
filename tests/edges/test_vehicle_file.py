"""A vehicle's TOML file: what it gives, and how it is refused."""

import pytest

from yawrate_env.plant.entry import from_toml
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


def test_values_arrive_and_experiment_and_target_have_defaults(edited, tmp_path):
    assert read(edited()) == Task()  # the paper's vehicle
    assert read(edited("J_z = 2400.0", "J_z = 3000")).vehicle.J_z == 3000
    assert read(edited("v_x = 20.0", "v_x = [10, 33.0]")).prior.v_x == (10, 33)
    path = tmp_path / "short.toml"
    path.write_text(example().partition("[experiment]")[0])
    assert read(path) == Task()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("J_z = 2400.0", "", "missing.*`J_z`.*vehicle"),
        ("J_z", "J_zz", "unknown.*`J_zz`.*vehicle"),
        ("J_z = 2400.0", 'J_z = "heavy"', "vehicle.J_z"),
        ("J_z = 2400.0", "J_z = -1", "vehicle.*J_z .* at least 2.4"),
        ("J_z = 2400.0", "J_z = nan", "vehicle.*J_z .* finite"),
        ("J_z = 2400.0", "J_z = {a = 1}", "vehicle.J_z"),
        ("[0.3, 1.1]", "[1.1, 0.3]", "prior.*mu_s"),
        ("[0.3, 1.1]", "2024-01-01", "prior.mu_s"),
        ("[vehicle]", "", "unknown.*`M_0`"),
        ('register = "same"', 'register = "other"', "experiment.*register .*same, random"),
        ("N = 10_000", "N = 1e4000", "experiment.N"),
        ("crossover = 1.5", "crossover = 60", "target.*crossover .* at most 45"),
        ("[vehicle]", "[vehicle", "TOML: .*line 4"),
        ("M_delta = [0.0,", "M_delta = [-5e3,", "M_delta = .* at least 189"),
    ],
)
def test_mistakes_are_named_with_file_section_and_key(edited, old, new, message):
    with pytest.raises(VehicleFileError, match=message) as caught:
        read(edited(old, new))
    assert "car.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_files_that_are_something_else_are_refused(tmp_path):
    with pytest.raises(VehicleFileError, match="No such file"):
        read(tmp_path / "absent.toml")
    (tmp_path / "empty.toml").write_text("")
    with pytest.raises(VehicleFileError, match="missing.*`vehicle`"):
        read(tmp_path / "empty.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleFileError, match="is not TOML"):
        read(tmp_path / "binary.toml")


@pytest.mark.parametrize(
    "text, words",
    [
        ("[plant]\nentry = 3", "entry"),
        ("[plant]\nentry = 'first_order:plant'\nname = 'x'", "name"),
        ("plant = 3", "plant"),
        ("[plant", "TOML"),
    ],
)
def test_files_that_name_a_plant_wrongly_are_refused(tmp_path, text, words):
    path = tmp_path / "my.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"\A[^\n]*my.toml[^\n]*{words}[^\n]*\Z"):
        from_toml(path)


def test_a_file_may_name_a_plant(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text("[plant]\nentry = 'first_order:described'\narguments = {noise = 0.5}")
    assert from_toml(path).noise == 0.5
    path.write_text(example())
    assert from_toml(path) is None
