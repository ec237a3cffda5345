"""How figures look: sizes, colours that tell apart in print and to every eye, names as the
mathematics writes them.
"""

import re
from collections.abc import Mapping
from html import unescape
from typing import Any

from socp.process import one_line

FONT, SMALL = 8.0, 7.0  # points, as in the captions and notes of a two-column paper
THIN, LINE = 0.6, 1.1  # points
MARKED = 40  # switching times that are marked at most: more are ringing, and grey everything
_TINT = 0.25  # share of its colour in the shade of an arc
INK, FAINT, ACCENT = "#1a1a1a", "#8a8a8a", "#0b5394"

# mode -> name, colour, hatch: from dark to light in grey too, and hatched, so that nothing hangs on
# the colour
MODES: Mapping[str, tuple[str, str, str]] = {
    "-": ("min", "#1f4e8c", "\\\\\\\\"),
    "+": ("max", "#f2ae5c", "////"),
    "s": ("singular", "#d9ead3", ""),
    "b": ("boundary", "#9a5c94", "xxxx"),
    "*": ("free", "#ffffff", ""),
}

Look = tuple[str, Any]  # colour and dashes of a line
OWN: Look = (INK, "-")
# other solutions' lines: dashes tell them apart in grey
OTHERS: tuple[Look, ...] = (
    ("#0b5394", (0, (5, 1.5))),
    ("#b45f06", (0, (1, 1))),
    ("#38761d", (0, (6, 1.5, 1, 1.5))),
    ("#741b47", (0, (3, 1, 1, 1, 1, 1))),
)

_LETTERS = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau "
    "upsilon phi chi "
)
_CAPITALS = "psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
_GREEK = frozenset((_LETTERS + _CAPITALS).split())
SETTINGS = {
    "font.size": SMALL,
    "axes.labelsize": FONT,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "axes.linewidth": THIN,
    "xtick.major.width": THIN,
    "ytick.major.width": THIN,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "hatch.linewidth": 0.4,
    "hatch.color": "#ffffff",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "pdf.fonttype": 42,
    "svg.hashsalt": "socp",
    "axes.unicode_minus": True,
    "path.simplify": True,
    "axes.formatter.useoffset": False,
    "axes.labelpad": 2.0,
}


def kind(mode: str) -> str:
    """Return the sign of a mode's kind: `b` for `b[u.upper]`."""
    return mode[:1] if mode[:1] in MODES else "*"


def tint(colour: str) -> tuple[float, float, float]:
    """Return a colour `#rrggbb` mixed with white: opaque, as not every printer knows what is half
    transparent.
    """
    red, green, blue = (1.0 - _TINT * (1.0 - int(colour[k : k + 2], 16) / 255) for k in (1, 3, 5))
    return red, green, blue


def symbol(name: str) -> str:
    """Return a name in the notation of mathtext, without dollars: Greek letters, digits and what
    follows `_` below.
    """
    base, below = parts_of(name)
    if not base:
        return r"\mathrm{" + re.sub(r"[^A-Za-z0-9.]", r" ", name) + "}"
    return _word(base) + ("_{" + ",".join(map(_word, below)) + "}" if below else "")


def parts_of(name: str) -> tuple[str, list[str]]:
    """Return the letters of a name and what stands below them; no letters where it is no symbol."""
    base, _, rest = name.partition("_")
    letters = re.match(r"([A-Za-z]+?)(\d*)$", base)
    if letters is None:
        return "", []
    return letters[1], [part for part in (letters[2], *rest.split("_")) if part]


def letter(word: str) -> str:
    """Return a word as text, the name of a Greek letter as that letter."""
    return unescape(f"&{word};") if word in _GREEK else word


def label(text: str, unit: str = "") -> str:
    """Return the label of an axis from a text in mathtext and a unit."""
    return f"${text}$" + (f" ({unit})" if unit else "")


def plain(text: str) -> str:
    """Return foreign text as it may stand beside mathtext: on one line, its dollars no signs of
    mathematics.
    """
    return one_line(text).replace("$", r"\$")


def _word(word: str) -> str:
    if word in _GREEK:
        return "\\" + word
    return word if len(word) == 1 else rf"\mathrm{{{word}}}"
