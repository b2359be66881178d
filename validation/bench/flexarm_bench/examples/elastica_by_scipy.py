"""A solver in one file: a clamped rod in the plane under a dead load on its tip, by SciPy's boundary value solver.

flexarm-bench run --solver examples/elastica_by_scipy.py statics
"""

import numpy as np
from flexarm_bench import Cannot
from scipy.integrate import solve_bvp

SHARES = np.linspace(0, 1, 11)[1:]  # of the load; each solution starts the next


def run(case, settings):
    """Displacement of the tip, x, y, z [m]."""
    if case.ask != "statics" or len(case.links) > 1 or not case.planar:
        raise Cannot("only one rod in the plane, in statics")
    if case.follows:
        raise Cannot("only dead loads")
    (link,), (fx, fy, _), (_, _, moment) = case.links, case.force, case.moment

    def slopes(s, state):  # state: x, y, angle, curvature along the rod
        _, _, angle, curvature = state
        c, s_ = np.cos(angle), np.sin(angle)
        return np.array([c, s_, curvature, share * (fx * s_ - fy * c) / link.EI])

    def ends(root, tip):
        return np.array([root[0], root[1], root[2], tip[3] - share * moment / link.EI])

    s = np.linspace(0, link.length, 51)
    state = np.array([s, 0 * s, 0 * s, 0 * s])
    for share in SHARES:  # noqa: B007  used in the functions above
        found = solve_bvp(slopes, ends, s, state, tol=1e-8, max_nodes=100_000)
        if not found.success:
            raise ArithmeticError(found.message)
        s, state = found.x, found.y
    return [state[0, -1] - link.length, state[1, -1], 0.0]
