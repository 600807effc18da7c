"""Write gains and tuners for other programs: C, MATLAB, JSON and ONNX.

========  ==============================  ===========================================
target    source                          written
========  ==============================  ===========================================
c         gains of a controller           C99 header, source and test with golden
                                          vectors, in a folder
c         gains of several PI loops       the same of each, and of all of them together
c         tuner with Laguerre features    the same for both of its stages, from samples
          and a network                   to gains
c         tuner with Laguerre features,   the same for its first stage
          ``features=True``
matlab    gains of a PI                   a script
json      gains of a controller with      one object, the controller in every form
          its limits
json      other gains                     one object, the gains by name
onnx      tuner with Laguerre features    one graph, from the measured output to gains
onnx      the same, ``features=True``     one graph, from features to gains
========  ==============================  ===========================================

Features on Laguerre functions are their coefficients, principal components of these, or a
frequency response made of these.  Where every episode has an input of its own, ``onnx`` is the
last line alone.  Only this package knows other programs' languages; its templates are in
``templates/``.
"""

import os
from pathlib import Path
from typing import Any

from tuners.export.controllers import form_of
from tuners.export.digital_pi import DigitalPI
from tuners.export.digital_pid import DigitalPID
from tuners.export.digital_state_feedback import DigitalStateFeedback
from tuners.export.documents import (
    gains_text,
    json_text,
    matlab_script,
)
from tuners.export.features_program import features_program
from tuners.export.gains import Gains, plant_settings
from tuners.export.loops_program import loops_program
from tuners.export.onnx_tuner import onnx_model
from tuners.export.pi_program import pi_program
from tuners.export.pid_program import pid_program, state_feedback_program
from tuners.export.programs import REALS
from tuners.export.schedule_program import GainTable, schedule_program
from tuners.export.tuner_program import first_stage_program, tuner_program
from tuners.tuner.schedule import Schedule
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.files import check_regular, replacing, write_text
from yawrate_env.plant.plant import Plant

__all__ = [
    "TARGETS",
    "DigitalPI",
    "DigitalPID",
    "DigitalStateFeedback",
    "GainTable",
    "Gains",
    "export",
    "features_program",
    "first_stage_program",
    "gains_text",
    "json_text",
    "loops_program",
    "matlab_script",
    "onnx_model",
    "pi_program",
    "pid_program",
    "plant_settings",
    "schedule_program",
    "state_feedback_program",
    "tuner_program",
    "write_schedule",
]

TARGETS = ("c", "matlab", "json", "onnx")


def export(
    source: Any,
    target: str,
    path: str | os.PathLike[str],
    *,
    plant: Plant | None = None,
    Ts: float | None = None,
    limits: Any = None,
    real: str = "double",
    features: bool = False,
) -> list[Path]:
    """Write gains or a tuner for another program.

    Parameters
    ----------
    source : Result, Gains, (kp, Ti) or Tuner
        What to export: targets ``matlab`` and ``json`` take gains, ``onnx`` a tuner, ``c`` both.
    target : {"c", "matlab", "json", "onnx"}
        Language of the files.
    path : path
        File to write; for ``c`` the folder, made if it is missing.
    plant : Plant, optional
        Whose gains a pair (kp, Ti) are: it knows sampling time, limits and units.
    Ts : float, optional
        Sampling time of the controller [s]; by default that of the plant's loop, or else of its
        experiment.
    limits : (float, float), optional
        Least and largest command of the controller, in its own unit; by default the plant's
        ``command_limits``.  Of several PI loops ``((low, high), ...)``, a pair for each input.
    real : {"double", "float"}
        Numbers of the controller in C.
    features : bool
        Cut a tuner at its features: ``c`` ends there, and the ``onnx`` graph begins there,
        for other inputs than that of the tuner's experiment.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    ValueError
        The source cannot be exported to this target; the message says what can.
    """
    validation.one_of("target", target, TARGETS)
    validation.one_of("real", real, REALS)
    where = Path(path)
    if target == "onnx":
        return _write_onnx(source, where, features)
    if target == "c" and isinstance(source, Tuner):
        files = first_stage_program(source) if features else tuner_program(source)
        return _write_all(where, files)
    gains = Gains.of(source, plant)
    if target == "matlab":
        text = matlab_script(gains.pi(Ts, limits))
    elif target == "json" and limits is None and (gains.limits is None or gains.refusal):
        text = gains_text(gains, Ts)
    else:
        form = form_of(gains)
        controller = form.make(gains, Ts, limits)
        if target == "c":
            return _write_all(where, form.program(controller, real=real))
        text = form.document(controller, gains)
    write_text(where, text)
    return [where]


def write_schedule(
    source: Schedule | GainTable, path: str | os.PathLike[str], *, real: str = "double"
) -> list[Path]:
    """Write gains over a measured parameter as a C99 table with interpolation, into a folder.

    Parameters
    ----------
    source : Schedule or GainTable
        The gains.
    path : str or path
        Of the folder.
    real : {"double", "float"}
        Type of all numbers.
    """
    table = source if isinstance(source, GainTable) else GainTable.of(source)
    return _write_all(Path(path), schedule_program(table, real=real))


def _write_all(folder: Path, files: dict[str, str]) -> list[Path]:
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file, and target c writes several. Name a folder.")
    for name in files:
        check_regular(folder / name)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_text(folder / name, text)
    return [folder / name for name in files]


def _write_onnx(source: Any, path: Path, features: bool) -> list[Path]:
    try:
        import onnx  # noqa: F401
    except ImportError:
        raise ValueError('target onnx needs onnx: pip install "yawrate[export]".') from None
    model = onnx_model(source, features=features)
    with replacing(path) as file:
        file.write(model.SerializeToString())
    return [path]
