"""Foreign text made safe to show: what would steer a terminal, or turn the reading direction, is shown as an escape."""

import re

# control characters (C0 but line feed and tab, DEL, C1), marks of reading direction, line and paragraph separators,
# marks without a shape (byte order, annotations, tags), and lone surrogates, which no encoding can write
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
    """Return text that shows as itself in Markdown: on one line, without emphasis, links, pictures, HTML or cells."""
    return _MARKDOWN.sub(r"\\\g<0>", one_line(text))


def markdown_code(text: object) -> str:
    """Return text as code in Markdown, also in a cell of a table; backticks, which would end it, become quotes."""
    return f"`{one_line(text).replace('`', chr(39)).replace('|', chr(92) + '|')}`"


def file_stem(name: str) -> str:
    """Return a name as that of a file in the current folder: no folders, nothing hidden, not too long.

    Letters and digits of any script, `-`, `+`, `.`, `_`, parentheses and inner blanks stay; all else becomes `_`.
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
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
