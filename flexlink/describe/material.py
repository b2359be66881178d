"""Materials, cross sections, damping and friction of links; properties of sections in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Literal, NamedTuple

import msgspec

from flexlink.common.errors import SceneError
from flexlink.common.wording import missing
from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in


class Material(Spec, frozen=True):
    """Isotropic, linear elastic material with Kelvin-Voigt damping: stress = E (strain + loss_time · strain rate).

    Examples
    --------
    >>> steel = fl.Material(young=210e9, density=7850.0, poisson=0.3)  # Pa, kg/m³
    >>> print(f"{scene.varied({'material.aluminium': steel}).arm.materials['aluminium'].young:.2g} Pa")
    2.1e+11 Pa
    """

    young: Annotated[Positive, measured_in("Pa")]
    """Young's modulus E [Pa]: steel 210e9, aluminium 70e9."""
    density: Annotated[Positive, measured_in("kg/m³")]
    """Density ρ [kg/m³]: steel 7850, aluminium 2700."""
    poisson: Annotated[float, msgspec.Meta(gt=-1, le=0.5)] = 0.3
    """Poisson's ratio ν [1]; the shear modulus is G = E / (2 (1 + ν))."""
    loss_time: Annotated[NonNegative, measured_in("s")] = 0.0
    """Kelvin-Voigt loss time η [s]: a mode of angular frequency ω has the damping ratio η ω / 2."""

    @property
    def shear(self) -> float:
        """Shear modulus G = E / (2 (1 + ν)) [Pa]."""
        return self.young / (2 * (1 + self.poisson))


class Section(Spec, frozen=True):
    """Cross section of a link: a shape and exactly the dimensions of that shape [m, m², m⁴].

    rectangle: height (along local y), width (along z); circle: diameter; tube: outer, inner (diameters);
    box: height, width, wall; general: area, i_y = ∫ z² dA, i_z = ∫ y² dA, torsion (St Venant's constant J).

    Examples
    --------
    >>> tube = fl.Section(shape="tube", outer=0.06, inner=0.05)  # m
    >>> plate = fl.Section(shape="rectangle", height=0.005, width=0.03)
    >>> measured = fl.Section(shape="general", area=3e-4, i_y=4e-8, i_z=4e-8, torsion=8e-8)  # m², m⁴
    """

    shape: Literal["rectangle", "circle", "tube", "box", "general"]
    """Shape of the section; it determines the required dimensions."""
    height: Annotated[Positive | None, measured_in("m")] = None
    """For a rectangle or box: outer size along the section's y [m]."""
    width: Annotated[Positive | None, measured_in("m")] = None
    """For a rectangle or box: outer size along the section's z [m]."""
    diameter: Annotated[Positive | None, measured_in("m")] = None
    """For a circle: diameter [m]."""
    outer: Annotated[Positive | None, measured_in("m")] = None
    """For a tube: outer diameter [m]."""
    inner: Annotated[NonNegative | None, measured_in("m")] = None
    """For a tube: inner diameter [m]."""
    wall: Annotated[Positive | None, measured_in("m")] = None
    """For a box: wall thickness [m]."""
    area: Annotated[Positive | None, measured_in("m²")] = None
    """For a general section: area A [m²]."""
    i_y: Annotated[Positive | None, measured_in("m⁴")] = None
    """For a general section: ∫ z² dA, which resists bending about y [m⁴]."""
    i_z: Annotated[Positive | None, measured_in("m⁴")] = None
    """For a general section: ∫ y² dA, which resists bending about z [m⁴]."""
    torsion: Annotated[Positive | None, measured_in("m⁴")] = None
    """For a general section: St Venant's torsion constant J [m⁴]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        wanted = SHAPES[self.shape][1]
        dimensions = [n for n in self.__struct_fields__ if n != "shape" and getattr(self, n) is not None]
        for name in dimensions:
            if name not in wanted:
                raise self._refused(name, f"a {self.shape} takes {', '.join(wanted)}", "key-of-another-kind")
        for name in wanted:
            if name not in dimensions:
                raise missing(name, f"a {self.shape} needs {', '.join(wanted)}")
        if self.outer is not None and self.inner is not None and self.inner >= self.outer:
            raise self._refused("inner", f"must be smaller than outer = {self.outer!r}", "section-walls")
        if self.wall and self.height and self.width and 2 * self.wall >= min(self.height, self.width):
            raise self._refused("wall", "must be less than half of height and width", "section-walls")
        try:
            properties = self.properties._asdict()
        except OverflowError:  # raised by Python's power
            properties = {"area or second moment": math.inf}
        for name, value in properties.items():
            if not 0 < value < math.inf:
                values = ", ".join(f"{key} = {getattr(self, key)!r}" for key in wanted)
                flows = "underflows" if value == 0 else "overflows"
                raise SceneError(f"{values}: {name} {flows} float64", id="overflow")

    @property
    def properties(self) -> SectionProperties:
        """Area, second moments and St Venant constant of this section."""
        return self.towards(self, 0.0)

    def breadths(self, tip: Section, x: float) -> tuple[float, float] | None:
        """Breadth seen along y and along z [m], at the fraction `x` of the way from this section to `tip`.

        None for a general section, whose outline is unknown.
        """
        across = BREADTHS.get(self.shape)
        if across is None:
            return None
        y, z = self._dimensions(across, tip, x)
        return y, z

    def towards(self, tip: Section, x: float) -> SectionProperties:
        """Properties at the fraction `x` of the way from this section to `tip`; dimensions vary linearly."""
        formula, names = SHAPES[self.shape]
        return formula(*self._dimensions(names, tip, x))

    def shear_factors(self, tip: Section, x: float) -> tuple[float, float] | None:
        """Shear correction factors for forces along y and z, at the fraction `x` of the way from this section to `tip`.

        None for a general section, whose shape is unknown.
        """
        formula, names = SHEAR_FACTORS.get(self.shape), SHAPES[self.shape][1]
        return None if formula is None else formula(*self._dimensions(names, tip, x))

    def _dimensions(self, names: tuple[str, ...], tip: Section, x: float) -> Iterator[float]:
        return ((1 - x) * getattr(self, name) + x * getattr(tip, name) for name in names)


class Damping(Spec, frozen=True):
    """Structural damping, given as the damping ratio of a bending or twisting mode at a frequency.

    proportional: Kelvin-Voigt damping, d = η k with η = ratio / (π at_hz) in every hinge. A mode's ratio grows with its
    frequency, ζ = η ω/2 = ratio · f / at_hz, for any number of segments. This damping reduces the largest stable step
    of explicit methods; `flexlink info` reports by how much.
    constant: dampers between all hinges of the links with this law, including root and gear, give every mode the same
    ratio. The ratio is exact in the configuration `initial.joint_deg` and `joint_m` with the joints held, if all
    flexible links have this law; in other configurations it is approximate. A complete state `initial.q`, as in a
    continued run, does not change the dampers. This law needs links in a row whose joints turn, from the first to the
    last link with this law.

    Examples
    --------
    >>> welded = fl.Damping(ratio=0.01, at_hz=4.2)  # 1 % of critical at 4.2 Hz
    >>> damped = fl.lump(scene.varied({"link.*.damping": welded}))
    >>> found = fl.modes(damped, q, locked=damped.active)
    >>> print(found.hertz[:2].round(2), found.damping_ratios[:2].round(4))  # in proportion to the frequency
    [ 5.7  26.87] [0.0135 0.064 ]
    >>> alike = fl.Damping(ratio=0.01, law="constant")
    >>> damped = fl.lump(scene.varied({"link.*.damping": alike}))
    >>> print(fl.modes(damped, q, locked=damped.active).damping_ratios.round(4))
    [0.01 0.01 0.01 0.01]
    """

    ratio: NonNegative
    """Damping ratio ζ of the mode at `at_hz`, or of all modes [1]: 0.01 is 1 % of critical."""
    at_hz: Annotated[Positive | None, measured_in("Hz")] = None
    """For the proportional law: frequency of the mode that has this ratio [Hz]; the ratio of a mode is proportional to
    its frequency."""
    law: Literal["proportional", "constant"] = "proportional"
    """Law of the damping ratio: proportional to a mode's frequency, or constant, the same for all modes of the link."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law == "proportional" and self.at_hz is None:
            raise missing("at_hz", "required unless law = 'constant'")
        if self.law == "constant" and self.at_hz is not None:
            raise self._refused("at_hz", "has no effect with law = 'constant'; leave it out", "no-effect")

    @property
    def is_constant(self) -> bool:
        """Whether all modes have the same ratio."""
        return self.law == "constant"

    @property
    def loss_time(self) -> float:
        """Kelvin-Voigt loss time η [s]; 0 if the ratio is constant."""
        return 0.0 if self.at_hz is None else self.ratio / (math.pi * self.at_hz)


class Friction(Spec, frozen=True):
    """Dry friction in each passive hinge of a link: coulomb · tanh(q̇ / coulomb_width), the friction law of joints.

    A link that bends by some angle dissipates coulomb times this angle, for any number of hinges.

    Examples
    --------
    >>> rubbing = scene.varied({"link.upper.friction": fl.Friction(coulomb=0.5)})  # N m in each hinge
    >>> rates = np.ones(chain.n)  # rad/s
    >>> print((fl.friction_torque(fl.lump(rubbing), rates) - fl.friction_torque(chain, rates)).round(2))
    [0.  0.5 0.5 0.  0.  0. ]
    """

    coulomb: Annotated[NonNegative, measured_in("N m")]
    """Dry friction torque of each hinge [N m]."""
    coulomb_width: Annotated[Positive, measured_in("rad/s")] = 0.01
    """Rate at which tanh reaches 76 % [rad/s]; a smaller value is closer to Coulomb's law, but makes the equations
    stiffer."""


class SectionProperties(NamedTuple):
    """Properties of a cross section, with local y and z through the centroid.

    `i_y` = ∫z² dA resists bending about local y (in the XZ plane), `i_z` = ∫y² dA bending about local z (in the XY
    plane); `torsion` is the St Venant constant J, which equals i_y + i_z only for circles.
    """

    area: float  # m²
    i_y: float  # m⁴
    i_z: float  # m⁴
    torsion: float  # m⁴


def rectangle(height: float, width: float) -> SectionProperties:
    """Solid rectangle, `height` along local y, `width` along local z."""
    area = height * width
    return SectionProperties(area, area * width**2 / 12, area * height**2 / 12, _rectangle_torsion(height, width))


def tube(outer: float, inner: float = 0.0) -> SectionProperties:
    """Circular tube with outer and inner diameter, or a solid circle."""
    i = math.pi * (outer**4 - inner**4) / 64
    return SectionProperties(math.pi * (outer**2 - inner**2) / 4, i, i, 2 * i)


def box(height: float, width: float, wall: float) -> SectionProperties:
    """Rectangular tube of uniform wall; torsion by Bredt's formula J = 4 A_m² t / s_m, valid for thin walls."""
    h, w = height - 2 * wall, width - 2 * wall
    middle_area, middle_length = (height - wall) * (width - wall), 2 * (height + width - 2 * wall)
    i_y, i_z = (height * width**3 - h * w**3) / 12, (width * height**3 - w * h**3) / 12
    return SectionProperties(height * width - h * w, i_y, i_z, 4 * middle_area**2 * wall / middle_length)


def _rectangle_torsion(a: float, b: float) -> float:
    """St Venant's series (Timoshenko & Goodier, art. 109), summed until its terms vanish in float64.

    J = a b³ [1/3 − (64/π⁵)(b/a) Σ tanh(mπa/2b)/m⁵, m = 1, 3, 5, …],  a ≥ b
    """
    a, b = max(a, b), min(a, b)
    # tanh = 1 − (1 − tanh): the terms 1/m⁵ sum to exactly 31ζ(5)/32; the terms of 1 − tanh decay like exp(−mπa/b), to
    # 2e-18 at m a/b = 13.
    rest = math.fsum(2 / (math.exp(m * math.pi * a / b) + 1) / m**5 for m in range(1, 13, 2) if m * a / b < 13)
    zeta_5 = 1.0369277551433699263
    return a * b**3 * (1 / 3 - 64 / math.pi**5 * (b / a) * (31 / 32 * zeta_5 - rest))


def _tube_factors(outer: float, inner: float = 0.0) -> tuple[float, float]:
    """Shear correction factors of a circular tube: 6/7 without a hole, 1/2 with a thin wall."""
    m = (inner / outer) ** 2
    factor = 6 * (1 + m) ** 2 / (7 * (1 + m) ** 2 + 20 * m)
    return factor, factor


def _box_factors(height: float, width: float, wall: float) -> tuple[float, float]:
    """Shear correction factors of a thin-walled box, about the shares of the walls along y and along z in its area."""
    h, w = height - wall, width - wall
    return _along(w / h), _along(h / w)


def _along(m: float) -> float:
    """Shear correction factor of a thin-walled box whose walls across the force are m times as wide as those along."""
    return 10 * (1 + 3 * m) ** 2 / (12 + 72 * m + 150 * m**2 + 90 * m**3 + 30 * m**3 * (1 + m))


SHEAR_FACTORS: dict[str, Callable[..., tuple[float, float]]] = {
    "rectangle": lambda height, width: (5 / 6, 5 / 6), "circle": _tube_factors, "tube": _tube_factors,
    "box": _box_factors,
}  # fmt: skip
"""Shear correction factors κ for forces along y and z: shear stiffness κ G A (Cowper 1966, for ν = 0)."""
BREADTHS = {
    "rectangle": ("width", "height"), "box": ("width", "height"), "circle": ("diameter", "diameter"),
    "tube": ("outer", "outer"),
}  # fmt: skip
"""Dimensions of each shape that face a flow along the section's y, and along its z."""
SHAPES: dict[str, tuple[Callable[..., SectionProperties], tuple[str, ...]]] = {
    "rectangle": (rectangle, ("height", "width")),
    "circle": (tube, ("diameter",)),
    "tube": (tube, ("outer", "inner")),
    "box": (box, ("height", "width", "wall")),
    "general": (SectionProperties, ("area", "i_y", "i_z", "torsion")),
}
