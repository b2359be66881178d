"""Torque of rotation-vector springs minus K (θ − θ₀), computed by flexlink because no engine has such springs."""

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


def excess_of(chain: Chain, read: Callable[[], Chain]) -> Excess | None:
    """Return a function that maps angles (n,) to extra torques (n,) of the file's chain; None without such springs."""
    if not chain.has_rotation_springs:
        return None
    loaded = read()
    return lambda q: np.array(excess_torque(loaded.bodies, loaded.hinges, loaded.couplings, np.array(q)))


def refuse_in_files(engine: str, path: Path) -> None:
    """Refuse a file with rotation-vector springs, which only chains built by flexlink support.

    Raises
    ------
    ArgumentError
        The file has such springs.
    """
    if ROTATION_SPRINGS.encode() in path.read_bytes():
        raise ArgumentError(
            f"the file has rotation-vector springs, which {engine} would read as springs of angles; compare the "
            "scene itself, or export it with a rule of springs = 'angles'",
            id="rotation-springs-in-file",
        )
