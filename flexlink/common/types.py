"""Array types by dtype, and a type variable."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from flexlink.common.wording import did_you_mean, short_list, truncated

T = TypeVar("T")
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]


class ByName(dict[str, T]):
    """Values by name; another name is refused by a KeyError with those that there are."""

    def __missing__(self, name: object) -> T:
        known = did_you_mean(name, self) or f"; allowed are {short_list([*self])}"
        raise KeyError(f"{truncated(name)}: unknown{known if self else ', there are none'}")
