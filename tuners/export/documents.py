"""A PI controller as a MATLAB script or JSON, and other gains as JSON."""

import json
from dataclasses import asdict

import numpy as np

import yawrate_env
from tuners.export.digital_pi import DigitalPI
from tuners.export.gains import Gains, sampling_time
from tuners.export.programs import render

FORMAT, GAINS_FORMAT, VERSION = "yawrate-controller", "yawrate-gains", 1


def matlab_script(pi: DigitalPI) -> str:
    """A script that defines the controller `pi` as ``tf`` and as difference equation."""
    b, a = pi.difference_equation()
    return render("pi.m", {"pi": pi, "b": b, "a": a})


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
        "signals": dict(zip(("input", "output"), gains.signals, strict=True)),
        "Ts": gains.Ts if Ts is None else sampling_time(Ts),
        "target": gains.target and asdict(gains.target),
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _ratio(command: str, output: str) -> str:
    """Unit of a gain from output to command."""
    return "s" if output == f"{command}/s" else f"({command})/({output})"
