"""Words counted: how many there are with a given number of switches, which were looked at, and
which need not be.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

from socp.model import Modes

Letters = tuple[Modes, ...]
_MANY = 10**15  # words: nobody reads more digits


def word_count(modes: int, switches: int) -> int:
    """Return the number of words of at most so many switches, with that many modes an arc and no
    equal neighbours.

    A word with an arc of length zero is a shorter word, so every control has one spelling.
    """
    return sum(modes * (modes - 1) ** k for k in range(switches + 1)) if modes else 0


def all_words(modes: Sequence[Modes], switches: int) -> Iterator[Letters]:
    """Yield all words of at most so many switches, the shortest first."""
    layer: list[Letters] = [(each,) for each in modes]
    yield from layer
    for _ in range(switches):
        layer = [(*word, each) for word in layer for each in modes if each != word[-1]]
        yield from layer


def canonical(arcs: Letters) -> Letters:
    """Return a word without equal neighbours."""
    return tuple(each for k, each in enumerate(arcs) if k == 0 or each != arcs[k - 1])


def insert_into(arcs: Letters, k: int, modes: Modes, side: int = 0) -> Letters:
    """Return a word with other modes put into arc k: within it, before it (side -1) or after it
    (side 1).
    """
    own = arcs[k]
    middle = {0: (own, modes, own), -1: (modes, own), 1: (own, modes)}[side]
    return canonical((*arcs[:k], *middle, *arcs[k + 1 :]))


@final
@dataclass(eq=False)
class Ledger:
    """What became of words: solved, without a solution, or excluded since the arc that they add
    does not pay.

    It holds for what a local solver finds: a word without a solution may have one from another
    start, and a word may have a second solution.
    """

    modes: int
    solved: set[Letters] = field(default_factory=set)
    failed: set[Letters] = field(default_factory=set)
    idle: set[Letters] = field(default_factory=set)

    def exclude(
        self, arcs: Letters, slopes: Mapping[tuple[int, Modes], float], level: float
    ) -> None:
        """Enter the words with one arc more than a solved one that an insertion does not pay in.

        slopes: of the modes put into arcs (by index), at their best; it pays below `level`.
        """
        for (k, modes), slope in slopes.items():
            if slope < level:
                continue
            self.idle.add(insert_into(arcs, k, modes))
            for side, other in ((-1, k - 1), (1, k + 1)):
                if slopes.get((other, modes), 0.0) >= level:
                    self.idle.add(insert_into(arcs, k, modes, side))

    def knows(self, word: Letters) -> bool:
        """Tell whether a word was looked at or excluded."""
        return any(word in each for each in (self.solved, self.failed, self.idle))

    def counts(self, switches: int) -> tuple[int, int, int, int, int]:
        """Return how many words of at most so many switches there are, solved, failed, excluded,
        not looked at.
        """
        rows = [
            {w for w in each if len(w) <= switches + 1}
            for each in (self.solved, self.failed, self.idle)
        ]
        solved, failed, idle = rows[0], rows[1] - rows[0], rows[2] - rows[0] - rows[1]
        total = word_count(self.modes, switches)
        return (
            total,
            len(solved),
            len(failed),
            len(idle),
            total - len(solved) - len(failed) - len(idle),
        )

    def text(self, switches: int, *, closed: bool = False) -> str:
        """Say in a sentence what is known of all words of at most so many switches.

        closed: one of them is an extremal with every control free in its box, and no better one is
        known.
        """
        total, solved, failed, idle, rest = self.counts(switches)
        parts = [
            f"{solved} solved",
            f"{failed} without a solution",
            f"{idle} excluded, the arc they add does not pay",
        ]
        why = (
            " (none is better if this extremal is the best one of all with every control free in "
            "its box)"
        )
        parts.append(f"{_plain(rest)} not looked at{why if closed else ''}")
        told = ", ".join(part for part in parts if not part.startswith("0 "))
        return f"of {_plain(total)} words of at most {switches} switches {told}"


def _plain(number: int) -> str:
    return str(number) if number < _MANY else f"about {number:.1e}"
