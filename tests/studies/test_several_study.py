"""The study of several logs: cars, their drives, and its page."""

import json

import numpy as np
import pytest

import tuners
from studies import several, several_page
from studies.several import CONDITIONS, CONSTANTS, Called, Gain, Garage, Pooled


def test_another_car_differs_in_one_parameter():
    garage = Garage(0, *CONDITIONS[0])
    for _ in range(20):
        car = garage.car()
        friction = abs(car.other("friction", garage.rng).mu_s - car.mu_s)
        assert friction == pytest.approx(0.2)
        for name in CONSTANTS:
            other = car.other(name, garage.rng).vehicle
            ratio = getattr(other, name) / getattr(car.vehicle, name)
            assert abs(ratio - 1) == pytest.approx(0.2)
            assert [n for n in CONSTANTS if getattr(other, n) != getattr(car.vehicle, n)] == [name]


def test_every_drive_has_an_input_and_a_noise_of_its_own():
    garage = Garage(0, 30.0, 2000)
    car = garage.car()
    one, two = garage.drive(car, 20.0), garage.drive(car, 20.0)
    assert (one.u != two.u).any() and (one.y != two.y).any()
    assert np.isnan(one.known).tolist() == [[True, True, False]]


def test_the_page_holds_the_numbers(tmp_path):
    rows = (
        [Gain("20", "fitted plant", 9, [0.02, 2e-4], [0.01, 1e-4], [2.0, 2.0])],
        [Called("right", 30.0, 10.0, 9, 0.01, 0.0, 0.1, 0.002)],
        [Pooled("right", "20", 9, 9, 0, 0, 9, 0, [0.9, float("nan")])],
    )
    given = {"tuner": "t", "sets": 9, "seed": 0}
    several_page.write(*rows, given, tmp_path)
    found = json.loads((tmp_path / "several.json").read_text())
    page = (tmp_path / "several.md").read_text()
    assert page == several_page.page(found)
    assert "| 2.00 / 2.00 |" in page and "| 1.0% |" in page and "90.0% / –" in page


@pytest.mark.slow
def test_every_table_is_measured():
    tuner = tuners.load("ts-ff-lag-vx")
    gain = several.gains(tuner, "fitted plant", (20.0,) * 4, 20.0, 8, 0)
    assert all(1.0 < ratio < 4.0 for ratio in gain.ratio)  # chance about 2, of 8 sets
    wrong = several.called(tuner, "friction", 20.0, 5000, 4, 0)
    assert wrong.disagrees == 1.0
    named = several.pooled(tuner, "friction", (20.0,) * 4, 20.0, 3, 0)
    assert named.named == 3 and named.missed == 0
