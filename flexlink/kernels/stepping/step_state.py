"""State of a stepper that is carried from step to step, and counters."""

from flexlink.kernels.tools.numbered import numbered

STEPPER = numbered(
    "time step",  # t, and the next h
    "last_step last_error",  # of the last accepted step; error relative to the allowed one; 0: none
    "max_step",  # largest h after the iteration failed; 0: any
    "refusal",  # why the last step was rejected, a `REFUSAL`; 0: it was not
    "accepted",  # whether the last stages are those of an accepted step
    "worst_joint",  # joint that moved most in the last iteration
    "deflection",  # the largest so far [m]
    "inverse_ω1",  # 1 / ω₁ [s], ω₁ the lowest frequency
    "max_iterations",  # of one step
    "rounding",  # displacement of a body by rounding in one iteration [m]
    "work power",  # up to the end of the last step, and there
    "contraction displacement",  # of its iteration (0: unknown), after one with this displacement of a body [m]
    "by_stage stay",  # coming steps with one matrix per stage; their number at the start, minus other steps since
    "wait patience",  # failures before the next trial of such steps, from now and after the last trial
    "turning",  # factor on the error of a step in which friction has its own iteration; 0: it has none
    "angle_travelled",  # by all free joints, back and forth [rad]
    "switch",  # time when a motor reaches or leaves its maximum torque in the next step [s]; 0: unknown
    "far",  # rotation of a free base after which its steps continue in other coordinates [rad]; 0: fixed
    # operations of steps besides evaluations, which determine their cost: restarts; factorizations of linear systems;
    # matrices of single stages, and solutions with these; propagations of a rate error over a time τ; solutions for
    # the friction of a joint that reverses, and multiplications in the small system of those
    "begun prepared stage_matrices stage_solutions weighed answers multiplications",
)
COUNT = numbered(
    "steps rejected failed",  # accepted; rejected for their error; failed iterations
    "iterations besides",  # of this method; other evaluations: by earlier methods, and for dense output
    "knot row",  # indices of the next knot and sample
)
SO_FAR = numbered("deflection", "steps rejected failed iterations besides")
"""Stored with each sample: the largest deflection [m], and counters, up to the step that contains it."""
REFUSAL = numbered("none error iteration")
"""Why a step was rejected: not at all; for its error; because its iteration did not converge."""
