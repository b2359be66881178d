"""Random jumps of torque, target, wrench and held tables: every sample meets the tolerance.

    python -m tests.campaigns.random_jumps 1000  # seeds 0 … 999, with a summary at the end; exit code 1 if one is wrong

Arms of one to three links with rotors up to 300 kg m². A torque, a wrench or the target of a drive jumps at rest or in
motion; tolerances are 1e-2 to 1e-6 m. The reference is DOP853 with a thousandth of the tolerance, also for samples
inside steps; Radau9 is used if the stability of DOP853 requires too many steps.
"""

import collections
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import flexlink as fl
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.motion.inputs.initial_state import initial_state
from validation.random_arms import Dice

Array = NDArray[np.float64]

WRONG = 10.0  # an error is wrong above this multiple of the tolerance, at any sample
METHODS = ("auto", "Radau5", "Radau9", "Gauss6")
STRICTER, FLOOR = 1e-3, 1e-11  # tolerance of the reference: fraction of the run's tolerance, at least FLOOR · reach
AFFORDABLE = 60_000  # maximum number of steps of DOP853


class Outcome(NamedTuple):
    """Outcome of a run, with errors relative to the tolerance."""

    seed: int
    method: str
    word: str
    tip: float = np.nan
    rates: float = np.nan
    work: float = np.nan
    steps: int = 0
    text: str = ""


def random_jump(dice: Dice) -> fl.Scene:
    """Random arm with a jump; its tolerance is in `run`."""
    number = dice.one_of(1, 2, 3)
    names = [f"link{k}" for k in range(number)]
    links = tuple(random_link(dice, name) for name in names)
    at = dice.one_of(0.0, 0.5)
    mass, length = 2.0 * number, sum(link.length for link in links)
    torque = tuple(dice.linear(-1, 1) * 0.3 * mass * 9.81 * length / (k + 1) for k in range(number))
    drive, wrench = fl.Drive(), fl.Wrench()
    kind = dice.one_of("torque", "target", "wrench", "held")
    sampled = all(link.joint.armature for link in links)  # only with large rotors: a sampled law hardly moves soft arms
    inertia = [(0.0 if sampled else mass * length**2 / (k + 1)) + link.joint.armature for k, link in enumerate(links)]
    ω = dice.linear(3.0, 15.0)
    gains = {"kp": tuple(J * ω**2 for J in inertia), "kd": tuple(1.4 * J * ω for J in inertia)}
    zero = (0.0,) * number
    start = tuple(dice.linear(-90, 90) for _ in names)
    step = tuple(dice.decades(-1, 1) for _ in names)
    if kind == "torque":
        drive = fl.Drive(kind="table", times=(0.0, at or 0.05), torques=(zero, torque), hold=True)
    elif kind == "target":
        target = tuple(a + b for a, b in zip(start, step, strict=True))
        drive = fl.Drive(kind="pd", **gains, target_deg=target, gravity=dice.one_of("none", "rigid"))
    elif kind == "held":
        rows = tuple(tuple(a + k * b for a, b in zip(start, step, strict=True)) for k in range(3))
        table = fl.Reference(profile="hold", times=(0.0, 0.4, 0.8), angle_deg=rows)
        drive = fl.Drive(kind="pd", **gains, reference=table, rate=100.0 if sampled else None)
    else:
        forces = ((0.0, 0.0, 0.0), dice.three(5.0 * mass))
        wrench = fl.Wrench(times=(0.0, at or 0.05), forces=forces, hold=True)
    return fl.Scene(
        name="jump",
        arm=fl.Arm(
            links=links, materials={"stuff": fl.Material(young=dice.decades(9.5, 11.3), density=2700.0,
                                                         loss_time=dice.one_of(0.0, dice.decades(-5, -3)))},
            sections={"bar": fl.Section(shape="rectangle", height=dice.linear(0.015, 0.05), width=0.03)},
            tip=fl.RigidBody(mass=dice.one_of(0.0, 2.0)),
        ),
        gravity=dice.one_of((0.0, 0.0, -9.81), (0.0, 0.0, 0.0)),
        initial=fl.InitialState(joint_deg=start),
        drive=drive, wrench=wrench,
        run=fl.RunSettings(method="auto", duration=2.0, sample=0.05, tolerance=dice.decades(-6, -2)),
    )  # fmt: skip


def random_link(dice: Dice, name: str) -> fl.Link:
    """Random bar of about a metre on a motor of 0 to 300 kg m²."""
    flex = dice.one_of("z", "z", "yz", "xyz")
    joint = fl.Joint(armature=dice.one_of(0.0, dice.decades(-2, 2.5)), viscous=dice.one_of(0.0, 1.0))
    mount = fl.Mount(rpy_deg=(90.0, 0.0, 0.0)) if name == "link0" and dice.chance(0.7) else fl.Mount()
    segments = dice.one_of(3, 5)
    return fl.Link(name=name, length=dice.linear(0.4, 1.2), flex=flex, segments=segments, material="stuff",
                   section="bar", joint=joint, mount=mount)  # fmt: skip


def judge(scene: fl.Scene, tolerance: float) -> fl.Trajectory:
    """Reference for a run: the same run with steps that end at every jump and need no interpolation."""
    chain = fl.lump(scene)
    q, qd = initial_state(scene, chain)
    stricter = max(STRICTER * tolerance, FLOOR * chain.reach)
    steps = scene.run.duration / fl.stable_step(chain, q, qd, method="DOP853")
    method = "DOP853" if steps < AFFORDABLE else "Radau9"
    return fl.simulate(scene, method=method, tolerance=stricter, unstable="allow")


def errors(run: fl.Trajectory, truth: fl.Trajectory, tolerance: float) -> tuple[float, float, float]:
    """Largest errors of tip, rates and work over all samples, relative to the tolerance."""
    chain, rows = run.chain, slice(0, len(run.t))
    tip = np.linalg.norm(run.tip - truth.tip[rows], axis=1).max()
    ω = slowest_frequency(chain, run.q[0])
    thrown = max(throw(chain, q, e, 1.0 / ω) for q, e in zip(run.q, run.qd - truth.qd[rows], strict=True))
    mass = chain.bodies["mass"].sum()
    forces = mass * np.linalg.norm(chain.gravity) + np.abs(truth.tau).sum(axis=1).max() / chain.reach
    forces += np.linalg.norm(truth.tip_wrench[:, :3], axis=1).max() if truth.tip_wrench is not None else 0.0
    forces += np.sqrt(2 * mass * truth.energy.kinetic.max()) * 100 / run.scene.run.duration
    work = np.abs(done(run) - done(truth)[rows]).max() / forces
    return tip / tolerance, thrown / tolerance, work / tolerance


def done(run: fl.Trajectory) -> Array:
    """Work W of all nonconservative forces [J]."""
    energy = run.energy.parts
    return np.asarray((energy - energy[:, :1]).sum(axis=0) - run.imbalance)


def throw(chain: fl.Chain, q: Array, e: Array, longest: float) -> float:
    """Upper bound of the tip error that an error of the rates causes, with springs and dampers (see kernels/thrown)."""
    M, hinges = fl.mass_matrix(chain, q), chain.hinges
    D, K = np.diag(hinges["damping"]), np.diag(hinges["stiffness"])
    J, largest = fl.jacobian(chain, q).linear, 0.0
    for τ in longest * 0.125 ** np.arange(5):
        largest = max(largest, float(np.linalg.norm(J @ (τ * np.linalg.solve(M + τ * D + τ**2 * K, M @ e)))))
    return largest


def outcome(seed: int) -> Outcome:
    """Run a random jump and its reference."""
    dice = Dice(seed)
    scene, method = random_jump(dice), METHODS[seed % len(METHODS)]
    tolerance = scene.run.tolerance
    assert tolerance is not None
    fixed = method == "Gauss6"
    settings = {"method": method, "step": 0.005} if fixed else {"method": method}
    try:
        truth = judge(scene, tolerance)
    except fl.FlexlinkError as error:
        return Outcome(seed, method, "no truth", text=str(error))
    if fixed:  # the doubt reported for a run with fixed steps
        tolerance = max(tolerance, 0.005 * float(np.linalg.norm(np.ptp(truth.tip, axis=0))))
    try:
        run = fl.simulate(scene, **settings)
    except fl.FlexlinkError as error:
        return Outcome(seed, method, type(error).__name__, text=str(error))
    tip, rates, work = errors(run, truth, tolerance)
    worst = max(tip, rates, work)
    word = "right" if worst <= WRONG else "warned" if run.warnings else "WRONG"
    if run.warnings and worst <= 1.0:
        word = "needless doubt"
    return Outcome(seed, method, word, tip, rates, work, run.steps.taken, "; ".join(run.warnings))


def main(first: int, last: int) -> int:
    """Run the seeds; return the exit code."""
    outcomes = []
    for seed in range(first, last):
        found = outcome(seed)
        outcomes.append(found)
        if found.word != "right" or max(found[3:6]) > 3:
            print(*(f"{x:.3g}" if isinstance(x, float) else x for x in found), flush=True)
    words = collections.Counter((found.method, found.word) for found in outcomes)
    print(*(f"{number:6d}  {method:7} {word}" for (method, word), number in sorted(words.items())), sep="\n")
    for name in ("tip", "rates", "work"):
        values = np.array([getattr(found, name) for found in outcomes if found.word != "no truth"])
        values = values[np.isfinite(values)]
        print(f"{name:6} error / tolerance: median {np.median(values):.3g}, largest {values.max():.3g}")
    return 1 if any(word == "WRONG" for _, word in words) else 0


if __name__ == "__main__":
    sys.exit(
        main(*map(int, sys.argv[1:])) if len(sys.argv) > 2 else main(0, int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    )
