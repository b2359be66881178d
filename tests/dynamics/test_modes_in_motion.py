"""Modes in motion: gyroscopic effects, slow flutter, order of damped modes, singular M."""

from __future__ import annotations

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import flexible, make_scene
from tests.support.beams import cantilever
from tests.support.words import refused


def test_modes_of_a_spinning_arm_solve_the_linearised_equation_of_motion() -> None:
    """A wheel at the tip of a straight soft arm that turns at 20 rad/s: flapping and twist are coupled by their rates.

    The straight arm without gravity is in relative equilibrium. T_GC is quadratic in the rates, so its central
    difference is exact, and T_GC is a trigonometric polynomial in the angles.
    """
    wheel = fl.RigidBody(mass=1.0, inertia=(0.5, 0.3, 0.4))
    chain = fl.lump(make_scene(flexible("a", "xyz", 3), tip=wheel, gravity=(0, 0, 0)))
    q, qd, free = np.zeros(chain.n), np.zeros(chain.n), np.arange(1, chain.n)
    qd[0] = 20.0
    assert fl.bias_torque(chain, q, qd)[free] == pytest.approx(0, abs=1e-9)

    def slope(torque, h: float) -> np.ndarray:
        return np.array([(torque(h * e) - torque(-h * e)) / (2 * h) for e in np.eye(chain.n)[free]]).T[free]

    G = slope(lambda d: fl.bias_torque(chain, q, qd + d), 1.0)
    K = slope(lambda d: fl.bias_torque(chain, q + d, qd) + fl.elastic_torque(chain, q + d), 1e-4)
    M = fl.mass_matrix(chain, q)[np.ix_(free, free)]
    zero, one = np.zeros_like(M), np.eye(len(M))

    def frequencies(C: np.ndarray) -> np.ndarray:
        A = np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        return np.sort(np.abs(np.linalg.eigvals(A).imag))[::2]

    found = np.sort(fl.natural_frequencies(chain, q, locked=[0], qd=qd))
    assert found == pytest.approx(frequencies(G), rel=1e-6)  # truncation error h² = 1e-8, and rounding
    assert np.abs(found / frequencies(zero) - 1).max() > 1e-3  # so a missing gyroscopic term would be detected


def test_slowly_growing_flutter_is_unstable() -> None:
    """Beck's column just below and above its flutter load: 20.05 EI/L², but 3 % less with 12 hinges."""
    chain = cantilever("legendre", 12)
    below, above = (fl.modes(chain, tip_wrench=[-20.05 * part, 0, 0, 0, 0, 0], frame="tip") for part in (0.93, 0.98))
    assert below.stable
    assert not above.stable
    assert above.damping_ratios.min() > -0.1


def test_damped_modes_are_sorted_slowest_first() -> None:
    """Overdamped modes are included: both real eigenvalues of a pair are sorted by rate."""
    damping = fl.Damping(ratio=0.3, at_hz=10.0)
    chain = fl.lump(make_scene(flexible("a", "xyz", 5, damping=damping, joint=fl.Joint(locked=True))))
    λ = fl.modes(chain, np.zeros(chain.n)).eigenvalues
    assert (λ.imag == 0).any()
    assert (λ.imag > 0).any()
    assert (np.diff(np.abs(λ)) >= 0).all()


def test_coaxial_joints_are_singular_even_if_rounding_hides_it(rng: np.random.Generator) -> None:
    skew = fl.Mount(rpy_deg=(-75.0, 20.0, 30.0))
    links = fl.Link(name="a", mount=skew), fl.Link(name="b", length=0.7, joint=fl.Joint(viscous=1.0))
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.3, inertia=(0.1, 0.2, 0.3))))
    for q in rng.uniform(-np.pi, np.pi, (50, 2)):
        with refused(fl.errors.SingularMassError, "joint-without-inertia"):
            fl.modes(chain, q)
