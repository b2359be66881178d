"""What a step of an implicit Runge-Kutta method works on: coefficients of the method, scratch of a chain."""

from typing import Any, NamedTuple

from flexlink.kernels.tools.numbered import numbered

STAGE = numbered("qdd last_qdd q qd residual divided")  # K of all stages, that of the last accepted step, Q, V, R, w
VECTOR = numbered("tau q_middle qd_middle rhs solution")  # of all joints
BUTCHER = numbered("A A2")  # of stages: A and A²
WEIGHT = numbered("b bA c d")


class ImplicitMethod(NamedTuple):
    """Coefficients of a method, its eigenvalues with their vectors, and the weights of its error."""

    A: Any  # (2, s, s) A and A²
    weights: Any  # (4, s) b, b A, c and d
    γ: Any  # the real eigenvalue; 0: no error is estimated
    real: Any
    T_real: Any
    Tinv_real: Any
    pairs: Any
    T_pairs: Any
    Tinv_pairs: Any
    dense: Any  # (2, s, s) of x: coefficients of β_i / x and of α_i / x²


class Turning(NamedTuple):
    """Joints that turn round in a step, d of them, at most as many as there is room for; s d numbers stage by stage."""

    dry: Any  # all joints with dry friction that are not prescribed
    joints: Any  # (d,)
    count: Any  # (1,) d
    G: Any  # (s d, s d)
    J: Any  # (s d, s d)
    rows: Any  # (5, s d)
    probe: Any  # (3, s d)
    real: Any  # (r, d, n) answers of all joints to torques at these, for every eigenvalue
    pairs: Any  # (p, d, n) complex


class ImplicitWork(NamedTuple):
    """Scratch of `implicit_step`, with the constants of a chain."""

    method: ImplicitMethod
    chain: Any
    inverse: Any  # scratch of inverse dynamics
    forces: Any  # force elements; None of a plain chain
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
