"""What counts as none, as one and the same, and as met: every such figure that several readers
share.

Each has one name and its reason here. Where two figures differ the reason does: what a solver
leaves, what a grid can tell, or what arithmetic rounds away. Figures of one reader stand with it.
"""

# -- by arithmetic

# against division by zero: far below any size, and its inverse is still a float
TINY = 1e-300
# of a span of time: nearer than this rounding alone tells two nodes apart (`model.result.arc`, the
# judge's polynomials)
ROUNDED = 1e-15
# of a horizon, or of the arc a time lies in: two times as near are one, and a stretch as short is a
# point. Solvers place a junction to 1e-11 of the horizon, so nothing that is meant is lost (kinks,
# the judge's nodes, words read off a grid, gaps between arcs in a result)
SAME_TIME = 1e-9

# -- by what a solver leaves

# of a control's box: a law further out leaves the box; nearer is the solver's own tolerance, which
# moves bounds by as much (mending, insertion, words solved without their boxes, conformance)
OUTSIDE = 1e-6
# of a constraint's magnitude: a direct solver with its usual tolerances leaves as much where one is
# active
LEFT = 1e-8
# violation by re-integration, relative, up to which objectives are compared with one another: what
# a converged solve leaves, and no more than six digits of the objective can be worth (comparing,
# census, frontier)
COMPARED = 1e-6

# -- by what the judge can tell

# of the width of a control's box: an interior point ends about 1e-6 of it inside, ringing passes it
# only in flight
AT_BOUND = 1e-3
# of the range of a state constraint's values on the solution: as near counts as on it
ACTIVE = 1e-4

# seconds for a law that the judge would like to know besides what it decides: one that takes longer
# has expressions too large to be followed (lessons, junctions, Legendre-Clebsch)
LAWS = 5.0

# one per cent of the magnitude of states and objective: what a second-order grid of some hundred
# steps reaches
FEASIBLE = 1e-2
# error of the objective, relative to its terms, up to which a solution is approximately extremal:
# three digits. The estimate is of first order; what it leaves is of the second, 1e-6 of the terms
APPROXIMATE = 1e-3
# residuals of the principle, relative to the Hamiltonian's own terms: six digits, which no grid
# reaches by luck
EXTREMAL = 1e-6
# of the horizon: a shorter arc is none. What it is worth is at most its share of the horizon times
# the Hamiltonian's magnitude, in which residuals are measured: below their tolerance no residual
# tells it from none. Where derivatives of a switching function do, it is one down to `SAME_TIME`
SHORTEST = EXTREMAL
