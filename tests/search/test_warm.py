"""Warm starts: neighbouring problems along the word of a solution, against closed forms."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ponds import POND, u, x
from records import revised

from socp import solve
from socp.errors import MethodError, SocpError, SolveError
from socp.laws import arc_law, principle
from socp.methods import default_guess
from socp.model import (
    Mode,
    Problem,
    Solution,
    Stop,
    constants,
    final_time,
    from_json,
    parameters,
    states,
    to_json,
)
from socp.registry import Registry
from socp.search import Search
from socp.search.warm import warm_start
from socp.transcription import lgr, resampled, uniform

NEWTON = "Newton on the conditions of the guess's word"
v = states("v")


@pytest.fixture(scope="module")
def solved() -> Solution:
    found = solve(POND, method="lgr-multiphase", word="- s +")
    assert found.extremal
    return found


@pytest.fixture
def derived(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the arcs whose laws are derived from now on, one entry a derivation."""
    seen = list[str]()

    def counted(setting: Any, *given: Any) -> Any:
        seen.append(setting.name())
        return known(setting, *given)

    known = principle.contact
    monkeypatch.setattr(principle, "contact", counted)
    return seen


def close(found: Solution | None, value: float, times: list[float]) -> None:
    assert found is not None
    assert found.extremal
    assert found.objective == pytest.approx(value, rel=1e-9)
    assert np.allclose(found.switches, times, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "value", "times"),
    [
        ({"level": 0.3}, 2 / 3 * 0.7**3, [0.7, 3.3]),
        ({"level": -0.4}, 2 / 3 * 1.4**3, [1.4, 2.6]),
        ({"rate": 3}, 2 / 3 * 0.75**3 / 3, [0.25, 3.75]),
        ({"final_time": 2}, 2 / 3 * 0.75**3, [0.75, 1.25]),
        ({"start.x": 2}, (1.75**3 + 0.75**3) / 3, [1.75, 3.25]),
        ({"bounds.u.upper": 0.5}, 0.75**3 / 3 * 3, [0.75, 2.5]),
    ],
)
def test_a_neighbour_is_certified_by_newton(
    solved: Solution, change: dict[str, float], value: float, times: list[float]
) -> None:
    search = Search()
    found = warm_start(POND.with_(change), solved, search)
    close(found, value, times)
    assert found is not None
    assert found.message == NEWTON
    assert (search.count, [node.word for node in search.nodes]) == (0, ["u: - s +"])


def test_an_arc_that_has_gone_is_dropped(solved: Solution) -> None:
    """In T = 1 the level is not reached: down for half of it, and up again. Newton along the word
    that holds no more ends with a length below zero, and along the one without that arc there.
    """
    search = Search()
    found = warm_start(POND.with_(final_time=1), solved, search)
    close(found, 2 / 3 * (0.75**3 - 0.25**3), [0.5])
    assert found is not None
    assert found.message == "Newton on the conditions of a word next to the guess's"
    assert (search.count, [node.word for node in search.nodes]) == (0, ["u: - +"])


def test_an_arc_that_has_come_is_inserted(solved: Solution) -> None:
    short = warm_start(POND.with_(final_time=1), solved, Search())
    assert short is not None
    close(warm_start(POND, short, Search()), 2 / 3 * 0.75**3, [0.75, 3.25])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("vdp_regulator", {"start.x2": 1.01}),
        pytest.param("lotka_fishing", {"start.x1": 0.51}, marks=pytest.mark.slow),
    ],
)
def test_a_guess_on_too_coarse_a_mesh_leads_on(name: str, change: dict[str, float]) -> None:
    """On one interval an arc neither motion is resolved."""
    problem = Registry.load().problem(name)
    guess = solve(problem)
    coarse = resampled(guess, [uniform(lgr(10), 1) for _ in guess.arcs])
    search, posed = Search(), problem.with_(change)
    found = warm_start(posed, coarse, search)
    assert found is not None
    assert (search.count, found.message) == (0, NEWTON)
    close(found, solve(posed).objective, found.switches)


def test_a_guess_of_free_controls_has_no_word() -> None:
    assert warm_start(POND, default_guess(POND), Search()) is None


def test_no_word_of_ten_leads_where_there_is_no_solution(solved: Solution) -> None:
    assert warm_start(POND.with_({"end.x": 9}), solved, Search()) is None


RADIUS = constants(radius=0.5)
DISC = Problem(
    name="disc",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 2, v: 0},
    target={"near": x**2 + v**2 <= RADIUS**2},
)


@pytest.fixture(scope="module")
def reached() -> Solution:
    return solve(DISC)


@pytest.mark.parametrize("radius", [0.3, 0.55, 0.7])
@pytest.mark.slow
def test_a_limit_that_is_met_at_the_end_is_met_by_the_neighbour(
    reached: Solution, radius: float
) -> None:
    """A wider target leaves the old end inside: it is the multiplier that says that it is met."""
    posed = DISC.with_(radius=radius)
    found = warm_start(posed, reached, Search())
    assert found is not None
    assert found.extremal
    assert found.message == NEWTON
    end = found.arcs[-1].x[:, -1]
    assert float(end @ end) == pytest.approx(radius**2, rel=1e-9)
    close(found, solve(posed).objective, found.switches)


def test_auto_does_not_scout_where_the_word_holds(
    solved: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    def scouted(*_: Any) -> None:
        raise AssertionError("it scouts")

    monkeypatch.setattr("socp_plugins.auto.scouted", scouted)
    found = solve(POND.with_(level=0.5), guess=solved)
    close(found, 2 / 3 * 0.5**3, [0.5, 3.5])
    assert found.judgement.agreement is not None
    assert found.effort.iterations == 0  # what the guess had cost is not counted again


def test_lgr_multiphase_takes_the_word_of_its_guess(solved: Solution) -> None:
    close(solve(POND.with_(level=0.5), solved, "lgr-multiphase"), 2 / 3 * 0.5**3, [0.5, 3.5])
    free = solve(POND, solved, "lgr-multiphase", phases=2, points=5)
    assert [str(arc.modes[0]) for arc in free.arcs] == ["*", "*"]


def test_solve_takes_the_names_of_the_command(solved: Solution) -> None:
    with pytest.raises(MethodError, match="auto has no option 'second'; did you mean 'seconds'"):
        solve(POND, second=3)
    with pytest.raises(MethodError, match="unknown method 'aut'; did you mean 'auto'"):
        solve(POND, method="aut")
    with pytest.raises(SolveError, match="guess: its states are x, but those of problem 'disc'"):
        solve(DISC, guess=solved)
    arcs = tuple(replace(arc, x=np.full_like(arc.x, np.nan)) for arc in solved.arcs)
    with pytest.raises(SolveError, match="guess: states or controls in it are not finite"):
        solve(POND, guess=replace(solved, arcs=arcs))
    named = solve("jacobson_1", method="euler-ipopt", steps=50)
    assert (named.problem, named.options["steps"]) == ("jacobson_1", 50)


class IterationsAlone:
    """A backend that was written when searches limited nothing but iterations."""

    def limited(self, _iterations: int) -> "IterationsAlone":
        return self

    def __call__(self, *_given: Any) -> Any:
        raise AssertionError("it is not asked")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"problem": 3}, "solve: 3 where a problem, its name or path is needed"),
        ({"problem": Path("nowhere.py")}, "nowhere.py: No such file"),
        ({"guess": 3}, "guess: 3 where a solution, or the path of one, is needed"),
        ({"backend": "ipop"}, "auto: backend: no backend 'ipop'; did you mean 'ipopt'"),
        ({"backend": 3}, "auto: backend=3, but it should be a backend"),
        ({"backend": IterationsAlone()}, r"auto: backend=.*limited\(iterations, lost=None\)"),
    ],
)
def test_what_solve_cannot_take_is_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(SocpError, match=said):
        solve(**{"problem": POND, **given})


def test_a_backend_may_be_named(solved: Solution) -> None:
    found = solve(POND, solved, "lgr-multiphase", backend="ipopt")
    assert found.extremal
    assert found.options["backend"] == "ipopt"


def test_a_warm_start_that_leads_nowhere_takes_nothing_from_the_search(solved: Solution) -> None:
    search = Search()
    left = search.backend.left
    assert warm_start(POND.with_({"end.x": 9}), solved, search) is None
    assert (search.count, search.solved, search.best, search.backend.left) == (0, {}, None, left)
    assert len(search.nodes) > 0


def test_ctrl_c_in_a_warm_start_leaves_the_guess(
    solved: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("socp.search.warm.polished", stopped)
    found = solve(POND.with_(level=0.5), guess=solved)
    assert found.stop is Stop.INTERRUPTED
    assert found.switches == pytest.approx(solved.switches)
    assert found.extremal is False


def test_a_statement_of_another_problem_is_no_origin(solved: Solution) -> None:
    lying = revised(solved, statement=DISC.statement)
    close(warm_start(POND.with_(level=0.5), lying, Search()), 2 / 3 * 0.5**3, [0.5, 3.5])


def test_a_word_along_a_limit_that_has_gone_is_not_followed() -> None:
    given = {"minimise": final_time, "dynamics": {x: v, v: u}, "start": {x: 0, v: 0}}
    rest = {**given, "end": {x: 2, v: 0}, "bounds": {u: (-1, 1)}}
    limited = Problem(name="limited", **{**rest, "bounds": {u: (-1, 1), v: (None, 1)}})
    along = solve(limited, method="lgr-multiphase", word="+ b -")
    assert along.extremal
    free = solve(Problem(name="free", **rest), along, "lgr-multiphase")
    assert free.word != along.word
    assert free.stop.ok


def test_a_guess_without_a_statement_does_as_well(solved: Solution) -> None:
    bare = revised(solved, statement=None, verdict=None)
    close(warm_start(POND.with_(level=0.5), bare, Search()), 2 / 3 * 0.5**3, [0.5, 3.5])


def fresh(problem: Problem) -> Problem:
    """Return a problem that shares nothing with others."""
    return replace(problem)


def test_neighbours_by_other_values_share_what_is_derived(
    solved: Solution, derived: list[str]
) -> None:
    pond, guess = fresh(POND), solved
    counts = []
    for level in (0.3, 0.35, 0.4):
        guess = solve(pond.with_(level=level), guess=guess)
        close(guess, 2 / 3 * (1 - level) ** 3, [1 - level, 3 + level])
        counts.append(len(derived))
    assert counts[0] > 0
    assert counts == [counts[0]] * 3
    alone = solve(fresh(pond.with_(level=0.4)), guess=guess)
    assert guess.objective == pytest.approx(alone.objective, rel=1e-12)
    assert np.allclose(guess.switches, alone.switches, atol=1e-12)
    assert (guess.parameters, guess.statement) == ({}, alone.statement)
    assert guess.verdict is not None
    assert alone.verdict is not None
    assert {f.kind for f in guess.verdict.findings} == {f.kind for f in alone.verdict.findings}


def test_a_neighbour_at_other_ends_derives_nothing_anew(derived: list[str]) -> None:
    guess = solve(pond := fresh(POND))
    guess = solve(pond.with_({"start.x": 1.5}), guess)
    count = len(derived)
    close(solve(pond.with_({"start.x": 2}), guess), (1.75**3 + 0.75**3) / 3, [1.75, 3.25])
    assert len(derived) == count > 0


def test_a_search_takes_no_law_from_a_start_that_nothing_moves_away_from() -> None:
    """With no prey sigma vanishes all the way: no law is found there, nor is one asked for."""
    y, c = states("y c")
    empty = Problem(
        name="fishery of two",
        minimise=c,
        dynamics={
            x: x - x * y - 0.4 * x * u,
            y: -y + x * y - 0.2 * y * u,
            c: (x - 1) ** 2 + (y - 1) ** 2,
        },
        bounds={u: (0, 1)},
        start={x: 0, y: 0, c: 0},
        final_time=12,
    )
    with pytest.raises(MethodError):
        arc_law(empty, (Mode("singular"),))
    found = solve(empty.with_({"start.x": 0.5, "start.y": 0.7}))
    assert found.word == "u: - + s"
    assert found.extremal


def test_a_guess_is_told_by_what_it_carries(solved: Solution) -> None:
    pond = fresh(POND)
    one = solve(pond.with_(level=0.3), guess=solved)
    other = solve(pond.with_(level=0.5), guess=loaded(one))
    close(other, 2 / 3 * 0.5**3, [0.5, 3.5])
    assert len(other.nodes) == 1


def loaded(solution: Solution) -> Solution:
    """Return a solution as it is read from its file."""
    return from_json(to_json(solution))


def test_a_guess_of_a_problem_of_other_parameters_is_a_guess_all_the_same() -> None:
    given = {"minimise": final_time, "start": {x: 0, v: 0}, "end": {x: 1, v: 0}}
    plain = Problem(name="plain", dynamics={x: v, v: u}, bounds={u: (-1, 1)}, **given)
    drift = parameters("drift")
    drifting = Problem(
        name="drifting", dynamics={x: v, v: u + drift}, bounds={u: (-1, 1), drift: (0, 0)}, **given
    )
    guess = solve(drifting, method="lgr-multiphase", word="+ -")
    found = solve(plain.with_({"end.x": 4}), guess=guess)
    assert found.extremal
    assert found.objective == pytest.approx(4.0, rel=1e-9)
