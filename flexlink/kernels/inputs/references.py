"""Piecewise polynomials in time, and the reference motion of a drive.

On piece i, from knot i to the next, value = Σ_j c_ij x^j with x = t − knot_i. Before the first knot x = 0; the last
piece continues without end.
"""

from flexlink.kernels.tools.compiler import entry, recursion


@recursion
def locate(knots, first, stop, t):
    """Index of the piece that contains time t, among pieces first … stop − 1, by bisection."""
    low, high = first, stop
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@entry
def reference(ref, t, middle, d):
    """Value [rad], rate [rad/s] and acceleration [rad/s²] of column `d` of a reference at time t.

    `ref` has knots (m,) and coefficients (m, p + 1, d). All stages of a step use the piece at its `middle`, so the
    polynomial is smooth within the step: a stage at its end ignores a jump there, and if a knot lies inside the step,
    stages on the other side of the knot extrapolate this piece.
    """
    piece = locate(ref.knots, 0, len(ref.knots), middle)
    x, c = t - ref.knots[piece], ref.coefficients[piece]
    if piece == 0:
        x = max(0.0, x)
    value, rate, half_acceleration = 0.0, 0.0, 0.0
    for j in range(len(c) - 1, -1, -1):  # Horner's scheme for the value and its first two derivatives
        half_acceleration = half_acceleration * x + rate
        rate = rate * x + value
        value = value * x + c[j, d]
    return value, rate, 2.0 * half_acceleration
