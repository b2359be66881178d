"""What a solver gets, a `Case`, and what it returns, an `Answer`. All values are in SI units, angles in rad."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Ask = Literal["statics", "buckling", "frequencies", "motion"]

# What a dimension is: exponents of length, mass and time.
Length = Annotated[float, (1, 0, 0)]
Mass = Annotated[float, (0, 1, 0)]
Time = Annotated[float, (0, 0, 1)]
Stiffness = Annotated[float, (3, 1, -2)]
MassPerLength = Annotated[float, (-1, 1, 0)]
InertiaPerLength = Annotated[float, (1, 1, 0)]
Inertia = Annotated[float, (2, 1, 0)]
Moment = Annotated[float, (2, 1, -2)]
Rate = Annotated[float, (0, 0, -1)]

STILL: Vector = (0.0, 0.0, 0.0)


class BenchError(Exception):
    """A mistake in a call, a file or a solver; the message is one line."""


class Cannot(Exception):  # noqa: N818  it is an answer, not an error
    """Raised by a solver that cannot compute a case; the text is the reason."""


@dataclass(frozen=True)
class Link:
    """A slender link, straight along its x axis, that bends, twists, but neither shears nor stretches.

    It begins at the end of the previous link, or at the origin; z is the axis of its joint. An infinite stiffness is
    that of a link which does not move in this way.
    """

    name: str
    length: Length
    joint: Literal["clamped", "free"] = "free"  # a free joint turns about z without torque, unless the case drives it
    angle: float = 0.0  # at the start, about z, relative to the previous link
    EI: Stiffness = math.inf  # bending in the x-y plane [N m²]
    EI_y: Stiffness = math.inf  # bending in the x-z plane [N m²]
    GJ: Stiffness = math.inf  # twist [N m²]
    mass_per_length: MassPerLength = 0.0  # kg/m
    rotary_inertia: InertiaPerLength = 0.0  # ρI of the section about z, per length [kg m]
    polar_inertia: InertiaPerLength = 0.0  # ρI of the section about x, per length [kg m]
    loss_time: Time = 0.0  # η of the material: moment = EI (κ + η dκ/dt) [s]
    hub_inertia: Inertia = 0.0  # rotary inertia about z that turns with the start of the link [kg m²]
    end_mass: Mass = 0.0  # point mass at the end of the link [kg]
    end_inertia: Inertia = 0.0  # its rotary inertia about each axis [kg m²]

    @property
    def bends_in_space(self) -> bool:
        """Whether the link bends out of the x-y plane or twists."""
        return math.isfinite(self.EI_y) or math.isfinite(self.GJ)


@dataclass(frozen=True)
class Pulse:
    """The torque `peak` sin³(2πt / `duration`) on the first joint; 0 after `duration`."""

    peak: Moment  # N m
    duration: Time  # s

    def torque(self, t: ArrayLike) -> Array:
        """The torque at these times [N m]."""
        t = np.asarray(t, dtype=float)
        return np.where(t < self.duration, self.peak * np.sin(2 * np.pi * t / self.duration) ** 3, 0.0)

    def __str__(self) -> str:
        return f"{self.peak:g} sin³(2πt / {self.duration:g}) N m on the first joint for {self.duration:g} s"


@dataclass(frozen=True)
class SpinUp:
    """The first joint's angle is given: its rate grows smoothly from 0 to `rate` in the time `duration`."""

    rate: Rate  # rad/s
    duration: Time  # s

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Angle [rad], rate [rad/s] and acceleration [rad/s²] at these times."""
        t = np.asarray(t, dtype=float)
        T, w = self.duration, 2 * np.pi / self.duration
        rising, a = t < T, self.rate / self.duration
        angle = np.where(rising, a * (t**2 / 2 + (np.cos(w * t) - 1) / w**2), self.rate * (t - T / 2))
        rate = np.where(rising, a * (t - np.sin(w * t) / w), self.rate)
        return angle, rate, np.where(rising, a * (1 - np.cos(w * t)), 0.0)

    def __str__(self) -> str:
        T, a = self.duration, self.rate / self.duration
        rising = f"{a:g} [t²/2 + ({T:g}/2π)² (cos(2πt/{T:g}) − 1)] rad for {T:g} s"
        return f"angle of the first joint: {rising}, then constant rate"


@dataclass(frozen=True)
class Case:
    """One arm with one load or motion, and what to return.

    ============== ================================================================ ============
    `ask`          the answer                                                       shape
    ============== ================================================================ ============
    `statics`      displacement of the tip from the straight, unloaded arm [m]      (3,)
    `buckling`     factor on gravity, force and moment at which the arm buckles     (1,)
    `frequencies`  the lowest angular frequencies above zero [rad/s]                (modes,)
    `motion`       x and y of the tip at `times` [m]; at rest and straight at first (times, 2)
    ============== ================================================================ ============
    """

    name: str
    part: str
    ask: Ask
    links: tuple[Link, ...]
    gravity: Annotated[Vector, (1, 0, -2)] = STILL  # m/s²
    force: Annotated[Vector, (1, 1, -2)] = STILL  # on the tip [N]
    moment: Annotated[Vector, (2, 1, -2)] = STILL  # on the tip [N m]
    follows: bool = False  # whether force and moment turn with the tip; their directions are those at the start
    spin: Annotated[Vector, (0, 0, -1)] = STILL  # steady rotation of the base, on which the arm moves [rad/s]
    torque: Pulse | None = None
    motion: SpinUp | None = None
    times: Annotated[tuple[float, ...], (0, 0, 1)] = ()  # s
    modes: int = 0

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the answer."""
        return {"statics": (3,), "buckling": (1,), "frequencies": (self.modes,), "motion": (len(self.times), 2)}[
            self.ask
        ]

    @property
    def planar(self) -> bool:
        """Whether all links move in the x-y plane."""
        return not any(link.bends_in_space for link in self.links)


@dataclass(frozen=True)
class Answer:
    """Values in the shape that the case asks for, and a note on how they were computed."""

    values: ArrayLike
    note: str = ""


Settings = Mapping[str, Any]
"""Settings of a run, from `--set name=value`; a solver uses what it knows."""
