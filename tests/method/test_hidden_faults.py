"""Faults that a prior hides are those that another plant of the prior explains."""

from first_order import SIGMA, TS, U, described

import tuners
from tuners.tuner.hidden_faults import as_record, hidden_faults, sentences


def of(plant):
    return {each.fault: each for each in hidden_faults(tuners.load("gb", plant))}


def test_an_unknown_gain_hides_a_wrong_scale():
    found = of(described())
    scaled = found["an output scaled by 1.5"]
    # Plants that stay in the prior: K below 2/1.5; kp is then off by 1/1.5 - 1.
    assert 0.45 < scaled.share < 0.75
    assert abs(scaled.cost["relative_error_of_kp"] - 1 / 3) < 0.02
    assert scaled.cost["relative_error_of_Ti"] < 0.05
    assert not any("sign" in fault or "time" in fault for fault in found)


def test_a_known_gain_hides_none():
    known = described(prior={"K": (1.3, 1.3), "T": (0.2, 1.0)})
    assert not any("scaled" in fault or "actuator" in fault for fault in of(known))


def test_what_is_hidden_is_printed_kept_and_quoted(tmp_path):
    plant = described()
    tuner = tuners.load("gb", plant)
    hidden = hidden_faults(tuner)
    said = sentences(hidden)
    assert len(said) == 1 + len(hidden) and "kp" in said[1] and sentences([]) == []
    tuner.training["hides"] = as_record(hidden)
    tuner.save(tmp_path / "lag.tuner")
    again = tuners.load(tmp_path / "lag.tuner", plant)
    y = plant.respond(plant.middle)[0] + SIGMA * U
    (note,) = (n for n in again.tune(U, y, TS).notes if "scaled by 1.5" in n)
    assert hidden[0].fault in note
