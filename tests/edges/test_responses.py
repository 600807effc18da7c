"""Bad responses and frequency responses: the argument that a refusal names."""

import numpy as np
import pytest

from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response

F = np.geomspace(0.01, 10.0, 2000)
T = np.linspace(0.0, 3.0, 50)


@pytest.mark.parametrize(
    "make, name",
    [
        (lambda: ClosedLoop(), "responses or open"),
        (lambda: Response("Step", T, T[:9]), r"'Step' .*\(9,\).* 50 times"),
        (lambda: Response("Step", T[:1], T[:1]), "time must rise.* at least two"),
        (lambda: Response(None, T, T), "title = None"),
        (lambda: Response("Step", T, T, setpoint=np.inf), "setpoint = inf"),
        (lambda: Response("Step", T, T, label=3), "label = 3"),
        (lambda: OpenLoop(T, T), "frequency = 0"),
        (lambda: OpenLoop(F, F[:9]), r"response .*\(9,\).* 2000"),
        (lambda: OpenLoop(F, ["x"] * 2000), "response .*complex"),
        (lambda: OpenLoop(F, np.full(2000, np.nan)), "response .*nan"),
        (lambda: OpenLoop(F, 0 * F), "response .* not 0"),
        (lambda: OpenLoop(F, F, margins=3), "margins = 3"),
        (lambda: ClosedLoop(Response("Step", T, T)), "responses"),
        (lambda: ClosedLoop((3,)), "response = 3"),
        (lambda: ClosedLoop((), 3), "open = 3"),
        (lambda: ClosedLoop((), OpenLoop(F, F), "no"), "stable = 'no'"),
    ],
)
def test_bad_arguments_are_named(make, name):
    with pytest.raises(ValueError, match=name):
        make()
