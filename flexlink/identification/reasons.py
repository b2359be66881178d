"""Explain why a parameter has no effect on the data: the columns that it affects instead, or the axis it acts about."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.vary import parts_of
from flexlink.identification.block import unit_in
from flexlink.identification.identifiability import Direction
from flexlink.identification.signals import Signals
from flexlink.motion.simulate import simulate


def with_reasons(signals: Signals, x: Array, directions: Sequence[Direction]) -> tuple[Direction, ...]:
    """The same directions, with a reason for each single parameter that is not identifiable."""
    number = {one.name: k for k, one in enumerate(signals.coordinates)}
    return tuple(
        one._replace(why=_why(signals, x, number[one.names[0]]))
        if one.lost and len(one.names) == 1 and one.names[0] in number else one
        for one in directions
    )  # fmt: skip


def _why(signals: Signals, x: Array, k: int) -> str:
    if signals.coordinates[k].timing:
        return ""
    reasons = [_moves(signals, x, k), _axis(signals.sources[0].scene, signals.coordinates[k].path)]
    return "".join(f"; {reason}" for reason in reasons if reason)


def _moves(signals: Signals, x: Array, k: int) -> str:
    """Columns that the parameter affects in the first run that depends on it."""
    count = 2  # largest number of columns to name
    # Smallest range of a column, absolute and relative to its largest value: a constant column varies by rounding
    # errors, 1e-11 rad/s in the stages of a long explicit step.
    rounded = 1e-6
    moves = 1e-3  # smallest change that counts, relative to the range of all columns of the same unit
    by = 0.05  # change of the coordinate x_k, whose effect on the columns is computed
    runs = [n for n, one in enumerate(signals.sources)
            if one.is_run and signals.coordinates[k].run in ("", one.name)]  # fmt: skip
    if not runs:
        return ""
    source, moved_point = signals.sources[runs[0]], x.copy()
    moved_point[k] += by if x[k] + by < signals.coordinates[k].bounds[1] else -by
    try:
        before, after = (simulate(signals.scene(runs[0], point)).columns for point in (x, moved_point))
    except FlexlinkError:
        return ""
    names = [name for name in before if name != "t [s]" and unit_in(name) != "J"]
    ranges: dict[str, float] = {}
    for name in names:
        still = rounded * (1.0 + float(np.abs(before[name]).max()))
        ranges[unit_in(name)] = max(ranges.get(unit_in(name), 0.0), still, float(np.ptp(before[name])))
    moved = {name: float(np.abs(after[name] - before[name]).max()) / ranges[unit_in(name)] for name in names}
    measured = {block.name for block in source.blocks}
    free = (name for name in names if moved[name] > moves and name not in measured)
    most = sorted(free, key=lambda name: (name.startswith("q"), -float(f"{moved[name]:.3g}")))  # beam hinges last
    data = ", ".join(sorted(measured))
    if most:
        return f"it affects {' and '.join(most[:count])}; the data of {source.name} are {data}"
    return f"in {source.name} it changes no column by more than {moves:.1%} of its range"


def _axis(scene: Scene, path: str) -> str:
    """Text that names both axes if a root spring acts about an axis other than the bending axis; otherwise ""."""
    diagonal = 0.7  # axes differ if the cosine of their angle is at most this; at 45° both are bending axes
    parts = parts_of(path)
    if len(parts) != 4 or parts[0] != "link" or parts[2] not in {"root_stiffness", "root_damping"} or parts[1] == "*":
        return ""
    link = scene.arm.links[scene.arm.number(int(parts[1]) if parts[1].isdigit() else parts[1]) - 1]
    bent = _bending(link)
    if not bent or max(abs(float(axis["xyz".index(parts[3])])) for axis in bent) > diagonal:
        return ""
    about = " and ".join(map(_named, bent))
    return (
        f"{parts[2]}.{parts[3]} acts about the link's {parts[3]}, but with flex = {link.flex!r} the link bends about "
        f"its {about}: the axes of a section follow the joint axis, or `up`"
    )


def _named(axis: Array) -> str:
    """Name of an axis (x, y or z), or its components if it is none of these."""
    largest = int(np.abs(axis).argmax())
    return "xyz"[largest] if abs(axis[largest]) > 0.999 else str([round(float(part), 3) + 0.0 for part in axis])


def _bending(link: Link) -> list[Array]:
    """Bending axes of a link, in its frame."""
    if link.flex == "rigid":
        return []
    return [link.beam.frame[:, "xyz".index(axis)] for axis in link.flex if axis != "x"]  # x is torsion
