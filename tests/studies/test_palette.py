"""Tuners that share a picture can be told apart by their colours, by the colour-blind too."""

from itertools import combinations

import numpy as np
import pytest

from studies.palette import COLOURS, INK
from studies.paper import SHOWN, TIMED

OFF_DESIGN = (
    "ts-gbm", "ts-ff", "ts-gbm-lag", "ts-ff-lag", "ts-ff-lag-vx", "rl", "gb", "bb", "vrft", "frit",
    "ladder",
)  # fmt: skip
TOGETHER = {
    "paper": SHOWN,
    "times": TIMED,
    "off the design point": OFF_DESIGN,
    "agents": (
        *("naf-laguerre", "naf-plain-laguerre", "sac-laguerre", "td3-laguerre", "ppo-laguerre"),
        *("gb", "nominal"),
    ),
    "learning": ("ts-gbm", "ts-ff", "ts-gbm-lag", "ts-ff-lag", "gb"),
}
# Machado, Oliveira and Fernandes (2009), full severity, on linear RGB.
SEEN = {
    "all cones": np.eye(3),
    "no red cones": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                     [-0.003882, -0.048116, 1.051998]],
    "no green cones": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                       [-0.011820, 0.042940, 0.968881]],
}  # fmt: skip
XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
WHITE = [0.9505, 1.0, 1.089]
APART = 14.0
"""CIE 1976 distance; 2.3 is a just noticeable difference of large patches side by side."""


def lab(colour, seen):
    """CIELAB of a colour as someone sees it."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    t = XYZ @ np.clip(seen @ linear, 0, 1) / WHITE
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize("picture", TOGETHER)
def test_colours_of_a_picture_keep_apart(picture, seen):
    places = {name: lab(COLOURS[name], np.array(SEEN[seen])) for name in TOGETHER[picture]}
    places["bound"] = lab(INK, np.array(SEEN[seen]))
    for one, other in combinations(places, 2):
        assert np.linalg.norm(places[one] - places[other]) > APART, (one, other)
