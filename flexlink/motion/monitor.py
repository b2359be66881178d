"""Checks of a run in progress: power balance, bending of hinges, joint limits, and errors of its steps."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array, Indices, Mask
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.dynamics import rounding
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.inputs.laws import TABLE
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.judgement import SEEN, WRONG, Allowance
from flexlink.kernels.stepping.runge_kutta import NEVER, probe
from flexlink.kernels.stepping.samples import tips_and_energies
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion.hindrance import held_torques_advice, hindrance, loop_warning
from flexlink.motion.tolerable import Thresholds, allowed_imbalance, probed, samples_apart, stated_of, tolerance_of
from flexlink.results import balance
from flexlink.results.record import Record
from flexlink.results.samples import StatedError, Steps
from flexlink.results.stop_reasons import DivergenceError, Failure
from flexlink.results.tip_motion import apart, compared_path, extent_of_motion, motion_in_words
from flexlink.results.trajectory import Trajectory

if TYPE_CHECKING:
    from flexlink.motion.sampled_control import Control


FAULTS = {
    WRONG.kinetic: Diagnostic(
        "the kinetic energy is negative: M is not positive definite", "mass-not-positive-definite"
    ),
    WRONG.finite: Diagnostic("energies or torques overflow float64", "diverged"),
}


class Monitor:
    """Checks each sample of a run against earlier ones only, so results do not depend on the length of chunks."""

    before: StatedError | None  # estimated error of the run that this one continues
    stated: StatedError | None  # estimated error of this run, once it has ended

    def __init__(self, record: Record, warnings: tuple[Diagnostic, ...] = (), control: Control | None = None) -> None:
        chain, run = record.chain, record.run
        self.record, self.control = record, control
        self._balance = balance.Balance(
            chain, record.inputs.potential_force, insisted=run.unstable == "allow",
            bend=Thresholds.far_bent, near=Thresholds.at_limit, kept=record.kept,
        )  # fmt: skip
        self.negative_rotors = record.kept("negative rotors", None, lambda: bool((chain.hinges["armature"] < 0).any()))
        self.explicit = record.problem.explicit
        self.start(warnings)

    def start(self, warnings: tuple[Diagnostic, ...] = ()) -> None:
        """Watch the run whose samples the record holds now, with warnings from the check of its step."""
        self.run = self.record.run
        self.n_valid, self.scene = 0, self.record.problem.scene  # number of valid samples, from the first
        self.confirmed = False  # by a verification run
        self.before, self.stated = None, None
        self.failure: str = ""  # fault of the first invalid sample
        self.warnings = [*warnings, *loop_warning(self.record)]
        self.methods: Sequence[tuple[int, str, str]] = ()
        self.steps, (self.deflection, self.angle_travelled, self.drifting) = Steps(self.run.method, 0, 0), (0.0,) * 3
        self._warned: set[str] = set()
        self._step_errors = [np.zeros(0)] if self.explicit else []
        self._furthest = -Thresholds.a_degree  # largest bend of a hinge at the last check of M [rad]
        self._extent = 0, 0.0  # number of samples, and the extent of their path
        self._balance.clear()

    def begin(self) -> None:
        """Compute tip and energies of the first sample, with which all other samples are compared."""
        self.record.derive(0, 1)
        self._balance.start(self.record.energy[:, 0], self.record.tip[0])

    def compile(self) -> None:
        """Compile what `check` calls, while no signal is deferred."""
        self.record.compile()
        self._balance.compile(self.record.samples)

    def check(
        self, stop: int, steps: Steps | None = None, errors: Array | None = None, *,
        methods: Sequence[tuple[int, str, str]] = (), so_far: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> bool:  # fmt: skip
        """Compute and check the new samples before `stop`; return whether all are valid.

        `errors`, if known, are the `step_errors` of the steps from the `probed` samples. For adaptive steps, `methods`
        lists each method with the index of its first sample and the reason for its choice; `so_far` are the largest
        deflection [m], the angle travelled by all free joints [rad], and the sum of errors of rates that last [m/s].
        """
        first, self.steps, self.methods = self.n_valid, steps or self.steps, methods
        self.deflection, self.angle_travelled, self.drifting = so_far
        if stop == first or self.failure:
            return not self.failure
        self.record.derive(first, stop)
        definite = self._definite(first, stop) if self.negative_rotors else stop
        self._check_samples(first, definite, methods)
        if self.n_valid == definite < stop:
            bent = self._bent(definite, self._bends(slice(definite, stop))[0])
            text = f"{bent}, too far for matched twist: M is not positive definite; use more segments"
            self.failure = Diagnostic(text, "mass-not-positive-definite")
        if self.n_valid > first and self.explicit:
            self._step_errors.append(self._probed(first, errors))
        return not self.failure

    def trajectory(self) -> Trajectory:
        """The valid samples with all warnings; only the first sample if none has been checked yet."""
        if not self.n_valid:
            self.check(1)
        stated, warnings = self.stated, (*self.warnings, *self._doubts())
        if stated is None and self.run.controlled:
            stated = stated_of(self)
        return self.record.trajectory(self.n_valid, warnings, self.steps, True, stated, self.scene)

    @property
    def tolerance(self) -> float:
        """Tolerance of the steps so far [m], but at least the smallest one that rounding errors allow."""
        return max(tolerance_of(self.run, self.record.chain, self.deflection), self.record.least_tolerance)

    @property
    def extent(self) -> float:
        """Extent of the tip's path (or of the path that replaces it) in the valid samples (`extent_of_motion`) [m]."""
        if self._extent[0] != self.n_valid:
            self._extent = self.n_valid, extent_of_motion(self.record.compared(self.n_valid))
        return self._extent[1]

    def diverged(self, failure: Failure | None = None) -> DivergenceError:
        """Return the error of a run that failed a check, or whose steps ended early."""
        record, run = self.record, self.run
        advice = f"try a smaller step than {run.fixed_step:g} s"
        if run.controlled:
            smaller = "smaller" if self.failure else "larger"  # else no step met the tolerance
            advice = f"try a {smaller} tolerance, another method, or fixed steps"
        loop = self._loop_advice()
        advice = loop or advice
        if self.failure or failure is None:
            text = f"t = {record.t[self.n_valid]:.6g} s: {self.failure}"
            failure = Failure(text, id=getattr(self.failure, "id", ""))
        if failure.advice:
            sampled = self.control is not None and self.control.sampled
            advice = f"{loop}; else {failure.advice}" if loop and sampled else failure.advice
        message = f"{record.chain.name}: {failure.text}; {advice}; {self.n_valid} samples kept"
        return failure.kind(message, self.trajectory(), id=failure.id)

    def _loop_advice(self) -> str:
        """Advice if the instability likely results from held torques and not from the steps; else empty."""
        if self.run.unstable == "allow":
            return ""
        if self.control is not None and self.control.sampled:
            return held_torques_advice(self.control.between)
        record = self.record
        found = hindrance(record, record.q[0], float(record.t[0])) if record.inputs.drive.rate else None
        return "; ".join(found or ())

    def _check_samples(self, first: int, stop: int, methods: Sequence[tuple[int, str, str]]) -> None:
        """Check samples: finite numbers, positive kinetic energy, energy balance, bends of hinges, joint limits."""
        seen, wrong = self._balance.seen, int(WRONG.nothing)
        if first == 0:
            self._balance.start(self.record.energy[:, 0], self.record.tip[0])
        self.n_valid = first
        begins = [(min(max(first, row), stop), name) for row, name, _ in methods or ((0, self.run.method, ""),)]
        for (begin, name), (end, _) in itertools.pairwise([*begins, (stop, "")]):
            if wrong == WRONG.nothing and self.n_valid == begin < end:
                self.n_valid, wrong = self._balance.look(begin, end, self.record.samples, self._allowance(name))
        if seen[SEEN.garbage] >= 0 or seen[SEEN.bent] or seen[SEEN.beyond]:
            for row, key, text in sorted(self._findings(slice(first, self.n_valid)), key=lambda found: found[0]):
                if key not in self._warned and (key != "bend" or not self._diverges):
                    self._warned.add(key)
                    self.warnings.append(Diagnostic(f"t = {self.record.t[row]:.6g} s: {text}", text.id))
        if seen[SEEN.garbage] >= 0 and self.run.unstable != "allow":
            unbalanced = f"{self._imbalance()} (at most {balance.SHARE:.0%} allowed)"
            self.failure = Diagnostic(unbalanced, "energy-imbalance")
        self.failure = FAULTS.get(wrong, self.failure)

    def _findings(self, rows: slice) -> Iterator[tuple[int, str, Diagnostic]]:
        """Yield warnings about these samples, each with the index of the sample, a key and the text."""
        seen = self._balance.seen
        if seen[SEEN.garbage] >= 0 and self.run.unstable == "allow":
            yield int(seen[SEEN.garbage]), "balance", Diagnostic(self._imbalance(), "energy-imbalance")
        if seen[SEEN.bent]:
            yield from self._far_bends(rows)
        if seen[SEEN.beyond]:
            yield from self._past_limits(rows)

    def _imbalance(self, left: int = SEEN.imbalance, of: int = SEEN.available) -> str:
        r, X = self._balance.seen[[left, of]]
        return f"the energy does not balance: E − E(0) − W = {r:.3g} J of {X:.3g} J exchanged"

    def unbalanced(self, q: Array, qd: Array, work: Array, steps: Steps, deflection: float) -> Failure | None:
        """Check the energy balance in a state beyond the samples, even with unstable = "allow"; return any failure.

        The arguments are angles and rates (n,), the integrated work (1,), and the steps and the largest `deflection`
        [m] of the run up to this state. A failed check leaves the balance unchanged.
        """
        record, seen = self.record, self._balance.seen
        tip, energy = np.empty((1, 3)), np.empty((3, 1))
        tips_and_energies(record.chain.arrays, q[None], qd[None], tip, energy)
        work = work + (tip - record.tip[0]) @ record.inputs.potential_force
        before, so_far = seen.copy(), np.zeros((1, SO_FAR.size))
        so_far[0, [SO_FAR.deflection, SO_FAR.steps]] = deflection, steps.taken
        samples = record.t[:1], q[None], qd[None], np.zeros((1, len(q))), tip, energy, work, so_far
        seen[SEEN.garbage] = -1.0
        _, wrong = self._balance.look(0, 1, samples, self._allowance(steps.method)._replace(compared=False))
        if wrong == WRONG.kinetic or (wrong == WRONG.nothing and seen[SEEN.garbage] < 0):
            return None
        text = self._imbalance(SEEN.last, SEEN.exchanged)
        seen[:] = before
        return Failure(text, id="energy-imbalance")

    def _allowance(self, name: str) -> Allowance:
        """Energy imbalance that the tolerance explains at samples computed by a method."""
        record = self.record

        def found() -> Allowance:
            explicit = name != AUTO and method(name).explicit  # before the first step the method may not be chosen yet
            return allowed_imbalance(self.run, record.chain, record.least_tolerance, explicit, not explicit)

        if not self.run.controlled:
            return balance.NOTHING
        return record.kept(("allowance", name), (self.run, record.least_tolerance), found)

    def _far_bends(self, rows: slice) -> Iterator[tuple[int, str, Diagnostic]]:
        """Warning about the first sample in which a hinge is bent too far."""
        bends = self._bends(rows)
        if bends.size and bends.max() > Thresholds.far_bent:
            row = int(np.argmax(bends.max(axis=1) > Thresholds.far_bent))
            bent = self._bent(rows.start + row, bends[row])
            text = f"{bent}: beyond 84° the chain is no longer a good model of a beam; use more segments"
            if bends[row].max() > 2 * np.pi:
                text = f"{bent}, more than a turn: the link is far too soft for its load; check young, section and load"
            yield rows.start + row, "bend", Diagnostic(text, "hinge-bent-far")

    def _bends(self, rows: slice) -> Array:
        return np.abs(self.record.q[rows][:, self._balance.bounds.bending])

    def _definite(self, first: int, stop: int) -> int:
        """Index of the first of these samples in which M is not positive definite, or `stop`.

        Only matched twist, with its negative rotor inertias, requires this check. It is repeated whenever a hinge is
        bent a degree more than at the last check.
        """
        for row, bend in enumerate(self._bends(slice(first, stop)).max(axis=1).tolist(), first):
            if bend >= self._furthest + Thresholds.a_degree:
                self._furthest, M = bend, mass_matrix(self.record.chain, self.record.q[row])
                if np.linalg.eigvalsh(M)[0] <= 0:
                    return row
        return stop

    def _past_limits(self, rows: slice) -> Iterator[tuple[int, str, Diagnostic]]:
        """Warnings about joints past their limits, which the model does not enforce."""
        chain, scene = self.record.chain, self.record.problem.scene
        stopped = {chain.index(scene.arm.number(tie.link or 0), 0, 0) for tie in scene.ties if tie.kind == "stop"}
        for k in sorted({*self._balance.bounds.limited.tolist()} - stopped):
            q, lower, upper = self.record.q[rows, k], chain.hinges["lower"][k], chain.hinges["upper"][k]
            out = np.maximum(lower - q, q - upper) > Thresholds.at_limit
            if out.any():
                row = rows.start + int(np.argmax(out))
                places = float(self.record.q[row, k]), float(lower), float(upper)
                at, least, most = (chain.place_in_words(k, place) for place in places)
                joint = f"joint {chain.joint_name(int(k))!r} is at {at}, past its limits {least} … {most}"
                text = f"{joint}; joint limits are not enforced; limits.stiffness makes them stops"
                yield row, f"limit {k}", Diagnostic(text, "joint-past-limits")

    def _bent(self, row: int, bends: Array) -> str:
        """Name and angle of the most bent hinge of a sample, for messages."""
        k = int(self._balance.bounds.bending[np.argmax(bends)])
        return f"hinge {self.record.chain.joint_name(k)!r} is bent by {np.degrees(self.record.q[row, k]):.1f}°"

    def _probed(self, first: int, known: Array | None) -> Array:
        """Errors of the probed steps after sample `first`, limited to valid samples; measured if not known."""
        sampled = probed(self.run, slice(first, self.n_valid))
        if known is not None:
            return known[: len(sampled)]
        with np.errstate(all="ignore"):
            return step_errors(self.record, sampled)

    @property
    def tip_error(self) -> float:
        """Sum of the errors of all fixed explicit steps [m], extrapolated from the measured ones; 0 for other steps."""
        if not self.explicit:
            return 0.0
        return float(summed(self.run, np.concatenate(self._step_errors), np.array(self.record.chain.size)))

    def _doubts(self) -> Iterator[Diagnostic]:
        """Warnings about a run that passed all checks but may be inaccurate."""
        if self.n_valid < 2:
            return
        rounded, tip_error = 0.0, self.tip_error
        if not self.run.controlled and not self._diverges:
            q, qd = self.record.q[: self.n_valid], self.record.qd[: self.n_valid]
            rounded = float(rounded_away(self.run, q, qd, np.array(self.record.chain.size)))
        moved = self.extent if tip_error or rounded else np.inf
        limited = None if self.record.inputs.drive.law == TABLE else self.at_limit
        if limited is not None and (part := limited.mean(axis=0)).max() > Thresholds.held:
            joint = self.record.chain.joint_name(int(self.record.inputs.drive.joints[np.argmax(part)]))
            text = f"the drive of {joint!r} is at its limit for {100 * part.max():.0f} % of the run"
            text += " and hardly controls it; raise drive.effort or slow the motion"
            yield Diagnostic(text, "drive-at-limit")
        if tip_error > Thresholds.doubt * Thresholds.tip_share * moved:
            text = f"step errors add up to {tip_error:.2g} m, {motion_in_words(self.record.chain, moved)}"
            yield Diagnostic(f"doubtful: {text}; halve the step and compare", "doubtful-step-errors")
        if rounded > Thresholds.doubt * Thresholds.tip_share * moved:
            largest = np.abs(self.record.q[: self.n_valid]).max()
            text = f"rounding errors of angles up to {largest:.2g} rad add up to {rounded:.2g} m, while the tip moves "
            text += f"{moved:.3g} m; start at angles of a few turns or less"
            yield Diagnostic(f"doubtful: {text}", "doubtful-rounding")
        if self.suspicious and not self.confirmed:
            excused, exchanged = self._balance.seen[[SEEN.excused, SEEN.exchanged]]
            remedy = f"{'take a tenth of the tolerance' if self.run.controlled else 'halve the step'} and compare"
            text = f"doubtful: the energy error is {excused / exchanged:.2g} of the energy exchanged; {remedy}"
            yield Diagnostic(text, "doubtful-energy")

    @property
    def _diverges(self) -> bool:
        """Whether an unstable loop, or a failed energy balance in spite of which the run goes on, explains bends."""
        return "balance" in self._warned or any(each.id == "unstable-loop" for each in self.warnings)

    @property
    def suspicious(self) -> bool:
        """Whether the energy imbalance is notable, or so large that only the tolerance explains it."""
        exchanged, _, unbalanced, excused = self._balance.seen[SEEN.exchanged : SEEN.travelled].tolist()
        least = Thresholds.doubt * balance.SHARE * exchanged
        return bool(unbalanced > least or excused > least / Thresholds.doubt)

    @property
    def at_limit(self) -> Mask | None:
        """Whether each driven joint's torque is at its limit, shape (valid samples, d); None without limits."""
        drive = self.record.inputs.drive
        if min(drive.effort.tolist(), default=np.inf) == np.inf:
            return None
        return np.abs(self.record.tau[: self.n_valid, drive.joints]) >= drive.effort

    @property
    def travelled(self) -> float:
        """Angle [rad] travelled, back and forth, by free joints in all steps, or by driven joints between samples."""
        return max(self.angle_travelled, float(self._balance.seen[SEEN.travelled]))


# Tip errors of fixed steps: one step h is compared with two steps h/2, at samples that represent all steps.
#
# The functions that sum over all steps also accept several runs side by side, along a first axis.


def step_errors(record: Record, probed: Indices) -> Array:
    """Distance between the tips after one step h and after two steps h/2 [m], from the `probed` samples of a run."""
    samples, found = (record.q, record.qd), [np.empty(0)]
    for part in record.parts(int(probed[0]), int(probed[-1]) + 1) if len(probed) else ():
        rows = probed[(probed >= part.start) & (probed < part.stop)]
        found.append(_tips(*_ends(record, record.scratch, record.inputs, samples, rows), [record])[0])
    return np.concatenate(found)


def step_errors_side_by_side(
    records: Sequence[Record], scratch: Any, inputs: Inputs, samples: tuple[Array, Array], probed: Indices
) -> Array:
    """`step_errors` (runs, probed) of up to eight runs side by side, from their samples (rows, n, 8) and scratch."""
    one, two = _ends(records[0], scratch, inputs, samples, probed)
    return _tips(one, two, records)


def summed(run: RunSettings, errors: Array, size: Array) -> Array:
    """Sum of all steps' errors [m], (…), from the probed ones (…, probed); rounding errors of the tip count as 0."""
    counted = np.where(errors < rounding.of_reach(1.0) * size[..., None], 0.0, errors)
    return np.asarray(counted.sum(axis=-1) * samples_apart(run) * run.steps_per_sample)


def rounded_away(run: RunSettings, q: Array, qd: Array, size: Array) -> Array:
    """Tip motion [m], shape (…), that N fixed steps may lose by rounding q + h q̇: N h q̇, at most N ulp(q)/2.

    The samples are (…, rows, n), of arms of size (…). The result is zero for angles of a few turns, where the loss does
    not exceed the usual rounding error.
    """
    most, steps = np.spacing(np.abs(q).max(axis=-2)) / 2, q.shape[-2] * run.steps_per_sample
    if (most.sum(axis=-1) <= rounding.of_reach(1.0)).all():
        return np.zeros(size.shape)
    lost = np.minimum(run.fixed_step * np.abs(qd).max(axis=-2), most).sum(axis=-1) * size
    return np.where(lost > rounding.of_reach(1.0) * size, lost * steps, 0.0)


def _ends(
    record: Record, scratch: Any, inputs: Inputs, samples: tuple[Array, Array], probed: Indices
) -> tuple[Array, Array]:
    """Angles (probed, n), or (probed, n, 8), after one step h and after two steps h/2."""
    run = record.run
    ends = np.empty((2, len(probed), *samples[0].shape[1:]))
    drive = inputs.drive._replace(next_instant=np.array([NEVER]))  # these steps do not evaluate a sampled law
    inputs, origins = inputs._replace(drive=drive), record.origin + probed * run.steps_per_sample
    arguments = scratch, method(run.method).arrays, inputs, run.fixed_step, origins, probed, samples, ends
    record.kept("probed steps", ends.ndim, lambda: direct(probe, *arguments))(*arguments)
    return ends[0], ends[1]


def _tips(one: Array, two: Array, records: Sequence[Record]) -> Array:
    """Distance of each arm's tip between two configurations, shape (arms, rows)."""
    found = np.empty((len(records), len(one)))
    for arm, record in enumerate(records):
        paths = (np.ascontiguousarray(part[..., arm] if part.ndim > 2 else part) for part in (one, two))
        found[arm] = apart(*(compared_path(record.chain, path) for path in paths))
    return found
