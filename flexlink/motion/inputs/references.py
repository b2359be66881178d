"""Reference motions of the driven joints, and other tables in time, as the arrays that the kernels read."""

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.joint_units import OF_JOINT, in_joint_units
from flexlink.describe.scene import Scene
from flexlink.kernels.inputs.record import PiecewisePolynomial


def reference_arrays(scene: Scene, chain: Chain) -> PiecewisePolynomial:
    """The target of the scene's drive or its reference motion, by `chain.active`; errors as in `Scene.course`."""
    course, links = scene.course, [chain.coordinate(int(k)).link - 1 for k in chain.active]
    if course is None:
        return constant(scene.joint_targets[links])
    check_start(scene, chain)
    # writable: kernels are compiled for writable arrays
    return PiecewisePolynomial(course.knots.copy(), course.coefficients.copy())


def check_start(scene: Scene, chain: Chain) -> None:
    """Check that `initial.q` agrees at t = 0 with the start of a reference without `from_deg`."""
    close = 1e-9  # largest difference [deg, m] that rounding of the same number explains
    initial, reference = scene.initial, scene.drive.reference
    if initial.q is None or initial.time or reference is None or len(initial.q) != chain.n:  # refused later
        return
    for k in chain.active.tolist():
        link = chain.coordinates[k].link - 1
        slides = scene.arm.slides[link]
        starts = float(in_joint_units([slides], [initial.q[k]])[0])
        stated, unit = scene.starts[link], OF_JOINT[slides].unit
        missing, default = f"from_{unit}", f"joint_{unit}"
        if reference.starts_at_initial(unit) and abs(starts - stated) > close:
            places = f"{starts:.9g} {unit} by initial.q, but at {stated:.9g} by initial.{default}"
            text = f"missing; the joint of {chain.link_names[link]!r} starts at {places}"
            raise SceneError(f"drive.reference.{missing}: {text}", id="missing-key")


def constant(angles: Array) -> PiecewisePolynomial:
    """A reference that is constant at these angles or positions (d,) [rad, m]."""
    return PiecewisePolynomial(np.zeros(1), np.array(angles, dtype=np.float64)[None, None])


# Conversion of tables in time to the piecewise polynomials that the kernels read.


def pieces_of(name: str, times: Array, rows: Array, *, smooth: bool) -> Array:
    """Coefficients (m, order + 1, d) of a table (m, d): linear or cubic-spline pieces, constant after the last time.

    Changes from one row of the named table to the next that overflow float64 are refused.
    """
    coefficients = np.zeros((len(times), 4 if smooth else 2, rows.shape[1]))
    coefficients[:, 0] = rows
    with np.errstate(over="ignore", invalid="ignore"):
        coefficients[:-1, 1] = np.diff(rows, axis=0) / np.diff(times)[:, None]
        if smooth and np.isfinite(coefficients).all():
            from scipy.interpolate import CubicSpline  # noqa: PLC0415  0.1 s that few scenes need

            coefficients[:-1] = CubicSpline(times, rows).c[::-1].transpose(1, 0, 2)
    if not np.isfinite(coefficients).all():
        text = "the change from one time to the next overflows float64; use smaller changes, or times farther apart"
        raise SceneError(f"{name}: {text}", id="overflow")
    return coefficients


def held_knots(times: Array) -> Array:
    """Knots of a table in which each row applies until the next time.

    Knots are rounded down by more than the rounding error of a sample's time, so a sample at a knot sees the new row.
    """
    return times * (1 - 8 * np.finfo(float).eps)
