"""References of the driven joints, as the arrays that the kernels read."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.own_units import OF_JOINT, in_own
from flexlink.describe.scene import Scene
from flexlink.kernels.inputs.record import PiecewisePolynomial


def reference_arrays(scene: Scene, chain: Chain) -> PiecewisePolynomial:
    """The target of the scene's drive, or its reference in time, in the order of `chain.active`.

    Raises
    ------
    SceneError
        The run starts elsewhere than the reference takes for granted, or as in `Scene.course`.
    DataFileError
        The file of the reference's shaper is not valid.
    """
    course, links = scene.course, [chain.coordinate(int(k)).link - 1 for k in chain.active]
    if course is None:
        return constant(scene.joint_targets[links])
    check_start(scene, chain)
    return PiecewisePolynomial(
        course.knots.copy(), course.coefficients.copy()
    )  # writable: kernels take them for another type


def check_start(scene: Scene, chain: Chain) -> None:
    """A run from a state of one's own starts at t = 0 where a reference without `from_deg` does.

    Raises
    ------
    SceneError
        It does not.
    """
    close = 1e-9  # [deg, m] two roundings of one number
    initial, reference = scene.initial, scene.drive.reference
    if initial.q is None or initial.time or reference is None:
        return
    for k in chain.active.tolist():
        link = chain.coordinates[k].link - 1
        slides = scene.arm.slides[link]
        starts, said, unit = float(in_own([slides], [initial.q[k]])[0]), scene.starts[link], OF_JOINT[slides].unit
        missing, default = f"from_{unit}", f"joint_{unit}"
        if reference.starts_at_initial(slides=slides) and abs(starts - said) > close:
            raise SceneError(
                f"drive.reference.{missing}: missing; for the joint of {chain.link_names[link]!r} initial.q gives "
                f"{starts:.9g} {unit} and initial.{default} {said:.9g}",
                id="missing-key",
            )


def constant(angles: Array) -> PiecewisePolynomial:
    """The reference that stays at these angles (d,) [rad, m]."""
    return PiecewisePolynomial(np.zeros(1), np.array(angles, dtype=np.float64)[None, None])
