"""Chains of many states with one control at an end: masses on springs, and a rod that is heated.

All begin at rest and at zero but for one mass that is pulled aside, so that neither the start nor a
guess shows how large most of the states become.
"""

from socp import Problem, controls, states


def masses(count: int) -> Problem:
    """Return so many masses in a row on springs, the first fixed to a wall: the squares of their
    ways for ten units of time, by a bounded force on the last one.
    """
    ways, speeds = ([states(f"{of}{k}") for k in range(count)] for of in "qv")
    force = controls("force")
    rates = dict(zip(ways, speeds, strict=True))
    for k, speed in enumerate(speeds):
        before, after = ways[k - 1] if k else 0, ways[min(k + 1, count - 1)]
        rates[speed] = before - 2 * ways[k] + after + (force if k == count - 1 else 0)
    return Problem(
        name=f"masses_{2 * count}",
        running=sum(way**2 for way in ways),
        dynamics=rates,
        bounds={force: (-1, 1)},
        start={each: float(each is ways[-1]) for each in rates},
        final_time=10,
    )


def rod(count: int) -> Problem:
    """Return the heat equation on a rod of length 1, at so many points: warm to 0.3 at the time 0.4
    by the temperature 0 to 1 of one end, the other end insulated.
    """
    warm, heat = [states(f"T{k}") for k in range(count)], controls("heat")
    rates = {}
    for k, here in enumerate(warm):
        before, after = warm[k - 1] if k else heat, warm[min(k + 1, count - 1)]
        rates[here] = count**2 * (before - 2 * here + after)
    return Problem(
        name=f"rod_{count}",
        minimise=sum((here - 0.3) ** 2 for here in warm) / count,
        dynamics=rates,
        bounds={heat: (0, 1)},
        start=dict.fromkeys(warm, 0),
        final_time=0.4,
    )
