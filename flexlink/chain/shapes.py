"""Shapes of links with `modes`: their hinges move together, q̇ = Φ ż, by a few strain modes for each direction.

A shape is a curvature along the link, the angles of its hinges: bending about y or z of the section, or twist. The
curvature, not the displacement, is a sum of shapes, so nothing is linearised. All other joints move one by one.

eigenmodes      K φ = ω² M φ for the link's hinges in one direction, with all distal bodies, all springs slack, all
                other joints at zero and locked; the slowest first
polynomials     the bending or twisting moment k φ is a Legendre polynomial of the position of the hinge along the link

Each shape is divided by its largest entry, so its coordinate is the angle of the hinge that moves most [rad].
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Kind
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.describe.link import AXES
from flexlink.describe.scene import Scene
from flexlink.kernels.bodies.mass import mass_upper
from flexlink.kernels.bodies.shaped_mass import Shapes

Hinges = NDArray[np.intp]


def with_shapes(chain: Chain, scene: Scene) -> Chain:
    """Return the chain with the shapes of all links with `modes`; the same chain if no link has any."""
    shaped = [(k, link, modes) for k, link in enumerate(scene.arm.links, 1) if (modes := link.strain_modes) is not None]
    if not shaped:
        return chain
    M, K = np.zeros((chain.n, chain.n)), chain.matrix("stiffness")
    mass_upper(chain.arrays, chain.rest.copy(), M)
    places = np.cumsum(chain.lengths)[np.searchsorted(chain.bodies["stop"], np.arange(chain.n), side="right")]
    parts: list[tuple[Hinges, Array]] = []
    for number, link, modes in shaped:
        for axis in AXES[link.flex]:
            hinges = chain.where(Kind.HINGE, link=number, axis=axis)
            count = modes.of_axis(axis)
            if count > len(hinges):
                text = f"link {link.name!r}: modes.{'xyz'[axis - 1]} = {count}: the link has {len(hinges)} hinges in "
                text += f"this direction; use at most {len(hinges)} modes, or more segments"
                raise SceneError(text, id="too-many-modes")
            block = np.ix_(hinges, hinges)
            try:
                shapes = SHAPES[modes.shapes](places[hinges], K[block], M[block], count)
            except np.linalg.LinAlgError:
                text = f"link {link.name!r}: modes: a hinge moves no inertia; use modes.shapes = 'polynomials'"
                raise SceneError(text, id="hinge-without-inertia") from None
            parts.append((hinges, scaled(shapes)))
    return dataclasses.replace(chain, shapes=joined(chain, parts))


def eigenmodes(x: Array, K: Array, M: Array, count: int) -> Array:
    """Angles of the `count` slowest modes K φ = ω² M φ of a link's hinges, all other joints locked, (h, count)."""
    return np.asarray(scipy.linalg.eigh(K, M)[1][:, :count])


def polynomials(x: Array, K: Array, M: Array, count: int) -> Array:
    """Angles due to moments that are Legendre polynomials along the link, of degree 0 … count − 1, (h, count)."""
    span = x[-1] - x[0] or 1.0
    return np.asarray(np.linalg.solve(K, np.polynomial.legendre.legvander(2 * (x - x[0]) / span - 1, count - 1)))


SHAPES: dict[str, Callable[[Array, Array, Array, int], Array]] = {"eigenmodes": eigenmodes, "polynomials": polynomials}
"""Families of shapes by name: functions of the places of a link's hinges along it [m], their stiffness and inertia, and
the number of shapes."""


def scaled(vectors: NDArray[Any]) -> NDArray[Any]:
    """Divide columns by their largest entry, or the first of several equal ones, so rounding does not affect signs."""
    sizes, equal = np.abs(vectors), 1e-6  # rounding makes entries of equal size differ in symmetric arms
    first = (sizes >= (1 - equal) * sizes.max(axis=0)).argmax(axis=0)
    return np.asarray(vectors / vectors[first, np.arange(vectors.shape[1])])


def joined(chain: Chain, parts: list[tuple[Hinges, Array]]) -> Shapes:
    """Φ of the whole chain, columns in the order of their first hinges; every other joint has one column."""
    shaped = {int(k) for hinges, _ in parts for k in hinges}
    alone = [(np.array([k], dtype=np.intp), np.ones((1, 1))) for k in range(chain.n) if k not in shaped]
    parts = sorted([*parts, *alone], key=lambda part: int(part[0][0]))
    first, stop, columns = np.zeros(chain.n, np.intp), np.zeros(chain.n, np.intp), 0
    Φ = np.zeros((chain.n, sum(shapes.shape[1] for _, shapes in parts)))
    for hinges, shapes in parts:
        first[hinges], stop[hinges] = columns, columns + shapes.shape[1]
        Φ[hinges, columns : columns + shapes.shape[1]] = shapes
        columns += shapes.shape[1]
    return shapes_of(chain, Φ, first, stop)


def shapes_of(chain: Chain, Φ: Array, first: Hinges, stop: Hinges) -> Shapes:
    """The shapes Φ (n, m) of a chain; those of hinge k are first … stop − 1."""
    inverse = np.ascontiguousarray(np.linalg.pinv(Φ).T)
    for j in range(Φ.shape[1]):  # other links have no share: their entries are rounding errors
        inverse[(first > j) | (stop <= j), j] = 0.0
    moves = moved_by(chain, Φ)
    found = Shapes(Φ, first, stop, inverse, np.argmax(moves, axis=1), moves.astype(np.float64))
    for array in found:
        array.flags.writeable = False
    return found


def shaped_hinges(chain: Chain) -> Hinges:
    """Indices of the hinges that move by shapes."""
    if chain.shapes is None:
        return np.zeros(0, dtype=np.intp)
    shared = (chain.shapes.matrix != 0).sum(axis=0) > 1
    return np.flatnonzero((chain.shapes.matrix[:, shared] != 0).any(axis=1))


def moved_by(chain: Chain, Φ: Array) -> NDArray[np.bool_]:
    """Whether each shape moves a hinge of a body or of a body outboard, (bodies, m)."""
    moves = np.zeros((len(chain.bodies), Φ.shape[1]), dtype=bool)
    for i in range(len(chain.bodies) - 1, -1, -1):
        body = chain.bodies[i]
        moves[i] |= (Φ[body["first"] : body["stop"]] != 0).any(axis=0)
        if body["parent"] > 0:
            moves[body["parent"] - 1] |= moves[i]
    return moves


def refuse_shapes(chain: Chain, what: str) -> None:
    """Refuse a chain with shapes in a function that does not support them; `what` begins the message."""
    if chain.shapes is not None:
        remedy = 'use the chain of their hinges, scene.varied({"link.*.modes": None})'
        text = f"{chain.name}: {what} does not support links with modes; {remedy}"
        raise ArgumentError(text, id="modes-not-supported")


def on_shapes(chain: Chain, name: str, change: Array, per: str = "") -> None:
    """Refuse a change of angles or, with `per` = "/s", rates (n,) that is no sum of its shapes up to rounding."""
    if chain.shapes is None:
        return
    Φ, size = chain.shapes.matrix, np.abs(change).max(initial=0.0)
    beside = change - Φ @ (chain.shapes.inverse.T @ change)
    k = int(np.argmax(np.abs(beside)))
    if not abs(beside[k]) <= 1e-9 * size:
        text = f"{name}: joint {chain.joint_name(k)!r} is {abs(beside[k]):.3g} {chain.joint_units[k]}{per} away from "
        text += f"the closest sum of the shapes of {chain.name!r}; give a state of this chain, such as rest or the end "
        raise ArgumentError(f"{text}of one of its runs", id="not-a-shape")
