"""Principal responses: unbiased for any input, where the prior's directions suffice."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from tuners import Recipe
from tuners.features import features_named, settings_of
from tuners.features.laguerre import Laguerre
from tuners.features.principal import PrincipalResponse, principal
from tuners.features.response import FrequencyResponse
from tuners.learners.polynomial import PolynomialSettings
from yawrate_env.signals.excitation import prbs

TS = 0.02
RESPONSE = FrequencyResponse(12, 3.0, 0.1, 1.0, points=4)
FUNCTIONS = Laguerre(12, 3.0)
U = prbs(500, TS, 0.5, 1.0, order=14, start=np.arange(1, 7, dtype=np.uint64))
RNG = np.random.default_rng(0)
MEAN, SPREAD = np.r_[5.0, RNG.standard_normal(11)], 0.3 * RNG.standard_normal((3, 12))
COEFFICIENTS = MEAN + RNG.standard_normal((300, 3)) @ SPREAD
GRAM, _ = FUNCTIONS.normal_equations(U, U, TS, np.empty((0, 500)))


def made(count=3):
    gram = GRAM[np.arange(300) % 6]
    return principal(RESPONSE, count, gram, (gram @ COEFFICIENTS[..., None])[..., 0])


STAGE = made()


def outputs(coefficients):
    return np.einsum("bn,bnk->bk", coefficients, FUNCTIONS.regressors(U, TS))


def test_noise_free_it_is_the_response_whatever_the_input():
    c = COEFFICIENTS[:1]
    features, usable = STAGE(U, outputs(np.repeat(c, 6, axis=0)), TS)
    assert usable.all() and features.shape == (6, STAGE.width)
    omega = 2 * np.pi * np.geomspace(0.1, 1.0, 4)
    response = (c @ FUNCTIONS.frequency_response(omega, TS))[0]
    expected = [*np.log(np.abs(response)), *np.unwrap(np.angle(response))]
    np.testing.assert_allclose(features, np.tile(expected, (6, 1)), atol=1e-5)


def test_noise_of_any_strength_leaves_the_model_without_bias():
    clean = outputs(np.repeat(COEFFICIENTS[:1], 6, axis=0))
    truth, _ = STAGE.model(U, clean, TS)
    for sigma in (1.0, 10.0):
        noisy = np.stack([clean + sigma * RNG.standard_normal(clean.shape) for _ in range(100)])
        z = np.stack([STAGE.model(U, y, TS)[0] for y in noisy])
        error = (z - truth).mean(axis=0) / (z.std(axis=0) / 10)
        assert np.abs(error).max() < 4  # of 18 standard normal numbers
        assert z.std() > 0.05 * sigma * np.sqrt(
            np.linalg.inv(GRAM).diagonal(axis1=1, axis2=2).min()
        )


def test_it_goes_through_a_file():
    written = json.loads(json.dumps(settings_of(STAGE)))
    assert written["name"] == "principal"
    assert features_named(**written) == STAGE
    assert hash(STAGE) == hash(replace(STAGE))


def test_bad_settings_are_refused():
    for changes, words in (
        ({"order": 0}, "order"),
        ({"mean": (1.0,)}, "mean"),
        ({"directions": ()}, "directions"),
    ):
        with pytest.raises(ValueError, match=words):
            PrincipalResponse(**asdict(STAGE) | changes)
    with pytest.raises(ValueError, match="components = 4"):
        made(4)
    for features, count in ((FUNCTIONS, 3), (RESPONSE, -1)):
        with pytest.raises(ValueError, match="components"):
            Recipe(features, PolynomialSettings(), components=count)
