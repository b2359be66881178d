"""Data carried from step to step of an adaptive run: numbers of the stepper, and counts."""

from flexlink.kernels.tools.numbered import numbered

STEPPER = numbered(
    "time step",  # t, and the next h
    "last_step last_error",  # length of the last accepted step, and its error / tolerance; 0: cleared
    "max_step",  # largest h after the iteration failed; 0: no limit
    "refusal",  # why the last step was rejected, a `REFUSAL`; 0: it was accepted
    "accepted",  # 1 if the last stages belong to an accepted step
    "worst_joint",  # the joint that moved most in the last iteration
    "deflection",  # largest deflection so far [m]
    "inverse_ω1",  # 1 / ω₁ [s], ω₁ the lowest frequency
    "max_iterations",  # limit for one step
    "rounding",  # displacement of a body by rounding in one iteration [m]
    "work power",  # W and power at the end of the step just taken
    "contraction displacement",  # contraction factor (0: unknown), displacement of a body by the pass before [m]
    "by_stage stay",  # remaining steps with stage matrices; their initial number, minus later steps without them
    "wait patience",  # failures to wait for before the next trial of stage matrices: remaining, and initial number
    "turning",  # factor of the error of a step with friction's nonlinear law; 0: friction is linearized; inf: no error
    "angle_travelled",  # path of all free joints, in both directions [rad]
    "switch",  # time at which a motor saturates or desaturates in the next step [s]; 0: unknown
    # of the last error norm: the rate of displacement that lasts [m/s], displacement by what a sampled law reads [m];
    # over all steps: the sum of the former, and of their displacements since then; the sum of the latter
    "drift kick drifting drifted kicked",
    "coast",  # time after which an error of the rates lasts [s]; 0: springs or a drive hold all joints
    "read",  # factor of the displacement by what a sampled law reads in the error of a step
    "far",  # angle of a free base that requires new coordinates [rad]; 0: the base is fixed
    # counts of operations besides evaluations, for the cost: restarts; factorizations of the linear systems; stage
    # matrices, and solutions with them; error norms of rates for one time τ; responses to the friction of a joint that
    # stops or reverses, and multiplications in the small system of these joints
    "begun prepared stage_matrices stage_solutions weighed answers multiplications",
)
COUNT = numbered(
    "steps rejected failed",  # accepted; rejected for the error; rejected because the iteration failed
    "iterations besides",  # of this method; other evaluations: by earlier methods, for dense output
    "knot row",  # indices of the next knot and of the next sample
)
SO_FAR = numbered("deflection", "steps rejected failed iterations besides", "drifted kicked")
"""Record with each sample: the largest deflection [m], the counts, and the sums of errors, up to the step that contains
the sample."""
REFUSAL = numbered("none error iteration")
"""Why a step was rejected: it was not, its error was too large, or the iteration did not converge."""
