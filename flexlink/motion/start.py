"""Where a run starts: the initial angles and rates of a scene, in the order of its chain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.analysis.equilibrium import solve_static
from flexlink.chain.arguments import given
from flexlink.chain.chain import Chain
from flexlink.describe.scene import Scene

Array = NDArray[np.float64]


def initial_state(scene: Scene, chain: Chain) -> tuple[Array, Array]:
    """Joint angles q0 [rad] and rates q̇0 [rad/s] with which a scene starts, in sequential order.

    Parameters
    ----------
    scene
        The scene; with initial.passive = "static" its hinges are bent by gravity and tip wrench, the joints held.
    chain
        Its chain, from `lump`.

    Returns
    -------
    tuple of ndarray
        q0 and q̇0, shape (n,) each.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, or `chain` no Chain.
    ConvergenceError
        passive = "static", and the arm finds no equilibrium.
    """
    initial = given("scene", scene, Scene).initial
    q = np.radians(spread(given("chain", chain, Chain), initial.joint_deg))
    if initial.passive == "static" and len(chain.active) < chain.n:
        q = solve_static(chain, q, tip_wrench=scene.tip_wrench, locked=chain.active.tolist()).q
    return q, np.radians(spread(chain, initial.rates))


def spread(chain: Chain, per_link: tuple[float, ...]) -> Array:
    """Put one number per link on that link's active joint, 0 on passive hinges; shape (n,)."""
    out = np.zeros(chain.n)
    for k in chain.active:
        out[k] = per_link[chain.coordinate(int(k)).link - 1]
    return out
