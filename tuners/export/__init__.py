"""From gains and tuners to what runs elsewhere.

========  ==============================  ===========================================
target    source                          written
========  ==============================  ===========================================
c         gains                           C99 header, source and test with golden
                                          vectors, in a folder
c         tuner with Laguerre features    the same for its first stage
matlab    gains                           a script
json      gains                           one object
onnx      tuner with Laguerre features    one graph, from yaw rate to gains
========  ==============================  ===========================================
"""

import os
from pathlib import Path
from typing import Any

from tuners.export.compressor_source import compressor_source
from tuners.export.digital_pi import LIMITS, DigitalPI
from tuners.export.documents import json_text, matlab_script
from tuners.export.onnx_tuner import check, onnx_model
from tuners.export.pi_source import c_source
from tuners.tuner import Tuner
from yawrate_env import validation
from yawrate_env.files import replacing, write_text

__all__ = [
    "TARGETS",
    "DigitalPI",
    "c_source",
    "compressor_source",
    "export",
    "json_text",
    "matlab_script",
    "onnx_model",
]

TARGETS = ("c", "matlab", "json", "onnx")


def export(
    source: Any,
    target: str,
    path: str | os.PathLike[str],
    *,
    Ts: float = 0.01,
    limits: tuple[float, float] = LIMITS,
    real: str = "double",
    features: bool = False,
) -> list[Path]:
    """Write gains or a tuner for another program.

    Parameters
    ----------
    source : TuningResult, (kp, Ti) or Tuner
        What to export: targets ``matlab`` and ``json`` want gains, ``onnx`` a tuner, ``c``
        takes both.
    target : {"c", "matlab", "json", "onnx"}
        What for.
    path : path
        File to write; for ``c`` the folder, made if it is missing.
    Ts : float
        Sampling time of the controller [s].
    limits : (float, float)
        Least and largest command of the controller [rad].
    real : {"double", "float"}
        Numbers of the controller in C.
    features : bool
        Let the ``onnx`` graph begin at the features that the first stage in C computes, for
        any other command than the tuner's own.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    ValueError
        The source cannot be exported so; the message says what can.
    """
    validation.one_of("target", target, TARGETS)
    validation.one_of("real", real, ("double", "float"))
    where = Path(path)
    if target == "onnx":
        return _write_onnx(source, where, features)
    if target == "c" and isinstance(source, Tuner):
        stage = check(source).stages.compressor
        return _write_all(where, compressor_source(stage, source.task.experiment.Ts))
    pi = DigitalPI.of(source, Ts, limits)
    if target == "c":
        return _write_all(where, c_source(pi, real=real))
    write_text(where, matlab_script(pi) if target == "matlab" else json_text(pi))
    return [where]


def _write_all(folder: Path, files: dict[str, str]) -> list[Path]:
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file, and target c writes several. Name a folder.")
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
