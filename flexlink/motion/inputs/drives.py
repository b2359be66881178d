"""A scene's drive as the record of arrays that the kernels read, and its gains −∂T_EX/∂q, −∂T_EX/∂q̇."""

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.memo import Memo, keep_last
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene, bare_and_rigid
from flexlink.dynamics.filters import linear_filter, transition
from flexlink.dynamics.forces import Gains
from flexlink.dynamics.terms import gravity_torque
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.inputs.drive_torque import drive_slopes
from flexlink.kernels.inputs.laws import CASCADE, CASCADE_GRAVITY, COMPUTED_TORQUE, PD, PD_GRAVITY, TABLE, RigidModel
from flexlink.kernels.inputs.record import Drive, PiecewisePolynomial
from flexlink.kernels.layout import BODY, HINGE
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.inputs.references import constant, held_knots, pieces_of, reference_arrays


def drive_arrays(scene: Scene, chain: Chain) -> Drive:
    """The scene's drive; a drive without joints if it has none; errors as in `pieces_of` and `holding_torque`."""
    # function that builds the arrays, by kind of drive
    laws = {"constant": _table, "table": _table, "pd": _pd, "computed_torque": _computed_torque, "cascade": _cascade}
    kind = scene.drive.kind if len(chain.active) else "none"
    if kind == "none":
        return no_drive()
    if kind in {"constant", "table"} and scene.drive.rate is None:  # shared, since runs never write to it
        joints = chain.active.tobytes(), tuple(chain.coordinates[k].link for k in chain.active.tolist())
        return TORQUES(scene.drive, (joints, len(chain.link_names)), lambda: _table(scene, chain))
    law = laws[kind](scene, chain)
    return law if scene.drive.rate is None else _sampled(scene, law)


TORQUES = Memo(64)  # cache of torque tables by drive and driven joints, shared by variants of an arm


def drive_of(joints: Indices, **parts: Any) -> Drive:
    """A drive of these joints with zero torque and no limits, except as given by `parts`."""
    d = len(joints)
    nothing = PiecewisePolynomial(np.zeros(1), np.zeros((1, 2, d)))
    blank = Drive(
        TABLE, 0.0, 0.0, joints, np.full(d, np.inf), np.empty((2, d)), nothing, nothing, np.zeros(d), np.zeros(d),
        np.zeros((0, 4)), np.zeros((0, 1, 3)), None, np.zeros((0, d)), np.zeros(1, np.int64),
    )  # fmt: skip
    return limited(blank._replace(**parts))


def limited(drive: Drive, effort: Array | None = None) -> Drive:
    """The drive with torques limited to ± effort [N m], shape (d,); None: the drive's own effort."""
    effort = drive.effort if effort is None else effort
    return drive._replace(effort=effort, limits=np.array([-effort, effort]))


def held_torques(chain: Chain, times: Array, torques: Array, effort: Array | None = None) -> Drive:
    """A drive that applies torques (m, d) to the driven joints, holding each row until the next time."""
    table = PiecewisePolynomial(held_knots(times), np.ascontiguousarray(torques[:, None]))
    return limited(drive_of(chain.active.copy(), feedforward=table), effort)


def effort_of(scene: Scene, chain: Chain) -> Array:
    """Torque limit of every driven joint [N m], shape (d,); inf if none is specified."""
    effort = scene.drive.effort
    return np.full(len(chain.active), np.inf) if effort is None else of_joints(chain, effort)


def same_law(a: Drive, b: Drive) -> bool:
    """Whether two drives are equal except for their rigid models, so that they can act side by side."""
    return a is b or all(map(np.array_equal, _numbers(a), _numbers(b)))


def _numbers(drive: Drive) -> tuple[Any, ...]:
    sampling = drive.law, drive.rate, drive.delay, drive.held.shape
    gains = drive.kp, drive.kd, drive.servo, drive.filters
    return *sampling, drive.joints, drive.effort, *drive.reference, *drive.feedforward, *gains


def pushed(chain: Chain) -> Drive:
    """A drive whose torques are whatever is in `held`, (1, d): a sampled law without instants."""
    never = np.array([np.iinfo(np.int64).max])
    return drive_of(chain.active.copy(), rate=1.0, held=np.zeros((1, len(chain.active))), next_instant=never)


def side_by_side(drives: Sequence[Drive]) -> Drive:
    """The drive of eight chains side by side; the last one is repeated to fill all lanes."""
    one = drives[0]
    eight = [drives[min(lane, len(drives) - 1)].model for lane in range(LANES)]
    own = (RigidModel(m.chain, rne_workspace(m.chain), m.wrench, *np.zeros((4, len(m.q)))) for m in eight)
    model = None if one.model is None else tuple(own)  # copies with their own motion and scratch
    return one._replace(model=model, held=np.zeros((*one.held.shape, LANES)), next_instant=one.next_instant.copy())


def remembered(drive: Drive) -> tuple[NDArray[Any], ...]:
    """The arrays of a drive to which a run writes."""
    return drive.held, drive.next_instant


def gains_of(chain: Chain, drive: Drive, t: float, q: Array, qd: Array) -> Gains:
    """−∂T_EX/∂q and −∂T_EX/∂q̇ of a drive without torque limits, (n,) if diagonal, else (n, n); 0 if it is sampled."""
    n, joints = chain.n, drive.joints
    if not len(joints) or drive.law == TABLE:  # independent of the state
        return Gains(*np.zeros((2, n)))
    slopes = np.zeros((2, n, len(joints)))
    if not drive.rate:
        unlimited = limited(drive, np.full(len(joints), np.inf))
        # step [rad, rad/s] of the central differences; they are exact for a linear law, up to rounding
        drive_slopes(unlimited, t, np.array([q, qd]), 1e-5, np.zeros((2, n)), slopes)
    own = slopes[:, joints]
    on_diagonal = np.einsum("kii->ki", own)
    if np.count_nonzero(own) == np.count_nonzero(on_diagonal):
        diagonal = np.zeros((2, n))
        diagonal[:, joints] = on_diagonal
        return Gains(*diagonal)
    whole = np.zeros((2, n, n))
    whole[:, :, joints] = slopes
    return Gains(*whole)


@keep_last(64)
def gains_at_zero(drive: Drive, chain: Chain, continuous: bool = False) -> Gains:
    """Gains of a drive at zero angles and rates, read-only; `continuous` takes a sampled law as continuous."""
    zero = np.zeros(chain.n)
    return gains_of(chain, _continuous(drive) if continuous else drive, 0.0, zero, zero)


def _continuous(drive: Drive) -> Drive:
    """A sampled law as if it were continuous, and without its memory."""
    drive = drive._replace(rate=0.0)
    return drive if drive.law < CASCADE else drive._replace(law=PD, kp=drive.kd * drive.kp)


def _table(scene: Scene, chain: Chain) -> Drive:
    drive, effort = scene.drive, effort_of(scene, chain)
    times, torques = _rows(scene, chain)
    if drive.hold:
        return held_torques(chain, times, torques, effort)
    return drive_of(chain.active.copy(), effort=effort, feedforward=_interpolated(scene, times, torques))


def _rows(scene: Scene, chain: Chain) -> tuple[Array, Array]:
    """Times (m,) and torques (m, d) of a drive's table."""
    drive = scene.drive
    rows = drive.torques or (drive.torque,)
    return np.array(drive.times or (0.0,)), np.array([of_joints(chain, row) for row in rows])


def _interpolated(scene: Scene, times: Array, torques: Array) -> PiecewisePolynomial:
    return PiecewisePolynomial(times, pieces_of("drive.torques", times, torques, smooth=scene.drive.smooth))


def _pd(scene: Scene, chain: Chain) -> Drive:
    feedback = _feedback(scene, chain)
    if scene.drive.reference is not None and scene.drive.reference.follows == "tip":
        from flexlink.motion.inputs.feedforward import tip_arrays  # noqa: PLC0415  few scenes invert the arm

        reference, torques = tip_arrays(scene, chain)
        return feedback._replace(law=PD, reference=reference, feedforward=torques)
    return _fed(scene, chain, feedback, PD, PD_GRAVITY)


def _cascade(scene: Scene, chain: Chain) -> Drive:
    filters = _filters_of(scene, chain, float(scene.drive.rate or 0.0))
    feedback = _feedback(scene, chain)._replace(servo=_servo_of(scene, chain), filters=filters)
    return _fed(scene, chain, feedback, CASCADE, CASCADE_GRAVITY)


def _servo_of(scene: Scene, chain: Chain) -> Array:
    """k_i, v_max [rad/s, m/s], rate feedforward and inertia of each driven joint, shape (d, 4), as in `cascade`."""
    drive, links = scene.drive, _links_of(chain)
    nothing = (0.0,) * len(scene.arm.links)
    fastest = scene.arm.in_si(scene.arm.own(drive.max_rate_deg, drive.max_rate_m))
    found = np.zeros((len(links), 4))
    found[:, 0] = np.array(drive.ki or nothing)[links]
    found[:, 1] = np.where(fastest > 0.0, fastest, np.inf)[links]
    found[:, 2] = 1.0 if drive.rate_feedforward is None else drive.rate_feedforward
    found[:, 3] = np.array(drive.inertia or nothing)[links]
    return found


def _filters_of(scene: Scene, chain: Chain, rate: float) -> Array:
    """Φ, Γ, Ψ, S, C, D of the filters of each driven joint, shape (d, f + 1, f + 3), as in `cascade`."""
    names = [scene.arm.links[k].name for k in _links_of(chain)]
    series = [tuple(each for each in scene.drive.filter if each.link in {"", name}) for name in names]
    f = max((len(linear_filter(each).B) for each in series), default=0)
    found = np.zeros((len(names), f + 1, f + 3))
    for block, filters in zip(found, series, strict=True):
        own, (Φ, Γ, Ψ) = linear_filter(filters), transition(filters, 1.0 / rate)
        n = len(own.B)
        block[:n, :n], block[:n, f], block[:n, f + 1] = Φ, Γ, Ψ
        block[:n, f + 2] = own.settled if n else 0.0
        block[f, :n], block[f, f] = own.C, own.D
    return found


def _links_of(chain: Chain) -> list[int]:
    """Index of the link of each driven joint."""
    return [chain.coordinates[k].link - 1 for k in chain.active.tolist()]


def _fed(scene: Scene, chain: Chain, feedback: Drive, law: int, by_model: int) -> Drive:
    """Add feed-forward, computed once for a constant reference, else by law `by_model` with the rigid model."""
    if scene.drive.torques is not None:
        return feedback._replace(law=law, feedforward=_interpolated(scene, *_rows(scene, chain)))
    target = feedback.reference
    still = len(target.knots) == 1 and not target.coefficients[:, 1:].any()
    if scene.drive.gravity == "rigid" and not still:
        return feedback._replace(law=by_model, model=rigid_model(lump(bare_and_rigid(scene))))
    if scene.drive.gravity == "static":
        from flexlink.motion.inputs.feedforward import holding_torque  # noqa: PLC0415  few scenes need statics

        torque = holding_torque(chain, target)
    elif scene.drive.gravity == "rigid":
        torque = constant(gravity_torque(lump(bare_and_rigid(scene)), target.coefficients[0, 0]))
    else:
        torque = constant(np.zeros(len(chain.active)))
    return feedback._replace(law=law, feedforward=torque)


def _computed_torque(scene: Scene, chain: Chain) -> Drive:
    return _feedback(scene, chain)._replace(law=COMPUTED_TORQUE, model=rigid_model(lump(bare_and_rigid(scene))))


def _feedback(scene: Scene, chain: Chain) -> Drive:
    """Reference, gains and limits of the driven joints."""
    kp, kd = (of_joints(chain, gains) for gains in (scene.drive.kp, scene.drive.kd))
    reference = reference_arrays(scene, chain)
    return drive_of(chain.active.copy(), effort=effort_of(scene, chain), reference=reference, kp=kp, kd=kd)


def _sampled(scene: Scene, law: Drive) -> Drive:
    """The law sampled at instants t = k / rate, with memory for all instants of the run and its delay before."""
    run, rate = scene.run, float(scene.drive.rate or 0.0)
    if not run.controlled:
        rate = 1.0 / (round(1.0 / (rate * run.fixed_step)) * run.fixed_step)  # same rounding as multiples of the step
    delay = scene.drive.delay
    rows = round(run.duration * rate) + 3 + math.ceil(delay * rate)
    memory = law.servo.shape[0] * (1 + law.filters.shape[1])
    return law._replace(rate=rate, delay=delay, held=np.zeros((rows, len(law.joints) + memory)))


def resampled(drive: Drive, scene: Scene, chain: Chain, rate: float) -> Drive:
    """The law at another sampling rate [Hz]; 0: as if it were continuous, without memory."""
    if drive.law < CASCADE or not rate:
        return drive._replace(rate=rate)
    return drive._replace(rate=rate, filters=_filters_of(scene, chain, rate))


def recall(drive: Drive, delayed: Array) -> None:
    """Give a sampled law its memory and the torques on their way when an earlier run ended (`Drive.delayed`)."""
    for acts, *torques in delayed.tolist() if drive.rate else []:
        number = round((acts - drive.delay) * drive.rate)
        drive.held[number % len(drive.held)] = torques  # and the memory
        drive.next_instant[0] = number + 1


def rigid_model(chain: Chain) -> RigidModel:
    """Rigid model of a chain: its arrays, its workspace, and the motion at which a control law evaluates it."""
    arrays = chain.as_full().arrays
    return RigidModel(arrays, rne_workspace(arrays), np.zeros(6), *np.zeros((4, chain.n)))


@functools.cache
def no_drive() -> Drive:
    """A drive without joints. All runs share it, since it is never written to."""
    return drive_of(np.empty(0, np.int64))


@functools.cache
def no_model() -> RigidModel:
    """Rigid model for laws that need none: a chain without bodies. All runs share it, since it is never written to."""
    return rigid_model(Chain("", np.empty(0, BODY), np.empty(0, HINGE), np.zeros(3), (), ()))


def of_joints(chain: Chain, per_link: tuple[float, ...] | None) -> Array:
    """Values of the driven joints, from one value per link, shape (d,)."""
    numbers = per_link or (0.0,) * len(chain.link_names)
    return np.array([numbers[chain.coordinates[k].link - 1] for k in chain.active.tolist()], dtype=np.float64)
