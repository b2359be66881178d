"""simulate_many(scenes): similar scenes run side by side, eight in one pass of the compiled loop.

Runs with a tolerance are simulated one by one. Each has different step lengths, and so different matrices to factorize,
and one rejected step would delay the other seven runs. Besides, steps take only 15 to 30 % of the time of such a run
(measured with ten joints, Radau5, 1e-4 m, 0.1 to 1 s). Those that differ only in initial state are prepared once.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from flexlink.chain.arguments import integer, require_each
from flexlink.chain.lumping import lump_many, open_chain
from flexlink.common.errors import FlexlinkError, or_raise
from flexlink.common.interruption import Stop, deferred
from flexlink.common.memo import Kept
from flexlink.describe.scene import Scene
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.budget import warn
from flexlink.motion.inputs.drives import same_law
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.step_check import check_steps
from flexlink.motion.side_by_side import Block, Ended, Member, Run, alike, fits_lanes
from flexlink.motion.single_run import SingleRun, prepared_run
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError
from flexlink.results.trajectory import Trajectory

Outcome = Ended | FlexlinkError


def simulate_many(scenes: Sequence[Scene], *, threads: int = 1) -> list[Trajectory]:
    """Simulate many scenes; similar scenes that are adjacent in the list run eight at a time, side by side.

    Similar scenes differ only in initial state, dimensions, materials and gravity. They have the same layout of bodies
    and hinges, the same drive, also sampled or with a model of each arm, the same motion, wrench (constant in frame 0)
    and run settings, and `run.solver` "articulated". Others run one by one. Results and checks are as for single runs.

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
        `scenes` contains an item that is not a Scene, or `threads` is not an integer of at least 1.
    UnstableStepError
        A scene's step is larger than its largest stable step; unstable = "allow" overrides this check.
    DivergenceError
        A run diverged, as in `simulate`; the error's `runs` contains all runs, this one up to its last good sample.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `runs` contains all runs up to that point.

    Examples
    --------
    >>> scenes = [scene.varied({"tip.mass": mass, "run.duration": 0.2}) for mass in (2.0, 4.0, 6.0)]
    >>> print([f"{run.tip[-1, 1]:.2f}" for run in fl.simulate_many(scenes, threads=2)])  # m
    ['0.34', '0.32', '0.29']
    """
    scenes, threads = require_each("scenes", scenes, Scene), integer("threads", threads, 1)
    with deferred() as stop:
        members = [or_raise(member) for member in prepared(scenes)]
        with ThreadPoolExecutor(threads) as pool:
            blocks = pool.map(lambda block: _simulated(block, Kept(), stop), [own for own, _ in _blocks(members, 64)])
            ends = [_ended(end) for block in blocks for end in block]
        runs = [end if isinstance(end, Trajectory) else end.trajectory for end in ends]
        for kind in (InterruptedRunError, DivergenceError):
            for end in ends:
                if isinstance(end, kind):
                    end.runs = runs
                    raise end
    return runs


def outcomes(scenes: Sequence[Scene], stop: Stop, *, compared: int | None = None) -> list[Outcome]:
    """Return the outcome of every scene, a run or an error; adjacent similar scenes run side by side.

    Each outcome is bit-identical whatever the other scenes are. Only the first `compared` scenes (None: all) are
    compared with verification runs, if their steps require such a run.
    """
    return [end.trajectory() if isinstance(end, Run) else end for end in ends_of(scenes, stop, compared=compared)]


def ends_of(scenes: Sequence[Scene], stop: Stop, *, compared: int | None = None) -> Iterator[Run | Outcome]:
    """Yield the `outcomes` one by one; if a member passed all checks in its block, yield a `Run` of that block."""
    members = prepared(scenes, compared)
    ends: deque[Run | Outcome] = deque()
    blocks = _blocks(member for member in members if isinstance(member, Member))
    for member in members:
        if isinstance(member, FlexlinkError):
            yield member
            continue
        if not ends:
            ends += _simulated(*next(blocks), stop)
        yield ends.popleft()


def prepared(scenes: Sequence[Scene], compared: int | None = None) -> list[Member | FlexlinkError]:
    """Build the problem of every scene and check its step; return members or errors; `compared` as in `outcomes`."""
    most = len(scenes) if compared is None else compared
    problems = _problems_of(scenes)
    checked = iter(check_steps([problem for problem in problems if isinstance(problem, InitialValueProblem)]))
    members: list[Member | FlexlinkError] = []
    for number, problem in enumerate(problems):
        if isinstance(problem, FlexlinkError):
            members.append(problem)
        elif isinstance(warnings := next(checked), FlexlinkError):
            members.append(warnings)
        else:
            members.append(Member(problem, warnings, fits_lanes(problem), number < most))
    return members


def _problems_of(scenes: Sequence[Scene]) -> list[InitialValueProblem | FlexlinkError]:
    """Return `problem_of` each scene, or its error; arms without drives and loads share their inputs."""
    found: list[InitialValueProblem | FlexlinkError] = []
    before: InitialValueProblem | None = None
    for scene, made in zip(scenes, lump_many([open_chain(scene) for scene in scenes]), strict=True):
        try:
            chain = or_raise(made)
            shares = before is not None and not chain.has_free_base and _acts_alike(before.scene, scene)
            problem = problem_of(scene, chain, before.inputs if before is not None and shares else None, tied=True)
            before = problem if problem.base is None else before
            found.append(problem)
        except FlexlinkError as error:
            found.append(error)
    return found


def _acts_alike(one: Scene, scene: Scene) -> bool:
    """Whether two scenes can share inputs: these must not depend on the arm, and runs must not write to them."""
    moved = one.motion or scene.motion or one.wrench.varies or one.wrench.on
    return not moved and one.drive.kind == scene.drive.kind == "none" and one.wrench == scene.wrench


def _blocks(members: Iterable[Member], alone: int = 1) -> Iterator[tuple[list[Member], Kept]]:
    """Blocks of members that run together, up to `alone` of those that run one after another, and what they share."""
    block, kept = list[Member](), Kept()
    for member in members:
        shares = bool(block) and _together(block[0], member)
        if block and not (shares and len(block) < (LANES if member.along else alone)):
            yield block, kept
            block, kept = [], kept if shares else Kept()
        block.append(member)
    if block:
        yield block, kept


def _together(one: Member, other: Member) -> bool:
    """Whether members can run side by side, or one after another prepared once; a reference may begin at `initial`."""
    a, b = one.problem, other.problem
    if one.along or other.along:
        return one.along and other.along and alike(a, b)
    changed = {name for name in Scene.__struct_fields__ if getattr(a.scene, name) != getattr(b.scene, name)}
    return changed <= {"initial"} and a.chain is b.chain and same_law(a.inputs.drive, b.inputs.drive)


def _simulated(members: Sequence[Member], kept: Kept, stop: Stop) -> Sequence[Run | Outcome]:
    """Simulate members in lanes. Even a single member uses a lane, so its numbers do not depend on its neighbours."""
    if not members[0].along:
        return [_alone(member, kept, stop) for member in members]
    try:
        block = Block(members, kept)
    except (MemoryError, ValueError):  # ValueError: more elements than numpy can count
        return [_alone(member, kept, stop) for member in members]
    if block.integrate(stop):
        return block.ends(stop)
    if len(members) == 1:  # the run diverges; repeated alone, it reports how
        return [_alone(members[0], kept, stop)]
    return [end for member in members for end in _simulated([member], Kept(), stop)]


def _ended(end: Run | Outcome) -> Ended:
    """Return the outcome of a run that started; raise the error of a run that did not."""
    if isinstance(end, Run):
        return end.trajectory()
    return end if isinstance(end, DivergenceError | InterruptedRunError) else or_raise(end)


def _alone(member: Member, kept: Kept, stop: Stop) -> Outcome:
    """Simulate a member; `kept`: of members that, if their steps are adaptive, differ only in their initial state."""
    problem = member.problem
    try:
        if problem.explicit:
            run = SingleRun(problem, warnings=member.warnings)
        else:
            first = kept("first", None, lambda: problem)
            run = prepared_run(dataclasses.replace(first, scene=problem.scene, q=problem.q, qd=problem.qd), kept)
        return run.finish(stop, compared=member.compared, warn=warn)
    except (FlexlinkError, InterruptedRunError) as error:
        return error
