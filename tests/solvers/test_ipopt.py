"""The Ipopt backend: options, trace, stopping, interruption, and every way in which a solve can
fail.
"""

import math
import os
import signal
import threading
from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from socp_problems.auv import problem as auv

from socp.errors import MethodError, SolveError
from socp.methods.guess import default_guess
from socp.model.progress import Progress
from socp.model.result.solution import Stop
from socp.process import time_limit
from socp.solvers import documented
from socp.solvers.backends import ipopt as module
from socp.solvers.backends.ipopt import Ipopt
from socp.solvers.contract import NLP, NLPPoint
from socp.transcription.collocation import collocate
from socp.transcription.mesh import uniform
from socp.transcription.phases import single_phase
from socp.transcription.schemes import euler

a, b = casadi.SX.sym("a"), casadi.SX.sym("b")
v = casadi.vertcat(a, b)
INF = math.inf


def programme(
    f: Any, g: Any = None, *, low: float = -INF, high: float = INF, box: float = 10.0
) -> NLP:
    """Return: minimise f(a, b) with low <= g <= high and both variables within +-box."""
    rows = casadi.SX(0, 1) if g is None else casadi.vertcat(g)
    g_box = np.array([np.full(rows.numel(), low), np.full(rows.numel(), high)])
    v_box = np.array([[-box, -box], [box, box]])
    return NLP.of(
        v=v, f=casadi.SX(f), g=rows, v_box=v_box, g_box=g_box, binary=np.zeros(2, dtype=bool)
    )


def at(*values: float) -> NLPPoint:
    return NLPPoint(v=np.array(values))


rosenbrock = programme(
    (1 - a) ** 2 + 100 * (b - a**2) ** 2
)  # the minimum 0 at (1, 1) takes some 20 iterations


# -- solving


def test_a_quadratic_with_its_multipliers() -> None:
    # minimise a^2 + b^2 with a + b >= 2: at (1, 1), gradient 2 = -lam_g; lam_g <= 0 on a lower
    # bound
    point = Ipopt()(programme(a**2 + b**2, a + b, low=2.0), at(0, 5))
    assert point.stop is Stop.SOLVED
    assert point.message == "Ipopt: Solve Succeeded"
    np.testing.assert_allclose(point.v, [1, 1], atol=1e-8)
    assert point.objective == pytest.approx(2.0, abs=1e-8)
    np.testing.assert_allclose(point.lam_g, [-2.0], atol=1e-7)
    np.testing.assert_allclose(point.lam_v, [0.0, 0.0], atol=1e-7)


def test_a_multiplier_of_a_variable_bound_has_the_sign_of_its_side() -> None:
    point = Ipopt()(programme(a - 3 * b, box=2.0), at(0, 0))
    np.testing.assert_allclose(point.v, [-2, 2], atol=1e-8)
    np.testing.assert_allclose(point.lam_v, [-1, 3], atol=1e-6)


def test_every_iteration_is_traced() -> None:
    point = Ipopt()(rosenbrock, at(-1, 1.5))
    assert set(point.trace) == {
        "objective",
        "inf_pr",
        "inf_du",
        "mu",
        "step",
        "alpha_pr",
        "alpha_du",
    }
    lengths = {len(values) for values in point.trace.values()}
    assert lengths == {point.iterations + 1}
    assert point.iterations > 5
    assert point.trace["objective"][0] == pytest.approx(4 + 100 * 0.25)
    assert point.trace["objective"][-1] == point.objective
    assert point.trace["inf_du"][-1] <= 1e-9
    assert point.trace["mu"][0] > point.trace["mu"][-1] > 0
    assert all(0 < alpha <= 1 for alpha in point.trace["alpha_pr"][1:])
    assert set(point.seconds) == {"build", "solve"}


def test_multipliers_of_the_guess_start_it_warm() -> None:
    first = Ipopt()(rosenbrock, at(-1, 1.5))
    settings = {"warm_start_init_point": "yes", "mu_init": 1e-8, "warm_start_bound_push": 1e-9}
    assert Ipopt(settings)(rosenbrock, first).iterations < first.iterations / 2


# -- options


def banana() -> NLP:
    return programme((1 - a) ** 2 + 100 * (b - a**2) ** 2, a + b, low=0.0)


def test_a_programme_solved_again_goes_the_way_of_its_first_solve() -> None:
    again, starts = banana(), [(-1.0, 1.5), (2.0, 0.0), (-1.0, 1.5)]
    known = [Ipopt()(banana(), at(*start)) for start in starts]
    stopped = Ipopt()(again, at(0, 5), lambda now: now.iteration == 3)
    found = [Ipopt()(again, at(*start)) for start in starts]
    assert stopped.stop is Stop.INTERRUPTED
    for one, other in zip(known, found, strict=True):
        assert other.stop is Stop.SOLVED
        assert (other.iterations, other.trace) == (one.iterations, one.trace)
        np.testing.assert_array_equal(other.v, one.v)


def test_a_programme_is_set_up_anew_for_other_options_and_other_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[dict[str, Any]] = []
    real, short = casadi.nlpsol, Ipopt({"max_iter": 2})

    def counted(*given: Any) -> Any:
        made.append(given[-1])
        return real(*given)

    monkeypatch.setattr(casadi, "nlpsol", counted)
    nlp = banana()
    for _ in range(2):
        Ipopt()(nlp, at(0, 5))
    assert len(made) == 1
    short(nlp, at(0, 5))
    assert len(made) == 2
    for seconds, solves in ((1e3, 2), (1e2, 1), (1e3, 1)):
        with time_limit(seconds):
            for _ in range(solves):
                Ipopt()(nlp, at(0, 5))
    limits = [each["ipopt.max_wall_time"] for each in made[2:]]
    assert limits == pytest.approx([1e3, 1e2, 1e3], rel=1e-2)


def test_options_reach_ipopt_by_their_own_names() -> None:
    loose, sharp = (Ipopt(options={"tol": tol})(rosenbrock, at(-1, 1.5)) for tol in (1e-2, 1e-10))
    assert loose.iterations < sharp.iterations
    assert sharp.trace["inf_du"][-1] <= 1e-10


def test_bounds_are_kept_to_the_last_digit() -> None:
    # Ipopt's own bound_relax_factor of 1e-8 moves a >= 1 to 1 - 1e-8, and the objective 1e5 a by
    # 1e-3
    steep = programme(1e5 * a, a, low=1.0)
    ours = Ipopt()(steep, at(3, 3))
    its = Ipopt({"bound_relax_factor": 1e-8})(steep, at(3, 3))
    assert ours.objective >= 1e5 - 1e-8
    assert ours.objective == pytest.approx(1e5, abs=1e-4)
    assert its.objective < 1e5 - 5e-4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"toll": 1e-9}, "ipopt has no option 'toll'; did you mean 'tol'?"),
        ({"max_iters": 5}, "ipopt has no option 'max_iters'; did you mean 'max_iter'?"),
        ({"zzzzqqqq": 1}, "ipopt has no option 'zzzzqqqq'"),
        (
            {"tol": -1},
            "ipopt.tol: -1 is not allowed; allowed: real, 0 < tol and its default value is 1e-08",
        ),
        ({"tol": "small"}, "ipopt.tol: 'small' is not allowed; allowed: real, 0 < tol"),
        ({"tol": None}, "ipopt.tol: None is not allowed"),
        ({"tol": [1e-9]}, "ipopt.tol: [1e-09] is not allowed"),
        ({"tol": math.nan}, "ipopt.tol: nan is not allowed"),
        (
            {"max_iter": True},
            "ipopt.max_iter: True is not allowed; allowed: integer, 0 <= max_iter and its",
        ),
        ({"max_iter": 2.5}, "ipopt.max_iter: 2.5 is not allowed"),
        ({"max_iter": -3}, "ipopt.max_iter: -3 is not allowed"),
        (
            {"mu_strategy": "adaptiv"},
            "ipopt.mu_strategy: 'adaptiv' is not allowed; allowed: monotone, adaptive",
        ),
        ({"mu_strategy": 1}, "ipopt.mu_strategy: 1 is not allowed; allowed: monotone, adaptive"),
    ],
)
def test_wrong_options_are_refused(
    options: dict[str, Any], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(MethodError) as caught:
        Ipopt(options)
    assert str(caught.value).startswith(message)
    assert capfd.readouterr().out == ""


def test_the_defaults_need_no_probing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documented, "_probe", lambda _options: pytest.fail("probed"))
    Ipopt()


def test_every_default_is_an_option_that_ipopt_takes() -> None:
    assert Ipopt(module._DEFAULTS).options == module._DEFAULTS


def test_an_option_that_fails_only_at_the_solve_is_named() -> None:
    point = Ipopt({"nlp_scaling_method": "user-scaling"})(rosenbrock, at(0, 0))
    assert point.stop is Stop.FAILED
    assert "nlp_scaling_method=user-scaling" in point.message


@pytest.mark.slow
def test_a_linear_solver_that_does_not_work_here_is_refused_with_those_that_do() -> None:
    with pytest.raises(
        MethodError, match=r"no-such-library\.so: it cannot be loaded .*work here: .*mumps"
    ):
        Ipopt({"linear_solver": "ma57", "hsllib": "no-such-library.so"})


# -- stopping


class Recorder:
    """A watch that keeps what it saw and answers as it is told."""

    def __init__(self, stop_at: int = 10**9) -> None:
        self.seen: list[Progress] = []
        self.stop_at = stop_at

    def __call__(self, progress: Progress, /) -> bool:
        self.seen.append(progress)
        return progress.iteration >= self.stop_at


def test_a_watch_sees_every_iteration() -> None:
    watch = Recorder()
    bowl = programme(a**2 + b**2, a + b, low=2.0, high=2.0)
    point = Ipopt()(bowl, at(0, 5), watch)
    assert [progress.iteration for progress in watch.seen] == list(range(point.iterations + 1))
    assert tuple(progress.objective for progress in watch.seen) == point.trace["objective"]
    assert watch.seen[0].infeasibility == pytest.approx(3.0)
    assert watch.seen[-1].infeasibility < 1e-8
    assert {progress.stage for progress in watch.seen} == {"ipopt"}


def test_a_watch_without_constraints_sees_no_infeasibility() -> None:
    watch = Recorder()
    Ipopt()(rosenbrock, at(-1, 1.5), watch)
    assert {progress.infeasibility for progress in watch.seen} == {0.0}


def test_a_watch_can_stop_and_the_last_iterate_is_returned() -> None:
    watch = Recorder(stop_at=6)
    point = Ipopt()(rosenbrock, at(-1, 1.5), watch)
    assert point.stop is Stop.INTERRUPTED
    assert point.iterations == 6
    assert point.objective == watch.seen[-1].objective
    assert point.objective == pytest.approx(
        float((1 - point.v[0]) ** 2 + 100 * (point.v[1] - point.v[0] ** 2) ** 2)
    )
    assert point.objective < 29


class TroubleError(Exception):
    """What a watch of ours raises."""


@pytest.mark.parametrize("error", [TroubleError, KeyboardInterrupt, SystemExit])
def test_what_a_watch_raises_comes_out(error: type[BaseException]) -> None:
    def watch(progress: Progress, /) -> bool:
        if progress.iteration == 2:
            raise error("now")
        assert progress.iteration < 2, "the solve went on"
        return False

    with pytest.raises(error, match="now"):
        Ipopt()(rosenbrock, at(-1, 1.5), watch)


def test_ctrl_c_stops_with_the_last_iterate() -> None:
    def watch(progress: Progress, /) -> bool:
        if progress.iteration == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return False

    before = signal.getsignal(signal.SIGINT)
    point = Ipopt()(rosenbrock, at(-1, 1.5), watch)
    assert point.stop is Stop.INTERRUPTED
    assert 4 <= point.iterations <= 6
    assert np.abs(point.v - [-1, 1.5]).max() > 0.1
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
def test_ctrl_c_from_outside_stops_a_silent_solve() -> None:
    reduced = collocate(single_phase(auv), [uniform(euler(), 2000)])
    guess = reduced.push(default_guess(auv))
    endless = Ipopt({"tol": 1e-30, "acceptable_iter": 0, "max_iter": 10**6})
    timer = threading.Timer(5.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    point = endless(reduced.problem, guess)
    timer.join()
    assert point.stop is Stop.INTERRUPTED
    solution = reduced.lift(point)
    assert solution.stop is Stop.INTERRUPTED
    assert np.isfinite(solution.rows("x")).all()


def test_it_runs_outside_the_main_thread() -> None:
    found: list[NLPPoint] = []
    thread = threading.Thread(target=lambda: found.append(Ipopt()(rosenbrock, at(-1, 1.5))))
    thread.start()
    thread.join()
    assert found[0].stop is Stop.SOLVED


# -- failing


def test_an_infeasible_programme() -> None:
    point = Ipopt()(programme(a, a**2 + b**2, high=-1.0), at(1, 1))
    assert point.stop is Stop.INFEASIBLE
    assert point.message == "Ipopt: Infeasible Problem Detected"


def test_a_limit_of_iterations() -> None:
    point = Ipopt({"max_iter": 3})(rosenbrock, at(-1, 1.5))
    assert point.stop is Stop.LIMIT
    assert point.iterations == 3


def test_an_objective_that_is_not_finite_at_the_guess() -> None:
    point = Ipopt()(programme(casadi.log(a - 4) + b**2), at(0, 3))
    assert point.stop is Stop.FAILED
    assert point.message == (
        "Ipopt: Invalid Number Detected; the objective is nan at the guess; give a guess where "
        "it is finite"
    )
    assert math.isnan(point.objective)
    assert point.iterations == 0


def test_constraints_that_are_not_finite_at_the_guess() -> None:
    point = Ipopt()(programme(a**2, casadi.vertcat(b, casadi.sqrt(a - 4)), high=0.0), at(0, 3))
    assert point.stop is Stop.FAILED
    assert "1 of 2 constraints are not finite at the guess" in point.message


def test_a_guess_that_is_not_finite() -> None:
    point = Ipopt()(rosenbrock, at(math.nan, 3))
    assert point.stop is Stop.FAILED
    assert "the guess itself is not finite" in point.message


def test_what_casadi_cannot_build_is_a_solve_error() -> None:
    stranger = casadi.SX.sym("stranger")
    with pytest.raises(SolveError, match=r"^Ipopt could not be set up: .*stranger"):
        Ipopt()(programme(a**2 + stranger), at(0, 0))


def test_a_guess_of_the_wrong_size_is_a_solve_error() -> None:
    with pytest.raises(SolveError, match=r"^Ipopt could not run"):
        Ipopt()(rosenbrock, at(0, 0, 0))


def test_crossed_bounds_are_no_crash() -> None:
    crossed = replace(rosenbrock, v_box=np.array([[1.0, 1.0], [0.0, 2.0]]))
    with pytest.raises(SolveError, match=r"^Ipopt could not run"):
        Ipopt()(crossed, at(0, 0))
