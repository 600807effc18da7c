"""Controllers and other gains as JSON."""

import json
from dataclasses import asdict
from typing import Any

import numpy as np

import yawrate_env
from tuners.export.digital_pi import DigitalPI
from tuners.export.digital_pid import DigitalPID
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.forms import vendors_forms
from tuners.export.gains import Gains, sampling_time

FORMAT, GAINS_FORMAT, VERSION = "yawrate-controller", "yawrate-gains", 1


def json_text(pi: DigitalPI) -> str:
    """Gains of a controller `pi` in every form, its limits and sampling time, as JSON."""
    b, a = pi.difference_equation()
    command, output = pi.units
    content = {
        "format": FORMAT,
        "version": VERSION,
        "program": f"yawrate {yawrate_env.__version__}",
        "kp": pi.kp,
        "Ti": pi.Ti,
        "Ts": pi.Ts,
        "standard": {"form": "Kp (1 + 1/(Ti s))", "Kp": pi.kp, "Ti": pi.Ti},
        "parallel": {"form": "Kp + Ki/s", "Kp": pi.kp, "Ki": pi.kp / pi.Ti},
        "forms": vendors_forms("PI", {"kp": pi.kp, "Ti": pi.Ti}, pi.Ts),
        "discretisation": "tustin",
        "difference_equation": {
            "form": "a[0] u[k] + a[1] u[k-1] = b[0] e[k] + b[1] e[k-1]",
            "b": b,
            "a": a,
        },
        "state": {
            "form": "u = sat(n1 e + x); x += step e + tracking (u - n1 e - x)",
            "n1": pi.gain,
            "step": pi.step,
            "tracking": pi.tracking,
        },
        "limits": [pi.low, pi.high],
        "units": {"e": output, "u": command, "kp": _ratio(command, output), "Ti": "s", "Ts": "s"},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def pid_text(pid: DigitalPID, gains: Gains) -> str:
    """A controller of the PID's family: gains in every form, its program, limits."""
    command, output = pid.units
    content = _head(pid.name, gains, pid.Ts) | {
        "forms": vendors_forms(pid.name, gains.values, pid.Ts),
        "discretisation": "tustin",
        "state": {
            "form": "e = sat(r - y); d = e - (1 - c) r; D = a D + g (d - d_before); "
            "v = Kp (e - (1 - b) r) + h e + x + D; u = sat(v); x += s e + tracking (u - v)",
            "Kp": pid.Kp,
            "h": pid.half,
            "s": pid.step,
            "a": pid.decay,
            "g": pid.rate,
            "b": pid.b,
            "c": pid.c,
            "tracking": pid.tracking,
        },
        "limits": [pid.low, pid.high],
        "units": {"e": output, "u": command, "Kp": _ratio(command, output), "times": "s"},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def state_feedback_text(of: DigitalStateFeedback, gains: Gains) -> str:
    """A state feedback: gains of the states in their order, and of the reference; limits."""
    content = _head(gains.controller, gains, of.Ts) | {
        "state": {
            "form": "u = sat(kr r - k1 x1 - ... - kn xn)",
            "k": list(of.gains.values()),
            "kr": of.reference_gain,
        },
        "limits": [of.low, of.high],
        "units": {"u": of.signals[0], "r": of.signals[1]},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _head(name: str, gains: Gains, Ts: float) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "program": f"yawrate {yawrate_env.__version__}",
        "controller": name,
        "gains": dict(gains.values),
        "Ts": Ts,
    }


def gains_text(gains: Gains, Ts: float | None = None) -> str:
    """Gains by name, and their loop, as JSON; ``null`` where there is no number.

    Parameters
    ----------
    gains : Gains
        Of any controller.
    Ts : float, optional
        Sampling time of the controller [s], if not that of the gains.
    """
    content = {
        "format": GAINS_FORMAT,
        "version": VERSION,
        "program": f"yawrate {yawrate_env.__version__}",
        "gains": {k: v if np.isfinite(v) else None for k, v in gains.values.items()},
        "trusted": gains.trusted,
        "signals": dict(zip(("input", "output"), gains.channels or gains.signals, strict=True)),
        "Ts": gains.Ts if Ts is None else sampling_time(Ts),
        "target": gains.target and asdict(gains.target),
        **_known_forms(gains, Ts),
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _known_forms(gains: Gains, Ts: float | None) -> dict[str, Any]:
    """Name and forms of a controller that is known."""
    name, every = gains.controller, gains.Ts if Ts is None else Ts
    if not name or every is None:
        return {}
    return {"controller": name, "forms": vendors_forms(name, gains.values, every)}


def _ratio(command: str, output: str) -> str:
    """Unit of a gain from output to command."""
    return "s" if output == f"{command}/s" else f"({command})/({output})"
