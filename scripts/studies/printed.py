"""What the paper and MathWorks' pages print, stored once, and our `pidtune` beside MATLAB's."""

from collections.abc import Mapping
from dataclasses import dataclass

import control

from studies.markdown import table
from tuners.pidtune import pidtune

PAPER = {"Ts": 0.01, "rate": 1000, "N": 10_000, "snr_db": 30, "validation": 0.2, "mass": 1895}
"""Section V: sampling time of the plant [s], rate [Hz], samples and signal-to-noise ratio [dB]
of an episode, share of the vehicles for validation, and the vehicle's mass [kg]."""

_MANUAL = "https://www.mathworks.com/help/control/ug/"
COMMAND_LINE = (
    "PID controller design at the command line",
    _MANUAL + "pid-controller-design-at-the-command-line.html",
)
CASCADE = (
    "Designing cascade control system with PI controllers",
    _MANUAL + "designing-cascade-control-system-with-pi-controllers.html",
)
LAGS = control.tf(1, [1, 3, 3, 1])  # 1/(s + 1)^3
INNER = control.tf(3, [1, 2])

NAMES = {
    "crossover": ("CrossoverFrequency", "{} rad/s"),
    "margin": ("PhaseMargin", "{}°"),
    "Kp": ("Kp", "Kp {}"), "Ki": ("Ki", "Ki {}"), "Kd": ("Kd", "Kd {}"),
    "Ti": ("Ti", "Ti {}"), "Tf": ("Tf", "Tf {}"),
}  # fmt: skip
"""Of what is printed: its name in ``info``, and how it is written."""


@dataclass(frozen=True, slots=True)
class Call:
    """A call on a page of MATLAB's manual.

    Attributes
    ----------
    page : tuple of str
        Title and address.
    text : str
        The call, as printed.
    system, kind, wc
        Arguments of our `pidtune`.
    printed : Mapping
        Numbers, as printed, by their names in `NAMES`.
    """

    page: tuple[str, str]
    text: str
    system: control.TransferFunction
    kind: str
    wc: float | None
    printed: Mapping[str, str]

    def ours(self) -> dict[str, str]:
        """Our numbers, with as many digits."""
        _, info = pidtune(self.system, self.kind, wc=self.wc)
        return {
            name: f"{getattr(info, NAMES[name][0]):.{len(text.partition('.')[2])}f}"
            for name, text in self.printed.items()
        }


MATLAB = (
    Call(
        COMMAND_LINE, "pidtune(zpk([],[-1 -1 -1],1),'PI',1.0)", LAGS, "PI", 1.0,
        {"Kp": "2.83", "Ki": "0.0495", "margin": "43.9973"},
    ),
    Call(
        COMMAND_LINE, "pidtune(zpk([],[-1 -1 -1],1),'PI')", LAGS, "PI", None,
        {"Kp": "1.14", "Ki": "0.454", "crossover": "0.5205", "margin": "60.0000"},
    ),
    Call(
        COMMAND_LINE, "pidtune(zpk([],[-1 -1 -1],1),'PIDF',1.0)", LAGS, "PIDF", 1.0,
        {"Kp": "2.72", "Ki": "0.985", "Kd": "1.72", "Tf": "0.00875"},
    ),
    Call(
        CASCADE, "pidtune(P2,pidstd(1,1),2), P2 = 3/(s+2)", INNER, "PI", 2.0,
        {"Kp": "0.244", "Ti": "0.134"},
    ),
    Call(
        CASCADE, "pidtune(P1*P2,pidstd(1,1),0.2), P1 = 10/(s+1)^3", INNER * 10 * LAGS, "PI", 0.2,
        {"Kp": "0.0119", "Ti": "0.849"},
    ),
)  # fmt: skip


def compared() -> str:
    """The calls, what is printed there, and what we give."""
    rows, last = [], None
    for call in MATLAB:
        page = "" if call.page == last else f"[{call.page[0]}]({call.page[1]})"
        ours = call.ours()
        here = "the same" if ours == dict(call.printed) else _listed(ours)
        rows.append((page, f"`{call.text}`", _listed(call.printed), here))
        last = call.page
    return table(("page", "call", "printed there", "here"), rows)


def _listed(numbers: Mapping[str, str]) -> str:
    return ", ".join(NAMES[name][1].format(text) for name, text in numbers.items())
