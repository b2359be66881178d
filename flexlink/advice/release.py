"""Links that start bent by their loads, the joints held, and are let go: `initial.passive` = "static".

    w                             bend of the springs at the start, in equilibrium with the joints held
    δ = M_aa⁺ M_ap w              how far the free joints a turn while the springs p straighten: no momentum comes of it
    d(t) = p_δ(t) − p(t)          tip of the rigid arm that starts δ further, from that of the one that does not

The rest of the bend swings about the loads of the run, as all bending does: `rigid.guess`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from flexlink.advice.model import Model
from flexlink.advice.model_runner import ModelRunner, Outcome
from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.terms import mass_matrix
from flexlink.inputs.initial_state import initial_state

Array = NDArray[np.float64]


class Release(NamedTuple):
    """What a bend at the start does to the tip."""

    start: Array  # how far it is away at first, the joints held (3,) [m]
    drift: Array  # d, of the joints that are let go (samples, 3) [m]; nan where that run does not come to its end


def release(bench: ModelRunner, strict: Outcome, model: Model, q: Array) -> Release:
    """Of the links of a model, beside a rigid run; `q` is where this starts, on the chain of the model."""
    assert strict.run is not None
    if bench.scene.initial.passive != "static":
        return Release(np.zeros(3), np.zeros_like(strict.tip))
    chain, rigid = bench.chain(model), strict.run.chain
    try:
        bent, _ = initial_state(bench.scene_of(model, strict.stepping), chain)
    except FlexlinkError:  # no equilibrium is found: nothing is known of the bend
        return Release(np.full(3, np.nan), np.full_like(strict.tip, np.nan))
    start = tip_position(chain, bent) - tip_position(chain, q)
    δ = _turned(rigid, chain, q, bent - q)
    if not δ.any():
        return Release(start, np.zeros_like(strict.tip))
    initial = replace(bench.scene.initial, passive="zero", q=tuple((strict.run.q[0] + δ).tolist()))
    return Release(start, bench.run_from(initial, (None,) * len(model), strict.stepping).tip - strict.tip)


def _turned(rigid: Chain, chain: Chain, q: Array, w: Array) -> Array:
    """δ on the joints of the rigid chain, 0 on those that are led."""
    there = np.array([chain.index(*coordinate) for coordinate in rigid.coordinates], np.intp)
    free = np.array(rigid.hinges["prescribed"] == 0)
    rows = mass_matrix(chain, q)[there[free]]
    δ = np.zeros(rigid.n)
    δ[free] = np.linalg.pinv(rows[:, there[free]]) @ (rows @ w)
    return δ
