"""Whether an array holds only finite numbers: one pass, no temporary."""

from flexlink.kernels.tools.compiler import entry
from flexlink.kernels.tools.lanes import all_zero, at, zero_of


@entry
def is_finite(a):
    """True if no element of `a`, (n,) or eight side by side (n, 8), is nan or infinite."""
    first = second = third = fourth = zero_of(a)  # four sums: each addition waits for the one before it
    whole = len(a) - len(a) % 4
    for k in range(0, whole, 4):
        first += at(a, k) - at(a, k)  # 0 if finite, nan otherwise
        second += at(a, k + 1) - at(a, k + 1)
        third += at(a, k + 2) - at(a, k + 2)
        fourth += at(a, k + 3) - at(a, k + 3)
    for k in range(whole, len(a)):
        first += at(a, k) - at(a, k)
    return all_zero((first + second) + (third + fourth))
