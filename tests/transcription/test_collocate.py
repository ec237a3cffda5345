"""The transcription: push and lift are inverse, tables join, bounds and conditions stand where they
should.
"""

from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_schemes import FAMILIES, FIXED
from socp_problems.auv import problem as auv

from socp.errors import MethodError
from socp.methods.guess import default_guess, guess_of
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import controls, final_time, initial, initial_time, parameters, states, time
from socp.model.word import Word
from socp.solvers.contract import NLP, NLPPoint, Reduced
from socp.transcription.collocation import collocate
from socp.transcription.mesh import Mesh, Table, table, uniform
from socp.transcription.phases import PhasedProblem, follow, single_phase
from socp.transcription.schemes import Scheme, euler, hermite_simpson, lgr, radau_iia, trapezoid

x, y = states("x y")
v, w = controls("v w")
k = parameters("k")

rich = Problem(
    name="rich",
    minimise=final_time + initial(x) ** 2 + k,
    running=x**2 + v * time,
    dynamics={x: y * v + casadi.sin(x) + w, y: k * v - time * y},
    bounds={v: (-1, 2), w: (0, 1), y: (-3, 4), k: (0.5, 2)},
    start={x: (0, 1), y: 0},
    end={y: 1},
    target={"loop": x == initial(x), "long": initial_time + 1 <= final_time},
    path={"wall": x + k * time <= 9, "floor": x >= -8},
    initial_time=(-1, 1),
    final_time=(1, 20),
)
WORDS = [
    (rich, "v: *; w: *"),
    (rich, "v: * *; w: * *"),
    (rich, "v: + * -; w: - * +"),
    (rich, "v: * b[y.upper] *; w: * + *"),
    (rich, "v: b[y.upper] b[y.upper]; w: + -"),
    (auv, "r: + s s s +; f: + + b[u.upper] - -"),
    (auv, "r: * s; f: * *"),
]


@st.composite
def meshes(draw: st.DrawFn, count: int) -> list[Mesh]:
    found: list[Mesh] = []
    for _ in range(count):
        family = draw(
            st.sampled_from([*FAMILIES, *(lambda _, make=make: make() for make in FIXED)])
        )
        shares = draw(st.lists(st.floats(0.1, 10.0), min_size=1, max_size=4))
        found.append([(share, family(draw(st.integers(1, 8)))) for share in shares])
    return found


def transcribed(
    problem: Problem, word: str, on: list[Mesh]
) -> tuple[PhasedProblem, Reduced[NLP, Solution, NLPPoint]]:
    phased = follow(problem, Word.parse(word, problem.control_names))
    return phased, collocate(phased, on)


@given(st.data(), st.integers(0, len(WORDS) - 1), st.integers(0, 2**32 - 1))
def test_push_after_lift_is_the_identity(data: Any, choice: int, seed: int) -> None:
    problem, word = WORDS[choice]
    count = len(Word.parse(word, problem.control_names).arcs)
    _, reduced = transcribed(problem, word, data.draw(meshes(count)))
    random = np.random.default_rng(seed)
    point = random.normal(size=reduced.problem.v.numel())
    point[1 : 1 + count] = 10.0 ** random.uniform(-6, 2, count)  # phases have positive lengths
    pushed = reduced.push(reduced.lift(NLPPoint(v=point))).v
    np.testing.assert_allclose(pushed, point, rtol=1e-9, atol=1e-13 * np.abs(point).max())


@given(st.data(), st.integers(0, len(WORDS) - 1))
def test_a_phase_of_no_length_survives_the_way_up_and_down(data: Any, choice: int) -> None:
    problem, word = WORDS[choice]
    count = len(Word.parse(word, problem.control_names).arcs)
    _, reduced = transcribed(problem, word, data.draw(meshes(count)))
    point = np.arange(1.0, reduced.problem.v.numel() + 1.0)
    point[count] = 0.0
    pushed = reduced.push(reduced.lift(NLPPoint(v=point))).v
    np.testing.assert_allclose(pushed, point, rtol=1e-9)


@settings(max_examples=12)  # casadi's own derivatives, which these are held against, take long
@given(st.data(), st.integers(0, len(WORDS) - 1), st.integers(0, 2**32 - 1))
def test_derivatives_are_those_of_the_programme(data: Any, choice: int, seed: int) -> None:
    problem, word = WORDS[choice]
    phased = follow(problem, Word.parse(word, problem.control_names))
    near = data.draw(st.sampled_from([None, default_guess(problem)]))
    nlp = collocate(phased, data.draw(meshes(len(phased.phases))), near).problem
    assert nlp.derivatives is not None
    known, random = nlp.derivatives(), np.random.default_rng(seed)
    v, weight = random.normal(size=nlp.v.numel()), random.normal()
    held = random.normal(size=nlp.g.numel())
    lam = casadi.SX.sym("lam", held.size)
    lagrangian = weight * nlp.f + casadi.dot(lam, nlp.g)
    wanted = [nlp.f, nlp.g, casadi.gradient(nlp.f, nlp.v), casadi.jacobian(nlp.g, nlp.v)]
    wanted.append(casadi.triu(casadi.hessian(lagrangian, nlp.v)[0]))
    right = casadi.Function("right", [nlp.v, lam], wanted)(v, held)
    f, g = known.nlp(v, [])
    (_, gradient), (_, slopes) = known.grad_f(v, []), known.jac_g(v, [])
    found = [f, g, gradient, slopes, known.hess_lag(v, [], weight, held)]
    for ours, theirs in zip(found, right, strict=True):
        size = np.abs(theirs.full()).max(initial=1.0)
        np.testing.assert_allclose(ours.full(), theirs.full(), atol=1e-12 * size)
    assert slopes.nnz() == right[3].nnz()  # as sparse as the programme


def test_arcs_that_share_a_function_have_their_own_constants() -> None:
    bangs = follow(auv, Word.parse("r: + - +; f: + - -", auv.control_names))
    grids = [uniform(radau_iia(3), 2)] * 3  # of 6 collocated nodes each
    nlp = collocate(bangs, grids).problem
    free = collocate(single_phase(auv, 3), grids).problem
    assert nlp.derivatives is not None
    assert free.derivatives is not None
    v = np.random.default_rng(1).uniform(0.5, 1.5, nlp.v.numel())
    low, high = auv.box
    u = np.concatenate([np.tile(each, 6) for each in (high, low, [high[0], low[1]])])
    f, g = nlp.derivatives().nlp(v, [])
    wanted = free.derivatives().nlp(np.append(v, u), [])
    np.testing.assert_allclose(f.full(), wanted[0].full(), rtol=1e-14)
    np.testing.assert_allclose(g.full(), wanted[1].full(), atol=1e-14)


@pytest.mark.parametrize(
    "scheme", [euler(), radau_iia(3), lgr(3), trapezoid()], ids=lambda s: s.name
)
def test_a_jump_of_the_control_stays_on_its_side_on_a_finer_mesh(scheme: Scheme) -> None:
    coarse, fine = (collocate(single_phase(rich), [uniform(scheme, n)]) for n in (4, 8))
    solution = coarse.lift(coarse.push(default_guess(rich)))
    steps = np.repeat([[0.0], [1.0]], solution.arcs[0].t.size, axis=1)
    held = 0 if scheme.side == "left" else 1  # nodes of the second half of the horizon
    half = solution.arcs[0].mesh[2]
    steps[0, half + (held and scheme.side == "right") :] = 2.0
    jumped = replace(solution, arcs=(replace(solution.arcs[0], u=steps),))
    lifted = fine.lift(fine.push(jumped)).arcs[0]
    first = (
        lifted.u[0, : lifted.mesh[4]] if scheme.side != "both" else lifted.u[0, : lifted.mesh[3]]
    )
    second = lifted.u[0, lifted.mesh[4] + 1 :]
    np.testing.assert_allclose(first[:-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(second, 2.0, atol=1e-12)


def test_any_solution_is_a_guess_on_any_mesh_and_word() -> None:
    t = np.linspace(0, 4, 301)
    smooth = guess_of(
        rich, t, np.array([np.sin(t), t / 4]), np.array([np.cos(t), t / 8]), {"k": 1.5}
    )
    for word, count in (("v: *; w: *", 1), ("v: + * -; w: - * +", 3)):
        for scheme in (euler(), trapezoid(), lgr(6), radau_iia(6)):
            _, reduced = transcribed(rich, word, [uniform(scheme, 3)] * count)
            up = reduced.lift(reduced.push(smooth))
            assert up.parameters == {"k": 1.5}
            assert (up.initial_time, up.final_time) == (0.0, pytest.approx(4.0))
            np.testing.assert_allclose(up.rows("x")[0], np.sin(up.t), atol=1e-4)
            np.testing.assert_allclose(up.rows("x")[1], up.t / 4, atol=1e-4)


def test_a_guess_of_another_problem_is_refused() -> None:
    other = Problem(name="other", minimise=x, dynamics={x: v}, bounds={v: (0, 1)}, final_time=1)
    reduced = collocate(single_phase(rich), [uniform(euler(), 3)])
    with pytest.raises(MethodError, match=r"guess: it has states x, but problem 'rich' has x, y"):
        reduced.push(default_guess(other))


# -- tables


@given(st.data())
def test_a_table_differentiates_and_integrates_piecewise(data: Any) -> None:
    (mesh,) = data.draw(meshes(1))
    joined = table(mesh)
    shares = np.array([share for share, _ in mesh])
    shares /= shares.sum()
    ends = np.append(0.0, np.cumsum(shares))
    np.testing.assert_allclose(joined.tau[joined.mesh], ends, atol=1e-15)
    assert (np.diff(joined.tau) > 0).all()
    assert joined.weights.sum() == pytest.approx(1.0)
    left = ends[:-1] + shares / 2 * np.array([s.weights @ (s.nodes + 1) / 2 for _, s in mesh])
    assert joined.weights @ joined.tau == pytest.approx(shares @ left)  # interval by interval
    np.testing.assert_allclose(
        joined.A.array() @ joined.tau, joined.B.array() @ np.ones(joined.tau.size), atol=1e-12
    )
    assert joined.A.shape == joined.B.shape == (joined.tau.size - 1, joined.tau.size)
    assert (joined.weights[joined.collocated] > 0).all()


def test_neighbours_share_the_node_between_them() -> None:
    joined = table([(1, lgr(3)), (3, lgr(2)), (4, lgr(5))])
    np.testing.assert_array_equal(joined.mesh, [0, 3, 5, 10])
    np.testing.assert_allclose(joined.tau[joined.mesh], [0, 1 / 8, 1 / 2, 1])
    assert joined.collocated.tolist() == list(range(10))
    assert table([(1, trapezoid())] * 3).weights == pytest.approx([1 / 6, 1 / 3, 1 / 3, 1 / 6])
    assert table([(1, euler())] * 2).collocated.tolist() == [1, 2]


def edges_by_hand(joined: Table, dense: np.ndarray, last: int) -> np.ndarray:
    found = np.zeros((dense.shape[0], joined.mesh.size - 1))
    for j, (a, b) in enumerate(zip(joined.mesh[:-1], joined.mesh[1:], strict=True)):
        found[a:b, j] = dense[a:b, b if last else a]
    return found


@pytest.mark.parametrize(
    "scheme", [euler(), hermite_simpson(), lgr(3), radau_iia(2)], ids=lambda s: s.name
)
@pytest.mark.parametrize("last", [0, 1])
def test_what_a_table_says_of_the_edges_of_its_intervals(scheme: Scheme, last: int) -> None:
    joined = table([(1, scheme), (2, scheme), (1.5, scheme)])
    for matrix, edge in zip((joined.A, joined.B), joined.at_edges[last], strict=True):
        by_hand = edges_by_hand(joined, matrix.array(), last)
        np.testing.assert_array_equal(edge.array(), by_hand)
    total = np.zeros(joined.tau.size)
    total[joined.mesh[:-1]] += joined.edges[0]
    total[joined.mesh[1:]] += joined.edges[1]
    np.testing.assert_allclose(total[joined.mesh], joined.weights[joined.mesh])


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ([], "a phase needs at least one interval"),
        (
            [(0.0, euler())],
            "an interval has share 0.0 of its phase where a positive number is needed",
        ),
        ([(-1.0, euler())], "share -1.0"),
        ([(float("nan"), euler())], "share nan"),
        (
            [(1, lgr(3)), (1, radau_iia(3))],
            "LGR 3 and Radau IIA 3 collocate different ends; use one of them",
        ),
    ],
)
def test_meshes_that_fit_nothing_are_refused(mesh: Mesh, message: str) -> None:
    with pytest.raises(MethodError) as caught:
        table(mesh)
    assert message in str(caught.value)


def test_counts_that_fit_nothing_are_refused() -> None:
    with pytest.raises(MethodError, match=r"mesh: 0 intervals where 1 or more are needed"):
        uniform(euler(), 0)
    with pytest.raises(MethodError, match=r"2 meshes for 1 phases; give one mesh a phase"):
        collocate(single_phase(rich), [uniform(euler(), 3)] * 2)


# -- the programme


def residuals(nlp: NLP, v_: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    g = casadi.Function("g", [nlp.v], [nlp.g])(v_).full().ravel()
    return g, np.maximum(nlp.g_box[0] - g, g - nlp.g_box[1])


oscillator = Problem(
    name="oscillator",
    minimise=x,
    running=y**2,
    dynamics={x: y, y: v - x},
    bounds={v: (-1, 1)},
    start={x: 1, y: 0},
    final_time=2,
)


def test_the_exact_motion_has_no_defect_and_its_cost() -> None:
    # u = 0: x = cos t, y = -sin t; integral of sin^2 over [0, 2] = 1 - sin(4) / 4
    t = np.linspace(0, 2, 4001)
    motion = guess_of(oscillator, t, np.array([np.cos(t), -np.sin(t)]), np.zeros((1, t.size)))
    reduced = collocate(single_phase(oscillator, 2), [uniform(lgr(10), 2)] * 2)
    nlp, point = reduced.problem, reduced.push(motion)
    g, violation = residuals(nlp, point.v)
    assert violation.max() < 1e-5  # the guess is piecewise linear
    cost = float(casadi.Function("f", [nlp.v], [nlp.f])(point.v))
    assert cost == pytest.approx(np.cos(2) + 1 - np.sin(4) / 4, abs=1e-6)
    assert g.size == 2 * 40 + 1  # defects of two states, and the final time


def test_an_objective_that_a_law_leaves_nothing_of_is_a_number_all_the_same() -> None:
    still = replace(oscillator, minimise=0, running=v, bounds={v: (0, 1)})
    phased = follow(still, Word.parse("v: -", still.control_names))
    nlp = collocate(phased, [uniform(lgr(2), 2)]).problem
    assert nlp.derivatives is not None
    at = np.ones(nlp.count)
    (f, _), (_, gradient) = nlp.derivatives().nlp(at, []), nlp.derivatives().grad_f(at, [])
    assert f.is_dense()
    assert gradient.is_dense()
    assert nlp.f.is_dense()
    assert [float(f), *gradient.elements()] == [0.0] * (1 + nlp.count)


def test_times_parameters_and_bounds_stand_in_the_programme() -> None:
    nlp = collocate(single_phase(rich, 2), [uniform(trapezoid(), 2)] * 2).problem
    low, high = nlp.v_box
    assert (low[0], high[0]) == (-1, 1)  # initial time
    assert low[1:3].tolist() == [0, 0]  # lengths
    assert np.isinf(high[1:3]).all()
    assert (low[3], high[3]) == (0.5, 2)  # parameter
    states_low, states_high = (row[4:14].reshape(5, 2) for row in (low, high))
    assert states_low[:, 0].tolist() == [0, -np.inf, -np.inf, -np.inf, -np.inf]
    assert states_high[:, 0].tolist() == [1, np.inf, np.inf, np.inf, np.inf]
    assert states_low[:, 1].tolist() == [0, -3, -3, -3, 1]
    assert states_high[:, 1].tolist() == [0, 4, 4, 4, 1]
    assert low[14:].tolist() == [-1, 0] * 6
    assert high[14:].tolist() == [2, 1] * 6
    assert nlp.g_box.shape == (
        2,
        2 * 4 + 2 * 5 + 2 + 1,
    )  # defects, path constraints, targets, final time
    assert nlp.g_box[:, -1].tolist() == [1, 20]
    assert not nlp.binary.any()


def test_a_fixed_length_is_a_number_a_bounded_final_time_a_row_and_a_free_one_is_none() -> None:
    given = []
    for last in (7.0, (3.0, 9.0), (-np.inf, np.inf)):
        problem = replace(oscillator, final_time=last)
        given.append(collocate(single_phase(problem), [uniform(euler(), 3)]).problem)
    assert [each.rows for each in given] == [6, 7, 6]
    assert [each.v_box[:, 1].tolist() for each in given] == [[7, 7], [0, np.inf], [0, np.inf]]
    assert given[1].g_box[:, -1].tolist() == [3, 9]
    two = single_phase(replace(oscillator, final_time=7.0), 2)
    both = collocate(two, [uniform(euler(), 3)] * 2).problem
    assert both.g_box[:, -1].tolist() == [7, 7]  # their lengths add up to it


def test_bounds_are_released_on_the_closed_boundary_arc_alone() -> None:
    phased, reduced = transcribed(
        rich, "v: * b[y.upper] *; w: * * *", [uniform(trapezoid(), 2)] * 3
    )
    assert [phase.kept for phase in phased.phases] == [
        frozenset(),
        frozenset({"y.upper"}),
        frozenset(),
    ]
    nodes = 7
    low, high = (row[5 : 5 + 2 * nodes].reshape(nodes, 2)[:, 1] for row in reduced.problem.v_box)
    assert high.tolist() == [0, 4, np.inf, np.inf, np.inf, 4, 1]
    assert low.tolist() == [0, -3, -3, -3, -3, -3, 1]


def test_a_boundary_arc_is_entered_once() -> None:
    phased, reduced = transcribed(
        rich, "v: * b[y.upper] b[y.upper] *; w: * + - *", [uniform(trapezoid(), 1)] * 4
    )
    assert [len(phase.entry) for phase in phased.phases] == [0, 1, 0, 0]
    assert reduced.problem.g_box.shape[1] == 2 * 4 + 2 * 5 + 1 + 2 + 1


def test_path_constraints_are_known_by_name_in_the_solution() -> None:
    _, reduced = transcribed(rich, "v: *; w: *", [uniform(trapezoid(), 4)])
    nlp = reduced.problem
    point = reduced.push(default_guess(rich))
    lam_g = np.zeros(nlp.g_box.shape[1])
    lam_g[8 : 8 + 5] = 2.0  # after 2 x 4 defects come the five rows of "wall"
    marked = replace(point, lam_g=lam_g, lam_v=np.zeros(nlp.v.numel()))
    (arc,) = reduced.lift(marked).arcs
    assert list(arc.multipliers) == ["y.lower", "y.upper", "wall", "floor"]
    h = (arc.t[-1] - arc.t[0]) / 4
    np.testing.assert_allclose(arc.multipliers["wall"], 2.0 / (h * np.array([0.5, 1, 1, 1, 0.5])))
    np.testing.assert_allclose(arc.multipliers["floor"], 0.0)


def test_a_node_shared_by_two_phases_has_one_density() -> None:
    _, reduced = transcribed(rich, "v: * *; w: * *", [uniform(trapezoid(), 1)] * 2)
    point = reduced.push(default_guess(rich))
    point.v[1:3] = 1.0, 3.0
    lam_g = np.zeros(reduced.problem.g_box.shape[1])
    lam_g[4 : 4 + 3] = 1.0, 4.0, 3.0
    before, after = reduced.lift(replace(point, lam_g=lam_g, lam_v=np.zeros(point.v.size))).arcs
    np.testing.assert_allclose(before.multipliers["wall"], [1 / 0.5, 4 / (0.5 + 1.5)])
    np.testing.assert_allclose(after.multipliers["wall"], [4 / (0.5 + 1.5), 3 / 1.5])


def test_without_multipliers_costates_are_unknown() -> None:
    _, reduced = transcribed(rich, "v: *; w: *", [uniform(lgr(3), 2)])
    (arc,) = reduced.lift(reduced.push(default_guess(rich))).arcs
    assert np.isnan(arc.costate).all()
    assert arc.multipliers == {}


def test_the_number_of_functions_built_does_not_grow_with_the_mesh(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    build, built = casadi.Function, []

    def counted(*arguments: Any) -> Any:
        built.append(arguments[0])
        return build(*arguments)

    monkeypatch.setattr(casadi, "Function", counted)
    counts, sizes = [], []
    for steps in (5, 500):
        built.clear()
        nlp = collocate(single_phase(rich), [uniform(trapezoid(), steps)]).problem
        counts.append(len(built))
        sizes.append(casadi.jacobian_sparsity(nlp.g, nlp.v).nnz())
    assert counts[0] == counts[1] <= 6
    assert sizes[1] < 101 * sizes[0]  # and the programme is as sparse as the mesh is local
