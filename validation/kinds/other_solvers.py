"""Whole motions by solvers that share no code with flexlink's integrators: SciPy's, and CVODE where installed.

The witness runs twice; how far its two tips are apart bounds the error of the coarser run, and so, amply, that of the
finer, which is compared. A run of ours may be off by ten times its tolerance, the project's limit for the error at the
end, and the witness by what was seen:

    apart / (10 tolerance + |coarse − fine|) ≤ 1
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from flexlink.common.errors import MissingDependencyError
from flexlink.describe.spec import Positive, Spec
from flexlink.motion.simulate import simulate
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.trade.first_order import FirstOrder
from validation.trade.scenes import trade_scene

ALLOWED_TOLERANCES = 10.0  # of its tolerance that an error may be at the end, at worst

LONG = True


class Witness(Spec, frozen=True):
    """A solver of others, and its two relative tolerances, the coarser first."""

    solver: Literal["Radau", "BDF", "LSODA", "DOP853", "CVODE"]
    relative: tuple[Positive, Positive]
    needed: bool = True  # a witness that is not is left out, and told, where it is not installed


def run(case: Case, scene: dict[str, tuple[Witness, ...]], methods: dict[str, Positive]) -> Iterator[Measured]:
    """Distances of tips in units of the allowed error, and the error estimate of each solver.

    `scene` are the witnesses of scenes of the trade by name, `methods` our methods with their tolerances [m].
    """
    left_out = ""
    for name, witnesses in scene.items():
        trade = trade_scene(name)
        ours = {method: simulate(trade, method=method, tolerance=ε).tip for method, ε in methods.items()}
        form = FirstOrder(trade)
        for witness in witnesses:
            try:
                coarse, fine = (form.by(witness.solver, relative).tip for relative in witness.relative)
            except MissingDependencyError as error:
                if witness.needed:
                    raise
                left_out = str(error)
                continue
            own = largest_distance(coarse, fine)
            yield Measured("witness, its two runs apart", own, name, witness.solver)
            for method, tip in ours.items():
                allowed = ALLOWED_TOLERANCES * methods[method] + own
                facts: Facts = {"method": method, "tolerance": methods[method]}
                yield Measured(
                    "tip apart / allowed", largest_distance(tip, fine) / allowed, name, witness.solver, facts
                )
    yield Measured("witnesses left out", float(bool(left_out)), note=left_out)
