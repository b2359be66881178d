"""Whether an array holds only finite numbers: one pass, no temporary."""

from flexlink.kernels.compiler import recursion
from flexlink.kernels.lanes import all_zero, at, zero_of


@recursion
def is_finite(a):
    """True if no element of `a`, (n,) or eight side by side (n, 8), is nan or infinite."""
    total = zero_of(a)
    for k in range(len(a)):
        total += at(a, k) - at(a, k)  # 0 if finite, nan otherwise
    return all_zero(total)
