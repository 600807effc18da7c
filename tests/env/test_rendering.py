import os
import subprocess
import sys
import warnings

import gymnasium
import make_docs
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled, ResetNeeded
from gymnasium.utils.env_checker import check_env
from recordings import ROOT

from yawrate_env.env.rendering import figure, pixels
from yawrate_env.env.window import Window
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

SHAPE = (640, 1000, 3)
TASK = Task()
VEHICLE = Context.of(0.7, 150.0, 20.0)
OBS = np.stack([np.full(1000, 0.01), np.sin(np.arange(1000) / 50)]).astype(np.float32)


def lines(picture, title):
    """Lines of the axes with this title, by label."""
    (axes,) = (axes for axes in picture.axes if axes.get_title(loc="left") == title)
    return {line.get_label(): line.get_data() for line in axes.get_lines()}


def texts(picture):
    return [text.get_text() for text in picture.texts]


def test_frames_are_pixels_and_change_with_the_step():
    env = PITuningEnv(render_mode="rgb_array")
    env.close()
    env.reset(seed=0)
    before = env.render()
    env.step(np.array([0.2, 0.2]))
    after = env.render()
    for frame in (before, after):
        assert isinstance(frame, np.ndarray) and frame.shape == SHAPE and frame.dtype == np.uint8
    assert (before != after).any()
    env.close()
    env.close()
    np.testing.assert_array_equal(after, env.render())  # drawing changes nothing
    window = Window(human=True)
    window.close()
    window.close()


def test_headline_has_gains_margins_and_reward():
    oracle = loops(TASK, VEHICLE).design()
    shown = texts(figure(TASK, VEHICLE, OBS, np.array([oracle.kp[0], oracle.Ti[0]])))
    for value in (f"{oracle.kp[0]:.3g} s", f"{oracle.Ti[0]:.3g} s", "60.0°", "1.50 Hz", "stable"):
        assert value in shown
    assert {"0.00", "\N{MINUS SIGN}0.00"} & set(shown)
    # Nothing of the truth is drawn before the step: it is not even looked at.
    assert "waiting for gains" in texts(figure(TASK, None, OBS, None))


def test_step_responses_follow_the_reference_and_the_oracle():
    """Integral action reaches the reference, with the oracle's gains along its own line."""
    oracle = loops(TASK, VEHICLE).design()
    picture = figure(TASK, VEHICLE, OBS, np.array([oracle.kp[0], oracle.Ti[0]]))
    curves = lines(picture, "Step response")
    np.testing.assert_array_equal(curves["gains"], curves["oracle"])
    time, y = curves["gains"]
    assert time[-1] == pytest.approx(2.0) and y[0] == 0
    assert y[-1] == pytest.approx(1, abs=0.01)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "gains, controller",
    [((10.0, 1e-3), "pi"), ((10.0, 100.0), "printed"), ((1e-3, 1e-3), "printed"),
     ((1e-3, 100.0), "pi")],
)  # fmt: skip
def test_corners_of_the_action_space_render(gains, controller):
    env = PITuningEnv(render_mode="rgb_array", controller=controller)
    env.reset(seed=0)
    stable = env.step(np.array(gains))[4]["stable"]
    frame = env.render()
    assert frame is not None and frame.shape == SHAPE
    assert stable or "UNSTABLE" in texts(figure(TASK, VEHICLE, OBS, np.array(gains)))


def test_unstable_loops_keep_the_axes():
    limits = []
    for gains in ((10.0, 1e-3), (0.17, 0.14)):
        picture = figure(TASK, VEHICLE, OBS, np.array(gains))
        limits.append([(axes.get_xlim(), axes.get_ylim()) for axes in picture.axes])
    assert limits[0] == limits[1]


@pytest.mark.parametrize(
    "arguments",
    [
        {"visible": "context", "decimate": 7, "register": "random", "delay_samples": 8},
        {"Ts_control": 1.0, "crossover": 0.02},  # the oracle has no gains
        {"N": 200, "snr_db": 0.0},
    ],
)
def test_other_tasks_render(arguments):
    env = PITuningEnv(render_mode="rgb_array", **arguments)
    env.reset(seed=0)
    env.step(np.array([0.1, 0.1]))
    frame = env.render()
    assert frame is not None and frame.shape == SHAPE


def test_decimated_samples_stand_at_the_middle_of_their_blocks():
    env = PITuningEnv(decimate=4, N=400)
    obs, _ = env.reset(seed=0)
    time = figure(env.task, VEHICLE, obs, None).axes[1].get_lines()[0].get_xdata()
    np.testing.assert_allclose(time, np.arange(400).reshape(-1, 4).mean(axis=1) * 0.001)


def visible_texts(picture):
    found = list(picture.texts)
    for axes in picture.axes:
        legend = axes.get_legend()
        found += [*axes.texts, axes._left_title, *(legend.get_texts() if legend else [])]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            found += [axis.label, *(tick.label1 for tick in ticks if tick.label1.get_visible())]
    return [text for text in found if text.get_text()]


@pytest.mark.parametrize(
    "gains",
    [None, (0.2, 0.12), (0.12, 0.2), (0.4, 0.07), (1e-3, 100), (10, 1)],
)
def test_no_words_overlap_or_leave_the_picture(gains):
    picture = figure(TASK, VEHICLE, OBS, None if gains is None else np.array(gains))
    pixels(picture)
    boxes = [(text.get_text(), text.get_window_extent()) for text in visible_texts(picture)]
    assert len(boxes) > 30
    for i, (first, box) in enumerate(boxes):
        assert 0 <= box.x0 and box.x1 <= SHAPE[1] and 0 <= box.y0 and box.y1 <= SHAPE[0], first
        for second, other in boxes[:i]:
            assert not box.overlaps(other), (first, second)


def test_environment_passes_gymnasiums_checker_with_rendering():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Gains are in physical units, as the agent must choose them.
        warnings.filterwarnings("ignore", message=".*symmetric and normalized.*")
        env = gymnasium.make("yawrate/PITuning-v0", render_mode="rgb_array").unwrapped
        check_env(env)
        env.close()


PROGRAM = """
import sys, gymnasium
def made(mode):
    env = gymnasium.make("yawrate_env:yawrate/PITuning-v0", render_mode=mode)
    env.reset(seed=0)
    return env
made("rgb_array").render()
assert "matplotlib.pyplot" not in sys.modules
sys.modules["matplotlib"].rcParams["backend"] = "TkAgg"
env = made("human")
assert env.render() is None
env.close()
"""


def test_human_mode_without_a_display_is_silent_and_frames_need_no_pyplot(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    human = PITuningEnv(render_mode="human")  # the backend without a display is Agg
    human.reset(seed=0)
    assert human.render() is None
    human.close()
    human.close()


def test_missing_matplotlib_names_the_remedy(monkeypatch):
    for module in ("rendering", "window"):
        monkeypatch.delitem(sys.modules, f"yawrate_env.env.{module}", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    env = PITuningEnv(render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(DependencyNotInstalled, match=r'pip install "yawrate\[tuners\]"'):
        env.render()


def test_vector_frames_are_those_of_the_scalar_environments():
    many = gymnasium.make_vec("yawrate/PITuning-v0", num_envs=2, render_mode="rgb_array")
    with pytest.raises(ResetNeeded):
        many.render()
    many.reset(seed=3)
    frames = many.render()
    assert isinstance(frames, tuple) and len(frames) == 2
    one = PITuningEnv(render_mode="rgb_array")
    one.reset(seed=4)
    np.testing.assert_array_equal(frames[1], one.render())
    many.step(many.action_space.sample())
    assert (many.render()[0] != frames[0]).any()  # the next episode, waiting for gains
    many.close()
    many.close()


def test_documentation_is_in_step_with_the_code(tmp_path):
    assert make_docs.main(["--check"]) == 0, "run scripts/make_docs.py"
    copy = ["--folder", str(tmp_path)]
    assert make_docs.main([*copy, "--check"]) == 1  # missing
    assert make_docs.main(copy) == 0 and make_docs.main([*copy, "--check"]) == 0
    for name in make_docs.PAGES:
        right = (tmp_path / name).read_text()
        (tmp_path / name).write_text("stale")
        assert make_docs.main([*copy, "--check"]) == 1
        (tmp_path / name).write_text(right)


def test_picture_for_the_readme_is_small_and_moves():
    from PIL import Image

    path = ROOT / "figures" / "environment.gif"
    assert path.stat().st_size <= 1.5e6
    with Image.open(path) as picture:
        assert picture.size == (1000, 640) and picture.n_frames > 10
