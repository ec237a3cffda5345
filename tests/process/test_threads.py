"""BLAS has one thread while socp computes, and its own number before and after."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import scipy.linalg  # has a BLAS of its own, which is to be there before threads are counted
from threadpoolctl import threadpool_info, threadpool_limits

from socp import Problem, Solution, controls, default_guess, final_time, run, states
from socp.methods import Method
from socp.model import Watch, silent
from socp.process import one_thread


def threads() -> set[int]:
    """Return the numbers of threads of the BLAS libraries that are loaded and can have several."""
    scipy.linalg.solve(np.eye(2), np.ones(2))
    return {
        each["num_threads"]
        for each in threadpool_info()
        if each["user_api"] == "blas" and each["threading_layer"] != "disabled"
    }


def test_one_thread_inside_and_as_many_as_before_after_the_last_has_left() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with one_thread():
            with one_thread():
                assert threads() == {1}
            assert threads() == {1}
        assert threads() == before == {2}


def test_the_setting_is_back_after_an_error() -> None:
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(ZeroDivisionError), one_thread():
            1 / 0  # noqa: B018
        assert threads() == {2}


def test_a_method_runs_on_one_thread_as_a_library_too() -> None:
    seen: list[set[int]] = []

    @dataclass(frozen=True)
    class Looks(Method):
        name: ClassVar[str] = "looks"
        source: ClassVar[str] = "this test"

        def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:  # noqa: ARG002
            seen.append(threads())
            return guess

    x, u = states("x"), controls("u")
    problem = Problem(
        name="line",
        minimise=final_time,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        end={x: 0},
    )
    with threadpool_limits(2, user_api="blas"):
        run(Looks(), problem, default_guess(problem))
        assert threads() == {2}
    assert seen == [{1}]
