"""What a subsolution of the Hamilton-Jacobi-Bellman equation has to satisfy, as demands."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf
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

    def flow(self, rates: Sequence[Polynomial]) -> list[Polynomial]:
        """Return the derivatives of the monomials along a motion with the rates of variables."""
        lift, region = self.region.lift, self.region
        field = [region.scaled(each) / rational(region.radius(k)) for k, each in enumerate(rates)]
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
    ansatz: Ansatz,
    running: Polynomial,
    vertices: Sequence[Sequence[Fraction]],
    margin: Fraction = Fraction(0),
) -> Iterator[Demand]:
    """Yield the inequality running + dV/dt >= margin at every vertex of the box of controls, on the
    region and where it is clipped.
    """
    lift = ansatz.region.lift
    for region, rates in ansatz.region.faces():
        for vertex in vertices:
            cost = region.scaled(at_vertex(lift, running, vertex))
            parts = ansatz.flow([at_vertex(lift, each, vertex) for each in rates])
            text = ", ".join(
                f"{lift.names[k]} = {float(u):g}"
                for k, u in zip(lift.controls, vertex, strict=True)
            )
            yield _above(ansatz, f"decrease at {text}", region, (cost, parts), margin)


def falling(ansatz: Ansatz, margin: Fraction) -> Iterator[Demand]:
    """Yield the inequality that V falls toward the inside, by a margin over the radius of the
    region, wherever a motion beyond clipped sides is compared with that at them.
    """
    region = ansatz.region
    for j, k in region.pairs:
        parts = ansatz.flow(region.lift.unit(j))
        if not region.clipped[j]:
            parts = [-each for each in parts]
        face, zero = region.face({k: region.clipped[k]}), region.lift.zero
        name = f"falling with {region.lift.names[j]}"
        yield _above(ansatz, name, face, (zero, parts), margin / region.radius(j))


def _above(
    ansatz: Ansatz,
    name: str,
    region: Region,
    sums: tuple[Polynomial, list[Polynomial]],
    margin: Fraction,
) -> Demand:
    """Return the inequality constant + sum v_j parts_j >= margin, or nothing to demand where all of
    it is zero; the parts are in coordinates of the ansatz.
    """
    lift, (constant, parts) = ansatz.region.lift, sums
    if region is not ansatz.region:
        gens = lift.ring.gens()
        wide = [k for k in range(len(gens)) if k not in lift.controls]
        maps = [
            region.scaled(ansatz.region.coordinate(k)) if k in wide else gen
            for k, gen in enumerate(gens)
        ]
        parts = [each.compose(*maps, ctx=lift.ring) for each in parts]
    full(lift, region, [constant, *parts])
    if margin and (constant != 0 or any(each != 0 for each in parts)):
        constant -= rational(margin)
    tables = [table(region, each) for each in parts]
    return Demand(name, region, table(region, constant), tables, float(margin) or inf)


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
