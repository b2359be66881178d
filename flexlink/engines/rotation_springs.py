"""What springs of rotation vectors take beyond K (θ − θ₀): no engine has them; computed by us from the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.formats.document import ROTATION_SPRINGS
from flexlink.kernels.forces.rotation_springs import excess_torque

Excess = Callable[[Array], Array]


def excess_of(chain: Chain, held_by: Callable[[], Chain]) -> Excess | None:
    """Torques (n,) of angles (n,), of the chain that the file holds; None of one without such springs."""
    if not chain.has_rotation_springs:
        return None
    held = held_by()
    return lambda q: np.array(excess_torque(held.bodies, held.hinges, held.couplings, np.array(q)))


def refuse_in_files(engine: str, path: Path) -> None:
    """Refuse a file that says that springs hold rotation vectors, which only chains of ours bring along.

    Raises
    ------
    ArgumentError
        It does.
    """
    if ROTATION_SPRINGS.encode() in path.read_bytes():
        raise ArgumentError(
            f"the file has springs of rotation vectors, which {engine} would take for springs of angles; compare the "
            "scene itself, or export it with a rule of springs = 'angles'",
            id="rotation-springs-in-file",
        )
