"""`invert`: torques and joint motion with which the tip of a flexible arm follows a move, checked by a run."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import Diagnostic, FlexlinkError, SceneError
from flexlink.common.types import Array, Complex
from flexlink.describe.drive import Drive
from flexlink.describe.initial import InitialState
from flexlink.describe.joint_units import OF_MOTION
from flexlink.describe.link import Link
from flexlink.describe.reference import Reference
from flexlink.describe.run_settings import AUTO
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.shaping import InputShaper
from flexlink.dynamics.result import Result
from flexlink.dynamics.tip_inversion.feedforward import Feedforward, directions_of, feedforward_of, refuse
from flexlink.dynamics.tip_inversion.moves import move_of, unshaped
from flexlink.dynamics.vibration.linear import pd_poles
from flexlink.motion.inputs.drives import of_joints
from flexlink.motion.inputs.feedforward import acting_torques, from_rest_to_rest
from flexlink.motion.inputs.initial_state import Rows, by_unit, per_link
from flexlink.motion.simulate import simulate
from flexlink.results.trajectory import Trajectory


class ShapedMove(NamedTuple):
    """The move of an `Inversion` by joint PD with an input shaper, for comparison."""

    run: Trajectory
    """Its run, in the time of the original scene."""
    lag: float
    """Largest distance of the tip from the path of the inversion [m]."""
    settles: float
    """Time from the end of the path until the tip stays within the tolerance of its goal [s]; inf if it does not."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Inversion(Result):
    """Torques and joint motion with which the tip follows a move, and the nonlinear run that they drive.

    Attributes
    ----------
    scene
        The scene, ready to run and to save: PD about the joint motion, with the torques as feedforward table. Its time
        is later than that of the given scene by `starts` − `given_start` if torques would have to begin before 0.
    run
        The run of this scene.
    times
        Times in this scene [s], shape (m,), equally spaced.
    torques, joints
        Torques and positions of the driven joints at these times, shape (m, d) [N m, rad; N, m].
    path
        Positions of the tip at these times, shape (m, 3) [m].
    directions
        Orthonormal directions in which the driven joints move the tip, at these times, shape (m, 3, d).
    zeros
        Transmission zeros at the start of the move, slowest first [1/s].
    starts, ends
        Start and end of the tip's move in this scene [s].
    given_start
        Start of the tip's move in the given scene [s].
    tolerance
        Largest allowed `error` [m].
    by_joints
        The given scene, with the same move of its joints, without input shaper.
    goal
        The arm at rest after the move, shape (n,) [rad].
    """

    scene: Scene
    run: Trajectory
    times: Array
    torques: Array
    joints: Array
    path: Array
    directions: Array
    zeros: Complex
    starts: float
    ends: float
    given_start: float
    tolerance: float
    by_joints: Scene
    goal: Array

    @property
    def starts_before(self) -> float:
        """Pre-actuation: time from the first torque to the start of the tip's move [s]."""
        return self.starts - float(self.times[0])

    @property
    def ends_after(self) -> float:
        """Time from the end of the tip's move to the last change of torque [s]."""
        return float(self.times[-1]) - self.ends

    @property
    def error(self) -> float:
        """Largest error of the tip in the run, in the directions in which its joints can move it [m]."""
        return float(self._missed(self.run).max())

    @functools.cached_property
    def beam_error(self) -> float:
        """Largest error of the tip of a continuous beam under the same drive [m]; inf if its run fails.

        The beam has at least twice as many hinges as each link, at least 8, by the rule gauss or by cells, of order 2
        or more; so a quarter of its error, at most, is left out. Sag that a coarse link misses is part of it.
        """
        try:
            return float(self._missed(simulate(_as_beam(self.scene, self.tolerance))).max())
        except FlexlinkError:
            return math.inf

    @property
    def residual(self) -> float:
        """The `error` from the end of the move on [m]."""
        return float(self._missed(self.run)[self.run.t >= self.ends - 1e-9].max(initial=0.0))

    @property
    def distance(self) -> float:
        """Largest distance of the tip from its path in the run, in all directions [m].

        A single link that bends is shorter; no torque of its joint can change that.
        """
        return float(np.linalg.norm(self._off(self.run), axis=1).max())

    @property
    def settles(self) -> float:
        """Time from the end of the move until the tip stays within the tolerance of its goal [s]; inf if never."""
        return self.run.settling_time(target=self.path[-1], tolerance=self.tolerance, after=self.ends)

    @property
    def met(self) -> bool:
        """Whether the error of the run is within the tolerance; that of a continuous beam is in the `warnings`."""
        return self.error <= self.tolerance

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """Warnings of the run, and if the tip misses its path by more than the tolerance, in the run or in a beam."""
        found, allowed = [*self.run.warnings], f"more than {1e3 * self.tolerance:.3g} mm"
        if not self.met:
            sampled = "check that the sampled loop is stable, or use a higher drive.rate"
            remedy = "use larger gains" if self.scene.drive.rate is None else sampled
            missed = f"tip: misses its path by {1e3 * self.error:.3g} mm, {allowed}"
            text = f"{missed}; {remedy}, a smaller run.tolerance or run.step, or a longer move"
            found.append(Diagnostic(text, "tip-off-path"))
        if self.beam_error > self.tolerance:
            missed = f"would miss the path by {1e3 * self.beam_error:.3g} mm, {allowed}"
            missed += "; use more segments, or a longer move"
            unknown = "cannot be run, so its error is not known; flexlink advise finds the segments that a motion needs"
            text = f"link.segments: a continuous beam {missed if math.isfinite(self.beam_error) else unknown}"
            found.append(Diagnostic(text, "beam-off-path"))
        return tuple(found)

    def shaped(self, kind: str = "ZVD") -> ShapedMove:
        """Run the same move by joint PD alone, with an input shaper for the two slowest poles at its end.

        Parameters
        ----------
        kind
            The shaper.

        Returns
        -------
        ShapedMove
            The run, how far its tip is from the path of this inversion, and when it settles.

        Raises
        ------
        SceneError
            There is no such shaper, or the arm has no vibration under PD.

        Examples
        --------
        >>> beside = fl.invert(scene).shaped("ZV")
        >>> print(beside.lag > 0.01)  # m
        True
        """
        scene, chain = self.by_joints, lump(self.by_joints)
        kp, kd = (of_joints(chain, gains) for gains in (scene.drive.kp, scene.drive.kd))
        slow = pd_poles(chain, self.goal, kp=kp, kd=kd, tip_wrench=scene.tip_wrench)[:2]
        run = simulate(scene.varied({"drive.reference.shaper": InputShaper.at(slow, kind)}))
        off = run.tip - self._path_at(run.t + self.starts - self.given_start)
        end = self.given_start + self.ends - self.starts
        settles = run.settling_time(target=self.path[-1], tolerance=self.tolerance, after=end)
        return ShapedMove(run, float(np.linalg.norm(off, axis=1).max()), settles)

    def _off(self, run: Trajectory) -> Array:
        """Tip minus path at all samples of a run, shape (samples, 3)."""
        return np.asarray(run.tip - self._path_at(run.t))

    def _missed(self, run: Trajectory) -> Array:
        """Its length in the `directions`, shape (samples,)."""
        spacing = self.times[1] - self.times[0]
        near = np.clip(np.rint((run.t - self.times[0]) / spacing), 0, len(self.times) - 1).astype(int)
        return np.asarray(np.linalg.norm(np.einsum("kij,ki->kj", self.directions[near], self._off(run)), axis=1))

    def _path_at(self, t: Array) -> Array:
        from scipy.interpolate import CubicSpline  # noqa: PLC0415  slow to import: 0.1 s

        return np.asarray(CubicSpline(self.times, self.path)(np.clip(t, self.times[0], self.times[-1])))

    def __repr__(self) -> str:
        begin = f"torques begin {self.starts_before:.3g} s before the move"
        return f"<Inversion of {self.scene.name!r}: {begin}; tip error {1e3 * self.error:.2g} mm>"


def invert(
    scene: Scene, to: ArrayLike | None = None, *, duration: float | None = None, tolerance: float = 1e-3
) -> Inversion:
    """Torques with which the tip, not the joints, follows a move from rest to rest: stable inversion.

    With joint control, the tip of a flexible arm lags behind the move and vibrates after it. This function computes the
    bounded motion of all joints and springs whose tip is on the path at all times, with the complete nonlinear
    equations, gravity and friction. Its torques begin before the tip moves, and end after it (Bayo 1987; Devasia, Chen
    & Paden 1996). For small moves, they are the inverse G(iω)⁻¹ of the linear model's frequency response. The result is
    checked by a run of the scene with these torques as feedforward of its PD drive.

    Parameters
    ----------
    scene
        The scene, with drive kind "pd". Its reference is the move: the tip is to be, at any time, where it would be
        with the arm at rest at the reference's angles. Acceleration must not jump, and an input shaper is left out. The
        arm starts at rest. A sampled drive holds its torques and delays them; the torques allow for both.
    to
        Instead of the reference: a point to which the tip moves along a straight line [m], shape (3,), in frame 0, with
        a quintic profile; from t = 0.
    duration
        Duration of the move to a point [s].
    tolerance
        Largest allowed error of the tip in the run [m]; if it is exceeded, `warnings` contains a remedy.

    Returns
    -------
    Inversion
        Torques, joint motion, the scene that they drive, and its run.

    Raises
    ------
    ArgumentError
        An argument is invalid, or the tip cannot reach the point.
    SceneError
        Nothing moves, or the reference is not smooth; the arm has a free base, a prescribed motion, another drive, a
        wrench that varies or friction that lags, or does not bend; it has
        more driven joints than directions in which they move the tip; a transmission zero is on the imaginary axis,
        or too slow; or the torques exceed `drive.effort`.
    ConvergenceError
        There is no such motion, or no equilibrium on the path.
    DivergenceError
        The run diverges, such as with an unstable sampled drive.

    Examples
    --------
    >>> found = fl.invert(scene)
    >>> print(found.met, found.starts_before < 0.1)  # s
    True True
    >>> path = found.scene.save("moved.toml")  # run it with flexlink simulate
    """
    scene, tolerance = require_type("scene", scene, Scene), positive("tolerance", tolerance)
    chain = lump(scene)
    refuse(scene, chain)
    initial = scene.initial
    if initial.q or initial.qd or initial.time or scene.joint_rates.any():
        why = "initial: the arm must start at rest, in equilibrium; leave out q, qd, rate_deg, rate_m and time"
        raise SceneError(why, id="inversion-not-possible")
    wrench = scene.tip_wrench
    move = move_of(scene, chain, to, duration, wrench)
    found = feedforward_of(scene, chain, move, wrench)
    driven, shift = driven_scene(scene, chain, found)
    return Inversion(
        scene=driven, run=simulate(driven), times=found.times + shift, torques=found.motion.torques,
        joints=found.motion.q[:, chain.active], path=found.path.tips,
        directions=directions_of(chain, found.path.postures), zeros=found.zeros[0][0], starts=move.start + shift,
        ends=move.start + shift + move.duration, given_start=move.start, tolerance=tolerance,
        by_joints=joint_scene(scene, chain, found, straight=to is not None), goal=found.path.postures[-1],
    )  # fmt: skip


def driven_scene(scene: Scene, chain: Chain, found: Feedforward) -> tuple[Scene, float]:
    """The scene driven by the inverse, later by a shift [s] so that its torques begin at t >= 0; and this shift."""
    drive, run, q = scene.drive, scene.run, found.path.postures
    shift = max(0.0, -float(found.times[0]))
    times = found.times + shift
    rows: dict[str, Rows] = {}
    for key, part in zip(OF_MOTION, from_rest_to_rest(found), strict=True):
        rows |= by_unit(scene, chain, key, part[:, chain.active])
    table = tuple(times.tolist())
    driven = Drive(
        kind="pd", kp=drive.kp, kd=drive.kd, reference=Reference(profile="smooth", times=table, **rows),  # type: ignore[arg-type]
        times=table, torques=per_link(scene, chain, acting_torques(scene, found)), smooth=True, effort=drive.effort,
        rate=drive.rate, delay=drive.delay,
    )  # fmt: skip
    parts = math.ceil(50 * run.spacing / found.move.duration - 1e-9)  # 50 samples per move show its error
    if drive.rate is not None or not run.controlled:  # samples are at sampling instants, or at ends of steps
        units = round(run.spacing * (drive.rate or 1.0 / run.fixed_step))
        parts = next((k for k in range(parts, units) if units % k == 0), max(1, units))
    spacing = float(f"{run.spacing / parts:.12g}")
    samples = math.ceil(max(run.duration + shift, times[-1]) / spacing - 1e-9)
    changes = {"run.sample": spacing, "run.duration": float(f"{samples * spacing:.12g}")}
    return scene.varied({"drive": driven, "initial": _at_rest(scene, chain, q[0]), **changes}), shift


def _as_beam(scene: Scene, tolerance: float) -> Scene:
    """The scene with twice the hinges, or 8, or more, in each link that bends, and steps that meet a tolerance."""
    links = tuple(link if link.flex == "rigid" else _divided(link) for link in scene.arm.links)
    steps: dict[str, object] = {"run.method": AUTO, "run.step": None, "run.tolerance": 0.1 * tolerance}
    # a fixed step that suits the scene may be unstable with more hinges
    return replace(scene, arm=replace(scene.arm, links=links)).varied({} if scene.run.controlled else steps)


def _divided(link: Link) -> Link:
    hinges = link.segments - 1
    if lumping_rule(link.lumping).cells is None:
        return replace(link, segments=max(8, 2 * hinges) + 1, lumping="gauss")
    return replace(link, segments=hinges * max(2, math.ceil(8 / hinges)) + 1)  # cells are better than gauss


def joint_scene(scene: Scene, chain: Chain, found: Feedforward, *, straight: bool) -> Scene:
    """The scene with the same move of its joints by PD, without input shaper; gravity is compensated if it acts."""
    q, spacing = found.path.postures, scene.run.spacing
    samples = math.ceil((found.move.start + found.move.duration) / spacing - 1e-9)  # up to the end of the move
    changes = dict[str, object]({"run.duration": max(scene.run.duration, float(f"{samples * spacing:.12g}"))})
    if straight:
        ends = by_unit(scene, chain, "to_deg", q[-1:, chain.active])
        changes["drive.reference"] = Reference(
            profile="quintic", duration=found.move.duration, **{key: rows[0] for key, rows in ends.items()}  # type: ignore[arg-type]
        )  # fmt: skip
        changes |= {"drive.target_deg": None, "drive.target_m": None}
    if any(scene.gravity) and scene.drive.gravity == "none":
        changes |= {"drive.times": None, "drive.torques": None, "drive.gravity": "static"}
    if scene.drive.reference is not None and not straight:
        changes["drive.reference.follows"] = "joints"
    return unshaped(scene).varied({**changes, "initial": _at_rest(scene, chain, q[0])})


def _at_rest(scene: Scene, chain: Chain, posture: Array) -> InitialState:
    """Initial state at rest in a posture (n,); locked joints keep their angles."""
    starts = by_unit(scene, chain, "joint_deg", posture[None, chain.active])
    rows = []
    for key, before in (("joint_deg", scene.initial.joint_deg), ("joint_m", scene.initial.joint_m)):
        row = starts.get(key, ((0.0,) * len(scene.arm.links),))[0]
        own = zip(before or (0.0,) * len(row), row, scene.arm.links, strict=True)
        rows.append(tuple(old if link.joint.locked else new for old, new, link in own))
    return InitialState(joint_deg=rows[0], joint_m=rows[1] if any(rows[1]) else None, passive="static")
