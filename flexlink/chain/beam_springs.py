"""The springs of a beam's hinges: constants by its rigidities at some sections, or by the integrals of a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.material import Material
from flexlink.describe.schemes.cells import Cells


class Springs(NamedTuple):
    """Springs of a beam: its rigidity at some sections holds its hinges, each its own, or those of a cell together."""

    link: Link
    sections: Array  # (4, N) of the beam, at the hinges, or at the Gauss points of cells
    lengths: Array  # (N,) of beam that each section stands for [m]
    rows: NDArray[np.intp]  # number of each hinge in the chain
    places: NDArray[np.intp]  # and its place among the stiffnesses, (3, N) in a row
    cells: Cells | None
    coupled: slice  # of the chain's couplings
    pairs: NDArray[np.intp]  # (couplings, 3) axis, cell and pair of hinges in it
    given: tuple[Array, Array] | None = None  # the constants themselves, of a table

    def constants(self, rigidities: Array) -> tuple[Array, Array]:
        """K_ii (…, hinges) and K_ij (…, couplings) [N m/rad] of GJ, EI_y, EI_z at the sections, (…, 3, N) [N m²]."""
        held = rigidities / self.lengths
        if self.cells is None:
            return held.reshape(*held.shape[:-2], -1)[..., self.places], np.zeros((*held.shape[:-2], 0))
        cell = self.cells.cell
        held = held.reshape(*held.shape[:-1], -1, self.cells.hinges)
        own = np.stack([cell.stiffness(i, i, held) for i in range(self.cells.hinges)], axis=-1)
        both = np.stack([cell.stiffness(i, j, held) for i, j in cell.pairs], axis=-1)
        axis, e, pair = self.pairs.T
        return own.reshape(*own.shape[:-3], -1)[..., self.places], both[..., axis, e, pair]

    def write(self, arm: Arm, hinges: NDArray[np.void], couplings: NDArray[np.void]) -> None:
        """Put spring and damping constants into the hinges and the couplings of the chain."""
        link = self.link
        if self.given is None:
            k, coupled = self.constants(rigidities(arm.materials[link.material or ""], self.sections))
        else:
            k, coupled = self.given
        if not k.all():  # it would count as a joint without a spring
            raise SceneError(f"link {link.name!r}: the stiffness of a hinge underflows float64")
        loss = arm.loss_time(link)
        hinges["stiffness"][self.rows], hinges["damping"][self.rows] = k, loss * k
        couplings["stiffness"][self.coupled], couplings["damping"][self.coupled] = coupled, loss * coupled


def rigidities(material: Material, sections: Array) -> Array:
    """GJ, EI_y, EI_z of sections (4, N), shape (3, N), in the order of the axes [N m²]."""
    _, i_y, i_z, torsion = sections
    return np.array([material.shear * torsion, material.young * i_y, material.young * i_z])
