"""Findings as values: what they are of, in judgements, in result files and for a search."""

import json
from dataclasses import replace
from typing import Any

import pytest
from records import older, revised

from socp import Problem, Solution, controls, run, states, time
from socp.errors import SolveError
from socp.methods.guess import default_guess
from socp.model.data.files import from_json, to_json
from socp.model.result.findings import Condition, Place
from socp.model.word import Mode
from socp.registry.plugins import Registry
from socp.search.mending import mends
from socp.search.neighbours import word_of

x, y = states("x y")
u, w = controls("u w")
LOWER, UPPER = Mode("lower"), Mode("upper")
LATER = ("kind", "control", "of", "stretch", "arc", "mode")  # fields that older files lack

# x and y as far as they go: w is + until 1, then -
TWO = Problem(
    name="two",
    dynamics={x: u, y: w * (1 - time)},
    bounds={u: (-1, 1), w: (-1, 1)},
    minimise=-x - y,
    start={x: 0, y: 0},
    final_time=1.5,
)


@pytest.fixture(scope="module")
def wrong(registry: Registry) -> Solution:
    """Return the judged word whose second control misses its switch."""
    method = registry.method("lgr-multiphase")(word="u: +; w: +")
    return run(method, TWO, default_guess(TWO))


@pytest.fixture(scope="module")
def right(registry: Registry) -> Solution:
    method = registry.method("lgr-multiphase")(word="u: + +; w: + -")
    return run(method, TWO, default_guess(TWO))


def test_a_finding_says_which_stretch_of_which_control_it_is_of(wrong: Solution) -> None:
    assert wrong.verdict is not None
    (found,) = [each for each in wrong.verdict.findings if each.kind is Condition.SIGN]
    assert not found.holds
    assert (found.control, found.stretch, found.place.mode) == ("w", 1, UPPER)
    assert found.wants == LOWER
    assert found.where == "w, stretch 1 (+)"
    assert found.t is not None
    assert found.t > 1


def test_a_search_puts_in_the_arc_that_is_asked_for(wrong: Solution, right: Solution) -> None:
    assert right.extremal
    now = word_of(wrong)
    (found,) = {each.key for each in mends(TWO, now, wrong)} & {"0: + +; 1: + -"}
    assert found
    assert wrong.verdict is not None
    silent = replace(
        wrong.verdict, findings=tuple(replace(f, wants=None) for f in wrong.verdict.findings)
    )
    assert not list(mends(TWO, now, revised(wrong, verdict=silent)))


@pytest.mark.slow
def test_mboc_names_the_missing_arc_and_its_control(registry: Registry) -> None:
    found = run(registry.method("mboc")(switches="0", starts=1), TWO, default_guess(TWO))
    assert not found.extremal
    assert "an arc is missing, w: - at t = " in found.message
    assert "(switching function sign on w, stretch 1 (+)" in found.message


def test_a_file_holds_findings_whole(wrong: Solution, right: Solution) -> None:
    for solution in (wrong, right):
        assert solution.verdict is not None
        read = from_json(to_json(solution)).verdict
        assert read is not None
        assert read.findings == solution.verdict.findings
        assert read.margins == solution.verdict.margins
        assert all(place.control and place.stretch for place in read.margins)


def of_before(solution: Solution, schema: int) -> dict[str, Any]:
    """Return the document that a version without the later fields wrote."""
    document: dict[str, Any] = json.loads(to_json(solution))
    for finding in document["judgement"]["verdict"]["findings"]:
        for name in LATER:
            del finding[name]
        finding["wants"] = ""
    return older(document, schema)


@pytest.mark.parametrize("schema", [1, 2])
def test_older_files_are_read_and_stretches_found_by_their_words(
    wrong: Solution, schema: int
) -> None:
    assert wrong.verdict is not None
    read = from_json(json.dumps(of_before(wrong, schema))).verdict
    assert read is not None
    assert read.margins == wrong.verdict.margins
    for old, new in zip(read.findings, wrong.verdict.findings, strict=True):
        assert (old.kind, old.residual, old.t) == (new.kind, new.residual, new.t)
        assert (str(old), old.wants) == (str(new), None)
        assert old.stretch == new.stretch


def test_conditions_of_another_version_keep_their_words(wrong: Solution) -> None:
    document = of_before(wrong, 2)
    document["verdict"]["findings"][0] |= {
        "condition": "a law of its own",
        "where": "u, there",
    }
    once = from_json(json.dumps(document))
    for solution in (once, from_json(to_json(once))):
        assert solution.verdict is not None
        first = solution.verdict.findings[0]
        assert (first.kind, first.condition) == (Condition.OTHER, "a law of its own")
        assert first.place == Place(of="u, there")


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("wants", "x", "wants: 'x' is no mode"),
        ("mode", "?", "mode: '?' is no mode"),
        ("kind", "LUCK", "kind: 'LUCK'; there are INSIDE, SIGN"),
        ("kind", "MOTION", "condition: "),
        ("condition", "luck", "condition: 'luck', but the words for"),
        ("stretch", -1, "stretch: "),
    ],
)
def test_findings_that_are_none_are_refused(
    wrong: Solution, field: str, value: object, said: str
) -> None:
    document = json.loads(to_json(wrong))
    document["judgement"]["verdict"]["findings"][0][field] = value
    with pytest.raises(SolveError) as caught:
        from_json(json.dumps(document))
    assert said in str(caught.value)
    assert "findings[0]" in str(caught.value) or "findings[...]" in str(caught.value)
