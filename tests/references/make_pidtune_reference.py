"""Make ``pidtune_reference.json``: plants, targets, and the only controllers that meet them.

Nothing here comes from this repository's packages.  To run it::

    python3 -m venv /tmp/mpenv && /tmp/mpenv/bin/pip install mpmath==1.3.0 numpy==2.4.6
    /tmp/mpenv/bin/python tests/references/make_pidtune_reference.py

Notes
-----
*Controller.*  With 40 digits, ``C(s_c) = -exp(j pm)/G(s_c)``, and its real and imaginary part
give the gains of ``Kp + Ki/s + Kd s`` at once; a PID has its two zeros in one place, which is
``Ti = 4 Td``.  A discrete controller has Tustin's formula for s, and the backward difference
for the derivative, whose gains are found by Newton's method from these.

*Status.*  The phase of the plant is unwrapped in 20 000 steps from 1e-4 of the crossover (or of
the slowest root), where it is -90 degrees for each integrator, -180 for each pole in the right
half plane.  The phase that the controller must supply is compared with what its kind can; where
a PI, PD or PID must lead by more, it leads by its most less 1.0027 degrees.  A loop whose
magnitude is above 1 somewhere above the wanted crossover is unreachable.

*Stability.*  Roots of the closed loop's polynomial; with a continuous delay, the winding of
``1 + L`` around a contour that encloses the right half plane out to where ``|L| < 1`` (the
integrators passed on the right).

The file is a list of objects: ``name``, ``num``, ``den`` (highest power first), ``dt``, ``delay``
[s], ``kind``, ``wc`` [rad/s], ``pm`` [deg], ``status``, ``Kp``, ``Ki``, ``Kd``, ``stable``,
``margin`` [deg] (what the loop has at wc).
"""

import json
from pathlib import Path

import numpy as np
from mpmath import (
    arg,
    cos,
    degrees,
    exp,
    fabs,
    findroot,
    im,
    mp,
    mpc,
    mpf,
    pi,
    polyroots,
    radians,
    re,
    sqrt,
    tan,
)

mp.dps = 40
LAG = radians(mpf("1.0027"))


def expand(roots, gain=1):
    """Coefficients of the polynomial with these roots."""
    out = [mpc(gain)]
    for root in roots:
        out = [a - root * b for a, b in zip([*out, 0], [0, *out], strict=True)]
    return [re(c) for c in out]


def pair(omega, zeta):
    """Return two conjugate roots."""
    omega, zeta = mpf(omega), mpf(zeta)
    root = omega * mpc(-zeta, sqrt(1 - zeta**2))
    return [root, root.conjugate()]


def plant(name, gain, zeros, poles, dt=0.0, delay=0.0):
    """One plant; in z if `dt` is given."""
    return dict(name=name, gain=mpf(gain), zeros=[mpc(z) for z in zeros],
                poles=[mpc(p) for p in poles], dt=dt, delay=mpf(delay))  # fmt: skip


def held(name, gain, pole, dt, delay=0.0):
    """Return gain/(s + pole) behind a zero-order hold."""
    a = exp(-mpf(pole) * mpf(dt))
    return plant(name, gain * (1 - a) / mpf(pole), [], [a], dt, delay)


def held_double_integrator(dt):
    """Return 1/s^2 behind a zero-order hold."""
    return plant("double integrator, sampled", mpf(dt) ** 2 / 2, [-1], [1, 1], dt)


def held_double_lag(dt):
    """Return 1/(s + 1)^2 behind a zero-order hold."""
    T = mpf(dt)
    a = exp(-T)
    b1, b0 = 1 - a - T * a, a * (a - 1 + T)
    return plant("double lag, sampled", b1, [-b0 / b1], [a, a], dt)


S = plant
CASES = [
    (S("first order", 2, [], [-1]), "PI", 3, 60),
    (S("first order", 2, [], [-1]), "PI", 0.5, 60),
    (S("first order", 2, [], [-1]), "PI", 0.2, 60),  # needs more lag than a PI has
    (S("first order", 2, [], [-1]), "P", 3, 60),
    (S("first order", 2, [], [-1]), "I", 0.2, 60),
    (S("first order, negative gain", -3, [], [-2]), "PI", 4, 70),
    (S("lag with zero", 1, [-3], [-1, -0.5]), "PI", 2, 60),
    (S("second order", 5, [], [-1, -2]), "PI", 1, 60),
    (S("second order", 5, [], [-1, -2]), "PID", 3, 60),
    (S("second order", 5, [], [-1, -2]), "PD", 4, 60),
    (S("second order", 5, [], [-1, -2]), "PD", 1, 60),  # needs lag
    (S("triple lag", 1, [], [-1] * 3), "PI", 0.5205, 60),
    (S("triple lag", 1, [], [-1] * 3), "PI", 1, 60),
    (S("triple lag", 1, [], [-1] * 3), "PID", 1, 60),
    (S("triple lag", 1, [], [-1] * 3), "PID", 2.5, 75),
    (S("triple lag", 1, [], [-1] * 3), "P", 0.5, 60),
    (S("triple lag", 1, [], [-1] * 3), "P", 1.2, 60),  # margin is less
    (S("four lags", 1, [], [-1, -2, -3, -4], ), "PI", 0.7, 55),
    (S("five lags", 100, [], [-1, -2, -3, -4, -5]), "PID", 1.2, 60),
    (S("six lags", 1, [], [-1] * 6), "PI", 0.25, 60),
    (S("six lags, past -300 deg", 1, [], [-1] * 6), "PI", 1.2, 60),
    (S("six lags, past -300 deg", 1, [], [-1] * 6), "PID", 1.2, 60),
    (S("sixth order, spread", 1e6, [-7], [-0.1, -2, -10, -30, -50, -80]), "PI", 1.5, 60),
    (S("integrator", 1, [], [0]), "PI", 2, 60),
    (S("integrator with lag", 3, [], [0, -1]), "PI", 0.2, 60),
    (S("integrator with lag", 3, [], [0, -1]), "PID", 1, 60),
    (S("integrator with lag", 3, [], [0, -1]), "PD", 2, 50),
    (S("double integrator", 1, [], [0, 0]), "PI", 1, 60),
    (S("double integrator", 1, [], [0, 0]), "PID", 1, 60),
    (S("double integrator", 1, [], [0, 0]), "PD", 1, 45),
    (S("motor, integrating, three lags", 1e3, [], [0, -5, -20, -50]), "PID", 8, 50),
    (S("first order, delay", 2, [], [-1], delay=0.5), "PI", 1, 60),
    (S("first order, delay", 2, [], [-1], delay=0.5), "PID", 2, 60),
    (S("long delay", 1, [], [-1], delay=4), "PI", 0.2, 60),
    (S("long delay", 1, [], [-1], delay=4), "PI", 2, 60),  # past a full turn
    (S("pure delay with lag", 1, [], [-20], delay=1), "PI", 0.4, 65),
    (S("integrator, delay", 1, [], [0], delay=0.3), "PI", 1, 50),
    (S("triple lag, delay", 1, [], [-1] * 3, delay=1), "PI", 0.35, 60),
    (S("resonant", 1, [], pair(10, 0.3)), "PI", 3, 89),
    (S("resonant, lightly damped", 1, [], pair(10, 0.05)), "PI", 0.9, 89),
    (S("resonant, above", 1, [], pair(1, 0.02)), "PID", 5, 60),
    (S("lag, resonance above the crossover", 900, [], [-1, *pair(30, 0.005)]), "PI", 5, 60),
    (S("lag, resonance well below 1", 900, [], [-1, *pair(30, 0.3)]), "PI", 2, 60),
    (S("antiresonance", 1, pair(3, 0.1), [-1, *pair(5, 0.1)]), "PI", 1.5, 60),
    (S("undamped", 1, [], pair(1, 0)), "PID", 2, 60),
    (S("right zero", -1, [2], [-1, -1]), "PI", 0.4, 60),
    (S("right zero", -1, [2], [-1, -1]), "PID", 1, 50),
    (S("two right zeros", 1, [3, 4], [-1, -1, -2]), "PI", 0.4, 60),
    (S("all-pass", -1, [5], [-5]), "PI", 4, 45),
    (S("unstable, first order", 1, [], [1]), "PI", 4, 60),
    (S("unstable, first order", 1, [], [1]), "P", 4, 60),
    (S("unstable, first order", 1, [], [1]), "PI", 1, 60),
    (S("unstable, second order", 8, [], [2, -4]), "PID", 6, 50),
    (S("unstable, second order", 8, [], [2, -4]), "PD", 6, 50),
    (S("unstable oscillator", 1, [], pair(1, -0.5)), "PID", 4, 60),
    (S("unstable oscillator", 1, [], pair(1, -0.5)), "PI", 4, 60),
    (S("unstable, delay", 1, [], [1], delay=0.1), "PI", 3, 40),
    (S("unstable, negative gain", -1, [], [1, -10]), "PID", 5, 45),
    (held("first order, sampled", 2, 1, 0.1), "PI", 3, 60),
    (held("first order, sampled slowly", 2, 1, 0.5), "PI", 2, 50),
    (held("first order, sampled, delay", 2, 1, 0.1, 0.3), "PI", 1.5, 60),
    (held("unstable, sampled", 1, -1, 0.05), "PI", 4, 50),
    (held_double_lag(0.1), "PI", 0.8, 60),
    (held_double_lag(0.1), "PID", 2, 60),
    (held_double_lag(0.1), "PI", 3, 60),
    (held_double_integrator(0.05), "PID", 2, 50),
    (held_double_integrator(0.05), "PD", 2, 50),
    (held_double_integrator(0.05), "PI", 2, 50),
    (S("accumulator", 0.01, [], [1], 0.01), "PI", 10, 60),
    (S("sampled resonance", 0.02, [], [mpc(0.9, 0.3), mpc(0.9, -0.3)], 0.1), "PI", 0.5, 80),
    (S("sampled right zero", -0.1, [1.5], [0.9, 0.8], 0.1), "PI", 0.5, 60),
]  # fmt: skip


def undelayed(G, omega):
    """Response at `omega` without the delay."""
    at = exp(1j * omega * mpf(G["dt"])) if G["dt"] else mpc(0, omega)
    value = mpc(G["gain"])
    for z in G["zeros"]:
        value *= at - z
    for p in G["poles"]:
        value /= at - p
    return value


def response(G, omega):
    """Response at `omega`, with the delay."""
    return undelayed(G, omega) * exp(-1j * omega * G["delay"])


def unstable(G, p):
    """Whether a pole is in the right half plane, or outside the unit circle."""
    return fabs(p) > 1 + mpf("1e-20") if G["dt"] else re(p) > mpf("1e-20")


def tracked_phase(G, wc):
    """Phase at `wc`, unwrapped, and the sign that the controller's gains need."""
    edge = 1 if G["dt"] else 0
    at_edge = sum(p == edge for p in G["poles"])
    before = sum(unstable(G, p) for p in G["poles"])
    slowest = [fabs(p - edge) / (G["dt"] or 1) for p in [*G["poles"], *G["zeros"]] if p != edge]
    omega = mpf("1e-4") * min([wc, *slowest])
    start = -at_edge * pi / 2 - before * pi
    first = undelayed(G, omega)
    turn = (arg(first) - start) / pi  # a whole number, odd where the gain must be negative
    sign = 1 if round(turn) % 2 == 0 else -1
    grid = np.geomspace(float(omega), float(wc), 20000)
    steps = np.diff(np.unwrap(np.angle(sampled(G, grid))))
    exact = arg(undelayed(G, wc)) + (0 if sign > 0 else pi)
    about = start + (turn - round(turn)) * pi + mpf(steps.sum())
    return exact + 2 * pi * round((about - exact) / (2 * pi)) - wc * G["delay"], sign


def sampled(G, omega):
    """Response at many frequencies, without the delay, in double precision."""
    at = np.exp(1j * omega * G["dt"]) if G["dt"] else 1j * omega
    value = np.full(len(omega), complex(G["gain"]))
    for z in G["zeros"]:
        value *= at - complex(z)
    for p in G["poles"]:
        value /= at - complex(p)
    return value


def basis(G, wc):
    """Return 1, integral and derivative of a controller at `wc`, and Tf."""
    if not G["dt"]:
        return mpc(1), 1 / mpc(0, wc), mpc(0, wc)
    T, z = mpf(G["dt"]), exp(1j * wc * mpf(G["dt"]))
    return mpc(1), T / 2 * (z + 1) / (z - 1), (z - 1) / (T * z)


def gains(G, kind, C, wc):
    """Kp, Ki, Kd whose response at wc is C."""
    one, integral, derivative = basis(G, wc)
    if kind == "P":
        return fabs(C), mpf(0), mpf(0)
    if kind == "I":
        return mpf(0), fabs(C) / fabs(integral), mpf(0)
    if kind == "PI":
        return re(C), im(C) / im(integral), mpf(0)
    if kind == "PD":
        Kd = im(C) / im(derivative)
        return re(C) - Kd * re(derivative), mpf(0), Kd
    # One place for both zeros: Ki (1 + T s)^2/(s (1 + Tf s)).
    Tf = mpf(G["dt"]) / 2

    def parts(Ki, T):
        return Ki * (2 * T - Tf), Ki, Ki * (T - Tf) ** 2

    def missing(Ki, T):
        a, b, c = parts(Ki, T)
        left = a * one + b * integral + c * derivative - C
        return re(left), im(left)

    # The filter's lag is small: start from the solution without it.
    psi = arg(C)
    T0 = tan((psi + pi / 2) / 2) / wc
    return parts(*findroot(missing, (fabs(C) * cos(psi) / (2 * T0), T0)))


def controller(G, k, omega):
    """Response of a controller with gains k."""
    return sum(a * b for a, b in zip(k, basis(G, omega), strict=True))


def reach(G, kind, wc):
    """Least and largest phase of a kind."""
    alpha = wc * mpf(G["dt"]) / 2 if kind in ("PD", "PID") else mpf(0)
    return {
        "P": (0, 0),
        "I": (-pi / 2, -pi / 2),
        "PI": (-pi / 2, mpf(0)),
        "PD": (mpf(0), pi / 2 - alpha),
        "PID": (alpha - pi / 2, pi / 2 - alpha),
    }[kind]


def closed_loop(G, k):
    """Numerator and denominator of L in s or z, without a continuous delay."""
    num, den = expand(G["zeros"], G["gain"]), expand(G["poles"])
    Kp, Ki, Kd = k
    if G["dt"]:
        T = mpf(G["dt"])
        # Kp + Ki T/2 (z + 1)/(z - 1) + Kd (z - 1)/(T z), over z (z - 1)
        top = [Kp + Ki * T / 2 + Kd / T, -Kp + Ki * T / 2 - 2 * Kd / T, Kd / T]
        bottom = [mpf(1), mpf(-1), mpf(0)]
        den = [*den, *[mpf(0)] * int(round(G["delay"] / T))]
    else:
        top, bottom = [Kd, Kp, Ki], [mpf(1), mpf(0)]
    if not Ki:  # no integrator after all: divide it out
        if G["dt"]:
            top, bottom = [Kp + Kd / T, -Kd / T], [mpf(1), mpf(0)]
        else:
            top, bottom = [Kd, Kp], [mpf(1)]
    return product(num, top), product(den, bottom)


def product(p, q):
    """Product of two polynomials."""
    out = [mpf(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            out[i + j] += a * b
    return out


def stable(G, k, wc):
    """Whether the closed loop is."""
    num, den = closed_loop(G, k)
    if G["delay"] and not G["dt"]:
        return winding(num, den, G["delay"], wc) == 0
    num, den = ([mpf(0)] * (9 - len(p)) + p for p in (num, den))
    total = [a + b for a, b in zip(num, den, strict=True)]
    while total[0] == 0:
        total = total[1:]
    roots = polyroots(total, maxsteps=2000, extraprec=2000)
    return all(fabs(r) < 1 for r in roots) if G["dt"] else all(re(r) < 0 for r in roots)


def winding(num, den, delay, wc):
    """Roots of den + num exp(-s delay) in the right half plane, by the argument principle.

    Along a closed contour: up the imaginary axis, moved to the right by a little so that
    it misses the integrators, and back on a half circle.
    """
    radius, aside = 300 * float(wc), 1e-3 * float(wc)
    num, den = (np.array([float(c) for c in p]) for p in (num, den))

    def value(s):
        return np.polyval(den, s) + np.polyval(num, s) * np.exp(-s * float(delay))

    along = aside + 1j * radius * np.linspace(-1, 1, 2_000_001) ** 3
    around = np.hypot(aside, radius) * np.exp(1j * np.linspace(np.pi / 2, -np.pi / 2, 100_001))
    around = np.concatenate([along[-1:], around[1:-1], along[:1]])
    if abs(np.polyval(num, along[0]) / np.polyval(den, along[0])) > 1:
        return 1  # it is never small, and has roots far to the right
    turns = [np.diff(np.unwrap(np.angle(value(path)))).sum() for path in (along, around)]
    return int(round(-sum(turns) / (2 * np.pi)))


def recrosses(G, k, wc):
    """Whether |L| is above 1 somewhere above wc."""
    wc, k = float(wc), [float(g) for g in k]
    omega = np.geomspace(wc * 1.001, 0.9999 * np.pi / G["dt"] if G["dt"] else 1000 * wc, 20000)
    if G["dt"]:
        z = np.exp(1j * omega * G["dt"])
        parts = 1, G["dt"] / 2 * (z + 1) / (z - 1), (z - 1) / (G["dt"] * z)
    else:
        parts = 1, 1 / (1j * omega), 1j * omega
    C = sum(a * b for a, b in zip(k, parts, strict=True))
    return bool((np.abs(sampled(G, omega) * C) > 1).any())


def case(G, kind, wc, pm):
    """One row of the table."""
    wc, margin = mpf(wc), radians(mpf(pm))
    phase, sign = tracked_phase(G, wc)
    needed = margin - pi - phase
    low, high = reach(G, kind, wc)
    row = dict(
        name=G["name"], num=[float(c) for c in expand(G["zeros"], G["gain"])],
        den=[float(c) for c in expand(G["poles"])], dt=G["dt"], delay=float(G["delay"]),
        kind=kind, wc=float(wc), pm=pm, needed=float(degrees(needed)), status="UNREACHABLE",
        Kp=None, Ki=None, Kd=None, stable=None, margin=None,
    )  # fmt: skip
    if kind in "PI" and kind != "PI":
        status, supplied = ("OK" if needed <= high else "PHASE_LIMITED"), high
    elif needed <= low:
        return row
    else:
        status = "OK" if needed < high else "PHASE_LIMITED"
        supplied = needed if status == "OK" else high - LAG
    C = exp(1j * supplied) / fabs(response(G, wc))
    k = [sign * g for g in gains(G, kind, C, wc)]
    if recrosses(G, k, wc):
        status = "UNREACHABLE"
    at_wc = response(G, wc) * controller(G, k, wc)
    assert fabs(fabs(at_wc) - 1) < mpf("1e-25")
    row |= dict(status=status, Kp=float(k[0]), Ki=float(k[1]), Kd=float(k[2]),
                stable=bool(stable(G, k, wc)), margin=float(degrees(arg(-at_wc))))  # fmt: skip
    return row


def main():
    """Compute and write."""
    rows = []
    for number, arguments in enumerate(CASES):
        rows.append(case(*arguments))
        row = rows[-1]
        print(number, row["name"], row["kind"], row["wc"], row["status"], row["stable"],
              row["margin"], round(row["needed"], 2))  # fmt: skip
    text = ",\n".join(json.dumps(row) for row in rows)
    Path(__file__).with_name("pidtune_reference.json").write_text(f"[\n{text}\n]\n")


if __name__ == "__main__":
    main()
