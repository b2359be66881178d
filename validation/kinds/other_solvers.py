"""Complete motions by solvers that share no code with flexlink's integrators: SciPy's, and CVODE if installed.

The independent solver runs twice. The distance between the tips of both runs bounds the error of the coarser one and,
generously, of the finer one, which is compared. A run of flexlink may have an error of ten times its tolerance, the
project's limit for the final error, and the other solver may have an error equal to that distance:

    distance of flexlink's tip / (10 tolerance + |coarse − fine|) ≤ 1
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

ALLOWED_TOLERANCES = 10.0  # largest accepted final error in units of the tolerance

LONG = True


class Witness(Spec, frozen=True):
    """An independent solver and its two relative tolerances, the coarser first."""

    solver: Literal["Radau", "BDF", "LSODA", "DOP853", "CVODE"]
    relative: tuple[Positive, Positive]
    needed: bool = True  # if False and not installed, the solver is skipped and reported


def run(case: Case, scene: dict[str, tuple[Witness, ...]], methods: dict[str, Positive]) -> Iterator[Measured]:
    """Yield tip distances in units of the allowed error, and the error estimate of each solver.

    `scene` lists independent solvers by scene of the trade study, `methods` flexlink's methods with tolerances [m].
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
