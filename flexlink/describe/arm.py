"""An arm: links with joints, materials, sections, payload and base. Frozen, checked, in SI units."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

import msgspec

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.joint_units import Row, in_si, together
from flexlink.describe.link import Link
from flexlink.describe.material import BREADTHS, Material, Section
from flexlink.describe.rest_shape import wrong_end
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.rigidity import Rigidity
from flexlink.describe.spec import Spec, link_key, raise_together, to_builtin

BETWEEN = (
    "a branch or a prismatic joint lies between the links with this law; set it for one link only, or use law = "
    "'proportional'"
)
"""Text for messages: why damping with a constant ratio, which needs dampers between hinges, is not available."""
BASE = "base"  # name that denotes the base as a parent, unless a link has this name


class Base(RigidBody, frozen=True):
    """Support of the first link: fixed in frame 0, or free, a floating rigid body such as a satellite.

    `mass` [kg], `center` [m] and `inertia` [kg m²] of a free base are given in the base's frame; `initial.base` gives
    its initial pose and velocity.

    Examples
    --------
    >>> satellite = fl.Base(kind="free", mass=400.0, inertia=(120.0, 120.0, 90.0))  # kg, kg m²
    """

    kind: Literal["fixed", "free"] = "fixed"
    """Whether the base is fixed in frame 0 or floats."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kind == "fixed" and (self.mass or any(self.inertia)):
            raise self._refused("mass", "a fixed base has no mass; kind = 'free' makes it float", "base-mass")
        if self.kind == "free" and not (self.mass and self.principal_moments[0] > 0):
            text = f"mass = {self.mass!r}, inertia = {truncated(self.inertia)}"
            raise SceneError(f"{text}: a free base needs mass, and inertia about every axis", id="base-mass")

    @property
    def free(self) -> bool:
        """Whether the base floats."""
        return self.kind == "free"


class Arm(Spec, frozen=True):
    """Links from the base outward, in series or as a tree, with the materials and sections that they name.

    Examples
    --------
    >>> arm = fl.Arm(
    ...     links=(fl.Link(name="boom", length=3.0, flex="z", segments=5, material="steel", section="pipe"),),
    ...     materials={"steel": fl.Material(young=210e9, density=7850.0)},
    ...     sections={"pipe": fl.Section(shape="tube", outer=0.06, inner=0.05)},
    ...     tip=fl.RigidBody(mass=5.0),
    ... )
    >>> print(arm)
    <Arm: 'boom' (z)>
    """

    links: Annotated[tuple[Link, ...], msgspec.Meta(min_length=1)] = msgspec.field(name="link")
    """The links, from the base outward."""
    materials: dict[str, Material] = msgspec.field(name="material", default_factory=dict)
    """Materials by the names that links use."""
    sections: dict[str, Section] = msgspec.field(name="section", default_factory=dict)
    """Sections by the names that links use."""
    rigidities: dict[str, Rigidity] = msgspec.field(name="rigidity", default_factory=dict)
    """Tables of rigidities and mass along beams, by the names that links use."""
    tip: RigidBody = RigidBody()
    """Payload: a rigid body in the tip frame, which is at the end of the last link."""
    base: Base = Base()
    """Support of the first link."""

    def __post_init__(self) -> None:
        super().__post_init__()
        raise_together(self._mistakes())

    def __hash__(self) -> int:
        tables = self.materials, self.sections, self.rigidities
        return hash((self.links, *(frozenset(table.items()) for table in tables), self.tip, self.base))

    def _mistakes(self) -> Iterator[Diagnostic]:
        """Inconsistencies between links, materials, sections and tables."""
        seen, joints = set[str](), dict[str, Link]()
        tables: dict[str, dict[str, Any]] = {
            "material": self.materials, "section": self.sections, "rigidity": self.rigidities
        }  # fmt: skip
        for k, link in enumerate(self.links, 1):
            if link.name in seen:
                yield Diagnostic(f"link.{k}.name = {link.name!r}: names of links must differ", "name-twice")
            if link.on and link.on != BASE and link.on not in seen:
                before = [BASE, *(each.name for each in self.links[: k - 1])]
                later = link.on in {each.name for each in self.links}
                meant = "; a parent comes before its child" if later else did_you_mean(link.on, before)
                text = f"no earlier link in the list; allowed are {', '.join(before)}{meant}"
                yield Diagnostic(f"{self.path(k)}.on = {link.on!r}: {text}", "unknown-name")
            seen.add(link.name)
            if link.joint.name or not link.joint.locked:
                other = joints.setdefault(link.joint_name, link)
                if other is not link and (link.joint.name or other.joint.name):
                    what = f"{self.path(k)}.joint.name = {link.joint_name!r}: the joint of {other.name!r}"
                    yield Diagnostic(f"{what} has this name; names must differ", "name-twice")
            for key in ("material", "section", "section_tip", "rigidity"):
                name, kind = getattr(link, key), key.partition("_")[0]
                if name is not None and name not in tables[kind]:
                    meant = did_you_mean(name, tables[kind]) or f"; define [{kind}.{name}]"
                    text = f"not defined; defined are {', '.join(tables[kind]) or 'none'}{meant}"
                    yield Diagnostic(f"{self.path(k)}.{key} = {name!r}: {text}", "unknown-name")
            yield from self._wrong_table(k, link)
            yield from self._wrong_drag(k, link)
            shapes = [self.sections[n].shape for n in (link.section, link.section_tip) if n in self.sections]
            if len(set(shapes)) > 1:
                text = f"is a {shapes[1]}, but {link.section!r} a {shapes[0]}"
                yield Diagnostic(f"{self.path(k)}.section_tip = {link.section_tip!r}: {text}", "section-shapes-differ")
        if len({link.dh.convention for link in self.links if link.dh is not None}) > 1:
            yield Diagnostic("link.dh.convention: differs between links; use only one", "dh-conventions-differ")
        if any(link.dh for link in self.links) and (bent := [link.name for link in self.links if link.rest_shape]):
            text = f"link {bent[0]!r} is curved at rest, and tables of dh describe straight links; use mount instead"
            yield Diagnostic(f"link.dh: {text}", "dh-curved")
        yield from self._wrong_law()
        if not self.base.free and all(link.joint.locked and not link.elastic for link in self.links):
            text = "link: every joint is locked and every link rigid; unlock a joint or let a link bend"
            yield Diagnostic(text, "nothing-to-move")

    def _wrong_law(self) -> Iterator[Diagnostic]:
        """Report damping with a constant ratio across a branch or a prismatic joint."""
        given = [k for k, link in enumerate(self.links) if link.damping is not None and link.damping.is_constant]
        for k in range(given[0] + 1, given[-1] + 1) if given else ():
            link, before = self.links[k], self.links[k - 1]
            if link.on not in {"", before.name} or (link.joint.slides and not link.joint.locked):
                path = f"{self.path(given[0] + 1)}.damping.law = 'constant'"
                yield Diagnostic(f"{path}: {BETWEEN}", "inertia-between-hinges")
                return

    def _wrong_table(self, k: int, link: Link) -> Iterator[Diagnostic]:
        """Report columns that a link's rigidity table lacks, and a table that does not end where the beam ends."""
        table = self.rigidities.get(link.rigidity or "")
        if table is None:
            return
        path = f"{self.path(k)}.rigidity = {link.rigidity!r}"
        for column in table.lacks(link.flex):
            yield Diagnostic(f"{path}: has no {column}; flex = {link.flex!r} needs it", "rigidity-table")
        wanted = [("ea", "kga_y", "kga_z")[axis] for axis in link.strain_axes if table.stiffness is None]
        if absent := [name for name in wanted if name not in table.strained]:
            what = f"{' and '.join(absent)} for {link.strain_keys}"
            text = f"{path}: has no {what}; add it, or stiffness 6 × 6, or use a material and a section"
            yield Diagnostic(text, "strains-need-a-section")
        if why := wrong_end(table.x[-1] * (link.beam.length if table.relative else 1.0), link.beam.length):
            parts = "; if x is from 0 to 1, give relative = true" if table.x[-1] == 1 else ""
            yield Diagnostic(f"{path}: {why}{parts}", "rigidity-table")

    def _wrong_drag(self, k: int, link: Link) -> Iterator[Diagnostic]:
        """Report a link with drag whose length or breadth is missing."""
        if link.drag is None:
            return
        path = f"{self.path(k)}.drag"
        if link.beam.length == 0:
            yield Diagnostic(f"{path}: the link has no length; leave drag out", "needs-a-length")
        elif link.drag.breadth is None:
            section = self.sections.get(link.section or "")
            reason = "the link has no section from which to take it" if link.section is None else ""
            if section is not None and section.shape not in BREADTHS:
                reason = f"a {section.shape} section, {link.section!r}, does not define it"
            if reason:
                yield Diagnostic(f"{path}.breadth: missing; {reason}", "missing-key")

    @property
    def parents(self) -> tuple[int, ...]:
        """Number of each link's parent, from 1; 0 is the base."""
        numbers, parents = {BASE: 0}, list[int]()
        for before, link in enumerate(self.links):
            parents.append(numbers[link.on] if link.on else before)
            numbers[link.name] = before + 1
        return tuple(parents)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Name of each link's joint: its own, or else the link's."""
        return tuple(link.joint_name for link in self.links)

    @property
    def has_drag(self) -> bool:
        """Whether any link has drag."""
        return any(link.drag is not None for link in self.links)

    @property
    def slides(self) -> tuple[bool, ...]:
        """Whether each link's joint is prismatic."""
        return tuple(link.joint.slides for link in self.links)

    def own(self, deg: Row | None, m: Row | None) -> Row:
        """Lists in both units as one number per link, in its joint's own unit, deg or m; zero if not given."""
        return together(self.slides, deg, m)

    def in_si(self, own: Row) -> Array:
        """Numbers in the joints' own units, converted to rad or m."""
        return in_si(self.slides, own)

    @property
    def tips(self) -> tuple[int, ...]:
        """Numbers of the links without children; the last one is the last link, whose end is the tip."""
        parents = set(self.parents)
        return tuple(k for k in range(1, len(self.links) + 1) if k not in parents)

    @property
    def is_serial(self) -> bool:
        """Whether every link is attached to the previous link."""
        return self.parents == tuple(range(len(self.links)))

    def __repr__(self) -> str:
        return f"<Arm: {short_list([f'{link.name!r} ({link.flex})' for link in self.links])}>"

    def loss_time(self, link: Link) -> float:
        """Kelvin-Voigt loss time η [s] of a link's hinges, from its `damping` or else from its material or table."""
        if link.flex == "rigid":
            return 0.0
        if link.damping is None and link.rigidity is not None:
            return self.rigidities[link.rigidity].loss_time
        return (link.damping or self.materials[link.material or ""]).loss_time

    def bending_stiffness(self, link: Link) -> tuple[float, ...]:
        """EI [N m²] at the root of a flexible link about its y and z; empty if it is rigid or has no section."""
        if link.flex == "rigid" or link.section is None:
            return ()
        _, i_y, i_z, _ = self.sections[link.section].properties
        return tuple(self.materials[link.material or ""].young * i for i in (i_y, i_z))

    def path(self, number: int, key: str = "link") -> str:
        """Path of a link, given its number from 1, as in `--set`: `link.upper` or `link.2`; `key` replaces "link"."""
        return f"{key}.{link_key([link.name for link in self.links], number - 1)}"

    def number(self, link: str | int) -> int:
        """Number, from 1, of a link, given by name or number.

        Raises
        ------
        ArgumentError
            There is no such link.
        """
        return link_number("link", link, [each.name for each in self.links])


def link_number(argument: str, value: object, names: Sequence[str]) -> int:
    """Number, from 1, of the link given by its name or number; `argument` names it in the message."""
    wanted = to_builtin(value)
    if isinstance(wanted, str) and wanted in names:
        return names.index(wanted) + 1
    if type(wanted) is int and 1 <= wanted <= len(names):
        return wanted
    text = f"allowed are {short_list(names)}, or 1 … {len(names)}{did_you_mean(wanted, names)}"
    raise ArgumentError(f"{argument} = {truncated(value)}: no link of this arm; {text}", id="unknown-link")
