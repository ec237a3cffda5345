"""Certificates of lower bounds: plain values, as JSON."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from socp.model import Problem
from socp.proof.bound.checking import FORMAT
from socp.proof.bound.lifting import Lift, fraction
from socp.proof.bound.rounding import Squares
from socp.proof.bound.sets import Region
from socp.proof.bound.squares import Exponents, Table

Data = dict[str, Any]


def monomial(exponents: Sequence[int]) -> list[list[int]]:
    """Return exponents as pairs (variable, power)."""
    return [[k, int(power)] for k, power in enumerate(exponents) if power]


def function(monomials: Sequence[Exponents], coefficients: Sequence[Fraction]) -> list[Any]:
    """Return a combination of monomials as plain values."""
    pairs = zip(monomials, coefficients, strict=True)
    return [[monomial(each), str(value)] for each, value in pairs if value]


def proof(squares: Squares) -> list[Any]:
    """Return squares as plain values."""
    parts = zip(squares.kinds, squares.bases, squares.rows, squares.scales, strict=True)
    return [
        [kind, [monomial(each) for each in basis], rows, scale]
        for kind, basis, rows, scale in parts
        if rows
    ]


def stage(region: Region, exits: Sequence[Data], value: Data) -> Data:
    """Return a region with the functions that hold on it as plain values."""
    box = region.box[: region.lift.base]
    return {
        "box": [None if None in each else [str(end) for end in each] for each in box],
        "clipped": [list(each) for each in sorted(region.clipped.items())],
        "exits": list(exits),
        "value": value,
    }


def certificate(problem: Problem, lift: Lift, stages: Sequence[Data]) -> Data:
    """Return a certificate, its bound to be filled in."""
    return {
        "format": FORMAT,
        "problem": dict(problem.statement),
        "functions": [[name, _polynomial(of)] for name, _, of in lift.functions],
        "stages": list(stages),
        "bound": None,
    }


def _polynomial(given: Any) -> list[Any]:
    its: Table = {tuple(map(int, e)): fraction(c) for e, c in given.to_dict().items()}
    return function(list(its), list(its.values()))
