"""Diagnose an engine that disagrees: compare what it has read, and check whether that explains all differences.

Largest stable step of the integrator that a file specifies, for a slightly bent arm without parallel axes.

Semi-implicit Euler, v' = v + h a(x, v), x' = x + h v', is stable for a mode λ² + d λ + ω² = 0 if

    h² ω² + 2 h d < 4        h < 4 / (d + √(d² + 4 ω²))

With implicit damping, v' = v + h (−ω² x − d v'), it is stable if h² ω² − 2 h d < 4, or h < (d + √(d² + 4 ω²)) / ω².
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, Diagnostic, EngineError, SingularMassError
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene
from flexlink.diagnosis.differences import Finding, Match, differences
from flexlink.diagnosis.mistakes import table
from flexlink.diagnosis.native import NativeEngine
from flexlink.diagnosis.quantities import QUANTITIES, Difference, State, compare_engines
from flexlink.dynamics.singularity import factored_mass
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.engines import ENGINES
from flexlink.engines.actuators import mark_unspecified, not_compared, taken_from_scene, with_drive
from flexlink.engines.base import Delegate, Engine, Samples
from flexlink.engines.child_process import FileEngine
from flexlink.engines.read_back import ACTUATOR_FIELDS, COUPLED_FIELDS, ReadBack, of_chain, to_chain

WITHOUT_WRENCH = {name: term for name, term in QUANTITIES.items() if "wrench" not in name}


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """Agreement and differences of one engine, and their causes."""

    engine: str
    rows: tuple[Difference, ...]  # compared quantities
    # in what the engine has read, largest effect first, lost digits last; of exports only if a quantity differs
    findings: tuple[Finding, ...] = ()
    explained: bool | None = None  # whether native dynamics with these numbers agree with the engine; None: unknown
    notes: tuple[Diagnostic, ...] = ()
    left_out: tuple[str, ...] = ()  # contents of the file that are not compared

    @property
    def passed(self) -> bool:
        """Whether no quantity differs, and no finding changes simulations."""
        return all(row.passed for row in self.rows) and not any(finding.counts for finding in self.findings)

    def __str__(self) -> str:
        bad, good = ([row.quantity for row in self.rows if row.passed is passed] for passed in (False, True))
        if bad:
            summary = f"{_verb(good or ['nothing'], 'agree')}, {_verb(bad, 'differ')}"
        else:
            summary = f"all {len(good)} quantities agree" if good else "nothing can be compared"
            summary += ", but a simulation of the file moves differently" if good and not self.passed else ""
        summary += f"; not compared: {', '.join(self.left_out)}" if self.left_out else ""
        findings = (f"{k}. {finding}" for k, finding in enumerate(self.findings, 1))
        return "\n  ".join([f"{self.engine}: {summary}", *findings, *self._conclusion(), *self.notes])

    def _conclusion(self) -> list[str]:
        bad = [row for row in self.rows if not row.passed]
        if not_finite := [row for row in bad if math.isnan(row.error)]:
            row = not_finite[0]
            return [f"{row.quantity}: the engine returns numbers that are not finite, first at joint {row.joint!r}"]
        if not bad or self.explained is None:
            return []
        if self.explained:
            these = "this" if sum(finding.counts for finding in self.findings) == 1 else "these"
            return [f"With {these} fixed the models agree; there is no other difference."]
        worst = max(bad, key=lambda row: row.error)
        subject = "These findings do" if self.findings else "What the engine has read does"
        cause = "" if self.findings else "the engine computes it differently, or "
        where = f"the largest is in {worst.quantity} at joint {worst.joint!r}"
        return [f"{subject} not explain all differences; {where}: {cause}an additional force acts on the arm"]


def _verb(names: Sequence[str], verb: str) -> str:
    return f"{', '.join(names)} {verb}{'s' if len(names) == 1 else ''}"


def diagnose(chain: Chain, engine: Engine, rows: Sequence[Difference], states: Sequence[State]) -> Diagnosis:
    """Diagnose an engine that has loaded flexlink's export, if it disagrees."""
    notes, of_arm = _by_us(chain, engine.name), [row for row in rows if row.quantity in QUANTITIES]
    if all(row.passed for row in of_arm):
        return Diagnosis(engine.name, tuple(rows), notes=notes)
    formats = {"pinocchio": "urdf", "exudyn": "urdf", "mujoco": "mjcf", "drake": "sdf"}
    match, findings = differences(of_chain(chain), engine.read_back(), formats.get(engine.name, engine.name))
    return dataclasses.replace(_explain(chain, engine, of_arm, findings, match, states), rows=tuple(rows), notes=notes)


def _by_us(chain: Chain, engine: str) -> tuple[Diagnostic, ...]:
    """Notes on parts of the arm that the engine does not compute itself."""
    if engine not in ENGINES or engine == "native":
        return ()
    computed = {
        "springs and dampers between two joints": len(chain.couplings) and not ENGINES[engine].between_joints,
        "what rotation-vector springs add to angle springs": chain.has_rotation_springs,
    }
    texts = (f"flexlink computes {what}, with the numbers of the file" for what, there in computed.items() if there)
    return tuple(Diagnostic(text, "computed-by-flexlink") for text in texts)


def diagnose_file(
    chain: Chain, loaded: tuple[str, FileEngine, tuple[str, ...]], states: Sequence[State],
    progress: Callable[[float], None] | None = None, *, scene: Scene | None = None,
) -> Diagnosis:  # fmt: skip
    """Diagnose an engine that has loaded a foreign file; its actuators are compared with the drive of the `scene`."""
    if chain.has_rotation_springs:
        why = f"{chain.name!r}: has springs of rotation vectors, which no other program supports"
        remedy = "compare the file with a scene whose lumping rule has springs = 'angles'"
        raise ArgumentError(f"{why}; {remedy}", id="rotation-springs-in-file")
    format, engine, stderr_errors = loaded
    ours, read = with_drive(of_chain(chain), scene, chain), mark_unspecified(_with_step(chain, engine.read_back()))
    errors = [Diagnostic(f"{engine.name} reports an error: {text}", "engine-error") for text in stderr_errors]
    match, findings = differences(ours, read, format)
    if match is None:
        return Diagnosis(engine.name, (), tuple(findings), notes=tuple(errors))
    engine.fill_missing(_missing(ours, read, match))
    matched, native, rows = Reordered(engine, match.order), NativeEngine(chain), tuple[Difference, ...]()
    try:
        rows = compare_engines(chain, native, [matched], states, quantities=WITHOUT_WRENCH, progress=progress)
        engine.neutralize_settings()  # settings are separate findings; after this only numbers may differ
    except (EngineError, SingularMassError) as error:  # for example, the only inertia of a joint is missing
        if not findings:
            raise
        errors.append(Diagnostic(f"the file cannot be evaluated: {error}", "not-evaluated"))
    diagnosis = _explain(chain, matched, rows, findings, match, states)
    actuators = not_compared(ours, read, match.order)
    left_out = ("actuators",) if actuators or "other actuators" in read.settings else ()
    notes = [*_by_us(chain, engine.name), *_notes(ours, match, read)]
    if actuators:
        text = f"not compared, because the scene has no drive: {actuators}"
        notes.append(Diagnostic(text, "actuators-not-compared"))
    return dataclasses.replace(diagnosis, notes=(*notes, *errors), left_out=left_out)


def _with_step(chain: Chain, read: ReadBack) -> ReadBack:
    """Add to the settings the integrator if it is not RK4, and the step if it is too large for this integrator."""
    settings = dict(read.settings)
    if read.integrator not in {"", "RK4"}:
        settings["integrator"] = read.integrator + ("" if read.integrator in LARGEST else " (stability not checked)")
    if read.step is not None and read.integrator in LARGEST:
        largest = LARGEST[read.integrator](chain)
        if read.step > largest:
            settings["step"] = f"{read.step:g} s > {largest:.3g} s ({read.integrator})"
    return dataclasses.replace(read, settings=settings)


def _missing(ours: ReadBack, read: ReadBack, match: Match) -> dict[str, Array]:
    """Our values of fields that the file does not specify, in the engine's order."""
    missing = read.unspecified.intersection(table().fields) - {*ACTUATOR_FIELDS}
    fields, inverse = {field: getattr(ours, field) for field in missing}, np.argsort(match.order)
    return {f: values if f == "gravity" else values[np.ix_(*[inverse] * values.ndim)] for f, values in fields.items()}


def _notes(ours: ReadBack, match: Match, read: ReadBack) -> list[Diagnostic]:
    by_order = Diagnostic("joint names differ; joints are matched by their order", "matched-by-order")
    by_body = Diagnostic("joint names differ; joints are matched by the bodies they move", "matched-by-body")
    notes = {"names": [], "bodies": [by_body], "order": [by_order]}[match.by]
    fields = (read.unspecified - set(ACTUATOR_FIELDS)) | taken_from_scene(ours, read)
    fields -= {field for field in COUPLED_FIELDS if not getattr(ours, field).any()}
    if labels := [words.label for field, words in table().fields.items() if field in fields]:
        notes.append(Diagnostic(f"not in the file, taken from the scene: {', '.join(labels)}", "taken-from-scene"))
    return notes


def _explain(
    chain: Chain, engine: Engine, rows: Sequence[Difference], findings: Sequence[Finding], match: Match | None,
    states: Sequence[State],
) -> Diagnosis:  # fmt: skip
    """Diagnosis with the quantities that each finding affects, and whether the findings explain all differences."""
    terms, some = {row.quantity: QUANTITIES[row.quantity] for row in rows} or WITHOUT_WRENCH, states[:20]
    tolerance = 10.0  # rounding bounds; more than one, because a record is rotated into frame 0 and back
    singular_mass = "q̈ (M is singular)"

    def differing(record: ReadBack, other: Engine) -> dict[str, float]:
        """Quantities that differ, with their error."""
        exact = to_chain(record, chain)
        native, singular = NativeEngine(exact), dict[str, float]()
        try:
            compared = compare_engines(exact, native, [other], some, quantities=terms)
        except SingularMassError:
            defined, singular = {name: terms[name] for name in terms if name != "q̈"}, {singular_mass: math.inf}
            compared = compare_engines(exact, native, [other], some, quantities=defined)
        return {row.quantity: row.error for row in compared if not row.error <= tolerance} | singular

    right, each = NativeEngine(to_chain(of_chain(chain), chain)), []
    for finding in findings:
        errors = {} if finding.faulty is None else differing(finding.faulty, right)
        effect = errors.get(singular_mass, errors.get("q̈", finding.effect))
        effect = math.inf if math.isnan(effect) else effect
        each.append(dataclasses.replace(finding, affects=tuple(errors), effect=effect))
    each.sort(key=lambda finding: (finding.id == "digits-lost", -finding.effect))
    explained, whole = None, match.whole if match is not None else None
    if whole is not None and not all(row.passed for row in rows):
        theirs, joints = whole
        explained = differing(theirs, Reordered(engine, joints)).keys() <= {singular_mass}
    return Diagnosis(engine.name, tuple(rows), tuple(each), explained)


class Reordered(Delegate):
    """An engine with reordered joints: joint k is joint `order[k]` of the original engine."""

    def __init__(self, engine: Engine, order: Indices) -> None:
        self.engine, self.order = engine, order
        self.name, self.version, self.n = engine.name, engine.version, engine.n

    def _evaluate(self, name: str, *arguments: Array, **named: Any) -> Array:
        """Convert arguments to the engine's order, and the result to our order."""
        inverse = np.argsort(self.order)
        values = getattr(self.engine, name)(*(x[inverse] for x in arguments), **named)
        return np.asarray(values[np.ix_(*[self.order] * values.ndim)])

    def integrate(self, scene: Scene) -> Samples:
        """Raise an error, because foreign files are not simulated."""
        why = f"{scene.name}: foreign files are compared at states, not in simulations"
        raise ArgumentError(why, id="file-not-simulated")

    def read_back(self) -> ReadBack:
        """Record of the arm in the engine's order."""
        return self.engine.read_back()


def _modes(chain: Chain) -> tuple[Array, Array]:
    """ω [rad/s] and d = φᵀ D φ [1/s] of the undamped modes φ; for an unstable mode, ω is its growth rate."""
    q = chain.slightly_bent
    M, K = factored_mass(chain, q, np.arange(chain.n))[0], stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    square, φ = scipy.linalg.eigh((K + K.T) / 2, M)
    return np.sqrt(np.abs(square)), np.einsum("im,im->m", φ, chain.times("damping", φ.T).T)


def _euler(chain: Chain) -> float:
    ω, d = _modes(chain)
    rate = d + np.sqrt(d**2 + 4 * ω**2)
    return float(4 / rate.max()) if rate.any() else np.inf


def _damped_implicitly(chain: Chain) -> float:
    ω, d = _modes(chain)
    ω, d = ω[ω > 0], d[ω > 0]
    return float(((d + np.sqrt(d**2 + 4 * ω**2)) / ω**2).min(initial=np.inf))


LARGEST: dict[str, Callable[[Chain], float]] = {
    "RK4": lambda chain: stable_step(chain, chain.slightly_bent, method="RK4"),
    "Euler": _damped_implicitly,
    "Euler without eulerdamp": _euler,
    "Implicit": _damped_implicitly,
    "Implicitfast": _damped_implicitly,
}
"""Function for the largest stable step of each `ReadBack.integrator`; other integrators are not checked."""
