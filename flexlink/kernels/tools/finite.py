"""Whether all numbers of an array are finite, and the largest of them, in one pass without a temporary array."""

from flexlink.kernels.tools.compiler import entry, inlined, recursion
from flexlink.kernels.tools.lanes import LANES, all_zero, at, eight_of, zero_of


@entry
def is_finite(a):
    """True if no element of `a`, (n,) or eight side by side (n, 8), is nan or infinite."""
    first = second = third = fourth = zero_of(a)  # four sums, since each addition waits for the one before
    whole = len(a) - len(a) % 4
    for k in range(0, whole, 4):
        first += at(a, k) - at(a, k)  # 0 if finite, nan otherwise
        second += at(a, k + 1) - at(a, k + 1)
        third += at(a, k + 2) - at(a, k + 2)
        fourth += at(a, k + 3) - at(a, k + 3)
    for k in range(whole, len(a)):
        first += at(a, k) - at(a, k)
    return all_zero((first + second) + (third + fourth))


@recursion
def largest(a):
    """The largest |a_k| of an array (n,), 0 if it is empty; nan if some a_k is not finite."""
    size = 0.0
    for k in range(len(a)):
        size = max(size, abs(a[k])) + (a[k] - a[k])
    return size


@inlined
def are_finite(three):
    """True if no element of three contiguous matrices (n, n) is nan or infinite."""
    a, b, c = three[0].reshape(-1), three[1].reshape(-1), three[2].reshape(-1)
    whole = len(a) - len(a) % LANES
    first = second = third = zero_of(three[0])
    for k in range(0, whole, LANES):
        x, y, z = eight_of(a, k), eight_of(b, k), eight_of(c, k)
        first, second, third = first + (x - x), second + (y - y), third + (z - z)
    rest = 0.0
    for k in range(whole, len(a)):
        rest += (a[k] - a[k]) + (b[k] - b[k]) + (c[k] - c[k])
    return all_zero((first + second) + third) and rest == 0.0
