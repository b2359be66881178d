"""Links that start in static equilibrium with the joints held, which are then released: `initial.passive` = "static".

    w                             angles of the springs at the start, in equilibrium with the joints held
    δ = M_aa⁺ M_ap w              rotation of the free joints a while the springs p straighten, at zero momentum
    d(t) = p_δ(t) − p(t)          tip of the rigid arm that starts δ further, from the one that does not

The rest of the deflection vibrates about the loads of the run, as all deflection does: `rigid.estimate`.
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
    """Effect of an initial deflection of a model's links: that of the tip at the start, the joints held (3,) [m].

    And the tip's drift d (samples, 3) [m] from a rigid run that starts at `q`, coordinates of the model; nan from where
    the run that shows it ends early.
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
    """δ on the joints of the rigid chain, 0 on prescribed ones."""
    there = np.array([chain.index(*coordinate) for coordinate in rigid.coordinates], np.intp)
    free = np.array(rigid.hinges["prescribed"] == 0)
    rows = mass_matrix(chain, q)[there[free]]
    δ = np.zeros(rigid.n)
    δ[free] = np.linalg.pinv(rows[:, there[free]]) @ (rows @ w)
    return δ
