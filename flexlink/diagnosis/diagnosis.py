"""Why an engine does not agree: what it has read beside what it should have, and whether that explains all of it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import EngineError, SingularMassError
from flexlink.describe.scene import Scene
from flexlink.diagnosis.differences import Finding, differences
from flexlink.diagnosis.foreign_files import Loaded
from flexlink.diagnosis.matching import Match
from flexlink.diagnosis.mistakes import FIELDS
from flexlink.diagnosis.native import NativeEngine
from flexlink.diagnosis.quantities import QUANTITIES, Difference, compare_engines
from flexlink.diagnosis.reordered import Reordered
from flexlink.diagnosis.stable_steps import LARGEST
from flexlink.diagnosis.states import State
from flexlink.engines.actuators import not_compared, said, taken_from_scene, with_drive
from flexlink.engines.base import Array, Engine, Reader
from flexlink.engines.read_back import ACTUATORS, ReadBack, of_chain, to_chain

FORMS = {"pinocchio": "urdf", "exudyn": "urdf", "mujoco": "mjcf", "drake": "sdf"}
"""What engines read of our own."""
WITHOUT_WRENCH = tuple(name for name in QUANTITIES if "wrench" not in name)
SINGULAR = ("M, which is singular",)
NO_DRIVE = "not compared, for the scene has no drive: "
LOOKED_AT = 20  # states at which causes are tried
AGAIN = 10.0
"""Units of rounding that a chain may differ by after its record was turned into frame 0 and back."""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """Of one engine what agrees, what differs, and why.

    Attributes
    ----------
    engine
        Its name.
    rows
        Its quantities, compared.
    findings
        What was read otherwise than it should have been; nothing is looked for where all agrees, but in files.
    explained
        Whether the native dynamics of what was read are those of the engine; None if that was not asked.
    notes
        What else is to be known.
    left_out
        What there is in the file and is not compared.
    """

    engine: str
    rows: tuple[Difference, ...]
    findings: tuple[Finding, ...] = ()
    explained: bool | None = None
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """No difference that counts."""
        return all(row.passed for row in self.rows) and not any(finding.counts for finding in self.findings)

    def __str__(self) -> str:
        bad, good = ([row.quantity for row in self.rows if row.passed is passed] for passed in (False, True))
        if not bad:
            agree = f"all {len(good)} quantities agree" if good else "nothing can be compared"
            agree += ", but runs of the file differ" if good and not self.passed else ""
        else:
            agree = f"{_verb(good or ['nothing'], 'agree')}, {_verb(bad, 'differ')}"
        agree += f"; not compared: {', '.join(self.left_out)}" if self.left_out else ""
        numbered = (f"  {k}. {finding}" for k, finding in enumerate(self.findings, 1))
        return "\n".join([f"{self.engine}: {agree}", *numbered, *(f"  {line}" for line in (*self._why(), *self.notes))])

    def _why(self) -> list[str]:
        bad = [row for row in self.rows if not row.passed]
        if any(math.isnan(row.error) for row in bad):
            row = next(row for row in bad if math.isnan(row.error))
            return [f"of {row.quantity} the engine returns numbers that are not finite, first at joint {row.joint!r}"]
        if not bad or self.explained is None:
            return []
        if self.explained:
            these = "this" if sum(finding.counts for finding in self.findings) == 1 else "these"
            return [f"With {these} fixed the models agree; there is no other difference."]
        worst = max(bad, key=lambda row: row.error)
        cause = (
            "something acts beside it" if self.findings else "the engine computes it otherwise, or something else acts"
        )
        return [f"what was read does not explain all of it, most at joint {worst.joint!r} in {worst.quantity}: {cause}"]


def _verb(names: Sequence[str], verb: str) -> str:
    return f"{', '.join(names)} {verb}{'s' if len(names) == 1 else ''}"


def diagnose(chain: Chain, engine: Engine, rows: Sequence[Difference], states: Sequence[State]) -> Diagnosis:
    """Of an engine with our own file: looked into where it does not agree, as far as it can tell what it has read."""
    if all(row.passed for row in rows) or not isinstance(engine, Reader):
        return Diagnosis(engine.name, tuple(rows))
    read = engine.read_back()
    match, findings = differences(of_chain(chain), read, FORMS.get(engine.name, engine.name))
    return _looked_into(chain, engine, rows, findings, match, states)


def diagnose_file(
    chain: Chain,
    loaded: Loaded,
    states: Sequence[State],
    progress: Callable[[float], None] | None = None,
    *,
    scene: Scene | None = None,
) -> Diagnosis:
    """Of an engine with a file of somebody else's: its quantities, and what it has read, all agreeing or not.

    The file's actuators are compared with the drive of the `scene`; without one, as with a scene without a drive.
    """
    form, engine, complaints = loaded
    ours, read = with_drive(of_chain(chain), scene, chain), said(_with_step(chain, engine.read_back()))
    told = tuple(f"{engine.name} complains: {text}" for text in complaints)
    match, findings = differences(ours, read, form)
    if match is None:
        return Diagnosis(engine.name, (), tuple(findings), notes=told)
    engine.adopt(_missing(ours, read, match))
    matched = Reordered(engine, match.order)
    native, rows = NativeEngine(chain), tuple[Difference, ...]()
    try:
        rows = compare_engines(chain, native, [matched], states, quantities=WITHOUT_WRENCH, progress=progress)
        engine.put_right()  # whether settings, too, explain what differs
    except (
        EngineError,
        SingularMassError,
    ) as error:  # a mistake may leave nothing to evaluate, such as a joint's rotor
        if not findings:
            raise
        told += (f"it cannot be evaluated: {error}",)
    found = _looked_into(chain, matched, rows, findings, match, states)
    beside = not_compared(ours, read, match.order)
    left_out = ("actuators",) if beside or "other actuators" in read.settings else ()
    notes = (*_notes(ours, match, read), *([NO_DRIVE + beside] if beside else []), *told)
    return dataclasses.replace(found, notes=notes, left_out=left_out)


def _with_step(chain: Chain, read: ReadBack) -> ReadBack:
    """Integrator and step of the file as settings: another one than RK4, and a step beyond its largest stable one."""
    settings = dict(read.settings)
    if read.integrator not in {"", "RK4"}:
        settings["integrator"] = read.integrator + ("" if read.integrator in LARGEST else " (not judged)")
    if read.step is not None and read.integrator in LARGEST:
        largest = LARGEST[read.integrator](chain)
        if read.step > largest:
            settings["step"] = f"{read.step:g} s, of {read.integrator} {largest:.3g} s"
    return dataclasses.replace(read, settings=settings)


def _missing(ours: ReadBack, read: ReadBack, match: Match) -> dict[str, Array]:
    """What the file does not say, from ours, in the engine's order."""
    fields = {field: getattr(ours, field) for field in FIELDS if field in read.unsaid and field not in ACTUATORS}
    return {f: values if f == "gravity" else values[np.argsort(match.order)] for f, values in fields.items()}


def _notes(ours: ReadBack, match: Match, read: ReadBack) -> list[str]:
    notes = [] if match.by_name else ["joints are matched by their order: their names differ"]
    taken = (read.unsaid - set(ACTUATORS)) | taken_from_scene(ours, read)
    unsaid = [FIELDS[field].label for field in FIELDS if field in taken]
    if unsaid:
        notes.append(f"not in the file, and taken from the scene: {', '.join(unsaid)}")
    return notes


def _looked_into(
    chain: Chain,
    engine: Engine,
    rows: Sequence[Difference],
    findings: Sequence[Finding],
    match: Match | None,
    states: Sequence[State],
) -> Diagnosis:
    names, some = [row.quantity for row in rows] or WITHOUT_WRENCH, states[:LOOKED_AT]

    def differ(one: ReadBack, other: Engine) -> tuple[str, ...]:
        """Quantities that differ; where M is singular, q̈ is not defined, and that is told by itself."""
        exact = to_chain(one, chain)
        native, beside = NativeEngine(exact), tuple[str, ...]()
        try:
            compared = compare_engines(exact, native, [other], some, quantities=names)
        except SingularMassError:
            defined = [name for name in names if name != "q̈"]
            compared, beside = compare_engines(exact, native, [other], some, quantities=defined), SINGULAR
        return (*(row.quantity for row in compared if not row.error <= AGAIN), *beside)

    right = NativeEngine(to_chain(of_chain(chain), chain))
    each = [f if f.made is None else dataclasses.replace(f, alone=differ(f.made, right)) for f in findings]
    explained, serial = None, match.serial if match is not None else None
    if serial is not None and not all(row.passed for row in rows):
        theirs, joints = serial
        explained = set(differ(theirs, Reordered(engine, joints))) <= set(SINGULAR)
    return Diagnosis(engine.name, tuple(rows), tuple(each), explained)
