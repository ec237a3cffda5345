"""Words: which kind of arc every control is on, arc after arc."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self, final

from socp.errors import MethodError
from socp.process import short

Kind = Literal["lower", "upper", "singular", "boundary", "free"]

_SPELLINGS: dict[str, Kind] = {
    "-": "lower",
    "lower": "lower",
    "lo": "lower",
    "+": "upper",
    "upper": "upper",
    "up": "upper",
    "s": "singular",
    "sing": "singular",
    "singular": "singular",
    "b": "boundary",
    "bdry": "boundary",
    "boundary": "boundary",
    "*": "free",
    "free": "free",
}
_MOST = 1000  # arcs of a word that is given: programmes along more do not end in any useful time
_TOKEN = re.compile(r"(?P<kind>[^\[\]\s]+)(?:\[(?P<constraint>[^\[\]]+)\])?$")


@final
@dataclass(frozen=True)
class Mode:
    """What one control does on one arc; a boundary arc may name the state constraint that it
    follows.
    """

    kind: Kind
    constraint: str | None = None

    SIGNS: ClassVar[dict[Kind, str]] = {
        "lower": "-",
        "upper": "+",
        "singular": "s",
        "boundary": "b",
        "free": "*",
    }

    def __str__(self) -> str:
        return self.SIGNS[self.kind] + (f"[{self.constraint}]" if self.constraint else "")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `+`, `-`, `s`, `b`, `b[constraint]`, `*` or their long names; MethodError names what
        is not one.
        """
        match = _TOKEN.match(text)
        kind = _SPELLINGS.get(match["kind"].lower()) if match else None
        if match is None or kind is None:
            raise MethodError(
                f"word: '{short(text)}' is no kind of arc; write + (upper bound), - (lower "
                "bound), s (singular), b or b[constraint] (boundary), * (free)"
            )
        if match["constraint"] and kind != "boundary":
            boundary = f"b[{match['constraint']}]"
            raise MethodError(
                f"word: '{text}' names a constraint, which only a boundary arc has: {boundary}"
            )
        return cls(kind, match["constraint"])


Modes = tuple[Mode, ...]  # of all controls on one arc


@final
@dataclass(frozen=True)
class Word:
    """A sequence of arcs; `arcs[k][i]` is the mode of control i on arc k.

    It is written one control after the other, `r: + s s s +; f: + + b - -`, with one mode an arc.
    """

    controls: tuple[str, ...]
    arcs: tuple[Modes, ...]

    def __str__(self) -> str:
        rows = [" ".join(str(arc[i]) for arc in self.arcs) for i in range(len(self.controls))]
        return "; ".join(f"{name}: {row}" for name, row in zip(self.controls, rows, strict=True))

    def of(self, control: str) -> str:
        """Return the modes of one control with equal neighbours merged, such as `+ s +`."""
        column = [str(arc[self.controls.index(control)]) for arc in self.arcs]
        return " ".join(mode for k, mode in enumerate(column) if k == 0 or mode != column[k - 1])

    @classmethod
    def parse(cls, text: str, controls: Sequence[str]) -> Self:
        """Read a word as `str(word)` writes it; the control's name may be left out where there is
        just one control.

        Raises MethodError naming the unknown, missing or repeated control, the bad mode, or the
        unequal lengths.
        """
        rows: dict[str, list[Mode]] = {}
        for part in filter(None, (piece.strip() for piece in text.split(";"))):
            name, colon, modes = part.partition(":")
            if not colon and len(controls) == 1:
                name, modes = controls[0], part
            name = name.strip()
            if name not in controls:
                known = ", ".join(controls)
                raise MethodError(
                    f"word: '{short(part)}' should start with a control and a colon; controls: "
                    f"{known}"
                )
            if name in rows:
                raise MethodError(f"word: control '{name}' is given twice")
            rows[name] = [Mode.parse(token) for token in modes.split()]
        missing = [name for name in controls if not rows.get(name)]
        if missing:
            such = f"'{missing[0]}: + s -'"
            raise MethodError(
                f"word: no arcs for control '{missing[0]}'; write one row a control, such as {such}"
            )
        lengths = {name: len(modes) for name, modes in rows.items()}
        if len(set(lengths.values())) > 1:
            counts = ", ".join(f"{name} has {count}" for name, count in lengths.items())
            raise MethodError(f"word: every control needs one mode an arc, but {counts}")
        most = max(lengths.values(), default=0)
        if most > _MOST:
            raise MethodError(f"word: {most} arcs; at most {_MOST}")
        return cls(tuple(controls), tuple(zip(*(rows[name] for name in controls), strict=True)))
