"""What goes from step to step of a run with steps of any length: numbers of its stepper, and counts."""

from flexlink.kernels.tools.numbered import numbered

STEPPER = numbered(
    "time step",  # t, and the next h
    "last_step last_error",  # of the last accepted one, its error as a part of what it may be; 0: none is remembered
    "max_step",  # largest h after the iteration failed; 0: any
    "refusal",  # why the last step was refused, a `REFUSAL`; 0: it was not
    "accepted",  # whether the last stages are those of an accepted step
    "worst_joint",  # that moved most in the last iteration
    "deflection",  # the largest so far [m]
    "inverse_ω1",  # 1 / ω₁ [s], ω₁ the lowest frequency
    "max_iterations",  # of one step
    "rounding",  # what it moves a body by in one iteration [m]
    "work power",  # up to the end of the step that was just taken, and there
    "contraction displacement",  # of its iteration (0: not known), after one that moved a body so far [m]
    "by_stage stay",  # steps to come whose stages have matrices of their own; as many as there were, less others since
    "wait patience",  # failures before the next trial of such steps, from now on and after the last one
    "turning",  # by which the error counts of a step in which friction has its own law; 0: it has a slope
    "angle_travelled",  # by all free joints, forth and back [rad]
    "switch",  # when a motor reaches its largest torque, or leaves it, in the step to come [s]; 0: not known to
    "far",  # by which a free base may turn until its steps go on in other coordinates [rad]; 0: it is fixed
    # what steps did beside evaluations, by which their cost is told: began anew; prepared their linear systems;
    # matrices of single stages, and solutions with these; times that it was told how far an error of rates gets in a
    # time τ; answers to the friction of a joint that turns round, and multiplications in the small system of those
    "begun prepared stage_matrices stage_solutions weighed answers multiplications",
)
COUNT = numbered(
    "steps rejected failed",  # taken; refused for their error, and for their iteration
    "iterations besides",  # by this method; evaluations besides: by other ones before, of dense output
    "knot row",  # numbers of the next knot and sample
)
SO_FAR = numbered("deflection", "steps rejected failed iterations besides")
"""What is noted with each sample: the largest deflection [m], and counts, up to the step that passes it."""
REFUSAL = numbered("none error iteration")
"""Why a step was refused: not at all; for its error; for an iteration that did not end."""
