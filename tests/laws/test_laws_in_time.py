"""Laws are derived as long as there is time; what is not found in time is not taken for none."""

import casadi
import pytest

from socp import Problem, controls, states
from socp.errors import LateError
from socp.laws import arc_law, arc_modes
from socp.laws.algebra import primitive
from socp.model import Mode
from socp.process import in_time, time_limit

x, y = states("x y")
u = controls("u")
problem = Problem(
    name="turnpike",
    running=x**2 + y**2,
    dynamics={x: y, y: u - x},
    bounds={u: (-1, 1)},
    start={x: 1, y: 0},
    final_time=5,
)


def test_in_time_names_what_was_asked_for() -> None:
    in_time("a law")  # no time is set
    with time_limit(100.0):
        in_time("a law", 1.0)
        with pytest.raises(LateError, match=r"a law: the time for it is over"):
            in_time("a law", 1000.0)
    with time_limit(0.0), pytest.raises(LateError):
        in_time("a law")


def test_a_law_that_was_late_is_found_later() -> None:
    with time_limit(0.0):
        with pytest.raises(LateError):
            arc_law(problem, (Mode("singular"),))
        assert (Mode("singular"),) not in arc_modes(problem)
    assert (Mode("singular"),) in arc_modes(problem)
    law = arc_law(problem, (Mode("singular"),))
    at = casadi.Function("law", [problem.x], [law.control])
    # on x' = y = -+x the objective's derivative is zero: u = x + y' with y = -x, y' = -y
    assert float(at([0.3, -0.3])) == pytest.approx(0.6)


def test_factors_of_what_is_deep_and_shared_take_no_time() -> None:
    a, b, c = (casadi.SX.sym(name) for name in "abc")
    left = right = a + b
    for _ in range(60):  # the same twice, each term used twice: 2^60 ways down
        left, right = left * left + casadi.sin(left), right * right + casadi.sin(right)
    factor, rest = primitive(casadi.vertcat(left * c, right * casadi.cos(c)))
    one = casadi.Function("f", [a, b, c], [factor, left])
    values = [float(each) for each in one(0.1, -0.09, 2.0)]
    assert values[0] == pytest.approx(values[1])
    assert not casadi.depends_on(rest, casadi.vertcat(a, b))
