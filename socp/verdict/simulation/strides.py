"""Steps of DOP853 in a row, on one memory, where they can be laid out before.

A step by itself takes ten times as long on its way to casadi and back as there. So steps are laid
out first, one an interval or so, and taken one after the other without a look at them; those whose
error is too large are cut into parts, and the motion goes on from the last one that is good. Every
step that is kept has passed the test of single ones, and begins where the one before it has led.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.model import numbers, repeated
from socp.process import in_time
from socp.transcription import DOP853_TIMES
from socp.verdict.simulation.steps import LEAST, basis, looked_at, one_step, shorter, worst

_ROW = 32  # steps that are taken before their errors are looked at
# Steps that are tried beyond twice those laid out: what takes more goes on by single ones, which
# tell what is stiff
_TRIED = 512

# times (k,), numbers of pieces (k,) -> controls (nu, k)
Controls = Callable[[np.ndarray, np.ndarray], np.ndarray]


@final
@dataclass(frozen=True, eq=False)
class Course:
    """What moves y (n,) over pieces of time that follow one another: rates (x, u, t, p) -> (n,),
    the last of which no rate depends on, controls, parameters p (np,), the `latest` (pieces,) time
    that functions see on each, and what a step may miss of y, relative and absolute (n,).
    """

    flow: casadi.Function
    controls: Controls
    p: np.ndarray
    latest: np.ndarray
    rtol: float
    atol: np.ndarray


@final
@dataclass(frozen=True, eq=False)
class Strides:
    """Steps in a row, k of them: where each begins and ends (k,) and the number of its piece (k,),
    y `before` and `after` it (k, n), and the coefficients (k, 7, n) of what is in between.
    """

    begins: np.ndarray
    ends: np.ndarray
    on: np.ndarray
    before: np.ndarray
    after: np.ndarray
    between: np.ndarray

    @classmethod
    def none(cls, n: int) -> "Strides":
        """Return no steps of y (n,)."""
        times, states = np.empty((2, 0)), np.empty((2, 0, n))
        return cls(times[0], times[1], np.empty(0, int), states[0], states[1], np.empty((0, 7, n)))

    def first(self, count: int) -> "Strides":
        """Return so many of the first ones."""
        return Strides(*(each[:count] for each in vars(self).values()))

    @classmethod
    def joined(cls, parts: Sequence["Strides"]) -> "Strides":
        """Return one row of all parts."""
        return cls(*map(np.concatenate, zip(*(vars(each).values() for each in parts), strict=True)))

    def looks(self, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return times (m,) to look at and the numbers of their steps (m,): where a piece begins,
        and within every step on to its end so many as `counts` (pieces,) has for its piece.
        """
        counts, first = counts[self.on], np.diff(self.on, prepend=-1) > 0
        step = np.repeat(np.arange(counts.size), counts + first)
        place = np.arange(1, step.size + 1) - np.cumsum(counts + first)[step] + counts[step]
        t = self.begins[step] + (self.ends - self.begins)[step] * (place / counts[step])
        return np.where(place == counts[step], self.ends[step], t), step

    def at(self, t: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return y (n, m) at times t (m,) of the steps whose numbers are given (m,)."""
        x = (t - self.begins[step]) / (self.ends - self.begins)[step]
        found: np.ndarray = self.before[step] + np.einsum(
            "im,min->mn", basis(x), self.between[step]
        )
        return found.T


def strides(course: Course, laid: np.ndarray, y: np.ndarray, most: np.ndarray) -> Strides:
    """Take steps from y (n,) that are `laid` out, rows (3, k) of where each begins and ends and its
    piece, or parts of them; it ends before one that takes y beyond `most` (n,), and where that
    takes too many.
    """
    left = _TRIED + 2 * laid.shape[1]
    done = [Strides.none(y.size)]
    while laid.shape[1] and left > 0 and not _too_short(laid):
        in_time("re-integration")
        now, laid = laid[:, :_ROW], laid[:, _ROW:]
        found, off = _taken(course, now, y)
        gone = ~(np.abs(found.after) <= most).all(axis=1)
        bad = np.flatnonzero(~(off < 1) | gone)
        good = int(bad[0]) if bad.size else off.size
        done.append(found.first(good))
        left -= off.size
        if bad.size and off[good] < 1:
            break
        if bad.size:
            laid = np.hstack([_cut(now[:, good:], off[good:]), laid])
        y = done[-1].after[-1] if good else y
    return Strides.joined(done)


def _too_short(laid: np.ndarray) -> bool:
    """Tell whether the next step is shorter than times can tell."""
    begin, end, _ = laid[:, 0]
    return not end - begin >= 10.0 * np.spacing(abs(begin))


def _cut(laid: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return steps (3, k) with those cut in parts whose errors (k,) are too large: the first one
    is, and those after it may have begun nowhere.
    """
    most = int(1.0 / LEAST)
    parts = np.ones(off.size, dtype=int)
    large = ~(off < 1) & ~np.isnan(off)
    parts[large] = np.clip(np.ceil(1.0 / shorter(off[large])), 2, most)
    parts[0] = parts[0] if large[0] else most
    begins, ends, on = np.repeat(laid, parts, axis=1)
    place = np.arange(1, on.size + 1) - np.repeat(np.cumsum(parts) - parts, parts)
    share = place / np.repeat(parts, parts)
    ends = np.where(share < 1, begins + share * (ends - begins), ends)
    return np.array([np.where(place > 1, np.roll(ends, 1), begins), ends, on])


def _taken(course: Course, laid: np.ndarray, y: np.ndarray) -> tuple[Strides, np.ndarray]:
    """Return the steps (3, k) that are laid out, with their errors (k,), whatever these are."""
    begins, ends, on = laid[0], laid[1], laid[2].astype(int)
    k, stages, h = on.size, DOP853_TIMES.size, ends - begins
    t = np.minimum(begins[:, None] + h[:, None] * DOP853_TIMES, course.latest[on][:, None])
    u = course.controls(t.ravel(), np.repeat(on, stages))
    given = u.T.reshape(k, 1, -1), t[:, None, :], h[:, None, None], course.p
    after, slopes = (each[:, 0] for each in repeated(one_step(course.flow), [y[None]], given, k))
    before = np.vstack([y, after[:-1]])
    slopes = slopes.reshape(k * stages, -1).T
    told = before.T, h[None], slopes, course.rtol, course.atol
    errors, between = numbers(looked_at(y.size), *told)
    between = between.T.reshape(k, -1, y.size)
    return Strides(begins, ends, on, before, after, between), worst(errors)
