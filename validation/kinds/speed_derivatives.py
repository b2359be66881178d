"""Time of exact derivatives, ∂q̈/∂(q, q̇, T_EX) and ∂τ/∂(q, q̇, q̈), compared with Pinocchio called from Python."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.chain.lumping import lump
from validation.case import Case, Measured
from validation.speed import evaluations, races
from validation.speed.families import timed_states
from validation.speed.races import Races

TIMED = True

Settings = Races
rehearsal = races.rehearsal


def run(case: Case, settings: Races) -> Iterator[Measured]:
    """Yield flexlink's times, and the ratios of Pinocchio's times to them, with Pinocchio's fastest joint type."""
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        for found in settings.run(name, chain.n, evaluations.derivatives(chain, timed_states(chain))):
            ours, *forms = found.seconds
            fastest = min(forms, key=found.seconds.__getitem__)
            what, ratio = f"{name} {found.job}", found.times_less(ours, fastest)
            yield Measured(f"{what}: pinocchio / public", ratio, "", fastest, found.facts, timed=True)
            yield Measured(f"{what}: public call", 1e6 * found.seconds[ours], varied=found.facts, timed=True)
