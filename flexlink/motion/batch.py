"""simulate_many(scenes): members of one layout side by side, eight in one pass of the compiled loop.

Those with a tolerance run one by one: the lengths of their steps, and so the matrices that they factor, are their own;
a step that one of eight refuses would hold up seven; and all their steps are but 15 to 30 % of what they cost, measured
with ten joints, Radau5, 1e-4 m, 0.1 to 1 s.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from flexlink.chain.arguments import integer, require_each
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.common.memo import Kept
from flexlink.describe.scene import Scene
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.budget import warn
from flexlink.motion.inputs.problem import problems_of
from flexlink.motion.inputs.step_check import judge_steps
from flexlink.motion.side_by_side import Block, Ended, Member, Run, alike, goes_along
from flexlink.motion.single_run import SingleRun
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError
from flexlink.results.trajectory import Trajectory

Outcome = Ended | FlexlinkError


def simulate_many(scenes: Sequence[Scene], *, threads: int = 1) -> list[Trajectory]:
    """Simulate many scenes; neighbours in the list that are alike run eight side by side.

    Alike are scenes that differ in initial state, dimensions, materials and gravity only: same layout of bodies and
    hinges, same drive, motion, wrench, constant in frame 0, and run settings, with dynamics "articulated", and with a
    drive that neither is sampled nor knows the rigid arm. Others run one by one. The numbers are those of single runs,
    and so are the judgements.

    Parameters
    ----------
    scenes
        The scenes.
    threads
        Number of threads that share the work.

    Returns
    -------
    list of Trajectory
        In the order of the scenes.

    Raises
    ------
    ArgumentError
        `scenes` holds something that is no Scene, or `threads` is no whole number of at least 1.
    UnstableStepError
        The step of a member is larger than its largest stable one; unstable = "allow" insists.
    DivergenceError
        A member diverged, as in `simulate`; the error's `runs` holds all runs, that member's up to there.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `runs` holds all runs as far as they went.

    Examples
    --------
    >>> scenes = [scene.varied({"tip.mass": mass, "run.duration": 0.2}) for mass in (2.0, 4.0, 6.0)]
    >>> print([f"{run.tip[-1, 1]:.2f}" for run in fl.simulate_many(scenes, threads=2)])  # m
    ['0.34', '0.32', '0.29']
    """
    scenes, threads = require_each("scenes", scenes, Scene), integer("threads", threads, 1)
    with deferred() as stop:
        members = []
        for member in prepared(scenes):
            if isinstance(member, FlexlinkError):
                raise member
            members.append(member)
        with ThreadPoolExecutor(threads) as pool:
            blocks = pool.map(lambda block: _simulated(block, Kept(), stop), list(_blocks(members)))
            ends = [_ended(end) for block in blocks for end in block]
        runs = [end if isinstance(end, Trajectory) else end.trajectory for end in ends]
        for kind in (InterruptedRunError, DivergenceError):
            for end in ends:
                if isinstance(end, kind):
                    end.runs = runs
                    raise end
    return runs


def outcomes(scenes: Sequence[Scene], stop: Stop, *, compared: int | None = None) -> list[Outcome]:
    """What becomes of every scene, of those that are refused, too; neighbours that are alike run side by side.

    The numbers of one do not depend on which others there are, to the bit. As many as `compared`, the first ones, are
    compared with verification runs where their steps call for it; None: all.
    """
    ends = ends_of(scenes, stop, compared=compared)
    return [end.trajectory() if isinstance(end, Run) else end for end in ends]


def ends_of(scenes: Sequence[Scene], stop: Stop, *, compared: int | None = None) -> Iterator[Run | Outcome]:
    """`outcomes`, in whose place those that passed every look beside others stand in their blocks."""
    members = prepared(scenes, compared)
    kept, before = Kept(), None
    ends: deque[Run | Outcome] = deque()
    blocks = _blocks(member for member in members if isinstance(member, Member))
    for member in members:
        if isinstance(member, FlexlinkError):
            yield member
            continue
        if not ends:
            block = next(blocks)
            first = block[0]
            if before is None or not (first.along and before.along and alike(before.problem, first.problem)):
                kept, before = Kept(), first
            ends += _simulated(block, kept, stop)
        yield ends.popleft()


def prepared(scenes: Sequence[Scene], compared: int | None = None) -> list[Member | FlexlinkError]:
    """The problems of all scenes, their steps judged, and what is refused; `compared` as in `outcomes`."""
    most = len(scenes) if compared is None else compared
    problems = problems_of(scenes)
    good = [problem for problem in problems if isinstance(problem, InitialValueProblem)]
    judged = iter(judge_steps(good))
    members: list[Member | FlexlinkError] = []
    for number, problem in enumerate(problems):
        if isinstance(problem, FlexlinkError):
            members.append(problem)
        else:
            warnings = next(judged)
            if isinstance(warnings, FlexlinkError):
                members.append(warnings)
            else:
                members.append(Member(problem, warnings, goes_along(problem), number < most))
    return members


def _blocks(members: Iterable[Member]) -> Iterator[list[Member]]:
    block: list[Member] = []
    for member in members:
        if block and not (member.along and len(block) < LANES and alike(block[0].problem, member.problem)):
            yield block
            block = []
        block.append(member)
        if not member.along:
            yield block
            block = []
    if block:
        yield block


def _simulated(members: Sequence[Member], kept: Kept, stop: Stop) -> Sequence[Run | Outcome]:
    """Also one alone goes in lanes: its numbers are those that it has beside any others."""
    if not members[0].along:
        return [_alone(members[0], stop)]
    try:
        block = Block(members, kept)
    except (MemoryError, ValueError):  # ValueError: more than numpy can count
        return [_alone(member, stop) for member in members]
    if block.integrate(stop):
        return block.ends(stop)
    if len(members) == 1:  # it diverges; it says so itself
        return [_alone(members[0], stop)]
    return [end for member in members for end in _simulated([member], Kept(), stop)]


def _ended(end: Run | Outcome) -> Ended:
    """How a run ended; the error of one that did not start is raised."""
    if isinstance(end, Run):
        return end.trajectory()
    if isinstance(end, FlexlinkError) and not isinstance(end, DivergenceError | InterruptedRunError):
        raise end
    return end


def _alone(member: Member, stop: Stop) -> Outcome:
    try:
        run = SingleRun(member.problem, warnings=member.warnings)
        return run.finish(stop, compared=member.compared, warn=warn)
    except (FlexlinkError, InterruptedRunError) as error:
        return error
