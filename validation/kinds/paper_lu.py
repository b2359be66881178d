"""q̈ by LU decomposition of M (as in the paper), by the library's solver, and by the inverse that the paper avoids."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed.families import timed_states


def run(case: Case, samples: int) -> Iterator[Measured]:
    """Yield each solver's residual M q̈ + T_IN − T_EX, the difference of LU from articulated bodies, the verdict."""
    residuals: dict[str, list[float]] = {}
    apart = []
    for scene in case.load_scenes():
        chain = fl.lump(scene)
        found: dict[str, float] = {}
        furthest = 0.0
        for q, qd, tau, _ in zip(*timed_states(chain, samples), strict=True):
            M = fl.mass_matrix(chain, q)
            right = tau - fl.bias_torque(chain, q, qd) - fl.elastic_torque(chain, q) - fl.friction_torque(chain, qd)
            ways = {
                "LU": fl.forward_dynamics(chain, q, qd, tau, solver="lu"),
                "articulated bodies": fl.forward_dynamics(chain, q, qd, tau, solver="articulated"),
                "inverse of M": np.linalg.inv(M) @ right,
            }
            for way, qdd in ways.items():
                left = np.abs(M @ qdd - right).max() / rounding.of_residual(chain, q, qd, qdd, tau)
                found[way] = max(found.get(way, 0.0), float(left))
            both = ways["LU"], ways["articulated bodies"]
            furthest = max(furthest, float(rounding.acceleration_error(chain, q, qd, tau, solutions=both).max()))
        for way, left in found.items():
            facts: Facts = {"solver": way}
            yield Measured(
                "residual" if way != "inverse of M" else "residual of the inverse", left, scene.name, varied=facts
            )
            residuals.setdefault(way, []).append(left)
        yield Measured("apart", furthest, scene.name)
        apart.append(furthest)
    yield Measured("claim", max(residuals["LU"]), note=_verdict(max(residuals["LU"]), max(residuals["inverse of M"])))


def _verdict(lu: float, inverse: float) -> str:
    """Verdict on whether LU's residual is within the rounding bound, with the residual of the inverse."""
    if lu > 1.0:
        return f"does not hold: LU leaves {number(lu, 2)} times the rounding bound"
    return (
        f"holds: LU leaves {number(lu, 2)} of the rounding bound, the inverse {number(inverse, 2)}; by "
        "default the library takes articulated bodies, which need no M (--solver lu is the paper's way)"
    )
