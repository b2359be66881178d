"""Plausible ranges of quantities, from `data/plausibility/ranges.toml`; hints on materials, sections and lengths."""

import math
from collections.abc import Iterator, Sequence

from flexlink.common.errors import Diagnostic
from flexlink.describe.arm import Arm
from flexlink.describe.data_files import load
from flexlink.describe.material import Section
from flexlink.describe.spec import Spec


def of_materials(arm: Arm) -> Iterator[Diagnostic]:
    """Hints on modulus and density of materials, except if only products such as EI are meaningful."""
    heavy = 2500.0, 23000.0  # range of densities of metals, glass and stone, none of which is soft [kg/m³]
    for name, material in arm.materials.items():
        path, E, ρ = f"material.{name}", material.young, material.density
        sections = [arm.sections[link.section] for link in arm.links if link.material == name and link.section]
        if not sections or not all(map(_is_no_section, sections)):  # else EI and ρA may be entered directly
            known = ranges()
            dense = known["density"].holds(ρ)
            yield from hint_if_outside(f"{path}.density", ρ, "density", ρ)
            if not known["young"].holds(E):
                yield from hint_if_outside(f"{path}.young", E, "young", E)
            elif dense and heavy[0] < ρ < heavy[1]:
                yield from hint_if_outside(f"{path}.young", E, "young_of_heavy", E)
            # faster than sound in any solid [m/s]; the speed of sound in diamond is 1.8e4 m/s
            elif dense and math.sqrt(E / ρ) > 2.5e4:
                yield from hint_if_outside(f"{path}.density", ρ, "density_of_stiff", ρ)


def _is_no_section(section: Section) -> bool:
    """Whether a general section is only a placeholder: an area of 1, or two or more implausible properties."""
    if section.shape != "general":
        return False
    known = ranges()
    area, *moments = (getattr(section, key) or 0.0 for key in ("area", "i_y", "i_z", "torsion"))
    odd = [not known["area"].holds(area), *(not known["second_moment"].holds(i) for i in moments)]
    return area == 1.0 or sum(odd) > 1 or not all(known["shape"].holds(i / area**2) for i in moments)


def of_sections(arm: Arm) -> Iterator[Diagnostic]:
    """Hints on dimensions of sections, lengths of links, how far they turn, and slenderness of flexible links."""
    mistaken: set[str] = set()
    for name, section in arm.sections.items():
        users = {link.material for link in arm.links if link.section == name and link.material}
        if users and all(not _is_real(arm, user) for user in users) and _is_no_section(section):
            continue
        found = list(_dimensions(f"section.{name}", section))
        if found:
            mistaken.add(name)
        yield from found
    for k, link in enumerate(arm.links, 1):
        L = link.beam.length
        long = list(hint_if_outside(f"{arm.path(k)}.length", L, "length", L)) if L else []
        yield from long
        for key in ("curvature", "twist"):
            for rate in given if isinstance(given := getattr(link, key), tuple) else (given,):
                if isinstance(rate, int | float):
                    yield from hint_if_outside(f"{arm.path(k)}.{key}", rate, "turned", abs(rate) * L)
        if link.section is None or link.flex == "rigid" or link.section in mistaken or long:
            continue
        section = arm.sections[link.section]
        if _is_no_section(section) and not _is_real(arm, link.material or ""):
            continue
        key, h = largest_dimension(section)
        known = ranges()["slenderness"]
        if known.holds(L / h):
            continue
        wide = L / h < known.range[0]
        path = f"section.{link.section}.{key}" if wide else f"{arm.path(k)}.length"
        detail = f", and {link.name!r} is {L / h:.2g} times as long as wide"
        yield from hint_if_outside(path, h if wide else L, "slenderness", L / h, -1.0 if wide else 1.0, detail)


def _is_real(arm: Arm, material: str) -> bool:
    """Whether modulus and density are plausible for a material."""
    known, made_of = ranges(), arm.materials[material]
    return known["young"].holds(made_of.young) and known["density"].holds(made_of.density)


def _dimensions(path: str, section: Section) -> Iterator[Diagnostic]:
    if section.shape != "general":
        name = "solid" if section.shape in {"rectangle", "circle"} else "hollow"
        for key in ("height", "width", "diameter", "outer", "wall"):
            value = getattr(section, key)
            if value is not None:
                yield from hint_if_outside(f"{path}.{key}", value, name, value)
        if section.inner and section.outer:
            yield from hint_if_outside(f"{path}.inner", section.inner, "bore", section.inner / section.outer)
        return
    A = section.area or 1.0
    area = list(hint_if_outside(f"{path}.area", A, "area", A))
    yield from area
    for key in ("i_y", "i_z", "torsion"):
        value = getattr(section, key)
        moment = list(hint_if_outside(f"{path}.{key}", value, "second_moment", value))
        yield from moment
        if not area and not moment:
            yield from hint_if_outside(f"{path}.{key}", value, "shape", value / A**2)


def largest_dimension(section: Section) -> tuple[str, float]:
    """The largest dimension of a section [m], with its key."""
    if section.shape == "general":
        A, i = section.area or 1.0, max(section.i_y or 0.0, section.i_z or 0.0)
        return "area", math.sqrt(12 * i / A)
    names = ("height", "width", "diameter", "outer")
    return max(((n, getattr(section, n) or 0.0) for n in names), key=lambda pair: pair[1])


class Range(Spec, frozen=True):
    """Plausible values of a quantity, and units that may have been used by mistake."""

    unit: str  # SI unit of the number in the hint
    range: tuple[float, float]  # plausible; a value outside triggers a hint
    usual: tuple[float, float]  # the value must be in it after the unit is corrected
    reason: str  # justification of the range
    mistaken: dict[str, float]  # conversion factor to SI of each unit that may have been used by mistake
    paths: tuple[str, ...] = ()  # of numbers of a scene to which the range applies directly
    of: str = ""  # quantity and unit that the range applies to, if this is not the given number itself
    inverse: str = ""  # if it may have been given: both names, such as 'a sampling period in s, the rate'
    remedy: str = "check its unit"  # end of the hint if no unit fits
    id: str = "likely-unit"

    def holds(self, value: float) -> bool:
        """Whether a value is plausible."""
        return self.range[0] <= value <= self.range[1]

    def likely(self, value: float, power: float = 1.0) -> dict[str, float]:
        """Units in which the number was probably given, and factors to SI; the quantity varies as number**power."""
        found = {u: f for u, f in self.mistaken.items() if self.usual[0] <= value * f**power <= self.usual[1]}
        # catalogues of profiles use several units
        return found if self.unit in {"m²", "m⁴"} else dict(list(found.items())[:1])


def ranges() -> dict[str, Range]:
    """Plausible ranges by name of quantity."""
    return load("plausibility", "plausibility", "ranges", dict[str, dict[str, Range]])["quantity"]


def hint_if_outside(
    path: str, value: float | Sequence[float], name: str, at: float, power: float = 1.0, detail: str = ""
) -> Iterator[Diagnostic]:
    """Yield a hint on a number or vector if a quantity is not plausible; `detail` is appended to the reason.

    The quantity is `at`, the number itself or one derived from it, which is proportional to this `power` of the number.
    """
    known = ranges()[name]
    if known.holds(at):
        return
    unit = "" if known.unit == "1" else f" {known.unit}"
    start = f"{path} = {shown(value)}{unit}: {known.reason}{detail}"
    if not (found := known.likely(at, power)):
        remedy = known.remedy
        if known.inverse and at > 0 and known.usual[0] <= 1 / at <= known.usual[1]:
            remedy = f"if this is {known.inverse} is {1 / at:.6g}{unit}"
        yield Diagnostic(f"{start}; {remedy}", known.id)
        return
    values = " or ".join(shown(value, factor) for factor in found.values())
    yield Diagnostic(f"{start}; likely given in {' or '.join(found)}: in SI {values}{unit}", "likely-unit")


def shown(value: float | Sequence[float], factor: float = 1.0) -> str:
    """A number or vector times a factor, with six digits."""
    if isinstance(value, int | float):
        return f"{value * factor:.6g}"
    return f"[{', '.join(f'{item * factor:.6g}' for item in value)}]"
