"""Tip loads with exact tip displacements from the reference files: one function per benchmark."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from validation.facts import Fact, Facts
from validation.reference_values import look_up

PRINCETON_ANGLES = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]  # deg


class TipLoad(NamedTuple):
    """A load on the tip and the resulting displacement."""

    facts: Facts  # size and direction of the load
    wrench: Array  # (6,) [N, N m]
    displacement: Array  # (3,) [m]
    note: str = ""  # published value
    frame: Frame = "world"  # axes of the wrench: of the world for a dead load, or of the tip

    @property
    def size(self) -> Fact:
        """The first fact."""
        return next(iter(self.facts.values()))


def elastica() -> Iterator[TipLoad]:
    """Transverse dead force α = PL²/EI on a beam with EI = L = 1 (Bisshopp & Drucker 1945)."""
    for α, exact in look_up("elastica_tip_load").items():
        u, w = float(exact["u/L (tip shortening)"]), float(exact["w/L (transverse tip deflection)"])
        yield TipLoad({"PL²/EI": float(α)}, np.array([0, float(α), 0, 0, 0, 0]), np.array([-u, w, 0]))


def roll_up() -> Iterator[TipLoad]:
    """End moment ML/2πEI on a beam with EI = L = 1: a full turn closes the circle."""
    for exact in look_up("rollup_end_moment", "continuum").values():
        x, y, turns = (float(exact[name]) for name in ("x/L", "y/L", "turns"))
        yield TipLoad({"turns": turns}, np.array([0, 0, 0, 0, 0, 2 * np.pi * turns]), np.array([x - 1, y, 0]))


def princeton() -> Iterator[TipLoad]:
    """Princeton beam (Dowell & Traybar 1975): three weights at seven angles β from the height axis of the section."""
    ansys = look_up("princeton_beam", "ansys_beam_tip |uy|,uz (m) for beta=0..90 step 15")
    for exact in look_up("princeton_beam", "kirchhoff").values():
        force, angle = float(exact["force_N"]), float(exact["beta_deg"])
        β = np.radians(angle)
        wrench = np.array([0, -force * np.cos(β), force * np.sin(β), 0, 0, 0])
        displacement = np.array([exact["ux"], exact["uy(height dir)"], exact["uz(flap dir)"]])
        note = ""
        if f"{force:g}" in ansys:
            y, z = (ansys[f"{force:g}"][axis][PRINCETON_ANGLES.index(angle)] for axis in "yz")
            note = f"ANSYS, with shear and stretch: |uy| = {y:.6g} m, uz = {z:.6g} m."
        yield TipLoad({"force": force, "angle": angle}, wrench, displacement, note)


def follower() -> Iterator[TipLoad]:
    """Follower force PL²/EI at the tip of a beam with EI = L = 1; it stays normal to the beam."""
    for size, exact in look_up("bent_rods", "follower").items():
        x, y, angle = map(float, exact)
        note = f"The tip turns by {angle:.4g} rad."
        wrench = np.array([0, float(size), 0, 0, 0, 0])
        yield TipLoad({"PL²/EI": float(size)}, wrench, np.array([x - 1, y, 0]), note, "tip")


def skew() -> Iterator[TipLoad]:
    """Oblique dead force on a beam with GJ, EI_y, EI_z = 0.7, 1, 3 and L = 1: it bends about two axes and twists."""
    exact = look_up("bent_rods", "space")
    force = np.array(exact["force"])
    displacement = np.array(exact["tip"]) - [1.0, 0.0, 0.0]
    facts: Facts = {"force": float(np.linalg.norm(force))}
    yield TipLoad(facts, np.concatenate([force, np.zeros(3)]), displacement)


TIP_LOADS: dict[str, Callable[[], Iterator[TipLoad]]] = {
    "elastica": elastica,
    "roll_up": roll_up,
    "princeton": princeton,
    "follower": follower,
    "skew": skew,
}
