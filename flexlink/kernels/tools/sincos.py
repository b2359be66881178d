"""Cosine and sine without branches, so loops over many angles are vectorized.

Cody & Waite (1980): x = k π/2 + y + tail with π/2 in three parts of 33 bits, so products with k < 2²⁰ are exact; then
the minimax polynomials of fdlibm (`k_sin.c`, `k_cos.c`, Sun Microsystems 1993) on |y| ≤ π/4. The error is below 1 ulp.
"""

import math

import numpy as np

from flexlink.kernels.tools.compiler import entry, inlined

LIMIT = 1e5  # rad, k < 2¹⁶: well below the limit 2²⁰ for exact products
TWO_OVER_PI = 0.6366197723675814
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)  # 33 bits, 33 bits, remainder

FAR = 4e8  # rad, fewer than 2²⁶ turns: their products with parts of 26 bits are exact
OFTEN = 64.0  # rad; a larger angle costs a sum of angles one digit
TURNS = 0.15915494309189535
TURN = (6.283185243606567, 6.357301884918343e-08, 2.4492935982947064e-16)  # 2π: 26 bits, 26 bits, remainder


@inlined
def cos_sin_reduced(y, tail):
    """cos and sin of y + tail, |y| ≤ π/4, |tail| ≤ ulp(y)."""
    z = y * y
    w = z * z
    v = z * y
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
    s += z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    sine = y - ((z * (0.5 * tail - v * s) - tail) + v * 1.66666666666666324348e-01)
    c = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05))
    c += w * w * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11))
    half = 0.5 * z
    head = 1.0 - half
    cosine = head + (((1.0 - head) - half) + (z * c - y * tail))
    return cosine, sine


@inlined
def cos_sin_bounded(x):
    """cos x, sin x for |x| ≤ LIMIT."""
    k = np.floor(x * TWO_OVER_PI + 0.5)
    first = x - k * HALF_PI[0]  # exact
    second = k * HALF_PI[1]  # exact
    y = first - second
    tail = ((first - y) - second) - k * HALF_PI[2]
    c, s = cos_sin_reduced(y, tail)
    quarter = 0.25 * k - np.floor(0.25 * k)  # 0, ¼, ½, ¾: the quadrant
    odd = quarter == 0.25 or quarter == 0.75  # noqa: PLR1714, a membership test does not vectorise
    cosine, sine = (s, c) if odd else (c, s)
    cosine = -cosine if quarter == 0.25 or quarter == 0.5 else cosine  # noqa: PLR1714
    sine = -sine if quarter >= 0.5 else sine
    return cosine, sine


@entry
def cos_sin_all(x, cosines, sines):
    """Write cos x and sin x of an array, any finite x; return whether some |x| is beyond half of `OFTEN`."""
    for k in range(len(x)):
        cosines[k], sines[k] = cos_sin_bounded(x[k])
    often = False
    for k in range(len(x)):
        if not abs(x[k]) < 0.5 * OFTEN:
            often = True
            if not abs(x[k]) < LIMIT:
                cosines[k], sines[k] = math.cos(x[k]), math.sin(x[k])
    return often


@entry
def less_whole_turns(x):
    """Subtract full turns from the angles beyond `OFTEN` of an array, any finite x, accurate to an ulp of π.

    Sums of angles whose absolute values stay below half of `OFTEN` are not affected, whatever other angles are in the
    array.
    """
    for k in range(len(x)):
        turns = np.floor(x[k] * TURNS + 0.5)
        less = ((x[k] - turns * TURN[0]) - turns * TURN[1]) - turns * TURN[2]
        x[k] = less if OFTEN <= abs(x[k]) < FAR else x[k]
    for k in range(len(x)):
        if not abs(x[k]) < FAR:
            x[k] = math.atan2(math.sin(x[k]), math.cos(x[k]))
