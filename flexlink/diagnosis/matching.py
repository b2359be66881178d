"""Match the joints of two records by name, else by the bodies they move, else, in a serial chain, by their order."""

import itertools
from collections import Counter
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.diagnosis.mistakes import _names
from flexlink.engines.coordinates import BASE_JOINTS
from flexlink.engines.read_back import ReadBack


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
