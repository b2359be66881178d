"""Numbers that were measured with one instrument."""

from __future__ import annotations

import dataclasses

from flexlink.common.types import Array
from flexlink.identification.colour import Colour


@dataclasses.dataclass(frozen=True, eq=False)
class Block:
    """Numbers that were measured with one instrument.

    Attributes
    ----------
    name
        What they are, with the unit; of a run its column.
    y
        The numbers in SI units, shape (n,), finite.
    σ
        Standard deviation of their noise, shape (n,).
    stated
        Whether the problem states it; else it follows from what the fit leaves.
    t
        Times of a run's column [s], shape (n,); None of single numbers, whose noise is independent.
    colour
        How the noise hangs together in time; None of white noise. σ is then the size of its innovations.
    gain, bias
        Whether scale and zero are unknown.
    """

    name: str
    y: Array
    σ: Array
    stated: bool
    t: Array | None = None
    colour: Colour | None = None
    gain: bool = False
    bias: bool = False

    @property
    def unit(self) -> str:
        """Unit of the numbers."""
        return unit_in(self.name)


def unit_in(name: str) -> str:
    """The unit in the name of a column.

    >>> print(unit_in("tip x [m]"))
    m
    """
    return name.rpartition("[")[2].rstrip("]")
