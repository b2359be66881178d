"""Which joint of one record is which of another: by name, else by the order from base to tip."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.engines.read_back import ACTUATORS, OF_BODIES, OF_JOINTS, OF_LINES, Indices, ReadBack

PARALLEL = 1e-6


class Match(NamedTuple):
    """Their joints as ours.

    Attributes
    ----------
    order
        Their joint for each of ours, in the engine's numbers, shape (n,).
    places
        Where along their chain, from 0, each of our joints stands, shape (n,); None where their chain branches.
    record
        Their record with our names and order, what the file does not say taken from ours. Its bodies are those at the
        same place along the chain, so that joints in another order at one point leave them alone.
    by_name
        Whether the names are the same.
    """

    order: Indices
    places: Indices | None
    record: ReadBack
    by_name: bool

    @property
    def moved(self) -> list[str]:
        """Names of joints that hang elsewhere along their chain."""
        names = self.record.names
        return list(names) if self.places is None else [names[k] for k, place in enumerate(self.places) if k != place]

    @property
    def serial(self) -> tuple[ReadBack, Indices] | None:
        """The record with the joints as they hang, base first, and which of ours each is; None where they branch."""
        if self.places is None:
            return None
        joints = np.argsort(self.places)
        fields: dict[str, Any] = {field: getattr(self.record, field)[joints] for field in (*OF_LINES, *OF_JOINTS)}
        return dataclasses.replace(self.record, names=tuple(self.record.names[k] for k in joints), **fields), joints


def matched(ours: ReadBack, theirs: ReadBack) -> Match | str:
    """The match, or in words why there is none."""
    by_name = sorted(ours.names) == sorted(theirs.names)
    sequence = _from_base_to_tip(theirs)
    if by_name:
        number = {name: k for k, name in enumerate(theirs.names)}
        order = np.array([number[name] for name in ours.names], dtype=np.intp)
    elif ours.n != theirs.n:
        return _other_joints(ours, theirs)
    elif sequence is None:
        return f"the joints have other names, and the chain branches at joint {theirs.names[_branch(theirs)]!r}"
    else:
        order = sequence[_turned_groups(ours, theirs.axes[sequence])]
    bodies = order if sequence is None else sequence
    of_joints = (*OF_LINES, "frames", *OF_JOINTS, *ACTUATORS)
    taken: dict[str, Any] = {field: getattr(theirs, field)[order] for field in of_joints}
    taken |= {field: getattr(theirs, field)[bodies] for field in OF_BODIES}
    taken["parts"] = theirs.parts._replace(owner=np.argsort(bodies)[theirs.parts.owner])
    taken |= {field: getattr(ours, field) for field in theirs.unsaid | ours.unsaid if hasattr(ours, field)}
    record = dataclasses.replace(theirs, names=ours.names, before=ours.before, **taken)
    return Match(order, None if sequence is None else np.argsort(sequence)[order], record, by_name)


def _other_joints(ours: ReadBack, theirs: ReadBack) -> str:
    told = f"{theirs.n} joints instead of {ours.n}"
    for words, one, other in (("without", ours, theirs), ("with", theirs, ours)):
        names = [repr(name) for name in one.names if name not in other.names]
        if names:
            told += f", {words} {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
    return told


def _from_base_to_tip(theirs: ReadBack) -> Indices | None:
    behind = {int(before): k for k, before in enumerate(theirs.before)}
    if len(behind) < theirs.n:
        return None
    sequence = [-1]
    while sequence[-1] in behind:
        sequence.append(behind[sequence[-1]])
    return np.array(sequence[1:], dtype=np.intp)


def _branch(theirs: ReadBack) -> int:
    """A joint from which two hang; −1 is the base, and counts as the first joint."""
    held, count = np.unique(theirs.before, return_counts=True)
    return max(0, int(held[count > 1][0]))


def _turned_groups(ours: ReadBack, axes: Array) -> Indices:
    """Our joints' places along their chain, where the joints at one point may stand in another order."""
    places = np.arange(ours.n)
    starts = [k for k in places if k == 0 or not np.array_equal(ours.points[k], ours.points[k - 1])]
    for first, stop in itertools.pairwise([*starts, ours.n]):
        group = places[first:stop]
        for turned in itertools.permutations(group) if len(group) <= 3 else ():
            if _parallel(axes[list(turned)], ours.axes[group]):
                places[group] = turned
                break
    return places


def _parallel(one: Array, other: Array) -> bool:
    return bool(np.abs(np.cross(one, other)).max() <= PARALLEL)
