"""Description of a plant: prior, simulator, design rule, and the metrics of its loop.

Everything is batched, ``(B, ...)``; functions that take one plant at a time are called in a
loop.  `docs/plants.md` says what each function must do.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.channels import Names, Noise
from yawrate_env.plant.checks import check_experiment, checked
from yawrate_env.plant.distributions import Range, Spread
from yawrate_env.plant.emulator import Emulator
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.parametrisation import LOG, Parametrisation
from yawrate_env.plant.performance import Performance
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.plant.sensitivity import Sensitivity
from yawrate_env.plant.simulator import Integers, Out, Simulator, Written
from yawrate_env.plant.sliders import Sliders
from yawrate_env.plant.suspect import Suspect
from yawrate_env.plant.trial import try_functions

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant(Simulator, Performance):
    """A family of plants, the experiment on them, and the design rule that knows their gains.

    Each function is called once when a plant is described, with the parameters in the middle
    of the prior; a bad setting or answer raises ``ValueError``.

    Attributes
    ----------
    prior : dict
        Names of the p parameters that differ from plant to plant, and their uniform ranges
        ``(low, high)``; a point is a parameter that is known.  `LogRange`, `Normal` and frozen
        variables of ``scipy.stats`` are other distributions, from which episodes are drawn.
    simulate : callable
        ``simulate(theta, u, rng)``: parameters (B, p) and input (N,) to outputs (B, N); input
        (B, N) where every episode has its own (`excite`).  `rng` is for randomness in the
        plant itself; where it is None, nothing is random.
    design : callable
        ``design(theta)``: parameters (B, p) to gains (B, k); ``nan`` where there are none.
        Where some gains only come as near to the target as the controller can, a pair: gains,
        and whether they reach it (B,) bool.
    gains : tuple of str
        Names of the gains.
    controller : str
        Name of the controller that the gains are of, of `yawrate_env.loop.controllers`, where it
        is one of these: programs and forms of it can then be written.
    u : array
        (N,) input of the experiment; (m, N) of several.
    Ts : float
        Sampling time of the experiment [s].
    noise : float or callable
        Standard deviation of the white measurement noise, or a function of noise-free
        outputs (B, N) to (B,): see `yawrate_env.plant.snr`.  Of several outputs one number, or one
        for each.
    channels : tuple, optional
        Names of m inputs and of q outputs, with units in brackets, of a plant that has several:
        inputs are then (m, N) or (B, m, N), and outputs (B, q, N).
    evaluate : callable, optional
        ``evaluate(theta, gains)``: parameters (B, p) and gains (B, k) to metrics (B, f) of the
        loop; ``nan`` where the loop is unstable, ``inf`` where it is stable and a metric is
        undefined.  Or a pair: metrics, ``nan`` where undefined, and whether each loop is stable
        (B,) bool.  If omitted, the gains' relative errors are the metrics.
    metrics : dict
        Names of the metrics to the errors that count as one, or to a `Metric`; without
        `evaluate` the gains' names to relative errors, 0.3 by default.  A unit stands in
        brackets: ``phase_margin [deg]``.
    target : tuple of float, optional
        Values of the counted metrics that the design rule aims at, where these are the same for
        every plant.
    parametrisation : Parametrisation
        What the learner predicts: the gains' logarithms, or `loop` coordinates.
    measured : dict, optional
        Parameters that are measured with every recording, such as a speed or a load, to how
        far outside the prior's range they may lie.
    together : callable, optional
        ``together(unit)``: uniform numbers (B, p) between 0 and 1 to parameters (B, p) that are not
        independent, within the prior's ranges.
    initial : tuple of str
        Parameters of the prior that are states in which a recording begins, of a nonlinear plant:
        rule and metrics do not depend on them.  Recordings may then begin at any time.
    excite : callable, optional
        ``excite(integers)``: random 64-bit integers (B,) to inputs (B, N), where every episode
        has an input of its own; `u` is then an example.
    linear : bool
        Whether responses add up: the contribution of a recording's initial state and offsets
        can then be told from the response to its input.
    integrating : bool
        Whether a linear plant's output goes on rising under a constant input.
    in_loop : bool
        Whether the experiment runs in a closed loop with a known controller of the error: `u` is
        then the loop's reference, `simulate` gives its output, and the measurement noise goes
        round the loop, ``y = simulate(theta, u - noise) + noise``.
    crossover : float, optional
        Frequency at which a loop's metrics are decided [Hz]: noise is looked at around it, and
        the response of a linear plant.
    plausible : tuple of float
        Largest absolute input and output of a plausible recording; values beyond them usually
        mean wrong units.
    batched : bool
        Whether the functions take B plants at once, or ``(p,)`` and ``(k,)`` of one.
    slow : bool
        Whether one simulation takes so long that their number matters, as from 10 ms on: training
        then runs them one by one in processes, keeps them, and fits plants with the help of an
        emulator (`tuners.tuner.simulations`).
    input : {"held", "lines"}
        Whether the inputs of recordings keep a sample's value until the next, as a digital
        output does, or are joined by lines.  The simulator's own input is held.
    signals : tuple of str
        Names of input and output in pictures and logs, with units in brackets:
        ``speed [rad/s]``.
    labels : dict, optional
        Parameters to the names that logs, checks and results use for them, with units:
        ``{"v_x": "speed [m/s]"}``.
    synonyms : dict, optional
        ``input``, ``output`` and names of measured parameters to further column names that logs
        give them.
    cautions : dict, optional
        Column names, in lower case letters, that may stand for another quantity than the input,
        to the sentence that a log with such a column gets.
    actuator : callable, optional
        ``actuator(signal, Ts)``: response (N,) of the known actuator in front of the plant to a
        signal (N,) that is linear between its samples, from steady state.  Logs may then hold
        the actuator's measured position instead of its command.
    remarks : callable, optional
        ``remarks(u, y, measured)``: sentences on what a log's input (N,), output (N,) and
        measured parameters {name: (N,)} leave out of account.
    suspects : callable, optional
        ``suspects()``: what may be wrong with the description or with a log
        (`yawrate_env.plant.suspect`), to name where a recording contradicts the plant.
    doubtful : callable, optional
        ``doubtful(rng)``: this plant as real recordings find it, with constants that are not quite
        the description's, another noise and another length; the intervals that need no exact
        description are calibrated on such plants, a new one for each block of episodes.  Its first
        p parameters are this plant's.
    messages : dict, optional
        Checks of a recording (`tuners.trust.checks`) to the sentence that is shown where they
        fail, in the terms of this plant: those of every plant, labels of measured parameters, and
        ``<metric>_error``, ``_spread`` and ``_contrast``.
    entry : str
        ``module:attribute`` where the description is found again; saved tuners name it.
    arguments : dict, optional
        Where `entry` is a function: the keyword arguments, plain JSON values, that give this
        plant.
    extrapolation : dict, optional
        Ranges of some parameters outside the prior, for the ``extrapolation`` set of episodes.
    record : callable, optional
        For speed: ``record(theta, u, keys, out, written)``, simulation and noise in one, for inputs
        (1, N) or (B, N) and the noise streams (B, 4) of `yawrate_env.signals.noise`; where `out`
        (B, N) is not None the outputs are written there, and ``written(i, j)`` is called, from any
        thread, once episodes i to j are.  No episode may depend on which others are asked for.
    sensitivity : Sensitivity, optional
        For speed: exact slopes of the output, with which its parameters are found from one start
        instead of several; by differences if omitted.
    linear_model : Plant, optional
        A linear plant with the same parameters: the search for those of a nonlinear one starts
        where that of the linear one ends.
    search_limits : dict, optional
        Parameters to how far they are searched; by default half a range beyond the prior,
        parameters that are positive staying so.
    action_bounds : callable, optional
        ``action_bounds()``: lowest and highest coordinates, (m,) each, that agents choose from;
        by default what the prior's plants need and a quarter more
        (`yawrate_env.plant.action_bounds`).
    loop : callable, optional
        ``loop(theta, gains)``, of one plant: parameters (p,) and gains (k,) to the `ClosedLoop`
        that reports draw.
    speeds : callable, optional
        ``speeds(theta)``, of one plant: parameters (p,) to the gains (k,) of slower and faster
        loops, by the names of the speeds.
    sliders : callable, optional
        ``sliders(theta)``, of one plant: parameters (p,) to what reports let their reader move of
        the loop (`yawrate_env.plant.sliders`).
    display : tuple, optional
        Names of input and output in reports with their units, and factors from the units of
        `signals` to these: ``(("steering [deg]", 57.3), ("yaw rate [deg/s]", 57.3))``; by
        default `signals` and 1.
    command_limits : tuple of float, optional
        Least and largest input that the actuator takes, where known: exported controllers
        saturate there.
    black_box : tuple, optional
        Order and pole [rad/s] of the Laguerre basis of the reference model; chosen
        automatically if omitted.
    emulator : Emulator, optional
        What stands for the simulator of a slow plant where only its slopes are needed, or where
        a search begins; training makes it.
    check : bool
        False leaves out the trial call of each function, and the demand that something can be
        learned from the experiment.
    settings : dict
        Names of all metrics to their `Metric`, not an argument.
    counted : tuple of str
        Names of the f metrics that count in the reward, not an argument; others are only reported.
    """

    prior: Mapping[str, Spread]
    simulate: Callable[[Array, Array, Any], Array]
    design: Callable[[Array], Array | tuple[Array, Flags]]
    gains: tuple[str, ...]
    u: Array
    Ts: float
    noise: Noise = 0.0
    channels: tuple[Names, Names] | None = None
    evaluate: Callable[[Array, Array], Array | tuple[Array, Flags]] | None = None
    metrics: Mapping[str, float | Metric] = field(default_factory=dict)
    target: tuple[float, ...] | None = None
    parametrisation: Parametrisation = LOG
    measured: Mapping[str, float] = field(default_factory=dict)
    together: Callable[[Array], Array] | None = None
    initial: tuple[str, ...] = ()
    excite: Callable[[Integers], Array] | None = None
    linear: bool = False
    integrating: bool = False
    in_loop: bool = False
    crossover: float | None = None
    plausible: tuple[float, float] = (np.inf, np.inf)
    batched: bool = True
    slow: bool = False
    input: str = "held"
    signals: tuple[str, str] = ("u", "y")
    labels: Mapping[str, str] = field(default_factory=dict)
    synonyms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    cautions: Mapping[str, str] = field(default_factory=dict)
    actuator: Callable[[Array, float], Array] | None = None
    remarks: Callable[[Array, Array, Mapping[str, Array]], Sequence[str]] | None = None
    suspects: Callable[[], Sequence[Suspect]] | None = None
    doubtful: "Callable[[np.random.Generator], Plant] | None" = None
    messages: Mapping[str, str] = field(default_factory=dict)
    entry: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    extrapolation: Mapping[str, Range] = field(default_factory=dict)
    record: Callable[[Array, Array, Integers, Out, Written], NDArray[np.floating]] | None = None
    sensitivity: Sensitivity | None = None
    linear_model: "Plant | None" = None
    search_limits: Mapping[str, Range] = field(default_factory=dict)
    action_bounds: Callable[[], tuple[Array, Array]] | None = None
    loop: Callable[[Array, Array], ClosedLoop] | None = None
    speeds: Callable[[Array], Mapping[str, Array]] | None = None
    sliders: Callable[[Array], Sliders] | None = None
    controller: str = ""
    display: tuple[tuple[str, float], tuple[str, float]] | None = None
    command_limits: Range | None = None
    black_box: tuple[int, float] | None = None
    emulator: Emulator | None = None
    check: InitVar[bool] = True
    settings: Mapping[str, Metric] = field(init=False, repr=False)
    counted: tuple[str, ...] = field(init=False)
    _counted: list[int] = field(init=False, repr=False)

    def __post_init__(self, check: bool) -> None:
        given = {each.name: getattr(self, each.name) for each in fields(self) if each.init}
        for name, value in checked(given).items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "settings", self.metrics)
        counted = tuple(name for name, metric in self.settings.items() if metric.counts)
        indices = [list(self.settings).index(name) for name in counted]
        object.__setattr__(self, "counted", counted)
        object.__setattr__(self, "_counted", indices)
        if check:
            check_experiment(self.u, self.Ts, self.crossover)
            try_functions(self)
