"""Words: which kind of arc every control is on, arc after arc."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
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
        """Read a word as `str(word)` writes it, one mode an arc, with bars between the arcs or
        without; the control's name may be left out where there is just one control.

        Raises MethodError naming the unknown, missing or repeated control, the bad mode, or the
        unequal lengths.
        """
        rows = {
            name: [sign for sign in signs if sign != "|"]
            for name, signs in _rows(text, controls).items()
        }
        lengths = {name: len(modes) for name, modes in rows.items()}
        if len(set(lengths.values())) > 1:
            counts = ", ".join(f"{name} has {count}" for name, count in lengths.items())
            raise MethodError(f"word: every control needs one mode an arc, but {counts}")
        _bounded(max(lengths.values(), default=0))
        modes = [[Mode.parse(token) for token in rows[name]] for name in controls]
        return cls(tuple(controls), tuple(zip(*modes, strict=True)))

    @classmethod
    def readings(cls, text: str, controls: Sequence[str]) -> tuple[Self, ...]:
        """Return the words that a text may stand for, the one with the most even stretches first.

        A text has one mode an arc, as `parse` reads it, or one a stretch, as reports print it,
        `r: + s +; f: + -`, with commas or without: then the switches of different controls may
        follow in any order. MethodError where both readings are meant by the same text, and where
        there are more orders than `_ORDERS`.
        """
        rows = _rows(text, controls)
        tokens = [token for row in rows.values() for token in row]
        parted = any(token.endswith(",") for token in tokens)
        named = {
            name: [Mode.parse(token.rstrip(",")) for token in row if token not in {"|", ","}]
            for name, row in rows.items()
        }
        again = any(a == b for row in named.values() for a, b in pairwise(row))
        lengths = {len(row) for row in named.values()}
        if not parted and ("|" in tokens or again or lengths == {1} or len(named) < 2):
            return (cls.parse(text, controls),)
        if not parted and len(lengths) == 1:
            arcs = "; ".join(f"{name}: {' | '.join(map(str, row))}" for name, row in named.items())
            raise MethodError(
                f"word: '{short(text)}' has two readings: write '{arcs}' if all controls switch at "
                f"the same times, '{arcs.replace(' |', ',')}' if every control has its own"
            )
        _bounded(sum(len(row) - 1 for row in named.values()) + 1)
        return tuple(
            cls(tuple(controls), each) for each in _orders([named[name] for name in controls])
        )


_ORDERS = 100  # of the switches of several controls: each is solved along, a second or so


def _rows(text: str, controls: Sequence[str]) -> dict[str, list[str]]:
    """Return the signs of every control's row; MethodError where controls are not those there
    are.
    """
    rows: dict[str, list[str]] = {}
    for part in filter(None, (piece.strip() for piece in text.split(";"))):
        name, colon, modes = part.partition(":")
        if not colon and len(controls) == 1:
            name, modes = controls[0], part
        name = name.strip()
        if name not in controls:
            known = ", ".join(controls)
            raise MethodError(
                f"word: '{short(part)}' should start with a control and a colon; controls: {known}"
            )
        if name in rows:
            raise MethodError(f"word: control '{name}' is given twice")
        rows[name] = modes.split()
    missing = [name for name in controls if not rows.get(name)]
    if missing:
        such = f"'{missing[0]}: + s -'"
        raise MethodError(
            f"word: no arcs for control '{missing[0]}'; write one row a control, such as {such}"
        )
    return rows


def _bounded(arcs: int) -> None:
    if arcs > _MOST:
        raise MethodError(f"word: {arcs} arcs; at most {_MOST}")


def _orders(rows: Sequence[Sequence[Mode]]) -> list[tuple[Modes, ...]]:
    """Return the arcs of rows of stretches for every order of their switches, even ones first.

    How uneven an order is says how far it is from one with all stretches of a control equally long.
    """
    steps = [len(row) - 1 for row in rows]
    count = math.factorial(sum(steps)) // math.prod(map(math.factorial, steps))
    if count > _ORDERS:
        raise MethodError(
            f"word: its switches may follow in {count} orders; write one mode an arc, such as "
            "'r: + s s s +; f: + + b - -'"
        )

    def onward(at: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], ...]]:
        if list(at) == steps:
            yield (at,)
        for k, place in enumerate(at):
            if place < steps[k]:
                for rest in onward((*at[:k], place + 1, *at[k + 1 :])):
                    yield (at, *rest)

    def uneven(path: tuple[tuple[int, ...], ...]) -> float:
        shares = [[k / n for k, n in zip(at, steps, strict=True) if n] for at in path]
        return sum(max(each) - min(each) for each in shares)

    paths = sorted(onward((0,) * len(rows)), key=uneven)
    return [
        tuple(tuple(row[k] for row, k in zip(rows, at, strict=True)) for at in path)
        for path in paths
    ]
