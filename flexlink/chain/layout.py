"""Topology of a chain: connections and branches of its bodies and hinges, and how its joints are named and found."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, number_of, require_type
from flexlink.chain.coordinates import KINDS, Coordinate, Kind, joint_names
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.arm import link_number
from flexlink.describe.joint_units import OF_JOINT, KindOfJoint, in_joint_units, in_words
from flexlink.kernels.bodies.shaped_mass import Shapes
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.layout import SLIDES, ChainArrays

Joints = str | int | Iterable[str | int | np.integer[Any] | np.bool_]
"""Ways to specify joints of a chain; see `Layout.joint_indices`."""


class Layout:
    """Properties of a chain that are independent of its masses, springs and gravity."""

    bodies: NDArray[np.void]
    hinges: NDArray[np.void]
    couplings: NDArray[np.void]
    coordinates: tuple[Coordinate, ...]
    link_names: tuple[str, ...]
    joints_of_links: tuple[str, ...]
    tips: dict[str, int]
    shapes: Shapes | None

    @property
    def arrays(self) -> ChainArrays:
        """View of this chain for kernels."""
        raise NotImplementedError

    @functools.cached_property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return len(self.hinges)

    @functools.cached_property
    def active(self) -> NDArray[np.intp]:
        """Sequential indices of the driven joints."""
        return self.where(Kind.JOINT)

    def where(self, *kinds: Kind, link: int = 0, axis: int | None = None) -> NDArray[np.intp]:
        """Sequential indices of the coordinates of these kinds, read-only; by default of all links and axes."""
        there = (c.kind in kinds and link in (0, c.link) and axis in (None, c.axis) for c in self.coordinates)
        found = np.flatnonzero(np.fromiter(there, bool))
        found.flags.writeable = False
        return found

    @functools.cached_property
    def held(self) -> NDArray[np.bool_]:
        """Mask of the coordinates whose motion is prescribed, (n,): their torque is unknown."""
        return np.asarray(self.hinges["prescribed"] != 0)

    @property
    def free(self) -> NDArray[np.intp]:
        """Sequential indices of the other coordinates, which move by forces."""
        return np.flatnonzero(~self.held)

    @functools.cached_property
    def internal(self) -> NDArray[np.intp]:
        """Sequential indices of internal coordinates, whose rates are states of force elements, and which move no body.

        Their angles have no effect and are constant in statics.
        """
        return self.where(*(kind for kind in Kind if not kind.moves))

    @functools.cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Mask of the sliding joints, shape (n,), whose coordinates are in m and forces in N instead of rad and N m."""
        return np.asarray(self.hinges["axis"] >= SLIDES)

    @functools.cached_property
    def is_serial(self) -> bool:
        """Whether the parent of every body is the previous body."""
        return not np.count_nonzero(self.bodies["begins"])

    @functools.cached_property
    def is_serial_revolute(self) -> bool:
        """Whether the parent of every body is the previous body, and no joint slides."""
        return self.is_serial and not np.count_nonzero(self.slides)

    @functools.cached_property
    def has_free_base(self) -> bool:
        """Whether the first six joints belong to a floating base."""
        return bool(self.coordinates) and self.coordinates[0].kind is Kind.BASE

    @functools.cached_property
    def coupled_joints(self) -> tuple[tuple[int, ...], ...]:
        """For every joint, the sequential indices of joints coupled to it by a spring or damper, ascending."""
        found: list[list[int]] = [[] for _ in range(self.n)]
        for i, j in zip(self.couplings["inner"].tolist(), self.couplings["outer"].tolist(), strict=True):
            found[i].append(j)
            found[j].append(i)
        return tuple(tuple(sorted(each)) for each in found)

    @functools.cached_property
    def has_rotation_springs(self) -> bool:
        """Whether springs act on rotation vectors of hinges about three axes instead of their angles (`BODY`)."""
        return bool(np.count_nonzero(self.bodies["springs"]))

    @property
    def springs_join_hinges(self) -> bool:
        """Whether some springs act on several hinges, so K is not diagonal."""
        return len(self.couplings) > 0 or self.has_rotation_springs

    @functools.cached_property
    def loaded(self) -> int:
        """Index in `bodies` of the tip frame at which the tip wrench acts."""
        return int(np.argmax(self.bodies["loaded"])) if self.bodies["loaded"].any() else len(self.bodies) - 1

    @functools.cached_property
    def bending(self) -> NDArray[np.intp]:
        """Sequential indices of the hinges within links, whose coordinates are angles."""
        return self.where(Kind.HINGE)

    @property
    def slightly_bent(self) -> Array:
        """Angles of an arm in which no two axes are parallel [rad], with beams neither stretched nor sheared, (n,)."""
        bent = np.linspace(0.1, 0.4, self.n)
        bent[self.where(Kind.STRAIN)] = 0.0
        return bent

    @functools.cached_property
    def axes(self) -> Array:
        """Hinge axes in frame 0 at zero angles, unit vectors, shape (n, 3)."""
        if not self.is_serial_revolute:
            return np.array(forward_kinematics(self.arrays, np.zeros(self.n)).axes)
        turned = self.bodies["turned"] != 0
        before = np.repeat(np.cumsum(turned), self.bodies["stop"] - self.bodies["first"])  # rotations before each hinge
        return _axes(self.bodies["rotation"][turned].tobytes(), before.tobytes(), self.hinges["axis"].tobytes())

    def all_axes_parallel_to(self, direction: Array) -> bool:
        """Whether all hinge axes are parallel or opposite to a unit vector of frame 0, at zero and hence at any angles.

        The tolerance is 16 ulp per mount rotation, the rounding error of the rotations.
        """
        turns = 1 + int(self.bodies["turned"].sum())
        x, y, z = direction
        across = self.axes @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # axis × direction
        return bool(np.abs(across).max() <= 16 * turns * np.finfo(np.float64).eps)

    @functools.cached_property
    def is_planar(self) -> bool:
        """Whether all hinge axes are parallel or opposite, so that the arm moves only in one plane.

        Gravity, tip wrench and offsets may have any direction: constraint torques balance out-of-plane loads. Trees and
        arms with prismatic joints count as spatial.
        """
        if not self.is_serial_revolute:
            return False
        axes, first = self.hinges["axis"].tolist(), self.bodies["first"].tolist()
        turned = [i for i, turns in enumerate(self.bodies["turned"].tolist()) if turns and 0 < first[i] < self.n]
        if not turned:  # all axes in one frame
            return bool(axes.count(axes[0]) == len(axes))
        if any(abs(self.bodies["rotation"][i, axes[first[i] - 1], axes[first[i]]]) < 0.99 for i in turned):
            return False
        return self.all_axes_parallel_to(self.axes[0])

    @functools.cached_property
    def _sequential(self) -> dict[Coordinate, int]:
        return {c: k for k, c in enumerate(self.coordinates)}

    @functools.cached_property
    def _layout(self) -> tuple[object, ...]:
        """Data that chains evaluated together have in common: connections and code path, without numerical values.

        They include which hinges share a point with others and have a rotor, because hinges at a point without rotors
        are eliminated together.
        """
        sizes = self.bodies["stop"] - self.bodies["first"]
        rotors = np.repeat(sizes > 1, sizes) & (self.hinges["armature"] != 0)
        whole = (
            self.bodies["first"], self.bodies["stop"], self.bodies["springs"], self.bodies["parent"],
            self.bodies["loaded"], self.hinges["axis"],
            self.hinges["prescribed"], rotors,
            self.couplings["inner"], self.couplings["outer"],
        )  # fmt: skip
        shared = () if self.shapes is None else (self.shapes.first, self.shapes.stop)
        return self.is_planar, *(part.tobytes() for part in (*whole, *shared))

    def same_layout(self, other: Layout) -> bool:
        """Whether two chains differ only in numerical values, so they can be evaluated together."""
        return self._layout == require_type("other", other, type(self))._layout

    def tip_body(self, tip: str | int | None = None) -> int:
        """Index in `bodies` of the tip frame of a link, given by its name or number; by default the arm's tip.

        Raises
        ------
        ArgumentError
            There is no such link, or it has child links.
        """
        if tip is None:
            return len(self.bodies) - 1
        name = self.link_names[link_number("tip", tip, self.link_names) - 1]
        if name not in self.tips:
            text = f"tip = {truncated(tip)}: has child links; tips are {', '.join(self.tips)}"
            raise ArgumentError(text, id="tip-not-a-tip")
        return self.tips[name]

    def index(self, link: int | str, segment: int, axis: int) -> int:
        """Sequential index of the coordinate (link, segment, axis), the paper's θ_{i,j,k}; link by number or name.

        (0, 0, 1) … (0, 0, 6) are the coordinates of a free base.

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
        last = max(axis for _, axis in KINDS)
        wanted = Coordinate(number, integer("segment", segment, 0), integer("axis", axis, 0, last))
        if wanted not in self._sequential:
            known = truncated(sorted(tuple(c) for c in self.coordinates if c.link == wanted.link))
            text = f"(link, segment, axis) = {truncated(tuple(wanted))}: unknown; link {wanted.link} has {known}"
            raise ArgumentError(text, id="unknown-hinge")
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

        A driven joint has its own name (`Joint.name`), or else the link's. A hinge whose name is also the name of a
        driven joint is numbered: "upper.2.z_2". Errors as in `coordinate`.
        """
        return self.joint_names[self.joint_index("k", k)]

    def body(self, k: int | str) -> int:
        """Index in `bodies` of the body that joint `k`, given by index or name, moves; errors as in `coordinate`.

        Examples
        --------
        >>> print(chain.body("fore"), chain.body("fore.2.z"))
        3 5
        """
        return int(np.searchsorted(self.bodies["stop"], self.joint_index("k", k), side="right"))

    def joint_indices(self, name: str, value: Joints) -> NDArray[np.intp]:
        """Sequential indices of the joints specified by `value`.

        `value` is a boolean mask, shape (n,), one index, the name of a joint (`joint_name`: "boom", "boom.2.z") or, if
        no joint has this name, of a link, which selects its active joint, or a sequence of these. The name of a joint
        that is locked in the scene, or of its link, selects no joint.

        Raises
        ------
        ArgumentError
            `value` contains something that is not a joint; the message lists what is allowed.
        """
        one = isinstance(value, str) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0
        items: list[Any] = [value] if one else list(value)  # type: ignore[arg-type]
        if items and all(isinstance(item, bool | np.bool_) for item in items):
            if len(items) != self.n:
                text = f"{name}: a mask of {len(items)} booleans; expected one per joint, {self.n}"
                raise ArgumentError(text, id="wrong-shape")
            return np.flatnonzero(np.array(items, dtype=bool))
        found = [self.joint_index(name, item, perhaps_locked=True) for item in items]
        return np.array([k for k in found if k >= 0], dtype=np.intp)

    def joint_index(self, name: str, value: object, *, perhaps_locked: bool = False) -> int:
        """Sequential index of the joint with index or name `value`; −1 for a link whose joint is locked.

        Raises
        ------
        ArgumentError
            `value` is not a joint, or is locked and not `perhaps_locked`.
        """
        wanted, names = number_of(value), self.joint_names
        if type(wanted) is int and 0 <= wanted < self.n:
            return wanted
        if isinstance(wanted, str) and wanted in names:
            return names.index(wanted)
        links = [*self.joints_of_links, *self.link_names]
        if isinstance(wanted, str) and wanted in links:  # a joint's own name goes before the name of a link
            joint = Kind.JOINT.at(links.index(wanted) % len(self.link_names) + 1)
            if joint in self.coordinates:
                return self.coordinates.index(joint)
            if perhaps_locked:
                return -1
        hint = did_you_mean(wanted, [*self.link_names, *names])
        all_links = truncated(", ".join(self.link_names)).strip("'")
        text = f"allowed are 0 … {self.n - 1}, names such as {names[-1]!r}, and links: {all_links}{hint}"
        raise ArgumentError(f"{name} = {truncated(value)}: not a joint of this chain; {text}", id="unknown-joint")

    @functools.cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, in sequential order."""
        return joint_names(self.link_names, self.coordinates, self.joints_of_links)

    @functools.cached_property
    def joint_kinds(self) -> tuple[KindOfJoint, ...]:
        """Kind of every joint, revolute or prismatic, with the names and units of its coordinate and load."""
        return tuple(OF_JOINT[slides] for slides in self.slides.tolist())

    @functools.cached_property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of every coordinate: rad or m."""
        return tuple(kind.si for kind in self.joint_kinds)

    def by_unit(self, joints: Iterable[int]) -> Iterator[tuple[KindOfJoint, list[int]]]:
        """Split joints by their unit: those in rad, then those in m; with names of the units, without empty lists."""
        for kind in OF_JOINT.values():
            if found := [k for k in joints if self.joint_kinds[k] is kind]:
                yield kind, found

    def place_in_words(self, k: int, value: float, *form: str) -> str:
        """Value of coordinate `k` with its unit, for messages: 30°, 0.5 m."""
        return in_words(bool(self.slides[k]), value, *form)

    def in_own_units(self, si: ArrayLike, joints: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Convert values (…, joints) from rad or m to deg or m, the units of scenes."""
        return in_joint_units(self.slides[joints], si)

    @functools.cached_property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of the drive force or torque of every coordinate: N m or N."""
        return tuple(kind.torque for kind in self.joint_kinds)


@functools.lru_cache(maxsize=64)
def _axes(turns: bytes, before: bytes, axes: bytes) -> Array:
    """`Layout.axes`, read-only, from rotations of turned bodies, the number of them before each hinge, and its axis."""
    rotations = np.array([*accumulate(np.frombuffer(turns).reshape(-1, 3, 3), np.matmul, initial=np.eye(3))])
    axes_in_base: Array = rotations[np.frombuffer(before, np.intp), :, np.frombuffer(axes, np.int64)]
    axes_in_base.flags.writeable = False
    return axes_in_base


OF_LAYOUT = [name for name, value in vars(Layout).items() if isinstance(value, functools.cached_property)]
"""Names of cached properties that chains of the same layout share."""


Branch = tuple[int, int, int]
"""Parent of consecutive bodies (−1: the base), the first of them, and the stop; each is the parent of the next."""


def spans_of(bodies: NDArray[np.void]) -> list[Branch]:
    """All branches of an arm, including the joints of its base; each branch comes after its parent's branch."""
    edges = [0, *np.flatnonzero(bodies["begins"]).tolist(), len(bodies)]
    return [(int(bodies["parent"][first]) - 1, first, stop) for first, stop in pairwise(edges)]


def sums_outward(spans: list[Branch], terms: Array) -> Array:
    """Sums of the terms of all bodies from the base up to each body, shape (bodies, …)."""
    sums = np.empty_like(terms)
    for parent, first, stop in spans:
        start = sums[parent] if parent >= 0 else np.zeros(terms.shape[1:])
        sums[first:stop] = np.cumsum(np.concatenate([start[None], terms[first:stop]]), axis=0)[1:]
    return sums


def sums_inward(spans: list[Branch], terms: Array) -> Array:
    """Sums of the terms of all bodies in the subtree of each body, shape (bodies, …)."""
    sums = terms.copy()
    for parent, first, stop in reversed(spans):
        sums[first:stop] = np.cumsum(sums[first:stop][::-1], axis=0)[::-1]
        if parent >= 0:
            sums[parent] += sums[first]
    return sums


def base_body(chain: Layout) -> int:
    """Number, from 1, of the body that is the base; 0 if the base is fixed in frame 0."""
    return 2 if chain.has_free_base else 0


def of_parents(chain: Layout, values: Array, of_base: Array) -> Array:
    """Values of each body's parent, shape (bodies, …); `of_base` is used for bodies attached to the base."""
    return np.asarray(np.concatenate([of_base[None], values])[chain.bodies["parent"]])


def branches_of(chain: Layout) -> list[list[int]]:
    """Numbers, from 1, of the bodies of every branch, each after its parent's branch; 0 is the fixed base."""
    base = base_body(chain)
    spans = [(max(base, first), stop) for _, first, stop in spans_of(chain.bodies) if stop > base]
    return [[int(chain.bodies["parent"][first]), *range(first + 1, stop + 1)] for first, stop in spans]


def unslid(chain: Layout, rotations: Array, points: Array) -> Array:
    """Origins that the bodies would have if all sliding joints were at zero, (bodies, 3), from poses in frame 0."""
    R, p = of_parents(chain, rotations, np.eye(3)), of_parents(chain, points, np.zeros(3))
    return np.asarray(p + np.einsum("bij,bj->bi", R, chain.bodies["translation"]))


def sliding_bodies(chain: Layout) -> list[int]:
    """Indices, from 0, of bodies that slide on their parents, except a floating base."""
    first = chain.bodies["first"]
    some = np.flatnonzero(first < chain.bodies["stop"]).tolist()
    return [k for k in some if k >= base_body(chain) and chain.slides[first[k]]]


def as_lines(chain: Layout, points: Array, *, base: bool = True, rails: Array | None = None) -> Array:
    """Origins of the bodies (…, bodies, 3) as lines along the branches, (…, m, 3), separated by nan.

    Lines start at a fixed base, the origin of frame 0, or, without `base`, at the bodies attached to it. Lines to
    sliding bodies pass through their positions at zero, `rails`, which are returned by `unslid`.
    """
    before, count = np.zeros((*points.shape[:-2], 1, 3)), points.shape[-2] + 1
    every = np.concatenate([before, points, np.full_like(before, np.nan), points if rails is None else rails], axis=-2)
    slide = set() if rails is None else {k + 1 for k in sliding_bodies(chain)}
    order: list[int] = []
    for branch in branches_of(chain):
        order += [count] if order else []
        for b in branch[0 if base or branch[0] else 1 :]:
            order += [count + b, b] if b in slide and b != branch[0] else [b]
    return np.asarray(every[..., order, :])
