"""Foreign text made safe to show: what would steer a terminal, or turn the reading direction, is
shown as an escape.
"""

import difflib
import re
from collections.abc import Callable, Iterable
from typing import Any

# control characters (C0 but line feed and tab, DEL, C1), marks of reading direction, line and
# paragraph separators, marks without a shape (byte order, annotations, tags), and lone surrogates,
# which no encoding can write
_STEERING = (
    "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f"
)
_UNSEEN = re.compile(f"[{_STEERING}]")
_UNSEEN_OR_BREAK = re.compile(f"[{_STEERING}\t\n]")
_MARKDOWN = re.compile(r"[\\`*_\[\]<>|&~$#]")
_SHORT = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def printable(text: object) -> str:
    r"""Return text with its control characters as escapes such as `\x1b`; lines and tabs stay."""
    return _UNSEEN.sub(_escape, str(text))


def one_line(text: object) -> str:
    """Return text on one line: as `printable`, line feeds and tabs as escapes too."""
    return _UNSEEN_OR_BREAK.sub(_escape, str(text))


def markdown(text: object) -> str:
    """Return text that shows as itself in Markdown: on one line, without emphasis, links, pictures,
    HTML or cells.
    """
    return _MARKDOWN.sub(r"\\\g<0>", one_line(text))


def markdown_code(text: object) -> str:
    """Return text as code in Markdown, also in a cell of a table; backticks, which would end it,
    become quotes.
    """
    return f"`{one_line(text).replace('`', chr(39)).replace('|', chr(92) + '|')}`"


def file_stem(name: str) -> str:
    """Return a name as that of a file in the current folder: no folders, nothing hidden, not too
    long.

    Letters and digits of any script, `-`, `+`, `.`, `_`, parentheses and inner blanks stay; all
    else becomes `_`.
    """
    plain = re.sub(r"[^\w.+() -]", "_", name).strip()
    plain = re.sub(r"^\.+", "_", plain)
    while len(plain.encode()) > _LONGEST:
        plain = plain[:-1]
    return plain or "_"


_LONGEST = 200  # bytes: file systems allow 255, and endings are still to come


def _escape(found: "re.Match[str]") -> str:
    code = ord(found[0])
    if found[0] in _SHORT:
        return _SHORT[found[0]]
    return (
        f"\\x{code:02x}"
        if code < 0x100
        else f"\\u{code:04x}"
        if code < 0x10000
        else f"\\U{code:08x}"
    )


_LONG = 120  # characters of a value in a message: enough to know it again, few enough to read on
_AN = ("SX", "MX", "ndarray")  # read letter by letter
_TEXT = 400  # characters of an error's text: some of them carry advice worth reading


def shown(value: Any) -> str:
    """Return how Python writes a value, on one line and shortened; a value that cannot be written
    is named by type.
    """
    text = _written(repr, value)
    return f"a {type(value).__name__} that cannot be printed" if text is None else short(text)


def plainly(value: Any) -> str:
    """Return a value as a reader knows it, `x` and not `SX(x)`, on one line, shortened and safe as
    `shown`.
    """
    text = _written(str, value)
    return shown(value) if text is None else short(text)


def said(error: BaseException) -> str:
    """Return the text of an error on one line, empty where it has none; one that cannot be printed
    says so.
    """
    text = _written(str, error)
    return "its text cannot be printed" if text is None else short(text, _TEXT)


def _written(write: Callable[[Any], str], value: Any) -> str | None:
    """Return what `repr` or `str` writes, None where that fails."""
    try:
        return write(value)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - a value of a stranger's class may raise anything here
        return None


def short(text: str, most: int = _LONG) -> str:
    """Return a text on one line, its middle left out where it is longer than a number of
    characters.
    """
    line = " ".join(text.split())
    if len(line) <= most:
        return line
    tail = most // 4
    return f"{line[: most - tail]} ... {line[-tail:]} ({len(line)} characters)"


def first_paragraph(doc: str | None) -> str:
    """Return the first paragraph of a docstring on one line, empty where there is none."""
    return " ".join(re.split(r"\n\s*\n", (doc or "").strip(), maxsplit=1)[0].split())


def a(thing: Any) -> str:
    """Return the type of a thing with its article, such as `an int`."""
    kind = type(thing).__name__
    return f"{'an' if kind[:1].lower() in 'aeiou' or kind in _AN else 'a'} {kind}"


def close(name: str, names: Iterable[str]) -> str:
    """Return '; did you mean ...?' with the closest of the names, empty where none is close."""
    found = difflib.get_close_matches(name, list(names), n=1)
    return f"; did you mean '{found[0]}'?" if found else ""
