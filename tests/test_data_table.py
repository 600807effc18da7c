"""The table that scikit-learn's users know."""

import numpy as np
import pytest
from test_data_generation import EPISODES, STAGE, TASK, made

from tuners.data import load_gains
from yawrate_env.plant.episodes import examples
from yawrate_env.vehicle.yaw_rate import yaw_rate


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made(tmp_path_factory.mktemp("table") / "data").path


@pytest.mark.parametrize("coordinates, names", [("gains", "kp Ti"), ("loop", "log_gain phase")])
def test_the_table_is_the_usable_part_of_the_data_set(coordinates, names, folder):
    loaded = examples(yaw_rate(TASK), EPISODES, 3, STAGE)
    table = load_gains(folder, coordinates=coordinates)
    np.testing.assert_array_equal(table.data, loaded.features[loaded.usable])
    targets = loaded.targets(yaw_rate(TASK, coordinates).coordinates)
    np.testing.assert_array_equal(table.target, targets[loaded.usable])
    assert np.isfinite(table.data).all() and np.isfinite(table.target).all()
    assert table.feature_names == [f"laguerre_{i}" for i in range(1, 5)]
    assert table.target_names == names.split() and table.frame is None
    assert f"{loaded.usable.sum()} vehicles" in table.DESCR and "55 degrees" in table.DESCR
    assert table["data"] is table.data
    with pytest.raises(AttributeError, match="colour"):
        _ = table.colour


def test_arrays_or_frames(folder):
    table = load_gains(folder)
    X, y = load_gains(folder, return_X_y=True)
    np.testing.assert_array_equal(X, table.data)
    np.testing.assert_array_equal(y, table.target)
    framed = load_gains(folder, as_frame=True)
    assert list(framed.frame) == [*table.feature_names, *table.target_names]
    assert list(framed.data) == table.feature_names and list(framed.target) == ["kp", "Ti"]
    np.testing.assert_array_equal(framed.frame.to_numpy(), np.hstack([X, y]))
    X, y = load_gains(folder, return_X_y=True, as_frame=True)
    assert X.equals(framed.data) and y.equals(framed.target)


def test_without_a_folder_it_is_simulated():
    X, y = load_gains(return_X_y=True)
    assert X.shape == (1500, 10) and y.shape == (1500, 2)
    residual = y - np.c_[X, np.ones(1500)] @ np.linalg.lstsq(np.c_[X, np.ones(1500)], y)[0]
    assert residual[:, 0].std() < 0.1 * y[:, 0].std()  # features tell of the gains


def test_unknown_coordinates_are_refused(folder):
    with pytest.raises(ValueError, match="coordinates = 'polar'"):
        load_gains(folder, coordinates="polar")
