"""States for the self-test of generated code, with ẋ from flexlink's solver, and the name of the code."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.free_motion import all_motions
from flexlink.dynamics.placement import tip_position

COUNT = 3
"""Number of states."""
ALLOWED = 1e-8
"""Largest difference of ẋ, relative to its largest entry: two algorithms in float64, stiff arms included."""


class Case(NamedTuple):
    """A state with its derivative."""

    x: Array
    u: Array
    rate: Array
    tip: Array


def cases(chain: Chain) -> list[Case]:
    """Random states of small deflections, with ẋ and tip from the solver of `simulate`."""
    rng, found = np.random.default_rng(0), list[Case]()
    Φ = all_motions(chain)
    rest, back = (0.0, Φ) if chain.shapes is None else (chain.rest, chain.shapes.inverse.T)
    bend = 0.1 / np.maximum(1.0, np.abs(Φ).sum(axis=0))
    for _ in range(COUNT):
        z, zd, u = (
            bend * rng.normal(size=chain.freedoms),
            rng.normal(size=chain.freedoms),
            rng.normal(size=len(chain.active)),
        )
        u[chain.hinges["prescribed"][chain.active] != 0] = 0.0  # as in `forward_dynamics`
        q, qd, tau = rest + Φ @ z, Φ @ zd, np.zeros(chain.n)
        tau[chain.active] = u
        qdd = forward_dynamics(chain, q, qd, tau)
        found.append(Case(np.append(z, zd), u, np.append(zd, back @ qdd), tip_position(chain, q)))
    return found


def name_of(chain: Chain) -> str:
    """Name of the arm as an identifier of C and Python."""
    name = re.sub(r"[^0-9a-zA-Z_]", "_", chain.name)
    return name if name[:1].isalpha() else f"arm_{name}"
