"""Write springs and dampers between two joints as fixed tendons of MJCF.

A tendon of length θ_i ± θ_j with stiffness |K_ij| adds |K_ij| to both joint stiffnesses and ±|K_ij| to their coupling,
with the sign of K_ij. Dampers are treated in the same way. The joints keep

    K_ii − Σ_j |K_ij|        D_ii − Σ_j |D_ij|

which must not be negative. Without `springlength` a tendon is slack at the joints' `springref`, like their springs. If
K_ij and D_ij have different signs, the damper gets a separate tendon.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.formats.document import decimals

SHARED = {"stiffness": ("springs", "N m/rad"), "damping": ("dampers", "N m s/rad")}
"""Fields of a hinge to which tendons contribute, each with its name in messages and its unit."""


def add_tendons(root: ET.Element, chain: Chain, joints: Sequence[str]) -> None:
    """Add the tendons of a chain, named "inner:outer" after their joints, in the order of its couplings."""
    if not len(chain.couplings):
        return
    parent, found = ET.SubElement(root, "tendon"), list(_tendons(chain))
    names = unique(f"{joints[inner]}:{joints[outer]}" for inner, outer, *_ in found)
    for name, (inner, outer, sign, stiffness, damping) in zip(names, found, strict=True):
        numbers = {"stiffness": decimals([stiffness]), "damping": decimals([damping])}
        tendon = ET.SubElement(parent, "fixed", {"name": name} | numbers)
        ET.SubElement(tendon, "joint", joint=joints[inner], coef="1")
        ET.SubElement(tendon, "joint", joint=joints[outer], coef=str(sign))


def diagonal_remainder(chain: Chain, field: str) -> Array:
    """Return K_ii − Σ_j |K_ij| for `field` "stiffness", or D_ii − Σ_j |D_ij| for "damping", shape (n,).

    Raises
    ------
    ArgumentError
        A value is negative; the message names the joint and its link.
    """
    own, taken, value = chain.hinges[field], np.zeros(chain.n), np.abs(chain.couplings[field])
    for end in ("inner", "outer"):
        np.add.at(taken, chain.couplings[end], value)
    left = own - taken
    if (left < 0).any():
        k, (name, unit) = int(np.argmin(left)), SHARED[field]
        raise ArgumentError(
            f"joint {chain.joint_name(k)!r}: {name} to other joints of its cell total {taken[k]:.6g} {unit}, more than "
            f"its own {own[k]:.6g} {unit}: MuJoCo's tendons cannot represent that; {_instead(chain, k, field)}",
            id="tendon-stiffness",
        )
    return left


def _instead(chain: Chain, k: int, field: str) -> str:
    """Return the remedy; only damping with `law = "constant"` couples joints without a spring."""
    if field == "damping" and (chain.couplings["stiffness"] == 0).any():
        return "use damping of law = 'proportional', or URDF or SDF"
    link = chain.link_names[chain.coordinate(k).link - 1]
    return f"use more segments in link {link!r}, whose section or material changes too fast, or use URDF or SDF"


def _tendons(chain: Chain) -> Iterator[tuple[int, int, int, float, float]]:
    """Yield fixed tendons over two joints with coefficients 1 and ±1: both joints, the sign, stiffness, damping."""
    for coupling in chain.couplings:
        i, j, k, d = coupling.item()
        if k * d < 0:
            yield i, j, -1 if k < 0 else 1, abs(k), 0.0
            yield i, j, -1 if d < 0 else 1, 0.0, abs(d)
        else:
            yield i, j, -1 if k < 0 or d < 0 else 1, abs(k), abs(d)
