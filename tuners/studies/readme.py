"""Numbers in README.md: the table between two markers is the one in results/."""

from pathlib import Path

from yawrate_env.files import write_text

START, END = "<!-- table3:start -->", "<!-- table3:end -->"


def updated(readme: str, table: str) -> str:
    """The text with the table between the markers replaced; ``ValueError`` without markers."""
    before, start, rest = readme.partition(START)
    _, end, after = rest.partition(END)
    if not start or not end:
        raise ValueError(f"README.md lacks {START} or {END}. Put them around the table.")
    return f"{before}{START}\n{table.strip()}\n{END}{after}"


def update(readme: Path, table: Path) -> None:
    """Put the table of one file into the other."""
    write_text(readme, updated(readme.read_text(), table.read_text()))
