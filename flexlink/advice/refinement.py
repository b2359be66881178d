"""Refinement study: extrapolate the tip's path to the limit of more and more hinges, and estimate the limit's error.

Measure axial loads and large bends of an arm; without these, rules with one spring per hinge have order 4.

    γ = max |F_x| L² / EI            axial load of a link in a run, due to weight, spin and tip wrench
    θ = |Σ θ_k|                      total bend of the link [rad]

Both reduce the order of these rules to 2, while cells stay at order 4. For the first frequency of a cantilever
with N hinges, the error is 5.2e-4 γ (8/N)² with gauss for γ up to 1, and 3.9e-5 (8/N)⁴ with lobatto. Beyond γ/N² = 100,
runs with cells are less accurate: the last segment, whose inertia is artificial (`Cells.tip`), follows too slowly.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.advice.goal import Goal, Thresholds, TipErrorNorm
from flexlink.advice.model import FAMILIES, FLEX, GAUSS, Axes, Model, limited_axes, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.chain.beams import table_of
from flexlink.chain.coordinates import Kind
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.results.convergence import Limit, change_of_limit, extrapolated
from flexlink.results.samples import picked
from flexlink.results.tip_motion import tip_travel
from flexlink.results.trajectory import Trajectory, deflections


class Level(NamedTuple):
    """A run with the same number of `hinges` in every link that bends."""

    hinges: int
    outcome: Outcome


class RefinementStudy:
    """Levels of a scene, refined until their limit is accurate enough."""

    def __init__(self, runner: ModelRunner, norm: TipErrorNorm, goal: Goal, axes: Axes, stepping: Stepping) -> None:
        self.runner, self.norm, self.goal, self.axes, self.stepping = runner, norm, goal, axes, stepping
        self.levels: dict[str, list[Level]] = {family: [] for family in FAMILIES}  # from coarse to fine
        self.family, self.reason = GAUSS, ""  # why the limit is less accurate than required
        self.limit: Limit | None = None  # the best estimate; None if fewer than two levels could be run
        self.tolerance = self.travel = self.deflection = 0.0  # of the tip at the finest level [m]
        self._limits: dict[str, list[Limit]] = {family: [] for family in FAMILIES}
        self._itself: dict[str, Array] = {}  # errors of the last level, estimated from its change (samples,)
        self._errors: list[float] = []

    def refine(self) -> None:
        """Run levels until the error of the limit is a tenth of the tolerance, or more hinges do not help."""
        for hinges in (1, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128):
            finest = self.levels[self.family][-1].hinges if self.levels[self.family] else 0
            if hinges <= finest or FAMILIES[self.family].rounded_up(hinges) != hinges:  # known, or not offered
                continue
            if self._beyond_budget(hinges):
                break
            taken = self._take(hinges, self.family)
            if taken.over_budget:
                break
            if self.limit is None or not taken.completed:
                continue
            if self.limit.error <= 0.1 * self.tolerance:
                return
            self._compare_rules(hinges)
            if self.limit.error <= 0.1 * self.tolerance:
                return
            self._errors.append(self.limit.error)
            if hinges >= 32 and self.limit.error > max(self.tolerance, self._errors[-4] * 2 / 3):
                self.reason = f"more than {hinges} hinges do not reduce the error"
                break

    @property
    def finest(self) -> Level:
        """The finest level."""
        return self.levels[self.family][-1]

    @property
    def model(self) -> Model:
        """The model of the finest level."""
        return uniform(self.axes, self.finest.hinges, self.family)

    def models(self) -> dict[Model, Outcome]:
        """Outcomes of all levels, by their models."""
        every = [(family, *level) for family, levels in self.levels.items() for level in levels]
        return {uniform(self.axes, hinges, family): outcome for family, hinges, outcome in every}

    def remove_step_errors(self) -> Array:
        """Remove the levels' step errors from the limit; return the remaining step errors up to each sample [m].

        Step errors are measured by runs with a tenth of the tolerance, at the two levels that determine the limit.
        """
        assert self.limit is not None
        tip, left = self.limit.tip, np.zeros(len(self.limit.tip))
        for weight, level in zip(self.limit.weights, self.levels[self.family][-2:], strict=True):
            change = weight * self._step_errors(level) if weight else np.zeros_like(tip)
            tip = tip + change
            left = left + self.norm.up_to(change) * Thresholds.strict**0.5  # upper bound for any order of the steps
        if not np.isfinite(left[-1]):  # take the finest level that stricter steps can run
            for level in self.levels[self.family][-2::-1]:
                errors = self.norm.up_to(self._step_errors(level))
                if np.isfinite(errors[-1]):
                    return Thresholds.scatter * errors
            return np.full(len(self.finest.outcome.tip), np.inf)
        self.limit = self.limit._replace(tip=tip)
        return left

    def _step_errors(self, level: Level) -> Array:
        """Change of a level's tip path by stricter steps (samples, 3) [m]; nan where the stricter run fails."""
        assert self.stepping.tolerance is not None
        strict = self.stepping._replace(tolerance=Thresholds.strict * self.stepping.tolerance)
        return self.runner.run(uniform(self.axes, level.hinges, self.family), strict).tip - level.outcome.tip

    def _beyond_budget(self, hinges: int) -> bool:
        levels = self.levels[self.family]
        if len(levels) < 2:  # an error estimate needs two levels
            return False
        models = (uniform(self.axes, n, self.family) for n in (levels[-1].hinges, hinges))
        before, price = (self.runner.evaluation_cost(model, explicit=False) for model in models)
        if levels[-1].outcome.seconds * price / before <= self.runner.budget:
            return False
        self.reason = f"a run with {hinges} hinges per link would take more than {self.runner.budget:g} s"
        return True

    def _take(self, hinges: int, family: str) -> Outcome:
        outcome = self.runner.run(uniform(self.axes, hinges, family), self.stepping)
        if not outcome.completed or outcome.run is None:
            self.reason = outcome.reason
            return outcome
        self.reason = ""
        self.levels[family].append(Level(hinges, outcome))
        self.travel, self.deflection = tip_travel(outcome.tip), float(deflections(outcome.run).max())
        self.tolerance = self.goal.tolerance(self.travel, self.deflection)
        if len(self.levels[family]) > 1:
            self.limit = self._estimate(family)
        return outcome

    def _estimate(self, family: str) -> Limit:
        """The finest level or the extrapolated limit, whichever is known more accurately."""
        levels, limits = [(n, run.tip) for n, run in self.levels[family][-3:]], self._limits[family]
        (Na, a), (Nb, b) = levels[-2:]
        order, safe = self._order(family, levels), FAMILIES[family].safe
        safe = 1.0 if self.runner.scene.ties else safe  # ties act between hinges: errors of tied arms fall irregularly
        limit = extrapolated(levels, order)
        # measured on 22 scenes: the error of a level is at most 1.4 times its distance from the limit
        itself = 1.4 * self.norm.up_to(limit.tip - b) if Nb >= FAMILIES[family].asymptotic else self.norm.up_to(b - a)
        if limits:
            errors = self.norm.up_to(change_of_limit(levels, order)) / safe
            if len(limits) > 1:
                errors = np.maximum(errors, limits[-1].errors * (Na / Nb) ** (order + Thresholds.limit_fall))
            limit = limit._replace(errors=errors)
            if Na >= 4:
                itself = np.maximum(itself, self._itself[family] * (Na / Nb) ** (order + Thresholds.limit_fall / 2))
        limits.append(limit)
        self._itself[family] = itself
        # the fewest samples beyond the tolerance, then the smallest error at the end
        return min(limit, Limit(b, itself), key=lambda one: (int((one.errors > self.tolerance).sum()), one.error))

    def _order(self, family: str, levels: Sequence[tuple[int, Array]]) -> float:
        """Order of the errors that fits the changes between three levels; with two levels, the family's higher order.

        In large bending in space, the angles of three successive hinges of a cell are Euler angles, and cells have
        order 2 only.
        """
        high, low = FAMILIES[family].order, FAMILIES[family].order_in_space
        if len(levels) < 3:
            return high
        (Na, a), (Nb, b), (Nc, c) = levels
        ratios = [(Na**-p - Nb**-p) / (Nb**-p - Nc**-p) for p in (low, high)]
        return high if self.norm(b - a) >= math.sqrt(math.prod(ratios)) * self.norm(c - b) else low

    def _compare_rules(self, hinges: int) -> None:
        """Switch to another family if a similar number of hinges then gives less than half the error.

        Cells are tried as soon as axial loads or large bends reduce the order of gauss to 2. Gauss-Legendre points over
        the full link are tried once.
        """
        last = self.levels[self.family][-1].outcome.run
        asymptotic = FAMILIES[self.family].asymptotic
        if hinges < asymptotic or last is None:
            return
        arm = self.runner.scene.arm
        beams = [table_of(arm, link) for link in arm.links]  # cells neither shear nor stretch, and need centred mass
        apt = not any(link.strains for link in arm.links) and not any(beam and beam.off_axis for beam in beams)
        tries = apt and not self.levels["lobatto"] and may_pay(arm, last, hinges)
        if not (tries and self._is_better("lobatto", (4, 8, 12))) and hinges == asymptotic:
            self._is_better("legendre", (4, asymptotic))

    def _is_better(self, family: str, counts: Sequence[int]) -> bool:
        """Whether levels of another family halve the error of the limit; if so, the study switches to that family."""
        assert self.limit is not None
        before = self.limit
        for hinges in counts:
            self._take(hinges, family)
        if len(self.levels[family]) == len(counts) and self.limit.error < before.error / 2:
            self.family = family
            return True
        self.limit, self.reason = before, ""
        return False


class AxisScreening:
    """Remaining `axes` of each link, without axes that hardly change the tip's path; one line per trial in `trials`."""

    def __init__(
        self, runner: ModelRunner, norm: TipErrorNorm, axes: Axes, stepping: Stepping, tolerance: float
    ) -> None:
        self.runner, self.norm, self.stepping = runner, norm, stepping
        self.allowed = Thresholds.allowed_share * tolerance
        self.axes, self.trials = axes, list[str]()
        self.tip = runner.run(uniform(axes, Thresholds.screening_hinges), stepping).tip
        self.left_out = np.zeros_like(self.tip)  # change of the path by omitting all these axes, (samples, 3) [m]
        if self._try("all: flex z only", limited_axes(axes, "z")):
            return
        if self.axes.count("rigid") < len(self.axes) - 1:
            self._try("all: flex yz only", limited_axes(self.axes, "yz"))
        for k, link in enumerate(self.runner.scene.arm.links):
            while self.axes[k] in FLEX[2:]:
                flex, less = self.axes[k], FLEX[FLEX.index(self.axes[k]) - 1]
                if not self._try(f"{link.name}: flex {flex} to {less}", (*self.axes[:k], less, *self.axes[k + 1 :])):
                    break

    def _try(self, name: str, axes: Axes) -> bool:
        """Adopt these axes if they change the tip's path by no more than allowed; return whether they do."""
        if axes == self.axes:
            return True
        tip = self.runner.run(uniform(axes, Thresholds.screening_hinges), self.stepping).tip
        without = self.left_out + tip - self.tip
        kept = self.norm(without) > self.allowed
        verdict = "too much" if kept else "accepted"
        self.trials.append(f"{name}: tip changes by {self.norm(tip - self.tip):.1e} m, {verdict}")
        if not kept:
            self.axes, self.tip, self.left_out = axes, tip, without
        return not kept


def may_pay(arm: Arm, run: Trajectory, hinges: int) -> bool:
    """Whether cells may be cheaper than hinges with one spring each, judged by a run with `hinges` such hinges."""
    # Cells may be cheaper if (γ + 2 θ) N² exceeds this value, at which the errors of gauss and lobatto (see above) are
    # about equal. The validation case advice_axial checks this value. Runs of a hanging hose with gauss and lobatto2
    # have equal errors at γ/N² = 120.
    γ, both = load_and_bend(arm, run)
    return γ < 100.0 * hinges**2 and both * hinges**2 > 5.0


def load_and_bend(arm: Arm, run: Trajectory) -> tuple[float, float]:
    """Largest γ, and largest γ + 2 θ, of any link during a run."""
    chain, few = run.chain, picked(run, np.unique(np.linspace(0, len(run.t) - 1, 40).astype(int)))  # at most 40 samples
    force = np.abs(few.loads.N)
    found = [(0.0, 0.0)]
    for number, link in enumerate(arm.links, 1):
        if hinges := chain.where(Kind.HINGE, link=number).tolist():
            axes = np.array([chain.coordinates[k].axis for k in hinges])
            θ = np.hypot(*(few.q[:, np.array(hinges)[axes == axis]].sum(axis=1) for axis in (2, 3)))  # about y and z
            γ = force[:, [chain.body(k) for k in hinges]].max(axis=1) * link.beam.length**2 / _least_rigidity(arm, link)
            found.append((float(γ.max()), float((γ + 2 * θ).max())))
    γ, both = map(max, zip(*found, strict=True))
    return γ, both


def _least_rigidity(arm: Arm, link: Link) -> float:
    """The smallest EI of a link [N m²]."""
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity].of_flex(link.flex, ())
        if table.coupled:
            return float(1 / np.linalg.eigvalsh(np.linalg.inv(table.rows.stiffness)[:, :3, :3]).max())
        return table.stiffness_factor * min(min(column) for column in (table.ei_y, table.ei_z) if column is not None)
    ends = [arm.sections[name].properties[1:3] for name in (link.section, link.section_tip) if name]
    return arm.materials[link.material or ""].young * min(min(end) for end in ends)


def horizon(refinement: RefinementStudy, norm: TipErrorNorm, known: Array) -> float:
    """Time [s] up to which the finest level is within the tolerance; `known`: error of the limit (samples,) [m]."""
    assert refinement.limit is not None
    finest = refinement.finest.outcome
    assert finest.run is not None
    beyond = np.flatnonzero(norm.up_to(finest.tip - refinement.limit.tip) + known > refinement.tolerance)
    times = finest.run.t
    return float(times[-1] if not beyond.size else times[max(0, beyond[0] - 1)])


def error_growth(runner: ModelRunner, refinement: RefinementStudy, tolerance: float) -> tuple[float, float]:
    """Growth factor and e-folding time [s] of an error in the initial angles, for the finest level.

    The factor is taken at the end of the run, or when the error becomes too large to be proportional to the initial
    error. The e-folding time refers to the second half of this interval; it is inf if the error does not grow.
    """
    outcome, size = refinement.finest.outcome, runner.chain(refinement.model).size
    angle = min(Thresholds.perturbation * (outcome.stepping.tolerance or 0.0), tolerance) / size
    perturbed = runner.perturbed_run(refinement.model, outcome.stepping, angle)
    if perturbed is None or outcome.run is None:
        return 1.0, np.inf
    apart = np.linalg.norm(perturbed.tip - outcome.tip, axis=1)
    beyond = np.flatnonzero(~(apart <= Thresholds.proportional * refinement.travel))
    apart = apart[: beyond[0]] if beyond.size else apart
    grown = np.maximum.accumulate(apart) / (angle * size)
    factor = float(grown.max(initial=1.0))
    half = len(grown) // 2
    if factor < Thresholds.sensitive_growth or len(grown) - half < 3:
        return factor, np.inf
    rate = np.polyfit(outcome.run.t[half : len(grown)], np.log(np.maximum(grown[half:], np.finfo(float).tiny)), 1)[0]
    return factor, float(1 / rate) if rate > 0 else np.inf
