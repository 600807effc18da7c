"""How figures look: size, style, and a colour for every tuner, the same in all of them."""

from zlib import crc32

from yawrate_env.env import rendering

WIDTH, DPI = 8.0, 150  # inch, pixels an inch
STYLE = {**rendering.STYLE, "font.size": 9.5, "figure.constrained_layout.use": True}
# Okabe and Ito's palette, which the colour-blind can tell apart.
COLOURS = {
    **{"gb": "#0072B2", "ts-ff": "#D55E00", "ts-gbm": "#009E73", "ts-ff-gains": "#E69F00"},
    **{"ts-gbm-gains": "#CC79A7", "nominal": "#7b838c", "oracle": "#1f2328"},
    **{"ts-ff-lag": "#56B4E9", "ts-gbm-lag": "#332288", "Cramér–Rao bound": "#1f2328"},
    **{"ts-ff-lag-vx": "#999933", "rl": "#882255", "naf-laguerre": "#882255"},
    **{"vrft": "#AA4499", "frit": "#117733", "bb": "#E69F00", "ladder": "#EE3377"},
    **{"naf-plain-laguerre": "#CC79A7", "sac-laguerre": "#E69F00", "rl-sac": "#E69F00"},
    **{"ff-laguerre": "#56B4E9", "td3-laguerre": "#999933", "ppo-laguerre": "#332288"},
}
OTHER_COLOURS = ("#56B4E9", "#882255", "#999933", "#332288")
INK, MODEL, NOISE, ZOOM = rendering.INK, "#b0307a", "#7fb0dd", "#faf6ea"


def colour(tuner: str) -> str:
    """Colour of a tuner, the same in every figure."""
    return COLOURS.get(tuner) or OTHER_COLOURS[crc32(tuner.encode()) % len(OTHER_COLOURS)]
