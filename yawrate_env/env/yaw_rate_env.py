"""The environments of the yaw-rate vehicle, ``yawrate/PITuning-v0`` and its nonlinear twin."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.env.interface import Array, Observation
from yawrate_env.env.tuning_env import TuningEnv
from yawrate_env.env.vector_env import TuningVectorEnv
from yawrate_env.env.yaw_rate_interface import interface_of, task_of
from yawrate_env.plant.distributions import LogRange, Normal
from yawrate_env.vehicle.nonlinear.twin import NonlinearTwin
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Task

Range = float | Sequence[float]
Prior = Range | LogRange | Normal | Mapping[str, Sequence[float]] | None
Parameters = Mapping[str, float] | None
Pixels = NDArray[np.uint8]


class PITuningEnv(TuningEnv):
    """Tune the yaw-rate PI controller of an unknown vehicle from one recorded episode.

    ## Description

    A vehicle's friction and mass are drawn at random and hidden.  The observation is one
    identification episode: the steering command, a pseudo-random binary signal, and the
    noisy yaw rate.  One action, the gains of a PI controller, ends the episode; the
    reward says how far the closed loop's phase margin and crossover are from the target.
    Vehicle, uncertainty and controller are those of Dettu, Lakshminarayanan, Formentin
    and Rojas, *From data to control: a two-stage simulation-based approach*.

    ## Action space

    `Box(2,)` float64, clipped to its bounds (the info's `clipped` says so).

    | index | gain | minimum | maximum | unit |
    |---|---|---|---|---|
    | 0 | proportional gain `kp` | 0.001 | 10 | s (rad per rad/s) |
    | 1 | integral time `Ti` | 0.001 | 100 | s |

    ## Observation space

    `Box(2, N)` float32.

    | row | signal | range | unit |
    |---|---|---|---|
    | 0 | steering command at the road wheel | ±`amplitude` | rad |
    | 1 | measured yaw rate | ±20 | rad/s |
    | 2 | speed, with `visible="speed"` or `"context"` | | m/s |
    | 3, 4 | `mu_s`, `M_delta`, with `visible="context"` (for upper bounds) | | –, kg |

    ## Rewards

    With `e = hypot((phase_margin - target)/10 deg, (crossover - target)/0.25 Hz)` the
    reward is `-e/(1 + e/4)` for a stable loop, -4 for a stable loop without a crossover,
    and -5 for an unstable one.

    ## Starting state

    `mu_s`, `M_delta` and `v_x` are drawn uniformly from their ranges; `reset(options=
    {"mu_s": 0.5, "M_delta": 100.0, "v_x": 20.0})` pins any of them.  For a curriculum,
    `reset(options={"width": 0.5})` shrinks every range to half about its middle: `width=0` is the
    vehicle in the middle, `width=1` the whole prior.  A batch takes one value, or one for
    each sub-environment; they hold for one episode.

    ## Episode end

    Every episode terminates after one step. A second `step` raises `ResetNeeded`.

    ## Information

    After the step: `kp`, `Ti` (as applied), `clipped`, `phase_margin` [deg], `crossover`
    [Hz], `gain_margin` [dB], `stable`, `cost`, `oracle_kp`, `oracle_Ti`, `mu_s`, `M_delta`, `v_x`.
    The info of `reset` is empty.  `cost` is for constrained learning: whether the loop is
    unstable or its phase margin below 45 deg, as a number.

    ## Arguments

    | name | default | meaning |
    |---|---|---|
    | `Ts` | 0.001 | sampling time of the episode [s] |
    | `N` | 10000 | samples of the episode |
    | `snr_db` | 30 | mean square of the noise-free yaw rate over noise variance [dB] |
    | `amplitude` | 1 deg | of the steering command [rad] |
    | `bit_time` | 0.1 | time each bit is held [s] |
    | `register` | `"same"` | the same sequence in every episode, or a `"random"` one |
    | `Ts_control` | 0.01 | sampling time of controller and margins [s] |
    | `delay_samples` | 0 | computation delay in samples of `Ts_control` |
    | `phase_margin` | 60 | target [deg] |
    | `crossover` | 1.5 | target [Hz] |
    | `controller` | `"pi"` | or `"printed"`: the paper's eq. (13) to the letter |
    | `mu_s` | [0.3, 1.1] | range of the friction scale, or a number |
    | `M_delta` | [0, 300] | range of the extra mass [kg], or a number |
    | `v_x` | 20 | speed [m/s], or a range |
    | `vehicle` | `{}` | any of Table II's parameters, for example `{"J_z": 2000.0}` |
    | `C_f`, `dead_time`, ... | `None` | a range of any other parameter, see below |
    | `visible` | `"episode"` | `"speed"` or `"context"` add rows to the observation |
    | `decimate` | 1 | average blocks of so many samples, to save memory |

    Any parameter of the vehicle may differ from episode to episode: `J_z` [kg m²], `l_f`, `l_r`
    [m], `C_f`, `C_r` [N/rad], `l_rel_f`, `l_rel_r` [m], `omega_n` [rad/s], `xi`, `dead_time` from
    the command to the actuator [s] and `sensor_lag`, the yaw-rate sensor's time constant [s], as in
    `make(..., C_f=(100e3, 150e3), dead_time=(0, 0.04))`.  `reset` pins them, the info has them, and
    `visible="context"` adds their rows.  Ranges are uniform; `{"log": [low, high]}` and
    `{"normal": [mean, deviation]}` (cut off at three deviations) are other distributions, for
    `mu_s`, `M_delta` and `v_x` too.

    ## Vectorised use

    `gymnasium.make_vec("yawrate/PITuning-v0", num_envs=256)` gives the native batch
    environment, which resets in the same step; `autoreset_mode="NextStep"` or `"Disabled"` changes
    that, for clients that ask for it.  With `vectorization_mode="sync"` or
    `"async"` pass `vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}`: Gymnasium's default,
    `NEXT_STEP`, spends every second step of a one-step environment on the reset, ignores that
    step's action and does not reward it, so that half of what an agent learns from is noise.

    Small batches pay for Python, and those of thousands leave the processor's cache.
    `gymnasium.make("yawrate_env:yawrate/PITuning-v0")` imports the package by itself, which a
    process started by `"spawn"` (`AsyncVectorEnv`, SB3's `SubprocVecEnv`) needs; only `yawrate/`
    is this package's namespace.  A native batch is one process on all cores: it is faster than
    any number of processes.

    Random actions tell how hard it is: drawn evenly from the box of gains, 92 % of the loops are
    unstable and the mean reward is -4.8; the fixed gains of the mid-prior vehicle earn -0.73.

    `render_mode="rgb_array"` gives pictures of the episode, of the open loop and of the step
    response; `"human"` opens a window and is not for batches.

    ## For learning agents

    `yawrate/PITuningFeatures-v0` gives standardised features of the recording and takes
    actions in [-1, 1], the controller's log magnitude and phase at the crossover;
    `features="armax"` gives others.  Any plant of your own has the same two, made from its
    description: `yawrate/Plant-v0` and `yawrate/PlantFeatures-v0` ([plants](plants.md)).

    ## Version history

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 1}

    def __init__(
        self,
        *,
        Ts: float = 0.001,
        N: int = 10_000,
        snr_db: float = 30.0,
        amplitude: float = float(np.radians(1.0)),
        bit_time: float = 0.1,
        register: str = "same",
        Ts_control: float = 0.01,
        delay_samples: int = 0,
        phase_margin: float = 60.0,
        crossover: float = 1.5,
        controller: str = "pi",
        mu_s: Prior = (0.3, 1.1),
        M_delta: Prior = (0.0, 300.0),
        v_x: Prior = 20.0,
        vehicle: Mapping[str, float] | None = None,
        visible: str = "episode",
        decimate: int = 1,
        render_mode: str | None = None,
        **others: Prior,
    ) -> None:
        task = task_of(
            Ts=Ts,
            N=N,
            snr_db=snr_db,
            amplitude=amplitude,
            bit_time=bit_time,
            register=register,
            Ts_control=Ts_control,
            delay_samples=delay_samples,
            phase_margin=phase_margin,
            crossover=crossover,
            controller=controller,
            mu_s=mu_s,
            M_delta=M_delta,
            v_x=v_x,
            vehicle=vehicle,
            others=others,
        )
        if render_mode is not None:
            validation.one_of("render_mode", render_mode, tuple(self.metadata["render_modes"]))
        self.render_mode = render_mode
        self.visible = visible
        self._window: Any = None
        self._adopt(task, decimate)

    def _adopt(self, task: Task, decimate: int) -> None:
        """Take episodes and loops from this task."""
        self.task = task
        super().__init__(interface_of(task, self.visible, decimate))
        self.decimate = self.interface.decimate

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a vehicle and record its episode."""
        answer = super().reset(seed=seed, options=options)
        if self.render_mode == "human":
            self.render()
        return answer

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Close the loop with these gains and evaluate it."""
        answer = super().step(action)
        if self.render_mode == "human":
            self.render()
        return answer

    def render(self) -> Pixels | None:
        """Draw the episode, the Bode plot and the step response."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                'No render_mode was given: gym.make(..., render_mode="rgb_array").'
            )
            return None
        if self._theta is None or self._obs is None:
            raise ResetNeeded("There is nothing to draw yet. Call reset() before render().")
        if self._window is None:
            from yawrate_env.env.window import Window

            self._window = Window(human=self.render_mode == "human")
        frame: Pixels | None = self._window.draw(
            self.task, context_of(self._theta, self.task.prior.others), self._obs, self._gains
        )
        return frame

    def close(self) -> None:
        """Close the window, if there is one; may be called twice."""
        if self._window is not None:
            self._window.close()
            self._window = None


class PITuningNonlinearEnv(PITuningEnv):
    """`PITuningEnv` whose episodes are driven on saturating tyres.

    Spaces, rewards, information and arguments are those of ``yawrate/PITuning-v0``.
    Margins are those of the linearisation about straight driving, which is the linear
    vehicle; `yawrate_env.vehicle.nonlinear.time_domain` evaluates a loop on the nonlinear one.

    ## Further arguments

    | name | default | meaning |
    |---|---|---|
    | `tyre` | `{}` | any of `shape`, `curvature`, `friction`, `friction_loss`, `stiffest_load` |
    | `body` | `{}` | any of `height`, `track`, `front_share`, `roll_lag`, `drag` |
    | `limits` | `{}` | any of `angle` [rad], `rate` [rad/s], of the road wheel |

    ## Version history

    * v0: first version.
    """

    def __init__(
        self,
        *,
        tyre: Parameters = None,
        body: Parameters = None,
        limits: Parameters = None,
        **linear: Any,
    ) -> None:
        super().__init__(**linear)
        twin = NonlinearTwin.of(tyre=tyre, body=body, limits=limits)
        self._adopt(replace(self.task, twin=twin), self.decimate)


class PITuningVectorEnv(TuningVectorEnv):
    """`num_envs` of `PITuningEnv` in one batch; keyword arguments are those of `PITuningEnv`."""

    scalar: ClassVar[type[PITuningEnv]] = PITuningEnv
    """What a sub-environment is."""

    metadata: dict[str, Any] = {
        **TuningVectorEnv.metadata,
        "render_modes": ["rgb_array"],
        "render_fps": 1,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        **kwargs: Any,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: a batch renders to 'rgb_array' only.")
        one = self.scalar(**kwargs)
        super().__init__(num_envs, one.interface, autoreset_mode)
        self.task, self.visible, self.decimate = one.task, one.visible, one.decimate
        self.render_mode = render_mode

    def render(self) -> tuple[Pixels, ...] | None:
        """One frame a sub-environment, of the episode that waits for gains."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                'No render_mode was given: gym.make_vec(..., render_mode="rgb_array").'
            )
            return None
        if self._theta is None or self._obs is None:
            raise ResetNeeded("There is nothing to draw yet. Call reset() before render().")
        from yawrate_env.env.rendering import figure, pixels

        return tuple(
            pixels(figure(self.task, context_of(theta[None], self.task.prior.others), obs, None))
            for theta, obs in zip(self._theta, self._obs, strict=True)
        )


class PITuningNonlinearVectorEnv(PITuningVectorEnv):
    """`num_envs` of `PITuningNonlinearEnv` in one batch."""

    scalar: ClassVar[type[PITuningEnv]] = PITuningNonlinearEnv
