"""The arm at rest with its driven joints held: its sag, its modes, and its first elastic frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.equilibrium import Equilibrium, solve_static
from flexlink.dynamics.placement import unbent
from flexlink.dynamics.vibration.modal import Modes, modes


def rest_of(chain: Chain, q: Array, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world") -> Equilibrium:
    """Static equilibrium with the driven joints held at their angles in q, shape (n,) [rad].

    Errors as in `solve_static`.
    """
    held = chain.active.tolist()
    return solve_static(chain, unbent(chain, q), tip_wrench=tip_wrench, frame=frame, locked=held)


def modes_at_rest(
    chain: Chain,
    rest: Equilibrium,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    count: int | None = None,
) -> Modes:
    """The `count` slowest modes, or all, about the equilibrium `rest` with the driven joints held."""
    return modes(chain, rest.q, tip_wrench=tip_wrench, frame=frame, locked=chain.active.tolist(), count=count)


def first_elastic_frequency(
    chain: Chain, q: Array, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world"
) -> float:
    """Lowest elastic frequency of the arm at rest [Hz] with its driven joints held at their angles in q; nan if none.

    Errors as in `solve_static`.
    """
    if not (chain.stiffness[~chain.held] > 0).any():
        return np.nan
    rest = rest_of(chain, q, tip_wrench=tip_wrench, frame=frame)
    few = modes_at_rest(chain, rest, tip_wrench=tip_wrench, frame=frame, count=FEW).first_elastic_hertz
    if np.isfinite(few):
        return few
    return modes_at_rest(chain, rest, tip_wrench=tip_wrench, frame=frame).first_elastic_hertz


FEW = 8
"""Number of modes computed first; for a long chain this is much cheaper than computing all of them."""
