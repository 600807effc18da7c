"""What the README shows works, and its table is the one in results/."""

import re
from pathlib import Path

import pytest

from tuners.studies.readme import END, START, updated

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_examples_run(block):
    exec(compile(block, "README.md", "exec"), {})


def test_the_table_is_the_one_in_results():
    table = (ROOT / "results" / "table3.md").read_text()
    assert README == updated(README, table)


def test_a_table_is_replaced_and_nothing_else():
    before = f"a\n{START}\nold\n{END}\nb\n"
    assert updated(before, "| new |\n") == f"a\n{START}\n| new |\n{END}\nb\n"


def test_markers_are_needed():
    with pytest.raises(ValueError, match="table3:start"):
        updated("no markers", "| new |")


@pytest.mark.parametrize("path", re.findall(r"\]\(((?!http)[^)#]+)\)", README))
def test_links_lead_somewhere(path):
    assert (ROOT / path).exists()


def test_no_machine_path_is_mentioned_anywhere():
    tracked = [*ROOT.glob("*.md"), *ROOT.glob("results/*.md"), *ROOT.glob("docs/*.md")]
    for file in tracked:
        assert not re.search(r"/(work|tmp|root|home)/", file.read_text()), file
