"""Checks of a run while it goes on: power balance, bending, joint limits, errors of its steps."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.conditions import AUTO, RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.dynamics import rounding
from flexlink.dynamics.terms import mass_matrix
from flexlink.motion.sampled_control import Control
from flexlink.motion.step_errors import step_errors
from flexlink.results import balance
from flexlink.results.record import Record
from flexlink.results.samples import Steps
from flexlink.results.stop_reasons import DivergenceError, Failure
from flexlink.results.tip_motion import extent_of_motion
from flexlink.results.trajectory import Trajectory

Indices = NDArray[np.intp]

FAR = np.radians(84.0)
"""Angle of a hinge from which a chain says little of the beam, and of three axes at one point the outer two nearly
coincide: cond(M) grows by 1/cos² 84° = 90, two decimal digits."""

TIP_SHARE = 0.05
"""Error of the tip, as a part of its motion, that counts as wrong: the same 5 % as in `balance.SHARE`."""


DOUBT = 0.1
"""Part of `balance.SHARE` and `TIP_SHARE` from which a run is doubtful: what is seen of the errors are the losses of
energy and the steps' own errors, which sensitive motion, and motion that drifts out of phase, multiply."""

LONG = 100
"""Number of steps with a tolerance in a run from which each is short: the error that it may have is in proportion."""


TOLERABLE = 3.0
"""Tolerances that a run may be off by: ten are the limit for an error at the end, one is what it should be."""

APART = 128
"""How many steps' own errors are looked at, by two steps of half the size: at least so many of a run, and of a long one
one in so many, which costs three in 128, 2 %."""


def least_tolerance(record: Record) -> float:
    """The smallest tolerance [m] that rounding allows, for the arm's reach and its initial angles."""
    # Roundings of the tip's place, each of one step, below which a tolerance asks for less than what they add up to
    roundings = 200.0
    return roundings * rounding.of_reach(record.chain.reach, float(np.abs(record.q[0]).max()))


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """The tolerance of a run [m]; a relative one is a part of the reach, or of the largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.reach)


def allowed_imbalance(
    run: RunSettings, chain: Chain, kinetic: Array, δ: float, moved: float, explicit: bool, compared: bool
) -> balance.Allowance:
    """Energy imbalance that position errors δ of the bodies, as large as the tolerance, explain: m g δ and m v δ/τ.

    τ, in which a body gets δ off its way, is a long step. Of a motion of a size, `moved` [m], errors of `TOLERABLE` δ
    that go as it goes change rates by as large a part, and energies by twice that. An implicit method damps vibrations
    that stay below δ, however fast they are, and all energy may have been theirs, or work that a drive does on them:
    it is `compared` with a second run, if there is one, which judges.
    """
    if not run.controlled:
        return balance.NOTHING
    momentum = np.sqrt(2 * chain.mass * np.abs(kinetic))
    share = 2 * TOLERABLE * δ / moved if explicit and moved > 0 else np.inf
    return balance.Allowance(δ * (chain.weight + momentum * LONG / run.duration), share, not explicit, compared)


class RunMonitor:
    """Checks the samples of a run, chunk by chunk in the order of time.

    Attributes
    ----------
    n_valid
        Number of valid samples, from the first on.
    failure
        What is wrong with the next sample; empty if nothing is.
    warnings
        What a reader of the valid samples should know.
    confirmed
        Whether a verification run agrees.
    tip_error
        Sum of the steps' own errors of the tip [m], of fixed steps of an explicit method.
    """

    def __init__(self, record: Record, warnings: tuple[str, ...] = (), control: Control | None = None) -> None:
        chain, run = record.chain, record.run
        self.record, self.run, self.control = record, run, control
        self.passive = np.array([k for k, c in enumerate(chain.coordinates) if c.segment], dtype=np.intp)
        self.limited = np.flatnonzero(np.isfinite(chain.hinges["lower"]))
        self.negative_rotors = bool((chain.hinges["armature"] < 0).any())
        self.n_valid, self.failure = 0, ""
        self.warnings = list(warnings)
        self._exchanged = 0.0  # up to now [J]
        self._unbalanced = self._excused = 0.0  # largest imbalance so far, apart from what is allowed, and with it [J]
        self.tip_error = 0.0
        self.confirmed = False
        self.explicit = record.problem.explicit
        self.steps, self.deflection, self.angle_travelled = Steps(run.method, 0, 0), 0.0, 0.0
        self._warned: set[str] = set()
        self._extent = 0, 0.0  # number of samples, and theirs

    def check(
        self,
        stop: int,
        steps: Steps | None = None,
        errors: Array | None = None,
        *,
        deflection: float = 0.0,
        angle_travelled: float = 0.0,
    ) -> bool:
        """Compute and check the samples before `stop` that are new; returns whether all are valid.

        `errors`, if known: the `step_errors` of the steps from the samples that are `probed`. Of steps with a
        tolerance: the largest `deflection` so far [m], and the `angle_travelled` by all free joints [rad].
        """
        first, self.steps = self.n_valid, steps or self.steps
        self.deflection, self.angle_travelled = deflection, angle_travelled
        if stop == first or self.failure:
            return not self.failure
        with np.errstate(all="ignore"):
            self.record.derive(first, stop)
            self.n_valid = stop
            self._judge_energy(slice(first, stop))
            if self.n_valid > first:
                self._judge_bend(slice(first, self.n_valid))
                self._judge_limits(slice(first, self.n_valid))
            if self.n_valid > first and self.explicit:
                self._probe_steps(slice(first, self.n_valid), errors)
        return not self.failure

    def trajectory(self) -> Trajectory:
        """The valid samples, with the warnings; the first one if none was checked yet."""
        if not self.n_valid:
            self.check(1)
        return self.record.trajectory(self.n_valid, (*self.warnings, *self._doubts()), self.steps)

    @property
    def tolerance(self) -> float:
        """Tolerance of the steps so far [m]; the rounding limit where nothing has bent yet."""
        return max(tolerance_of(self.run, self.record.chain, self.deflection), self.least)

    @functools.cached_property
    def least(self) -> float:
        """The smallest tolerance that rounding allows [m]."""
        return least_tolerance(self.record)

    @property
    def extent(self) -> float:
        """Extent of the tip in the valid samples (`extent_of_motion`) [m]."""
        if self._extent[0] != self.n_valid:
            self._extent = self.n_valid, extent_of_motion(self.record.tip[: self.n_valid])
        return self._extent[1]

    def diverged(self, failure: Failure | None = None) -> DivergenceError:
        """The error to raise for a run that failed a check, or whose steps ended early."""
        record, run = self.record, self.run
        advice = f"try a smaller step than {run.step:g} s"
        if run.controlled:
            smaller = "smaller" if self.failure else "larger"  # no step was small enough
            advice = f"try a {smaller} tolerance, another method, or fixed steps"
        if self.failure or failure is None:
            failure = Failure(f"t = {record.t[self.n_valid]:.6g} s: {self.failure}")
        message = f"{record.chain.name}: {failure.text}; {failure.advice or advice}; {self.n_valid} samples kept"
        return failure.kind(message, self.trajectory())

    def _judge_energy(self, rows: slice) -> None:
        """Samples are finite, their kinetic energy is positive, and their energy balances."""
        record = self.record
        energy, work = record.energy[:, rows], record.work(rows)
        if rows.start == 0:
            self._balance = balance.Balance(record.chain, record.energy[:, 0])
        allowance = self._allowance(energy[0])
        judged = self._balance.judge(energy, work, record.q[rows], self._steps_up_to(rows), allowance)
        r, X, explained, ε, garbage = judged
        finite = np.isfinite(r) & np.isfinite(X)
        if not np.isfinite(record.tau[rows]).all():
            finite &= np.isfinite(record.tau[rows]).all(axis=1)
        self._exchanged = float(X[-1])
        sound = finite & ~garbage
        self._unbalanced = max(self._unbalanced, float((np.abs(r) - explained)[sound].max(initial=0.0)))
        self._excused = max(self._excused, float((np.abs(r) - ε)[sound].max(initial=0.0)))
        if garbage.any():
            k = int(np.argmax(garbage))
            unbalanced = f"the energy does not balance: E − E(0) − W = {r[k]:.3g} J of {X[k]:.3g} J exchanged"
            if self.run.unstable == "allow":
                self._warn("balance", rows.start + k, unbalanced)
            else:
                self._stop_at(rows, garbage, f"{unbalanced} (at most {balance.SHARE:.0%} allowed)")
        self._stop_at(rows, energy[0] < -ε, "the kinetic energy is negative: M is not positive definite")
        self._stop_at(rows, ~finite, "energies or torques overflow float64")

    def _allowance(self, kinetic: Array) -> balance.Allowance:
        """Energy imbalance [J] of the next samples that the tolerance explains, from their kinetic energies [J]."""
        if not self.run.controlled:
            return balance.NOTHING
        name = self.steps.method  # before the first step it may not be picked yet
        explicit = name != AUTO and method(name).explicit
        moved = self.extent if explicit else 0.0
        return allowed_imbalance(
            self.run, self.record.chain, kinetic, self.tolerance, moved, explicit, compared=not explicit
        )

    def _steps_up_to(self, rows: slice) -> Array | int:
        """Number of steps up to each of these samples; of adaptive steps the number so far."""
        if self.run.controlled:
            return self.steps.taken
        return self.run.steps_per_sample * np.arange(rows.start, rows.stop)

    def _judge_bend(self, rows: slice) -> None:
        """Check that no hinge is bent too far, and that M is positive definite (matched twist has negative rotors)."""
        record, passive = self.record, self.passive
        if not passive.size:
            return
        bends = np.abs(record.q[rows][:, passive])
        if bends.max() > FAR:
            row = int(np.argmax(bends.max(axis=1) > FAR))
            text = (
                f"{self._bent(rows.start + row, bends[row])}: beyond 84° the chain is no longer a good model of a beam"
            )
            self._warn("bend", rows.start + row, f"{text}; use more segments")
        if not self.negative_rotors:
            return
        row = int(np.argmax(bends.max(axis=1)))
        if np.linalg.eigvalsh(mass_matrix(record.chain, record.q[rows][row]))[0] <= 0:
            self.n_valid = rows.start + row
            bent = self._bent(self.n_valid, bends[row])
            self.failure = f"{bent}, too far for matched twist: M is not positive definite; use more segments"

    def _judge_limits(self, rows: slice) -> None:
        """Warn of joints beyond their limits; the model has no end stops."""
        # How far past a limit an angle still counts as at it [rad]: rounding of a run that starts or is led there
        rounding_of_angles = 1e-9
        chain = self.record.chain
        for k in self.limited:
            q, lower, upper = self.record.q[rows, k], chain.hinges["lower"][k], chain.hinges["upper"][k]
            out = np.maximum(lower - q, q - upper) > rounding_of_angles
            if out.any():
                row, (least, most) = rows.start + int(np.argmax(out)), np.degrees([lower, upper])
                angle = f"joint {chain.joint_name(int(k))!r} is at {np.degrees(self.record.q[row, k]):.6g}°"
                self._warn(
                    f"limit {k}",
                    row,
                    f"{angle}, past its limits {least:.6g}° … {most:.6g}°; the model has no end stops",
                )

    def _bent(self, row: int, bends: Array) -> str:
        """Name and angle of the hinge that is bent most in a sample, for messages."""
        k = int(self.passive[np.argmax(bends)])
        return f"hinge {self.record.chain.joint_name(k)!r} is bent by {np.degrees(self.record.q[row, k]):.1f}°"

    def probed(self, rows: slice) -> Indices:
        """Samples whose next step's error is measured."""
        every = self._apart()
        return np.arange(-(-rows.start // every) * every, rows.stop, every)

    def _apart(self) -> int:
        """Distance between measured steps [samples]."""
        fewest = 64  # steps of a run whose error is measured, if it has so many
        per_sample = self.run.steps_per_sample
        steps_apart = min(APART, (self.run.samples - 1) * per_sample // fewest)
        return max(1, -(-steps_apart // per_sample))

    def _probe_steps(self, rows: slice, known: Array | None) -> None:
        """Add up the errors of steps, extrapolated from the measured ones."""
        probed = self.probed(rows)
        errors = step_errors(self.record, probed) if known is None else known[: len(probed)].copy()
        errors[errors < rounding.of_position(self.record.chain)] = 0.0
        self.tip_error += float(errors.sum()) * self._apart() * self.run.steps_per_sample

    def _doubts(self) -> Iterator[str]:
        """Warnings of a run that passed all checks but may be inaccurate."""
        if self.n_valid < 2:
            return
        rounded = self._rounded_away()
        moved = self.extent if self.tip_error or rounded else np.inf
        if self.tip_error > DOUBT * TIP_SHARE * moved:
            yield (
                f"doubtful: step errors add up to {self.tip_error:.2g} m, while the tip moves {moved:.3g} m; "
                "halve the step and compare"
            )
        if rounded > DOUBT * TIP_SHARE * moved:
            largest = np.abs(self.record.q[: self.n_valid]).max()
            yield (
                f"doubtful: rounding of angles up to {largest:.2g} rad adds up, step by step, "
                f"to {rounded:.2g} m, while the tip moves {moved:.3g} m; start at angles of a few turns or less"
            )
        if self.suspicious and not self.confirmed:
            yield (
                f"doubtful: the energy error is {self._excused / self._exchanged:.2g} of the energy "
                f"exchanged; {'take a tenth of the tolerance' if self.run.controlled else 'halve the step'} and compare"
            )

    @property
    def suspicious(self) -> bool:
        """Whether the energy imbalance is notable, or so large that only the tolerance explains it."""
        least = DOUBT * balance.SHARE * self._exchanged
        return self._unbalanced > least or self._excused > least / DOUBT

    def _rounded_away(self) -> float:
        """Tip motion [m] that rounding of q + h q̇ in N fixed steps may lose: N h q̇, at most N ulp(q)/2.

        Nothing at the angles of a few turns, where that is what rounding leaves anyway.
        """
        if self.run.controlled:
            return 0.0
        record, run = self.record, self.run
        q, qd = (np.abs(part[: self.n_valid]).max(axis=0) for part in (record.q, record.qd))
        step, reach = float(np.minimum(run.step * qd, np.spacing(q) / 2).sum()), record.chain.reach
        return step * reach * self.n_valid * run.steps_per_sample if step * reach > rounding.of_reach(reach) else 0.0

    def _stop_at(self, rows: slice, bad: NDArray[np.bool_], failure: str) -> None:
        if bad.any() and rows.start + int(np.argmax(bad)) <= self.n_valid:
            self.n_valid, self.failure = rows.start + int(np.argmax(bad)), failure

    def _warn(self, key: str, row: int, text: str) -> None:
        if key not in self._warned:
            self._warned.add(key)
            self.warnings.append(f"t = {self.record.t[row]:.6g} s: {text}")
