"""Other units: every solver computes a similar arm, so that stored numbers are of no use to it.

With other units of length, mass and time, all values of a case change, and its answer follows exactly.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, get_type_hints

import numpy as np

from flexarm_bench.case import Array, Case

LARGEST = 2.0  # factor between the old and the new units, at most


@dataclass(frozen=True)
class Units:
    """New units in terms of the old ones; `load` is a factor on the loads of a buckling case."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0
    load: float = 1.0

    @classmethod
    def drawn(cls, seed: int) -> Units:
        """Random units."""
        return cls(*np.exp(np.random.default_rng(seed).uniform(-1, 1, 4) * np.log(LARGEST)).tolist())

    def similar(self, case: Case) -> Case:
        """The case in these units."""
        new: Case = self._converted(case)
        if case.ask != "buckling":
            return new
        loads: dict[str, Any] = {
            name: tuple(self.load * x for x in getattr(new, name)) for name in ("gravity", "force", "moment")
        }
        return dataclasses.replace(new, **loads)

    def back(self, case: Case, values: Array) -> Array:
        """The answer to `similar(case)` in the units of `case`."""
        factor = {
            "statics": self.length, "motion": self.length, "frequencies": 1 / self.time, "buckling": self.load,
        }[case.ask]  # fmt: skip
        return values * factor

    def _converted(self, value: Any, dimension: Any = None) -> Any:
        if isinstance(value, tuple):
            return tuple(self._converted(each, dimension) for each in value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            kinds = get_type_hints(type(value), include_extras=True)
            dimensions = {name: getattr(kind, "__metadata__", (None,))[0] for name, kind in kinds.items()}
            return type(value)(**{name: self._converted(getattr(value, name), dimensions[name]) for name in kinds})
        if dimension is None:
            return value
        units = np.array([self.length, self.mass, self.time])
        return value / float(np.prod(units ** np.array(dimension)))
