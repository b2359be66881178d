"""A run's fixed step against the largest stable one, before the run starts."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import UnstableStepError
from flexlink.common.types import Array
from flexlink.describe.conditions import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.stability import eigenvalue_bound, fastest_eigenvalues, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.inputs.drives import gains_of
from flexlink.inputs.tip_wrench import wrench_at
from flexlink.kernels.inputs.record import Inputs


def judge_step(scene: Scene, chain: Chain, q: Array, qd: Array, inputs: Inputs) -> tuple[str, ...]:
    """Check the fixed step against the largest stable one about the initial state; a warning where the run insists.

    Raises
    ------
    UnstableStepError
        The step is beyond it, and `run.unstable` does not allow it.
    """
    run = scene.run
    if run.duration == 0 or not steps_explicitly(run):
        return ()
    wrench, frame = wrench_at(inputs, scene.initial.time)
    gains = gains_of(chain, inputs.drive, scene.initial.time, q, qd)
    acting: Any = {"tip_wrench": wrench, "frame": frame, "gains": gains}
    if run.step * eigenvalue_bound(chain, q, qd, **acting) <= stable_half_disc(method(run.method)):
        return ()
    λ = fastest_eigenvalues(chain, q, qd, **acting)
    largest = stable_step_of(λ, run.method)
    if run.step <= largest:
        return ()
    reason = (
        f"run.step = {run.step:g} s: more than {largest:.3g} s, the largest stable step of {run.method} at the start "
        f"of {scene.name!r} (fastest eigenvalue {np.abs(λ).max():.4g} 1/s)"
    )
    if run.unstable == "refuse":
        raise UnstableStepError(
            f"{reason}; take a smaller step, or allow this one: unstable = 'allow' (--insist)", largest
        )
    return (f"{reason}; allowed by unstable = 'allow'",)
