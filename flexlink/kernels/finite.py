"""Whether an array holds only finite numbers: one pass, no temporary."""

from flexlink.kernels.compiler import kernel


@kernel
def is_finite(a):
    """True if no element of `a` (n,) is nan or infinite."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] - a[k]  # 0 if finite, nan otherwise
    return total == 0.0
