"""What a subsolution of the Hamilton-Jacobi-Bellman equation has to satisfy, as demands."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import final

import numpy as np

from socp.proof.bound.lifting import Lift, Polynomial, rational
from socp.proof.bound.sets import Region, full
from socp.proof.bound.squares import Demand, Exponents, table


@final
@dataclass(frozen=True, eq=False)
class Ansatz:
    """Functions of the coordinates of a region: combinations of monomials (n,)."""

    region: Region
    monomials: list[Exponents]

    def combined(self, coefficients: Sequence[Fraction]) -> Polynomial:
        """Return a combination of the monomials as a polynomial of the variables."""
        lift = self.region.lift
        terms = zip(self.monomials, coefficients, strict=True)
        its = lift.ring.from_dict({each: rational(c) for each, c in terms if c})
        gens = lift.ring.gens()
        used = its.degrees()
        maps = [self.region.coordinate(k) if used[k] > 0 else gen for k, gen in enumerate(gens)]
        return its.compose(*maps, ctx=lift.ring)

    def on(self, other: Region) -> list[Polynomial]:
        """Return the monomials as polynomials of the coordinates of another region."""
        lift = self.region.lift
        gens = lift.ring.gens()
        used = {k for each in self.monomials for k, power in enumerate(each) if power}
        maps = [
            other.scaled(self.region.coordinate(k)) if k in used else gen
            for k, gen in enumerate(gens)
        ]
        powers: dict[tuple[int, int], Polynomial] = {}
        found = []
        for each in self.monomials:
            value = lift.ring.constant(1)
            for k, power in enumerate(each):
                if power:
                    if (k, power) not in powers:
                        powers[k, power] = maps[k] ** power
                    value *= powers[k, power]
            found.append(value)
        return found

    def flow(self, vertex: Sequence[Fraction]) -> list[Polynomial]:
        """Return the derivatives of the monomials along the motion under a constant control."""
        lift, region = self.region.lift, self.region
        field = [
            region.scaled(at_vertex(lift, rate, vertex)) / rational(region.radius(k))
            for k, rate in enumerate(lift.rates)
        ]
        found = []
        for each in self.monomials:
            total = lift.zero
            for k, power in enumerate(each[: len(field)]):
                if power and field[k] != 0:
                    lower = [p - (i == k) for i, p in enumerate(each)]
                    total += power * lift.ring.from_dict({tuple(lower): 1}) * field[k]
            found.append(total)
        return found


def at_vertex(lift: Lift, given: Polynomial, vertex: Sequence[Fraction]) -> Polynomial:
    """Return a polynomial with the controls in place."""
    names = [lift.names[k] for k in lift.controls]
    return given.subs(dict(zip(names, map(rational, vertex), strict=True)))


def decrease(
    ansatz: Ansatz, running: Polynomial, vertices: Sequence[Sequence[Fraction]]
) -> Iterator[Demand]:
    """Yield the inequality running + dV/dt >= 0 at every vertex of the box of controls."""
    region, lift = ansatz.region, ansatz.region.lift
    for vertex in vertices:
        cost = region.scaled(at_vertex(lift, running, vertex))
        parts = ansatz.flow(vertex)
        full(lift, region, [cost, *parts])
        text = ", ".join(
            f"{lift.names[k]} = {float(u):g}" for k, u in zip(lift.controls, vertex, strict=True)
        )
        tables = [table(region, each) for each in parts]
        yield Demand(f"decrease at {text}", region, table(region, cost), tables)


def below(ansatz: Ansatz, name: str, region: Region, final: Polynomial) -> Demand:
    """Return the inequality V <= final on a region, such as that of admissible ends."""
    its = ansatz.on(region)
    full(region.lift, region, [region.scaled(final), *its])
    cost = table(region, region.scaled(final))
    return Demand(name, region, cost, [table(region, -each) for each in its])


def value(ansatz: Ansatz, at: Region) -> np.ndarray:
    """Return the monomials (n,) at a point, the middle of a region."""
    zero = (0,) * len(at.lift.names)
    return np.array([float(table(at, each).get(zero, 0)) for each in ansatz.on(at)])
