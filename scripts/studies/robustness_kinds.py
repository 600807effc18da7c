"""Kinds of faults by group and name; how severe they are, their steps say."""

from studies import log_steps, signal_steps, vehicle_steps
from studies.drives import Fault
from studies.log_steps import command_shifted, held
from studies.signal_steps import gusts
from studies.vehicle_steps import NAMES, friction_changes, speed_off, wrong

NOTHING = {"nothing": Fault()}

VEHICLE = {
    **{f"{name} ± 30 %": Fault(vehicle=(wrong(name, by=0.3),)) for name in NAMES},
    "no relaxation": Fault(vehicle=(vehicle_steps.without_relaxation,)),
    "all ± 5 %": Fault(vehicle=(wrong(*NAMES, by=0.05),)),
    "all ± 30 %, another car": Fault(vehicle=(wrong(*NAMES, by=0.3),)),
    "speed off by up to 1 m/s": Fault(vehicle=(speed_off(0.0, 1.0),)),
    "speed off by 1 to 4 m/s": Fault(vehicle=(speed_off(1.0, 4.0),)),
    "sensor gain ± 3 %": Fault(vehicle=(vehicle_steps.sensor_gain,)),
    "dead time up to 40 ms": Fault(vehicle=(vehicle_steps.dead_time,)),
    "J_z and l_f mask each other": Fault(vehicle=(vehicle_steps.masked_inertia,)),
    "omega_n and l_rel_f mask each other": Fault(vehicle=(vehicle_steps.masked_lag,)),
}

SIGNAL = {
    "drift": Fault(signal=(signal_steps.drift,)),
    "offset jumps": Fault(signal=(signal_steps.jump,)),
    "hum": Fault(signal=(signal_steps.hum,)),
    "slow gusts": Fault(signal=(gusts(0.3),)),
    "fast gusts": Fault(signal=(gusts(0.03),)),
    "outliers": Fault(log=(signal_steps.outliers,)),
    "dropouts": Fault(log=(signal_steps.dropouts,)),
    "rows lost": Fault(log=(log_steps.rows_lost,)),
    "clipped": Fault(signal=(signal_steps.clipped,)),
    "cubic sensor": Fault(signal=(signal_steps.cubic,)),
    "saturating sensor": Fault(signal=(signal_steps.saturating,)),
    "quantised": Fault(signal=(signal_steps.quantised,)),
    "noise grows": Fault(log=(signal_steps.growing_noise,)),
    "friction falls at mid-recording": Fault(vehicle=(friction_changes(0.5),)),
    "friction falls at 3/4": Fault(vehicle=(friction_changes(0.75),)),
    "speed falls": Fault(vehicle=(vehicle_steps.speed_falls,)),
}

LOG = {
    "command late": Fault(log=(command_shifted(1),)),
    "command early": Fault(log=(command_shifted(-1),)),
    "wheel's angle as command": Fault(log=(log_steps.wheel_as_command,)),
    "clock wrong": Fault(log=(log_steps.wrong_clock,)),
    "yaw rate held": Fault(log=(held(both=False),)),
    "both held": Fault(log=(held(both=True),)),
    "jitter": Fault(log=(log_steps.jitter,)),
    "averaged": Fault(log=(log_steps.averaged,)),
    "gain in the log": Fault(signal=(log_steps.gain,)),
    "lag in the log": Fault(signal=(log_steps.lag,)),
    "friction falls in the last fifth": Fault(vehicle=(friction_changes(0.8),)),
}

ACTUATOR = {
    "deadband": Fault(vehicle=(vehicle_steps.deadband,)),
    "backlash": Fault(vehicle=(vehicle_steps.backlash,)),
    "asymmetry": Fault(vehicle=(vehicle_steps.asymmetry,)),
    "rate limit": Fault(vehicle=(vehicle_steps.rate_limit,)),
}

_SINGLE = VEHICLE | SIGNAL | LOG | ACTUATOR
_PAIRS = (
    ("C_f ± 30 %", "C_r ± 30 %"),
    ("C_f ± 30 %", "J_z ± 30 %"),
    ("l_f ± 30 %", "omega_n ± 30 %"),
    ("speed off by 1 to 4 m/s", "C_r ± 30 %"),
    ("speed off by 1 to 4 m/s", "J_z ± 30 %"),
    ("M_0 ± 30 %", "l_rel_r ± 30 %"),
    ("xi ± 30 %", "l_rel_f ± 30 %"),
    ("dead time up to 40 ms", "C_f ± 30 %"),
    ("drift", "C_f ± 30 %"),
    ("slow gusts", "l_r ± 30 %"),
    ("friction falls at mid-recording", "C_r ± 30 %"),
    ("drift", "omega_n ± 30 %"),
)

LOG_ONLY = "faults that only the log has"

GROUPS: dict[str, dict[str, Fault]] = {
    "nothing wrong": NOTHING,
    "the vehicle's data are wrong": VEHICLE,
    "disturbances and defects": SIGNAL,
    LOG_ONLY: LOG,
    "what an input of two levels hides": ACTUATOR,
    "two at once": {f"{a}; {b}": _SINGLE[a] + _SINGLE[b] for a, b in _PAIRS},
}
"""All kinds: group, name, fault."""
