"""The part of a Pyomo.GDP script that is the same for every problem: variables, defects, conditions
and disjuncts.
"""

MODEL = '''

model = pyo.ConcreteModel()
last = ARCS * (NODES - 1)  # neighbouring arcs share a node
model.t0 = pyo.Var(bounds=T0)
model.h = pyo.Var(range(ARCS), bounds=(0, LONGEST))
model.p = pyo.Var(range(NP), bounds=lambda m, i: P_BOX[i])
model.X = pyo.Var(range(last + 1), range(NX))
model.U = pyo.Var(range(ARCS), POINTS, range(NU), bounds=lambda m, k, j, i: U_BOX[i])
model.Y = pyo.Var(range(ARCS), range(NODES if any(COSTATE) else 0), range(NX))


def tightest(*boxes):
    low, high = [[b[side] for b in boxes if b[side] is not None] for side in (0, 1)]
    return max(low, default=None), min(high, default=None)


for n in range(last + 1):
    for i in range(NX):
        boxes = [X_BOX[i], *([START[i]] if n == 0 else []), *([END[i]] if n == last else [])]
        low, high = tightest(*boxes)
        model.X[n, i].setlb(low)
        model.X[n, i].setub(high)


def variables(m):
    """Return the variables: initial time, lengths, parameters, states, controls, costates."""
    nodes = [m.X[n, i] for n in range(last + 1) for i in range(NX)]
    controls = [m.U[k, j, i] for k in range(ARCS) for j in POINTS for i in range(NU)]
    carried = range(NODES if any(COSTATE) else 0)
    costates = [m.Y[k, j, i] for k in range(ARCS) for j in carried for i in range(NX)]
    return [m.t0, *m.h.values(), *m.p.values(), *nodes, *controls, *costates]


p = [model.p[i] for i in range(NP)]
starts = [model.t0 + sum(model.h[j] for j in range(k)) for k in range(ARCS + 1)]


def x(k, j):
    return [model.X[k * (NODES - 1) + j, i] for i in range(NX)]


def u(k, j):
    return [model.U[k, j, i] for i in range(NU)]


def y(k, j):
    return [model.Y[k, j, i] for i in range(NX)] if any(COSTATE) else [0.0] * NX


def t(k, j):
    return starts[k] + TAU[j] * model.h[k]


def bounded(constraints, expression, low, high):
    """Add a row, unless it is a number."""
    if not isinstance(expression, (int, float)):
        constraints.add(expression == low if low == high else (low, expression, high))


def defects(constraints, k, values, rates):
    """Add A X - h B F = 0 for one quantity of an arc."""
    for a, b in zip(A, B):
        left = sum(c * v for c, v in zip(a, values) if c)
        right = model.h[k] * sum(c * f for c, f in zip(b, rates) if c)
        bounded(constraints, left - right, 0.0, 0.0)


model.defects, model.conditions = pyo.ConstraintList(), pyo.ConstraintList()
cost = mayer(x(ARCS - 1, NODES - 1), x(0, 0), p, starts[0], starts[-1])[0]
for k in range(ARCS):
    rates = [rate(x(k, j), u(k, j), t(k, j), p) for j in POINTS]
    for i in range(NX):
        defects(model.defects, k, [x(k, j)[i] for j in range(NODES)], [each[i] for each in rates])
    densities = [running(x(k, j), u(k, j), t(k, j), p)[0] for j in POINTS]
    cost += model.h[k] * sum(w * density for w, density in zip(WEIGHTS, densities))
    for j in range(NODES if k == ARCS - 1 else NODES - 1):
        for c in path(x(k, j), t(k, j), p):
            bounded(model.conditions, c, None, 0.0)
ends = target(x(ARCS - 1, NODES - 1), x(0, 0), p, starts[0], starts[-1])
for equation, value in zip(EQUATION, ends):
    bounded(model.conditions, value, 0.0 if equation else None, 0.0)
if TF != (None, None):
    bounded(model.conditions, starts[-1], *TF)
model.objective = pyo.Objective(expr=cost)
model.mode = Disjunct(range(ARCS), range(len(MODES)))
for (k, c), disjunct in model.mode.items():
    names = ("law", "entry", "costate_rate")
    law, entry, costate_rate = (globals()[f"{name}_{c}"] for name in names)
    disjunct.law, disjunct.more = pyo.ConstraintList(), pyo.ConstraintList()
    disjunct.BigM = pyo.Suffix(direction=pyo.Suffix.LOCAL)
    for j in POINTS:
        for i, value in enumerate(law(x(k, j), y(k, j), t(k, j), p)):
            row = disjunct.law.add(model.U[k, j, i] - value == 0)
            if BIG_M[c][i] is not None:
                disjunct.BigM[row] = BIG_M[c][i]
    for value in entry(x(k, 0), y(k, 0), t(k, 0), p):
        bounded(disjunct.more, value, 0.0, 0.0)
    if COSTATE[c]:
        rates = [costate_rate(x(k, j), y(k, j), t(k, j), p) for j in POINTS]
        for i in range(NX):
            values = [y(k, j)[i] for j in range(NODES)]
            defects(disjunct.more, k, values, [each[i] for each in rates])
model.choice = Disjunction(range(ARCS), rule=lambda m, k: [m.mode[k, c] for c in range(len(MODES))])
model.differ = pyo.ConstraintList()  # equal neighbours would be one arc
for k in range(ARCS - 1):
    for c in range(len(MODES) if len(MODES) > 1 else 0):
        model.differ.add(sum(model.mode[j, c].binary_indicator_var for j in (k, k + 1)) <= 1)
'''
