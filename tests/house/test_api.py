"""Docstrings of what `socp` offers say what a user has to know: shapes of arrays, units of values,
and the errors that are raised.
"""

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from carts import cart
from saddles import saddle

import socp as public
from socp import Ipopt, Reference, Scene, SocpError, Solution, SolveError, Word, silent

SHAPE = re.compile(r"\((?:\w+|\w+ \+ 1)(?:, (?:\w+|\w+ \+ 1)|,)\)|\((?:rows|intervals|arcs)\b")
# what holds or takes values of a problem says in which units they are
MEASURED = ("Problem", "Reference", "Scene", "Solution", "constants", "default_guess", "judge")
MEASURED += ("load", "solve", "solve_collocated", "collocate")


MEMBERS = (property, cached_property, classmethod, staticmethod)


def documented() -> Iterator[tuple[str, Any]]:
    """Yield functions, classes and the public members of classes, by name."""
    for name in public.__all__:
        found = getattr(public, name)
        if inspect.isroutine(found) or inspect.isclass(found):
            yield name, found
        if inspect.isclass(found):
            for member, value in vars(found).items():
                if not member.startswith("_") and (
                    inspect.isfunction(value) or isinstance(value, MEMBERS)
                ):
                    yield f"{name}.{member}", value


def annotated(value: Any) -> str:
    """Return the annotations of a function or property as text."""
    function = getattr(value, "fget", None) or getattr(value, "func", None)
    function = function or getattr(value, "__func__", value)
    return str(getattr(function, "__annotations__", {}))


@pytest.mark.parametrize(("name", "value"), list(documented()))
def test_a_public_name_has_a_docstring_with_the_shapes_of_its_arrays(name: str, value: Any) -> None:
    text = inspect.getdoc(value) or ""
    assert text, name
    if not inspect.isclass(value) and "ndarray" in annotated(value):
        assert SHAPE.search(text), name


@pytest.mark.parametrize("name", MEASURED)
def test_what_has_values_of_a_problem_says_in_which_units(name: str) -> None:
    assert "unit" in (inspect.getdoc(getattr(public, name)) or "")


def solution() -> Solution:
    return public.solve(cart(), method="lgr-multiphase", word="+ -", watch=silent)


REFUSED: dict[str, Callable[[], Any]] = {
    "states": lambda: public.states("1x"),
    "controls": lambda: public.controls("u u"),
    "parameters": lambda: public.parameters("tf"),
    "constants": lambda: public.constants(t=1),
    "initial": lambda: public.initial(public.controls("u")),
    "Problem": lambda: replace(cart(), name=""),
    "Problem.with_": lambda: cart().with_(nothing=1),
    "Reference": lambda: replace(
        cart(), reference=Reference(objective=1, word="?", switches="now")
    ),
    "Scene": lambda: replace(cart(), scene=Scene(plane=("x", "v"))),
    "solve": lambda: public.solve("no_such_problem"),
    "judge": lambda: public.judge(saddle(1.0), solution()),
    "run": lambda: public.run(Ipopt(), cart(), public.default_guess(cart())),  # type: ignore[arg-type]
    "load": lambda: public.load("no.socp.json"),
    "save": lambda: public.save(solution(), "nowhere/cart.socp.json"),
    "follow": lambda: public.follow(cart(), {}),
    "points": lambda: public.points({}),
    "sweep": lambda: public.sweep(cart(), {"nothing": [1.0]}, watch=silent),
    "single_phase": lambda: public.single_phase(cart(), 0),
    "collocate": lambda: public.collocate(public.single_phase(cart()), []),
    "Ipopt": lambda: Ipopt(options={"nothing": 1}),
    "Word.parse": lambda: Word.parse("u: ?", ("u",)),
    "Word.readings": lambda: Word.readings("u: ?", ("u",)),
    "Solution.simulate": lambda: solution().simulate(start={"nothing": 1}),
    "Solution.sensitivity": lambda: solution().sensitivity(to=["nothing"]),
    "Solution.plot": lambda: solution().plot(panels=["nothing"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_error_that_is_raised_stands_in_the_docstring(name: str) -> None:
    with pytest.raises(SocpError) as refused:
        REFUSED[name]()
    found: Any = public
    for part in name.split("."):
        found = getattr(found, part)
    kinds = [kind.__name__ for kind in type(refused.value).__mro__]
    text = inspect.getdoc(found) or ""
    assert any(re.search(rf"\b{kind}\b", text) for kind in kinds[: kinds.index("SocpError")]), text


def test_a_solution_of_another_problem_is_not_judged() -> None:
    with pytest.raises(SolveError, match=r"solution: its states are .*, but those of problem"):
        public.judge(saddle(1.0), solution())
    assert np.isfinite(public.judge(cart(), solution()).objective)
