import os
import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.path import Path
from recordings import ROOT

from studies import palette, plots

NAMES = ("gb", "ts-ff", "ts-gbm")
TIME = 0.01 * np.arange(400)
TRUTH = np.random.default_rng(0).uniform(0.1, 0.4, 30)
REFERENCE = np.where(TIME < 2, 0.05, -0.05)
WAVE = 0.05 * np.sin(TIME)


def estimates(truth=TRUTH, names=NAMES):
    return {name: truth * (1 + 0.01 * (i + 1)) for i, name in enumerate(names)}


def identification(worst=2.0):
    model_time = TIME[::4]
    model = WAVE[::4] + 0.01 * (np.abs(model_time - worst - 0.5) < 0.5)
    return plots.identification(TIME, WAVE, WAVE + 1e-3, model_time, model, np.sign(WAVE))


def regression(values, truth=TRUTH, unit="s"):
    return plots.regression(truth, values, "$k_p$", unit, dict.fromkeys(values, 0.123))


def tracking(names=NAMES, apart=1e-4):
    rates = {name: WAVE + apart * i for i, name in enumerate(names)}
    return plots.tracking(TIME, REFERENCE, rates, rates)


def spread(scale, count=30):
    x, y = np.random.default_rng(1).normal(size=(2, count))
    return 60 + scale * x, 1.5 + 0.1 * scale * y


def margin_scatter(points=None, bound=(0.01, 1e-3)):
    points = points or {name: spread(0.01 * 10**i) for i, name in enumerate(NAMES)}
    return plots.margin_scatter(points, (60.0, 1.5), bound)


METRICS = {
    "identification": identification,
    "regression": lambda: regression(estimates()),
    "times": lambda: plots.times(estimates(0.01 * TRUTH)),
    "tracking": tracking,
    "margin_scatter": margin_scatter,
}


def labels(figure):
    return [f() for axes in figure.axes for f in (axes.get_xlabel, axes.get_ylabel)]


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def dot_colours(axes):
    dots = (part for part in axes.collections if isinstance(part, PathCollection))
    return [to_hex(part.get_facecolor()[0]).upper() for part in dots]


@pytest.mark.parametrize("name", METRICS)
def test_labels_have_units_and_settings_stay(name):
    before = dict(matplotlib.rcParams)
    figure = METRICS[name]()
    assert dict(matplotlib.rcParams) == before
    assert isinstance(figure, Figure) and figure.get_figwidth() == palette.WIDTH
    written = [label for label in labels(figure) if label]
    assert written
    assert all("[" in label for label in written)


@pytest.mark.parametrize("name", METRICS)
def test_equal_figures_are_saved_as_equal_bytes(name, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "DPI", 40)  # faster
    written = []
    for file in ("a.png", "b.png"):
        plots.save(METRICS[name](), tmp_path / file)
        written.append((tmp_path / file).read_bytes())
    assert written[0] == written[1]
    assert written[0].startswith(b"\x89PNG")
    for stamp in (b"tEXt", b"iTXt", b"tIME"):
        assert stamp not in written[0]


def test_a_save_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    figure = METRICS["times"]()

    def broken(file, **_):
        file.write(b"half of it")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", broken)
    with pytest.raises(OSError, match="disk full"):
        plots.save(figure, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_pyplot_is_not_imported():
    program = "import sys, studies.plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    paths = os.pathsep.join([str(ROOT), str(ROOT / "scripts")])
    subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": paths}, check=True
    )


def test_a_tuner_has_one_colour_in_every_figure():
    expected = [palette.colour(name) for name in NAMES]
    assert len(set(expected)) == 3
    above = regression(estimates()).axes[:3]
    assert [dot_colours(axes)[0] for axes in above] == expected
    (axes,) = METRICS["times"]().axes
    assert dot_colours(axes) == expected
    for axes in tracking().axes:
        assert [lines(axes)[name].get_color() for name in NAMES] == expected
    assert dot_colours(margin_scatter().axes[0]) == expected


def test_unknown_tuners_have_a_colour_too():
    assert palette.colour("mine.tuner") == palette.colour("mine.tuner") in palette.OTHER_COLOURS


def test_identification_shows_degrees_and_where_the_model_errs():
    above, whole, zoom = identification(worst=1.0).axes
    np.testing.assert_allclose(np.unique(above.get_lines()[0].get_ydata()), np.degrees([-1, 0, 1]))
    for axes in (whole, zoom):
        shown = lines(axes)
        assert list(shown) == ["measured", "noise-free", "ARMAX model"]
        np.testing.assert_allclose(shown["noise-free"].get_ydata(), np.degrees(WAVE))
    assert whole.get_xlim() == pytest.approx((0, 4))
    assert zoom.get_xlim() == pytest.approx((1, 2), abs=0.05)


def test_regression_has_one_panel_a_tuner_with_its_rms():
    grid = np.reshape(regression(estimates()).axes, (2, 3))
    for name, above, below in zip(NAMES, *grid, strict=True):
        assert above.get_title(loc="left") == f"{name}: rms 0.12 %"
        np.testing.assert_allclose(
            above.collections[0].get_offsets(), np.stack([TRUTH, estimates()[name]], axis=1)
        )
        x, y = above.get_lines()[0].get_data()
        assert list(x) == list(y)
        error = 100 * (estimates()[name] / TRUTH - 1)
        np.testing.assert_allclose(below.collections[0].get_offsets()[:, 1], error)


@pytest.mark.parametrize(("most", "scale"), [(0.9, "linear"), (2.0, "log")])
def test_regression_is_logarithmic_beyond_a_decade(most, scale):
    truth = np.linspace(0.1, most, 20)
    figure = regression({"gb": truth}, truth)
    for axes in figure.axes[:1]:
        assert axes.get_xscale() == axes.get_yscale() == scale


def test_regression_counts_what_it_shows(tmp_path):
    holes = np.where(np.arange(30) < 12, np.nan, TRUTH)
    figure = regression({"gb": holes, "ts-ff": TRUTH, "ts-gbm": np.full(30, np.nan)})
    assert [axes.get_xlabel()[-6:] for axes in figure.axes[3:]] == ["n = 18", "n = 30", " n = 0"]
    plots.save(figure, tmp_path / "holes.png")
    plots.save(regression({"gb": np.full(30, np.nan)}), tmp_path / "none.png")


def test_times_are_milliseconds_with_the_median_beside():
    (axes,) = plots.times({"gb": np.array([0.02, 0.05, 0.07]), "ts-ff": np.full(4, 1e-3)}).axes
    assert axes.get_xscale() == "log"
    assert [label.get_text() for label in axes.get_yticklabels()] == ["gb", "ts-ff"]
    assert [text.get_text() for text in axes.texts] == ["median 50 ms", "median 1.0 ms"]
    low, high = axes.get_xlim()
    assert low < 1 and high > 70


def test_one_constant_time_still_has_labelled_ticks():
    (axes,) = plots.times({"gb": np.full(5, 0.0075)}).axes
    low, high = axes.get_xlim()
    assert any(low < tick < high for tick in axes.xaxis.get_major_locator()())


def test_tracking_shows_every_tuner_and_the_steepest_transient():
    figure = tracking()
    for axes in figure.axes:
        assert set(NAMES) <= set(lines(axes))
    assert ["reference" in lines(axes) for axes in figure.axes] == [True, True, False, False]
    whole, zoom = figure.axes[:2]
    np.testing.assert_allclose(lines(whole)["reference"].get_ydata(), np.degrees(REFERENCE))
    low, high = zoom.get_xlim()
    assert low < 2 < high < 4
    apart = np.degrees(2e-4)
    assert zoom.get_title(loc="left") == f"tuners differ by up to {apart:.2g} deg/s"
    assert len({line.get_linestyle() for line in whole.get_lines()}) > 1


def test_tracking_of_a_single_tuner_compares_nothing():
    assert not any(axes.get_title(loc="left") for axes in tracking(names=("gb",)).axes)


def test_margin_scatter_marks_rms_and_bound():
    points = {name: spread(0.01 * 10**i) for i, name in enumerate(NAMES)}
    (axes,) = margin_scatter(points).axes
    marks = {label.split(":")[0]: line for label, line in lines(axes).items()}
    for name in NAMES:
        x, y = (line[0] for line in marks[f"{name}, n = 30"].get_data())
        assert y == pytest.approx(np.sqrt(np.mean((points[name][0] - 60) ** 2)))
        assert x == pytest.approx(np.sqrt(np.mean((points[name][1] - 1.5) ** 2)))
    assert [list(v) for v in marks["Cramér-Rao bound"].get_data()] == [[1e-3], [0.01]]
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_half_of_the_episodes_are_in_an_ellipse():
    points = spread(1.0, count=401)
    figure = margin_scatter({"gb": points})
    ellipse = max(figure.axes[0].get_lines(), key=lambda line: len(line.get_xdata()))
    path = Path(np.log(np.stack(ellipse.get_data(), axis=1)))
    inside = path.contains_points(
        np.log(np.abs(np.stack([points[1] - 1.5, points[0] - 60], axis=1)))
    )
    assert inside.mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("bound", [None, (0.01, 1e-3)])
@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_margin_scatter_survives_lost_and_perfect_loops(bound, bad, tmp_path):
    lost = np.full(5, np.nan)
    perfect = np.full(5, 60.0) + bad, np.full(5, 1.5) + bad
    for points in (
        {"gb": spread(0.1), "oracle": perfect, "nominal": (lost, lost)},
        {"gb": perfect},
    ):
        plots.save(margin_scatter(points, bound), tmp_path / "figure.png")
