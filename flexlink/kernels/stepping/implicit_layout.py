"""Data of an implicit Runge-Kutta step: coefficients of the method, and scratch of a chain."""

from typing import Any, NamedTuple

from flexlink.kernels.tools.numbered import numbered

STAGE = numbered("qdd last_qdd q qd residual divided")  # K, K of the last accepted step, Q, V, R, w
VECTOR = numbered("tau q_middle qd_middle rhs solution")  # vectors (n,)
BUTCHER = numbered("A A2")  # matrices (s, s)
WEIGHT = numbered("b bA c d")


class ImplicitMethod(NamedTuple):
    """Coefficients of a method, eigenvalues and eigenvectors T of A, and weights of the error estimate.

    `real`: real eigenvalues. `pairs`: one eigenvalue of each complex pair.
    """

    A: Any  # (2, s, s) A and A²
    weights: Any  # (4, s) b, b A, c and d
    γ: Any  # the real eigenvalue; 0: the method has no error estimate
    real: Any
    T_real: Any
    Tinv_real: Any
    pairs: Any
    T_pairs: Any
    Tinv_pairs: Any
    dense: Any  # (2, s, s) coefficients of the polynomials β_i / x and α_i / x²


class Turning(NamedTuple):
    """Scratch for the d joints that stop or reverse, as many as fit; arrays (s d,) are ordered by stage."""

    dry: Any  # all joints with dry friction, except prescribed joints
    joints: Any  # (d,)
    count: Any  # (1,) d
    G: Any  # (s d, s d)
    J: Any  # (s d, s d)
    rows: Any  # (5, s d)
    probe: Any  # (3, s d)
    real: Any  # (r, d, n) responses of all joints to torques at the d joints, for every real eigenvalue
    pairs: Any  # (p, d, n) the same for the complex eigenvalues


class ImplicitWork(NamedTuple):
    """Scratch of `implicit_step`, and the constants of a chain."""

    method: ImplicitMethod
    chain: Any
    inverse: Any  # scratch of inverse dynamics
    forces: Any  # force elements; None for a plain chain
    posture: Any
    stepper: Any  # a `STEPPER`
    new: Any  # (3, n) q, q̇, q̈ at the end of the step
    stages: Any  # (6, s, n)
    power: Any  # (s,)
    vectors: Any  # (5, n)
    springs: Any  # see `error_norm`
    saturation: Any  # see `saturation`
    factors: Any  # (r, n, 8)
    pairs: Any  # (2, n) complex
    factors_pairs: Any  # (p, n, 8) complex
    stage_postures: Any  # a posture whose arrays have a leading dimension s
    stage_factors: Any  # (s, n, 8)
    turning: Turning
    ties: Any = None  # see `ties`; None: an open chain
