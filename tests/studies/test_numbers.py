"""Numbers in README.md and docs/ come from stored results; those that do not yet are counted."""

import json

import pytest
from recordings import ROOT

from studies.numbers import unanchored, wrong
from studies.plants import described
from studies.readme import updated

RESULTS = ROOT / "results"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

STANDING = {
    "README.md": 16,
    "accuracy.md": 19,
    "agents.md": 11,
    "app.md": 1,
    "cli.md": 29,
    "controllers.md": 33,
    "datasets.md": 17,
    "deviations.md": 23,
    "direct.md": 17,
    "environment.md": 38,
    "gallery.md": 0,
    "matlab.md": 32,
    "method.md": 14,
    "nonlinear.md": 19,
    "plants.md": 46,
    "recalibration.md": 13,
    "recalibration_environment.md": 41,
    "release.md": 8,
    "trust.md": 31,
    "tuners.md": 4,
}
"""Numbers without an anchor: definitions, settings, section numbers, and measured ones that still
wait for theirs.  A new number gets an anchor, or stands in a generated block; these may only fall.
A page that is not here has none.
"""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_anchored_numbers_are_the_stored_ones(page):
    assert wrong(page.read_text(), RESULTS) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_number_comes_without_its_source(page):
    assert len(unanchored(page.read_text())) <= STANDING.get(page.name, 0)


def test_an_anchor_is_compared_with_what_is_stored(tmp_path):
    rows = [{"tuner": "gb", "n": 5, "rms": 0.009214}, {"tuner": "bb", "n": 5, "share": 0.977}]
    (tmp_path / "a.json").write_text(json.dumps({"rows": rows, "episodes": 20_000}))
    right = [
        "0.0092°<!-- a.json: rows/0/rms -->", "0.00921<!-- a.json: rows/tuner=gb/rms -->",
        "97.7 %<!-- a.json: rows/tuner=bb&n=5/share * 100 -->",
        "98 %<!-- a.json: rows/1/share * 100 -->",
        "20 000<!-- a.json: episodes -->", "20000 episodes<!-- a.json: episodes -->",
    ]  # fmt: skip
    for text in right:
        assert wrong(f"It is {text}, so.", tmp_path) == [], text
        assert unanchored(f"It is {text}, so.") == []
    for text in ("0.0093°<!-- a.json: rows/0/rms -->", "97 %<!-- a.json: rows/1/share * 100 -->"):
        (line,) = wrong(f"It is {text}", tmp_path)
        assert "a.json" in line
    with pytest.raises(KeyError):
        wrong("1<!-- a.json: nothing -->", tmp_path)


def test_code_links_and_generated_blocks_need_no_anchor():
    page = "`n=5` of [this](a/v2.md) <!-- t:start -->\n| 7 |\n<!-- t:end --> are 31 and 2.5°."
    assert unanchored(page) == ["31", "2.5"]
    assert unanchored("```sh\nmake 3\n```\nts-ff-1khz, PITuning-v0, `a 4`") == []


def test_the_plants_tables_are_the_stored_ones():
    parts = json.loads((RESULTS / "plants.json").read_text())
    page = (ROOT / "docs" / "plants.md").read_text()
    for name, part in parts.items():
        assert updated(page, name, described(part)) == page, name
