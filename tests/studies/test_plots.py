import matplotlib
import numpy as np
import pytest
from imports import imported_names
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


POINTS = {name: spread(0.01 * 10**i) for i, name in enumerate(NAMES)}


def margin_scatter(points=POINTS, bound=(0.01, 1e-3)):
    return plots.margin_scatter(points, (60.0, 1.5), bound)


FIGURES = {
    "identification": identification,
    "regression": lambda: regression(estimates()),
    "times": lambda: plots.times(estimates(0.01 * TRUTH)),
    "tracking": tracking,
    "margin_scatter": margin_scatter,
}


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def dot_colours(axes):
    dots = (part for part in axes.collections if isinstance(part, PathCollection))
    return [to_hex(part.get_facecolor()[0]).upper() for part in dots]


@pytest.mark.parametrize("name", FIGURES)
def test_figures_have_units_leave_settings_and_are_saved_as_equal_bytes(
    name, tmp_path, monkeypatch
):
    before = dict(matplotlib.rcParams)
    figures = FIGURES[name](), FIGURES[name]()
    assert dict(matplotlib.rcParams) == before
    assert isinstance(figures[0], Figure) and figures[0].get_figwidth() == palette.WIDTH
    labels = [f() for axes in figures[0].axes for f in (axes.get_xlabel, axes.get_ylabel)]
    assert any(labels) and all("[" in label for label in labels if label)
    monkeypatch.setattr(plots, "DPI", 20)  # faster
    written = []
    for figure in figures:
        plots.save(figure, tmp_path / "figure.png")
        written.append((tmp_path / "figure.png").read_bytes())
    assert written[0] == written[1]
    assert written[0].startswith(b"\x89PNG")
    assert not any(stamp in written[0] for stamp in (b"tEXt", b"iTXt", b"tIME"))


def test_a_save_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    figure = FIGURES["times"]()

    def broken(file, **_):
        file.write(b"half of it")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", broken)
    with pytest.raises(OSError, match="disk full"):
        plots.save(figure, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_pyplot_is_not_imported():
    for path in (ROOT / "scripts").glob("[bs]*s/*.py"):
        assert not any(name.startswith("matplotlib.pyplot") for name in imported_names(path)), path


def test_a_tuner_has_one_colour_in_every_figure():
    expected = [palette.colour(name) for name in NAMES]
    assert len(set(expected)) == 3
    above = FIGURES["regression"]().axes[:3]
    assert [dot_colours(axes)[0] for axes in above] == expected
    (axes,) = FIGURES["times"]().axes
    assert dot_colours(axes) == expected
    for axes in tracking().axes:
        assert [lines(axes)[name].get_color() for name in NAMES] == expected
    assert dot_colours(margin_scatter().axes[0]) == expected
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
        pairs = np.stack([TRUTH, estimates()[name]], axis=1)
        np.testing.assert_allclose(above.collections[0].get_offsets(), pairs)
        x, y = above.get_lines()[0].get_data()
        assert list(x) == list(y)
        error = 100 * (estimates()[name] / TRUTH - 1)
        np.testing.assert_allclose(below.collections[0].get_offsets()[:, 1], error)
    for most, scale in ((0.9, "linear"), (2.0, "log")):  # logarithmic beyond a decade
        truth = np.linspace(0.1, most, 20)
        axes = regression({"gb": truth}, truth).axes[0]
        assert axes.get_xscale() == axes.get_yscale() == scale


def test_regression_counts_what_it_shows(tmp_path):
    holes, none = np.where(np.arange(30) < 12, np.nan, TRUTH), np.full(30, np.nan)
    figure = regression({"gb": holes, "ts-ff": TRUTH, "ts-gbm": none})
    assert [axes.get_xlabel()[-6:] for axes in figure.axes[3:]] == ["n = 18", "n = 30", " n = 0"]
    plots.save(regression({"gb": none}), tmp_path / "none.png")


def test_times_are_milliseconds_with_the_median_beside():
    (axes,) = plots.times({"gb": np.array([0.02, 0.05, 0.07]), "ts-ff": np.full(4, 1e-3)}).axes
    assert axes.get_xscale() == "log"
    assert [text.get_text() for text in axes.texts] == ["median 50 ms", "median 1.0 ms"]
    low, high = axes.get_xlim()
    assert low < 1 and high > 70
    (axes,) = plots.times({"gb": np.full(5, 0.0075)}).axes  # one constant time has ticks too
    low, high = axes.get_xlim()
    assert any(low < tick < high for tick in axes.xaxis.get_major_locator()())


def test_tracking_shows_every_tuner_and_the_steepest_transient():
    figure = tracking()
    assert all(set(NAMES) <= set(lines(axes)) for axes in figure.axes)
    whole, zoom = figure.axes[:2]
    np.testing.assert_allclose(lines(whole)["reference"].get_ydata(), np.degrees(REFERENCE))
    low, high = zoom.get_xlim()
    assert low < 2 < high < 4
    apart = np.degrees(2e-4)
    assert zoom.get_title(loc="left") == f"tuners differ by up to {apart:.2g} deg/s"
    assert not any(axes.get_title(loc="left") for axes in tracking(names=("gb",)).axes)


def test_margin_scatter_marks_rms_bound_and_half_of_the_episodes():
    (axes,) = margin_scatter().axes
    marks = {label.split(":")[0]: line for label, line in lines(axes).items()}
    for name in NAMES:
        x, y = (line[0] for line in marks[f"{name}, n = 30"].get_data())
        assert y == pytest.approx(np.sqrt(np.mean((POINTS[name][0] - 60) ** 2)))
        assert x == pytest.approx(np.sqrt(np.mean((POINTS[name][1] - 1.5) ** 2)))
    assert [list(v) for v in marks["Cramér-Rao bound"].get_data()] == [[1e-3], [0.01]]
    assert axes.get_xscale() == axes.get_yscale() == "log"

    points = spread(1.0, count=401)
    (axes,) = margin_scatter({"gb": points}).axes
    ellipse = max(axes.get_lines(), key=lambda line: len(line.get_xdata()))
    path = Path(np.log(np.stack(ellipse.get_data(), axis=1)))
    off = np.abs(np.stack([points[1] - 1.5, points[0] - 60], axis=1))
    assert path.contains_points(np.log(off)).mean() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("bound", [None, (0.01, 1e-3)])
def test_margin_scatter_survives_lost_and_perfect_loops(bound, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "DPI", 20)
    lost, perfect = np.full(5, np.nan), (np.full(5, 60.0), np.full(5, 1.5))
    for points in (
        {"gb": spread(0.1), "oracle": perfect, "nominal": (lost, lost)},
        {"gb": perfect},
        {"gb": (lost, lost)},
    ):
        plots.save(margin_scatter(points, bound), tmp_path / "figure.png")
