"""A DC motor with an uncertain load: PI speed loop, designed by loop shaping.

    python scripts/compare_plant.py examples/plants/dc_motor.py

The load's inertia and friction are unknown.  Two seconds of switched voltage is recorded,
and a trained tuner reads the gains off it.
"""

import control

from yawrate_env.loop.target import Target
from yawrate_env.plant.parametrisation import loop as loop_coordinates
from yawrate_env.plant.pi_loop import GAINS, METRICS, PILoop
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import prbs

R, L, K = 1.0, 2e-3, 0.05  # winding [ohm], [H], torque constant [N m/A] = [V s/rad]
TS = 1e-3


def motor(theta):
    """Voltage [V] to speed [rad/s], for the load's inertia [kg m2] and friction [N m s/rad]."""
    J, b = theta
    A = [[-R / L, -K / L], [K / J, -b / J]]
    return control.ss(A, [[1 / L], [0]], [[0, 1]], 0)


target = Target(phase_margin=60.0, crossover=8.0, Ts=5e-3, delay_samples=1)
loop = PILoop.of(motor, TS, target, signals=("voltage [V]", "speed [rad/s]"))

plant = Plant(
    prior={"J": (1e-4, 6e-4), "b": (5e-4, 4e-3)},
    simulate=loop.simulate,
    design=loop.design,
    evaluate=loop.evaluate,
    gains=GAINS,
    metrics={**METRICS, "crossover [Hz]": 1.3},
    parametrisation=loop_coordinates(target),
    u=prbs(N=2000, Ts=TS, bit_time=0.05, amplitude=6.0)[0],
    Ts=TS,
    noise=1.0,  # rad/s, of a tachometer
    linear=True,
    crossover=target.crossover,
    signals=loop.signals,
    loop=loop.around,
    entry="dc_motor:plant",
)
