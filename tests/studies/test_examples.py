"""The examples do what they say, those of the README among them; its links lead somewhere."""

import json
import re
import sys

import gymnasium
import numpy as np
import pytest
import torch
import yaml
from recordings import ROOT
from stable_baselines3 import SAC

import yawrate_env
from tuners.agents.sb3_vec_env import Sb3VecEnv
from yawrate_env.plant.reward import distance

EXAMPLES = ROOT / "examples"
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_the_readmes_examples_run(block):
    exec(compile(block, "README.md", "exec"), {})


def test_links_lead_somewhere_and_no_page_names_a_machines_path():
    links = re.findall(r"\]\(((?!http)[^)#]+)\)", README)
    assert links and all((ROOT / path).exists() for path in links)
    for file in (*ROOT.glob("*.md"), *ROOT.glob("results/*.md"), *ROOT.glob("docs/*.md")):
        assert not re.search(r"/(work|tmp|root|home)/", file.read_text()), file


@pytest.fixture
def cleanrl(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    before = torch.get_num_threads()
    import cleanrl_sac

    yield cleanrl_sac
    torch.set_num_threads(before)
    del sys.modules["cleanrl_sac"]


def notebook():
    return json.loads((EXAMPLES / "quickstart.ipynb").read_text())


def cells(kind):
    found = (cell for cell in notebook()["cells"] if cell["cell_type"] == kind)
    return ["".join(cell["source"]) for cell in found]


def test_the_notebook_runs(capsys):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    names = {}
    try:
        for cell in cells("code"):
            exec(compile(cell, "quickstart.ipynb", "exec"), names)
        assert len(plt.get_fignums()) == 2
    finally:
        plt.close("all")
    assert not names["stable"].size - names["stable"].sum()
    nominal, ts_ff = (names["results"][name] for name in ("nominal", "ts-ff"))
    assert ts_ff[0].std() < 0.1 * nominal[0].std()
    # What is stored is what comes out now, up to the last digits of other machines.
    printed = capsys.readouterr().out
    for line in ("observation (2, 10000) float32   info {}", "phase margin 53.77°"):
        assert line in printed


def test_the_notebook_is_stored_with_its_outputs_and_small():
    codes = [cell for cell in notebook()["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in codes] == list(range(1, len(codes) + 1))
    outputs = [output for cell in codes for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} == {"stream", "display_data"}
    assert "phase margin 53.77°" in "".join("".join(o.get("text", "")) for o in outputs)
    assert (EXAMPLES / "quickstart.ipynb").stat().st_size < 150_000
    text = " ".join(cells("markdown")).replace("`", " ").split()
    named = [part.rstrip(".;:,") for part in text if part.startswith(("examples/", "docs/"))]
    assert len(named) == 3 and all((ROOT / name).exists() for name in named)


@pytest.mark.slow
def test_the_single_file_agent_becomes_good(cleanrl, tmp_path):
    args = cleanrl.Args(total_episodes=640, log=str(tmp_path))
    info = cleanrl.evaluate(cleanrl.train(args), cleanrl.Args(eval_episodes=300))
    assert list(tmp_path.rglob("events.out.tfevents.*"))
    assert len(info["phase_margin"]) == 300 and info["stable"].all()
    metrics = np.stack([info["phase_margin"], info["crossover"]], axis=1)
    error = distance((metrics - [60.0, 1.5]) / [10.0, 0.25])
    # The fixed controller's is 0.95; 5000 episodes bring 0.03.
    assert error.mean() < 0.75


def test_the_single_file_agent_repeats_itself(cleanrl):
    args = cleanrl.Args(total_episodes=96, learning_starts=64, hidden=16)
    one, other = (cleanrl.train(args).parameters() for _ in range(2))
    for a, b in zip(one, other, strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_the_single_file_agents_density_is_that_of_its_actions(cleanrl):
    torch.manual_seed(0)
    actor = cleanrl.Actor(3, 1, 8)
    obs = torch.zeros(1, 3)
    mean, log_std = actor.net(obs)[0].tolist()
    action, log_prob = actor(obs)
    a = action.item()
    normal = -0.5 * ((np.arctanh(a) - mean) / np.exp(log_std)) ** 2
    expected = normal - log_std - 0.5 * np.log(2 * np.pi) - np.log(1 - a**2)
    assert log_prob.item() == pytest.approx(expected, abs=1e-5)
    assert actor.best(obs).item() == pytest.approx(np.tanh(mean), abs=1e-6)


def test_the_zoos_hyperparameters_are_stable_baselines3s():
    with open(EXAMPLES / "rl_zoo3" / "sac.yml") as file:
        settings = yaml.safe_load(file)[yawrate_env.FEATURES_ID]
    # What the Zoo keeps for itself, or translates: "lin_1e-3" falls linearly.
    steps, count, rate = (settings.pop(k) for k in ("n_timesteps", "n_envs", "learning_rate"))
    assert (steps, count, rate) == (20_000, 16, "lin_1e-3")
    settings["policy_kwargs"] = eval(settings["policy_kwargs"])
    env = Sb3VecEnv(gymnasium.make_vec(yawrate_env.FEATURES_ID, num_envs=2, Ts=0.01, N=300))
    agent = SAC(env=env, device="cpu", **settings)
    assert agent.target_entropy == -4.0 and agent.gamma == 0.0
