"""Random vehicles and gains, and the same loops built by python-control from the start.

Only the vehicle's A and B, which `test_vehicle` checks against the printed equations,
are taken from the package; zero-order hold, Tustin's rule, the delay and the series
connection are python-control's.
"""

from dataclasses import dataclass
from functools import cache

import control
import numpy as np

from yawrate_env.batch import take
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.margins import Margins, margins
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction, open_loop
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space

CASES = [(form, delay) for form in ("pi", "printed") for delay in (0, 1, 3)]


def contexts(count: int, seed: int) -> Context:
    rng = np.random.default_rng(seed)
    return Context.of(
        rng.uniform(0.3, 1.1, count), rng.uniform(0, 300, count), rng.uniform(10, 33, count)
    )


def gains(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Log-uniform over the whole action box: most crossovers are far off, many loops unstable."""
    rng = np.random.default_rng(seed)
    return 10 ** rng.uniform(-3, 1, count), 10 ** rng.uniform(-3, 2, count)


def control_plant(vehicle: Vehicle, context: Context, index: int, Ts: float) -> control.StateSpace:
    A, B, C = state_space(vehicle, take(context, slice(index, index + 1)))
    return control.sample_system(control.ss(A[0], B[0][:, None], C[None], 0), Ts, "zoh")


def control_controller(kp: float, Ti: float, target: Target) -> control.StateSpace:
    """Tustin's rule on kp (1 + 1/(Ti s)), or on kp/(1 + Ti s) for the printed form."""
    printed = target.controller == "printed"
    continuous = control.ss(-1 / Ti, 1 / Ti, kp, 0) if printed else control.ss(0, 1 / Ti, kp, kp)
    return control.sample_system(continuous, target.Ts, "tustin")


@dataclass(frozen=True)
class Loops:
    """200 loops, by the package and by python-control."""

    target: Target
    plant: DiscretePlant
    transfer_function: TransferFunction
    kp: np.ndarray
    Ti: np.ndarray
    found: Margins
    control_loops: list[control.StateSpace]

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Response of loop b at omega[b], by python-control."""
        z = np.exp(1j * omega * self.target.Ts)
        return np.array([L(z[b]) for b, L in enumerate(self.control_loops)])


@cache
def control_plants() -> list[control.StateSpace]:
    return [control_plant(Vehicle(), contexts(200, seed=1), b, Target().Ts) for b in range(200)]


@cache
def random_loops(form: str, delay: int) -> Loops:
    target = Target(controller=form, delay_samples=delay)
    context, (kp, Ti) = contexts(200, seed=1), gains(200, seed=2)
    plant = plants(Vehicle(), context, target.Ts)
    transfer_function = TransferFunction.of(plant, delay)
    lag = control.ss(control.tf([1], [1] + [0] * delay, target.Ts))
    control_loops = [
        G * lag * control_controller(kp[b], Ti[b], target) for b, G in enumerate(control_plants())
    ]
    found = margins(open_loop(transfer_function, kp, Ti, target))
    return Loops(target, plant, transfer_function, kp, Ti, found, control_loops)
