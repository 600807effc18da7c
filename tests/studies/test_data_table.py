"""The table that scikit-learn's users know."""

import numpy as np
import pytest
from data_sets import STAGE, cars, made

from tuners.data import load_gains
from tuners.tuner.examples import examples


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made(tmp_path_factory.mktemp("table") / "data", 100, of=cars).path


@pytest.mark.parametrize(
    "parametrisation, names", [("gains", "kp Ti"), ("plant", "log_gain phase")]
)
def test_the_table_is_the_usable_part_of_the_data_set(parametrisation, names, folder):
    loaded = examples(cars, 100, 3, STAGE)
    table = load_gains(folder, parametrisation=parametrisation)
    np.testing.assert_array_equal(table.data, loaded.features[loaded.usable])
    targets = loaded.targets(cars.parametrisation) if names[0] == "l" else loaded.gains
    np.testing.assert_array_equal(table.target, targets[loaded.usable])
    assert np.isfinite(table.data).all() and np.isfinite(table.target).all()
    assert table.feature_names == [f"laguerre_{i}" for i in range(1, 5)]
    assert table.target_names == names.split() and table.frame is None
    assert f"{loaded.usable.sum()} plants" in table.DESCR and "yaw_rate" in table.DESCR
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


def test_unknown_parametrisations_are_refused(folder):
    with pytest.raises(ValueError, match="parametrisation = 'polar'"):
        load_gains(folder, parametrisation="polar")
