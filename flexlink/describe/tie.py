"""Ties, which close loops: points of the arm that stay together, or keep their distance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.wording import both_given, missing, truncated
from flexlink.describe.arm import Arm
from flexlink.describe.directions import unit
from flexlink.describe.sensor import beyond_beam
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, link_key, measured_in


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
    """For a hinge: its axis, in axes of the link or of frame 0; need not be normalized. Default: the tie's `axis`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.x is not None and self.point is not None:
            raise both_given("point", self.point, f"x = {self.x!r}")
        if self.link is None and self.x is not None:
            raise self._refused("x", "needs a link; give link, or point in frame 0", "needs-another-key")
        if self.axis is not None:
            unit("axis", self.axis)


class Tie(Spec, frozen=True):
    """A tie between a point of a link and a point of another link, or of frame 0, `to`; it closes a loop.

    point: the points coincide, as in a ball joint.  hinge: they coincide, and so do the axes, as in a revolute joint.
    distance: they keep the distance `length`, as at the ends of a rod without mass.

    A tie holds exactly, without a spring. `simulate` and `Problem` take scenes with ties, by implicit methods such as
    Radau5; all other functions refuse them.

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
    kind: Literal["point", "hinge", "distance"]
    """What the tie holds: two points together, two points and two axes, or the distance of two points."""
    link: str | int
    """Link, by name or number from 1."""
    x: Annotated[NonNegative | None, measured_in("m")] = None
    """Position along the link's beam, from the beam's root [m]. Default: the end of the link."""
    point: Annotated[Vector3 | None, measured_in("m")] = None
    """Point of the undeformed link, in the link's frame, instead of `x` [m]; it moves with the nearest segment."""
    axis: Vector3 | None = None
    """For a hinge: its axis, in axes of the link; need not be normalized."""
    length: Annotated[Positive | None, measured_in("m")] = None
    """For a distance: the distance [m]."""
    to: TieEnd = TieEnd()
    """The other end, `to.link` with `to.x` or `to.point`; without a link `to.point` is a point of frame 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.x is not None and self.point is not None:
            raise both_given("point", self.point, f"x = {self.x!r}")
        if self.to.link is None and self.to.point is None:
            raise missing("to.point", "give the point of frame 0 [m], or to.link")
        for key, kind in (("axis", "hinge"), ("length", "distance")):
            if getattr(self, key) is None and self.kind == kind:
                raise missing(key, f"kind {kind!r} needs it")
            if getattr(self, key) is not None and self.kind != kind:
                raise self._refused(key, f"only for kind {kind!r}; leave it out", "key-of-another-kind")
        if self.axis is not None:
            unit("axis", self.axis)


def refuse_ties(ties: Sequence[Tie], why: str = "only simulate and Problem support ties") -> None:
    """Refuse a scene with ties.

    Raises
    ------
    SceneError
        There are ties.
    """
    if ties:
        raise SceneError(f"tie.{ties[0].name}: {why}; leave [[tie]] out", id="ties-not-supported")


def tie_mistakes(ties: Sequence[Tie], arm: Arm) -> Iterator[Diagnostic]:
    """Report ties that do not fit the arm, and duplicate names."""
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
        if len(numbers) == 2 and numbers[0] == numbers[1]:
            text = f"{path}.to.link = {truncated(tie.to.link)}: is the tie's own link; name another one"
            yield Diagnostic(text, "tie-to-itself")
