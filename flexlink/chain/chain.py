"""Chain: the arm as rigid bodies and one-axis hinges, in read-only arrays; the only model that algorithms take.

A body is a rigid segment. It is attached to its parent (in an unbranched arm, the previous body) by a fixed
transformation (`rotation`, `translation`) followed by its hinges. The hinges of a body share one point, and their
order is X, Y, Z, or Z, Y, X at every second hinge of a lumping rule with `alternate_axes`. A body may instead slide
along a prismatic joint. The last body of every link without child links is followed by its tip frame, a body without
hinges and inertia; the last body is the frame of the arm's tip.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import vector
from flexlink.chain.coordinates import Coordinate, Kind
from flexlink.chain.layout import OF_LAYOUT, Layout, spans_of, sums_outward
from flexlink.chain.rigid import DESCRIBED
from flexlink.chain.size import at_any_posture, on_elastic_gears, size_without_reach, turning_radii, without_lever
from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.types import Array, Indices
from flexlink.common.wording import short_list
from flexlink.kernels.bodies.shaped_mass import Shapes
from flexlink.kernels.geometry.kinematics import KinematicsWork, forward_kinematics
from flexlink.kernels.layout import COUPLING, FORCES, ChainArrays, Rare


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Chain(Layout):
    """A serial chain or tree of `n` one-axis hinges.

    Attributes
    ----------
    name
        Name of the arm, for exporters and messages.
    bodies, hinges
        Structured arrays of dtype `BODY` and `HINGE`, read-only.
    gravity
        Acceleration due to gravity in the inertial frame 0 [m/s²], shape (3,).
    coordinates
        Three-index coordinate of every hinge, in the order of `hinges`.
    link_names
        Names of the arm's links; `Coordinate.link` is their number, from 1.
    couplings
        Springs and dampers between two hinges, structured array of dtype `COUPLING`, read-only; none by default.
    forces
        Other force elements by name, structured arrays of dtype `FORCES[name]`, read-only; none by default. For
        example, "drag" contains the points at which aerodynamic drag acts.
    tips
        Index in `bodies` of the tip frame of every link without child links, by the link's name. The last one is the
        arm's tip; by default it is the last body and the only tip.
    joints_of_links
        Name of each link's joint, in the order of `link_names`; by default the link's name.
    shapes
        Shapes by which the hinges move together, q̇ = Φ ż, of links with `modes`; None: the hinges move one by one.
    described
        For each body, axes of its link and of its section in axes of the body, `described["link"]` and
        `described["section"]`, structured array of dtype `DESCRIBED`, read-only; by default they are equal.

    Examples
    --------
    >>> chain
    <Chain 'two_links': 6 joints, 2 of them driven; 6.15281 kg>
    >>> print(chain.n, chain.joint_names)
    6 ('upper', 'upper.1.z', 'upper.2.z', 'fore', 'fore.1.z', 'fore.2.z')
    >>> print(chain.active, chain.stiffness[chain.bending].round(0))  # N m/rad
    [0 3] [17194. 17194. 21492. 21492.]
    >>> picture = chain.plot(q)
    """

    name: str
    bodies: NDArray[np.void]
    hinges: NDArray[np.void]
    gravity: Array
    coordinates: tuple[Coordinate, ...]
    link_names: tuple[str, ...]
    couplings: NDArray[np.void] = dataclasses.field(default_factory=lambda: np.zeros(0, COUPLING))
    tips: dict[str, int] = dataclasses.field(default_factory=dict)
    forces: dict[str, NDArray[np.void]] = dataclasses.field(default_factory=dict)
    shapes: Shapes | None = None
    described: NDArray[np.void] = dataclasses.field(default_factory=lambda: np.zeros(0, DESCRIBED))
    joints_of_links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints_of_links", self.joints_of_links or self.link_names)
        if not self.tips and self.link_names:
            object.__setattr__(self, "tips", {self.link_names[-1]: len(self.bodies) - 1})
        if not len(self.described):
            alike = np.zeros(len(self.bodies), DESCRIBED)
            alike["link"] = alike["section"] = np.eye(3)
            object.__setattr__(self, "described", alike)
        parts = self.bodies, self.hinges, self.gravity, self.couplings, self.described
        for array in (*parts, *self.forces.values()):
            array.flags.writeable = False

    def __reduce__(self) -> tuple[type[Chain], tuple[object, ...]]:
        """Rebuild copies and pickles with the constructor, so arrays are read-only, as compiled kernels require."""
        return Chain, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    def __repr__(self) -> str:
        shapes = "" if self.shapes is None else f" that move by {self.freedoms} shapes"
        return f"<Chain {self.name!r}: {self.n} joints{shapes}, {len(self.active)} of them driven; {self.mass:.6g} kg>"

    def _repr_html_(self) -> str:
        hinges = self.hinges
        heads = ["k", "joint", "driven", "stiffness [N m/rad]", "damping [N m s/rad]", "rest [rad]"]
        if self.slides.any():
            heads[3:] = ["stiffness [N m/rad; N/m]", "damping [N m s/rad; N s/m]", "rest [rad; m]"]
        columns: list[list[Any]] = [hinges[name].tolist() for name in ("stiffness", "damping", "rest")]
        if len(self.couplings):
            heads.append("coupled with")
            columns.append([short_list(list(map(str, coupled))) for coupled in self.coupled_joints])
        if self.slides.any():
            heads.append("slides")
            columns.append(["yes" if slides else "" for slides in self.slides.tolist()])
        driven = ["yes" if c.kind is Kind.JOINT else "" for c in self.coordinates]
        rows = list(zip(range(self.n), self.joint_names, driven, *columns, strict=True))
        return html_table(repr(self), tuple(heads), rows)

    def plot(self, q: ArrayLike | None = None, *, ax: Any = None) -> Any:
        """Draw the arm at angles q [rad], shape (n,), from the side and, unless it is planar, from above.

        Without q, joints are at zero and springs unloaded. Returns a matplotlib Figure, which a notebook displays; it
        is that of `ax`, axes to draw in, one for each view, or a new one.

        Raises
        ------
        ArgumentError
            `q` has the wrong shape, is not real or not finite; or there are more or fewer axes than views.
        MissingDependencyError
            matplotlib is not installed.
        """
        return drawing_module("scene_report.arm_picture").plot_chain(self, q, ax=ax)

    def with_numbers(self, **fields: Any) -> Chain:
        """Return the chain with other field values but the same layout; cached layout data are reused."""
        other, known = dataclasses.replace(self, **fields), vars(self)
        vars(other).update((name, known[name]) for name in OF_LAYOUT if name in known)
        return other

    @functools.cached_property
    def arrays(self) -> ChainArrays:
        """View of this chain for kernels."""
        rare = self._rare if self.forces or self.springs_join_hinges or not self.is_serial_revolute else None
        return ChainArrays(self.bodies, self.hinges, self.gravity, rare)

    @property
    def _rare(self) -> Rare:
        return Rare(*(self.force(name) for name in Rare._fields))

    def force(self, name: str) -> NDArray[np.void]:
        """Force elements of this name, "couplings", "drag", ...; an empty array if there are none."""
        if name == "couplings":
            return self.couplings
        nothing = np.frombuffer(b"", FORCES[name])  # read-only like all arrays of a chain, so compiled types match
        return self.forces.get(name, nothing)

    def without_forces(self) -> Chain:
        """Return the chain without the elements of `forces`; the same chain if it has none."""
        return dataclasses.replace(self, forces={}) if self.forces else self

    @property
    def drag(self) -> NDArray[np.void]:
        """Points at which the links have drag, structured array of dtype `DRAG`."""
        return self.force("drag")

    def as_full(self) -> Chain:
        """Return the same chain in the form for the general kernels, which support all features, used or not."""
        other = dataclasses.replace(self)
        known = {name: value for name, value in vars(self).items() if not name.startswith("bound ")}
        vars(other).update(known | {"arrays": self.arrays._replace(rare=self._rare)})
        return other

    @functools.cached_property
    def mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self.bodies["mass"].sum())

    def com(self, q: ArrayLike) -> Array:
        """Centre of mass of all bodies at angles q [rad], shape (n,), in frame 0, shape (3,) [m].

        Raises
        ------
        ArgumentError
            `q` has the wrong shape, is not real or not finite, or the chain has no mass.

        Examples
        --------
        >>> print(chain.com(q)[:2].round(3))  # m
        [1.286 0.154]
        """
        if self.mass == 0:
            raise ArgumentError(f"{self.name!r}: has no mass, so it has no centre of mass", id="no-mass")
        placed = forward_kinematics(self.arrays, vector("q", q, self.n))
        centers = placed.points + np.einsum("ijk,ik->ij", placed.rotations, self.bodies["center"])
        return np.asarray(self.bodies["mass"] @ centers / self.mass)

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom: `n`, or the number of shapes by which the hinges move."""
        return self.n if self.shapes is None else self.shapes.matrix.shape[1]

    @functools.cached_property
    def freedom_names(self) -> tuple[str, ...]:
        """Names of the degrees of freedom: those of the joints, and "boom.mode1.z" for the first shape of a link."""
        if self.shapes is None:
            return self.joint_names
        names, counts = list[str](), dict[tuple[int, int], int]()
        for hinges in (np.flatnonzero(column) for column in self.shapes.matrix.T):
            c = self.coordinates[hinges[0]]
            if len(hinges) > 1 or self.shapes.stop[hinges[0]] - self.shapes.first[hinges[0]] > 1:
                number = counts[c.link, c.axis] = counts.get((c.link, c.axis), 0) + 1
                names.append(f"{self.link_names[c.link - 1]}.mode{number}.{' xyz'[c.axis]}")
            else:
                names.append(self.joint_names[hinges[0]])
        return tuple(names)

    @property
    def stiffness(self) -> Array:
        """Spring constants k [N m/rad], shape (n,); K_ii of coupled springs; 0 for active joints."""
        return self.hinges["stiffness"]

    @property
    def damping(self) -> Array:
        """Viscous coefficients d [N m s/rad], shape (n,), including structural damping; D_ii of coupled dampers."""
        return self.hinges["damping"]

    @property
    def rest(self) -> Array:
        """Angles θ₀ at which the springs are unloaded [rad], shape (n,)."""
        return self.hinges["rest"]

    def matrix(self, field: str) -> Array:
        """K of all springs if `field` is "stiffness", D of all dampers if "damping", shape (n, n), with couplings."""
        matrix, (i, j) = np.diag(self.hinges[field]), (self.couplings["inner"], self.couplings["outer"])
        if len(self.couplings):
            matrix[i, j] = matrix[j, i] = self.couplings[field]
        return matrix

    def times(self, field: str, φ: Array, *, absolute: bool = False) -> Array:
        """K φ if `field` is "stiffness", D φ if "damping", for angles or rates φ (n,) or (b, n), in O(n).

        With `absolute`, return |K| |φ|, which bounds the rounding error of the product.
        """
        value = self.couplings[field]
        if absolute:
            φ, value = np.abs(φ), np.abs(value)
        product: Array = self.hinges[field] * φ
        if len(value):
            add_products(product, self.couplings, value, φ)
        return product

    @functools.cached_property
    def reach(self) -> float:
        """Upper bound of the distance of any mass from the origin of frame 0 [m]."""
        if self.is_serial_revolute:
            return float(_lengths(self.bodies["translation"]).sum() + _lengths(self.bodies["center"]).max())
        return float((sums_outward(spans_of(self.bodies), self.lengths) + _lengths(self.bodies["center"])).max())

    @functools.cached_property
    def size(self) -> float:
        """Characteristic length [m], never 0: the reach or, if this is 0 (a cart, a wheel), √(J/m) or 1 m.

        Relative tolerances are multiplied by it. J is the largest inertia that turns [kg m²], m the total mass [kg].
        """
        return self.reach or size_without_reach(self.bodies, self.hinges)

    @property
    def size_name(self) -> str:
        """Name of `size`, for messages."""
        return "reach" if self.reach else "size"

    @functools.cached_property
    def has_levers(self) -> bool:
        """Whether turning some joint moves a point, as in most arms; if not, errors are angles times `size`."""
        without = len(self._without_lever)
        return not without or without < self.n - int(self.slides.sum())

    @functools.cached_property
    def turning_radii(self) -> Array:
        """Factors from angles to displacements for joints that move no point [m], 0 for other joints, (n,), or (0,).

        The factor is `size` if no joint has a lever, otherwise a radius of gyration, reduced for motors on elastic
        gears. Shape (0,) means that there are no such joints.
        """
        if not self.has_levers:
            return np.where(self.slides, 0.0, self.size)
        free, motors = self._without_lever, on_elastic_gears(self.arrays)
        some = len(free) or len(motors)
        return turning_radii(self.arrays, free, motors, self.size, self._anywhere) if some else np.empty(0)

    @functools.cached_property
    def _without_lever(self) -> Indices:
        return without_lever(self.arrays, self.reach, lambda: self._anywhere)

    @functools.cached_property
    def _anywhere(self) -> KinematicsWork:
        return at_any_posture(self.arrays, self.size)

    @property
    def lengths(self) -> Array:
        """Distance from each body's parent to its hinges [m], (bodies,); sliding joints are at their farthest limit."""
        lengths: Array = _lengths(self.bodies["translation"])
        if np.count_nonzero(self.slides):
            limits = np.maximum(np.abs(self.hinges["lower"]), np.abs(self.hinges["upper"]))
            slid = np.zeros(self.n + 1)
            np.cumsum(np.where(self.slides & np.isfinite(limits), limits, 0.0), out=slid[1:])
            lengths += slid[self.bodies["stop"]] - slid[self.bodies["first"]]
        return lengths

    @functools.cached_property
    def weight(self) -> float:
        """Σ m g of all bodies [N]."""
        return self.mass * math.sqrt(self.gravity @ self.gravity)


def _lengths(vectors: Array) -> Array:
    """Lengths of vectors (b, 3), shape (b,)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=1)))


def merged(couplings: NDArray[np.void]) -> NDArray[np.void]:
    """Couplings of which each pair of hinges occurs once, sorted, with the sums of their constants."""
    n = couplings["outer"].max(initial=0) + 1
    pairs, pair_index = np.unique(couplings["inner"] * n + couplings["outer"], return_inverse=True)
    joined = np.zeros(len(pairs), COUPLING)
    joined["inner"], joined["outer"] = divmod(pairs, n)
    for field in ("stiffness", "damping"):
        joined[field] = np.bincount(pair_index, couplings[field], len(pairs))
    return joined


def add_products(product: Array, couplings: NDArray[np.void], value: Array, φ: Array) -> None:
    """For each coupling of hinges i and j, add `value` φ_j to row i of the product, and `value` φ_i to row j."""
    inner, outer = couplings["inner"], couplings["outer"]
    np.add.at(product.T, inner, (value * φ[..., outer]).T)
    np.add.at(product.T, outer, (value * φ[..., inner]).T)
