"""All inputs of a scene as one record of arrays for the kernels: drive, prescribed motions, tip wrench."""

import functools
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.actions import Frame, PrescribedMotion
from flexlink.describe.profiles import quintics
from flexlink.describe.scene import Scene
from flexlink.kernels.geometry.branches import loaded_body, path_to
from flexlink.kernels.inputs.laws import PD, TABLE
from flexlink.kernels.inputs.record import Drive, GivenWrench, Inputs, Loads, MotionTable, given_at, no_motion
from flexlink.motion.inputs.drives import drive_arrays, gains_of, no_model
from flexlink.motion.inputs.references import held_knots, pieces_of

LINEAR = 2  # number of coefficients per piece of a piecewise linear table


def input_arrays(scene: Scene, chain: Chain) -> Inputs:
    """The inputs of a scene; errors as in `drive_arrays`, `motion_arrays` and `loads_of`."""
    return inputs_with(drive_arrays(scene, chain), scene, chain)


def inputs_with(drive: Drive, scene: Scene, chain: Chain) -> Inputs:
    """The inputs of a scene with another drive; errors as in `motion_arrays` and `loads_of`."""
    loads = loads_of(scene, chain)
    wrench = scene.tip_wrench if loads is None else np.full(6, np.nan)  # until a stage writes it
    if chain.arrays.rare is not None:
        # without loads, the wrench is constant and acts on the arm's tip
        loads = loads or Loads(False, False, np.zeros(1), np.zeros((1, 1, 6)), chain.arrays, np.empty(0, np.int64))
    return Inputs(drive_for(chain, drive), motion_arrays(scene, chain), wrench, loads)


def drive_for(chain: Chain, drive: Drive) -> Drive:
    """The drive with the types that the chain's loops require: full loops need a rigid model, even if it is empty."""
    return drive if chain.arrays.rare is None else drive._replace(model=drive.model or no_model())


def of_kind(scene: Scene, chain: Chain) -> Chain:
    """Return the chain, marked for the kind of compiled loops that the scene needs.

    There are two kinds, both for planar and for spatial chains. *Plain* loops support springs and friction of joints,
    prescribed motions, laws without a model, and a constant wrench on the arm's tip. *Full* loops also support
    branches, sliding joints, moving bases, force elements (`kernels.forces.elements`), laws that evaluate a rigid
    model, and wrenches that vary or act on another tip. Even a plain chain uses full loops for such a law or wrench.
    """
    modelled = scene.drive.kind == "computed_torque" or scene.drive.gravity == "rigid"
    return chain.as_full() if chain.arrays.rare is None and (modelled or loads_of(scene, chain)) else chain


def acting_at(inputs: Inputs, chain: Chain, t: float, q: Array, qd: Array) -> dict[str, Any]:
    """Tip wrench, its frame and the drive gains about a state at time t [s], as keyword arguments of `stable_step`."""
    wrench, frame = wrench_at(inputs, t)
    return {"tip_wrench": wrench, "frame": frame, "gains": gains_of(chain, inputs.drive, t, q, qd)}


def corners(given: Drive | Loads) -> Array:
    """Knots [s] of an input at which even fixed steps end, excluding sampling instants."""
    if isinstance(given, Drive) and given.rate:
        return np.empty(0)
    if isinstance(given, Drive) and given.law != TABLE:
        tabled = given.law == PD and given.feedforward.coefficients.shape[1] in {LINEAR, LINEAR + 2}  # or cubic
        return np.concatenate([given.reference.knots, given.feedforward.knots if tabled else []])
    table = given.feedforward if isinstance(given, Drive) else given
    return np.empty(0) if table.coefficients.shape[1] > LINEAR else table.knots


def motion_arrays(scene: Scene, chain: Chain) -> MotionTable:
    """The scene's prescribed motions; a table without joints if it has none; an error if a rate overflows float64."""
    if not scene.motion:
        return no_motion()
    joints = [chain.index(scene.arm.number(motion.link), 0, 0) for motion in scene.motion]
    with np.errstate(all="ignore"):
        pieces = [_pieces(motion) for motion in scene.motion]
    for motion, piece in zip(scene.motion, pieces, strict=True):
        if not np.isfinite(piece).all():
            text = "its rate between two times overflows float64; expected a slower motion"
            raise SceneError(f"motion.{motion.link}.{motion.keys[0]}: {text}", id="overflow")
    knots = [np.array(motion.times) for motion in scene.motion]
    first = np.cumsum([0, *map(len, knots)], dtype=np.int64)
    return MotionTable(np.array(joints, dtype=np.int64), first, np.concatenate(knots), np.concatenate(pieces))


@functools.lru_cache(maxsize=64)
def _pieces(motion: PrescribedMotion) -> Array:
    """Quintic Hermite pieces, followed by a piece with the final rate; cached for all models of a scene."""
    pieces = quintics(motion.times, motion.in_si().T)
    pieces.flags.writeable = False
    return pieces


# A scene's tip wrench as the arrays that the kernels read, and at its start or at another time.


def initial_wrench(scene: Scene, chain: Chain) -> tuple[Array, Frame]:
    """The wrench at the start of a scene, shape (6,), and the frame of its axes; errors as in `loads_of`."""
    loads = loads_of(scene, chain)
    return (scene.tip_wrench, "world") if loads is None else _with_frame(given_at(loads, scene.initial.time))


def wrench_at(inputs: Inputs, t: float) -> tuple[Array, Frame]:
    """The wrench at time t [s], shape (6,), and the frame of its axes."""
    return _with_frame(inputs.given_wrench(t))


def _with_frame(given: GivenWrench) -> tuple[Array, Frame]:
    return given.tip_wrench, "tip" if given.follower else "world"


def loads_of(scene: Scene, chain: Chain) -> Loads | None:
    """The tip wrench; None if it is constant and acts on the arm's tip; errors as in `pieces_of`.

    In that case its work follows from the motion of the tip in frame 0.
    """
    wrench = scene.wrench
    if not wrench.varies and (not wrench.acts or chain.loaded == len(chain.bodies) - 1):
        return None
    times = np.array(wrench.times or (0.0,))
    tables = {"forces": wrench.forces or (wrench.force,), "moments": wrench.moments or (wrench.moment,)}
    rows = {name: np.zeros((len(times), 3)) + table for name, table in tables.items()}
    if wrench.times is None or wrench.hold:
        knots, parts = held_knots(times), [table[:, None] for table in rows.values()]
    else:
        knots = times
        parts = [pieces_of(f"wrench.{name}", times, table, smooth=wrench.smooth) for name, table in rows.items()]
    coefficients = np.ascontiguousarray(np.concatenate(parts, axis=2))
    path = path_to(chain.bodies, loaded_body(chain.bodies))
    return Loads(True, wrench.frame == "tip", knots, coefficients, chain.arrays, path)
