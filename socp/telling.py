"""What was given, as a message shows it: on one line, not too long, whatever its own text does."""

import difflib
from collections.abc import Iterable
from typing import Any

_LONG = 120  # characters of a value in a message: enough to know it again, few enough to read on
_AN = ("SX", "MX", "ndarray")  # read letter by letter
_TEXT = 400  # characters of an error's text: some of them carry advice worth reading


def shown(value: Any) -> str:
    """Return how Python writes a value, on one line and shortened; a value that cannot be written is named by type."""
    try:
        text = repr(value)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - a value of a stranger's class may raise anything here
        return f"a {type(value).__name__} that cannot be printed"
    return short(text)


def plainly(value: Any) -> str:
    """Return a value as a reader knows it, `x` and not `SX(x)`, on one line, shortened and safe as `shown`."""
    try:
        text = str(value)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - as above
        return shown(value)
    return short(text)


def said(error: BaseException) -> str:
    """Return the text of an error on one line, empty where it has none; one that cannot be printed says so."""
    try:
        text = str(error)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - as above
        return "its text cannot be printed"
    return short(text, _TEXT)


def short(text: str, most: int = _LONG) -> str:
    """Return a text on one line, its middle left out where it is longer than a number of characters."""
    line = " ".join(text.split())
    if len(line) <= most:
        return line
    tail = most // 4
    return f"{line[: most - tail]} ... {line[-tail:]} ({len(line)} characters)"


def a(thing: Any) -> str:
    """Return the type of a thing with its article, such as `an int`."""
    kind = type(thing).__name__
    return f"{'an' if kind[:1].lower() in 'aeiou' or kind in _AN else 'a'} {kind}"


def close(name: str, names: Iterable[str]) -> str:
    """Return '; did you mean ...?' with the closest of the names, empty where none is close."""
    found = difflib.get_close_matches(name, list(names), n=1)
    return f"; did you mean '{found[0]}'?" if found else ""
