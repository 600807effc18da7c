"""What a release is made from: the files of the last commit, their addresses, and the notes."""

import io
import re
import subprocess
import tarfile
import tomllib
from pathlib import Path
from typing import Any

_PLACES = {"Repository": "", "Documentation": "/blob/{tag}/docs/index.md",
           "Changelog": "/blob/{tag}/CHANGELOG.md", "Issues": "/issues"}  # fmt: skip
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)\s]+)\)")


def export(repository: Path, folder: Path) -> None:
    """Write the files of the last commit, and nothing else, into a folder."""
    archive = subprocess.run(
        ["git", "archive", "HEAD"], cwd=repository, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder, filter="data")


def changed(repository: Path) -> list[str]:
    """Files that differ from the last commit, or are not in it."""
    lines = subprocess.run(
        ["git", "status", "--porcelain"], cwd=repository, check=True, capture_output=True, text=True
    ).stdout
    return [line[3:] for line in lines.splitlines()]


def notes(changelog: str, version: str) -> str:
    """The changelog's section on a version, without its heading.

    Raises
    ------
    ValueError
        If there is no section, or nothing in it.
    """
    found = re.search(
        rf"^## \[?{re.escape(version)}\]?(?: [^\n]*)?\n(.*?)(?=^## |\Z)", changelog, re.M | re.S
    )
    if found is None or not found[1].strip():
        raise ValueError(
            f"CHANGELOG.md says nothing about version {version}. Add a section "
            f"'## [{version}] - DATE' with what users notice."
        )
    return found[1].strip() + "\n"


def project(folder: Path) -> dict[str, Any]:
    """The table ``project`` of a pyproject.toml."""
    found: dict[str, Any] = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))
    return dict(found["project"])


def place(folder: Path, address: str, tag: str) -> None:
    """Write the project's addresses into exported files, as an index shows them.

    Parameters
    ----------
    folder : Path
        With pyproject.toml and README.md, which are changed.
    address, tag : str
        Of the repository, such as ``https://example.org/owner/name``, and of the release in it.

    Raises
    ------
    ValueError
        If the address is no web address.
    """
    if not re.fullmatch(r"https://[^/\s]+/\S+[^/\s]", address):
        raise ValueError(
            f"repository: {address} is no address such as https://example.org/owner/name."
        )
    urls = {name: address + rest.format(tag=tag) for name, rest in _PLACES.items()}
    with open(folder / "pyproject.toml", "a", encoding="utf-8") as file:
        file.write("\n[project.urls]\n")
        file.writelines(f'{name} = "{url}"\n' for name, url in urls.items())
    readme = folder / "README.md"
    readme.write_text(absolute(readme.read_text("utf-8"), address, tag), "utf-8")


def absolute(page: str, address: str, tag: str) -> str:
    """A page of Markdown whose links and pictures are web addresses."""

    def linked(found: re.Match[str]) -> str:
        picture, text, path = found.groups()
        kind = "raw" if picture else "blob"
        return f"{picture}[{text}]({address}/{kind}/{tag}/{path})"

    return _LINK.sub(linked, page)


def commands(page: str) -> list[str]:
    """The commands ``yawrate ...`` of a page's shell blocks that the extra ``tune`` runs.

    Left out are those whose comment, behind them or in the line above, says which other extra
    they need, and later ones that read what those write.
    """
    found, absent = [], set[str]()
    for block in re.findall(r"```sh\n(.*?)```", page, re.S):
        above = ""
        for line in block.splitlines():
            command, _, comment = line.partition("#")
            comment, above = comment + above, "" if command else comment
            words = command.split()
            if words[:1] != ["yawrate"]:
                continue
            if "needs yawrate[" in comment or absent & set(words):
                absent |= {after for word, after in zip(words, words[1:], strict=False)
                           if word in ("-o", "--out")}  # fmt: skip
                continue
            found.append(command.strip())
    return found
