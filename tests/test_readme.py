"""What the README shows works, and its table is the one in results/."""

import re
from pathlib import Path

import pytest

from studies.readme import updated

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_examples_run(block):
    exec(compile(block, "README.md", "exec"), {})


@pytest.mark.parametrize("name", ["table3", "ratios"])
def test_the_tables_are_those_in_results(name):
    table = (ROOT / "results" / f"{name}.md").read_text()
    assert README == updated(README, name, table)


def test_a_table_is_replaced_and_nothing_else():
    before = "a\n<!-- t:start -->\nold\n<!-- t:end -->\nb\n"
    assert updated(before, "t", "| new |\n") == before.replace("old", "| new |")


def test_markers_are_needed():
    with pytest.raises(ValueError, match="table3:start"):
        updated("no markers", "table3", "| new |")


@pytest.mark.parametrize("path", re.findall(r"\]\(((?!http)[^)#]+)\)", README))
def test_links_lead_somewhere(path):
    assert (ROOT / path).exists()


def test_no_machine_path_is_mentioned_anywhere():
    tracked = [*ROOT.glob("*.md"), *ROOT.glob("results/*.md"), *ROOT.glob("docs/*.md")]
    for file in tracked:
        assert not re.search(r"/(work|tmp|root|home)/", file.read_text()), file
