import numpy as np
import pytest

from yawrate_env.vehicle.contexts import CONTEXT_SETS, context_set
from yawrate_env.vehicle.task import Prior

PRIOR = Prior(v_x=(10.0, 33.0))


@pytest.mark.parametrize("name", CONTEXT_SETS)
def test_an_episode_is_known_by_set_seed_and_number(name):
    whole = context_set(name).draw(PRIOR, seed=3, first=0, count=10)
    part = context_set(name).draw(PRIOR, seed=3, first=6, count=2)
    np.testing.assert_array_equal(part.key, whole.key[6:8])
    np.testing.assert_array_equal(part.context.mu_s, whole.context.mu_s[6:8])


def test_sets_share_no_episode_whatever_the_seeds():
    keys = {
        row.tobytes()
        for name in CONTEXT_SETS
        for seed in range(20)
        for row in context_set(name).draw(PRIOR, seed, 0, 20).key
    }
    assert len(keys) == len(CONTEXT_SETS) * 20 * 20


@pytest.mark.parametrize("name", ["train", "test"])
def test_training_and_test_vehicles_come_from_the_tasks_prior(name):
    prior = Prior(mu_s=(0.5, 0.6), M_delta=10.0, v_x=25.0)
    context = context_set(name).draw(prior, 0, 0, 200).context
    assert 0.5 <= context.mu_s.min() < 0.51 and 0.59 < context.mu_s.max() <= 0.6
    assert (context.M_delta == 10).all() and (context.v_x == 25).all()


def test_extrapolation_lies_outside_eq_12_at_the_tasks_speeds():
    context = context_set("extrapolation").draw(PRIOR, 0, 0, 200).context
    assert context.mu_s.min() >= 1.1 and context.M_delta.min() >= 300
    assert 10 <= context.v_x.min() < 11 and 32 < context.v_x.max() <= 33


def test_unknown_sets_are_refused_by_name():
    with pytest.raises(ValueError, match="context = 'tset' is unknown. Choose one of train, test"):
        context_set("tset")
