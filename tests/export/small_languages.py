"""Readers of the MATLAB and the structured text that is exported, just large enough for these."""

import re

import control
import numpy as np

KNOWN = {
    "TRUE": True,
    "FALSE": False,
    "LIMIT": lambda low, value, high: min(max(value, low), high),
    "MIN": min,
    "MAX": max,
}


def scalars(script):
    """The numbers and rows that a MATLAB script assigns before its objects, by name."""
    found = {"Inf": np.inf}
    for name, text in re.findall(
        r"^(\w+) = ([^;]+);", script.partition("% Control System")[0], re.M
    ):
        found[name] = eval(text, {}, dict(found))
    return found


def objects(script):
    """Toolbox objects of a script, by name: a transfer function for each input."""
    known, found = scalars(script), {}
    with np.errstate(divide="ignore"):
        known = {name: np.float64(v) if np.isscalar(v) else v for name, v in known.items()}
        for name, call, text in re.findall(r"^(\w+) = (\w+)\((.*)\);", script, re.M):
            if call in MAKERS:
                text = text.replace("[kr, -k]", "[kr, *[-one for one in k]]")
                found[name] = MAKERS[call](*eval(f"({text},)", {}, dict(known)))
    return found


def _pid(Kp, Ki, Kd, Tf, Ts, *options):
    return (_of_pid2(Kp, Ki, Kd, Tf, 1.0, 1.0, Ts, *options)[1],)


def _of_pid2(Kp, Ki, Kd, Tf, b, c, Ts, *options):
    """MATLAB's manual on ``pid2``: Kp (b r - y) + Ki IF (r - y) + Kd/(Tf + DF) (c r - y)."""
    chosen = dict(zip(options[::2], options[1::2], strict=True))
    z = control.tf("z")
    z.dt = Ts
    trapezoid = Ts / 2 * (z + 1) / (z - 1)
    assert chosen["IFormula"] == "Trapezoidal"
    integral, derivative = Ki * trapezoid, 0.0
    if Kd:
        assert chosen["DFormula"] == "Trapezoidal" and Tf > 0
        derivative = Kd / (Tf + trapezoid)
    return tuple(Kp * p + integral + d * derivative for p, d in ((b, c), (1.0, 1.0)))


def _pidstd2(Kp, Ti, Td, N, b, c, Ts, *options):
    return _of_pid2(Kp, Kp / Ti, Kp * Td, Td / N if Td else 0.0, b, c, Ts, *options)


MAKERS = {
    "pid": _pid,
    "pid2": _of_pid2,
    "pidstd": lambda Kp, Ti, Td, N, Ts, *o: (_pidstd2(Kp, Ti, Td, N, 1.0, 1.0, Ts, *o)[1],),
    "pidstd2": _pidstd2,
    "tf": lambda num, den, Ts: (control.tf(num, den, Ts),),
    "ss": lambda A, B, C, D, Ts: (A, B, C, np.array(D), Ts),
}


class Block:
    """A function block of structured text as a Python object: inputs are arguments of a call."""

    def __init__(self, text):
        text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
        heads = re.findall(r"VAR(?:_INPUT|_OUTPUT| CONSTANT)?\n(.*?)END_VAR", text, re.S)
        declared = re.findall(r"(\w+) : (\w+)(?: := ([^;]+))?;", "".join(heads))
        assert {kind for _, kind, _ in declared} <= {"BOOL", "LREAL", "REAL"}
        names = [name.upper() for name, _, _ in declared]
        assert len(set(names)) == len(names)  # they are the same in small letters
        self.names = {name: kind for name, kind, _ in declared}
        start = {name: _value(value) for name, _, value in declared}
        self.memory = {**KNOWN, **start}
        self.code = compile(_python(text[text.rindex("END_VAR") + 8 :]), "block", "exec")

    def __call__(self, **inputs):
        assert set(inputs) <= set(self.names)
        self.memory |= inputs
        exec(self.code, self.memory)
        return self.memory["Command"]


def _value(text):
    if text in ("", "FALSE"):
        return False if text else 0.0
    assert re.fullmatch(r"-?\d+\.\d+(E-?\d+)?", text), text
    return float(text)


def _python(text, opening="THEN", words=(("<>", "!="), (" AND ", " and "), (" OR ", " or "))):
    """Assignments and IFs as Python."""
    lines, depth = [], 0
    joined = re.sub(r"\s+", " ", text).replace("END_FUNCTION_BLOCK", "")
    for part in re.split(r"(?<=;)|(?<= THEN)|(?<=ELSE )", joined):
        part = part.strip().rstrip(";")
        if part in ("END_IF", "ELSE"):
            depth -= 1
        if part == "ELSE":
            lines.append("    " * depth + "else:")
            depth += 1
        elif part.startswith("IF "):
            condition = re.sub(r"\bNOT\b", "not", part[3:].removesuffix("THEN"))
            for old, new in words:
                condition = condition.replace(old, new)
            lines.append("    " * depth + f"if {condition.strip()}:")
            depth += 1
        elif part and part != "END_IF":
            target, _, value = part.partition(" := ")
            assert value and re.fullmatch(r"\w+", target), part
            words_of = value
            for old, new in (*words, ("NOT ", "not ")):
                words_of = words_of.replace(old, new)
            lines.append("    " * depth + f"{target} = {words_of}")
    assert depth == 0
    return "\n".join(lines)


class Function:
    """The MATLAB function at the end of a script; its persistent variables are `memory`."""

    def __init__(self, script):
        head, self.arguments, body = re.search(
            r"^function u = (\w+)\((.*?)\)\n(.*)^end\n\Z", script, re.S | re.M
        ).groups()
        (kept,) = re.findall(r"persistent (.*)", body)
        body = re.sub(r"%.*", "", body.replace(f"persistent {kept}", ""))
        self.memory = {
            **dict.fromkeys(kept.split()), "isfinite": np.isfinite, "min": min, "max": max,
            "abs": abs, "isempty": lambda value: value is None,
        }  # fmt: skip
        lines, depth = [], 0
        for line in filter(None, map(str.strip, body.splitlines())):
            if line == "end":
                depth -= 1
                continue
            text = line.rstrip(";").replace("~=", "!=").replace("&&", "and")
            lines.append("    " * depth + (f"{text}:" if text.startswith("if ") else text))
            depth += text.startswith("if ")
        self.code = compile("\n".join(lines), head, "exec")

    def __call__(self, *values):
        self.memory |= dict(zip(self.arguments.split(", "), values, strict=True))
        exec(self.code, self.memory)
        return self.memory["u"]
