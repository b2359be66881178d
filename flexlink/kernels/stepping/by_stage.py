"""When each stage of a step gets a separate matrix (see `newton`): only if one matrix for all is not enough.

A step whose iteration does not converge is repeated with one matrix per stage. This mode lasts for eight steps; if the
next failure follows soon after its end, it lasts twice as long the next time. If two steps in a row fail in this mode,
it ends, and is tried again after twice as many failures as before.
"""

from flexlink.kernels.stepping.step_state import REFUSAL, STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion


@recursion
def tried_again(stepper):
    """Whether a failed step is repeated at the same length, with one matrix per stage."""
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
    """Count an accepted step and its iterations; if there were many, use one matrix per stage for the next steps."""
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
    """Use one matrix per stage for some steps."""
    fewest = 8.0
    stepper[STEPPER.stay] = 2.0 * stepper[STEPPER.stay] + fewest
    stepper[STEPPER.by_stage] = stepper[STEPPER.stay]
    stepper[STEPPER.contraction] = 0.0
