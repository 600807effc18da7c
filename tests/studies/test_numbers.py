"""Every number in README.md and docs/ has a source, and is what the source says."""

import json
import math
import re

import pytest
from recordings import ROOT

from studies.numbers import unanchored, wrong
from studies.plants import described
from studies.readme import updated
from studies.sources import value_of

RESULTS = ROOT / "results"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def ids(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_anchored_numbers_are_their_sources(page):
    assert wrong(page.read_text(), ROOT) == []


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_no_number_comes_without_its_source(page):
    assert unanchored(page.read_text()) == [], "see scripts/studies/numbers.py"


@pytest.fixture
def stored(tmp_path):
    """A project with one file of results."""
    rows = [{"tuner": "gb", "n": 5, "rms": 0.009214}, {"tuner": "bb", "n": 5, "share": 0.977}]
    found = {"rows": rows, "episodes": 20_000, "return": -43.3, "small": 2.5e-8}
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "a.json").write_text(json.dumps(found))
    return tmp_path


RIGHT = [
    "0.0092°<!-- a.json: rows/0/rms -->", "0.00921<!-- a.json: rows/tuner=gb/rms -->",
    "97.7 %<!-- a.json: rows/tuner=bb&n=5/share * 100 -->",
    "98 %<!-- a.json: rows/1/share * 100 -->",
    "20 000<!-- a.json: episodes -->", "20000 episodes<!-- a.json: episodes -->",
    "−43<!-- a.json: return -->", "-43.3<!-- a.json: return -->", "2.5e-8<!-- a.json: small -->",
    "106 times<!-- a.json: rows/1/share / rows/0/rms -->", "2<!-- a.json: rows/# -->",
]  # fmt: skip
WRONG = [
    "0.0093°<!-- a.json: rows/0/rms -->", "97 %<!-- a.json: rows/1/share * 100 -->",
    "43<!-- a.json: return -->", "-43.2<!-- a.json: return -->", "4e-8<!-- a.json: small -->",
    "21 000<!-- a.json: episodes -->", "107 times<!-- a.json: rows/1/share / rows/0/rms -->",
    "0.10<!-- code: tuners.trust.intervals:LEVEL -->",
]  # fmt: skip


@pytest.mark.parametrize("text", RIGHT)
def test_a_number_that_is_its_source_passes(text, stored):
    assert wrong(f"It is {text}, so.", stored) == []
    assert unanchored(f"It is {text}, so.") == []


@pytest.mark.parametrize("text", WRONG)
def test_a_number_that_is_not_its_source_is_found(text, stored):
    (line,) = wrong(f"It is {text}, so.", stored)
    assert text.split(" -->")[0].split("<!-- ")[1] in line


def test_sources_in_the_code(stored):
    for source, value in {
        "code: tuners.trust.intervals:LEVEL * 100": 90,
        "code: yawrate_env.vehicle.task:Experiment(amplitude) * degrees": 1,
        "1 / code: yawrate_env.vehicle.task:Experiment(Ts)": 1000,
        "code: yawrate_env.vehicle.task:Task(target)/crossover": 1.5,
        "code: yawrate_env.vehicle.task:Prior(mu_s)/1": 1.1,
        "code: yawrate_env.vehicle.yaw_rate:METRICS/phase_margin [deg]/error * 2": 3,
        "code: yawrate_env.env.yaw_rate_env:PITuningEnv(N)": 10_000,
        "code: math:inf": math.inf,
    }.items():
        assert value_of(source, stored) == pytest.approx(value), source


@pytest.mark.parametrize(
    "source",
    ["a.json: nothing", "a.json: rows/n=5/n", "code: tuners.trust.intervals:NOTHING",
     "code: tuners.trust.intervals:LEVEL + 1", "code: open('x')", "b.json: rows", "rows/0"],
)  # fmt: skip
def test_a_source_that_leads_nowhere_is_refused(source, stored):
    with pytest.raises((LookupError, ValueError, AttributeError, OSError, TypeError)):
        value_of(source, stored)


MEASURED = [
    "31 and 2.5°", "98 %", "-4.8", "±1°", "1500 others", "10 000 samples", "0.987/0.999",
    "`98 %`", "`0.0093°`", "`1500`", "`30 dB, 10 s`", "`3 to 5 %`",
    "$98$ %", r"$98\,\%$", "$e = 0.25$", "$rms < 12$",
    "(3.8 times)", "(of 1500 episodes, 2000)", "(Episodes 2000)", "(PRBS, 2000)",
    "Tuners, 2010 of them",
    "figures of 4 to 8 %", "eq. 98", "step of 5°", "a step 5 °", "section 98", "Python 4 times",
    "[-1, 2]", "[0, 0.5]", "2 DOF", "3DOF", "in 5 steps", "20. That", "ROS 3", "30dB", "x-0.5",
    "12-fold", "1e-8", "30 Hz<!-- no source -->", "<!-- a.json: rows --> 7",
]  # fmt: skip


@pytest.mark.parametrize("text", MEASURED)
def test_no_pattern_hides_a_measured_number(text):
    assert unanchored(f"It is {text}, so.") != [], text
    assert unanchored(f"Before.\n{text} it is, so.") != [], text


CLAIMLESS = [
    "`n=5` of [this](a/v2.md)", "<!-- t:start -->\n| 7 |\n<!-- t:end -->", "```sh\nmake 3\n```",
    "`ts-ff-1khz`, PITuning-v0, `a 4`, x2, H2, M₀", "eq. (13) and eqs. (4), (5)", "figures 4 to 8",
    "(Skogestad, 2003)", "(Gu et al. 2016)", "(Hägglund, 2004)",
    "(Grimholt and Skogestad, 2018; and more)",
    "a 2DOF", "Python 3.11 to 3.14", "MDF 3\nand 4", "actions in [-1, 1]²", "$kp (1 + 1/(Ti s))$",
]  # fmt: skip


@pytest.mark.parametrize("text", CLAIMLESS)
def test_code_formulas_names_and_references_need_no_source(text):
    assert unanchored(text) == []


def test_numerals_of_lists_and_headings_follow_each_other():
    assert unanchored("## 1. A\n\n1. one\n2. two\n\n## 2. B\n") == []
    assert unanchored("1. one\n3. three\n") == ["3"]
    assert unanchored("1. one\n2. two\n   more\n3. three\n") == []
    assert unanchored("## 1. A\n\n## 2. B\n") == []
    assert unanchored("Of all were\n20. That") == ["20"]


def test_indices_of_rows_follow_each_other():
    assert unanchored("| 0 | a |\n| 1, 2 | b |\n| 3 | c |\n\n| 0 | d |\n") == []
    assert unanchored("| 0 | 98 % |\n| 2 | 5 |\n") == ["98", "2", "5"]
    assert unanchored("| 7 | a |\n| 1 | a |\n") == ["7", "1"]


WRITTEN = {
    "README.md": {"table3"},
    "accuracy.md": {"ratios", "robustness"},
    "cli.md": {"statuses", "hunt"},
    "gallery.md": {"gallery"},
    "matlab.md": {"matlab"},
    "nonlinear.md": {"nonlinear"},
    "plants.md": {"channels", "corners", "dc_motor", "pendulum", "process_plants", "two_tanks"},
    "release.md": {"installed"},
}
"""Blocks that a program writes; `test_pages`, `make_docs.py --check` and the test below hold them
against what is stored, but for gallery and release, which have no other store."""


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_no_block_is_a_programs_by_its_markers_alone(page):
    found = set(re.findall(r"<!-- ([\w-]+):start -->", page.read_text()))
    assert found == WRITTEN.get(ids(page).removeprefix("docs/"), set())


def test_the_plants_tables_are_the_stored_ones():
    parts = json.loads((RESULTS / "plants.json").read_text())
    page = (ROOT / "docs" / "plants.md").read_text()
    for name, part in parts.items():
        assert updated(page, name, described(part)) == page, name
