"""What the starts of a census did not meet: how many extremals are to be expected unseen.

Starts are taken for independent draws of one generator, each of which ends in one of finitely many
*species*: an extremal each, and one more for all starts that end in none. All numbers and shares of
species are taken for equally likely beforehand (Boender, Rinnooy Kan, Mathematical Programming 37,
1987). None of it says anything of an extremal that the generator leads to in no case.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from socp.study.clusters import Census

_DOUBT = 0.05  # probability with which the largest share that was missed is understated


@final
@dataclass(frozen=True, kw_only=True)
class Unseen:
    """What is to be expected of species that no start has met.

    - starts, species: what was seen; nowhere: the starts that ended in no extremal, the species of
      their own where there are any;
    - expected: number of unseen species, None where there are too few starts to tell;
    - share: expected share of the starts that end in unseen species, None there as well;
    - complete: probability that there are none;
    - missed: a species in which a larger share of starts ends would have been missed with a
      probability of less than 5 %, whatever is likely beforehand.
    """

    starts: int
    species: int
    nowhere: int
    expected: float | None
    share: float | None
    complete: float
    missed: float


def unseen(census: Census) -> Unseen | None:
    """Return what the finished starts of a census let expect, None where none is finished."""
    n, nowhere = len(census.outcomes), sum(not each.certified for each in census.outcomes)
    if not n:
        return None
    w = len(census.extremals) + (nowhere > 0)
    i = np.arange(1, w + 1)
    enough = n > w + 2
    return Unseen(
        starts=n,
        species=w,
        nowhere=nowhere,
        expected=w * (w + 1) / (n - w - 2) if enough else None,
        share=w * (w + 1) / (n * (n - 1)) if enough else None,
        complete=float(np.prod((n - 1 - i) / (n - 1 + i))) if enough else 0.0,
        missed=float(1.0 - _DOUBT ** (1.0 / n)),
    )
