"""Time of one evaluation of q̈, RNE, M and T_GC against n: flexlink compiled and from Python, engines from Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from validation.case import Case, Measured
from validation.speed import evaluations, races
from validation.speed.evaluations import FORWARD, RNE
from validation.speed.families import Family, timed_states
from validation.speed.races import Jobs, Race, Races
from validation.store import Series

OURS = ("native", "public")  # kernels in a compiled loop; checked functions called from Python
PLAIN = "revolute joints, local"  # default of `pin.aba` with a chain read from a file
PINOCCHIO, FASTEST = "pinocchio", "pinocchio, fastest"

TIMED = True

Settings = Races
rehearsal = races.rehearsal


def run(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """Yield times, ratios of other programs' times to flexlink's, exponents of n, and a series for every job."""
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        for one in settings.run(name, chain.n, _contestants(chain, family, segments)):
            forms = {form: seconds for form, seconds in one.seconds.items() if form not in (*OURS, "mujoco")}
            form_of = {PINOCCHIO: PLAIN, FASTEST: min(forms, key=forms.__getitem__)} if forms else {}
            seconds = {name: each for name, each in one.seconds.items() if name not in forms}
            found.append(one._replace(seconds=seconds | {name: forms[form] for name, form in form_of.items()}))
            yield from _rows(found[-1], form_of, segments == family.segments[0])
    yield from races.growth(found)


def _contestants(chain: Chain, family: Family, segments: int) -> dict[str, Jobs]:
    """Calls to be timed: native, public, MuJoCo, each form of Pinocchio; beyond the engines' limits only O(n) jobs."""
    states = timed_states(chain)
    found = {"native": evaluations.native(chain, states), "public": evaluations.public(chain, states)}
    if segments <= family.mujoco:
        found["mujoco"] = evaluations.mujoco_calls(chain, states)
    if segments <= family.pinocchio:
        return found | evaluations.pinocchio(chain, states)
    return {name: {job: jobs[job] for job in (FORWARD, RNE)} for name, jobs in found.items()}


def _rows(found: Race, form_of: Mapping[str, str], first: bool) -> Iterator[Measured]:
    what = f"{found.chain} {found.job}"
    if first:
        yield Measured(f"{what}: public call", 1e6 * found.seconds["public"], varied=found.facts, timed=True)
    for name in (name for name in found.seconds if name not in OURS):
        facts = found.facts | ({"form": form_of[name]} if name in form_of else {})
        for our in OURS:
            yield Measured(f"{what}: {name} / {our}", found.times_less(our, name), "", name, facts, timed=True)
