"""The vehicle's environment with further open parameters, and its file with them."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import yawrate_env
from yawrate_env.plant.distributions import LogRange, Normal
from yawrate_env.vehicle.task import Prior
from yawrate_env.vehicle.vehicle_file import VehicleFileError, example, read

SETTINGS = {"N": 500, "C_f": (1e5, 1.5e5), "dead_time": (0, 0.04)}
MORE = SETTINGS | {"visible": "context", "sensor_lag": {"log": [0.001, 0.02]}}


def make(**settings):
    return gymnasium.make(yawrate_env.ENV_ID, **settings)


def test_the_info_shows_open_parameters_and_reset_pins_them():
    env = make(**SETTINGS)
    env.reset(seed=0)
    *_, info = env.step(np.array([0.2, 0.2]))
    assert 1e5 <= info["C_f"] <= 1.5e5 and 0 <= info["dead_time"] <= 0.04
    assert "J_z" not in info
    late, pinned = env.reset(seed=0, options={"dead_time": 0.3})[0], {"dead_time": 0.3}
    *_, info = env.step(np.array([0.2, 0.2]))
    assert info["dead_time"] == 0.3 and pinned == {"dead_time": 0.3}
    assert not env.observation_space.contains(late[:1])
    with pytest.raises(ValueError, match="dead_time = 0.6 must be .* at most 0.5. Use SI units."):
        env.reset(options={"dead_time": 0.6})
    with pytest.raises(ValueError, match="'J_z' is unknown. Choose one of .*C_f, dead_time"):
        env.reset(options={"J_z": 2000.0})


def test_rows_of_the_context_are_as_before_and_then_the_open_parameters():
    env = make(**MORE)
    obs, _ = env.reset(seed=3)
    *_, info = env.step(np.array([0.2, 0.2]))
    names = ("v_x", "mu_s", "M_delta", "C_f", "dead_time", "sensor_lag")
    np.testing.assert_allclose(obs[2:, 0], [info[name] for name in names], rtol=1e-6)
    assert env.observation_space.contains(obs)
    assert make(N=500, visible="context").observation_space.shape == (5, 500)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space:UserWarning")
def test_the_checker_of_gymnasium_has_no_objection():
    check_env(make(**MORE).unwrapped, skip_render_check=True)


def test_batches_repeat_single_environments_bit_for_bit():
    envs = gymnasium.make_vec(yawrate_env.ENV_ID, num_envs=3, **MORE)
    obs, _ = envs.reset(seed=[5, 6, 7])
    _, reward, *_, info = envs.step(np.full((3, 2), 0.2))
    for i, seed in enumerate((5, 6, 7)):
        env = make(**MORE)
        np.testing.assert_array_equal(env.reset(seed=seed)[0], obs[i])
        assert env.step(np.full(2, 0.2))[1] == reward[i]
    assert set(info["final_info"]) >= {"C_f", "dead_time", "sensor_lag"}


def test_pictures_show_the_loop_behind_the_dead_time():
    env = make(**MORE, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([0.2, 0.2]))
    assert env.render().shape[2] == 3


def test_tyres_that_saturate_take_them_too():
    env = gymnasium.make(yawrate_env.NONLINEAR_ID, N=500, C_f=(1e5, 1.5e5))
    env.reset(seed=0)
    assert "C_f" in env.step(np.array([0.2, 0.2]))[-1]
    with pytest.raises(ValueError, match="dead_time must be 0"):
        gymnasium.make(yawrate_env.NONLINEAR_ID, N=500, dead_time=(0, 0.01))


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"C_f": (1.0, 2.0)}, "C_f = 1 must be .* at least 124.9"),
        ({"xi": {"beta": [1, 2]}}, "xi = .* is no prior"),
    ],
)
def test_mistakes_are_one_line(settings, message):
    with pytest.raises(ValueError, match=rf"\A[^\n]*{message}[^\n]*\Z"):
        make(**settings)


@pytest.mark.parametrize("name", ["colour", "M_0"])
def test_arguments_that_there_are_not_are_named_with_those_that_may_be_open(name):
    with pytest.raises(TypeError, match=rf"unexpected keyword argument '{name}'.* J_z, l_f"):
        make(**{name: 3.0})


@pytest.fixture
def edited(tmp_path):
    """The example file with some text replaced."""

    def edit(old, new):
        assert old in example()
        path = tmp_path / "car.toml"
        path.write_text(example().replace(old, new, 1))
        return path

    return edit


def test_a_file_has_priors_over_any_parameter(edited):
    path = edited("# C_f = [100e3, 150e3]", "\n".join([
        "C_f = [100e3, 150e3]", "C_r = {log = [1e5, 2e5]}", "J_z = {normal = [2400, 100]}",
        "xi = 0.8", "dead_time = [0, 0.04]",
    ]))  # fmt: skip
    assert read(path).prior == Prior(
        C_f=(1e5, 1.5e5), C_r=LogRange(1e5, 2e5), J_z=Normal(2400, 100), xi=0.8,
        dead_time=(0, 0.04),
    )  # fmt: skip
    assert read(edited("[0.3, 1.1]", "{log = [0.3, 1.1]}")).prior.mu_s == LogRange(0.3, 1.1)


def test_a_file_may_leave_delays_out_or_have_them(edited):
    assert read(edited("dead_time = 0.0 ", "# ")).vehicle.dead_time == 0.0
    assert read(edited("dead_time = 0.0 ", "dead_time = 0.012 ")).vehicle.dead_time == 0.012


@pytest.mark.parametrize(
    "new, message",
    [
        ("C_f = [1.0, 2.0]", r"\[prior\] C_f = 1 must be .* at least 124.9"),
        ("C_f = {beta = [1, 2]}", r"\[prior\] C_f = .* is no prior. .*log = .*normal = "),
        ("C_f = {log = [1, 2, 3]}", "prior.C_f"),
        ("C_f = true", "prior.C_f"),
        ("C_x = [1, 2]", "unknown.*C_x.*prior"),
        ("M_0 = [1500, 2000]", "unknown.*M_0.*prior"),
        ("dead_time = [0, 0.9]", r"\[prior\] dead_time = 0.9 .* at most 0.5"),
    ],
)
def test_mistakes_in_a_file_name_file_section_and_key(edited, new, message):
    with pytest.raises(VehicleFileError, match=rf"\A[^\n]*car.toml[^\n]*{message}[^\n]*\Z"):
        read(edited("# C_f = [100e3, 150e3]", new))
