"""What a run costs, counted before it and after it: evaluations times what one takes in the compiled loop."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.describe.data_files import read_toml
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Spec, decode

PRICES = Path(__file__).parent / "data" / "prices.toml"
MICRO = 1e-6


class Rate(Spec, frozen=True):
    """Of one evaluation: `start`, and `body` of a body with 0, 1, … hinges [µs]."""

    start: NonNegative
    body: tuple[NonNegative, ...]

    def seconds(self, bodies: NDArray[np.intp]) -> float:
        """Of a chain with bodies[k] bodies of k hinges [s of CPU]."""
        return MICRO * (self.start + float(np.dot(self.body, bodies[: len(self.body)])))


class Kernel(Spec, frozen=True):
    """Of a compiled loop, for chains in a plane and in space."""

    plane: Rate
    space: Rate


class Prices(Spec, frozen=True):
    """Of explicit stages, and of implicit ones, a pass of Newton's iteration each."""

    explicit: Kernel
    implicit: Kernel

    def evaluation(self, bodies: NDArray[np.intp], *, planar: bool, explicit: bool) -> float:
        """Time of one evaluation [s of CPU] of a chain with bodies[k] bodies of k hinges, k = 0 … 3."""
        kernel = self.explicit if explicit else self.implicit
        return (kernel.plane if planar else kernel.space).seconds(bodies)


@functools.cache
def prices() -> Prices:
    """Those that were measured."""
    return decode(read_toml(PRICES), Prices)


def bodies_of(chain: Chain) -> NDArray[np.intp]:
    """How many bodies have 0, 1, 2, 3 hinges, the tip frame apart, shape (4,)."""
    hinges = (chain.bodies["stop"] - chain.bodies["first"])[:-1]
    return np.bincount(np.minimum(hinges, 3), minlength=4)


def price(chain: Chain, name: str, evaluations: int) -> float:
    """CPU time of so many evaluations by the method of this name [s]."""
    one = prices().evaluation(bodies_of(chain), planar=chain.is_planar, explicit=method(name).explicit)
    return evaluations * one
