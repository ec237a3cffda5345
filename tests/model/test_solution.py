"""Solutions: evaluation, and the result file that reads back bit for bit or is refused by name."""

import errno
import itertools
import json
import math
import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from records import built
from socp_problems.auv import problem as auv

from socp.errors import SolveError
from socp.model.data.files import from_json, load, save, to_json
from socp.model.result.arc import Arc
from socp.model.result.findings import Feasibility
from socp.model.result.records import Effort, Judgement, Origin
from socp.model.result.solution import Solution, Stop
from socp.transcription.collocation import collocate
from socp.transcription.mesh import table, uniform
from socp.transcription.phases import single_phase
from socp.transcription.schemes import euler, hermite_simpson, lgr, radau_iia, trapezoid


def arc_of(scheme: Any, shares: list[float], span: tuple[float, float], **values: Any) -> Arc:
    """Return an arc on a mesh with x and u given as functions of time."""
    joined = table([(share, scheme) for share in shares])
    t = span[0] + (span[1] - span[0]) * joined.tau
    x, u = (np.atleast_2d(np.array(values[name](t), dtype=float)) for name in ("x", "u"))
    unknown, modes = np.full_like(x, np.nan), ("*",) * len(u)
    return Arc(t=t, x=x, u=u, costate=unknown, mesh=joined.mesh, side=joined.side, modes=modes)


def solution_of(*arcs: Arc, **changes: Any) -> Solution:
    names = {
        f"{kind}_names": tuple(f"{kind[0]}{k}" for k in range(len(getattr(arcs[0], which))))
        if arcs
        else ()
        for kind, which in (("state", "x"), ("control", "u"))
    }
    parts: dict[str, Any] = {
        "problem": "p",
        "method": "m",
        "arcs": arcs,
        "objective": 1.0,
        "stop": Stop.SOLVED,
    }
    return built(**parts | names | changes)


# -- evaluation


@pytest.mark.parametrize(
    "scheme", [hermite_simpson(), lgr(3), radau_iia(5), lgr(20)], ids=lambda s: s.name
)
def test_evaluation_is_exact_for_the_polynomials_a_scheme_holds(scheme: Any) -> None:
    degree = min(scheme.nodes.size - 1, 3)
    solution = solution_of(
        arc_of(scheme, [1, 3, 2], (1, 2.5), x=lambda t: t**degree, u=lambda t: 1 + t)
    )
    t = np.linspace(1, 2.5, 97)
    np.testing.assert_allclose(solution.at(t), [t**degree], rtol=1e-13)
    np.testing.assert_allclose(solution.at(t, "u"), [1 + t], rtol=1e-13)


def test_values_are_right_continuous_at_switches_and_clipped_at_the_ends() -> None:
    first = arc_of(lgr(3), [1], (0, 1), x=lambda t: t, u=lambda t: 0 * t - 1)
    second = arc_of(lgr(3), [1], (1, 3), x=lambda t: t, u=lambda t: 0 * t + 2)
    solution = solution_of(first, second)
    assert solution.at([0.5, 1 - 1e-12, 1.0, 1.5], "u").tolist() == [[-1, -1, 2, 2]]
    assert solution.at([-5.0, 99.0], "x").tolist() == [[0, 3]]
    assert solution.at([1.0], "u", [1 - 1e-9]).tolist() == [[-1]]
    assert (solution.initial_time, solution.final_time) == (0, 3)
    assert solution.at(0.5).shape == (1, 1)


def test_a_control_may_jump_where_intervals_meet() -> None:
    steps = arc_of(euler(), [1, 1, 2], (0, 4), x=lambda t: t, u=np.ceil)
    assert steps.u[0].tolist() == [0, 1, 2, 4]
    solution = solution_of(steps)
    assert solution.at([0.0, 0.5, 1.0, 1.5, 2.0, 3.9, 4.0], "u").tolist() == [[1, 1, 2, 2, 4, 4, 4]]


def test_total_variation_counts_jumps_once_and_slopes_in_full() -> None:
    first = arc_of(euler(), [1, 1], (0, 2), x=lambda t: t, u=lambda t: np.array([t, -t]))
    second = arc_of(
        trapezoid(), [1, 1], (2, 4), x=lambda t: t, u=lambda t: np.array([5 - t, 0 * t])
    )
    variation = solution_of(first, second).total_variation()
    # u1: steps 1, 2, then 3 down to 1; u2: steps -1, -2, then 0
    np.testing.assert_allclose(variation, [1 + 1 + 2, 1 + 2])


def test_what_a_continued_solve_took_is_added_up() -> None:
    arc = arc_of(euler(), [1], (0, 1), x=lambda t: t, u=lambda t: t)
    one = solution_of(
        arc, seconds={"build": 1.0, "solve": 2.0}, iterations=3, trace={"objective": (4.0, 5.0)}
    )
    two = solution_of(arc, seconds={"solve": 10.0}, iterations=4, trace={"objective": (6.0,)})
    both = two.after(one)
    assert (both.seconds, both.effort.iterations) == ({"build": 1.0, "solve": 12.0}, 7)
    assert both.effort.trace == {"objective": (4.0, 5.0, 6.0)}


def test_switches_and_word_come_from_the_structure() -> None:
    arc = arc_of(euler(), [1], (0, 3), x=lambda t: t, u=lambda t: t)
    structure = {
        "r": (("+", 0.0, 1.0), ("s", 1.0, 3.0)),
        "f": (("+", 0.0, 1.0 + 1e-15), ("b[wall]", 1.0 + 1e-15, 3.0)),
    }
    solution = solution_of(arc, structure=structure)
    assert solution.word == "r: + s; f: + b[wall]"
    assert solution.switches == [1.0]


def test_a_feasibility_that_could_not_be_computed_is_not_feasible() -> None:
    fine = Feasibility(
        miss=1e-9, miss_at="x", path=2e-9, path_at="", box=0.0, drift=1.0, feedback=False
    )
    assert fine.worst == 2e-9
    assert replace(fine, error="broke down").worst == math.inf
    assert replace(fine, miss=math.nan).worst == math.inf


# -- the result file

number = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(allow_nan=False, allow_infinity=False)
value = st.one_of(st.floats(-1e150, 1e150), st.sampled_from([math.nan, math.inf, -math.inf]))
text = st.text(st.characters(codec="utf-8"), max_size=8)
printable = st.characters(codec="utf-8", exclude_categories=("C", "Z"), include_characters=" ")
name = st.text(printable, min_size=1, max_size=8)  # drawn printable: a filter throws most away


plain = st.one_of(st.none(), st.booleans(), st.integers(), finite, text)


@st.composite
def arcs(draw: st.DrawFn, states: int, controls: int, span: tuple[float, float]) -> Arc:
    scheme = draw(st.sampled_from([euler(), trapezoid(), lgr(2), radau_iia(3)]))
    joined = table([(1.0, scheme)] * draw(st.integers(1, 3)))
    n = joined.tau.size

    inner = st.lists(st.floats(*span), min_size=n - 2, max_size=n - 2)

    def matrix(rows: int) -> np.ndarray:
        return np.array(
            draw(st.lists(value, min_size=rows * n, max_size=rows * n)), dtype=float
        ).reshape(rows, n)

    return Arc(
        t=np.array([span[0], *sorted(draw(inner)), span[1]]),
        x=matrix(states),
        u=matrix(controls),
        costate=matrix(states),
        mesh=joined.mesh,
        side=joined.side,
        modes=("*",) * controls,
        multipliers={name: matrix(1)[0] for name in draw(st.lists(name, max_size=2, unique=True))},
    )


@st.composite
def solutions(draw: st.DrawFn) -> Solution:
    states, controls = draw(st.integers(1, 3)), draw(st.integers(0, 2))
    names = draw(
        st.lists(name, min_size=states + controls + 2, max_size=states + controls + 2, unique=True)
    )
    corners = sorted(draw(st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=4, unique=True)))
    figures = {name: draw(number) for name in ("miss", "path", "box", "drift")}
    seen = Feasibility(
        **figures, miss_at=draw(text), path_at="", feedback=draw(st.booleans()), error=draw(text)
    )
    ends = st.tuples(finite, finite).map(sorted)
    stretch = st.tuples(st.sampled_from(["+", "s", "b[wall]"]), ends).map(
        lambda each: (each[0], *each[1])
    )
    row = st.lists(stretch, min_size=1, max_size=3).map(tuple)
    return built(
        problem=draw(name),
        method=draw(name),
        objective=draw(number),
        stop=draw(st.sampled_from(Stop)),
        message=draw(text),
        verified=(seen,) * draw(st.integers(0, 2)),
        arcs=tuple(draw(arcs(states, controls, span)) for span in itertools.pairwise(corners)),
        state_names=tuple(names[:states]),
        control_names=tuple(names[states:-2]),
        parameters={
            each: draw(st.floats(-1e150, 1e150))
            for each in names[len(names) - draw(st.integers(0, 2)) :]
        },
        seconds=draw(st.dictionaries(text, number, max_size=2)),
        options=draw(st.dictionaries(text, plain, max_size=3)),
        versions=draw(st.dictionaries(text, text, max_size=2)),
        iterations=draw(st.integers(0, 10**6)),
        trace=draw(st.dictionaries(text, st.lists(number, max_size=4).map(tuple), max_size=2)),
        structure=draw(st.sampled_from([{}, {each: draw(row) for each in names[states:-2]}])),
    )


def bits(value: Any) -> Any:
    """Return a value with every float as its eight bytes, nan as nan, records by their fields."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind, value.shape, bits(value.tolist())
    if isinstance(value, float):
        return "nan" if math.isnan(value) else value.hex()
    if isinstance(value, (list, tuple)):
        return type(value).__name__, [bits(each) for each in value]
    if isinstance(value, (Arc, Effort, Feasibility, Judgement, Origin, Solution)):
        return {each.name: bits(getattr(value, each.name)) for each in fields(value)}
    return {key: bits(each) for key, each in value.items()} if isinstance(value, dict) else value


@given(solutions())
def test_what_is_read_is_what_was_written_bit_for_bit(solution: Solution) -> None:
    assert bits(from_json(to_json(solution))) == bits(solution)


@given(solutions())
def test_the_file_is_strict_json(solution: Solution) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    document = json.loads(to_json(solution), parse_constant=refuse)
    assert document["schema"] == 3
    assert document["switches"] == solution.switches
    assert document["word"] == solution.word


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "toy.socp.json"
    save(solution_of(arc_of(lgr(3), [1, 1], (0, 1), x=lambda t: t, u=lambda t: -t)), path)
    return path


def test_save_and_load(saved: Path) -> None:
    assert to_json(load(saved)) + "\n" == saved.read_text()
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_numpy_scalars_are_written_as_numbers() -> None:
    arc = arc_of(euler(), [1], (0, 1), x=lambda t: t, u=lambda t: t)
    solution = solution_of(
        arc, options={"steps": np.int64(3), "tol": np.float64(1e-9)}, objective=np.float64(2)
    )
    assert from_json(to_json(solution)).options == {"steps": 3, "tol": 1e-9}


def altered(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 4}, "not a socp result: schema: 4; this socp reads schemas 1, 2 and 3"),
        ({"stop": "WON"}, "not a socp result: stop: 'WON'; there are SOLVED, ACCEPTABLE"),
        ({"arcs": []}, "not a socp result: arcs: expected 'array' of length >= 1"),
        ({"arcs": None}, "not a socp result: arcs: expected 'array', got 'null'"),
        ({"objective": "many"}, "not a socp result: objective: invalid enum value 'many'"),
        ({"surprise": 1}, "not a socp result: object contains unknown field 'surprise'"),
        ({"problem": 3}, "not a socp result: problem: expected 'str', got 'int'"),
        ({"effort": [1]}, "not a socp result: effort: expected 'object', got 'array'"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(
    saved: Path, changes: dict[str, Any], message: str
) -> None:
    altered(saved, **changes)
    with pytest.raises(SolveError) as caught:
        load(saved)
    assert str(caught.value).startswith(f"{saved}: {message}")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"t": [0.0, 1.0]},
            ".mesh: [0, 3, 6] where, for 2 nodes, 0, ..., 1, increasing, is needed",
        ),
        (
            {"mesh": [0, 6, 3]},
            ".mesh: [0, 6, 3] where, for 7 nodes, 0, ..., 6, increasing, is needed",
        ),
        ({"x": [[0.0]]}, ".x[0]: 1 values where 7 are needed, one for each node"),
        ({"side": "middle"}, ".side: invalid enum value 'middle'"),
        (
            {"multipliers": {"wall": [1.0]}},
            ".multipliers.wall: 1 values where 7 are needed, one for each node",
        ),
    ],
)
def test_what_is_wrong_in_an_arc_is_named(
    saved: Path, changes: dict[str, Any], message: str
) -> None:
    (arc,) = json.loads(saved.read_text())["arcs"]
    altered(saved, arcs=[arc | changes])
    with pytest.raises(SolveError) as caught:
        load(saved)
    assert str(caught.value) == f"{saved}: not a socp result: arcs[0]{message}"


def test_a_truncated_file_is_refused_wherever_it_ends(saved: Path) -> None:
    whole = saved.read_text().rstrip()
    for end in range(0, len(whole) - 1, 97):
        saved.write_text(whole[:end])
        with pytest.raises(SolveError, match="not a socp result"):
            load(saved)


@pytest.mark.parametrize(
    "garbage",
    [
        b"",
        b"[]",
        b"3",
        b"null",
        b"{}",
        b'"text"',
        b"\xff\xfe\x00",
        b"[" * 100_000,
        b'{"schema": 1}',
        b"\x00" * 64,
    ],
)
def test_garbage_is_refused(tmp_path: Path, garbage: bytes) -> None:
    path = tmp_path / "garbage.json"
    path.write_bytes(garbage)
    with pytest.raises(SolveError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_missing_files_and_folders_are_named(tmp_path: Path, saved: Path) -> None:
    with pytest.raises(SolveError, match=r"missing.json: No such file or directory"):
        load(tmp_path / "missing.json")
    with pytest.raises(SolveError, match=r"Is a directory"):
        load(tmp_path)
    with pytest.raises(
        SolveError, match=r"nowhere.+out.json: cannot be written: No such file or directory"
    ):
        save(load(saved), tmp_path / "nowhere" / "out.json")


def failing(code: int) -> Any:
    def fail(*_arguments: Any, **_options: Any) -> None:
        raise OSError(code, os.strerror(code))

    return fail


@pytest.mark.parametrize(
    ("where", "code", "reason"),
    [
        ("os.fsync", errno.ENOSPC, "No space left on device"),
        ("pathlib.Path.replace", errno.EACCES, "Permission denied"),
        ("pathlib.Path.chmod", errno.EPERM, "Operation not permitted"),
        ("os.open", errno.EROFS, "Read-only file system"),
    ],
)
def test_a_failed_write_leaves_the_old_file_and_no_other(
    saved: Path, monkeypatch: pytest.MonkeyPatch, where: str, code: int, reason: str
) -> None:
    before = saved.read_bytes()
    changed = replace(load(saved), objective=7.0)
    with monkeypatch.context() as broken:
        broken.setattr(where, failing(code))
        with pytest.raises(SolveError) as caught:
            save(changed, saved)
    assert str(caught.value) == f"{saved}: cannot be written: {reason}"
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_an_interruption_while_writing_leaves_no_part_behind(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_arguments: Any) -> None:
        raise KeyboardInterrupt

    before = saved.read_bytes()
    with monkeypatch.context() as broken:
        broken.setattr("os.fsync", interrupt)
        with pytest.raises(KeyboardInterrupt):
            save(replace(load(saved), objective=7.0), saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_a_saved_result_is_a_guess_on_any_mesh(tmp_path: Path) -> None:
    t_end, path = 4.0, tmp_path / "guess.json"
    curves = {
        "x": lambda t: np.array([t, t**2, 1 - t, 0 * t + 2]),
        "u": lambda t: np.array([t, -t]),
    }
    names = {"state_names": auv.state_names, "control_names": auv.control_names}
    save(solution_of(arc_of(lgr(5), [1, 2], (0, t_end), **curves), **names), path)
    guess = load(path)
    for scheme in (euler(), trapezoid(), hermite_simpson(), lgr(7), radau_iia(3)):
        for phases in (1, 3):
            reduced = collocate(single_phase(auv, phases), [uniform(scheme, 4)] * phases)
            again = reduced.lift(reduced.push(guess))
            assert again.final_time == pytest.approx(t_end)
            t = np.linspace(0.1, 3.9, 9)
            np.testing.assert_allclose(again.rows("x"), curves["x"](again.t), atol=1e-12)
            if scheme.nodes.size > 2:  # two nodes hold straight lines alone
                np.testing.assert_allclose(again.at(t), curves["x"](t), atol=1e-12)
