"""The page ``results/README.md``: the scoreboard, and how to read it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.markdown import ratios, table
from studies.metrics import rms
from studies.scoreboard import PROTOCOL, Estimate, EvaluationProtocol, Row, to_json
from tuners import NAMES
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import ranges_of
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]

EXAMPLE = '''\
# my_agent.py
import numpy as np


class Fixed:
    """The same gains for every vehicle."""

    def predict(self, obs, state=None, episode_start=None, deterministic=True):
        return np.tile([0.23, 0.28], (len(obs), 1)), state  # kp [s], Ti [s]
'''

_PAGE = """\
# Results

Made by `make results`; edits are overwritten. The same numbers for programs:
[scoreboard.json](scoreboard.json).

## {title}

| | |
|---|---|
| environment | `yawrate/PITuning-v0` with its default arguments |
| episodes | {episodes} of each context set, seed {seed}; the same ones for every tuner |
| recording | {N} samples of {Ts:g} s at {snr:g} dB, {register} PRBS of ±{amplitude:g}°, bits of \
{bit:g} s |
| vehicles, set `test` | {prior} |
| vehicles, set `extrapolation` | {beyond} |
| controller | PI at {Ts_control:g} s, {delay} |
| target | phase margin {phase_margin:g}°, crossover {crossover:g} Hz |
| training | not at all, or on other episodes: the `train` set, or the environment's own |

{tables}
{missing}\
## How to read it

- **Score**: linear in mean reward, 0 for `nominal` (the fixed gains of the mid-prior vehicle, which
  ignore the recording) and 1 for `oracle` (the design rule that knows the vehicle). Negative means
  worse than the fixed gains. Compare tuners by their score; where all are near 1, by the regret.
- **Reward** and **regret**: with e = hypot(phase-margin error / 10°, crossover error / 0.25 Hz), a
  stable loop earns −e/(1 + e/4), an unstable one −5. Regret is the mean of the oracle's reward
  minus the tuner's on the same episode; 0.01 is about 0.1° or 0.0025 Hz.
- **rmse**: root mean square of the distance from the target, bias included; **× bound**: over the
  least that any unbiased tuner can reach ([accuracy.md](accuracy.md)).
- **Brackets**: 95 % bootstrap intervals over episodes. They say how well {episodes} episodes
  determine the score of *this* trained tuner; they do not cover what another training seed
  would give{seeds}. All tuners get the same episodes, so two may differ for certain though
  their brackets overlap.
- **`extrapolation`** has vehicles outside the training data, with more friction and mass at once:
  {beyond}.
  `nominal` and the learned tuners are made for the prior; `gb` assumes the equations of motion
  only, `vrft` and `frit` assume no vehicle, and `oracle` knows it. A tuner that falls far behind
  `gb` here does not extrapolate: boosted trees, for example, predict what they predict at the edge
  of their data.
- **`ladder`** is what `tune` answers with: the gains of `ts-ff-lag` where the recording confirms
  them, else those of the simulator fitted to it, else those of the black box **`bb`**, which knows
  no vehicle. All other learned tuners stand here alone.

## Your own policy

Anything with Stable-Baselines3's `predict` goes in: for a batch of observations (B, 2, N) it
returns actions (B, 2) in physical units (clipped to the environment's bounds) and the state.

```python
{example}```

```sh
# one row an episode, beside others
python scripts/evaluate.py --policy my_agent:Fixed --tuner ts-ff --out rows.csv
# its score on a page like this one
python scripts/make_results.py --policy my_agent:Fixed --results mine
```

`--sb3 model.zip` takes a model that Stable-Baselines3 or sb3-contrib saved, trained in
`yawrate/PITuning-v0` or in `yawrate/PITuningFeatures-v0` (its spaces say which) without further
wrappers; such files hold pickles, so load trusted ones only. A policy that learned needs episodes
of its own: train on `gymnasium.make(...)`, never on the `test` or `extrapolation` set. When you
quote a score, quote the protocol's version with it.
"""

_OTHERS = {
    "table3.md": "the paper's Table III beside ours, from tuners trained afresh",
    "rl.md": "reinforcement-learning agents, seed by seed, and the median over five seeds",
    "leaderboard.md": "scores of agents and tuners, and how another one gets there",
    "accuracy.md": "how near to the Cramér–Rao bound, why not nearer, and when not to trust it",
    "minimax.md": "second stages trained for the worst case over the prior",
    "unknowns.md": "what the paper leaves open, and whether any of it explains its Table III",
    "robustness.md": "who breaks where: wrong vehicle data, disturbances, defects, faulty logs",
    "off_design.md": "every tuner under other noise, lengths, excitations and wrong vehicle data",
    "schedule.md": "gains over speed, and the price of a wrong speed",
    "closed_loops.md": "recordings under an old controller, with and without its reference",
    "several.md": "what several logs of one vehicle are worth, and whether another car is noticed",
    "log_files.md": "what becomes of thousands of damaged log files",
    "recalibration.md": "gains kept right while friction changes, from never to the oracle",
    "process_plants.md": "plants with dead time, on recordings by SciPy, right and faulty",
    "corners.md": "a wide prior, corner by corner",
    "channels.md": "a plant with two inputs and two outputs",
    "plants.md": "the examples of `docs/plants.md`",
    "nonlinear.md": "what a linear twin costs when the tyres saturate",
    "benchmark.md": "computing times beside other libraries and the machine's limits",
    "datasets.md": "time and memory of data sets up to a million episodes",
    "episodes.csv": "one row an episode and tuner behind `table3.md`",
}


def write(board: Sequence[Row], protocol: EvaluationProtocol, folder: Path) -> None:
    """Write ``README.md`` and ``scoreboard.json`` into a folder that exists."""
    write_text(folder / "scoreboard.json", to_json(board, protocol))
    write_text(folder / "README.md", page(board, protocol, others(folder)))


def others(folder: Path) -> dict[str, str]:
    """Further files of a folder, and what they hold."""
    return {name: what for name, what in _OTHERS.items() if (folder / name).exists()}


def page(board: Sequence[Row], protocol: EvaluationProtocol, beside: dict[str, str]) -> str:
    """Build the whole page; `beside` are further files of the folder and what they hold."""
    task = Task()
    e, t = task.experiment, task.target
    beyond = _vehicles(yaw_rate(task), "extrapolation")
    absent = [name for name in NAMES if name not in {row.tuner for row in board}]
    text = _PAGE.format(
        title=_title(protocol),
        episodes=protocol.episodes,
        seed=protocol.seed,
        N=e.N,
        Ts=e.Ts,
        snr=e.snr_db,
        register="the same" if e.register == "same" else "a random",
        amplitude=np.degrees(e.amplitude),
        bit=e.bit_time,
        prior=_vehicles(yaw_rate(task), "test"),
        beyond=beyond,
        Ts_control=t.Ts,
        delay=f"{t.delay_samples} samples of delay" if t.delay_samples else "no delay",
        phase_margin=t.phase_margin,
        crossover=t.crossover,
        tables="\n".join(_section(board, protocol, name) for name in protocol.context_sets),
        missing=f"Not here, since the package ships no file for them: {_names(absent)}.\n\n"
        if absent
        else "",
        seeds=" ([rl.md](rl.md) does, for five)" if "rl.md" in beside else "",
        example=EXAMPLE,
    )
    if not beside:
        return text
    listed = "\n".join(f"- [{name}]({name}): {what}" for name, what in beside.items())
    return f"{text}\n## Also here\n\n{listed}\n"


HEADS = (
    "tuner", "learned from", "score", "mean reward", "regret to the oracle",
    "phase margin rmse [°]", "crossover rmse [Hz]", "× bound", "unstable",
)  # fmt: skip


def scores(rows: Sequence[Row], bound: Array) -> str:
    """Table of one context set, and the bound (2,) on phase_margin [deg] and crossover [Hz]."""
    cells = [
        [
            f"`{row.tuner}`", row.learned_from or "–", _fixed(row.score),
            *map(_short, (row.reward, row.regret, row.phase_margin, row.crossover)),
            ratios(np.array([row.phase_margin.value, row.crossover.value]) / bound),
            row.unstable,
        ]
        for row in rows
    ]  # fmt: skip
    least = [f"{value:#.3g}" for value in bound]
    return table(
        HEADS, [*cells, ["*Cramér–Rao bound*", "–", "", "", "", *least, "1 / 1", ""]]
    )  # fmt: skip


def bound(protocol: EvaluationProtocol, context: str) -> Array:
    """Root mean square of the bound over a protocol's episodes, (2,) [deg], [Hz]."""
    return rms(bound_on(yaw_rate(Task()), context, protocol.seed, protocol.episodes))


def _section(board: Sequence[Row], protocol: EvaluationProtocol, context: str) -> str:
    chosen = [row for row in board if row.context_set == context]
    return f"### Context set `{context}`\n\n{scores(chosen, bound(protocol, context))}"


def _title(protocol: EvaluationProtocol) -> str:
    if protocol == PROTOCOL:
        return f"Evaluation protocol {protocol.version}"
    return f"A trial: evaluation protocol {protocol.version} cut to {protocol.episodes} episodes"


def _vehicles(plant: Plant, name: str) -> str:
    mu_s, M_delta, v_x = np.transpose(ranges_of(plant, name))
    speed = f"{v_x[0]:g}" if v_x[0] == v_x[1] else f"{v_x[0]:g} to {v_x[1]:g}"
    return f"μs {mu_s[0]:g} to {mu_s[1]:g}, Mδ {M_delta[0]:g} to {M_delta[1]:g} kg, {speed} m/s"


def _names(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _fixed(x: Estimate) -> str:
    return f"{x.value:.4f} ({x.low:.4f} to {x.high:.4f})"


def _short(x: Estimate) -> str:
    """Three digits; what is rounding error shows as 0."""
    value, low, high = (
        "0" if abs(v) < 1e-9 else f"{v:#.3g}".removesuffix(".") for v in (x.value, x.low, x.high)
    )
    return f"{value} ({low} to {high})"
