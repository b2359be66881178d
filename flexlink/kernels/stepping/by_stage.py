"""When the stages of a step have matrices of their own (see `newton`): only where one for all is not enough.

A step whose iteration does not converge is tried again with them. They stay for eight steps, for twice as many and more
where their end is soon followed by the next failure. If two steps in a row fail in spite of them, they end, and the
next trial comes after twice as many failures.
"""

from flexlink.kernels.stepping.step_state import REFUSAL, STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion


@recursion
def tried_again(stepper):
    """Whether a step that failed is tried again as it is, with matrices of its stages."""
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
    """A step was taken, after so many iterations; where they were many, the next ones have matrices of their stages."""
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
    """From now on for some steps."""
    fewest = 8.0
    stepper[STEPPER.stay] = 2.0 * stepper[STEPPER.stay] + fewest
    stepper[STEPPER.by_stage] = stepper[STEPPER.stay]
    stepper[STEPPER.contraction] = 0.0
