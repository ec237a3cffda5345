"""What casadi calls at every iteration of a nonlinear programme: it tells a watch and asks the
solver to stop.
"""

from collections.abc import Sequence

import casadi
import numpy as np

from socp.model import Progress, Watch, silent
from socp.solvers.contract import NLP, NLPPoint


class Observer(casadi.Callback):  # type: ignore[misc]
    """Passes every iteration to a watch; casadi swallows exceptions here, so the first one is kept
    for later.

    It reads casadi's own memory: matrices made of it, five an iteration, would cost more than a
    watch. `whole` maps the variables that a solver is given to all of them, the objective and the
    constraints, where it is given a smaller programme or tells of no values.
    """

    def __init__(
        self, stage: str, nlp: NLP, watch: Watch = silent, whole: casadi.Function | None = None
    ) -> None:
        super().__init__()
        self.sizes = {
            "x": nlp.count,
            "f": 1,
            "g": nlp.rows,
            "lam_x": nlp.count,
            "lam_g": nlp.rows,
        }
        self.stage, (self.low, self.high) = stage, nlp.g_box
        self.whole = whole
        self.begin(watch)
        self.construct("observer", {})

    def begin(self, watch: Watch) -> None:
        """Start anew with a watch, for another solve."""
        self.watch, self.stop, self.count = watch, False, 0
        self.error: BaseException | None = None

    def ask(self) -> None:
        """Ask the solver to stop after this iteration."""
        self.stop = True

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return int(casadi.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of an input."""
        return str(casadi.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        """Return the shape of an input."""
        size = self.sizes.get(casadi.nlpsol_out(i), 0)
        return casadi.Sparsity.dense(size, 1) if size else casadi.Sparsity(0, 0)

    def has_eval_buffer(self) -> bool:
        """Tell that it reads memory."""
        return True

    def eval_buffer(self, given: Sequence[memoryview], asked: Sequence[memoryview]) -> int:
        """Show an iteration and answer whether to stop."""
        try:
            if self.watch is not silent and self.error is None:
                self._show(np.frombuffer(given[0]).copy(), given)
            self.count += 1
        except BaseException as error:  # noqa: BLE001
            # anything raised here would vanish in the solver
            self.error, self.stop = error, True
        np.frombuffer(asked[0])[0] = float(self.stop)
        return 0

    def _show(self, v: np.ndarray, given: Sequence[memoryview]) -> None:
        if self.whole is None:
            objective = float(np.frombuffer(given[1])[0])
            g = np.frombuffer(given[2]) if self.sizes["g"] else np.zeros(0)
        else:
            v, f, g = (each.full().ravel() for each in self.whole(v))
            objective = float(f[0])
        violation = float(np.max(np.maximum(self.low - g, g - self.high), initial=0.0))
        if self.watch(Progress(self.stage, self.count, objective, violation, v=v)):
            self.stop = True  # never assigned from the answer: Ctrl-C may have set it meanwhile


def unusable(nlp: NLP, guess: NLPPoint) -> str:
    """Say what cannot be computed at the guess: the usual reason for a failure at the first
    iteration.
    """
    if not np.isfinite(guess.v).all():
        return "the guess itself is not finite"
    if nlp.derivatives is None:
        f, g = casadi.Function("start", [nlp.v], [nlp.f, nlp.g])(guess.v)
    else:  # there is no need to write it down
        f, g = nlp.derivatives().nlp(guess.v, [])
    bad = int((~np.isfinite(g.full())).sum())
    if not np.isfinite(float(f)):
        return f"the objective is {float(f)} at the guess; give a guess where it is finite"
    return (
        f"{bad} of {g.numel()} constraints are not finite at the guess; give a guess where they are"
        if bad
        else ""
    )


def arguments(nlp: NLP, guess: NLPPoint) -> dict[str, np.ndarray]:
    """Return what a solver of casadi is called with: the guess, warm where it carries multipliers,
    and the bounds.
    """
    given = {
        "x0": guess.v,
        "lbx": nlp.v_box[0],
        "ubx": nlp.v_box[1],
        "lbg": nlp.g_box[0],
        "ubg": nlp.g_box[1],
    }
    if guess.lam_v is not None and guess.lam_g is not None:
        given |= {"lam_x0": guess.lam_v, "lam_g0": guess.lam_g}
    return given


def last_line(error: Exception) -> str:
    """Return the last line of an error of casadi without the place in its sources."""
    return str(error).strip().splitlines()[-1].rsplit(": ", 1)[-1]
