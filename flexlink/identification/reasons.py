"""Why a number has no effect on the data: what it moves in their place, and about which axis it acts."""

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
    """The same directions; those of one number that is not held say what it moves instead."""
    number = {one.name: k for k, one in enumerate(signals.coordinates)}
    return tuple(
        one._replace(why=_why(signals, x, number[one.names[0]]))
        if one.lost and len(one.names) == 1 and one.names[0] in number else one
        for one in directions
    )  # fmt: skip


def _why(signals: Signals, x: Array, k: int) -> str:
    said = [_moves(signals, x, k), _axis(signals.sources[0].scene, signals.coordinates[k].path)]
    return "".join(f"; {part}" for part in said if part)


def _moves(signals: Signals, x: Array, k: int) -> str:
    """What the number moves in the first run in which it counts."""
    count = 2  # columns that are named
    # range, a part of 1 and of its largest number, of a column that stands still: inside a long explicit step rounding
    # of its stages makes 1e-11 rad/s, and a part `moves` of the range counts
    rounded = 1e-6
    moves = 1e-3  # part of the range of columns of one unit
    by = 0.05  # change in the coordinate
    runs = [n for n, one in enumerate(signals.sources)
            if one.is_run and signals.coordinates[k].run in ("", one.name)]  # fmt: skip
    if not runs:
        return ""
    source, beside = signals.sources[runs[0]], x.copy()
    beside[k] += by if x[k] + by < signals.coordinates[k].bounds[1] else -by
    try:
        here, there = (simulate(signals.scene(runs[0], point)).columns for point in (x, beside))
    except FlexlinkError:
        return ""
    names = [name for name in here if name != "t [s]" and unit_in(name) != "J"]
    ranges: dict[str, float] = {}
    for name in names:
        still = rounded * (1.0 + float(np.abs(here[name]).max()))
        ranges[unit_in(name)] = max(ranges.get(unit_in(name), 0.0), still, float(np.ptp(here[name])))
    moved = {name: float(np.abs(there[name] - here[name]).max()) / ranges[unit_in(name)] for name in names}
    measured = {block.name for block in source.blocks}
    free = (name for name in names if moved[name] > moves and name not in measured)
    most = sorted(free, key=lambda name: (name.startswith("q"), -float(f"{moved[name]:.3g}")))  # a beam's hinges last
    data = ", ".join(sorted(measured))
    if most:
        return f"it moves {' and '.join(most[:count])}, the data of {source.name} are {data}"
    return f"in {source.name} it moves nothing by more than {moves:.1%} of its range"


def _axis(scene: Scene, path: str) -> str:
    """Of a spring at a root that is about another axis than the bending: both axes."""
    diagonal = 0.7  # cosine: at 45°, as sections may be turned, both count
    parts = parts_of(path)
    if len(parts) != 4 or parts[0] != "link" or parts[2] not in {"root_stiffness", "root_damping"} or parts[1] == "*":
        return ""
    link = scene.arm.links[scene.arm.number(int(parts[1]) if parts[1].isdigit() else parts[1]) - 1]
    bent = _bending(link)
    if not bent or max(abs(float(axis["xyz".index(parts[3])])) for axis in bent) > diagonal:
        return ""
    about = " and ".join(map(_named, bent))
    return (
        f"{parts[2]}.{parts[3]} is about {parts[3]} of the link, but flex = {link.flex!r} bends it about {about} of "
        "the link: a section's axes follow the joint's, or up"
    )


def _named(axis: Array) -> str:
    """x, y or z where it is one of them, else the axis itself."""
    largest = int(np.abs(axis).argmax())
    return "xyz"[largest] if abs(axis[largest]) > 0.999 else str([round(float(part), 3) + 0.0 for part in axis])


def _bending(link: Link) -> list[Array]:
    """Axes about which a link bends, in its frame."""
    if link.flex == "rigid":
        return []
    return [link.beam.frame[:, "xyz".index(axis)] for axis in link.flex if axis != "x"]  # about x it twists
