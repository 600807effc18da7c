"""Text from bytes: byte order marks, UTF-16 without one, and Western encodings."""

from tuners.logs.table import LogError

_MARKS = {
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
_HEAD = 4000


def decoded(content: bytes) -> str:
    """The text, its lines ended by newlines alone."""
    text = _decoded(content)
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _decoded(content: bytes) -> str:
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    head = content[:_HEAD]
    zeros = head[::2].count(0), head[1::2].count(0)
    if max(zeros) > 0.4 * len(head[::2]) and min(zeros) == 0:
        return content.decode("utf-16-le" if zeros[1] else "utf-16-be", errors="replace")
    if 0 in content:
        raise LogError("The file is not a text table: it has zero bytes in it.")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")
