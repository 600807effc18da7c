"""How figures look: size, style, and a colour for every tuner, the same in all of them."""

from zlib import crc32

from yawrate_env.env import rendering

WIDTH, DPI = 8.0, 150  # inch, pixels an inch
STYLE = {**rendering.STYLE, "font.size": 9.5, "figure.constrained_layout.use": True}
# Okabe and Ito's palette, with further colours that keep apart from it and from each other for
# the colour-blind; tuners of one picture never share a colour (tests/studies/test_palette.py).
COLOURS = {
    **{"gb": "#0072B2", "ts-ff": "#D55E00", "ts-gbm": "#009E73", "ts-ff-gains": "#E69F00"},
    **{"ts-gbm-gains": "#CC79A7", "nominal": "#7b838c", "oracle": "#1f2328"},
    **{"ts-ff-lag": "#56B4E9", "ts-gbm-lag": "#332288", "Cramér–Rao bound": "#1f2328"},
    **{"ts-ff-lag-vx": "#CDBB5C", "rl": "#8B0000", "naf-laguerre": "#8B0000"},
    **{"vrft": "#EE99AA", "frit": "#01665E", "bb": "#E69F00", "ladder": "#785EF0"},
    **{"naf-plain-laguerre": "#F0A0C0", "sac-laguerre": "#E69F00", "rl-sac": "#E69F00"},
    **{"ff-laguerre": "#56B4E9", "td3-laguerre": "#01665E", "ppo-laguerre": "#332288"},
}
OTHER_COLOURS = ("#56B4E9", "#8B0000", "#CDBB5C", "#332288")
INK, MODEL, NOISE, ZOOM = rendering.INK, "#b0307a", "#7fb0dd", "#faf6ea"


def colour(tuner: str) -> str:
    """Colour of a tuner, the same in every figure."""
    return COLOURS.get(tuner) or OTHER_COLOURS[crc32(tuner.encode()) % len(OTHER_COLOURS)]


def chance(episodes: int) -> str:
    """Why a tuner may lie below the bound, from the spread of a sample's standard deviation."""
    share = 100 / (2 * episodes) ** 0.5
    return (
        f"The bound limits the standard deviation over many episodes; that of {episodes} has a "
        f"standard error of {share:.1f} %,\nso a tuner on the bound may lie below it by chance."
    )
