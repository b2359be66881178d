"""Lumping rules as data. A rule places N hinges on a link of length 1 and gives each a weight.

A chain of rigid segments and springs is a quadrature of the curvature integral θ = ∫ M/EI dx: hinges are nodes, with
stiffness k = EI / (weight · length). Its frequencies are what Nyström's method gives for λ κ(x) = ∫ M(x, y) κ(y) dy,
where M(x, y) is the inertial moment at x due to a kink at y. M'' has a kink at x = y, which limits every rule to order
4 in bending, and to order 2 in twist (see `twist_inertias`). This applies without axial load and for small angles;
otherwise only rules with `cells` exceed order 2.
"""

from typing import Annotated, Literal

import msgspec
import numpy as np

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.describe import data_files
from flexlink.describe.schemes.cells import Cells, no_multiple
from flexlink.describe.spec import NonNegative, Positive, Spec

Exponent = Annotated[float, msgspec.Meta(ge=0, le=100)]


class Grid(Spec, frozen=True):
    """Equally spaced nodes: x_j = (first + j − 1) h, j = 1 … N, with h = 1 / (first + N − 1 + last).

    All weights are h, except those listed in `first_weights` and `last_weights`.
    """

    first: NonNegative
    """Distance of the first hinge from the root, in units of the hinge spacing h [1]."""
    last: NonNegative
    """Distance of the last hinge from the tip, in units of h [1]."""
    first_weights: tuple[Positive, ...] = ()
    """Weights of the first hinges, from the root, in units of h; the other weights are h [1]."""
    last_weights: tuple[Positive, ...] = ()
    """Weights of the last hinges, from the tip inward, in units of h [1]."""


class Element(Spec, frozen=True):
    """Nodes and weights on [0, 1], repeated in equal elements along the link."""

    nodes: tuple[NonNegative, ...]
    """Positions of the hinges of an element on [0, 1]."""
    weights: tuple[Positive, ...]
    """Fraction of the element that each hinge represents; the sum is 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.nodes or len(self.nodes) != len(self.weights):
            why = f"expected one per node, {len(self.nodes)}, and at least one"
            raise self._refused("weights", why, "rule-weights")
        if self.nodes[-1] > 1 or np.any(np.diff(self.nodes) <= 0):
            raise self._refused("nodes", "must increase within [0, 1]", "rule-nodes")
        if abs(sum(self.weights) - 1) > 1e-12:  # more than the rounding of weights written with 13 digits
            raise self._refused("weights", "must sum to 1", "rule-weights")


class Jacobi(Spec, frozen=True):
    """Gauss-Jacobi nodes over the link, for the weight function (1 − x)^tip x^root; Gauss-Legendre if both are 0.

    The rule with N hinges is exact for bending moments (1 − x)^tip x^root · (polynomial of degree 2N − 1).
    """

    root: Exponent = 0.0
    """Exponent of x in the weight function (1 − x)^tip x^root."""
    tip: Exponent = 0.0
    """Exponent of 1 − x in the weight function."""


class LumpingRule(Spec, frozen=True):
    """Positions of the hinges of a flexible link, and the part of the beam that each represents.

    `matched_twist` gives the twist hinges the (negative) rotor inertia of `twist_inertias`. M stays positive definite
    for moderate bending: in tests, up to 50° in all hinges, or 40° for a link twice as thick at its tip as at its root;
    at 90° the axes X and Z of a hinge coincide.

    `alternate_axes` reverses the axis order of every second hinge to Z, Y, X. With angles θ = φ + O(φ²) of Rx Ry Rz,
    the springs' energy differs from that of the rotation vector φ by ½ (k_x − k_y + k_z) θ_x θ_y θ_z, which accumulates
    to a first-order error of twist by bending about two axes; with the reversed order it has the opposite sign. A
    second-order error remains wherever a link bends far out of a plane.

    With `springs` = "rotation", the springs of a hinge act on φ itself. The springs of a cell of two hinges act on the
    curvature of the rotation between them, which then also has order 4. This affects links with flex = "xyz": with
    fewer axes every rotation involves twist, and in a plane angles are exact. See
    `flexlink.kernels.forces.rotation_springs`.
    """

    about: str
    """One-sentence description of the rule."""
    source: str
    """Publication or derivation."""
    grid: Grid | None = None
    """Equally spaced hinges; a rule has exactly one of grid, element, jacobi and cells."""
    element: Element | None = None
    """Hinges of an element that is repeated along the link."""
    jacobi: Jacobi | None = None
    """Gauss-Jacobi hinges over the complete link."""
    cells: Cells | None = None
    """Cells of hinges whose springs act together."""
    matched_twist: bool = False
    """Whether twist hinges get the rotor inertia with which twist converges with order 4."""
    alternate_axes: bool = False
    """Whether every second hinge has the axis order Z, Y, X."""
    springs: Literal["angles", "rotation"] = "angles"
    """Coordinates of the springs of three-axis hinges: the three angles, or the rotation vector, which is more accurate
    for bending far out of a plane but not available in other simulators."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum(kind is not None for kind in (self.grid, self.element, self.jacobi, self.cells)) != 1:
            raise SceneError("grid, element, jacobi, cells: a rule has exactly one of the four", id="rule-kind")
        if self.cells is not None and self.matched_twist:
            text = "matched_twist = true: not needed with cells, whose twist has order 4 without it; leave it out"
            raise SceneError(text, id="rule-kind")

    def hinges(self, count: int) -> tuple[Array, Array]:
        """Nodes and weights of `count` hinges on [0, 1]."""
        if self.grid is not None:
            return _grid_hinges(self.grid, count)
        if self.jacobi is not None:
            return _jacobi_hinges(self.jacobi, count)
        if self.cells is not None:
            return self.cells.place(count)
        assert self.element is not None
        size = len(self.element.nodes)
        if count % size:
            raise no_multiple(count, size)
        elements = count // size
        nodes = (np.arange(elements)[:, None] + np.array(self.element.nodes)) / elements
        return nodes.ravel(), np.tile(self.element.weights, elements) / elements

    def takes(self, count: int) -> bool:
        """Whether the rule exists for `count` hinges."""
        try:
            self.hinges(count)
        except ArgumentError:
            return False
        return True

    def twist_inertias(self, weights: Array, inertias: Array, moments: Array) -> Array:
        """Rotor inertia of the twist hinges [kg m²], shape (N,); zero unless `matched_twist`.

        The twist angle of a beam varies linearly between hinges, but the chain's twist angle has steps. Under uniform
        twist (per unit of acceleration) the beam carries the moment ∫_{x_i}^1 ξ p dξ beyond hinge i, p(ξ) = ρ I_p L.
        The chain is turned by C(ξ) = Σ w_j over x_j ≤ ξ and carries ∫_{x_i}^1 C p dξ. The difference is assigned to the
        hinge as an inertia of the relative motion,

            r_i = 1/w_i ∫_{x_i}^1 (ξ − C(ξ)) p(ξ) dξ                                                 (negative).

        In the integral equation λ GJ κ(x) = ∫ P(max(x, y)) κ(y) dy, P(x) = ∫_x^1 p dξ, this subtracts the kink of the
        kernel at y = x, ∫ P κ dy = κ(x) ∫ P dy + ∫ P (κ(y) − κ(x)) dy (Kantorovich & Krylov 1958), which raises
        Nyström's method from order 2, the limit of every rule here, to order 4, with or without taper. The rule must be
        exact for quadratics, which excludes the midpoint rule. `inertias` and `moments`, ∫ p dξ and ∫ ξ p dξ, are from
        each hinge to the next, or from the last to the end [kg m²], shape (N,) as `weights`.
        """
        return matched_inertias(weights, inertias, moments) if self.matched_twist else np.zeros(len(weights))


def matched_inertias(weights: Array, inertias: Array, moments: Array) -> Array:
    """Inertias r_i of `LumpingRule.twist_inertias`, (…, N), also [kg] for a mass per length in the place of ρ I_p."""
    excess = moments - np.cumsum(weights) * inertias
    return np.asarray(np.cumsum(excess[..., ::-1], axis=-1)[..., ::-1] / weights)


def exact_for_quadratics(nodes: Array, weights: Array) -> bool:
    """Whether a rule integrates polynomials of degree 2 over [0, 1] exactly."""
    return all(abs(weights @ nodes**k - 1 / (k + 1)) < 1e-9 for k in range(3))  # more than rounding of the rule's data


def _grid_hinges(grid: Grid, count: int) -> tuple[Array, Array]:
    corrected = len(grid.first_weights) + len(grid.last_weights)
    spaces = grid.first + count - 1 + grid.last
    if count < max(1, corrected) or spaces <= 0:
        raise ArgumentError(f"needs at least {max(1, corrected) + 1} segments", id="segments-of-rule")
    weights = np.ones(count)
    weights[: len(grid.first_weights)] = grid.first_weights
    weights[count - len(grid.last_weights) :] = grid.last_weights[::-1]
    return (grid.first + np.arange(count, dtype=np.float64)) / spaces, weights / spaces


def _jacobi_hinges(jacobi: Jacobi, count: int) -> tuple[Array, Array]:
    from scipy import special  # noqa: PLC0415  takes 0.2 s, and few scenes need it

    if count > 1000:  # the eigenvalue problem costs O(N²)
        raise ArgumentError("takes at most 1001 segments; rules such as gauss take any number", id="segments-of-rule")
    t, w = special.roots_jacobi(count, jacobi.tip, jacobi.root)  # nodes on [−1, 1]; w includes the weight function
    x: Array = np.array((1 + t) / 2)
    weighted: Array = np.array(w / 2 ** (1 + jacobi.tip + jacobi.root))
    return x, np.asarray(weighted / ((1 - x) ** jacobi.tip * x**jacobi.root), dtype=np.float64)


def lumping_rule(name: str) -> LumpingRule:
    """Load a built-in rule, or the user's TOML file."""
    return data_files.load("lumping", "lumping", name, LumpingRule)
