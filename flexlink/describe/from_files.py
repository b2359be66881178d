"""Read tables of motions, drives, references and wrenches from CSV files, once, when a scene is built."""

import contextlib
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import asdict, replace

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import missing, short_list
from flexlink.data.csv_table import CsvTable, head_of, read_csv
from flexlink.data.smoothing import smoothed
from flexlink.describe.actions import PrescribedMotion, Wrench
from flexlink.describe.arm import Arm
from flexlink.describe.drive import Drive
from flexlink.describe.initial import InitialState
from flexlink.describe.joint_units import Row
from flexlink.describe.link import Link
from flexlink.describe.reference import Reference
from flexlink.describe.spec import Spec

RATES = {"qd": "/s", "qdd": "/s²"}
"""Prefixes of headers of rates and accelerations ("qd NAME [deg/s]" for "q NAME [deg]"), with their unit suffixes."""


def filled_from_files(
    arm: Arm, *, motion: tuple[PrescribedMotion, ...], drive: Drive, wrench: Wrench, initial: InitialState
) -> dict[str, Any]:
    """Fields of a scene that change when tables in files are read; joints then start at the first row of a file."""
    filled: dict[str, Any] = {}
    if any(each.file is not None for each in motion):
        motions = list(motion)
        for k, each in enumerate(motion):
            if each.file is not None and (number := _number(arm, each)):
                motions[k] = motion_from_file(each, arm.links[number - 1])
                initial = _started_with(initial, arm, number, motions[k])
        filled |= {"motion": tuple(motions), "initial": initial}
    moved = {_number(arm, each) for each in motion}
    if drive.file is not None:
        drive = filled["drive"] = drive_from_file(drive, arm, moved)
    if drive.reference is not None and drive.reference.file is not None:
        starts = arm.own(initial.joint_deg, initial.joint_m)
        filled["drive"] = replace(drive, reference=reference_from_file(drive.reference, arm, moved, starts))
    if wrench.file is not None:
        filled["wrench"] = wrench_from_file(wrench)
    return filled


def _number(arm: Arm, motion: PrescribedMotion) -> int:
    """Number of the moving link; 0 if there is no such link, which the checks of the scene report later."""
    try:
        return arm.number(motion.link)
    except ArgumentError:
        return 0


def _started_with(initial: InitialState, arm: Arm, number: int, motion: PrescribedMotion) -> InitialState:
    """Start a joint at the first angle and rate of its motion; a given angle must be near the first one."""
    # largest allowed difference between the given initial value and the file's first one, angle [deg] or position [m]
    near = {"joint": {"deg": 1.0, "m": 0.01}[motion.terms.unit], "rate": 0.0}
    changes = {}
    for (name, allowed), column in zip(near.items(), motion.columns, strict=False):
        key = f"{name}_{motion.terms.unit}"
        row, first = list(getattr(initial, key) or (0.0,) * len(arm.links)), column[0]
        if len(row) != len(arm.links) or initial.q is not None or initial.time:
            return initial
        given = row[number - 1]
        if given and abs(given - first) > allowed:
            remedy = "leave this out if the file is right: the joint starts where the file does"
            if key.endswith("_deg") and abs(given - np.radians(first)) <= allowed:
                remedy = "its angles in rad are probably degrees: write [deg] in the name of the column"
            text = f"the file of the motion of {motion.link!r} starts at {first:.6g}; {remedy}"
            raise SceneError(f"{arm.path(number, f'initial.{key}')} = {given!r}: {text}", id="start-differs-from-file")
        row[number - 1] = first
        changes[key] = tuple(row)
    return replace(initial, **changes)


def without_starts(initial: InitialState, arm: Arm, led: tuple[PrescribedMotion, ...], by: object) -> InitialState:
    """The initial state without values set by earlier motions `led`, so that new ones `by` may start elsewhere."""
    new = by if isinstance(by, list | tuple) else ()
    tables = (each if isinstance(each, dict) else asdict(each) for each in new if isinstance(each, dict | Spec))
    files = {table.get("link") for table in tables if table.get("file")}
    rows: dict[str, list[float]] = {}
    for motion in (each for each in led if {each.link, _number(arm, each)} & files):
        for name, column in zip(("joint", "rate"), motion.columns, strict=False):
            key, k = f"{name}_{motion.terms.unit}", _number(arm, motion) - 1
            row = rows.get(key) or list(getattr(initial, key) or ())
            if k < len(row) and row[k] == column[0]:
                row[k] = 0.0
                rows[key] = row
    return replace(initial, **{key: tuple(row) for key, row in rows.items()}) if rows else initial


def drive_from_file(drive: Drive, arm: Arm, moved: set[int]) -> Drive:
    """The drive with the torques of its file; locked joints, and those led by a motion (`moved`), need no column."""
    with _table("drive", drive.file or "") as table:
        columns = []
        for k, link in enumerate(arm.links, 1):
            quantity = f"tau {link.joint_name}"
            none = link.joint.locked or (k in moved and quantity not in table.quantities)
            columns.append(np.zeros(len(table.values)) if none else table.column(quantity, link.joint.terms.torque))
        return replace(drive, file=None, times=_row(table.times), torques=_rows(np.column_stack(columns)))


def reference_from_file(reference: Reference, arm: Arm, moved: set[int], starts: Sequence[float]) -> Reference:
    """The reference with the angles of its file, which has one column "q NAME [deg]" for each moving joint.

    Locked joints, and joints led by a motion (`moved`), need no column; without one, the reference of a led joint is
    its initial position. With profile "smooth", rates and accelerations come from `smoothed` if a `cutoff` is given,
    else from the file if it has them.
    """
    with _table("drive.reference", reference.file or "") as table:
        there, links = table.quantities, arm.links
        free = {k: link for k, link in enumerate(links) if not link.joint.locked}
        led = {k: link for k, link in free.items() if k + 1 not in moved or f"q {link.joint_name}" in there}
        rates = [name for name in RATES if any(f"{name} {link.joint_name}" in there for link in led.values())]
        smooth = rates if reference.profile == "smooth" else ()
        columns = {k: _angles(table, link, reference.cutoff, smooth) for k, link in led.items()}
        rows: dict[str, tuple[Row, ...]] = {}
        for part in range(max(map(len, columns.values()), default=1)):
            for terms in {link.joint.terms for link in free.values()}:
                values = np.zeros((len(table.values), len(links)))
                for k, link in free.items():
                    if link.joint.terms == terms:
                        values[:, k] = columns[k][part] if k in columns else starts[k] * (part == 0)
                rows[terms.motion[part]] = _rows(values)
        return replace(reference, file=None, cutoff=None, times=_row(table.times), **rows)


def _angles(table: CsvTable, link: Link, cutoff: float | str | None, rates: Collection[str]) -> list[Array]:
    """Positions of a joint, then filtered rates and accelerations if there is a cutoff, else the columns `rates`."""
    unit = link.joint.terms.unit
    positions = table.column(f"q {link.joint_name}", unit)
    if cutoff is not None:
        return [*smoothed(table.times, positions, cutoff)]
    found = (table.column(f"{name} {link.joint_name}", f"{unit}{per}") for name, per in RATES.items() if name in rates)
    return [positions, *found]


def wrench_from_file(wrench: Wrench) -> Wrench:
    """The wrench with the components of its file, "force x [N]" … "moment z [N m]"; missing components are 0."""
    parts = {"forces": ("force", "N"), "moments": ("moment", "N m")}
    allowed = {f"{name} {axis}" for name, _ in parts.values() for axis in "xyz"}
    with _table("wrench", wrench.file or "") as table:
        there = table.quantities
        for head in table.heads:
            quantity = head_of(head)[0]
            if quantity not in allowed and quantity.startswith(("force", "moment")):
                text = f"{table.path}: column {head!r}: not known; expected {short_list(sorted(allowed))}"
                raise DataFileError(text, id="unknown-column")
        if not allowed & there:
            text = f"{table.path}: needs a column 'force x [N]' or 'moment z [N m]'; has {short_list(table.heads)}"
            raise DataFileError(text, id="no-such-column")
        rows: dict[str, Any] = {}
        none = np.zeros(len(table.values))
        for key, (name, unit) in parts.items():
            named = [f"{name} {axis}" for axis in "xyz"]
            if there & set(named):
                columns = [table.column(each, unit) if each in there else none for each in named]
                rows[key] = _rows(np.column_stack(columns))
        return replace(wrench, file=None, times=_row(table.times), **rows)


def recorded_positions(motion: PrescribedMotion, link: Link) -> tuple[Array, Array]:
    """Times [s] and positions [deg or m] in the file of a motion, not filtered."""
    table = read_csv(Path(motion.file or ""))
    return table.times, table.column(f"q {link.joint_name}", link.joint.terms.unit)


def motion_from_file(motion: PrescribedMotion, link: Link) -> PrescribedMotion:
    """The motion with the angles of its file, "q NAME [deg]", and their rates and accelerations.

    With a `cutoff`, all come from `smoothed`; without one, rates and accelerations are the columns "qd NAME [deg/s]"
    and "qdd NAME [deg/s²]".
    """
    with _table(f"motion.{motion.link}", motion.file or "") as table:
        times = table.times
        if len(times) and (first := float(times[0])) != 0:
            raise DataFileError(f"t starts at {first!r} s; a motion starts at 0, so shift it", id="first-time")
        columns = _angles(table, link, motion.cutoff, ())
        if motion.cutoff is None:
            for name in RATES:
                if f"{name} {link.joint_name}" not in table.quantities:
                    lacks = f"{table.path} has no column '{name} {link.joint_name}'. Give a cutoff [Hz], or 'auto', to"
                    raise missing("cutoff", f"{lacks} compute rates and accelerations, or a file that contains them")
            columns = _angles(table, link, None, RATES)
        rows: dict[str, Any] = dict(zip(link.joint.terms.motion, map(_row, columns), strict=True))
        return replace(motion, file=None, cutoff=None, times=_row(times), **rows)


def _row(column: Array) -> Row:
    return tuple(column.tolist())


def _rows(table: Array) -> tuple[Row, ...]:
    return tuple(map(tuple, table.tolist()))


@contextlib.contextmanager
def _table(path: str, file: str) -> Iterator[CsvTable]:
    """The table in a CSV file; errors about it start with the path of the key that names the file."""
    try:
        table = read_csv(Path(file))
        if not len(table.values):
            raise DataFileError(f"{file}: no rows; expected one or more below the header", id="file-empty")
        yield table
    except DataFileError as error:
        raise DataFileError(f"{path}.file = {file!r}: {str(error).removeprefix(f'{file}: ')}") from None
    except SceneError as error:
        raise SceneError(f"{path}.{error}") from None
