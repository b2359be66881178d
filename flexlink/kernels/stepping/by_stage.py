"""Decide when each stage of a step uses a separate matrix (see `newton`): only if one matrix for all stages fails.

A step whose iteration does not converge is repeated with stage matrices. They are used for eight steps, and for up to
24 steps if the next failure follows soon after. If two attempts in a row fail in spite of stage matrices, these are
switched off, and the number of failures before the next trial about doubles.
"""

from flexlink.kernels.stepping.step_state import REFUSAL, STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion


@recursion
def tried_again(stepper):
    """Whether a failed step is repeated at the same length, with stage matrices."""
    if stepper[STEPPER.by_stage] > 0.0:
        if stepper[STEPPER.refusal] != REFUSAL.none:
            stepper[STEPPER.by_stage] = stepper[STEPPER.stay] = 0.0
            stepper[STEPPER.patience] = 2.0 * stepper[STEPPER.patience] + 1.0
            stepper[STEPPER.wait] = stepper[STEPPER.patience]
        return False
    if stepper[STEPPER.wait] > 0.0:
        stepper[STEPPER.wait] -= 1.0
        return False
    begin(stepper)
    return True


@recursion
def count_step(iterations, stepper):
    """Count an accepted step; after more than nine iterations, the next steps use stage matrices."""
    many = 9
    if stepper[STEPPER.by_stage] > 0.0:
        stepper[STEPPER.by_stage] -= 1.0
        if stepper[STEPPER.by_stage] == 0.0:
            stepper[STEPPER.patience] = stepper[STEPPER.contraction] = 0.0
    else:
        stepper[STEPPER.stay] = max(0.0, stepper[STEPPER.stay] - 1.0)
        if iterations > many and stepper[STEPPER.wait] == 0.0:
            begin(stepper)


@inlined
def begin(stepper):
    """Switch stage matrices on for the next steps."""
    fewest = 8.0
    stepper[STEPPER.stay] = 2.0 * stepper[STEPPER.stay] + fewest
    stepper[STEPPER.by_stage] = stepper[STEPPER.stay]
    stepper[STEPPER.contraction] = 0.0
