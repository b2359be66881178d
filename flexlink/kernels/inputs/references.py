"""What is given in time as piecewise polynomials, and where a drive is to lead its joints by them.

On piece i, from knot i to the next, value = Σ_j c_ij x^j with x = t − knot_i; before the first knot x = 0, and the last
piece goes on for ever.
"""

from flexlink.kernels.tools.compiler import entry, recursion


@recursion
def locate(knots, first, stop, t):
    """Number of the piece that holds time t, among pieces first … stop − 1, by bisection."""
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

    `ref`: knots (m,) and coefficients (m, p + 1, d). The piece is that of the `middle` of the step that t belongs to: a
    stage at the end of the step does not see what follows, be it a jump or another acceleration, and one before a knot
    within the step sees what follows, so that the step's own polynomial is smooth.
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
