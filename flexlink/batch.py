"""simulate_many(scenes): members of one layout side by side, eight in one pass of the compiled loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from flexlink.chain import Chain
from flexlink.checks import all_given, integer
from flexlink.dynamics import lanes_workspace, solver_for
from flexlink.errors import DivergenceError
from flexlink.inputs import input_arrays
from flexlink.kernels.lanes import LANES
from flexlink.kernels.runge_kutta import integrate
from flexlink.scene import Scene
from flexlink.simulate import simulate
from flexlink.tableaus import tableau
from flexlink.trajectory import Trajectory


def simulate_many(scenes: Sequence[Scene], threads: int = 1) -> list[Trajectory]:
    """Simulate many scenes; neighbours in the list that are alike run eight side by side.

    Alike are scenes that differ in initial state, dimensions, materials and gravity only: same layout of bodies and
    hinges, same drive, motion, wrench and run settings, with dynamics "articulated". Others run one by one. The numbers
    are those of single runs.

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
    DivergenceError
        The state of a member left the finite numbers; the error's `runs` holds all runs, that member's up to there.
    """
    scenes, threads = all_given("scenes", scenes, Scene), integer("threads", threads, 1)
    with ThreadPoolExecutor(threads) as pool:
        blocks = pool.map(_simulate_block, list(_blocks(_members(scenes))))
        outcomes = [outcome for block in blocks for outcome in block]
    runs = [outcome.trajectory if isinstance(outcome, DivergenceError) else outcome for outcome in outcomes]
    for outcome in outcomes:
        if isinstance(outcome, DivergenceError):
            outcome.runs = runs
            raise outcome
    return runs


Member = tuple[Scene, Chain]


def _members(scenes: Sequence[Scene]) -> Iterator[Member]:
    """Scenes with their chains; neighbours that differ in nothing a chain is made of share one."""
    made_of: tuple[object, ...] = ()
    for scene in scenes:
        locked = [a for a, link in zip(scene.initial.joint_deg, scene.arm.links, strict=True) if link.joint.locked]
        parts = (scene.name, scene.arm, scene.gravity, locked, [motion.link for motion in scene.motion])
        if parts != made_of:
            made_of, chain = parts, scene.chain()
        yield scene, chain


def _blocks(members: Iterable[Member]) -> Iterator[list[Member]]:
    block: list[Member] = []
    for member in members:
        if block and (len(block) == LANES or not _alike(block[0], member)):
            yield block
            block = []
        block.append(member)
    if block:
        yield block


def _alike(a: Member, b: Member) -> bool:
    (scene, chain), (other, its) = a, b
    shared = ("run", "drive", "motion", "wrench")
    return all(getattr(scene, name) == getattr(other, name) for name in shared) and chain.same_layout(its)


def _simulate_alone(scene: Scene) -> Trajectory | DivergenceError:
    try:
        return simulate(scene)
    except DivergenceError as error:
        return error


def _simulate_block(block: Sequence[Member]) -> Sequence[Trajectory | DivergenceError]:
    scene, chain = block[0]
    run, solver = scene.run, solver_for(chain, scene.run.dynamics)
    if len(block) == 1 or solver.lanes_workspace is None:
        return [_simulate_alone(member) for member, _ in block]
    q, qd = np.empty((2, run.samples, chain.n, LANES))
    for lane in range(LANES):
        member, its = block[min(lane, len(block) - 1)]
        q[0, :, lane], qd[0, :, lane] = member.initial_state(its)
    inputs = input_arrays(scene, chain)
    work = lanes_workspace(solver, [its for _, its in block])
    steps = (run.samples - 1) * run.steps_per_sample
    arrays = chain.arrays, work, tableau(run.method).arrays
    if integrate(*arrays, *inputs, run.step, 0, run.steps_per_sample, q, qd) < steps:
        return [_simulate_alone(member) for member, _ in block]  # one of them diverges; it says so itself
    return [
        Trajectory.from_states(member, its, run.times, *(np.ascontiguousarray(x[:, :, lane]) for x in (q, qd)))
        for lane, (member, its) in enumerate(block)
    ]
