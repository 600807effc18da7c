"""Code, commands and links on the pages of the documentation.

Python runs, page by page from top to bottom; the start pages' commands run; of all other commands
program, options, targets and extras exist; links lead to files and headings.
"""

import importlib
import importlib.util
import inspect
import os
import re
import shlex
import shutil
import sys
import tomllib
from functools import cache

import click
import pytest
from command import TRUSTED, UNTRUSTED, call
from recordings import ROOT

from tuners.cli import main
from yawrate_env.plant.entry import from_toml

DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("**/*.md"), *ROOT.glob("results/*.md"), ROOT / "README.md",
                ROOT / "CONTRIBUTING.md"])  # fmt: skip
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
LINK = re.compile(r"\]\(((?!\w+:)[^)\s]*)\)")

SHELLS = "sh", "bash", "shell"
SMALLER = {
    "plants": [
        ("tuners.train(plant)", "tuners.train(plant, episodes=300, calibration=128)"),
        (
            "tuners.train(slow, workers=2",
            "tuners.train(slow, episodes=60, calibration=50, workers=1",
        ),
        *(
            (f"{stage}), plant)", f"{stage}), plant, episodes=60, calibration=0)")
            for stage in ("Regressor()", "Settings(network)", "Settings()")
        ),
        ("episodes=8000", "episodes=256"),
    ],
    "agents": [(".learn(2000)", ".learn(600)"), ("20_000", "2_000")],
    "datasets": [
        ("1_000_000", "300"),
        ("100_000", "30"),
        ("recipe)\n", "recipe, calibration=128)\n"),
    ],
}
"""What would take minutes, with fewer episodes."""


def blocks(page, *languages):
    return [text for language, text in BLOCK.findall(page.read_text()) if language in languages]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working folder with the examples."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


def run(page, folder):
    """Run a page's Python; a block that begins with a file's name is written there."""
    shared = {"__name__": page.stem}
    for block in blocks(page, "python"):
        if named := re.match(r"# (\w+\.py)\n", block):
            (folder / named[1]).write_text(block)
            continue
        for long, short in SMALLER.get(page.stem, []):
            block = block.replace(long, short)
        exec(compile(block, str(page), "exec"), shared)


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if blocks(page, "python") and page.stem not in SMALLER],
    ids=lambda page: page.stem,
)
def test_python_runs(page, folder):
    run(page, folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALLER)
def test_python_that_trains_runs(name, folder):
    run(DOCS / f"{name}.md", folder)


def test_plants_files_are_read(folder):
    page = DOCS / "plants.md"
    (folder / "my_plant.py").write_text(blocks(page, "python")[0])
    for i, text in enumerate(blocks(page, "toml")):
        file = folder / f"{i}.toml"
        file.write_text(text)
        assert from_toml(file).prior


@cache
def script(name):
    """The command of a file in scripts/."""
    spec = importlib.util.spec_from_file_location(f"script_{name}", ROOT / "scripts" / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main


def parsed(command, words):
    """Refuse options that a command does not have."""
    context = click.Context(command)
    command.make_parser(context).parse_args(list(words))


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page, *SHELLS)], ids=lambda page: page.stem
)
def test_programs_options_targets_and_extras_exist(page):
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for line in "\n".join(blocks(page, *SHELLS)).replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["yawrate"]:
            parsed(main.get_command(click.Context(main), words[1]), words[2:])
        elif words[:1] == ["python"] and words[1].endswith(".py"):
            parsed(script(os.path.basename(words[1])), words[2:])
        elif words[:1] == ["make"]:
            assert words[1] in targets, line
        elif words[:2] == ["pip", "install"]:
            for extra in re.findall(r"\[([\w,]+)\]", line):
                assert set(extra.split(",")) <= set(extras["optional-dependencies"]), line


SHELL = [page for page in PAGES if page.parent.name == "start" and blocks(page, "sh")]


@pytest.mark.slow
@pytest.mark.parametrize("page", SHELL, ids=lambda page: page.stem)
def test_commands_run(page, folder):
    for block in blocks(page, "sh"):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words[:2] == ["yawrate", "train"]:
                words += ["--episodes", "200"]
            if words[:1] == ["yawrate"]:
                code, _, err = call(*words[1:])
                assert code in (TRUSTED, UNTRUSTED), (line, err)


def test_the_output_that_the_engineers_page_shows_is_the_commands(folder):
    (shown,) = re.findall(r"```\n(log\.csv.*?)```", (DOCS / "start" / "engineer.md").read_text(),
                          re.DOTALL)  # fmt: skip
    assert call("tune", "examples/log.csv")[1].strip() == shown.strip()


def anchors(page):
    """Of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page):
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)
    for link in LINK.findall(text):
        file, _, heading = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        on_the_site = DOCS / "results" / ("index.md" if target.name == "README.md" else target.name)
        assert target.exists() or on_the_site.exists(), link
        if heading:
            assert heading in anchors(target if target.exists() else on_the_site), link


PACKAGES = "tuners", "tuners.data", "tuners.export", "tuners.logs", "tuners.pidtune", \
    "yawrate_env.plant", "yawrate_env.plants"  # fmt: skip


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_name_every_argument_of_public_names(package):
    module = importlib.import_module(package)
    for name in module.__all__:
        public = getattr(module, name)
        if not callable(public) or isinstance(public, type) and issubclass(public, Exception):
            continue
        said = re.findall(r"\w+", inspect.getdoc(public) or "")
        missing = set(inspect.signature(public).parameters) - {"args", "kwargs"} - set(said)
        assert said and not missing, name


def test_the_reference_lists_what_tuners_offers():
    page = (DOCS / "reference" / "index.md").read_text()
    listed = set(re.findall(r"`tuners\.(\w+) <", page))
    assert listed == set(importlib.import_module("tuners").__all__)


def test_the_methods_ten_pictures_are_drawn_by_commands():
    sections = re.split(r"^## \d+\. ", (DOCS / "method.md").read_text(), flags=re.MULTILINE)[1:]
    assert len(sections) == 10
    for section in sections:
        assert len(re.findall(r"!\[[^\]]+\]\(\.\./figures/", section)) == 1
        for file in re.findall(r"python scripts/(\w+\.py)", section):
            assert (ROOT / "scripts" / file).is_file()
