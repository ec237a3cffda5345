"""The coefficients of DOP853: twelve stages of order 8, its two error estimates, and three stages
more for a polynomial of order 7 through the step; and steps of order 8, with their derivatives from
those of the rate at all stages of all steps at once.

Hairer, Norsett, Wanner, Solving ODEs I, II.5 and II.10, in the digits that a float holds; scipy
prints them too, but to import it for these takes as long as to solve a small problem.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import final

import casadi
import numpy as np

from socp.model import Expr, numbers, repeated

# fmt: off
# Of a step: when its stages are (16,); the thirteenth is its end
DOP853_TIMES = np.array([
    0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726,
    0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1,
    1, 0.1, 0.2, 0.7777777777777778,
])

# Of every stage the weights of those before it; those of the thirteenth make the step
DOP853_STAGES = [
    [],
    [
        0.05260015195876773,
    ],
    [
        0.0197250569845379, 0.0591751709536137,
    ],
    [
        0.02958758547680685, 0, 0.08876275643042054,
    ],
    [
        0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792,
    ],
    [
        0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242,
    ],
    [
        0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125,
    ],
    [
        0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023,
    ],
    [
        0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
        20.154067550477894, -43.48988418106996,
    ],
    [
        0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627,
    ],
    [
        -0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
        -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
    ],
    [
        2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
        27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
        0.6433927460157636,
    ],
    [
        0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003,
        -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
        0.04471061572777259,
    ],
    [
        0.056167502283047954, 0, 0, 0, 0, 0, 0.25350021021662483, -0.2462390374708025,
        -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699,
        -0.008298,
    ],
    [
        0.03183464816350214, 0, 0, 0, 0, 0.028300909672366776, 0.053541988307438566,
        -0.05492374857139099, 0, 0, -0.00010834732869724932, 0.0003825710908356584,
        -0.00034046500868740456, 0.1413124436746325,
    ],
    [
        -0.42889630158379194, 0, 0, 0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711,
        0.3567271874552811, 0, 0, 0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987,
    ],
]

# Weights (13, 2) of two estimates of the error, over the length: of order 5 and of order 3
DOP853_ERRORS = np.array([
    [
        0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502,
        1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571,
        -0.022355307863886294, 0,
    ], [
        -0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003,
        -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034,
        0.02265179219836082, 0,
    ],
]).T

# Weights (16, 4) of the last coefficients of the polynomial through a step, over the length
DOP853_THROUGH = np.array([
    [
        -8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
        2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688,
        -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894,
    ],
    [
        10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902,
        -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229,
        15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408,
    ],
    [
        19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236,
        -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443,
        -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279,
    ],
    [
        -25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141,
        93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605,
        -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564,
    ],
]).T
# fmt: on


_END = 12  # the stage that is the end of a step, and how many there are before it
# Of every stage, and of the end, the weights (13, 12) of the slopes of stages
_WEIGHTS = np.array([np.pad(row, (0, _END - len(row))) for row in DOP853_STAGES[: _END + 1]])
_HELD = (
    4_000_000  # numbers of stages worked on at once: some hundred megabytes with what is on hand
)


@cache
def stage_points(n: int) -> tuple[casadi.Function, ...]:
    """Return where the second stage and all later ones look at y (n,), each as a function of y, h
    and the slope (n,) of every stage before it: built once for all motions of n.
    """
    y, h = casadi.SX.sym("y", n), casadi.SX.sym("h")
    found = []
    for row in DOP853_STAGES[1:]:
        slopes = casadi.SX.sym("slopes", n, len(row))
        at = y + h * casadi.mtimes(slopes, casadi.DM(row))
        found.append(casadi.Function("at", [y, h, *casadi.horzsplit(slopes)], [at]))
    return tuple(found)


@final
@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of y (ny, 1) under parameters p (np, 1) and others u (nu, 1) along its rate f (ny, 1),
    all of them expressions, and what their slopes and curvatures are made of: those of h f, with h
    the length of a step.

    m counts what h f depends on: y where the rate does (c,), h and p.
    """

    y: Expr
    p: Expr
    u: Expr
    rate: Expr

    @cached_property
    def active(self) -> list[int]:
        """Places (c,) in y of what stands in the rate: even where casadi says of a function that is
        called there that it has no slope.
        """
        used = set(casadi.symvar(self.rate))
        return [k for k, each in enumerate(casadi.vertsplit(self.y)) if each in used]

    @cached_property
    def step(self) -> casadi.Function:
        """One step (y, h, p, u) -> y after it, and what the rate depends on (c stages,) at every
        stage.
        """
        p, u = self.p, self.u
        rate = casadi.Function("f", [self.y, p, u], [self.rate])
        y, h = casadi.SX.sym("y", self.y.numel()), casadi.SX.sym("h")
        slopes, at = list[Expr](), [y]
        for point in stage_points(y.numel())[:_END]:
            slopes.append(rate(at[-1], p, u))
            at.append(point(y, h, *slopes))
        stages = casadi.vec(casadi.horzcat(*at[:_END])[self.active, :])
        found = [casadi.densify(each) for each in (at[_END], stages)]
        return casadi.Function("step", [y, h, p, u], found)

    @cached_property
    def slope(self) -> tuple[Expr, Expr, list[Expr]]:
        """The slope h f of a stage (ny, 1), what it depends on in one column (m, 1), that is y
        where it does, h and p, and apart, with the controls.
        """
        y, h = self.y[self.active], casadi.SX.sym("h")
        return h * self.rate, casadi.vertcat(y, h, self.p), [y, h, self.p, self.u]

    @cached_property
    def sloped(self) -> casadi.Function:
        """(y where the rate depends on it, h, p, u) -> slopes (m, ny) of h f by all but u."""
        slope, by, given = self.slope
        found = casadi.jacobian(slope, by).T
        return casadi.Function("sloped", given, [casadi.densify(found)])

    @cached_property
    def curved(self) -> casadi.Function:
        """(the same, multipliers (ny,)) -> Hessian (m, m) of h f times these by all but u."""
        slope, by, given = self.slope
        held = casadi.SX.sym("l", slope.numel())
        found = casadi.hessian(casadi.dot(held, slope), by)[0]
        return casadi.Function("curved", [*given, held], [casadi.densify(found)])


@final
@dataclass(frozen=True, eq=False)
class Stages:
    """The stages of n steps by what h f depends on there: `at` (stages, n, c), that is y where the
    rate depends on it, and `given`, that is h (n, 1), p (np,) and u (n, nu).
    """

    steps: Steps
    at: np.ndarray
    given: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, steps: Steps, y: np.ndarray, *given: np.ndarray) -> "Stages":
        """Return those of steps from y (n, ny) with the others `given` as the class has them."""
        h, p, u = given
        _, at = numbers(steps.step, y.T, h.T, p, u.T)
        return cls(steps, staged(at.T, len(steps.active)), (h, p, u))

    @cached_property
    def slopes(self) -> np.ndarray:
        """Slopes (stages, n, ny, m) of h f."""
        (found,) = repeated(self.steps.sloped, [], [self.at, *self.given], _END)
        ny, m = self.steps.sloped.size_out(0)[::-1]
        return found.reshape(*self.at.shape[:2], ny, m)

    @property
    def _many(self) -> int:
        """How many steps are worked on at once."""
        ny, m = self.steps.sloped.size_out(0)[::-1]
        return max(int(_HELD // (_END * m * (ny + m))), 1)

    @property
    def _large(self) -> bool:
        return bool(self.at.shape[1] > self._many)

    def portions(self) -> Iterator[tuple["Stages", slice]]:
        """Yield the same for so many steps at a time, and which: what is worked out for each is
        let go with it.
        """
        h, p, u = self.given
        for k in range(0, self.at.shape[1], self._many):
            own = slice(k, k + self._many)
            yield Stages(self.steps, self.at[:, own], (h[own], p, u[own])), own

    @cached_property
    def _through(self) -> tuple[np.ndarray, np.ndarray]:
        """Changes (stages, n, m, m) of what every stage depends on, and (n, ny, ny + 1 + np) of y
        after the step, by the same and by y, h and p before it.
        """
        slopes, places = self.slopes, self.steps.active
        _, n, ny, m = slopes.shape
        by, changes = np.empty((_END, n, m, m)), np.empty((_END, n, ny, m))
        by[:], flat = np.eye(m), changes.reshape(_END, -1)
        for i, (own, found) in enumerate(zip(slopes, changes, strict=True)):
            if i:
                moved = (_WEIGHTS[i, :i] @ flat[:i]).reshape(n, ny, m)
                by[i, :, : len(places)] += moved[:, places]
            np.matmul(own, by[i], out=found)
        across = np.zeros((n, ny, ny + m - len(places)))
        across[:, range(ny), range(ny)] = 1.0
        across[:, :, [*places, *range(ny, across.shape[2])]] += (_WEIGHTS[_END] @ flat).reshape(
            n, ny, m
        )
        return by, across

    @property
    def across(self) -> np.ndarray:
        """Slopes (n, ny, ny + 1 + np) of y after the steps by y, h and p before."""
        if self._large:
            return np.concatenate([each.across for each, _ in self.portions()])
        return self._through[1]

    def _held(self, later: np.ndarray) -> np.ndarray:
        """Return the multipliers (stages, n, ny) of every stage's slope from those of y after the
        steps, `later` (n, ny).
        """
        slopes, places = self.slopes, self.steps.active
        found, back = np.empty(slopes.shape[:3]), np.empty((_END, len(later), 1, len(places)))
        flat = back.reshape(_END, len(later) * len(places))
        for i in reversed(range(_END)):
            found[i] = _WEIGHTS[_END, i] * later
            moved = _WEIGHTS[i + 1 : _END, i] @ flat[i + 1 :]
            found[i][:, places] += moved.reshape(len(later), len(places))
            np.matmul(found[i][:, None], slopes[i, :, :, : len(places)], out=back[i])
        return found

    def bent(self, later: np.ndarray) -> np.ndarray:
        """Return the Hessians (n, m, m) of y after the steps times multipliers (n, ny), by y before
        them where the rate depends on it, h and p.
        """
        if self._large:
            return np.concatenate([each.bent(later[own]) for each, own in self.portions()])
        held, by = self._held(later), self._through[0]
        (found,) = repeated(self.steps.curved, [], [self.at, *self.given, held], _END)
        hessians: np.ndarray = (by.swapaxes(2, 3) @ (found.reshape(by.shape) @ by)).sum(axis=0)
        return hessians


def staged(at: np.ndarray, count: int) -> np.ndarray:
    """Return what a step has of its stages (n, count stages) stage by stage, (stages, n, count)."""
    return at.reshape(len(at), _END, count).swapaxes(0, 1)
