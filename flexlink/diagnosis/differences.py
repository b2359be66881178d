"""Differences between two records of an arm in joints, axes, numbers and settings, each with the likely mistake."""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array, Indices, Mask
from flexlink.diagnosis.joint_axes import Displacement, deviations, displaced_joints, reach, turning, undo_displacements
from flexlink.diagnosis.mistakes import Field, _names, _short, _where, table
from flexlink.diagnosis.patterns import Discrepancy, any_difference, fewer_digits
from flexlink.engines.actuators import limits
from flexlink.engines.coordinates import BASE_JOINTS
from flexlink.engines.read_back import ACTUATOR_FIELDS, AXIS_FIELDS, BODY_FIELDS, COUPLED_FIELDS, JOINT_FIELDS, ReadBack
from flexlink.formats.mjcf import levers_of

EXACT = 1e-12  # relative tolerance for copied numbers
PLACED = 1e-11  # relative tolerance for numbers that are rotated into frame 0 joint by joint


class Match(NamedTuple):
    """The joints of another record (`theirs`), matched to our joints.

    `record` is the other record with our names and order, and with our values of unspecified fields. Its body k is the
    k-th body along the other chain, so the order of joints at the same point does not matter.
    """

    order: Indices  # for each of our joints, its index in the other record
    positions: Indices | None  # of our joints along the other chain, from 0; None if joints have different parents
    record: ReadBack
    by: str  # what is equal: "names" of the joints, "bodies" (names of joints or of the bodies they move), or "order"
    reordered: list[str]  # names of joints that have another position, or another parent, in the other record

    @property
    def whole(self) -> tuple[ReadBack, Indices] | None:
        """The other record, in its order from the base, and our index of each joint; None if parents differ."""
        if self.positions is None:
            return None
        joints = np.argsort(self.positions)
        return self.record.in_order(joints, np.arange(len(joints)), parents=self.record.parents), joints


@dataclasses.dataclass(frozen=True)
class Finding:
    """A difference in what an engine has read, with the mistake that explains it."""

    what: str  # field, joints, number in the file and expected number; for a setting, its value
    likely: str  # the likely mistake
    remedy: str
    id: str  # stable id of the kind of difference, for example "mass-differs"
    # flexlink's record with this mistake; None if records do not contain what differs
    faulty: ReadBack | None = dataclasses.field(default=None, repr=False, compare=False)
    counts: bool = True  # whether the difference changes simulations; otherwise it is only a note
    affects: tuple[str, ...] = ()  # quantities of the equation of motion that change if only this mistake is made
    # largest error of q̈ by this mistake alone, relative to the rounding bound; infinite if no joint is comparable
    effect: float = dataclasses.field(default=0.0, repr=False, compare=False)

    @property
    def diagnostic(self) -> Diagnostic:
        """The finding as text with its id, like errors and warnings."""
        return Diagnostic(str(self), self.id)

    def __str__(self) -> str:
        likely = f": {self.likely}" if self.likely else ""
        affects = f"; affects {', '.join(self.affects)}" if self.affects else ""
        return f"{self.what}{likely}{affects}; {self.remedy}"


def differences(ours: ReadBack, theirs: ReadBack, format: str) -> tuple[Match | None, list[Finding]]:
    """Match the joints (None if impossible) and list the differences, in the words of a `format` of `FORMATS`."""
    match = match_joints(ours, theirs)
    if not isinstance(match, Match):
        what, remedy = match
        return None, [Finding(what, "", remedy, "joints-differ")]
    if match.reordered and not np.array_equal(ours.parents, np.arange(ours.n) - 1):
        what, likely = f"{_names(match.reordered)} with another parent", "a branch begins at another joint"
        remedy = "correct the parents; numbers are compared after that"
        findings = [Finding(what, likely, remedy, "parents-differ", effect=np.inf)]
    else:
        numbers = _numbers_of_tendons(ours, match.record) if format == "mjcf" else _numbers(ours, match.record, format)
        findings = list(numbers)
        if match.reordered:
            what = f"{_names(match.reordered)} in another order along the chain"
            likely = "rotations about one point do not commute"
            remedy = "correct the order of joints in a body, or of links"
            findings.insert(0, Finding(what, likely, remedy, "joint-order-differs", effect=np.inf))
    settings = [
        Finding(what.format(value=theirs.settings[name]), "", remedy, id, counts=counts)
        for name, (id, what, remedy, counts) in table().settings.items()
        if name in theirs.settings and name not in theirs.unspecified
    ]
    return match, [*findings, *settings]


def _numbers_of_tendons(ours: ReadBack, theirs: ReadBack) -> list[Finding]:
    """`_numbers` for MJCF, where the stiffness of a joint is K_ii − Σ_j |K_ij|, with K_ij from its tendons."""
    fields = COUPLED_FIELDS.values()
    pairs = {field: (getattr(ours, field), getattr(theirs, field)) for field in fields}
    other = {field: np.abs(b - a) > EXACT * np.maximum(np.abs(a), np.abs(b)) for field, (a, b) in pairs.items()}

    def shifted(read: ReadBack, sign: int) -> ReadBack:
        """Remove the tendons' contribution to the joint stiffness and damping (−1), or add it (1)."""
        parts = {field: getattr(read, field) + sign * other[field] * _shared(read, field) for field in fields}
        return dataclasses.replace(read, **parts)

    findings = _numbers(shifted(ours, -1), shifted(theirs, -1), "mjcf")
    return [f if f.faulty is None else dataclasses.replace(f, faulty=shifted(f.faulty, 1)) for f in findings]


def _shared(read: ReadBack, field: str) -> Array:
    """Σ_j |K_ij|/c_ij, or Σ_j |D_ij|/c_ij, for each joint i, shape (n,)."""
    coupled = next(name for name, own in COUPLED_FIELDS.items() if own == field)
    slides, across = read.slides, np.abs(read.axes @ read.axes.T) < 0.5  # about two axes of a section
    levers = levers_of(read.stiffness[:, None], read.stiffness, across | (slides != slides[:, None]))
    return np.asarray((np.abs(getattr(read, coupled)) / levers).sum(axis=1))


def _numbers(ours: ReadBack, theirs: ReadBack, format: str) -> list[Finding]:
    """One finding per cause of different numbers: displaced axes, then fields, then digits lost in the file."""
    units, everything = tuple(table().length_units), _differing(ours, theirs)
    realigned, displacements, displaced = undo_displacements(ours, theirs, PLACED, units)
    fields, rounded = _differing(ours, realigned), list[Finding]()
    several = len(displacements) + len(fields) > 1
    if several and all(fewer_digits(diff) for diff in everything.values()):
        return [_fewer_digits(everything, theirs)]
    if several and (lost := lost_digits(everything)):  # corrected first, so that only larger mistakes remain to explain
        theirs, faulty = with_entries(theirs, ours, lost), with_entries(ours, theirs, lost)
        realigned, displacements, displaced = undo_displacements(ours, theirs, LOST, units)
        more = lost_digits(_differing(ours, realigned))  # hidden before by the displaced axes
        rounded = [_fewer_digits(lost | more, with_entries(faulty, realigned, more))]
        fields = _differing(ours, with_entries(realigned, ours, more))
    findings = [*_displacements(realigned, displacements, displaced, theirs, format)]
    findings += [_explained(field, diff, format) for field, diff in fields.items()]
    same_cause = itertools.groupby(findings, key=lambda finding: (finding.likely, finding.remedy))
    return [*(_joined(ours, list(group)) for _, group in same_cause), *rounded]


def _fewer_digits(differing: Mapping[str, Discrepancy], faulty: ReadBack) -> Finding:
    labels = ", ".join(words.label for field, words in table().fields.items() if field in differing)
    digits = -np.log10(max(diff.relative_error for diff in differing.values()))
    what, likely = f"{labels}: correct to only about {digits:.0f} digits", "digits were lost in writing"
    return Finding(what, likely, "write numbers with all 17 digits (repr, %.17g)", "digits-lost", faulty=faulty)


def _joined(ours: ReadBack, group: list[Finding]) -> Finding:
    """Join findings with the same cause to one finding, whose faulty record has the mistakes of all of them."""
    names = [field.name for field in dataclasses.fields(ReadBack)]
    fields: dict[str, Any] = {}
    for record in (finding.faulty for finding in reversed(group) if finding.faulty is not None):
        fields |= {name: value for name in names if (value := getattr(record, name)) is not getattr(ours, name)}
    what = "; ".join(finding.what for finding in group)
    return dataclasses.replace(group[0], what=what, faulty=dataclasses.replace(ours, **fields))


def _displacements(
    realigned: ReadBack, displacements: list[Displacement], displaced: ReadBack, theirs: ReadBack, format: str
) -> Iterator[Finding]:
    """Yield one finding per kind of displaced axes."""
    L, shown = reach(realigned), 3
    zero = next(row for row in table().mistakes if row.setting == "ref")
    ref = "joint-zero-differs", table().fields["lines"], zero.likely, zero.remedy
    for kind, words in table().misplaced.items():
        if not (found := [each for each in displacements if _kind(each, L) == kind]):
            continue
        joints = [theirs.names[each.joint] for each in found]
        joint_words = [f"joint {name!r} {_displaced(each, L)}" for name, each in zip(joints, found, strict=True)]
        what = f"{', '.join(joint_words[:shown])}{' …' * (len(joint_words) > shown)}"
        what += ", but not its body" if kind == "position" else ""
        what += ", with all links after it" if found[-1].axes is None else ""
        what += "" if found[-1].rigid else ", and with further displacements, which are not analysed"
        yield _worded(ref if "ref" in theirs.settings else words, what, _names(joints), format, displaced)


def _kind(displacement: Displacement, L: float) -> str:
    """Kind of a displacement: a key of `Table.misplaced`."""
    if displacement.axes is not None:
        return "position" if displacement.offset > PLACED * L else "axis"
    if displacement.unit_factor is not None:
        return table().length_units[displacement.unit_factor]
    return "far" if displacement.offset > 3 * L else "frame"  # a wrong sign or rotation displaces by up to 2 L


def _displaced(displacement: Displacement, L: float) -> str:
    if displacement.axes is not None and displacement.angle > PLACED:
        one, other = (_short(np.where(np.abs(axis) < EXACT, 0, axis)) for axis in displacement.axes)
        return f"rotates about {one} instead of {other}"
    if displacement.unit_factor is not None:
        times, offset = displacement.unit_factor, displacement.offset
        return f"is {times:g} times as far from the previous joint: displaced by {offset:.4g} m"
    turned = [f"rotated by {np.degrees(displacement.angle):.4g}°"] if displacement.angle > PLACED else []
    offset_words = [f"displaced by {displacement.offset:.4g} m"] if displacement.offset > PLACED * L else []
    return " and ".join([*turned, *offset_words])


def _differing(ours: ReadBack, theirs: ReadBack) -> dict[str, Discrepancy]:
    """Fields that differ, with the entries that differ."""
    # joints i < j, shape (m, 2), with a spring or damper between them in one of the records, by field
    found = {f: np.argwhere(np.triu((getattr(ours, f) != 0) | (getattr(theirs, f) != 0), 1)) for f in COUPLED_FIELDS}
    between = {field: rows for field, rows in found.items() if len(rows)}
    alone = [field for field in table().fields if field not in COUPLED_FIELDS]
    pairs = {field: (_values(ours, field, ours), _values(theirs, field, ours)) for field in alone}
    pairs |= {f: (getattr(ours, f)[*rows.T], getattr(theirs, f)[*rows.T]) for f, rows in between.items()}
    apart = {field: _norm(b - a) for field, (a, b) in pairs.items() if field != "effort"}
    L, (sin, off) = reach(ours), deviations(ours, theirs)
    m, lever = ours.masses, _norm(ours.centers - ours.points)
    other_mass = apart["masses"] > LOST * np.maximum(m, theirs.masses)
    same_mass = ~other_mass & (m > 0)  # a different mass explains a different centre and inertia
    copied = ("gravity", "slides", *JOINT_FIELDS, *between, *ACTUATOR_FIELDS[:-1])
    bad = {field: apart[field] > EXACT * np.maximum(*map(_norm, pairs[field])) for field in copied}
    for field in COUPLED_FIELDS.values():  # tendons may have absorbed part of these numbers
        bad[field] &= apart[field] > EXACT * _shared(ours, field)
    bad |= {
        "axes": (sin <= PLACED) & (np.einsum("ij,ij->i", ours.axes, theirs.axes) < 0),
        "lines": (sin > PLACED) | (off > PLACED * L),
        "tip": apart["tip"] > PLACED * L,
        "masses": apart["masses"] > EXACT * np.maximum(m, theirs.masses),
        "centers": same_mass & (apart["centers"] > PLACED * L),
        "inertias": ~other_mass & (apart["inertias"] > PLACED * _norm(ours.inertias) + EXACT * m * lever**2),
    }
    bad["inertias"] &= turning(ours)
    drive_range = np.zeros((ours.n, 2)) if ours.drive_range is None else ours.drive_range
    one, other = (np.clip(drive_range, read.effort[:, :1], read.effort[:, 1:]) for read in (ours, theirs))
    bad["effort"] = np.any(~np.isclose(one, other, rtol=EXACT, atol=0), axis=1)
    if theirs.gear[ours.gear != 0].all():
        bad["gear"] &= ours.gear != 0  # an additional motor does nothing without a command
    for read in (ours, theirs):
        bad["rest"] &= (read.stiffness != 0) | (_shared(read, "stiffness") != 0)
    bad["coulomb_width"] &= (ours.coulomb != 0) & (theirs.coulomb != 0)
    return {
        field: Discrepancy(a[mask], b[mask], between.get(field, np.arange(len(mask)))[mask], ours, theirs)
        for field, (a, b) in ((field, pairs[field]) for field in table().fields if field in pairs)
        if (mask := bad[field]).any()
    }


def _values(read: ReadBack, field: str, ours: ReadBack) -> Array:
    """Numbers of a field, one row per joint; for joint axes, direction with our sign, and point nearest to ours."""
    if field == "lines":
        sense = np.sign(np.einsum("ij,ij->i", ours.axes, read.axes))[:, None]
        along = np.einsum("ij,ij->i", ours.axes, read.points - ours.points)[:, None]
        return np.hstack([sense * read.axes, (read.points - along * ours.axes) / reach(ours)])
    if field == "tip":
        return np.array([next((part.tip for part in (read, ours) if part.tip is not None), np.zeros(3))])
    if field == "slides":
        return read.slides.astype(float)
    values: Array = getattr(read, field)
    return values[None] if field == "gravity" else values


def _norm(rows: Array) -> Array:
    return np.asarray(np.sqrt((rows.reshape(len(rows), -1) ** 2).sum(axis=1)))


def _explained(field: str, diff: Discrepancy, format: str) -> Finding:
    ours, theirs = diff.our_record, diff.their_record
    possible = (row for row in table().mistakes if row.field == field and row.setting in {"", *theirs.settings})
    mistake = next(row for row in possible if row.shape(diff))
    if mistake.shape is any_difference and field != "effort":  # without a pattern, the largest error is shown
        diff = diff.only(np.argsort(-diff.errors.astype(np.float32), kind="stable"))
    global_field = field in {"gravity", "tip"}
    faulty: dict[str, Any] = {}
    for name in BODY_FIELDS if field == "masses" else (field,):
        values = getattr(theirs, name)
        faulty[name] = values.copy() if global_field else with_rows(getattr(ours, name), values, diff.rows)
    where = "" if global_field else _where(ours.names, diff.rows)
    subject = table().fields[field].label
    if where:
        subject = f"{subject.removesuffix(' joints')} {where}" if field in COUPLED_FIELDS else f"{subject} of {where}"
    words = table().fields[field].id, _of_joints(field, diff), mistake.likely, mistake.remedy
    return _worded(words, f"{subject}: {_instead(field, diff)}", where, format, dataclasses.replace(ours, **faulty))


def _worded(words: tuple[str, Field, str, str], what: str, where: str, format: str, faulty: ReadBack) -> Finding:
    id, field, likely, remedy = words
    few = where.startswith(("joint ", "joints "))
    tag, joints = getattr(field, format, field.label), where if few else "these joints"
    return Finding(what, likely, remedy.format(tag=tag, unit=field.unit, where=joints), id, faulty)


def _instead(field: str, diff: Discrepancy) -> str:
    """Text with the file's first number, the expected one and their ratio, or the relative error if they look alike."""
    if field == "slides":
        return "revolute instead of prismatic" if diff.ours[0] else "prismatic instead of revolute"
    unit = _of_joints(field, diff).unit
    if field == "effort":
        slides = bool(diff.our_record.slides[diff.rows[0]])
        actual, expected = (limits(part[0], slides=slides) for part in (diff.theirs, diff.ours))
    else:
        actual, expected = (_short(part[0]) for part in (diff.theirs, diff.ours))
    if actual == expected:
        return f"{actual} {unit}, relative error {diff.relative_error:.3g}"
    factor = f", factor {diff.factor:.6g}" if diff.factor else ""
    if field == "inertias" and not diff.factor and (part := diff.part_factor):
        factor = f", factor {part:.6g} in the inertia of one part"
    return f"{actual} instead of {expected} {unit}".rstrip() + factor


def _of_joints(field: str, diff: Discrepancy) -> Field:
    """Label and unit of a field; the unit for prismatic joints if all these joints are prismatic."""
    words = table().fields[field]
    of_joints = field in (*JOINT_FIELDS, *ACTUATOR_FIELDS) and diff.rows.ndim == 1
    if of_joints and diff.our_record.slides[diff.rows].all():
        return words._replace(unit=table().sliding_units.get(words.unit, words.unit))
    return words


LOST = 1e-4  # largest relative difference that counts as lost digits if other numbers differ by more


def lost_digits(differing: Mapping[str, Discrepancy]) -> dict[str, Discrepancy]:
    """Return, by field, the entries that differ only by lost digits."""
    fields = {"lines", "masses", "centers", "inertias", *JOINT_FIELDS} & differing.keys()
    few = {field: differing[field].only(_shortened(field, differing[field])) for field in fields}
    return {field: diff for field, diff in few.items() if len(diff.rows)}


def with_entries(read: ReadBack, other: ReadBack, lost: Mapping[str, Discrepancy]) -> ReadBack:
    """Return the record with the entries of these fields and joints taken from the other record."""
    changed: dict[str, Any] = {}
    for field, diff in lost.items():
        for name in AXIS_FIELDS if field == "lines" else (field,):
            changed[name] = with_rows(getattr(read, name), getattr(other, name), diff.rows)
    if "axes" in changed:  # a flipped axis remains flipped
        changed["axes"] *= np.sign(np.einsum("ij,ij->i", changed["axes"], read.axes))[:, None]
    return dataclasses.replace(read, **changed)


def with_rows(ours: Array, theirs: Array, rows: Indices) -> Array:
    """Our numbers with some rows replaced by theirs; pairs of joints, rows (m, 2), replace K_ij and K_ji."""
    mixed = ours.copy()
    if rows.ndim == 1:
        mixed[rows] = theirs[rows]
    else:
        i, j = rows.T
        mixed[i, j] = mixed[j, i] = theirs[i, j]
    return mixed


def _shortened(field: str, diff: Discrepancy) -> Mask:
    """Whether each entry differs little; a scalar must also have a short number of digits in one of the records."""
    if field == "lines":
        return ~np.isin(diff.rows, displaced_joints(diff.our_record, diff.their_record, LOST))
    size = np.abs(diff.ours).reshape(len(diff.rows), -1).max(axis=1)
    near = np.asarray(diff.errors <= LOST * (reach(diff.our_record) if field == "centers" else size))
    if diff.ours.ndim > 1:
        return near
    each = [diff.only([k]) for k in range(len(near))]
    return near & [fewer_digits(one) or fewer_digits(one._replace(ours=one.theirs, theirs=one.ours)) for one in each]


# Match the joints of two records by name, else by the bodies they move, else, in a serial chain, by their order.


def match_joints(ours: ReadBack, theirs: ReadBack) -> Match | tuple[str, str]:
    """Return the match, or the reason for its failure and the remedy."""
    is_tree, by = len({*ours.parents.tolist()}) < ours.n, "bodies"
    if sorted(ours.names) == sorted(theirs.names):
        by = "names"
    sequence, paired = None if is_tree else _from_base_to_tip(theirs), _paired(ours, theirs)
    floats = [{*BASE_JOINTS} <= {*read.names} for read in (ours, theirs)]
    if floats[0] != floats[1]:
        what = f"the base {'floats' if floats[1] else 'is fixed'} in the file, but not in the scene"
        return what, "make them alike: flexlink import --free-base, or base.kind in the scene"
    if ours.n != theirs.n:
        what = f"{theirs.n} joints instead of {ours.n}"
        for words, one, other in (("without", ours, theirs), ("with", theirs, ours)):
            if names := [repr(name) for name in one.names if name not in other.names]:
                what += f", {words} {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
        return what, "check segments, locked joints and grippers"
    if sorted(paired) == list(range(theirs.n)):
        order = np.array(paired, dtype=np.intp)
    elif sequence is None:
        alone = [name for name, partner in zip(ours.names, paired, strict=True) if partner < 0]
        what = f"{_names(alone)} not in the file, by name or by the body moved; its tree has {_names(theirs.names)}"
        return what, "give the joints the file's names: joint.name in the scene"
    else:
        order, by = sequence[_regrouped(ours, theirs.axes[sequence])], "order"
    bodies = order if sequence is None else sequence
    fields = {"names", "parents", "tip_on", *theirs.unspecified, *ours.unspecified}
    own = {field: getattr(ours, field) for field in fields if hasattr(ours, field)}
    record = theirs.in_order(order, bodies, **own)
    positions = None if sequence is None else np.argsort(sequence)[order]
    if is_tree:
        elsewhere = np.append(np.argsort(order), -1)[theirs.parents[order]] != ours.parents
        positions = None if elsewhere.any() else np.arange(ours.n)
    else:
        elsewhere = np.full(ours.n, True) if positions is None else positions != np.arange(ours.n)
    return Match(order, positions, record, by, [ours.names[k] for k in np.flatnonzero(elsewhere)])


def _paired(ours: ReadBack, theirs: ReadBack) -> list[int]:
    """For each of our joints, the number of theirs of this name, else of the only one left on a body of this name."""
    named = {name: k for k, name in enumerate(theirs.names)}
    left = [k for k, name in enumerate(theirs.names) if name not in ours.names]
    count = Counter(theirs.bodies[k] for k in left)
    moves = {theirs.bodies[k]: k for k in left if count[theirs.bodies[k]] == 1}
    return [named.get(name, moves.get(body, -1)) for name, body in zip(ours.names, ours.bodies, strict=True)]


def _from_base_to_tip(theirs: ReadBack) -> Indices | None:
    behind = {int(parent): k for k, parent in enumerate(theirs.parents)}
    if len(behind) < theirs.n:
        return None
    sequence = [-1]
    while sequence[-1] in behind:
        sequence.append(behind[sequence[-1]])
    return np.array(sequence[1:], dtype=np.intp)


def _regrouped(ours: ReadBack, axes: Array) -> Indices:
    """Positions of our joints along the other chain, where joints at the same point may have another order."""
    positions = np.arange(ours.n)
    starts = [k for k in positions if k == 0 or not np.array_equal(ours.points[k], ours.points[k - 1])]
    for first, stop in itertools.pairwise([*starts, ours.n]):
        group = positions[first:stop]
        for permuted in itertools.permutations(group) if len(group) <= 3 else ():
            if np.abs(np.cross(axes[list(permuted)], ours.axes[group])).max() <= 1e-6:
                positions[group] = permuted
                break
    return positions
