"""Damage that log files come with."""

from hypothesis import strategies as st
from recordings import ROOT

EXAMPLE = ROOT / "examples" / "log.csv"
LINES = EXAMPLE.read_text().splitlines()[:402]
CELLS = st.sampled_from(
    ["", "nan", "inf", "-1e999", "1e308", "1e19", "x", "-", "0x10", "1,5", "1;2", '"', "\t",
     "999999", "-0.0", "12:00:01", "2024-01-01", "true", "µ"]
)  # fmt: skip
EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("cell"), st.integers(0, 401), st.integers(0, 3), CELLS),
        st.tuples(st.just("column"), st.integers(0, 3), CELLS),
        st.tuples(st.just("drop"), st.integers(0, 401), st.integers(1, 300)),
        st.tuples(st.just("repeat"), st.integers(1, 401), st.integers(1, 50)),
        st.tuples(st.just("swap"), st.integers(0, 401), st.integers(0, 401)),
        st.tuples(st.just("cut"), st.integers(0, 12000)),
        st.tuples(st.just("insert"), st.integers(0, 12000), st.binary(min_size=1, max_size=20)),
    ),
    min_size=1,
    max_size=5,
)


def edited(edits):
    """The example's first 4 s with damage done to it."""
    lines, content = list(LINES), None
    for kind, *how in edits:
        if kind == "cell":
            row, column, text = how
            if row < len(lines):
                cells = lines[row].split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[row] = ",".join(cells)
        elif kind == "column":
            column, text = how
            for k, line in enumerate(lines[1:], 1):
                cells = line.split(",")
                cells[min(column, len(cells) - 1)] = text
                lines[k] = ",".join(cells)
        elif kind == "drop":
            del lines[how[0] : sum(how)]
        elif kind == "repeat":
            lines[how[0] : how[0]] = lines[how[0] - 1 : how[0]] * how[1]
        elif kind == "swap":
            i, j = (min(k, len(lines) - 1) for k in how)
            if lines:
                lines[i], lines[j] = lines[j], lines[i]
    content = "\n".join(lines).encode()
    for kind, *how in edits:
        if kind == "cut":
            content = content[: how[0]]
        elif kind == "insert":
            content = content[: how[0]] + how[1] + content[how[0] :]
    return content


HEADS = [b"", b"t,steer,yaw_rate,speed\n", b"PAR1", b"MATLAB 5.0 MAT-file, ", b"\xff\xfe",
         b"\x89HDF\r\n\x1a\n", b"MDF     4.10    ", b"\xef\xbb\xbf"]  # fmt: skip
