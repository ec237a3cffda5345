"""Proved minima of words: curvatures in closed form, saddles and wrong signs refused, and what the
numeric second order says.
"""

import numpy as np
import pytest
from saddles import HORIZON, along, held, saddle, thrown
from scipy.integrate import quad
from scipy.optimize import brentq
from test_prove import PROBLEMS, solved

from socp import (
    Problem,
    Solution,
    controls,
    default_guess,
    run,
    states,
)
from socp.model import Rung
from socp.model.data.files import from_json, to_json
from socp.proof import Existence, induced, prove
from socp.proof.balls import flint, precision
from socp.proof.minimum import definite
from socp.registry import Registry
from socp.verdict.minimum.order import second_order
from socp.view.ladder import rung_texts


def least(proof: Existence) -> float:
    assert proof.holds, f"{proof.step}: {proof.reason}"
    assert not proof.minimum.reason, proof.minimum.reason
    assert proof.minimum.least is not None
    return proof.minimum.least


@pytest.mark.parametrize("k", [-3.0, -1.0, -0.5])
def test_a_minimum_of_the_saddle_family_in_closed_form(k: float) -> None:
    """J''(s) = 2 (1 - 2 k); with both lengths moved by T / sqrt 2 that is 9 (1 - 2 k)."""
    switch = HORIZON * (k - 1) / (2 * k - 1)
    problem = saddle(k)
    proof = prove(problem, held(problem, "u: + -", [switch, HORIZON - switch]))
    assert proof.minimum.free == 1
    assert least(proof) == pytest.approx(9 * (1 - 2 * k), rel=1e-6)
    assert least(proof) < 9 * (1 - 2 * k)
    assert [each.rung for each in proof.rungs(solved("jacobson_1"))] == [Rung.EXISTS, Rung.WORD]


@pytest.mark.parametrize("k", [1.5, 2.0, 5.0])
def test_a_maximum_of_the_saddle_family_is_refused_with_its_curvature(k: float) -> None:
    switch = HORIZON * (k - 1) / (2 * k - 1)
    problem = saddle(k)
    solution = held(problem, "u: + -", [switch, HORIZON - switch])
    proof = prove(problem, solution)
    assert proof.holds
    assert proof.minimum.least is None
    assert "it is none: the curvature along a direction is at most" in proof.minimum.reason
    told = float(proof.minimum.reason.split("at most ")[1])
    assert told == pytest.approx(9 * (1 - 2 * k), rel=1e-3)
    assert [each.rung for each in proof.rungs(solution)] == [Rung.EXISTS]


def test_where_the_curvature_is_zero_nothing_is_proved() -> None:
    """With k = 1/2 and 3/2 x(3) the objective is the same for every switch: there is no single
    extremal.
    """
    problem = saddle(0.5, tilt=1.5)
    proof = prove(problem, held(problem, "u: + -", [1.2, 1.8]))
    assert not proof.holds
    assert proof.minimum.text == "not proved: no extremal is proved to exist"


def test_the_hessian_of_a_word_in_closed_form() -> None:
    """Lengths are measured in the horizon, the initial speed in the largest one, 3."""
    problem = thrown()
    proof = prove(problem, along(problem, "u: + -", [2.0, 1.0]))
    units = np.array([HORIZON / np.sqrt(2), 3.0])
    wanted = np.array([[8.8, 3.2], [3.2, 4.8]]) * units[:, None] * units
    assert proof.minimum.free == 2
    assert least(proof) == pytest.approx(np.linalg.eigvalsh(wanted)[0], rel=1e-6)


@pytest.mark.parametrize("name", ["jacobson_1", "vdp_regulator"])
def test_singular_arcs_agree_with_the_numeric_second_order(name: str) -> None:
    agrees(PROBLEMS[name], solved(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["catalyst_mixing", "fishery_discounted", "goddard_vlimit"])
def test_more_arcs_agree_with_the_numeric_second_order(name: str) -> None:
    agrees(PROBLEMS[name], solved(name), 1e-2)


def agrees(problem: Problem, solution: Solution, off: float = 2e-4) -> None:
    found = second_order(problem, solution).word
    assert found is not None
    proof = prove(problem, solution)
    assert proof.minimum.free == found.free
    assert least(proof) == pytest.approx(found.least, rel=off)


def test_a_boundary_arc_along_a_bent_constraint() -> None:
    """The multipliers of where it begins weigh the second derivatives of the constraint."""
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="bent",
        minimise=-x + v**2,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        path={"c": v + 0.2 * x**2 <= 1},
        final_time=3,
    )
    agrees(problem, along(problem, "u: + b -", [0.96, 1.76, 0.28]))


@pytest.mark.slow
def test_a_law_that_carries_a_costate_in_closed_form() -> None:
    """Integral of (x^2 + y^2) / 2 with x' = u, y' = x and the integral of x^2 / 2 given: on the
    singular arc u = y / (1 + eta), eta the constant costate of z. From rest at y = 1, the word `-
    s` is a family in (s, eta), and a curve of it meets the condition.
    """
    x, y, z = states("x y z")
    u = controls("u")
    problem = Problem(
        name="isoperimetric",
        running=(x**2 + y**2) / 2,
        dynamics={x: u, y: x, z: x**2 / 2},
        bounds={u: (-1, 1)},
        start={x: 0, y: 1, z: 0},
        end={z: 0.1},
        final_time=HORIZON,
    )
    solution = run(Registry.load().method("auto")(), problem, default_guess(problem))
    s, h = float(solution.junctions[0]), 1e-3
    points = [isoperimetric(s + k * h) for k in (-1, 0, 1)]
    bent = (points[0][0] - 2 * points[1][0] + points[2][0]) / h**2
    turned = (points[2][1] - points[0][1]) / (2 * h)
    proof = prove(problem, solution)
    assert points[1][0] == pytest.approx(solution.objective, abs=1e-9)
    assert proof.minimum.free == 1
    assert least(proof) == pytest.approx(bent / (2 / HORIZON**2 + turned**2), rel=1e-3)


def energy(t: float, w: float, a: float, b: float) -> float:
    return float((a * np.cosh(w * t) + b * np.sinh(w * t)) ** 2 / 2)


def isoperimetric(s: float) -> tuple[float, float]:
    """Return the objective with the switch at s, and eta so that z(T) = 1/10."""
    left = HORIZON - s

    def integrals(eta: float) -> tuple[float, float]:
        w = (1 + eta) ** -0.5
        a, b = 1 - s**2 / 2, -s / w  # y = a cosh w t + b sinh w t, x = y'
        both = [quad(energy, 0, left, (w, *its))[0] for its in ((w * b, w * a), (a, b))]
        return s**3 / 6 + both[0], s**3 / 6 + (s - s**3 / 3 + s**5 / 20) / 2 + sum(both)

    eta = brentq(lambda e: integrals(e)[0] - 0.1, 1.0, 2.0, xtol=1e-14)
    return integrals(eta)[1], float(eta)


def test_where_no_direction_is_free_the_word_has_no_neighbours() -> None:
    problem = PROBLEMS["double_integrator_time"]
    solution = solved("double_integrator_time")
    proof = prove(problem, solution)
    assert (proof.minimum.free, proof.minimum.least, proof.minimum.reason) == (0, None, "")
    proved = from_json(to_json(solution.with_judgement(proofs=proof.rungs(solution))))
    texts = {rung: said for rung, _, said in rung_texts(proved)}
    told = "local minimum of the word (proved): no direction is free"
    assert texts["strict local minimum among controls of its word, proved"] == told


def test_a_wrong_sign_of_the_hessian_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    right = induced.Induced.curvature
    monkeypatch.setattr(induced.Induced, "curvature", lambda self, kernel: -right(self, kernel))
    proof = prove(PROBLEMS["jacobson_1"], solved("jacobson_1"))
    assert proof.holds
    assert proof.minimum.reason.startswith("it is none")
    assert [each.rung for each in proof.rungs(solved("jacobson_1"))] == [Rung.EXISTS]


@pytest.mark.parametrize(
    ("entries", "wanted"),
    [
        ([2, -1, -1, 2], True),
        ([1, 2, 2, 1], False),
        ([-1, 0, 0, 1], False),
        ([1, 1, 1, 1], False),
        ([0, 0, 0, 1], False),
    ],
)
def test_pivots_tell_definite_matrices(entries: list[int], wanted: bool) -> None:
    with precision(64):
        module = flint()
        assert definite(module.arb_mat(2, 2, entries)) is wanted
        wide = [module.arb(each, 2) for each in entries]
        assert not definite(module.arb_mat(2, 2, wide))
