"""Arrays of an implicit step: coefficients of the method, scratch arrays of a chain."""

from typing import Any, NamedTuple

from flexlink.kernels.tools.numbered import numbered

STAGE = numbered("qdd last_qdd q qd residual divided")  # K of the stages, K of the last accepted step, Q, V, R, w
VECTOR = numbered("tau q_middle qd_middle rhs solution")  # one number per joint
BUTCHER = numbered("A A2")  # of the stages: A and A²
WEIGHT = numbered("b bA c d")


class ImplicitMethod(NamedTuple):
    """Coefficients of a method, the eigenvalues and eigenvectors of A, and the weights of the error."""

    A: Any  # (2, s, s) A and A²
    weights: Any  # (4, s) b, b A, c and d
    γ: Any  # the real eigenvalue; 0: no error estimate
    real: Any
    T_real: Any
    Tinv_real: Any
    pairs: Any
    T_pairs: Any
    Tinv_pairs: Any
    dense: Any  # (2, s, s): coefficients of β_i / x and of α_i / x² by powers of x


class Turning(NamedTuple):
    """The d joints that reverse in a step; d has an upper limit. Arrays of s d numbers are ordered by stage."""

    dry: Any  # all joints with dry friction that are not prescribed
    joints: Any  # (d,)
    count: Any  # (1,) d
    G: Any  # (s d, s d)
    J: Any  # (s d, s d)
    rows: Any  # (5, s d)
    probe: Any  # (3, s d)
    real: Any  # (r, d, n) response of all joints to torques at these joints, for every eigenvalue
    pairs: Any  # (p, d, n) complex


class ImplicitWork(NamedTuple):
    """Scratch arrays of `implicit_step`, with the constants of a chain."""

    method: ImplicitMethod
    chain: Any
    inverse: Any  # workspace of inverse dynamics
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
