"""Ties between points of the arm: exact ones, which close loops, and springs, stops, cables, walls and play."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.wording import both_given, missing, truncated
from flexlink.describe.arm import Arm
from flexlink.describe.directions import unit
from flexlink.describe.joint import Limits
from flexlink.describe.numbers import require_increasing
from flexlink.describe.sensor import Sensor, beyond_beam
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, link_key, measured_in

SPRING, RANGE = ("stiffness", "damping"), ("play", "only", "dissipation")


class TieEnd(Spec, frozen=True):
    """The other end of a tie: a point of a link, or of frame 0.

    Examples
    --------
    >>> print(fl.details.TieEnd(link="upper", x=0.5))
    TieEnd(link='upper', x=0.5)
    """

    link: str | int | None = None
    """Link, by name or number from 1. Default: frame 0."""
    x: Annotated[NonNegative | None, measured_in("m")] = None
    """Position along the link's beam, from the beam's root [m]. Default: the end of the link."""
    point: Annotated[Vector3 | None, measured_in("m")] = None
    """Point of the undeformed link, in the link's frame, instead of `x`; or the point in frame 0 [m]."""
    axis: Vector3 | None = None
    """Direction in axes of the link or of frame 0, which need not be normalized. Hinge: its axis; default: the tie's
    `axis`. Slider: the line on which the tie's point moves. Point: the only direction in which the tie acts, as of a
    wall."""
    rpy_deg: Annotated[Vector3 | None, measured_in("deg")] = None
    """Weld: roll, pitch, yaw of the tie's link in axes of the link or of frame 0 [deg]. Default: 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.x is not None and self.point is not None:
            raise both_given("point", self.point, f"x = {self.x!r}")
        if self.link is None and self.x is not None:
            raise self._refused("x", "needs a link; give link, or point in frame 0", "needs-another-key")
        if self.axis is not None:
            unit("axis", self.axis)


class Tie(TieEnd, frozen=True, kw_only=True):
    """A tie between a point of a link and a point of another link, or of frame 0, `to`; or on the joint of a link.

    point: the points coincide, as in a ball joint; with `to.axis` only along this direction.  hinge: they coincide, and
    so do the axes, as in a revolute joint.  weld: they coincide, and the link's axes are those of `to`, turned by
    `to.rpy_deg`.  slider: the point is on the line through `to` along `to.axis`.
    distance: the points keep the distance `length`, as at the ends of a rod without mass; with `times` and `lengths` it
    moves.  joint: the joint of the link stays at 0, or with `to.link` moves by `ratio` times the joint of that link.
    stop: the joint stays within its limits.

    cylinder: a distance with oil on both sides of the piston, full at `length`, closed, and pumped to follow `lengths`:
    p = p₀ + β ln(V(l) / V(l + g)) in each chamber, p₀ its `pressures`, β the `bulk_modulus`; at 0 absolute it is empty.
    It pulls with A_rod p_rod − A_bore p_bore + `damping` ġ. There is no leakage, and the piston does not stop.

    A tie holds exactly, by a force g = 0 with the displacement g; with `stiffness` it is a spring, k g + `damping` ġ.
    A spring may act in one direction only, or beyond a `play`. It then presses with k δ (1 + c δ̇), δ > 0 the depth and
    c the `dissipation` (Hunt & Crossley 1975). Steps end where it begins or ceases to press.

    `simulate`, `Problem` and `Simulator` take scenes with ties, as do `simulate_many`, `sweep`, `sensitivities`, `fit`,
    `advise`, `report`, `compare` and `compare_trajectories`. `solve_static`, `modes`, `buckling_loads`, `linearize` and
    `to_mjcf` take them as `ties`. All other functions refuse them.

    Examples
    --------
    >>> rod = fl.details.Tie(name="rod", kind="distance", link="fore", length=1.2, to={"point": (1.0, -0.8, 0.0)})
    >>> changes = {"tie": (rod,), "drive": fl.Drive(), "initial.passive": "zero", "run.tolerance": 1e-4}
    >>> held = fl.simulate(scene.varied(changes), duration=0.1)
    >>> print(np.linalg.norm(held.tip - rod.to.point, axis=1).round(12).max())  # m
    1.2
    """

    name: str
    """Name of the tie, for messages."""
    kind: Literal["point", "hinge", "weld", "slider", "distance", "cylinder", "joint", "stop"]
    """What the tie holds: points, points and axes, a point on a line, the distance of points, or a joint."""
    ratio: Annotated[float | None, measured_in("1", "m/rad")] = None
    """For joints of `link` and `to.link`: position of the first per position of the second, as of gears [1], or of a
    rack [m/rad]. Default: 1."""
    length: Annotated[Positive | None, measured_in("m")] = None
    """For a distance or cylinder: the distance [m]."""
    times: Annotated[tuple[float, ...] | None, measured_in("s")] = None
    """For a distance that moves: times [s], from 0; between them the length is a quintic from rest to rest."""
    lengths: Annotated[tuple[Positive, ...] | None, measured_in("m")] = None
    """For a distance that moves, instead of `length`: the distance at each time [m]; it keeps the last one."""
    bore: Annotated[Positive | None, measured_in("m")] = None
    """For a cylinder: diameter of the piston [m]."""
    rod: Annotated[NonNegative, measured_in("m")] = 0.0
    """For a cylinder: diameter of the rod, on one side of the piston [m]."""
    stroke: Annotated[tuple[Positive, Positive] | None, measured_in("m")] = None
    """For a cylinder: shortest and longest distance of the points [m], where the piston meets the cylinder's ends."""
    bulk_modulus: Annotated[Positive | None, measured_in("Pa")] = None
    """For a cylinder: bulk modulus β of the oil with its hoses [Pa]; about 1e9 Pa."""
    dead_volume: Annotated[NonNegative, measured_in("m³")] = 0.0
    """For a cylinder: volume of oil in each chamber, with its hose, when the piston is at its end [m³]."""
    pressures: Annotated[tuple[NonNegative, NonNegative], measured_in("Pa")] = (0.0, 0.0)
    """For a cylinder: pressures p₀ above that of the air, of the bore side and the rod side, at `length` [Pa]."""
    stiffness: Annotated[Positive | None, measured_in("N m/rad", "N/m")] = None
    """Stiffness k of a spring in place of an exact tie, on a revolute joint [N m/rad], else [N/m]. Default: exact."""
    damping: Annotated[NonNegative, measured_in("N m s/rad", "N s/m")] = 0.0
    """Damping of a spring without a free range, on a revolute joint [N m s/rad], else [N s/m]."""
    play: Annotated[Positive | None, measured_in("rad", "m")] = None
    """Free range of a spring, from −play/2 to play/2: on a revolute joint [rad] about zero, else [m] about `length`."""
    only: Literal["push", "pull"] | None = None
    """Direction of a spring: a cable only pulls, g > 0; a wall with its outward normal `to.axis` only pushes, g < 0."""
    dissipation: Annotated[NonNegative, measured_in("s/rad", "s/m")] = 0.0
    """Factor c of the speed in the force of a spring with a free range, on a revolute joint [s/rad], else [s/m]. It is
    about 1.5 (1 − e) / v for a coefficient of restitution e near 1 at the speed v."""
    to: TieEnd = TieEnd()
    """The other end, `to.link` with `to.x` or `to.point`; without a link `to.point` is a point of frame 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.link is None:
            raise missing("link", "give the link of the tie")
        self._check_kind("tie", self.kind, "rpy_deg")
        if self.on_joint:
            known = (TieEnd(), TieEnd(link=self.to.link))[: 1 + (self.kind == "joint")]
            for key, value in (("x", self.x), ("point", self.point), ("to", None if self.to in known else self.to)):
                if value is not None:
                    why = f"kind {self.kind!r} is on the joint of link; leave it out"
                    raise self._refused(key, why, "key-of-another-kind")
            if self.ratio is not None and self.to.link is None:
                raise self._refused("ratio", "needs a second joint; give to.link", "needs-another-key")
        elif self.to.link is None and self.to.point is None:
            raise missing("to.point", "give the point of frame 0 [m], or to.link")
        self._check_length()
        self._check_spring()

    def _check_length(self) -> None:
        if not self.has_length:
            return
        if self.length is not None and (self.times or self.lengths):
            raise both_given("length", self.length, "times")
        if self.length is None and not (self.times and self.lengths):
            raise missing("length", "give it, or times and lengths")
        if self.times and self.lengths:
            if len(self.times) != len(self.lengths):
                text = f"lengths has {len(self.lengths)} values: expected one per time, {len(self.times)}"
                raise SceneError(text, id="one-per-time")
            require_increasing("times", self.times, from_zero=True)
        if self.kind == "cylinder":
            self._check_oil()

    def _check_oil(self) -> None:
        """Check that the piston is inside the cylinder, and larger than its rod."""
        shortest, longest = self.stroke or (0.0, 0.0)
        if not shortest < longest:
            raise self._refused("stroke", "the second distance must be greater than the first", "cylinder-sizes")
        if not self.rod < (self.bore or 0.0):
            raise self._refused("rod", f"must be less than bore = {self.bore!r}", "cylinder-sizes")
        for key, lengths in (("length", (self.length,)), ("lengths", self.lengths)):
            for l in lengths or ():
                if l is not None and not shortest < l < longest:
                    text = f"{key} = {l!r}: must be within stroke = [{shortest!r}, {longest!r}] m"
                    raise SceneError(text, id="cylinder-sizes")

    def _check_spring(self) -> None:
        one = self.kind != "point" or self.to.axis is not None
        for key in (*SPRING[1:], *RANGE):
            value = getattr(self, key)
            if value and self.stiffness is None and self.kind != "cylinder":
                raise self._refused(key, "needs a spring; give stiffness, or leave it out", "needs-another-key")
            if value and key in RANGE and not one:
                raise self._refused(key, "a point needs a direction for it; give to.axis", "needs-another-key")
        if self.play and self.only:
            raise both_given("only", self.only, f"play = {self.play!r}")
        key = "damping" if self.has_range else "dissipation"
        if getattr(self, key):
            text = "springs with a free range have none; give dissipation [s/m]"
            if not self.has_range:
                text = "springs without a free range have none; give damping [N s/m], or play or only"
            raise self._refused(key, text, "key-of-another-kind")

    @property
    def on_joint(self) -> bool:
        """Whether the tie is on the link's joint, and has no points."""
        return self.kind in ("joint", "stop")

    @property
    def exact(self) -> bool:
        """Whether the tie holds without a spring."""
        return self.stiffness is None and self.kind != "cylinder"

    @property
    def has_length(self) -> bool:
        """Whether the tie acts along the distance of its points."""
        return self.kind in ("distance", "cylinder")

    @property
    def has_range(self) -> bool:
        """Whether the tie is a spring that does not act in part of its range."""
        return bool(self.play or self.only or self.kind == "stop")

    @property
    def range(self) -> tuple[float, float]:
        """Free range of g [m, rad], other than of a stop."""
        half = (self.play or 0.0) / 2
        return (-math.inf, 0.0) if self.only == "pull" else (0.0, math.inf) if self.only == "push" else (-half, half)


def stops_of(limits: Limits, arm: Arm, ties: Sequence[Tie], moved: set[str | int]) -> Iterator[Tie]:
    """The stops that `limits` makes of the limits of an arm with these ties, except on the links `moved` as given.

    A stiffness that is missing for joints of one kind, or has no effect, is refused.
    """
    if limits == Limits():
        return
    known = {tie.link for tie in ties if tie.kind == "stop"} | moved
    limited = [(link, "_m" if link.joint.terms.unit == "m" else "") for link in arm.links if link.joint.limits]
    for key in ("stiffness", "dissipation", "stiffness_m", "dissipation_m"):
        if getattr(limits, key) and key.endswith("_m") not in {bool(m) for _, m in limited}:
            why = "has no effect; no joint of this kind has limits; leave it out"
            raise SceneError(f"limits.{key} = {getattr(limits, key)!r}: {why}", id="no-effect")
    for link, m in limited:
        if not link.joint.locked and not known & {link.name, arm.number(link.name)}:
            k, c = getattr(limits, f"stiffness{m}"), getattr(limits, f"dissipation{m}")
            if k is None:
                raise missing(f"limits.stiffness{m}", f"joint {link.name!r} is {link.joint.kind}")
            yield Tie(name=f"stop of {link.name}", kind="stop", link=link.name, stiffness=k, dissipation=c)


def refuse_ties(
    ties: Sequence[Tie],
    why: str = "only runs, sweeps, reports, sensitivities, fits, advice, solve_static, modes, buckling_loads, "
    "linearize, to_mjcf and comparisons support ties",
) -> None:
    """Refuse a scene with ties."""
    if ties:
        raise SceneError(f"tie.{ties[0].name}: {why}; leave [[tie]] and limits out", id="ties-not-supported")


def tie_mistakes(ties: Sequence[Tie], arm: Arm, sensors: Sequence[Sensor]) -> Iterator[Diagnostic]:
    """Report ties that do not fit the arm, duplicate names, and sensors of ties that do not have their signal."""
    for sensor in sensors:
        able = [tie.name for tie in ties if not tie.on_joint and (sensor.kind == "force" or tie.kind == "cylinder")]
        if sensor.on_tie and sensor.tie not in able:
            text = f"sensor.{sensor.name}.tie = {sensor.tie!r}: expected a tie"
            text += " between points" if sensor.kind == "force" else " of kind 'cylinder'"
            yield Diagnostic(f"{text}: {', '.join(map(repr, able)) or 'there is none'}", "unknown-tie")
    names = [tie.name for tie in ties]
    for k, tie in enumerate(ties):
        path = f"tie.{link_key(names, k)}"
        if names.index(tie.name) < k:
            yield Diagnostic(f"{path}.name = {tie.name!r}: names of ties must differ", "name-twice")
        numbers = []
        for end, above in ((tie, path), (tie.to, f"{path}.to")):
            if end.link is not None:
                try:
                    numbers.append(arm.number(end.link))
                except ArgumentError as error:
                    yield Diagnostic(f"{above}.{error}", error.id)
                    continue
                if beyond := beyond_beam(end.x, arm.links[numbers[-1] - 1]):
                    yield Diagnostic(f"{above}.{beyond}", beyond.id)
        if tie.on_joint and numbers:
            joint = arm.links[numbers[0] - 1].joint
            if any(arm.links[number - 1].joint.locked for number in numbers):
                yield Diagnostic(f"{path}: its joint is locked; a tie needs a free joint", "tie-of-locked-joint")
            elif tie.kind == "stop" and joint.limits is None:
                text = f"{path}: the joint of link {truncated(tie.link)} has no limits; give {joint.limits_key}"
                yield Diagnostic(text, "stop-without-limits")
        if len(numbers) == 2 and numbers[0] == numbers[1]:
            text = f"{path}.to.link = {truncated(tie.to.link)}: is the tie's own link; name another one"
            yield Diagnostic(text, "tie-to-itself")
