"""Read tables of motions, drives, references and wrenches from CSV files, once, when a scene is built."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array, T
from flexlink.common.wording import short_list
from flexlink.data.csv_table import CsvTable, head_of, read_csv
from flexlink.data.smoothing import smoothed
from flexlink.describe.actions import PrescribedMotion, Wrench
from flexlink.describe.arm import Arm
from flexlink.describe.drive import Drive
from flexlink.describe.initial import InitialState
from flexlink.describe.joint_units import IN_METRES, OF_JOINT, Row
from flexlink.describe.link import Link
from flexlink.describe.reference import OF_MOTION, Reference

RATES = {"qd": "/s", "qdd": "/s²"}
"""Prefixes of headers of rates and accelerations ("qd NAME [deg/s]" for "q NAME [deg]"), with their unit suffixes."""


def filled_from_files(
    arm: Arm, *, motion: tuple[PrescribedMotion, ...], drive: Drive, wrench: Wrench, initial: InitialState
) -> dict[str, Any]:
    """Return the fields of a scene that change when tables in files are read; joints then start at a file's first row.

    Raises
    ------
    SceneError, DataFileError
        A file is invalid, or the scene gives a different initial state.
    """
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
        filled["drive"] = drive_from_file(drive, arm, moved)
    if drive.reference is not None and drive.reference.file is not None:
        starts = filled.get("initial", initial).own("joint", arm.slides)
        reference = reference_from_file(drive.reference, arm, moved, starts)
        filled["drive"] = replace(filled.get("drive", drive), reference=reference)
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
    """Start a joint at the first angle and rate of its motion; an angle given in the scene must nearly equal the first.

    Raises
    ------
    SceneError
        The scene gives a different angle, or a rate.
    """
    # largest allowed difference between the given initial value and the file's first one, angle [deg] or position [m]
    near = {"joint": 0.01 if motion.slides else 1.0, "rate": 0.0}
    changes = {}
    for (name, allowed), column in zip(near.items(), motion.columns, strict=False):
        key = f"{name}_{OF_JOINT[motion.slides].unit}"
        row, first = list(getattr(initial, key) or (0.0,) * len(arm.links)), column[0]
        if len(row) != len(arm.links) or initial.q is not None or initial.time:
            return initial
        given = row[number - 1]
        if given and abs(given - first) > allowed:
            converted = key.endswith("_deg") and abs(given - np.radians(first)) <= allowed  # degrees, read as rad
            remedy = (
                "its angles in rad are probably degrees: write [deg] in the name of the column"
                if converted
                else "leave this out if the file is right: the joint starts where the file does"
            )
            raise SceneError(
                f"{arm.path(number, f'initial.{key}')} = {given!r}: the file of the motion of {motion.link!r} starts "
                f"at {first:.6g}; {remedy}",
                id="start-differs-from-file",
            )
        row[number - 1] = first
        changes[key] = tuple(row)
    return replace(initial, **changes)


def without_starts(initial: InitialState, arm: Arm, led: tuple[PrescribedMotion, ...], by: object) -> InitialState:
    """The initial state without values set by earlier motions, so that new motions `by` may start elsewhere.

    Parameters
    ----------
    initial
        The initial state.
    arm
        The arm.
    led
        The earlier motions.
    by
        The new motions, as tables or descriptions.
    """
    files = {
        each.get("link") if isinstance(each, dict) else getattr(each, "link", None)
        for each in (by if isinstance(by, list | tuple) else ())
        if (each.get("file") if isinstance(each, dict) else getattr(each, "file", None))
    }
    rows: dict[str, list[float]] = {}
    for motion in (each for each in led if {each.link, _number(arm, each)} & files):
        for name, column in zip(("joint", "rate"), motion.columns, strict=False):
            key, k = f"{name}_{OF_JOINT[motion.slides].unit}", _number(arm, motion) - 1
            row = rows.get(key) or list(getattr(initial, key) or ())
            if k < len(row) and row[k] == column[0]:
                row[k] = 0.0
                rows[key] = row
    return replace(initial, **{key: tuple(row) for key, row in rows.items()}) if rows else initial


def drive_from_file(drive: Drive, arm: Arm, moved: set[int]) -> Drive:
    """Return the drive with the torques of its file, which has one column "tau NAME [N m]" for each driven joint.

    Locked joints, and joints with prescribed motion (`moved`, by link number), need no column.

    Raises
    ------
    DataFileError
        Raised by `read_csv` or `CsvTable.column`.
    """

    def filled(table: CsvTable) -> Drive:
        columns = [_torques(table, link, k in moved) for k, link in enumerate(arm.links, 1)]
        torques = tuple(map(tuple, np.column_stack(columns).tolist()))
        return replace(drive, file=None, times=tuple(table.times.tolist()), torques=torques)

    return _read("drive", drive.file or "", filled)


def _torques(table: CsvTable, link: Link, moved: bool) -> Array:
    quantity = f"tau {link.joint_name}"
    if link.joint.locked or (moved and quantity not in table.quantities):
        return np.zeros(len(table.values))
    return table.column(quantity, OF_JOINT[link.joint.slides].torque)


def reference_from_file(reference: Reference, arm: Arm, moved: set[int], starts: Sequence[float]) -> Reference:
    """Return the reference with the angles of its file, which has one column "q NAME [deg]" for each moving joint.

    Locked joints, and joints with prescribed motion (`moved`), need no column; without a column, the reference of a
    moved joint is its initial position. With profile "smooth", rates and accelerations come from `smoothed` if a
    `cutoff` is given, else from the file if it has them.

    Raises
    ------
    DataFileError
        As for `drive_from_file`; or the file has rates or accelerations for only some of the joints.
    SceneError
        Raised by `smoothed`.
    """

    def filled(table: CsvTable) -> Reference:
        there = table.quantities
        led = [
            k
            for k, link in enumerate(arm.links, 1)
            if not link.joint.locked and (k not in moved or f"q {link.joint_name}" in there)
        ]
        rates = [name for name in RATES if any(f"{name} {arm.joint_names[k - 1]}" in there for k in led)]
        columns = {
            k: _angles(table, arm.links[k - 1], reference.cutoff, rates if reference.profile == "smooth" else ())
            for k in led
        }
        rows: dict[str, tuple[Row, ...]] = {}
        for part, key in zip(range(max(map(len, columns.values()), default=1)), OF_MOTION, strict=False):
            for slides in {link.joint.slides for link in arm.links if not link.joint.locked}:
                values = np.zeros((len(table.values), len(arm.links)))
                for k, link in enumerate(arm.links, 1):
                    if link.joint.slides == slides and not link.joint.locked:
                        values[:, k - 1] = columns[k][part] if k in columns else starts[k - 1] * (part == 0)
                rows[IN_METRES[key] if slides else key] = tuple(map(tuple, values.tolist()))
        return replace(reference, file=None, cutoff=None, times=tuple(table.times.tolist()), **rows)

    return _read("drive.reference", reference.file or "", filled)


def _angles(table: CsvTable, link: Link, cutoff: float | str | None, rates: Collection[str]) -> list[Array]:
    """Positions of a joint, then filtered rates and accelerations if there is a cutoff, else the columns `rates`."""
    unit = OF_JOINT[link.joint.slides].unit
    positions = table.column(f"q {link.joint_name}", unit)
    if cutoff is not None:
        return [*smoothed(table.times, positions, cutoff)]
    found = (table.column(f"{name} {link.joint_name}", f"{unit}{per}") for name, per in RATES.items() if name in rates)
    return [positions, *found]


def wrench_from_file(wrench: Wrench) -> Wrench:
    """Return the wrench with the components of its file, "force x [N]" … "moment z [N m]"; missing components are 0.

    Raises
    ------
    DataFileError
        No component is present, or an unknown header starts with "force" or "moment"; or as for `drive_from_file`.
    """
    parts = {"forces": ("force", "N"), "moments": ("moment", "N m")}

    def filled(table: CsvTable) -> Wrench:
        quantities = [head_of(head)[0] for head in table.heads]
        allowed = {f"{name} {axis}" for name, _ in parts.values() for axis in "xyz"}
        for head, quantity in zip(table.heads, quantities, strict=True):
            if quantity not in allowed and quantity.startswith(("force", "moment")):
                raise DataFileError(
                    f"{table.path}: column {head!r}: not known; expected {short_list(sorted(allowed))}",
                    id="unknown-column",
                )
        if not allowed & set(quantities):
            raise DataFileError(
                f"{table.path}: needs a column 'force x [N]' or 'moment z [N m]'; has {short_list(table.heads)}",
                id="no-such-column",
            )
        rows = {}
        for key, (name, unit) in parts.items():
            there = [f"{name} {axis}" in quantities for axis in "xyz"]
            if any(there):
                none = np.zeros(len(table.values))
                columns = [
                    table.column(f"{name} {axis}", unit) if given else none
                    for axis, given in zip("xyz", there, strict=True)
                ]
                rows[key] = tuple(map(tuple, np.column_stack(columns).tolist()))
        return replace(wrench, file=None, times=tuple(table.times.tolist()), **rows)

    return _read("wrench", wrench.file or "", filled)


def keys_of_motion(link: Link) -> tuple[str, ...]:
    """Keys of position, rate and acceleration of a prescribed motion of a link's joint."""
    return tuple(IN_METRES[key] for key in OF_MOTION) if link.joint.slides else tuple(OF_MOTION)


def recorded_positions(motion: PrescribedMotion, link: Link) -> tuple[Array, Array]:
    """Times [s] and positions [deg or m] in the file of a motion, not filtered."""
    table = read_csv(Path(motion.file or ""))
    return table.times, table.column(f"q {link.joint_name}", OF_JOINT[link.joint.slides].unit)


def motion_from_file(motion: PrescribedMotion, link: Link) -> PrescribedMotion:
    """Return the motion with the angles of its file, "q NAME [deg]", and their rates and accelerations.

    With a `cutoff`, angles, rates and accelerations come from `smoothed`; without one, rates and accelerations are the
    columns "qd NAME [deg/s]" and "qdd NAME [deg/s²]".

    Raises
    ------
    DataFileError
        As for `drive_from_file`; or the times do not start at 0.
    SceneError
        Raised by `smoothed`; or both the cutoff and the columns of rates and accelerations are missing.
    """

    def filled(table: CsvTable) -> PrescribedMotion:
        times = table.times
        if len(times) and times[0] != 0:
            raise DataFileError(
                f"{table.path}: t starts at {float(times[0])!r} s; a motion starts at 0, so shift it", id="first-time"
            )
        columns = _angles(table, link, motion.cutoff, ())
        if motion.cutoff is None:
            for name in RATES:
                if f"{name} {link.joint_name}" not in table.quantities:
                    raise SceneError(
                        f"cutoff: missing; {table.path} has no column '{name} {link.joint_name}'. Give a cutoff "
                        "[Hz], or 'auto', to compute rates and accelerations, or a file that contains them",
                        id="missing-key",
                    )
            columns = _angles(table, link, None, RATES)
        rows: dict[str, Row] = {
            key: tuple(part.tolist()) for key, part in zip(keys_of_motion(link), columns, strict=True)
        }
        return replace(motion, file=None, cutoff=None, times=tuple(times.tolist()), **rows)

    return _read(f"motion.{motion.link}", motion.file or "", filled)


def _read(path: str, file: str, filled: Callable[[CsvTable], T]) -> T:
    """Read a CSV file and apply `filled` to it; errors start with the path of the key that names the file."""
    try:
        table = read_csv(Path(file))
        if not len(table.values):
            raise DataFileError(f"{file}: no rows; expected one or more below the header", id="file-empty")
        return filled(table)
    except DataFileError as error:
        raise DataFileError(f"{path}.file = {file!r}: {str(error).removeprefix(f'{file}: ')}") from None
    except SceneError as error:
        raise SceneError(f"{path}.{error}") from None
