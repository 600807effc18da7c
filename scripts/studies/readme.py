"""Tables in pages for people: what stands between two markers is the table in results/."""

from pathlib import Path

from yawrate_env.files import write_text


def updated(readme: str, name: str, table: str) -> str:
    """The text with a table between its markers replaced; ``ValueError`` without markers."""
    start_marker, end_marker = f"<!-- {name}:start -->", f"<!-- {name}:end -->"
    before, start, rest = readme.partition(start_marker)
    _, end, after = rest.partition(end_marker)
    if not start or not end:
        raise ValueError(
            f"The page lacks {start_marker} or {end_marker}. Put them around the table."
        )
    return f"{before}{start_marker}\n{table.strip()}\n{end_marker}{after}"


def update(readme: Path, table: Path) -> None:
    """Put the table of one file into the other, between the markers of its name."""
    write_text(readme, updated(readme.read_text(), table.stem, table.read_text()))
