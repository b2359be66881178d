"""Read the state of runs after every step, at random, or only at the end; compare all their results."""

import hashlib
import itertools
import random
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion.budget import ChunkSize


def in_every_way(what: Callable[[], Any], seed: str | int) -> list[list[object]]:
    """Digests of the runs, read after every step, at random, or only at the end."""
    dice, found = random.Random(seed), []
    ways = (
        (itertools.repeat(1), lambda: True),
        (iter(lambda: dice.randint(1, 40), 0), lambda: dice.random() < 0.3),
        (itertools.repeat(2**40), lambda: False),
    )
    for sizes, due in ways:
        with pytest.MonkeyPatch.context() as patch:
            look(patch, sizes, due)
            found.append(digests(what))
    return found


def digest(run: fl.Trajectory) -> tuple[object, ...]:
    """All results of a run, with arrays to the bit."""
    arrays = run.t, run.q, run.qd, run.tau, run.tip, run.energy.parts, run.imbalance
    sha = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays))
    return len(run.t), sha.hexdigest(), run.warnings, repr(run.steps)


def digests(what: Callable[[], Any]) -> list[object]:
    """Digests of the runs, of how they ended, and of what was read during the runs."""
    with warnings.catch_warnings(record=True) as words:
        warnings.simplefilter("always")
        try:
            ended = what()
        except fl.errors.DivergenceError as error:
            ended = error
        except fl.FlexlinkError as error:
            return [type(error).__name__, str(error)]
    found: list[object] = [str(word.message) for word in words]
    for each in ended if isinstance(ended, list) else [ended]:
        found += [str(each), digest(each.trajectory)] if isinstance(each, Exception) else [digest(each)]
    return found


def look(patch: pytest.MonkeyPatch, sizes: Iterator[int], due: Callable[[], bool]) -> None:
    """Advance all runs by these numbers of steps in turn; after each piece, read a run if `due()` is true."""

    def start(pace: ChunkSize) -> int:
        pace.size = next(sizes)
        return pace.size

    def end(pace: ChunkSize) -> bool:
        start(pace)
        return due()

    patch.setattr(ChunkSize, "start", start)
    patch.setattr(ChunkSize, "end", end)
    patch.setattr(ChunkSize, "over", property(lambda _pace: due()))
