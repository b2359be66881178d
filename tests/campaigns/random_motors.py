"""Random arms with saturating motors: every sample meets the tolerance.

    python -m tests.campaigns.random_motors 300  # seeds 0 … 299, with a summary at the end; exit code 1 if one is wrong

Arms of one or two links, rigid or flexible, with stiff or elastic gears. The drives demand several times their torque
limit: a distant target, trapezoidal moves within limits of rate and acceleration, tables of torques, computed torque.
The reference is SciPy's DOP853 with an independent control law, one branch at a time; every change of branch is an
event.
"""

import collections
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.motion.inputs.initial_state import initial_state
from tests.campaigns.fresh_scene_truth import Truth
from validation.random_arms import Dice

Array = NDArray[np.float64]

WRONG = 10.0  # an error is wrong above this multiple of the tolerance, at any sample
METHODS = ("DOP853", "Radau5", "Radau9")
EXACT, SHORTEST = 1e-11, 1e-9  # relative tolerance of the reference; time step across a switch [s]
AFFORDABLE = 400_000  # maximum evaluations of the reference


class Outcome(NamedTuple):
    """Outcome of a run: error / tolerance, and evaluations relative to the same run without torque limits."""

    seed: int
    method: str
    tolerance: float
    word: str
    error: float = np.nan
    cost: float = np.nan
    text: str = ""


def random_motor(dice: Dice) -> fl.Scene:
    """Random arm with drives that saturate; its tolerance is in `run`."""
    number = dice.one_of(1, 1, 2)
    links = tuple(_link(dice, f"link{k}") for k in range(number))
    lengths = np.array([link.length for link in links])
    mass, tip = sum((link.hub.mass if link.hub else 1.5 * link.length) for link in links), dice.one_of(0.0, 1.0)
    inertia = [float((mass + tip) * lengths[k:].sum() ** 2 / 3 + (links[k].joint.armature)) for k in range(number)]
    ω, start = dice.linear(4.0, 20.0), tuple(dice.linear(-60, 60) for _ in links)
    gains = {"kp": tuple(J * ω**2 for J in inertia), "kd": tuple(dice.linear(0.6, 2.0) * J * ω for J in inertia)}
    part, duration = dice.decades(-1.5, -0.3), dice.one_of(0.5, 1.0, 2.0)
    target = tuple(angle + dice.one_of(-1, 1) * dice.linear(20, 80) for angle in start)
    turn = np.radians(np.abs(np.subtract(target, start)))
    effort = tuple(part * float(J * ω**2 * angle) for J, angle in zip(inertia, turn, strict=True))
    kind, gravity = dice.one_of("target", "move", "table", "computed"), dice.one_of("none", "rigid")
    if kind == "target":
        drive = fl.Drive(kind="pd", **gains, target_deg=target, gravity=gravity, effort=effort)
    elif kind == "table":
        times = (0.0, *(duration * part for part in sorted(dice.linear(0.1, 0.9) for _ in range(3))))
        rows = tuple(tuple(dice.linear(-2, 2) * E for E in effort) for _ in times)
        drive = fl.Drive(kind="table", times=times, torques=rows, effort=effort)
    else:
        move = fl.Reference(
            profile="trapezoidal", to_deg=target, max_rate_deg=tuple(dice.linear(60, 400) for _ in links),
            max_acceleration_deg=tuple(dice.decades(2.3, 4.0) for _ in links), start=dice.one_of(0.0, 0.1),
        )  # fmt: skip
        if kind == "computed":
            gains = {"kp": (ω**2,) * number, "kd": (1.6 * ω,) * number}
        drive = fl.Drive(kind="computed_torque" if kind == "computed" else "pd", **gains, reference=move,
                         effort=effort, **({} if kind == "computed" else {"gravity": gravity}))  # fmt: skip
    return fl.Scene(
        name="motor",
        arm=fl.Arm(
            links=links,
            materials={"stuff": fl.Material(young=dice.decades(9.7, 11.3), density=2700.0, loss_time=1e-4)},
            sections={"bar": fl.Section(shape="rectangle", height=dice.linear(0.008, 0.03), width=0.03)},
            tip=fl.RigidBody(mass=tip),
        ),
        gravity=dice.one_of((0.0, 0.0, 0.0), (0.0, -9.81, 0.0)),
        initial=fl.InitialState(joint_deg=start), drive=drive,
        run=fl.RunSettings(method="auto", duration=duration, sample=duration / 40, tolerance=1e-4),
    )  # fmt: skip


def _link(dice: Dice, name: str) -> fl.Link:
    """Random bar of about a metre on a motor with or without an elastic gear."""
    length = dice.linear(0.4, 1.2)
    gear: dict[str, Any] = {}
    if dice.chance(0.5):
        gear = {"gear_stiffness": dice.decades(2.5, 4.5), "gear_damping": dice.one_of(0.0, 1.0)}
    joint = fl.Joint(armature=dice.decades(-2, 0), viscous=dice.one_of(0.0, 0.5), **gear)
    if dice.chance(0.5):
        mass = dice.linear(0.3, 2.0)
        hub = fl.RigidBody(mass=mass, center=(0.5 * length, 0.0, 0.0), inertia=(0.01 * mass, 0.1 * mass, 0.1 * mass))
        return fl.Link(name=name, length=length, joint=joint, hub=hub)
    return fl.Link(name=name, length=length, flex="z", segments=3, material="stuff", section="bar", joint=joint)


def judged(scene: fl.Scene, times: Array) -> Array:
    """Tip positions at the times by SciPy, shape (rows, 3); within a step each torque stays on one branch."""
    chain = fl.lump(scene)
    q, qd = initial_state(scene, chain)
    truth, E, d = Truth(scene.varied({"drive.effort": None}), chain), np.array(scene.drive.effort), len(chain.active)
    knots = sorted({float(t) for t in (*truth.breaks, times[-1]) if 0 < t <= times[-1]})
    y, t, found, spent = np.concatenate([q, qd]), 0.0, {0.0: q}, 0

    def law(t: float, middle: float, q: Array, qd: Array) -> Array:
        """Drive torques without limits; `middle` is a time inside the piece of the reference."""
        return truth.law(t + 1e-12 * (middle - t), q, qd)

    def accelerations(y: Array, u: Array) -> Array:
        tau = np.zeros(chain.n)
        tau[chain.active] = u
        return fl.forward_dynamics(chain, y[: chain.n], y[chain.n :], tau=tau)

    def sides(t: float, end: float, y: Array) -> Array:
        u = law(t, 0.5 * (t + end), y[: chain.n], y[chain.n :])
        return np.where(u > E, 1, np.where(u < -E, -1, 0))

    for end in knots:
        while t < end:
            middle, side = 0.5 * (t + end), sides(t, end, y)

            def slope(now: float, y: Array, side: Array = side, middle: float = middle) -> Array:
                nonlocal spent
                spent += 1
                if spent > AFFORDABLE:
                    raise TimeoutError
                u = law(now, middle, y[: chain.n], y[chain.n :])
                return np.concatenate([y[chain.n :], accelerations(y, np.where(side == 0, u, side * E))])

            def crossing(k: int, level: float, middle: float = middle) -> Callable[[float, Array], float]:
                def event(now: float, state: Array) -> float:
                    return float(law(now, middle, state[: chain.n], state[chain.n :])[k] - level)

                event.terminal = True  # type: ignore[attr-defined]
                return event

            events = [crossing(k, sign * E[k]) for k in range(d) for sign in (-1, 1)]
            part = solve_ivp(slope, (t, end), y, method="DOP853", rtol=EXACT, atol=EXACT, events=events,
                             dense_output=True, max_step=0.02)  # fmt: skip
            for row in times[(times > t) & (times <= part.t[-1] * (1 + 1e-15))]:
                found[float(row)] = part.sol(row)[: chain.n]
            t, y = float(part.t[-1]), part.y[:, -1]
            if part.status == 1 and t < end:  # step across the switch with the full law
                h = min(SHORTEST, end - t)
                qdd = accelerations(y, np.clip(law(t, middle, y[: chain.n], y[chain.n :]), -E, E))
                y = np.concatenate([y[: chain.n] + h * y[chain.n :] + 0.5 * h * h * qdd, y[chain.n :] + h * qdd])
                for row in times[(times > t) & (times <= t + h)]:
                    found[float(row)] = y[: chain.n]
                t += h
    return np.array([fl.tip_position(chain, found[float(row)]) for row in times])


def outcomes(seed: int, tolerances: tuple[float, ...] | None = None) -> list[Outcome]:
    """Run one random arm with all methods."""
    dice = Dice(seed)
    scene = random_motor(dice)
    tolerances = tolerances or (dice.decades(-8, -2), dice.decades(-5, -2))
    free = scene.varied({"drive.effort": None})
    try:
        truth = judged(scene, fl.simulate(scene, tolerance=1e-2).t)
    except (TimeoutError, fl.FlexlinkError) as error:
        return [Outcome(seed, "", np.nan, "no truth", text=f"{type(error).__name__} {error}")]
    found = []
    for method in METHODS:
        for tolerance in tolerances:
            try:
                run = fl.simulate(scene, method=method, tolerance=tolerance)
                unlimited = fl.simulate(free, method=method, tolerance=tolerance)
            except fl.FlexlinkError as error:
                found.append(Outcome(seed, method, tolerance, type(error).__name__, text=str(error)))
                continue
            error = float(np.linalg.norm(run.tip - truth, axis=1).max()) / tolerance
            cost = run.steps.evaluations / unlimited.steps.evaluations
            word = "right" if error <= WRONG else "warned" if run.warnings else "WRONG"
            found.append(Outcome(seed, method, tolerance, word, error, cost, "; ".join(run.warnings)))
    return found


def main(first: int, last: int) -> int:
    """Run the seeds; return the exit code."""
    found = []
    for seed in range(first, last):
        for one in outcomes(seed):
            found.append(one)
            if one.word != "right" or one.error > 3:
                print(*(f"{x:.3g}" if isinstance(x, float) else x for x in one), flush=True)
    words = collections.Counter((one.method, one.word) for one in found)
    print(*(f"{number:6d}  {method:7} {word}" for (method, word), number in sorted(words.items())), sep="\n")
    for method in METHODS:
        errors, costs = np.array([one[4:6] for one in found if one.method == method and one.error == one.error]).T
        print(
            f"{method:7} error / tolerance: median {np.median(errors):.3g}, largest {errors.max():.3g}; "
            f"evaluations over those without limits: median {np.median(costs):.3g}, 90 % {np.quantile(costs, 0.9):.3g}"
        )
    return 1 if any(word == "WRONG" for _, word in words) else 0


if __name__ == "__main__":
    sys.exit(
        main(*map(int, sys.argv[1:])) if len(sys.argv) > 2 else main(0, int(sys.argv[1]) if len(sys.argv) > 1 else 30)
    )
