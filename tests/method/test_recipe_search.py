"""The search for a recipe: when it begins, what it varies, what it keeps, and what it advises."""

from dataclasses import replace

import numpy as np
import pytest
from data_sets import wandering
from first_order import described
from first_order import plant as lag
from slow_plant import calls
from slow_plant import plant as slow

import tuners
from tuners.cli.train import recipe_table
from tuners.tuner import recipe_search
from tuners.tuner.against_bound import ENOUGH, Comparison, Errors
from tuners.tuner.recipe_search import GROWTH, Search
from tuners.tuner.recipes import USUAL, Candidate, Sizes, recipe_for, sizes_of
from tuners.tuner.remedy import remedy
from yawrate_env.plant.distributions import LogRange
from yawrate_env.plant.episodes import sample

FEW = {"episodes": 60, "calibration": 100}


@pytest.fixture
def small(monkeypatch):
    """A small pilot."""
    for name, value in {"_PILOT": 60, "_HELD": 64, "_EPOCHS": 8}.items():
        monkeypatch.setattr(recipe_search, name, value)


def errors(plant, values, bound=1.0):
    theta = sample(plant, 256)
    values = np.broadcast_to(values, (256,))[None, :, None]
    return Errors(theta, values, np.full((256, 1), bound))


def test_a_ratio_is_of_root_mean_squares_and_a_quarter_is_the_worst_by_bound():
    bound = np.repeat([1.0, 2.0, 4.0, 8.0], 10)
    factor = np.repeat([3.0, 1.0, 1.0, 1.0], 10)
    found = Errors(np.zeros((40, 1)), (factor * bound)[None, :, None], bound[:, None])
    assert found.ratio() == pytest.approx(np.sqrt((9 + 4 + 16 + 64) / 85))
    assert found.quarter == pytest.approx(3.0)
    assert found.ratio().max() < ENOUGH and not found.enough
    near = replace(found, values=1.05 * bound[None, :, None])
    assert near.enough and near.better_than(found) and not found.better_than(near)
    assert Comparison(found, near).refined and not Comparison(near, found).refined
    lost = np.where(np.arange(40) % 2, np.nan, near.values[0, :, 0])
    assert replace(near, values=lost[None, :, None]).ratio() == pytest.approx(1.05)


def test_near_the_bound_nothing_is_searched(monkeypatch):
    monkeypatch.setattr(recipe_search._Validation, "of", None)
    tuner = tuners.train(lag, sizes=Sizes(plants=300), calibration=100)
    (only,) = tuner.training["search"]["tried"]
    own = tuner.training["against_bound"]["learner"]["ratio"]
    fitted = tuner.training["against_bound"]["fitted_plant"]["ratio"]
    assert only["chosen"] and only["ratio"] == own
    assert min(max(own.values()), max(fitted.values())) <= ENOUGH
    usual = tuners.train(replace(recipe_for(lag), episodes=300), lag)
    np.testing.assert_array_equal(usual.method.learner.W1, tuner.method.learner.W1)


def test_where_neither_is_near_the_best_recipe_is_kept_and_a_remedy_is_told(small, tmp_path):
    plant = described(simulate=wandering)
    with pytest.warns(UserWarning, match="random"):
        tuner = tuners.train(plant, **FEW)
    tried = tuner.training["search"]["tried"]
    stages = [row["stage"] for row in tried]
    assert stages[0] == "usual" and set(stages[1:]) <= {"pilot", "grown"} and "grown" in stages
    final = [row for row in tried if row["stage"] != "pilot"]
    (chosen,) = (row for row in tried if row["chosen"])
    assert chosen in final
    assert max(chosen["ratio"].values()) <= min(max(row["ratio"].values()) for row in final) / 0.98
    assert all(row["plants"] == 60 for row in tried)  # as given
    orders = {row["order"] for row in tried if row["stage"] == "pilot"}
    poles = {row["pole"] for row in tried if row["stage"] == "pilot"}
    assert len(orders) == 4 and len(poles) > 2
    lines = recipe_table(tuner)
    assert len(lines) == len(tried) + 3 and sum("chosen" in line for line in lines) == 1
    with pytest.warns(UserWarning, match="random"):
        again = tuners.train(plant, **FEW)
    again.save(tmp_path / "again.tuner")
    tuner.save(tmp_path / "tuner.tuner")
    files = ((tmp_path / f"{name}.tuner").read_bytes() for name in ("again", "tuner"))
    assert len(set(files)) == 1
    assert (
        tuners.load(tmp_path / "tuner.tuner", plant).training["search"] == again.training["search"]
    )


def test_sizes_that_are_given_are_not_searched(small):
    sizes = Sizes(order=6, pole=2.5, neurons=5)
    tuner = tuners.train(lag, sizes=sizes, **FEW, alone=True)
    search = tuner.training["search"]
    assert search["given"] == ["order", "pole", "neurons", "plants"]
    for row in search["tried"]:
        assert (row["order"], row["pole"], row["plants"]) == (6, 2.5, 60)
    assert {row["neurons"] for row in search["tried"] if row["stage"] != "pilot"} == {5}
    assert tuner.method.features.order == 6 and len(tuner.method.learner.b1) == 5


@pytest.mark.slow
def test_alone_a_learner_is_searched_where_the_fitted_plant_would_do(small, monkeypatch):
    monkeypatch.setattr("tuners.tuner.recipes.NEURONS", 3)
    usual = tuners.train(lag, calibration=100)
    assert len(usual.training["search"]["tried"]) == 1
    assert usual.training["answers"] == "FITTED_PLANT"
    alone = tuners.train(lag, calibration=100, alone=True)
    tried = alone.training["search"]["tried"]
    plants = {row["plants"] for row in tried if row["stage"] == "grown"}
    assert plants <= {1000 * times for _, times in GROWTH} and plants
    ratios = [max(t.training["against_bound"]["learner"]["ratio"].values()) for t in (usual, alone)]
    assert ratios[1] < ratios[0]


@pytest.mark.parametrize(
    "arguments", [{"sizes": Sizes(order=3)}, {"alone": True}, {"sizes": "order"}]
)
def test_recipes_of_ones_own_are_not_searched(arguments):
    with pytest.raises(ValueError, match=next(iter(arguments))):
        tuners.train(recipe_for(lag), lag, **arguments)


@pytest.mark.parametrize("wrong", [
    {"order": 0}, {"pole": -1.0}, {"neurons": 1.5}, {"neurons": 10**6}, {"plants": 0},
])  # fmt: skip
def test_wrong_sizes_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Sizes(**wrong)


def test_sizes_of_a_recipe_make_it_again():
    recipe = recipe_for(lag, Sizes(order=5, neurons=7, plants=300))
    assert recipe_for(lag, sizes_of(recipe)) == recipe


def grown(*ratios):
    sizes = (Sizes(8, 1.0, 16, 1000 * 2**k) for k in range(len(ratios)))
    return [Candidate(s, "grown", np.array([r])) for s, r in zip(sizes, ratios, strict=True)]


def test_a_remedy_names_the_end_where_the_error_is():
    theta = sample(lag, 256)
    high = np.where(theta[:, 0] > 1.7, 6.0, 1.0)
    said = remedy(lag, errors(lag, high), grown(2.0, 2.0))
    assert "narrow" in said and "K above 1.7" in said
    wide = described(prior={"K": (0.1, 10.0), "T": (0.2, 1.0)})
    low = np.where(sample(wide, 256)[:, 0] < 2.0, 6.0, 1.0)
    assert "log-uniform" in remedy(wide, errors(wide, low), grown(2.0, 2.0))
    already = described(prior={"K": LogRange(0.1, 10.0), "T": (0.2, 1.0)})
    low = np.where(sample(already, 256)[:, 0] < 0.2, 6.0, 1.0)
    said = remedy(already, errors(already, low), grown(2.0, 2.0))
    assert "log-uniform" not in said and "K below" in said


def test_a_remedy_tells_how_many_plants_the_pilots_trend_asks_for():
    even = errors(lag, 1.5)
    # The excess of the squares halves with twice the plants: from 3 over 1.5 to 0.21 in 2.8 steps.
    said = remedy(lag, even, grown(2.0, np.sqrt(2.5)))
    assert "--episodes 10000" in said
    assert "plants" not in remedy(lag, even, grown(1.5, 1.5))
    assert "random" in remedy(described(simulate=wandering), even, grown(2.0, 1.5))


def test_a_slow_plant_gets_no_more_plants_than_its_simulations_allow():
    usual = recipe_for(slow)
    for before, after in ((1000, 2000), (4500, 4500)):
        search = Search(recipe_for, USUAL, replace(usual, episodes=before), 0, 500)
        assert search._larger(slow, USUAL, 1.5, 2).episodes == after


class Killed(Exception):
    """Ends a training."""


@pytest.mark.slow
def test_a_search_on_a_slow_plant_is_the_same_killed_or_not_for_any_workers(
    small, tmp_path, monkeypatch
):
    monkeypatch.setattr("tuners.tuner.recipes.plants_for", lambda plant: 128)
    monkeypatch.setattr("tuners.catalogue.plants_for", lambda plant: 128)
    monkeypatch.setattr("tuners.tuner.recipes.NEURONS", 4)
    for module in ("against_bound", "training"):
        monkeypatch.setattr(f"tuners.tuner.{module}.EPISODES", 64)

    def trained(name, workers):
        tuner = tuners.train(slow, calibration=60, alone=True, workers=workers,
                             checkpoint=tmp_path / name, progress=lambda *_: None)  # fmt: skip
        tuner.save(tmp_path / f"{name}.tuner")
        assert any(row["stage"] == "grown" for row in tuner.training["search"]["tried"])
        return (tmp_path / f"{name}.tuner").read_bytes()

    monkeypatch.setattr(recipe_search, "ENOUGH", 0.5)  # so that it is searched
    calls.clear()
    whole = trained("whole", 1)
    first = len(calls)
    # 640 of steps, 128 to judge with at up to 5 each, 128 to check with; and 512 to learn from, 128
    # held out, 32 whose pole is sought.
    assert first < 2100
    with monkeypatch.context() as patch:
        patch.setattr(recipe_search, "fit", lambda *_, **__: (_ for _ in ()).throw(Killed))
        with pytest.raises(Killed):
            trained("killed", 2)
    assert trained("killed", 2) == whole


def test_a_learner_that_further_plants_find_near_the_bound_stays(small, monkeypatch):
    monkeypatch.setattr(
        recipe_search._Validation, "ratio", lambda held, stages: np.array([1.0, 1.05])
    )
    with pytest.warns(UserWarning, match="bound"):
        tuner = tuners.train(described(simulate=wandering), **FEW)
    assert tuner.training["answers"] == "METHOD"
    assert [row["stage"] for row in tuner.training["search"]["tried"]] == ["usual"]
