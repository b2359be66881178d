"""Torques that engines do not compute: dry friction, springs between joints, and rotation-vector springs.

Files describe the first two by flexlink's own elements. Rotation-vector springs act as angle springs in an engine;
flexlink computes the rest of their torque.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.engines.couplings import torque
from flexlink.formats.document import ROTATION_SPRINGS
from flexlink.kernels.forces.rotation_springs import excess_torque

Excess = Callable[[Array], Array]


class OwnElements:
    """Torques of flexlink's own elements in a file, which an engine does not compute."""

    coulomb: Array
    coulomb_width: Array
    couplings: NDArray[np.void]
    excess: Excess | None = None

    def _friction(self, qd: Array) -> Array:
        return np.asarray(self.coulomb * np.tanh(qd / self.coulomb_width))

    def _between(self, field: str, φ: Array) -> Array | float:
        """Torques of springs or dampers between joints, for `field` "stiffness" or "damping"."""
        return torque(self.couplings, field, φ) if len(self.couplings) else 0.0

    def _beyond(self, q: Array) -> Array | float:
        """Torque of rotation-vector springs minus the torque of angle springs."""
        return 0.0 if self.excess is None else self.excess(q)


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
