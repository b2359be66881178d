"""Outputs of a sweep: one number per run, computed from a sampled column or from the complete run."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.numbers import within
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3
from flexlink.describe.tie import refuse_ties
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.placement import tip_position
from flexlink.motion.side_by_side import Block
from flexlink.results.samples import sources_of
from flexlink.results.trajectory import Trajectory, deflections

REDUCTIONS: Mapping[str, Callable[[Array, Array], Array]] = {
    "final": lambda t, x: x[..., -1],
    "first": lambda t, x: x[..., 0],
    "min": lambda t, x: x.min(axis=-1),
    "max": lambda t, x: x.max(axis=-1),
    "largest": lambda t, x: np.abs(x).max(axis=-1),
    "range": lambda t, x: np.ptp(x, axis=-1),
    "mean": lambda t, x: x.mean(axis=-1),
    "rms": lambda t, x: np.sqrt(np.mean(x * x, axis=-1)),
    "time of min": lambda t, x: t[np.argmin(x, axis=-1)],
    "time of max": lambda t, x: t[np.argmax(x, axis=-1)],
}
"""Functions of the times t and a column x, shape (samples,), or of several runs, (runs, samples)."""

DEFLECTION = "deflection [m]"  # column of `deflections`: distance of the tip from its position with all springs at rest


class SweepOutput(Spec, frozen=True):
    """One number per run; the name of the quantity `of` contains its unit.

    A sampled column (`Trajectory.columns`, for example "tip x [m]", or "deflection [m]") is reduced by `take`, by
    default "final". "largest" is the largest absolute value, "range" is maximum − minimum. Only samples from the time
    `after` [s] on are used. "steps" and "evaluations" are counts of the run, "error [m]" is its largest stated error.
    "settling time [s]" needs a `tolerance` [m]. Settling time and "overshoot [m]" take a `target`: a point in frame 0,
    "final" (the tip's last position), or "rest" (its static equilibrium, with the joints at their final angles).
    """

    of: str
    """A sampled column, for example "tip x [m]", or a measure of the run, for example "settling time [s]"."""
    take: Literal[
        "final", "first", "min", "max", "largest", "range", "mean", "rms", "time of min", "time of max"
    ] | None = None  # fmt: skip
    """Reduction of the column to one number. Default: final."""
    after: NonNegative = 0.0
    """Time of the first sample to use [s]."""
    target: Vector3 | Literal["rest", "final"] | None = None
    """For settling time and overshoot: a point in frame 0 [m], the tip's final position, or its rest position."""
    tolerance: Positive | None = None
    """For the settling time: distance from the target within which the tip must remain [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        known = MEASURES[self.of][1] if self.of in MEASURES else {"take", "after"}
        for name, value in (("take", self.take), ("after", self.after or None),
                            ("target", self.target), ("tolerance", self.tolerance)):  # fmt: skip
            if value is not None and name not in known:
                allowed = ", ".join(sorted(known)) or "no options"
                why = f"{name} = {truncated(value)}: quantity {self.of!r} takes {allowed}"
                raise SceneError(why, id="key-of-another-kind")
        if "tolerance" in known and self.tolerance is None:
            raise SceneError(f"tolerance: missing; quantity {self.of!r} needs one [m]", id="missing-key")

    def measure(self, run: Trajectory) -> float:
        """This output of a run; an error if the run has no such column, no sample in time, or no rest position."""
        if self.of in MEASURES:
            return float(MEASURES[self.of][0](self, run))
        return float(self._reduced(run.t, column_of(run, self.of)))

    def measure_all(self, block: Block) -> list[float]:
        """Apply `measure` to every member of a block, with bitwise equal results."""
        if self.of in MEASURES:
            return [self.measure(block.trajectory(k)) for k in range(len(block.members))]
        return [float(value) for value in self._reduced(block.t[: block.rows], columns_of(block, self.of))]

    def _reduced(self, t: Array, column: Array) -> Array:
        first = len(t) - int(within(t, self.after).sum())
        if first == len(t):
            raise ArgumentError(f"after = {self.after:g}: the run ends at {t[-1]:g} s", id="after-the-end")
        return REDUCTIONS[self.take or "final"](t[first:], column[..., first:])

    def place(self, run: Trajectory) -> Array:
        """Target position of the tip, shape (3,) [m]."""
        if self.target == "final":
            return np.asarray(run.tip[-1])
        if isinstance(self.target, tuple):
            return np.array(self.target)
        chain = run.chain
        if run.scene is not None:
            refuse_ties(run.scene.ties, "the position at rest of an arm with ties is not computed")
        rest = solve_static(chain, run.q[-1], tip_wrench=run.tip_wrench[-1], locked=chain.active.tolist())
        return tip_position(chain, rest.q)


def column_of(run: Trajectory, name: str) -> Array:
    """Return a sampled quantity by its name, shape (samples,)."""
    if name == DEFLECTION:
        return deflections(run)
    columns = run.columns
    if name not in columns:
        known = [*columns, DEFLECTION, *MEASURES]
        why = f"of = {truncated(name)}: no such quantity; allowed are {short_list(known)}{did_you_mean(name, known)}"
        raise ArgumentError(why, id="unknown-quantity")
    return columns[name]


def columns_of(block: Block, name: str) -> Array:
    """`column_of` for every member of a block, shape (members, samples)."""
    if name == DEFLECTION:
        return block.deflections
    sources = sources_of(block.chain)
    if name not in sources:
        return np.array([column_of(block.trajectory(k), name) for k in range(len(block.members))])
    column = sources[name](block.samples)
    return np.ascontiguousarray(column.T) if column.ndim > 1 else np.array([column] * len(block.members))


def _counted(run: Trajectory, name: str) -> float:
    if run.steps is None:
        text = f"of = {name!r}: only runs of flexlink's native engine count them"
        raise ArgumentError(text, id="engine-does-not-support")
    return float(getattr(run.steps, {"steps": "taken"}.get(name, name)))


def _stated(run: Trajectory) -> float:
    """Largest stated error of the tip [m]."""
    if run.error is None:
        raise ArgumentError("error [m]: only for runs with a tolerance; fixed steps state no error", id="no-effect")
    return float(run.error.max())


MEASURES: Mapping[str, tuple[Callable[[SweepOutput, Trajectory], float], set[str]]] = {
    "steps": (lambda _output, run: _counted(run, "steps"), set()),
    "evaluations": (lambda _output, run: _counted(run, "evaluations"), set()),
    "error [m]": (lambda _output, run: _stated(run), set()),
    "settling time [s]": (
        lambda output, run: run.settling_time(
            target=output.place(run), tolerance=output.tolerance or 0.0, after=output.after
        ),
        {"target", "tolerance", "after"},
    ),
    "overshoot [m]": (lambda output, run: run.overshoot(target=output.place(run)), {"target"}),
    "residual vibration [m]": (lambda output, run: run.residual_vibration(after=output.after), {"after"}),
}
"""Measures of a run, each with the options of `SweepOutput` that it takes."""


def measured(quantities: Mapping[str, SweepOutput], run: Trajectory) -> tuple[tuple[float | None, ...], str]:
    """Outputs of a run (None for an output that cannot be computed), and the reasons for missing outputs."""
    values: list[float | None] = []
    reasons = []
    with np.errstate(all="ignore"):
        for name, quantity in quantities.items():
            try:
                values.append(quantity.measure(run))
            except FlexlinkError as error:
                values.append(None)
                reasons.append(f"{name}: {error}")
    return tuple(values), "; ".join(reasons)


def measured_together(quantities: dict[str, SweepOutput], block: Block) -> list[tuple[tuple[float | None, ...], str]]:
    """`measured` for every member of a block, in order."""
    try:
        with np.errstate(all="ignore"):
            columns = [quantity.measure_all(block) for quantity in quantities.values()]
    except FlexlinkError:  # one by one, so that each member gets the numbers that can be computed
        return [measured(quantities, block.trajectory(k)) for k in range(len(block.members))]
    return [(values, "") for values in zip(*columns, strict=True)]
