"""Two records of an arm compared: joints, lines, numbers, settings; each difference with the likely mistake."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.diagnosis.joint_axes import Place, Placed, deviations, put_back, size
from flexlink.diagnosis.matching import Match, matched
from flexlink.diagnosis.mistakes import (
    DIGITS_LOST,
    FIELDS,
    LENGTHS,
    MISTAKES,
    OF_PLACES,
    ORDER,
    PLACES,
    SETTINGS,
    ZERO_SHIFTED,
    Mistake,
)
from flexlink.diagnosis.shapes import Seen, fewer_digits, moments
from flexlink.engines.actuators import limits
from flexlink.engines.read_back import ACTUATORS, OF_BODIES, OF_JOINTS, ReadBack

Array = NDArray[np.float64]

EXACT, PLACED = 1e-12, 1e-11
"""Relative: of numbers that are copied, and of those that are turned into frame 0 joint by joint."""
COPIED = ("gravity", *OF_JOINTS, *ACTUATORS[:-1])
SHOWN = 3  # names of joints
REACHES = 3.0
"""Times the arm's reach beyond which only another unit of length displaces a frame; a wrong sign or turn does by 2."""


@dataclasses.dataclass(frozen=True)
class Finding:
    """One difference in what was read, with the mistake that explains it.

    Attributes
    ----------
    what
        The field, where, and what stands there instead of what; of a setting all that there is to say.
    likely, change
        What was probably done, and what puts it right.
    made
        Our record with this mistake made; None for what is no number of the record.
    counts
        Whether runs differ by it; otherwise it is only worth knowing.
    alone
        Quantities of the equation of motion that differ by this alone.
    """

    what: str
    likely: str
    change: str
    made: ReadBack | None = dataclasses.field(default=None, repr=False, compare=False)
    counts: bool = True
    alone: tuple[str, ...] = ()

    def __str__(self) -> str:
        likely = f": {self.likely}" if self.likely else ""
        alone = f"; by itself it changes {', '.join(self.alone)}" if self.alone else ""
        return f"{self.what}{likely}{alone}; {self.change}"


def differences(ours: ReadBack, theirs: ReadBack, form: str) -> tuple[Match | None, list[Finding]]:
    """How the joints are matched (None: they cannot be), and what differs, numbers before settings.

    Parameters
    ----------
    ours
        The right record, joints from base to tip.
    theirs
        What an engine has read.
    form
        Format that it was read from, for the words: a name in `flexlink.formats.FORMATS`.
    """
    match = matched(ours, theirs)
    if isinstance(match, str):
        return None, [Finding(match, "", "check the number of segments, locked joints and grippers")]
    return match, [*_order(match), *_numbers(ours, match.record, form), *_settings(theirs)]


def _order(match: Match) -> Iterator[Finding]:
    if match.moved:
        yield Finding(f"{_names(match.moved)} hang in another order along the chain", *ORDER)


def _numbers(ours: ReadBack, theirs: ReadBack, form: str) -> list[Finding]:
    placed = put_back(ours, theirs, PLACED, tuple(LENGTHS))
    fields = _differing(ours, placed.theirs)
    everything = _differing(ours, theirs)
    if len(placed.places) + len(fields) > 1 and all(fewer_digits(seen) for seen in everything.values()):
        what, worst = ", ".join(FIELDS[field].label for field in everything), max(map(_apart, everything.values()))
        return [Finding(f"{what}: right to about {-np.log10(worst):.0f} digits", *DIGITS_LOST, made=theirs)]
    found = [*_placements(placed, theirs, form), *(_explained(field, seen, form) for field, seen in fields.items())]
    return [_joined(ours, list(one)) for _, one in itertools.groupby(found, key=lambda f: (f.likely, f.change))]


def _joined(ours: ReadBack, same: list[Finding]) -> Finding:
    """Findings with one cause as one, which is made in all fields of theirs."""
    mades = [finding.made for finding in same if finding.made is not None]
    names = [field.name for field in dataclasses.fields(ReadBack)]
    fields: dict[str, Any] = {
        f: value for made in reversed(mades) for f in names if (value := getattr(made, f)) is not getattr(ours, f)
    }
    what = "; ".join(finding.what for finding in same)
    return dataclasses.replace(same[0], what=what, made=dataclasses.replace(ours, **fields))


def _placements(placed: Placed, theirs: ReadBack, form: str) -> Iterator[Finding]:
    """One finding for each way in which lines lie elsewhere."""
    L = size(placed.theirs)
    for kind, mistake in PLACES.items():
        places = [place for place in placed.places if _kind(place, L) == kind]
        if not places:
            continue
        told = [f"joint {theirs.names[place.joint]!r} {_displaced(place, L)}" for place in places]
        what = f"{', '.join(told[:SHOWN])}{' …' * (len(told) > SHOWN)}"
        what += ", but not what it carries" if kind == "position" else ""
        what += ", with all behind it" if places[-1].axes is None else ""
        what += "" if places[-1].alone else ", where more is displaced, and not compared further"
        likely = ZERO_SHIFTED if "ref" in theirs.settings else mistake
        yield _worded(likely, what, _names([theirs.names[place.joint] for place in places]), form, placed.ours)


def _kind(place: Place, L: float) -> str:
    """Which of `PLACES` it is."""
    if place.axes is not None:
        return "position" if place.offset > PLACED * L else "axis"
    if place.times is not None:
        return LENGTHS[place.times]
    return "far" if place.offset > REACHES * L else "frame"


def _displaced(place: Place, L: float) -> str:
    if place.axes is not None and place.angle > PLACED:
        one, other = (_short(np.where(np.abs(axis) < EXACT, 0, axis)) for axis in place.axes)
        return f"turns about {one} instead of {other}"
    if place.times is not None:
        return f"is {place.times:g} times as far from the one before: displaced by {place.offset:.4g} m"
    turned = [f"turned by {np.degrees(place.angle):.4g}°"] if place.angle > PLACED else []
    return " and ".join([*turned, *([f"displaced by {place.offset:.4g} m"] if place.offset > PLACED * L else [])])


def _settings(theirs: ReadBack) -> Iterator[Finding]:
    for name, (what, change, counts) in SETTINGS.items():
        if name in theirs.settings and name not in theirs.unsaid:
            yield Finding(what.format(value=theirs.settings[name]), "", change, counts=counts)


def _differing(ours: ReadBack, theirs: ReadBack) -> dict[str, Seen]:
    """Fields that differ, with the entries that do."""
    pairs = {field: (_values(ours, field, ours), _values(theirs, field, ours)) for field in FIELDS}
    apart = {field: _norm(b - a) for field, (a, b) in pairs.items() if field != "effort"}
    L, (sin, off) = size(ours), deviations(ours, theirs)
    m, lever = ours.masses, _norm(ours.centers - ours.points)
    other_mass = apart["masses"] > EXACT * np.maximum(m, theirs.masses)
    there = ~other_mass & (m > 0)  # where the mass differs, centre and inertia do with it
    bad = {field: apart[field] > EXACT * np.maximum(*map(_norm, pairs[field])) for field in COPIED}
    bad |= {
        "axes": (sin <= PLACED) & (np.einsum("ij,ij->i", ours.axes, theirs.axes) < 0),
        "lines": (sin > PLACED) | (off > PLACED * L),
        "tip": apart["tip"] > PLACED * L,
        "masses": other_mass,
        "centers": there & (apart["centers"] > PLACED * L),
        "inertias": ~other_mass & (apart["inertias"] > PLACED * _norm(ours.inertias) + EXACT * m * lever**2),
    }
    one, other = (_reached(ours, read.effort) for read in (ours, theirs))
    bad["effort"] = np.any(~np.isclose(one, other, rtol=EXACT, atol=0), axis=1)
    if theirs.control[ours.control != 0].all():
        bad["control"] &= ours.control != 0  # one more motor does nothing without a command
    bad["rest"] &= (ours.stiffness != 0) & (theirs.stiffness != 0)
    bad["coulomb_width"] &= (ours.coulomb != 0) & (theirs.coulomb != 0)
    return {
        field: Seen(a[mask], b[mask], np.flatnonzero(mask), ours, theirs)
        for field, (a, b) in pairs.items()
        if (mask := bad[field]).any()
    }


def _reached(ours: ReadBack, effort: Array) -> Array:
    """Least and largest torque that the scene's drive gets with these limits."""
    asked = np.zeros((ours.n, 2)) if ours.asked is None else ours.asked
    return np.clip(asked, effort[:, :1], effort[:, 1:])


def _values(read: ReadBack, field: str, ours: ReadBack) -> Array:
    """Numbers of a field by joints, or one row; of lines the axis in the sense of ours, and the point next to ours."""
    if field == "lines":
        sense = np.sign(np.einsum("ij,ij->i", ours.axes, read.axes))[:, None]
        along = np.einsum("ij,ij->i", ours.axes, read.points - ours.points)[:, None]
        return np.hstack([sense * read.axes, (read.points - along * ours.axes) / size(ours)])
    if field == "tip":
        known = [part.tip for part in (read, ours) if part.tip is not None]
        return np.array(known[:1] or [np.zeros(3)])
    values: Array = getattr(read, field)
    return values[None] if field == "gravity" else values


def _norm(rows: Array) -> Array:
    return np.asarray(np.sqrt((rows.reshape(len(rows), -1) ** 2).sum(axis=1)))


def _mistake(field: str, seen: Seen, theirs: ReadBack) -> Mistake:
    """The first row of the table that fits."""
    told = {"", *theirs.settings}
    return next(m for m in MISTAKES if m.field == field and m.setting in told and m.shape(seen))


def _explained(field: str, seen: Seen, form: str) -> Finding:
    ours, theirs = seen.us, seen.them
    fields = OF_BODIES if field == "masses" else (field,)
    one = field in {"gravity", "tip"}
    made = {name: getattr(ours, name).copy() for name in fields}
    for name in fields:
        rows = slice(None) if one else seen.where
        made[name][rows] = getattr(theirs, name)[rows]
    where = "" if one else _names([ours.names[k] for k in seen.where])
    what = f"{FIELDS[field].label}{' of ' * bool(where)}{where}: {_instead(field, seen)}"
    return _worded(_mistake(field, seen, theirs), what, where, form, dataclasses.replace(ours, **made))


def _worded(mistake: Mistake, what: str, where: str, form: str, made: ReadBack) -> Finding:
    words = OF_PLACES[mistake.field]
    tag, joints = getattr(words, form, words.label), where if where.startswith("joint ") else "these joints"
    change = mistake.change.format(tag=tag, unit=words.unit, where=joints)
    return Finding(what, mistake.likely, change, made)


def _names(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:SHOWN])
    return f"joint {shown}" if len(names) == 1 else f"{len(names)} joints ({shown}{' …' * (len(names) > SHOWN)})"


def _instead(field: str, seen: Seen) -> str:
    """The first numbers, and what they should be; how far apart, where that does not show."""
    unit = FIELDS[field].unit
    got, expected = ((limits if field == "effort" else _short)(part[0]) for part in (seen.theirs, seen.ours))
    if got == expected:
        return f"{got} {unit}, off by {_apart(seen):.3g} of it"
    factor = f", factor {seen.factor:.6g}" if seen.factor else ""
    if field == "inertias" and not seen.factor and (of_part := seen.part):
        factor = f", of a part of it the factor {of_part:.6g}"
    return f"{got} instead of {expected} {unit}".rstrip() + factor


def _apart(seen: Seen) -> float:
    """Largest difference, relative to the largest number."""
    return float(np.abs(seen.theirs - seen.ours).max() / np.abs(seen.ours).max())


def _short(value: Array) -> str:
    """A number, a vector, or of an inertia the principal moments."""
    numbers = moments(value) if np.ndim(value) == 2 else np.atleast_1d(value)
    text = ", ".join(f"{x + 0.0:.6g}" for x in numbers)
    return f"({text})" if len(numbers) > 1 else text
