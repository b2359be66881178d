"""Time of a call of exact derivatives, ∂q̈/∂(q, q̇, T_EX) and ∂τ/∂(q, q̇, q̈), and of Pinocchio's from Python."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pinocchio as pin

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import growth, pinocchio_models
from validation.speed.evaluations import Jobs, from_python
from validation.speed.families import States, timed_states
from validation.speed.growth import Races
from validation.speed.stopwatch import race

FORWARD, INVERSE = "∂q̈", "∂τ"
OURS = "public"

TIMED = True

Settings = Races
rehearsal = growth.rehearsal


def run(case: Case, settings: Races) -> Iterator[Measured]:
    """Our times, and the ratios of Pinocchio's times, with its fastest joints, to ours."""
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = lump(family.scene(case, segments))
            contestants = parties(chain, timed_states(chain))
            for job in (FORWARD, INVERSE):
                laps = race({party: jobs[job] for party, jobs in contestants.items()}, settings.turns, settings.turn)
                ours = laps.pop(OURS).seconds
                form = min(laps, key=lambda party: laps[party].seconds)
                facts: Facts = {"chain": name, "job": job, "n": chain.n}
                ratio = laps[form].seconds / ours
                yield Measured(f"{name} {job}: pinocchio / public", ratio, "", form, facts, timed=True)
                yield Measured(f"{name} {job}: public call", 1e6 * ours, "", "native", facts, timed=True)


def parties(chain: Chain, states: States) -> dict[str, Jobs]:
    """The contestants by job: flexlink, and Pinocchio with each kind of joints that fits."""
    q, qd, tau, qdd = (list(part) for part in states)
    found = {
        OURS: {
            FORWARD: from_python(lambda s: fl.forward_dynamics_derivatives(chain, q[s], qd[s], tau[s]), len(q)),
            INVERSE: from_python(lambda s: fl.inverse_dynamics_derivatives(chain, q[s], qd[s], qdd[s]), len(q)),
        }
    }
    for name, (model, sign) in pinocchio_models.build_all(chain).items():
        found[name] = _pinocchio(model, [list(part * sign) for part in states])
    return found


def _pinocchio(model: Any, states: list[list[Any]]) -> Jobs:
    (q, qd, tau, qdd), data = states, pin.Data(model)
    return {
        FORWARD: from_python(lambda s: pin.computeABADerivatives(model, data, q[s], qd[s], tau[s]), len(q)),
        INVERSE: from_python(lambda s: pin.computeRNEADerivatives(model, data, q[s], qd[s], qdd[s]), len(q)),
    }
