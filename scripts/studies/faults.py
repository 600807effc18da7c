"""Bad and foreign recordings, to find out whether they are recognised.

Each kind is a function of a task, a generator and a number of recordings.  What is true
and what the recording claims differ on purpose: gains are evaluated on the true vehicle.
Severities were fixed before anything was measured.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.faulty import Faulty, Rng, claimed_speed, driven, of_prior, recorded, scaled, strength
from tuners.tuner.recording import Recording
from yawrate_env.batch import concatenate
from yawrate_env.vehicle.single_track import CONSTANTS, Context
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]

Kind = Callable[[Task, Rng, int], Faulty]


def _usual(task: Task, rng: Rng, count: int) -> tuple[Context, Array, Array, Array, Array]:
    context = of_prior(task, rng, count)
    u, clean, noise = recorded(task, context, rng)
    return context, u, clean, noise, strength(clean)


def _claim(
    task: Task,
    u: Array,
    y: Array,
    context: Context,
    *,
    v_x: Array | None = None,
    real: bool = True,
) -> Faulty:
    known = claimed_speed(context.v_x if v_x is None else v_x)
    recording = Recording(np.ascontiguousarray(u), y, task.experiment.Ts, known)
    return Faulty(recording, context, real)


def wrong_sampling_time(task: Task, rng: Rng, count: int) -> Faulty:
    """Recorded at half, 0.8, 1.25 or twice the sampling time that is claimed."""
    parts = []
    for factor, n in zip((0.5, 0.8, 1.25, 2.0), _quarters(count), strict=True):
        context = of_prior(task, rng, n)
        u, clean, noise = recorded(task, context, rng, Ts=task.experiment.Ts * factor)
        parts.append((context, u, clean + noise))
    return _joined(task, parts)


def wrong_speed(task: Task, rng: Rng, count: int) -> Faulty:
    """The claimed speed is 3 to 8 m/s off, either way."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    off = rng.uniform(3, 8, count) * rng.choice([-1, 1], count)
    true = replace(context, v_x=context.v_x + off)
    u, clean, noise = recorded(task, true, rng)
    return _claim(task, u, clean + noise, true, v_x=context.v_x)


def wrong_unit(task: Task, rng: Rng, count: int) -> Faulty:
    """One of the two channels in degrees."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    first = rng.random((count, 1)) < 0.5
    factor = np.degrees(1.0)
    y = clean + noise
    return _claim(task, np.where(first, factor * u, u), np.where(first, y, factor * y), context)


def swapped(task: Task, rng: Rng, count: int) -> Faulty:
    """Command and yaw rate exchanged."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    return _claim(task, clean + noise, u, context)


def reversed_sign(task: Task, rng: Rng, count: int) -> Faulty:
    """Steering counted positive to the other side."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    return _claim(task, -u, clean + noise, context)


def weak_input(task: Task, rng: Rng, count: int) -> Faulty:
    """A hundredth of the amplitude under the usual noise."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    return _claim(task, u / 100, clean / 100 + noise, context)


def constant_input(task: Task, rng: Rng, count: int) -> Faulty:
    """The steering is held; a vehicle that goes round in circles."""
    context, u, _, noise, _ = _usual(task, rng, count)
    held = np.full_like(u, task.experiment.amplitude)
    clean = driven(task, context, held)
    return _claim(task, held, clean + noise, context)


def clipped(task: Task, rng: Rng, count: int) -> Faulty:
    """The sensor saturates at 0.3 to 0.7 of the peak."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    y = clean + noise
    limit = rng.uniform(0.3, 0.7, (count, 1)) * np.abs(y).max(axis=1, keepdims=True)
    return _claim(task, u, np.clip(y, -limit, limit), context)


def dies(task: Task, rng: Rng, count: int) -> Faulty:
    """The sensor sticks at its value from 2 to 8 s on."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    y = clean + noise
    N = y.shape[1]
    at = (rng.uniform(0.2, 0.8, count) * N).astype(int)
    stuck = np.arange(N) >= at[:, None]
    return _claim(task, u, np.where(stuck, y[np.arange(count), at][:, None], y), context)


def dead(task: Task, rng: Rng, count: int) -> Faulty:
    """The sensor shows a constant and its last digit."""
    context, u, clean, _, rms = _usual(task, rng, count)
    y = rms + 1e-4 * rng.integers(-1, 2, clean.shape)
    return _claim(task, u, y, context, real=False)


def noise_alone(task: Task, rng: Rng, count: int) -> Faulty:
    """White noise of the strength of a yaw rate."""
    context, u, clean, _, rms = _usual(task, rng, count)
    return _claim(task, u, rms * rng.standard_normal(clean.shape), context, real=False)


def hum(task: Task, rng: Rng, count: int) -> Faulty:
    """A sinusoid of 0.5 to 10 Hz, half to twice as strong as the yaw rate."""
    context, u, clean, noise, rms = _usual(task, rng, count)
    t = np.arange(clean.shape[1]) * task.experiment.Ts
    f, phase = rng.uniform(0.5, 10, (count, 1)), rng.uniform(0, 2 * np.pi, (count, 1))
    amplitude = np.sqrt(2) * rms * rng.uniform(0.5, 2, (count, 1))
    return _claim(task, u, clean + noise + amplitude * np.sin(2 * np.pi * f * t + phase), context)


def bias_step(task: Task, rng: Rng, count: int) -> Faulty:
    """The sensor's offset jumps by half to twice the yaw rate's strength, at 2 to 8 s."""
    context, u, clean, noise, rms = _usual(task, rng, count)
    N = clean.shape[1]
    late = np.arange(N) >= rng.uniform(0.2, 0.8, (count, 1)) * N
    return _claim(task, u, clean + noise + late * rms * rng.uniform(0.5, 2, (count, 1)), context)


def friction_outside(task: Task, rng: Rng, count: int) -> Faulty:
    """Friction of ice (0.1 to 0.2), or of no known road (1.4 to 2)."""
    context = of_prior(task, rng, count)
    mu_s = np.where(
        rng.random(count) < 0.5, rng.uniform(0.1, 0.2, count), rng.uniform(1.4, 2, count)
    )
    context = replace(context, mu_s=mu_s)
    u, clean, noise = recorded(task, context, rng)
    return _claim(task, u, clean + noise, context)


def mass_outside(task: Task, rng: Rng, count: int) -> Faulty:
    """600 to 1500 kg too heavy, or 400 to 800 kg too light."""
    context = of_prior(task, rng, count)
    heavy = rng.random(count) < 0.5
    M_delta = np.where(heavy, rng.uniform(600, 1500, count), -rng.uniform(400, 800, count))
    context = replace(context, M_delta=M_delta)
    u, clean, noise = recorded(task, context, rng)
    return _claim(task, u, clean + noise, context)


def another_vehicle(task: Task, rng: Rng, count: int) -> Faulty:
    """Every parameter of the vehicle multiplied by 0.6 to 1.6."""
    context = of_prior(task, rng, count)
    for name in CONSTANTS:
        if name != "xi":
            context = scaled(task.vehicle, context, name, rng.uniform(0.6, 1.6, count))
    u, clean, noise = recorded(task, context, rng)
    return _claim(task, u, clean + noise, context)


def gaps(task: Task, rng: Rng, count: int) -> Faulty:
    """Three gaps of 0.05 to 0.5 s that the recording does not show."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    y, N = clean + noise, clean.shape[1]
    for i in range(count):
        kept = np.ones(N, dtype=bool)
        for at in rng.uniform(0.1, 0.9, 3):
            kept[int(at * N) : int(at * N + rng.uniform(0.005, 0.05) * N)] = False
        filler = np.resize(np.flatnonzero(kept), N)
        u[i], y[i] = u[i, filler], y[i, filler]
    return _claim(task, u, y, context)


def late(task: Task, rng: Rng, count: int) -> Faulty:
    """The yaw rate was logged 0.05 to 0.2 s late."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    shift = (rng.uniform(0.05, 0.2, count) / task.experiment.Ts).astype(int)
    delayed = np.stack(
        [np.concatenate([np.zeros(s), c[: len(c) - s]]) for s, c in zip(shift, clean, strict=True)]
    )
    return _claim(task, u, delayed + noise, context)


def backwards(task: Task, rng: Rng, count: int) -> Faulty:
    """Time runs the other way."""
    context, u, clean, noise, _ = _usual(task, rng, count)
    return _claim(task, u[:, ::-1], np.ascontiguousarray((clean + noise)[:, ::-1]), context)


KINDS: dict[str, Kind] = {
    kind.__name__.replace("_", " "): kind
    for kind in (
        wrong_sampling_time, wrong_speed, wrong_unit, swapped, reversed_sign, weak_input,
        constant_input, clipped, dies, dead, noise_alone, hum, bias_step, friction_outside,
        mass_outside, another_vehicle, gaps, late, backwards,
    )
}  # fmt: skip
"""Every kind by name."""


def _quarters(count: int) -> list[int]:
    return [len(part) for part in np.array_split(np.arange(count), 4)]


def _joined(task: Task, parts: list[tuple[Context, Array, Array]]) -> Faulty:
    contexts, u, y = zip(*parts, strict=True)
    return _claim(task, np.concatenate(u), np.concatenate(y), concatenate(contexts))
