"""Chain: the arm as rigid bodies and one-axis hinges, read-only arrays, the only input of every algorithm.

A body is a rigid segment. It hangs on one before it, of an arm that does not branch on the one right before it, by a
fixed placement (`rotation`, `translation`) followed by its hinges, all at one point, in the order of their numbers: X,
Y, Z, or, at every second hinge of a lumping rule with `alternate_axes`, Z, Y, X; or by those of a prismatic joint,
along which it slides. Behind the last body of every link that no other hangs on comes one without hinges and inertia,
its tip frame; the last of all is the frame of the arm's tip.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
from collections.abc import Iterable
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, number_of, require_type, vector
from flexlink.chain.coordinates import LAG, Coordinate, joint_names
from flexlink.chain.couplings import add_products
from flexlink.chain.size import on_elastic_gears, size_without_reach, turning_radii, without_lever
from flexlink.chain.spans import spans_of, sums_outward
from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.types import Array, Indices
from flexlink.common.wording import short_list, truncated
from flexlink.describe.links import link_number
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.layout import COUPLING, FORCES, SLIDES, ChainArrays, Rare

_OF_LAYOUT = {
    "active", "internal", "slides", "is_serial", "is_serial_revolute", "has_free_base", "joint_units", "bending",
    "axes", "coupled_joints", "has_rotation_springs", "is_planar", "joint_names", "_sequential", "_layout",
}  # fmt: skip
"""What is found of a chain without its masses, springs and gravity."""

Joints = str | int | Iterable[str | int | np.integer[Any] | np.bool_]
"""Joints of a chain: see `Chain.joint_indices`."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Chain:
    """A chain of `n` one-axis hinges, or a tree of them.

    Attributes
    ----------
    name
        Name of the arm, for exporters and messages.
    bodies, hinges
        Structured arrays of dtype `BODY` and `HINGE`, read-only.
    gravity
        Acceleration of gravity in the inertial frame 0 [m/s²], shape (3,).
    coordinates
        The three-index coordinate of every hinge, in sequential order.
    link_names
        Names of the arm's links; `Coordinate.link` counts them from 1.
    couplings
        Springs and dampers between two hinges, structured array of dtype `COUPLING`, read-only; none by default.
    forces
        Other force elements by name, structured arrays of dtype `FORCES[name]`, read-only; none by default. "drag":
        points at which the links meet drag of the air.
    tips
        Number in `bodies` of the tip frame of every link that no other hangs on, by the link's name; the last one is
        the arm's tip. By default the last body is the only one.

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

    def __post_init__(self) -> None:
        if not self.tips and self.link_names:
            object.__setattr__(self, "tips", {self.link_names[-1]: len(self.bodies) - 1})
        for array in (self.bodies, self.hinges, self.gravity, self.couplings, *self.forces.values()):
            array.flags.writeable = False

    def __reduce__(self) -> tuple[type[Chain], tuple[object, ...]]:
        """Copies and pickles are built anew: their arrays, too, are read-only, which the compiled kernels expect."""
        return Chain, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    def __repr__(self) -> str:
        return f"<Chain {self.name!r}: {self.n} joints, {len(self.active)} of them driven; {self.mass:.6g} kg>"

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
        driven = ["yes" if c.axis == 0 else "" for c in self.coordinates]
        rows = list(zip(range(self.n), self.joint_names, driven, *columns, strict=True))
        return html_table(repr(self), tuple(heads), rows)

    def plot(self, q: ArrayLike | None = None) -> Any:
        """Draw the arm at angles q [rad], shape (n,), from the side and, if it is not in a plane, from above.

        Without q joints are at zero and springs slack. Returns a matplotlib Figure, which a notebook shows once.

        Raises
        ------
        ArgumentError
            `q` has the wrong shape, is not real or not finite.
        MissingDependencyError
            matplotlib is not installed.
        """
        return drawing_module("scene_report.arm_picture").plot_chain(self, q)

    def with_numbers(
        self,
        name: str,
        bodies: NDArray[np.void],
        hinges: NDArray[np.void],
        gravity: Array,
        couplings: NDArray[np.void],
    ) -> Chain:
        """A chain whose hinges stand as they do here; what has been found of that is not sought again."""
        names = self.coordinates, self.link_names
        other = Chain(name, bodies, hinges, gravity, *names, couplings, self.tips, self.forces)
        known = vars(self)
        vars(other).update((name, known[name]) for name in _OF_LAYOUT if name in known)
        return other

    @functools.cached_property
    def arrays(self) -> ChainArrays:
        """The kernels' view of this chain."""
        forces = len(self.couplings) or self.forces or self.has_rotation_springs
        rare = self._rare if forces or not self.is_serial_revolute else None
        return ChainArrays(self.bodies, self.hinges, self.gravity, rare)

    @property
    def _rare(self) -> Rare:
        return Rare(*(self.force(name) for name in Rare._fields))

    def force(self, name: str) -> NDArray[np.void]:
        """The force elements of a name, "couplings", "drag", ...; an empty array where there are none."""
        if name == "couplings":
            return self.couplings
        nothing = np.frombuffer(b"", FORCES[name])  # read-only as all of a chain: of one type to compiled loops
        return self.forces.get(name, nothing)

    def without_forces(self) -> Chain:
        """The chain without the elements of `forces`; itself where it has none."""
        return dataclasses.replace(self, forces={}) if self.forces else self

    @property
    def drag(self) -> NDArray[np.void]:
        """Points at which the links meet drag, structured array of dtype `DRAG`."""
        return self.force("drag")

    def as_full(self) -> Chain:
        """The same chain for loops that know all features, whether it has them or not."""
        other = dataclasses.replace(self)
        vars(other).update(vars(self) | {"arrays": self.arrays._replace(rare=self._rare)})
        return other

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return len(self.hinges)

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
            raise ArgumentError(f"{self.name!r}: has no mass, and so no centre of mass")
        placed = forward_kinematics(self.arrays, vector("q", q, self.n))
        centers = placed.points + np.einsum("ijk,ik->ij", placed.rotations, self.bodies["center"])
        return np.asarray(self.bodies["mass"] @ centers / self.mass)

    @property
    def stiffness(self) -> Array:
        """Spring constants k [N m/rad], shape (n,), K_ii of coupled springs; 0 on active joints."""
        return self.hinges["stiffness"]

    @property
    def damping(self) -> Array:
        """Viscous coefficients d [N m s/rad], shape (n,), structural damping included; D_ii of coupled dampers."""
        return self.hinges["damping"]

    @property
    def rest(self) -> Array:
        """Angles θ₀ at which the springs are slack [rad], shape (n,)."""
        return self.hinges["rest"]

    @functools.cached_property
    def coupled_joints(self) -> tuple[tuple[int, ...], ...]:
        """Of every joint the sequential indices of those that a spring or damper couples it with, ascending."""
        found: list[list[int]] = [[] for _ in range(self.n)]
        for i, j in zip(self.couplings["inner"].tolist(), self.couplings["outer"].tolist(), strict=True):
            found[i].append(j)
            found[j].append(i)
        return tuple(tuple(sorted(each)) for each in found)

    def matrix(self, field: str) -> Array:
        """K of all springs, `field` "stiffness", or D of all dampers, "damping", shape (n, n), couplings included."""
        matrix, (i, j) = np.diag(self.hinges[field]), (self.couplings["inner"], self.couplings["outer"])
        if len(self.couplings):
            matrix[i, j] = matrix[j, i] = self.couplings[field]
        return matrix

    def times(self, field: str, φ: Array, *, absolute: bool = False) -> Array:
        """K φ, `field` "stiffness", or D φ, "damping", of angles or rates φ (n,) or (b, n), in O(n).

        `absolute`: |K| |φ|, of which the product is known to a few roundings.
        """
        value = self.couplings[field]
        if absolute:
            φ, value = np.abs(φ), np.abs(value)
        product: Array = self.hinges[field] * φ
        if len(value):
            add_products(product, self.couplings, value, φ)
        return product

    @functools.cached_property
    def has_rotation_springs(self) -> bool:
        """Whether springs hold rotation vectors of hinges about three axes, not their angles (`BODY`)."""
        return bool(self.bodies["springs"].any())

    @functools.cached_property
    def active(self) -> NDArray[np.intp]:
        """Sequential indices of the driven joints."""
        active = np.array([k for k, c in enumerate(self.coordinates) if c.axis == 0], dtype=np.intp)
        active.flags.writeable = False
        return active

    @functools.cached_property
    def internal(self) -> NDArray[np.intp]:
        """Sequential indices of internal coordinates: their rates are states of force elements, and they move no body.

        Nothing depends on their angles: in statics they stay where they are.
        """
        internal = np.array([k for k, c in enumerate(self.coordinates) if c.axis == LAG], dtype=np.intp)
        internal.flags.writeable = False
        return internal

    @functools.cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Which joints slide, shape (n,): coordinates in m and torques in N, where others have rad and N m."""
        return np.asarray(self.hinges["axis"] >= SLIDES)

    @functools.cached_property
    def is_serial(self) -> bool:
        """Whether every body hangs on the one before it."""
        return not self.bodies["begins"].any()

    @functools.cached_property
    def is_serial_revolute(self) -> bool:
        """Whether every body hangs on the one before it and no joint slides."""
        return self.is_serial and not self.slides.any()

    @functools.cached_property
    def has_free_base(self) -> bool:
        """Whether the first six joints are those of a base that floats."""
        return bool(self.coordinates) and self.coordinates[0].link == 0

    @functools.cached_property
    def loaded(self) -> int:
        """Number in `bodies` of the tip frame at which the tip wrench acts."""
        return int(np.argmax(self.bodies["loaded"])) if self.bodies["loaded"].any() else len(self.bodies) - 1

    def tip_body(self, tip: str | int | None = None) -> int:
        """Number in `bodies` of the tip frame of a link, given by its name or number; by default of the arm's tip.

        Raises
        ------
        ArgumentError
            There is no such link, or another hangs on it.
        """
        if tip is None:
            return len(self.bodies) - 1
        name = self.link_names[link_number("tip", tip, self.link_names) - 1]
        if name not in self.tips:
            raise ArgumentError(f"tip = {truncated(tip)}: other links hang on it; tips are {', '.join(self.tips)}")
        return self.tips[name]

    @functools.cached_property
    def bending(self) -> NDArray[np.intp]:
        """Sequential indices of the hinges within links."""
        bending = np.array([k for k, c in enumerate(self.coordinates) if c.segment], dtype=np.intp)
        bending.flags.writeable = False
        return bending

    @functools.cached_property
    def axes(self) -> Array:
        """Hinge axes in frame 0 at zero angles, unit vectors, shape (n, 3)."""
        if not self.is_serial_revolute:
            return np.array(forward_kinematics(self.arrays, np.zeros(self.n)).axes)
        turned = self.bodies["turned"] != 0
        before = np.repeat(np.cumsum(turned), self.bodies["stop"] - self.bodies["first"])  # turns, of each hinge
        return _axes(self.bodies["rotation"][turned].tobytes(), before.tobytes(), self.hinges["axis"].tobytes())

    def all_axes_parallel_to(self, direction: Array) -> bool:
        """Whether all hinge axes are parallel or opposite to a unit vector of frame 0, at zero and thus at all angles.

        Within 16 ulp per mount rotation, the rounding of the rotations themselves.
        """
        turns = 1 + int(self.bodies["turned"].sum())
        x, y, z = direction
        across = self.axes @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # axis × direction
        return bool(np.abs(across).max() <= 16 * turns * np.finfo(np.float64).eps)

    @functools.cached_property
    def is_planar(self) -> bool:
        """Whether all hinge axes are parallel or opposite: the hinges then move, and feel torques, in one plane only.

        Gravity, tip wrench and offsets may point anywhere: what is out of the plane meets constraint torques. Trees and
        arms with prismatic joints count as spatial.
        """
        return self.is_serial_revolute and self.all_axes_parallel_to(self.axes[0])

    @functools.cached_property
    def reach(self) -> float:
        """How far from the origin of frame 0 any of the masses can get [m], at most."""
        if self.is_serial_revolute:
            return _reach(self.bodies["translation"].tobytes(), self.bodies["center"].tobytes())
        away = sums_outward(spans_of(self.bodies), self.lengths)
        return float((away + np.linalg.norm(self.bodies["center"], axis=1)).max())

    @functools.cached_property
    def size(self) -> float:
        """The reach [m], and where that is 0, as of a cart or a wheel, √(J/m), or 1 m: never 0.

        What a relative tolerance is a part of, J the largest inertia that turns.
        """
        return self.reach or size_without_reach(self.bodies, self.hinges)

    @property
    def size_name(self) -> str:
        """What `size` is, for messages."""
        return "reach" if self.reach else "size"

    @functools.cached_property
    def has_levers(self) -> bool:
        """Whether turning any joint moves a place, as of most arms; where it moves none angles times `size` count."""
        return not len(self._without_lever) or len(self._without_lever) < self.n - int(self.slides.sum())

    @functools.cached_property
    def turning_radii(self) -> Array:
        """By which angles of joints count as displacements where they move no place [m], 0 of others, (n,); (0,): all.

        The `size` where no joint has a lever; else a radius of gyration, of motors on elastic gears a part of one.
        """
        if not self.has_levers:
            return np.where(self.slides, 0.0, self.size)
        free, motors = self._without_lever, on_elastic_gears(self.arrays)
        return turning_radii(self.arrays, free, motors, self.size) if len(free) or len(motors) else np.empty(0)

    @functools.cached_property
    def _without_lever(self) -> Indices:
        return without_lever(self.arrays, self.reach)

    @property
    def lengths(self) -> Array:
        """From what each body hangs on to its hinges, (bodies,) [m]; those that slide as far out as limits say."""
        lengths: Array = np.linalg.norm(self.bodies["translation"], axis=1)
        if self.slides.any():
            limits = np.abs([self.hinges["lower"], self.hinges["upper"]]).max(axis=0)
            slid = np.append(0.0, np.cumsum(np.where(self.slides & np.isfinite(limits), limits, 0.0)))
            lengths += slid[self.bodies["stop"]] - slid[self.bodies["first"]]
        return lengths

    @functools.cached_property
    def weight(self) -> float:
        """Σ m g of all bodies [N]."""
        return self.mass * math.sqrt(self.gravity @ self.gravity)

    @functools.cached_property
    def _sequential(self) -> dict[Coordinate, int]:
        return {c: k for k, c in enumerate(self.coordinates)}

    @functools.cached_property
    def _layout(self) -> tuple[object, ...]:
        """What chains side by side have in common: bodies and hinges but for their numbers, and which code they take.

        Hinges that share their point with others and have a rotor count, too: groups without one are taken out whole.
        """
        sizes = self.bodies["stop"] - self.bodies["first"]
        rotors = np.repeat(sizes > 1, sizes) & (self.hinges["armature"] != 0)
        whole = (
            self.bodies["first"], self.bodies["stop"], self.bodies["springs"], self.bodies["parent"],
            self.bodies["loaded"], self.hinges["axis"],
            self.hinges["prescribed"], rotors,
            self.couplings["inner"], self.couplings["outer"],
        )  # fmt: skip
        return self.is_planar, *(part.tobytes() for part in whole)

    def same_layout(self, other: Chain) -> bool:
        """Whether two chains differ in numbers only, so that they can be evaluated side by side."""
        return self._layout == require_type("other", other, Chain)._layout

    def index(self, link: int | str, segment: int, axis: int) -> int:
        """Sequential index of the coordinate (link, segment, axis), the paper's θ_{i,j,k}; the link by number or name.

        (0, 0, 1) … (0, 0, 6) are those of a free base.

        Raises
        ------
        ArgumentError
            There is no such coordinate, or its joint is locked.

        Examples
        --------
        >>> print(chain.index("upper", 1, 3), chain.joint_name(1))  # link, segment, axis: 3 bends in the XY plane
        1 upper.1.z
        """
        number = 0 if number_of(link) == 0 and self.has_free_base else link_number("link", link, self.link_names)
        wanted = Coordinate(number, integer("segment", segment, 0), integer("axis", axis, 0, LAG))
        if wanted not in self._sequential:
            known = truncated(sorted(tuple(c) for c in self.coordinates if c.link == wanted.link))
            raise ArgumentError(
                f"(link, segment, axis) = {truncated(tuple(wanted))}: not in this chain; link {wanted.link} has {known}"
            )
        return self._sequential[wanted]

    def coordinate(self, k: int | str) -> Coordinate:
        """Three-index coordinate of a joint, given by its sequential index `k`, 0 ≤ k < n, or by its name.

        Raises
        ------
        ArgumentError
            There is no such joint.
        """
        return self.coordinates[self.joint_index("k", k)]

    def joint_name(self, k: int | str) -> str:
        """Unique readable name of joint `k`: "upper", "upper.2.z" for a passive hinge, "upper.gear", "upper.root.z".

        Errors as above.
        Where a link is called like another one's hinge, the hinge is numbered: "upper.2.z_2".
        """
        return self.joint_names[self.joint_index("k", k)]

    def body(self, k: int | str) -> int:
        """Number in `bodies` of the one that hangs on joint `k`, given by index or name; errors as above.

        Examples
        --------
        >>> print(chain.body("fore"), chain.body("fore.2.z"))
        3 5
        """
        return int(np.searchsorted(self.bodies["stop"], self.joint_index("k", k), side="right"))

    def joint_indices(self, name: str, value: Joints) -> NDArray[np.intp]:
        """Sequential indices of the joints that `value` means.

        A boolean mask, shape (n,), one index, name of a joint (`joint_name`: "boom", "boom.2.z") or name of a link,
        whose active joint is meant, or a sequence of them. Where the joint of a link is locked in the scene, its name
        means none.

        Raises
        ------
        ArgumentError
            `value` holds something that is no joint; the message says what is allowed.
        """
        one = (
            isinstance(value, str)
            or not isinstance(value, Iterable)
            or (isinstance(value, np.ndarray) and not value.ndim)
        )
        items: list[Any] = [value] if one else list(value)  # type: ignore[arg-type]
        if items and all(isinstance(item, bool | np.bool_) for item in items):
            if len(items) != self.n:
                raise ArgumentError(f"{name}: a mask of {len(items)} booleans; expected one per joint, {self.n}")
            return np.flatnonzero(np.array(items, dtype=bool))
        found = [self.joint_index(name, item, perhaps_locked=True) for item in items]
        return np.array([k for k in found if k >= 0], dtype=np.intp)

    def joint_index(self, name: str, value: object, *, perhaps_locked: bool = False) -> int:
        """Sequential index of the joint that `value`, an index or a name, means; −1 for a link whose joint is locked.

        Raises
        ------
        ArgumentError
            `value` is no joint, or, unless `perhaps_locked`, one that is locked.
        """
        wanted, names = number_of(value), self.joint_names
        if type(wanted) is int and 0 <= wanted < self.n:
            return wanted
        if isinstance(wanted, str) and wanted in names:
            return names.index(wanted)
        if perhaps_locked and isinstance(wanted, str) and wanted in self.link_names:
            return -1
        close = difflib.get_close_matches(wanted, [*self.link_names, *names], n=1) if isinstance(wanted, str) else []
        hint = f"; did you mean {close[0]!r}?" if close else ""
        links = truncated(", ".join(self.link_names)).strip("'")
        raise ArgumentError(
            f"{name} = {truncated(value)}: no joint of this chain; allowed are 0 … {self.n - 1}, "
            f"names such as {names[-1]!r}, and links: {links}{hint}"
        )

    @functools.cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, in sequential order."""
        return joint_names(self.link_names, self.coordinates)

    @functools.cached_property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of every coordinate: rad or m."""
        return tuple("m" if slides else "rad" for slides in self.slides.tolist())


@functools.lru_cache(maxsize=64)
def _reach(translations: bytes, centers: bytes) -> float:
    """`Chain.reach`; chains that differ in stiffness alone share it."""
    away, centres = (np.linalg.norm(np.frombuffer(part).reshape(-1, 3), axis=1) for part in (translations, centers))
    return float(away.sum() + centres.max())


@functools.lru_cache(maxsize=64)
def _axes(turns: bytes, before: bytes, axes: bytes) -> Array:
    """`Chain.axes`, read-only, from the turns of the bodies that are turned, how many are before each hinge, axes."""
    rotations = np.array([*accumulate(np.frombuffer(turns).reshape(-1, 3, 3), np.matmul, initial=np.eye(3))])
    axes_in_base: Array = rotations[np.frombuffer(before, np.intp), :, np.frombuffer(axes, np.int64)]
    axes_in_base.flags.writeable = False
    return axes_in_base
