"""Branches of registered problems: events at values that are worked out in another way."""

import numpy as np
import pytest

from socp.model import free
from socp.registry import Registry, solve
from socp.study import follow

TURNS = "r: - s s s +; f: + + b[u.upper] - -"


@pytest.mark.slow
def test_a_speed_limit_is_released_at_the_free_peak() -> None:
    """A rocket's speed is highest where its singular arc ends, with no limit and with this."""
    registry = Registry.load()
    limited, without = registry.problem("goddard_vlimit"), registry.problem("goddard")
    start = solve(
        limited, method="lgr-multiphase", word="+ s b -", lengths="0.0235 0.036 0.042 0.1"
    )
    at = solve(without, method="lgr-multiphase", word="+ s -", lengths="0.0235 0.05 0.13")
    peak = float(at.at(at.junctions[-1:])[1, 0])
    found = follow(limited, {"bounds.v.upper": (0.1, 0.16)}, start, steps=4)
    assert (found.ended, found.points[-1].value) == ("", 0.16)
    assert all(each.solution.extremal for each in found.points)
    (event,) = found.events
    assert (event.kind, event.where) == ("constraint left", "v.upper")
    assert event.after == "u: + s -"
    assert event.value == pytest.approx(peak, abs=1e-8)
    assert event.time == pytest.approx(at.junctions[-1], abs=1e-6)


@pytest.mark.slow
def test_a_vehicle_first_turns_the_other_way_in_a_weak_current() -> None:
    """Where it needs not turn at first, it would set out with the same heading were that free."""
    problem = Registry.load().problem("auv")
    start = solve(
        problem.with_(current=0),
        method="lgr-multiphase",
        word=TURNS,
        lengths="0.02 0.6 19 0.3 0.02",
    )
    found = follow(problem, {"current": (0.0, 2.0)}, start, steps=4)
    assert (found.ended, found.points[-1].value) == ("", 2.0)
    assert all(each.solution.extremal for each in found.points)
    (event,) = found.events
    assert (event.kind, event.where) == ("bound changes", "r")
    assert event.time == pytest.approx(0.0, abs=1e-8)
    assert (event.before, event.after[:8]) == ("r: - s +; f: + b[u.upper] -", "r: + s +")
    loose = problem.with_({"current": event.value, "start.phi": free})
    turned = solve(
        loose,
        method="lgr-multiphase",
        word="r: s s s +; f: + b[u.upper] - -",
        lengths="0.65 18 0.3 0.05",
    )
    assert turned.at(np.zeros(1))[2, 0] == pytest.approx(np.pi, abs=1e-8)
