"""The environment of re-calibration while driving, ``yawrate/PIRecalibration-v0``."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.batch import replaced
from yawrate_env.env.interface import Array, Observation, copied
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.env.vector_env import Flags, TuningVectorEnv
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS, Conditions, Window
from yawrate_env.vehicle.drives import Course, Drives
from yawrate_env.vehicle.single_track import Vehicle

Range = float | Sequence[float]

_RESET = START_INTEGERS + 2 * WINDOW_INTEGERS


class PIRecalibrationEnv(gymnasium.Env[Observation, Array]):
    """Keep the gains of a yaw-rate PI controller right while friction walks and jumps.

    ## Description

    An episode is a drive of 50 windows of 5 s in closed loop: steps and lane changes of the
    yaw-rate reference, gyro noise and a steering disturbance inside the loop, controller and logger
    at 100 Hz, the vehicle of `yawrate/PITuning-v0` exactly between the samples.  Between windows
    friction walks (0.02 root mean square in a minute) and now and then jumps (once in five minutes,
    to anywhere in its range), and speed walks.  The load is another one in every drive.  An action
    sets the gains of the next window or keeps them.

    ## Action space

    `Box(-1, 1, (3,))` float32, clipped; four numbers with `probing`.

    | index | meaning |
    |---|---|
    | 0 | log magnitude of the controller at the crossover, over the range that the prior needs |
    | 1 | its phase there, likewise |
    | 2 | positive: take these gains; otherwise keep those in effect |
    | 3 | amplitude of a pseudo-random probing of the reference, up to `probing`; negative: none |

    The range is that of `yawrate/PITuningFeatures-v0`.  New gains do not move the wheel by
    themselves: the controller changes bumplessly.

    ## Observation space

    `Box(-10, 10, (9,))` float32, what the last window tells alone:

    | index | meaning |
    |---|---|
    | 0, 1 | estimates of log friction and log total mass, standardised by the prior |
    | 2, 3 | logarithms of their standard deviations over the prior's |
    | 4 | their correlation |
    | 5 | misfit: excess of squared prediction errors in standard deviations, as `±log(1 + abs)` |
    | 6, 7 | gains in effect, as in the action |
    | 8 | speed of the window to come, in [-1, 1] over its range |

    The estimates are maximum a posteriori with the prior, of the log's command and yaw rate
    (`yawrate_env.vehicle.drive_estimate`); `unwrapped.interface.estimates` turns observations back.

    ## Rewards

    With e the distance of phase margin and crossover from what the design rule reaches on the
    vehicle as it is in the window, in units of 10 deg and 0.25 Hz, the reward is `-e/(1 + e/4)`,
    less `price` where the gains changed; -4 for a stable loop without a crossover; -5 for an
    unstable one.  With `probing`, `comfort` times the root mean square lateral acceleration
    [m/s^2] is subtracted too.

    ## Starting state

    Friction, load and speed are uniform in their ranges; the gains are those of the design rule for
    them, and one window has been driven.  `reset(options={"mu_s": 0.5, "M_delta": 100.0, "v_x":
    20.0})` pins where they start.

    ## Episode end

    The drive is truncated after its windows, and terminates with an unstable loop.

    ## Information

    After a step, of its window: `kp`, `Ti`, `changed`, `phase_margin` [deg], `crossover` [Hz],
    `gain_margin` [dB], `stable`, `oracle_kp`, `oracle_Ti`, `mu_s`, `M_delta`, `v_x`, and `cost`:
    whether the loop is unstable or its phase margin below 45 deg, as a number.  That of `reset` is
    empty.

    ## Arguments

    | name | default | meaning |
    |---|---|---|
    | `windows` | 50 | of a drive |
    | `window` | 5 | length of a window [s] |
    | `price` | 0.01 | of new gains, in reward |
    | `probing` | 0 | largest amplitude of probing [rad/s]; without it the action is shorter |
    | `comfort` | 0.05 | price of lateral acceleration with probing [reward per m/s^2] |
    | `mu_s` | [0.3, 1.1] | range of friction |
    | `M_delta` | [0, 300] | range of the load [kg] |
    | `v_x` | [10, 33] | range of speed [m/s] |
    | `friction_walk` | 0.02 | root mean square in a minute |
    | `jump_every` | 300 | mean time between jumps [s] |
    | `speed_walk` | 3 | root mean square in a minute [m/s] |
    | `noise` | 0.1 deg/s | of the gyro, standard deviation [rad/s] |
    | `disturbance` | 0.05 deg | at the steering, root mean square [rad] |
    | `disturbance_time` | 0.15 | its time constant [s] |
    | `Ts_control` | 0.01 | sampling time of controller and logger [s] |
    | `delay_samples` | 0 | computation delay in samples |
    | `phase_margin`, `crossover` | 60, 1.5 | target [deg, Hz] |
    | `vehicle` | `{}` | any of Table II's parameters |

    ## Vectorised use

    `gymnasium.make_vec("yawrate/PIRecalibration-v0", num_envs=256)` gives the native batch
    environment, which resets in the same step.

    ## Version history

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        *,
        windows: int = 50,
        window: float = 5.0,
        price: float = 0.01,
        probing: float = 0.0,
        comfort: float = 0.05,
        mu_s: Range = (0.3, 1.1),
        M_delta: Range = (0.0, 300.0),
        v_x: Range = (10.0, 33.0),
        friction_walk: float = 0.02,
        jump_every: float = 300.0,
        speed_walk: float = 3.0,
        noise: float = float(np.radians(0.1)),
        disturbance: float = float(np.radians(0.05)),
        disturbance_time: float = 0.15,
        Ts_control: float = 0.01,
        delay_samples: int = 0,
        phase_margin: float = 60.0,
        crossover: float = 1.5,
        vehicle: Mapping[str, float] | None = None,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode = {render_mode!r}: drives are not drawn. Leave it out.")
        try:
            known = Vehicle(**(vehicle or {}))
        except TypeError:
            names = ", ".join(Vehicle.__slots__)
            raise ValueError(f"vehicle = {vehicle!r}: give any of {names}, as numbers.") from None
        validation.number("Ts_control", Ts_control, above=0.0, remedy="Give it in seconds.")
        ranges: Any = {"mu_s": mu_s, "M_delta": M_delta, "v_x": v_x}
        conditions = Conditions(
            **ranges,
            friction_walk=friction_walk,
            jump_every=jump_every,
            speed_walk=speed_walk,
            noise=noise,
            disturbance=disturbance,
            disturbance_time=disturbance_time,
            window=window,
            Ts=Ts_control,
        )
        target = Target(phase_margin, crossover, Ts_control, delay_samples)
        self.interface = RecalibrationInterface.of(
            Drives.of(known, conditions, target),
            windows=windows,
            price=price,
            probing=probing,
            comfort=comfort,
        )
        self.render_mode = None
        self.observation_space: Any = self.interface.observation_space
        self.action_space: Any = self.interface.action_space
        self._course: Course | None = None
        self._coming: Window | None = None
        self._left = 0

    @property
    def plant(self) -> Plant:
        """The family of cars, as of the other environments."""
        return self.interface.plant

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a drive."""
        pins = self.interface.pins(copied(options), 1)
        super().reset(seed=seed)
        drawn = self.np_random.bit_generator.random_raw(_RESET)[None]
        self._course, self._coming, obs = _begun(self.interface, drawn, pins)
        self._left = self.interface.windows
        return obs[0], {}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive one window."""
        if self._course is None or self._coming is None or not self._left:
            raise ResetNeeded("The drive is over. Call reset() before the next step().")
        given = validation.finite_array("action", action, shape=self.action_space.shape)[None]
        drawn = self.np_random.bit_generator.random_raw(WINDOW_INTEGERS)[None]
        self._course, self._coming, obs, reward, info = self.interface.step(
            self._course, self._coming, given, drawn
        )
        scalars = {name: values[0].item() for name, values in info.items()}
        terminated = not scalars["stable"]
        self._left = 0 if terminated else self._left - 1
        return obs[0], float(reward[0]), terminated, not (self._left or terminated), scalars


class PIRecalibrationVectorEnv(TuningVectorEnv):
    """`num_envs` of `PIRecalibrationEnv` in one batch; keyword arguments are its own.

    Generators, seeds and reset masks are those of every batch environment.
    """

    def __init__(self, num_envs: int = 1, *, render_mode: None = None, **kwargs: Any) -> None:
        one = PIRecalibrationEnv(render_mode=render_mode, **kwargs)
        super().__init__(num_envs, one.interface)  # type: ignore[arg-type]
        self.drives = one.interface
        self.render_mode = None
        self._course: Course | None = None
        self._coming: Window | None = None
        self._left = np.zeros(self.num_envs, np.int64)

    @property
    def coming_theta(self) -> Array:
        """Vehicles (B, 3) of the windows to come, for policies that may know the truth."""
        if self._coming is None:
            raise ResetNeeded("Call reset() first.")
        return self._coming.theta.copy()

    def step(self, actions: Array) -> tuple[Observation, Array, Flags, Flags, dict[str, Any]]:
        """Drive one window in every sub-environment; those that end begin their next drive."""
        if self._course is None or self._coming is None:
            raise ResetNeeded("Call reset() before the first step().")
        shape = (self.num_envs, *self.single_action_space.shape)
        given = validation.finite_array("action", actions, shape=shape)
        raw = [one.bit_generator.random_raw(WINDOW_INTEGERS) for one in self._own_generators()]
        self._course, self._coming, obs, reward, info = self.drives.step(
            self._course, self._coming, given, np.stack(raw)
        )
        self._obs = obs
        terminated = ~info["stable"]
        self._left -= 1
        truncated = (self._left == 0) & ~terminated
        ended = terminated | truncated
        told: dict[str, Any] = _told(info, ~ended) if not ended.all() else {}
        if ended.any():
            final_obs = np.empty(self.num_envs, dtype=object)
            for i in np.flatnonzero(ended):
                final_obs[i] = obs[i]
            told |= {"final_obs": final_obs, "_final_obs": ended.copy(),
                     "final_info": _told(info, ended), "_final_info": ended.copy()}  # fmt: skip
            return self._renew(ended, {}), reward, terminated, truncated, told
        return self._obs.copy(), reward, terminated, truncated, told

    def _renew(self, mask: Flags, pins: Mapping[str, Array]) -> Observation:
        generators, rows = self._own_generators(), np.flatnonzero(mask)
        drawn = np.stack([generators[i].bit_generator.random_raw(_RESET) for i in rows])
        pinned = {name: values[rows] for name, values in pins.items()}
        course, coming, obs = _begun(self.drives, drawn, pinned)
        if self._course is None or self._coming is None or self._obs is None or mask.all():
            self._course, self._coming, self._obs = course, coming, obs
        else:
            self._course = replaced(self._course, rows, course)
            self._coming = replaced(self._coming, rows, coming)
            self._obs = self._obs.copy()
            self._obs[rows] = obs
        self._theta = self._course.theta  # that there has been a reset
        self._left[rows] = self.drives.windows
        return self._obs.copy()


def _begun(
    interface: RecalibrationInterface, drawn: NDArray[np.uint64], pins: Mapping[str, Array]
) -> tuple[Course, Window, Observation]:
    parts = np.split(drawn, [START_INTEGERS, START_INTEGERS + WINDOW_INTEGERS], axis=1)
    starts, first, then = parts
    return interface.begin(starts, first, then, pins)


def _told(info: Mapping[str, NDArray[Any]], of: Flags) -> dict[str, Any]:
    """Values of some sub-environments, zero elsewhere, and which they are."""
    told: dict[str, Any] = {}
    for name, values in info.items():
        told[name], told[f"_{name}"] = np.where(of, values, np.zeros_like(values)), of.copy()
    return told
