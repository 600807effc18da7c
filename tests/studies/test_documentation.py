"""The code on the pages of the documentation runs, page by page from top to bottom."""

import os
import re
import shlex
import shutil

import pytest
from command import TRUSTED, UNTRUSTED, call
from recordings import ROOT

DOCS = ROOT / "docs"
ELSEWHERE = {"plants", "datasets"}  # they train for minutes; their plants have tests of their own
PAGES = sorted(
    page
    for page in DOCS.glob("**/*.md")
    if "```python" in page.read_text() and page.stem not in ELSEWHERE
)
SHELL = sorted(page for page in DOCS.glob("start/*.md") if "\nyawrate " in page.read_text())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working folder with the examples."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_runs(page, folder):
    shared = {"__name__": page.stem}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        exec(compile(block, str(page), "exec"), shared)


@pytest.mark.slow
@pytest.mark.parametrize("page", SHELL, ids=lambda page: page.stem)
def test_commands_run(page, folder):
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["yawrate"]:
                code, _, err = call(*words[1:])
                assert code in (TRUSTED, UNTRUSTED), (line, err)
    assert os.listdir(folder)
