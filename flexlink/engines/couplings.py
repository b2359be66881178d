"""Springs and dampers between two joints, as an engine has read them, and torques that engines do not compute.

The list is an array of dtype `COUPLING` with the engine's joint numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import add_products
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.kernels.layout import COUPLING

COUPLED_FIELDS = {"coupled_stiffness": "stiffness", "coupled_damping": "damping"}
"""Maps fields of `ReadBack` to fields of couplings and hinges."""


def to_matrices(couplings: NDArray[np.void], n: int) -> dict[str, Array]:
    """Return `COUPLED_FIELDS` of n joints: symmetric K_ij and D_ij with zero diagonal, shape (n, n)."""
    fields = {field: np.zeros((n, n)) for field in COUPLED_FIELDS}
    for field, matrix in fields.items():
        i, j = couplings["inner"], couplings["outer"]
        matrix[i, j] = matrix[j, i] = couplings[COUPLED_FIELDS[field]]
    return fields


def of_matrices(fields: Mapping[str, Array]) -> NDArray[np.void]:
    """Convert the matrices `COUPLED_FIELDS` to a list of couplings."""
    K, D = (fields[field] for field in COUPLED_FIELDS)
    inner, outer = np.nonzero(np.triu((K != 0) | (D != 0), 1))
    couplings = np.zeros(len(inner), COUPLING)
    couplings["inner"], couplings["outer"] = inner, outer
    couplings["stiffness"], couplings["damping"] = K[inner, outer], D[inner, outer]
    return couplings


def of_elements(elements: Iterable[ET.Element], joints: Sequence[str]) -> NDArray[np.void]:
    """Return the couplings that flexlink's elements in a file specify; couplings of the same joint pair add up."""
    number, found = {name: k for k, name in enumerate(joints)}, dict[tuple[int, int], Array]()
    for element in elements:
        ends = [element.get(key, "") for key in ("inner", "outer")]
        i, j = sorted(number.get(name, -1) for name in ends)
        if i < 0 or i == j:
            raise ArgumentError(
                f"coupling of {ends[0]!r} and {ends[1]!r}: expected two joints of the file", id="coupling-in-file"
            )
        try:
            constants = np.array([float(element.get(key, "")) for key in COUPLED_FIELDS.values()])
        except ValueError as error:
            raise ArgumentError(f"coupling of {ends[0]!r} and {ends[1]!r}: {error}", id="coupling-in-file") from None
        found[i, j] = found.get((i, j), 0.0) + constants
    return np.array([(*pair, *constants) for pair, constants in found.items()], dtype=COUPLING)


def torque(couplings: NDArray[np.void], field: str, φ: Array) -> Array:
    """Return the torque of the couplings, Σ_j K_ij φ_j for `field` "stiffness" or Σ_j D_ij φ_j for "damping", (n,)."""
    total = np.zeros(len(φ))
    add_products(total, couplings, couplings[field], φ)
    return total
