"""Linear programmes by HiGHS through casadi, which is here anyway: to import a modelling package
takes as long as to solve a problem.
"""

from typing import Any

import casadi
import numpy as np

from socp.process import output_discarded

_SETTINGS = {"error_on_fail": False, "print_time": False, "highs": {"output_flag": False}}


def linear_programme(
    cost: np.ndarray, matrix: Any, rows: np.ndarray, box: np.ndarray
) -> np.ndarray | None:
    """Return v (n,) of least cost (n,) @ v with rows[0] <= matrix @ v <= rows[1], (2, m), and
    box[0] <= v <= box[1], (2, n); None where HiGHS finds none.

    `matrix` (m, n) is what casadi keeps, sparse where it is.
    """
    given, n = casadi.DM(matrix), cost.size
    shapes = {"a": given.sparsity(), "h": casadi.Sparsity(n, n)}
    with output_discarded():  # HiGHS has a banner
        try:
            solver = casadi.conic("linear", "highs", shapes, _SETTINGS)
            found = solver(g=cost, a=given, lba=rows[0], uba=rows[1], lbx=box[0], ubx=box[1])
        except RuntimeError:
            return None
    return np.array(found["x"]).ravel() if solver.stats()["success"] else None
