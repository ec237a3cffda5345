"""What every backend of the table does: Ipopt's conventions, honest stops, a clean end, silence."""

import ctypes
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

from socp import MethodError, Problem, default_guess, run, silent
from socp.cli.options import build
from socp.model import Progress, Stop
from socp.registry import Registry, load_problem
from socp.solvers import BACKENDS, NLP, Backend, NLPPoint, Uno
from socp.solvers.backends.uno_options import KINDS

WORD = ("word", "r: + s s s +; f: + + b - -"), ("lengths", "0.05 0.6 14 0.1 0.2")
a, b = casadi.SX.sym("a"), casadi.SX.sym("b")
_LIBRARIES = {"libuno.so", "libuno.dylib", "libuno.dll", "uno.dll"}
Made = Callable[[], Backend]


@pytest.fixture(params=sorted(BACKENDS))
def make(request: pytest.FixtureRequest) -> Made:
    made: Made = BACKENDS[request.param]
    return made


def programme(
    f: Any, g: Any = None, box: tuple[Any, Any] = (-10.0, 10.0), rows: tuple[float, float] = (0, 0)
) -> NLP:
    g = casadi.SX(0, 1) if g is None else g
    return NLP.of(
        v=casadi.vertcat(a, b),
        f=casadi.SX(f),
        g=g,
        v_box=np.array([np.broadcast_to(each, 2) for each in box], dtype=float),
        g_box=np.array([np.full(g.numel(), each) for each in rows], dtype=float),
        binary=np.zeros(2, dtype=bool),
    )


def at(*v: float) -> NLPPoint:
    return NLPPoint(v=np.array(v))


ROSENBROCK = (1 - a) ** 2 + 100 * (b - a**2) ** 2
# f, g, box of v, box of g; x, lam_v, lam_g by hand: grad f + lam_v + J' lam_g = 0
CASES = {
    "free": ((a - 1) ** 2 + (b + 2) ** 2, None, (-10, 10), (0, 0), (1, -2), (0, 0), ()),
    "at a bound": ((a - 1) ** 2 + b**2, None, (2, 9), (0, 0), (2, 2), (-2, -4), ()),
    "upper row": ((a - 1) ** 2 + b**2, a + b, (-9, 9), (-9, 0), (0.5, -0.5), (0, 0), (1,)),
    "lower row": (a + b**2, a - b, (-9, 9), (1, 9), (0.5, -0.5), (0, 0), (-1,)),
    "equation": (a**2 + b**2, a + 2 * b, (-9, 9), (5, 5), (1, 2), (0, 0), (-2,)),
    "held": (a * b + b**2, a + b, ((3, -9), (3, 9)), (-9, 9), (3, -1.5), (1.5, 0), (0,)),
}


@pytest.mark.parametrize("factor", [1.0, 1e3])
@pytest.mark.parametrize("case", CASES)
def test_points_and_multipliers_are_those_found_by_hand(
    make: Made, case: str, factor: float
) -> None:
    f, g, box, rows, v, lam_v, lam_g = CASES[case]
    nlp = programme(f, g, box, rows)
    point = make().scaled(factor)(nlp, at(0.3, 0.4))
    assert point.stop is Stop.SOLVED, point.message
    assert point.v == pytest.approx(v, abs=1e-6)
    assert point.objective == pytest.approx(
        float(casadi.Function("f", [nlp.v], [nlp.f])(point.v)), rel=1e-9
    )
    assert point.lam_v == pytest.approx(lam_v, abs=1e-6)
    assert point.lam_g == pytest.approx(lam_g, abs=1e-6)


def test_iterations_are_counted_limited_and_told(make: Made) -> None:
    told: list[Progress] = []

    def watch(now: Progress) -> bool:
        told.append(now)
        return False

    point = make()(programme(ROSENBROCK, a + b, rows=(-9, 9)), at(-1, 1.5), watch)
    assert point.stop is Stop.SOLVED
    assert point.iterations > 5
    assert len(told) >= point.iterations - 1
    assert {each.stage for each in told} == {make().name}
    last = told[-1].v
    assert last is not None
    assert last == pytest.approx(point.v, abs=1e-3)
    assert told[-1].objective == pytest.approx(point.objective, abs=1e-3)
    short = make().limited(3)
    for limited in (short, short.limited(50), short.within(1e-6)):
        point = limited(programme(ROSENBROCK), at(-1, 1.5))
        assert (point.stop, point.iterations) == (Stop.LIMIT, 3)


def test_a_watch_stops_it_and_what_it_raises_comes_out(make: Made) -> None:
    point = make()(programme(ROSENBROCK), at(-1, 1.5), lambda now: now.iteration >= 2)
    assert point.stop is Stop.INTERRUPTED
    assert point.iterations < 5

    def broken(_: Progress) -> bool:
        raise ZeroDivisionError("in the watch")

    with pytest.raises(ZeroDivisionError, match="in the watch"):
        make()(programme(ROSENBROCK), at(-1, 1.5), broken)


def test_ctrl_c_stops_a_solve(make: Made) -> None:
    """It comes from outside while the solver is at work, and the last iterate comes back."""
    seen = threading.Event()

    def interrupt() -> None:
        seen.wait(5)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)

    def watch(now: Progress) -> bool:
        if now.iteration == 2:
            seen.set()
            thread.join()
        return False

    thread.start()
    point = make()(programme(ROSENBROCK), at(-1, 1.5), watch)
    assert point.stop is Stop.INTERRUPTED
    assert np.isfinite(point.v).all()


def test_what_cannot_be_met_or_computed_is_said(make: Made) -> None:
    name = type(make()).__name__
    point = make()(programme(a, a**2 + b**2, rows=(-9, -1)), at(1, 1))
    assert (point.stop, point.message.partition(":")[0]) == (Stop.INFEASIBLE, name)
    point = make()(programme(casadi.log(a - 4) + b**2, box=(-9, 9)), at(0, 3))
    assert point.stop is Stop.FAILED
    assert "the objective is nan at the guess" in point.message


def test_a_tolerance_set_by_hand_stays(make: Made) -> None:
    name = {"ipopt": "tol", "uno": "dual_tolerance"}[make().name]
    start, nlp = at(-1, 1.5), programme(ROSENBROCK)
    rough = BACKENDS[make().name]({name: 0.5}).within(1e-11)(nlp, start)
    fine = make().within(1e-11)(nlp, start)
    assert rough.iterations < fine.iterations


def test_nothing_is_written_on_standard_output(
    make: Made, capfd: pytest.CaptureFixture[str]
) -> None:
    make()(programme(ROSENBROCK, a + b, ((1, -9), (1, 9)), (-9, 9)), at(-1, 1.5), silent)
    make()(programme(a, a**2 + b**2, rows=(-9, -1)), at(1, 1))
    assert capfd.readouterr().out == ""


def test_every_backend_certifies_along_a_word(make: Made, registry: Registry) -> None:
    problem: Problem = load_problem("auv", registry)
    method = build(registry.methods["lgr-multiphase"], [*WORD, ("backend", make().name)])
    solution = run(method, problem, default_guess(problem))
    assert solution.extremal
    assert solution.objective == pytest.approx(14.95016178215, abs=1e-8)
    assert solution.options["backend"] == make().name
    assert solution.message.lower().startswith(make().name)


def test_every_backend_searches(make: Made, registry: Registry) -> None:
    problem = load_problem("double_integrator_time", registry)
    method = build(registry.methods["auto"], [("backend", make().name)])
    solution = run(method, problem, default_guess(problem))
    assert solution.extremal
    assert solution.objective == pytest.approx(1 + np.sqrt(6), abs=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"backend": "unno"}, "lgr: backend: no backend 'unno'; did you mean 'uno'?"),
        ({"backend": "simplex"}, "lgr: backend: no backend 'simplex'; there are ipopt, uno"),
        ({"uno.TR_radius": "1"}, "lgr: uno: its backend is ipopt; add -o backend=uno"),
        (
            {"backend": "uno", "ipopt.tol": "1"},
            "lgr: ipopt: its backend is uno; add -o backend=ipopt",
        ),
        ({"un.TR_radius": "1"}, "lgr has no backend 'un'; did you mean 'uno'?"),
        (
            {"uno.TR_radiu": "1", "backend": "uno"},
            "uno has no option 'TR_radiu'; did you mean 'TR_radius'?",
        ),
        (
            {"backend": "uno", "uno.preset": "snopt"},
            "uno.preset: 'snopt' is not allowed; allowed: filtersqp, filterslp, funnelsqp, ipopt",
        ),
        ({"backend": "uno", "uno.max_iterations": "2.5"}, "allowed: a whole number"),
        ({"backend": "uno", "uno.primal_tolerance": "nan"}, "allowed: a number"),
        ({"backend": "uno", "uno.print_solution": "maybe"}, "allowed: yes or no"),
    ],
)
def test_wrong_backends_and_options_are_refused(
    given: dict[str, str], said: str, registry: Registry
) -> None:
    with pytest.raises(MethodError) as found:
        build(registry.methods["lgr"], given.items())
    assert said in str(found.value)


def test_options_of_the_chosen_backend_are_set_in_any_order(registry: Registry) -> None:
    given = [("uno.TR_radius", "1"), ("backend", "uno"), ("uno.preset", "funnelsqp")]
    for order in (given, given[::-1]):
        backend = getattr(build(registry.methods["lgr"], order), "backend")  # noqa: B009
        assert (type(backend), backend.options) == (Uno, {"TR_radius": 1, "preset": "funnelsqp"})


def test_uno_has_the_options_that_are_listed() -> None:
    """An option that Uno does not know is passed over by casadi without a word."""
    here = Path(casadi.__file__).parent.glob("*uno.*")
    library = ctypes.CDLL(str(next(each for each in here if each.name in _LIBRARIES)))
    library.uno_create_solver.restype = ctypes.c_void_p
    library.uno_get_solver_option_type.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    solver = library.uno_create_solver()
    kinds = [int, float, bool, str]
    for name, kind in KINDS.items():
        if name != "preset":  # a call of its own
            found = library.uno_get_solver_option_type(solver, name.encode())
            assert found >= 0, name
            assert kinds[found] is kind, name
    assert library.uno_get_solver_option_type(solver, b"no_such_option") == -1


@pytest.mark.parametrize("preset", ["filtersqp", "ipopt"])
def test_presets_of_uno_solve(preset: str) -> None:
    point = Uno({"preset": preset})(programme(ROSENBROCK, a + b, rows=(-9, 0.5)), at(-1, 1.5))
    assert point.stop is Stop.SOLVED
    assert point.lam_g == pytest.approx([0.727864], abs=1e-4)
