"""Contradictory descriptions are refused on creation; the message has the key, its value and the allowed values."""

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.eigenproblem import first_order_matrix
from flexlink.motion.inputs.actuation import input_arrays
from tests.conftest import flexible, make_scene
from tests.support.words import refused

BOX = {"shape": "box", "height": 0.04, "width": 0.06}
TABLE = {"kind": "table", "times": (0.0, 1.0), "torques": ((0.0,), (1.0,))}
RISE = {"times": (0.0, 1.0), "angle_deg": (0.0, 90.0), "rate_deg": (0.0, 0.0), "acceleration_deg": (0.0, 0.0)}


def locked() -> fl.Link:
    return flexible("boom", joint=fl.Joint(locked=True))


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "walls as thick as the box": (
        lambda: fl.Section(**BOX, wall=0.02), "section-walls"),
    "a box without wall": (lambda: fl.Section(**BOX), "missing-key"),
    "a link without name": (lambda: fl.Link(name=""), "empty-name"),
    "material without section": (
        lambda: fl.Link(name="a", length=1.0, material="steel"),
        "missing-key"),
    "taper to a section from none": (
        lambda: fl.Link(name="a", length=1.0, section_tip="thin"), "needs-another-key"),
    "a rigid link in segments": (
        lambda: fl.Link(name="a", length=1.0, segments=3),
        "rigid-segments"),
    "a flexible link in one": (lambda: flexible("a", segments=1), "too-few-segments"),
    "a flexible link without length": (
        lambda: flexible("a", length=0.0), "needs-a-length"),
    "a flexible link without material": (
        lambda: fl.Link(name="a", length=1.0, flex="z", segments=3), "missing-key"),
    "a scene without name": (lambda: replace(make_scene(flexible("a")), name=""), "empty-name"),
    "times that do not increase": (
        lambda: fl.Drive(**TABLE | {"times": (1.0, 1.0)}), "times-not-increasing"),
    "smooth through one point": (
        lambda: fl.Drive(kind="table", times=(0.0,), torques=((1.0,),), smooth=True),
        "needs-another-key"),
    "a row of torques too few": (
        lambda: fl.Drive(**TABLE | {"torques": ((0.0,),)}), "one-per-time"),
    "a motion of a locked joint": (
        lambda: make_scene(locked(), motion=(fl.PrescribedMotion(link="boom", **RISE),)),
        "motion-of-locked-joint"),
    "two motions of one joint": (
        lambda: make_scene(flexible("boom"), motion=(fl.PrescribedMotion(link="boom", **RISE),) * 2),
        "motion-twice"),
}  # fmt: skip


@pytest.mark.parametrize(("build", "id"), REFUSED.values(), ids=REFUSED.keys())
def test_a_description_that_contradicts_itself_is_refused(build: Callable[[], object], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        build()


def test_an_explicit_method_has_no_eigendecomposition() -> None:
    with refused(fl.errors.ArgumentError, "method-not-supported"):
        _ = method("RK4").modes


def test_a_smooth_table_interpolates_its_torques_with_continuous_derivatives() -> None:
    """At the knots, value, slope and second derivative jump by rounding errors only, times 1/h per derivative."""
    t = np.linspace(0.0, 4.0, 17)
    torques = tuple((float(value),) for value in np.sin(t))
    scene = make_scene(flexible("a"), drive=fl.Drive(kind="table", times=tuple(t), torques=torques, smooth=True))
    drive = input_arrays(scene, fl.lump(scene)).drive
    c, x = drive.feedforward.coefficients[:, :, 0], np.diff(t)
    value = sum(c[:-1, j] * x**j for j in range(4))
    slope = sum(j * c[:-1, j] * x ** (j - 1) for j in range(1, 4))
    np.testing.assert_allclose(c[:, 0], np.sin(t), rtol=0, atol=1e-15)
    np.testing.assert_allclose(value, np.sin(t[1:]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(slope[:-1], c[1:-1, 1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(2 * c[:-2, 2] + 6 * c[:-2, 3] * x[:-1], 2 * c[1:-1, 2], rtol=0, atol=1e-12)


def test_a_first_order_matrix_that_overflows_float64_is_refused() -> None:
    one = np.eye(1)
    with refused(fl.errors.ArgumentError, "overflow"):
        first_order_matrix(1e-300 * one, one, 1e300 * one)
