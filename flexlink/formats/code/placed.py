"""Positions, rates and inertias of a chain's bodies on a tape, in frame 0."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.formats.code.tape import function
from flexlink.formats.code.vectors import (
    ZERO,
    Matrix,
    Real,
    Vector,
    add,
    apply,
    column,
    constant,
    cross,
    product,
    scale,
    swung,
    transposed,
    turned,
)
from flexlink.kernels.layout import SLIDES


class Placed:
    """Positions and rates of a chain."""

    def __init__(self, chain: Chain, q: list[Real], qd: list[Real]) -> None:
        self.chain, self.qd = chain, qd
        self.parents = (chain.bodies["parent"] - 1).tolist()
        self.axes: list[Vector] = [ZERO] * chain.n
        self.points: list[Vector] = []
        self.levers: list[Vector] = []  # r from the parent's hinge point to that of the body
        self.slides = chain.slides.tolist()
        self.ω: list[Vector] = []
        self.ζ: list[Vector] = [ZERO] * chain.n  # velocity terms of the acceleration of a hinge
        self.inertias: list[tuple[float, Vector, Matrix]] = []  # m, m c and inertia about the hinge point
        rotations: list[Matrix] = []
        for i, b in enumerate(chain.bodies):
            parent = self.parents[i]
            R: Matrix = rotations[parent] if parent >= 0 else constant(np.eye(3))
            ω = self.ω[parent] if parent >= 0 else ZERO
            r = apply(R, tuple(b["translation"].tolist()))
            R = product(R, constant(b["rotation"]))
            for k in range(b["first"], b["stop"]):
                axis = int(chain.hinges[k]["axis"])
                e = column(R, axis % 3)
                self.axes[k] = e
                if axis >= SLIDES:
                    r = add(r, scale(q[k], e))
                    self.ζ[k] = scale(2.0, scale(qd[k], cross(ω, e)))
                    continue
                self.ζ[k] = scale(qd[k], cross(ω, e))
                ω = add(ω, scale(qd[k], e))
                R = turned(R, axis, function("cos", q[k], math.nan), function("sin", q[k], math.nan))
            rotations.append(R)
            self.ω.append(ω)
            self.levers.append(r)
            self.points.append(add(self.points[parent] if parent >= 0 else ZERO, r))
            self.inertias.append(_inertia(R, b))

    def centripetal(self, i: int) -> Vector:
        """ω × (ω × r) of the parent of body i."""
        parent = self.parents[i]
        return swung(self.ω[parent], self.levers[i]) if parent >= 0 else ZERO


def _inertia(R: Matrix, b: Any) -> tuple[float, Vector, Matrix]:
    m, c = float(b["mass"]), b["center"]
    about_hinge = b["inertia"] + m * (c @ c * np.eye(3) - np.outer(c, c))
    J = product(product(R, constant(about_hinge)), transposed(R)) if about_hinge.any() else constant(np.zeros((3, 3)))
    return m, apply(R, tuple((m * c).tolist())), J
