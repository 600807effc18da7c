"""The notebook for the paper's reader: what it prints is what it is stored with."""

import json
import re

import pytest
from recordings import ROOT

from studies.table3 import PAPER

NOTEBOOK = ROOT / "examples" / "paper.ipynb"
ROW = re.compile(r"(.+?)  +(\d\d\.\d\d) ± (\d\.\d{3})  +(\d\.\d{3}) ± (\d\.\d{4})")


def codes():
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def rows(text):
    return {row[0]: tuple(map(float, row[1:])) for row in ROW.findall(text)}


def stored():
    return rows("".join("".join(o["text"]) for cell in codes() for o in cell["outputs"]))


def test_the_papers_rows_are_those_of_its_table():
    found = stored()
    for name, of in (("gray box", "gb"), ("TS-FF", "ts-ff"), ("TS-GBM", "ts-gbm")):
        margin, crossover = PAPER[of]["phase_margin"], PAPER[of]["crossover"]
        assert found[f"paper, {name}"] == pytest.approx((*margin, *crossover), abs=6e-4)
    assert NOTEBOOK.stat().st_size < 20_000


@pytest.mark.slow
def test_the_notebook_prints_what_it_is_stored_with(capsys):
    names = {}
    for cell in codes():
        exec(compile("".join(cell["source"]), NOTEBOOK.name, "exec"), names)
    found = rows(capsys.readouterr().out)
    assert len(found) == 6 and found == stored()
