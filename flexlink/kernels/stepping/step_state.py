"""What goes from step to step of a run with steps of any length: numbers of its clock, and counts."""

TIME, STEP, LAST, ERROR, CEILING, REFUSED, ACCEPTED, WORST = range(8)
# t and the next h; length of the last accepted step and its error as a part of what it may be (0: nothing is
# remembered); largest h after the iteration failed (0: any); why the last step was refused (0: it was not); whether the
# last stages are those of an accepted step; the joint that moved most in the last iteration.

DEFLECTION, SLOWEST, PASSES, ROUNDING, WORK, POWER, CONTRACTION, MOVED, TURNED, CLOCK_SIZE = range(8, 18)
# The largest deflection so far [m]; 1 / ω₁ [s], ω₁ the lowest frequency; most iterations, and what rounding
# moves a body by in one [m]; of the step that was just taken the work up to its end, the power there, and by how much
# its iteration contracted (0: not known) after a pass that moved a body so far [m]; the angle that all free joints
# went through, forth and back [rad].

TAKEN, REJECTED, FAILED, ITERATIONS, KNOT, ROW, PATIENCE, COUNTS = range(8)
# Steps, steps refused for their error and for their iteration, passes of it, numbers of the next knot and sample; how
# many iterations may fail before Python is asked.

TOO_FAR_OFF, NOT_SOLVED = 1.0, 2.0
# Why a step was refused: for its error, and for an iteration that did not end.
