import numpy as np
import pytest
import scipy.linalg
from systems import contexts

from yawrate_env.loop.discretisation import expm, zoh, zoh_with_sensitivity
from yawrate_env.loop.observer_form import ObserverForm
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space, state_space_sensitivity

SAMPLING_TIMES = [1e-4, 0.001, 0.01, 0.1]


def augmented(A, B, Ts):
    return np.block([[A * Ts, B[:, None] * Ts], [np.zeros((1, len(A) + 1))]])


@pytest.mark.parametrize("Ts", SAMPLING_TIMES)
@pytest.mark.parametrize("xi", [0.9, 1.0])  # 1: the actuator's poles meet, A has no eigenbasis
def test_zoh_is_the_matrix_exponential(Ts, xi):
    A, B, C = state_space(Vehicle(xi=xi), contexts(30, seed=0))
    plant = zoh(A, B, C, Ts)
    for b in range(len(A)):
        E = scipy.linalg.expm(augmented(A[b], B[b], Ts))
        tolerance = 1e-13 * np.abs(E).max()
        np.testing.assert_allclose(plant.A[b], E[:-1, :-1], rtol=0, atol=tolerance)
        np.testing.assert_allclose(plant.B[b], E[:-1, -1], rtol=0, atol=tolerance)
    assert plant.Ts == Ts and len(plant) == 30


@pytest.mark.parametrize("scale", [1e-3, 0.1, 1.0, 30.0])
def test_expm_agrees_with_scipy_at_any_norm(scale):
    X = scale * np.random.default_rng(0).standard_normal((20, 5, 5))
    for ours, theirs in zip(expm(X), scipy.linalg.expm(X), strict=True):
        # At norm 140 scipy is off by 3e-12 and ours by 1e-13, against 60 digits of mpmath.
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())


@pytest.mark.parametrize("Ts", SAMPLING_TIMES)
def test_sensitivities_are_frechet_derivatives(Ts):
    vehicle, context = Vehicle(), contexts(5, seed=1)
    A, B, C = state_space(vehicle, context)
    dA = state_space_sensitivity(vehicle, context)
    plant, dAd, dBd = zoh_with_sensitivity(A, B, C, dA, Ts)
    np.testing.assert_array_equal(plant.A, zoh(A, B, C, Ts).A)
    for b, p in np.ndindex(5, 2):
        X, dX = augmented(A[b], B[b], Ts), augmented(dA[b, p], 0 * B[b], Ts)
        dE = scipy.linalg.expm_frechet(X, dX, compute_expm=False)
        tolerance = 1e-12 * np.abs(dE).max()
        np.testing.assert_allclose(dAd[b, p], dE[:-1, :-1], rtol=0, atol=tolerance)
        np.testing.assert_allclose(dBd[b, p], dE[:-1, -1], rtol=0, atol=tolerance)


def test_one_plant_does_not_depend_on_the_batch():
    # Speeds from 1 to 1000 m/s need different numbers of squarings.
    context = Context.of(0.7, 100.0, np.geomspace(1, 1000, 17))
    A, B, C = state_space(Vehicle(), context)
    together = zoh(A, B, C, 0.01)
    for b in range(17):
        alone = zoh(A[b : b + 1], B[b : b + 1], C, 0.01)
        np.testing.assert_array_equal(alone.A[0], together.A[b])
        np.testing.assert_array_equal(alone.B[0], together.B[b])
    assert expm(np.empty((0, 3, 3))).shape == (0, 3, 3)


@pytest.mark.parametrize("centre", [None, 1.0, 0.3])
def test_observer_form_has_the_plants_response(centre):
    plant = zoh(*state_space(Vehicle(), contexts(5, seed=3)), 0.01)
    form = ObserverForm.of(plant, centre)
    z = np.exp(1j * np.array([0.01, 0.1, 1.0, 3.0]))
    for b, c in enumerate(form.centre):
        companion = c * np.eye(6) + np.eye(6, k=1)
        companion[:, 0] -= form.alpha[b]
        T, A = form.rows[b], plant.A[b]  # w = T x turns (A, B, C) into the companion form
        np.testing.assert_allclose(T @ A, companion @ T, rtol=0, atol=1e-13 * np.abs(T).max())
        np.testing.assert_allclose(T @ plant.B[b], form.beta[b], rtol=0, atol=1e-15)
        np.testing.assert_array_equal(T[0], plant.C)
        ratio = np.polyval([0, *form.beta[b]], z - c) / np.polyval([1, *form.alpha[b]], z - c)
        resolvent = np.linalg.inv(z[:, None, None] * np.eye(6) - A)
        np.testing.assert_allclose(ratio, resolvent @ plant.B[b] @ plant.C, rtol=1e-9)


def test_observer_forms_derivatives_are_central_differences():
    vehicle, context, Ts, h = Vehicle(), contexts(5, seed=4), 0.001, 1e-6
    A, B, C = state_space(vehicle, context)
    dA = state_space_sensitivity(vehicle, context) * [[[[0.5]], [[2000.0]]]]
    plant, dAd, dBd = zoh_with_sensitivity(A, B, C, dA, Ts)
    form = ObserverForm.of(plant, 1.0)
    found = form.sensitivity(plant, dAd, dBd)
    for p in range(2):
        up, down = (ObserverForm.of(zoh(A + s * h * dA[:, p], B, C, Ts), 1.0) for s in (1, -1))
        for exact, name in zip(found, ("alpha", "beta"), strict=True):
            expected = (getattr(up, name) - getattr(down, name)) / (2 * h)
            # Coefficient by coefficient: they span ten powers of ten.
            scale = np.abs(getattr(form, name))
            np.testing.assert_allclose(exact[:, p] / scale, expected / scale, atol=1e-6)
