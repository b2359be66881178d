"""What the removal of redundant operations gains: the kernels of a plane beside those of space, on the same arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from msgspec.structs import replace

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.spec import Spec
from flexlink.dynamics import rounding
from flexlink.kernels import forward
from flexlink.reporting.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.timing import loops
from validation.timing.families import Family, States, timed_states
from validation.timing.stopwatch import Work, race

TIMED = True

PLANE, SPACE = "plane", "space"
RNE, FORWARD = "inverse dynamics", "forward dynamics"


class Settings(Spec, frozen=True):
    """A family of plane chains, and how often and how long [s] each kernel runs."""

    chain: Family
    turns: int = 40
    turn: float = 0.0003


def rehearsal(settings: Settings) -> Settings:
    """The shortest chain, once."""
    return replace(settings, chain=replace(settings.chain, segments=settings.chain.segments[:1]), turns=1, turn=0.0)


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Times of both kernels of both algorithms, how far apart their torques are, and the smallest gain of each."""
    gains: dict[str, list[float]] = {RNE: [], FORWARD: []}
    for segments in settings.chain.segments:
        chain = lump(settings.chain.scene(case, segments))
        states = timed_states(chain)
        laps = race(_works(chain, states), settings.turns, settings.turn)
        for (job, kernel), lap in laps.items():
            facts: Facts = {"job": job, "form": kernel, "n": chain.n}
            yield Measured("time", 1e6 * lap.seconds, varied=facts, timed=True)
        yield Measured("apart", _apart(chain, states), varied={"n": chain.n})
        for job, found in gains.items():
            found.append(laps[job, SPACE].seconds / laps[job, PLANE].seconds)
            yield Measured("gain", found[-1], varied={"job": job, "n": chain.n}, timed=True)
    least = {job: min(found) for job, found in gains.items()}
    yield Measured("claim", least[RNE], note=_verdict(least), timed=True)


def _works(chain: Chain, states: States) -> dict[tuple[str, str], Work]:
    q, qd, tau, qdd = states
    plane, space = forward.PLANAR.workspace(chain.arrays), forward.ARTICULATED.workspace(chain.arrays)
    return {
        (RNE, PLANE): lambda calls: loops.planar_rne_loop(plane, q, qd, qdd, calls),
        (RNE, SPACE): lambda calls: loops.rne_loop(chain.arrays, q, qd, qdd, calls),
        (FORWARD, PLANE): lambda calls: loops.forward_dynamics_loop(plane, q, qd, tau, calls),
        (FORWARD, SPACE): lambda calls: loops.forward_dynamics_loop(space, q, qd, tau, calls),
    }


def _apart(chain: Chain, states: States) -> float:
    """Difference of T_GC of a state, over what rounding explains."""
    q, qd, rest = states.q[:1], states.qd[:1], np.zeros((1, chain.n))
    plane = loops.planar_rne_loop(forward.PLANAR.workspace(chain.arrays), q, qd, rest, 1)
    difference = np.abs(plane - loops.rne_loop(chain.arrays, q, qd, rest, 1)).max()
    return float(difference / rounding.of_bias_torque(chain, q[0], qd[0]))


def _verdict(least: Mapping[str, float]) -> str:
    said = ", ".join(f"at least {number(gain, 2)} times less in {job}" for job, gain in least.items())
    return f"holds: {said}" if min(least.values()) > 1.0 else f"does not hold: {said}"
