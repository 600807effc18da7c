"""What a release is made from."""

import subprocess
import tomllib

import pytest
from recordings import ROOT

from releases import source

ADDRESS = "https://example.org/owner/name"
CHANGES = """# Changelog

## [0.3.0] - Unreleased

### Added

- Three.

## [0.2.0] - 2026-01-01

- Two.

## 0.1.0

## [0.0.1]
- Zero."""


def test_notes_are_the_versions_section():
    assert source.notes(CHANGES, "0.3.0") == "### Added\n\n- Three.\n"
    assert source.notes(CHANGES, "0.2.0") == "- Two.\n"
    assert source.notes(CHANGES, "0.0.1") == "- Zero.\n"


@pytest.mark.parametrize("version", ["0.1.0", "0.2", "1.0.0", "0x3.0"])
def test_a_version_without_notes_is_refused(version):
    with pytest.raises(ValueError, match=version):
        source.notes(CHANGES, version)


def test_links_become_addresses():
    page = (
        "[a](docs/a.md) ![b](figures/b.png) [c](https://c.org) [d](#d) "
        "[`e`](results/README.md#part) [f](mailto:f@f.org)"
    )
    assert source.absolute(page, ADDRESS, "v1") == (
        f"[a]({ADDRESS}/blob/v1/docs/a.md) ![b]({ADDRESS}/raw/v1/figures/b.png) "
        f"[c](https://c.org) [d](#d) [`e`]({ADDRESS}/blob/v1/results/README.md#part) "
        "[f](mailto:f@f.org)"
    )


def test_readmes_links_lead_to_files():
    text = source.absolute((ROOT / "README.md").read_text("utf-8"), ADDRESS, "v1")
    paths = [part.split(")")[0] for part in text.split(f"({ADDRESS}/")[1:]]
    assert len(paths) > 10
    for path in paths:
        assert (ROOT / path.split("/", 2)[2].partition("#")[0]).exists(), path


def test_addresses_are_the_projects(tmp_path):
    for name in ("pyproject.toml", "README.md"):
        (tmp_path / name).write_text((ROOT / name).read_text("utf-8"), "utf-8")
    source.place(tmp_path, ADDRESS, "v1")
    urls = source.project(tmp_path)["urls"]
    assert urls["Repository"] == ADDRESS and len(urls) == 4
    assert all(url.startswith(ADDRESS) for url in urls.values())


@pytest.mark.parametrize("address", ["", "example.org/a/b", "http://a.org/b", "https://a.org"])
def test_other_addresses_are_refused(tmp_path, address):
    with pytest.raises(ValueError, match="repository"):
        source.place(tmp_path, address, "v1")


def test_commands_that_need_another_extra_are_left_out():
    page = (
        "```sh\nyawrate init -o a.toml  # words\n"
        "yawrate train -o a.tuner  # needs yawrate[tuners]\n"
        "yawrate tune log.csv --tuner a.tuner\npip install x\n```\nyawrate no\n"
        "```sh\n# a minute; needs yawrate[tuners]\nyawrate train -o b.tuner\n"
        "yawrate tune log.csv --tuner b.tuner\n```\n"
        "```sh\nyawrate tune 'my log.csv'\n```"
    )
    assert source.commands(page) == ["yawrate init -o a.toml", "yawrate tune 'my log.csv'"]


def test_engineers_have_commands_in_the_readme():
    assert source.commands((ROOT / "README.md").read_text("utf-8"))


def test_only_what_is_committed_is_exported(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    run = ["git", "-c", "user.name=a", "-c", "user.email=a@a.org"]
    (here / "kept.txt").write_text("first\n")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run([*run, *words], cwd=here, check=True)
    assert source.changed(here) == []
    (here / "kept.txt").write_text("second\n")
    (here / "new.txt").write_text("\n")
    source.export(here, there)
    assert [path.name for path in there.iterdir()] == ["kept.txt"]
    assert (there / "kept.txt").read_text() == "first\n"
    assert sorted(source.changed(here)) == ["kept.txt", "new.txt"]


def test_every_python_that_is_claimed_is_resolved_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    named = {c.rpartition(" ")[2] for c in project["classifiers"] if ":: 3." in c}
    script = (ROOT / "scripts" / "release.py").read_text("utf-8")
    assert named and all(f'"{version}"' in script for version in named)
    assert project["requires-python"] == f">={min(named)}"
