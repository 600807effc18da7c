"""Steps on the yaw rate: disturbances of the drive, and defects of the sensor."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from studies.drives import Drive, Step
from studies.faulty import Rng


def drift(drive: Drive, rng: Rng) -> Drive:
    """A ramp of 0.4 to 4 times the yaw rate's strength."""
    ramp = np.linspace(-1, 1, drive.shape[1])
    return replace(drive, y=drive.y + ramp * drive.rms * rng.uniform(0.2, 2, (len(drive), 1)))


def jump(drive: Drive, rng: Rng) -> Drive:
    """The offset jumps by 0.2 to 1.5 of the strength, somewhere in the middle."""
    B, N = drive.shape
    late = np.arange(N) > rng.uniform(0.2, 0.8, (B, 1)) * N
    return replace(drive, y=drive.y + late * drive.rms * rng.uniform(0.2, 1.5, (B, 1)))


def hum(drive: Drive, rng: Rng) -> Drive:
    """A sinusoid of 0.5 to 4 Hz, of 0.05 to 0.5 of the strength."""
    B, N = drive.shape
    time = drive.task.experiment.Ts * np.arange(N)
    size = np.sqrt(2) * drive.rms * rng.uniform(0.05, 0.5, (B, 1))
    frequency, phase = rng.uniform(0.5, 4, (B, 1)), rng.uniform(0, 2 * np.pi, (B, 1))
    return replace(drive, y=drive.y + size * np.sin(2 * np.pi * frequency * time + phase))


def gusts(memory: float) -> Step:
    """Wind with a memory [s], of 0.1 to 0.6 of the strength."""

    def step(drive: Drive, rng: Rng) -> Drive:
        pole = np.exp(-drive.task.experiment.Ts / memory)
        wind = lfilter([1.0], [1.0, -pole], rng.standard_normal(drive.shape), axis=1)
        wind = wind / wind.std(axis=1, keepdims=True)
        return replace(drive, y=drive.y + wind * drive.rms * rng.uniform(0.1, 0.6, (len(drive), 1)))

    return step


def outliers(drive: Drive, rng: Rng) -> Drive:
    """Three samples in a thousand are up to tens of times the strength off."""
    hit = rng.random(drive.shape) < 0.003
    return replace(drive, y=drive.y + hit * 10 * drive.rms * rng.standard_normal(drive.shape))


def dropouts(drive: Drive, rng: Rng) -> Drive:
    """Four times the sensor holds its value for 0.1 to 0.4 s."""
    B, N = drive.shape
    y, k = drive.y.copy(), np.arange(N)
    for _ in range(4):
        first, length = rng.integers(0, N - 400, (B, 1)), rng.integers(100, 400, (B, 1))
        held = (k >= first) & (k < first + length)
        y = np.where(held, np.take_along_axis(y, first, axis=1), y)
    return replace(drive, y=y)


def clipped(drive: Drive, rng: Rng) -> Drive:
    """The sensor ends at 0.4 to 0.8 of the peak."""
    limit = drive.peak * rng.uniform(0.4, 0.8, (len(drive), 1))
    return replace(drive, y=np.clip(drive.y, -limit, limit))


def cubic(drive: Drive, rng: Rng) -> Drive:
    """The sensor's gain grows or shrinks by up to 40 % towards the peak."""
    bend = rng.uniform(-0.4, 0.4, (len(drive), 1))
    return replace(drive, y=drive.y * (1 + bend * (drive.y / drive.peak) ** 2))


def saturating(drive: Drive, rng: Rng) -> Drive:
    """The sensor saturates softly."""
    bend, peak = rng.uniform(0.3, 1.2, (len(drive), 1)), drive.peak
    return replace(drive, y=np.tanh(bend * drive.y / peak) / bend * peak)


def quantised(drive: Drive, rng: Rng) -> Drive:
    """Steps of half to twice the strength."""
    step = drive.rms * rng.uniform(0.5, 2, (len(drive), 1))
    return replace(drive, y=np.round(drive.y / step) * step)


def growing_noise(drive: Drive, rng: Rng) -> Drive:
    """More noise, up to four times the usual at the end."""
    more = drive.sigma * np.linspace(0, 4, drive.shape[1])
    return replace(drive, y=drive.y + more * rng.standard_normal(drive.shape))
