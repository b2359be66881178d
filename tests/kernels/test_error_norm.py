"""The error of a step in metres: displacements of the bodies due to errors of angles and rates."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigh

import flexlink as fl
from flexlink.kernels.forward.mass_plus import displacement, place_bodies
from flexlink.kernels.forward.mass_plus_cells import columns
from flexlink.kernels.forward.mass_plus_plane import plane_posture
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.stepping.error_norm import CLOSER, Springs, step_error_norm
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.tools.compiler import kernel
from tests.conftest import compiled, flexible, make_scene

pytestmark = compiled
SCENES = {
    "plane": make_scene(flexible("a"), flexible("b")),
    "space": make_scene(flexible("a", "yz"), flexible("b", "xyz")),
    "plane, cells": make_scene(flexible("a", lumping="lobatto4"), flexible("b", lumping="lobatto2")),
    "space, cells": make_scene(flexible("a", "yz", lumping="lobatto2"), flexible("b", "xyz", lumping="lobatto4")),
}


class Work(NamedTuple):
    """The part of a method's workspace that `step_error_norm` uses."""

    chain: Any
    posture: Any
    stepper: Any
    springs: Any


@kernel
def weighed(h, q, e_q, e_v, work):
    place_bodies(q, work.posture)
    return step_error_norm(h, e_q, e_v, work.springs, work.posture, work.chain, work.stepper, None)


@kernel
def moved(change, posture):
    return displacement(change, posture)


def prepared(name: str) -> tuple[np.ndarray, Work, np.ndarray, np.ndarray]:
    """A bent posture, a workspace, and frequencies [rad/s] and mode shapes (columns) there; two joints are free."""
    chain = fl.lump(SCENES[name])
    n, q = chain.n, np.random.default_rng(3).uniform(-0.5, 0.5, chain.n)
    squares, shapes = eigh(chain.matrix("stiffness"), fl.mass_matrix(chain, q))
    ω, numbers = np.sqrt(np.maximum(squares, 0.0)), np.zeros(STEPPER.size)
    ω[:2], numbers[STEPPER.inverse_ω1] = 0.0, 1.0 / ω[2]
    posture = (plane_posture if chain.is_planar else space_posture)(chain.arrays)
    springs = Springs(*np.zeros((2, n)), None, np.zeros(n), np.zeros((n, columns(posture.first))), *np.zeros((2, n)))
    return q, Work(chain.arrays, posture, numbers, springs), ω, shapes


@pytest.mark.parametrize("name", SCENES)
def test_a_rate_error_in_a_mode_counts_as_the_displacement_it_causes(name: str) -> None:
    """A rate error e_v counts as e_v/ω · x/(1 + x²), x = τω, with the best τ: 1/2 at x = 1, less between two τ."""
    q, work, ω, shapes = prepared(name)
    least = CLOSER**0.5 / (1 + CLOSER)
    for k in range(2, len(ω)):
        counted = weighed(1e-3 / ω[-1], q, np.zeros_like(q), shapes[:, k], work) * ω[k]
        assert least * (1 - 1e-6) <= counted / moved(shapes[:, k], work.posture) <= 0.5 * (1 + 1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_a_rate_error_of_a_free_joint_counts_for_the_slowest_vibration_time(name: str) -> None:
    q, work, ω, shapes = prepared(name)
    for k in range(2):
        counted = weighed(1e-3 / ω[-1], q, np.zeros_like(q), shapes[:, k], work)
        assert counted * ω[2] == pytest.approx(moved(shapes[:, k], work.posture), rel=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_a_sampled_control_error_counts_as_the_displacement_it_causes(name: str) -> None:
    """An impulse p moves a mode of frequency ω by τ / (1 + τ² ω²) times the modal share of p."""
    q, work, ω, shapes = prepared(name)
    τ, inverse = 1.0 / ω[2], shapes @ shapes.T
    work.springs.impulse[:], work.stepper[STEPPER.read] = 1e3 / inverse[0, 0], 3.0
    e = shapes[:, -1]
    impulse = shapes.T @ (work.springs.impulse * e) / (1.0 + (τ * ω) ** 2)
    counted = weighed(1e-3 / ω[-1], q, np.zeros_like(q), e, work)
    thrown = moved(τ * (shapes @ impulse), work.posture)
    assert (counted, work.stepper[STEPPER.kick]) == pytest.approx((3.0 * thrown, thrown), rel=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_rate_errors_in_long_steps_count_for_the_length_of_a_step(name: str) -> None:
    q, work, ω, shapes = prepared(name)
    h = 3.0 / ω[2]
    counted = weighed(h, q, np.zeros_like(q), shapes[:, 4], work)
    assert counted == pytest.approx(h * moved(shapes[:, 4], work.posture), rel=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_an_angle_error_counts_as_the_displacement_of_the_bodies(name: str) -> None:
    q, work, _, shapes = prepared(name)
    counted = weighed(1e-6, q, shapes[:, 3], np.zeros_like(q), work)
    assert counted == pytest.approx(moved(shapes[:, 3], work.posture), rel=1e-12)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
@pytest.mark.parametrize("name", SCENES)
def test_an_error_that_is_not_finite_gives_nan(name: str, wrong: float) -> None:
    q, work, *_ = prepared(name)
    for k in range(len(q)):
        e = np.zeros_like(q)
        e[k] = wrong
        assert np.isnan(moved(e, work.posture))
        assert np.isnan(weighed(1e-3, q, e, np.zeros_like(q), work))
        assert np.isnan(weighed(1e-3, q, np.zeros_like(q), e, work))
