"""Release of links that start in static equilibrium with locked joints (`initial.passive` = "static").

    w                             initial angles of the springs, in equilibrium with locked joints
    δ = M_aa⁺ M_ap w              rotation of the free joints a as the springs p straighten, at zero momentum
    d(t) = p_δ(t) − p(t)          tip of a rigid arm that starts with an offset δ, minus tip without this offset

The remaining deflection vibrates under the loads of the run like any other deflection (`rigid.estimate`).
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from flexlink.advice.model import Model
from flexlink.advice.model_runner import ModelRunner, Outcome
from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.terms import mass_matrix
from flexlink.motion.inputs.initial_state import initial_state


def release(runner: ModelRunner, strict: Outcome, model: Model, q: Array) -> tuple[Array, Array]:
    """Effect of initially deflected links on the tip: its initial deflection (3,) and its drift (samples, 3) [m].

    The initial deflection is for locked joints. The drift d is relative to a rigid run that starts at `q`, coordinates
    of the model; it is nan after an early end of the run from which it is computed.
    """
    assert strict.run is not None
    if runner.scene.initial.passive != "static":
        return np.zeros(3), np.zeros_like(strict.tip)
    chain, rigid = runner.chain(model), strict.run.chain
    try:
        bent, _ = initial_state(runner.scene_of(model, strict.stepping), chain)
    except FlexlinkError:  # no equilibrium: the deflection is unknown
        return np.full(3, np.nan), np.full_like(strict.tip, np.nan)
    start = tip_position(chain, bent) - tip_position(chain, q)
    δ = _turned(rigid, chain, q, bent - q)
    if not δ.any():
        return start, np.zeros_like(strict.tip)
    initial = replace(runner.scene.initial, passive="zero", q=tuple((strict.run.q[0] + δ).tolist()))
    return start, runner.run_from(initial, (None,) * len(model), strict.stepping).tip - strict.tip


def _turned(rigid: Chain, chain: Chain, q: Array, w: Array) -> Array:
    """Rotations δ of the rigid chain's joints for spring angles w; 0 for prescribed joints."""
    there = np.array([chain.index(*coordinate) for coordinate in rigid.coordinates], np.intp)
    free = np.array(rigid.hinges["prescribed"] == 0)
    rows = mass_matrix(chain, q)[there[free]]
    δ = np.zeros(rigid.n)
    δ[free] = np.linalg.pinv(rows[:, there[free]]) @ (rows @ w)
    return δ
