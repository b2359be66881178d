"""Random scenes with random steps: no run may be finite and wrong without a warning.

    python -m tests.campaigns.random_scenes 2000  # seeds 0 … 1999, with a summary; exit code 1 if one is wrong

Arms of one to three links, soft to stiff, planar and spatial, with taper, friction, damping, drive, wrench and payload,
with a step of 0.1 to 30 times the stable step. The reference is a run with a quarter of the step.
"""

import collections
import sys

import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from validation.random_arms import Dice

WRONG = 0.05  # a run is wrong above this error relative to the tip's motion
FLEX, SHARES = ("rigid", "z", "yz", "xyz"), (0.2, 0.3, 0.2, 0.3)


def random_scene(dice: Dice) -> fl.Scene:
    """Random arm with a random load case; run settings are defaults."""
    sections = {}
    for name in ("bar", "rod"):
        sizes = {"height": dice.decades(-2.2, -1.2), "width": dice.decades(-2.2, -1.2)}
        sizes = sizes if name == "bar" else {"diameter": dice.decades(-2.2, -1.2)}
        shape, taper = "rectangle" if name == "bar" else "circle", dice.linear(0.4, 1.0)
        sections[name] = fl.Section(shape=shape, **sizes)
        sections[f"{name}'s tip"] = fl.Section(shape=shape, **{key: taper * value for key, value in sizes.items()})
    loss = dice.one_of(0.0, dice.decades(-6, -3))
    material = fl.Material(young=dice.decades(6.5, 11.5), density=dice.decades(3, 3.9), loss_time=loss)
    links = tuple(random_link(dice, f"link{k}") for k in range(dice.one_of(1, 2, 3)))
    if all(link.joint.locked and link.flex == "rigid" for link in links):
        links = (replace(links[0], joint=fl.Joint()), *links[1:])
    free = [not link.joint.locked for link in links]
    rates = tuple(dice.linear(-90, 90) if moves else 0.0 for moves in free)
    return fl.Scene(
        name="random",
        arm=fl.Arm(
            links=links, materials={"stuff": material}, sections=sections,
            tip=fl.RigidBody(mass=dice.one_of(0.0, dice.decades(-1, 1))),
        ),
        gravity=dice.three(9.81),
        initial=fl.InitialState(joint_deg=tuple(dice.linear(-180, 180) for _ in links), rate_deg=rates),
        drive=random_drive(dice, free),
        wrench=fl.Wrench(force=dice.three(20), moment=dice.three(2)) if dice.chance(0.3) else fl.Wrench(),
    )  # fmt: skip


def random_link(dice: Dice, name: str) -> fl.Link:
    flex, section = dice.one_of(*FLEX, shares=SHARES), dice.one_of("bar", "rod")
    joint = fl.Joint(
        locked=dice.chance(0.2), viscous=dice.one_of(0.0, dice.decades(-2, 1)), armature=dice.one_of(0.0, 0.02),
        coulomb=dice.one_of(0.0, 0.0, dice.decades(-2, 1)), coulomb_width=dice.decades(-2, -0.5),
    )  # fmt: skip
    return fl.Link(
        name=name, length=dice.linear(0.3, 1.5), flex=flex, segments=1 if flex == "rigid" else dice.one_of(3, 5, 7),
        material="stuff", section=section, section_tip=f"{section}'s tip" if dice.chance(0.4) else None,
        lumping=dice.one_of("gauss", "paper", "midpoint", "legendre"), joint=joint,
        mount=fl.Mount(rpy_deg=dice.three(90)) if dice.chance(0.5) else fl.Mount(),
        damping=fl.Damping(ratio=dice.linear(0, 0.05), at_hz=dice.decades(0, 1.5)) if dice.chance(0.3) else None,
    )  # fmt: skip


def random_drive(dice: Dice, free: list[bool]) -> fl.Drive:
    kind = dice.one_of("none", "constant", "pd")

    def per_link(low: float, high: float) -> tuple[float, ...]:
        return tuple(dice.linear(low, high) if moves else 0.0 for moves in free)

    if kind == "constant":
        return fl.Drive(kind=kind, torque=per_link(-5, 5))
    if kind == "pd":
        return fl.Drive(kind=kind, kp=per_link(0, 300), kd=per_link(0, 30), target_deg=per_link(-60, 60))
    return fl.Drive()


def with_random_step(dice: Dice, scene: fl.Scene) -> fl.Scene:
    """Scene with a duration of about a second and at most 20,000 steps of 0.1 to 30 times the stable step."""
    factor = dice.decades(-1, np.log10(30)) if dice.chance(0.5) else dice.linear(0.1, 1.2)
    step = factor * min(largest_step(scene), 0.1)
    per_sample = max(1, round(min(max(8.0, 1.0 / step), 20_000.0) / 50))
    sample = per_sample * step
    return scene.varied({"run": fl.RunSettings(step=step, sample=sample, duration=50 * sample)})


def largest_step(scene: fl.Scene) -> float:
    """Largest stable step at the start, as computed by `simulate`."""
    try:
        SingleRun(problem_of(scene.varied({"run": fl.RunSettings(step=1e9, sample=1e9, duration=1e9)})))
    except fl.errors.UnstableStepError as error:
        return error.largest
    return float("inf")


def verdict(seed: int) -> tuple[str, float]:
    """Outcome of a random scene, and its error relative to the tip's motion, if known."""
    dice = Dice(seed)
    scene = with_random_step(dice, random_scene(dice))
    try:
        run = fl.simulate(scene)
    except (fl.errors.UnstableStepError, fl.errors.DivergenceError, fl.errors.SingularMassError) as error:
        return type(error).__name__, np.nan
    try:
        fine = fl.simulate(scene, step=scene.run.step / 4, unstable="allow")
    except fl.errors.DivergenceError:
        return "warned" if run.warnings else "WRONG", np.inf
    error = np.abs(run.tip - fine.tip).max()
    motion = np.linalg.norm(np.ptp(fine.tip, axis=0))
    share = float(error / motion) if motion > 1e-9 else 0.0
    return "warned" if run.warnings else "WRONG" if share > WRONG else "right", share


def main(count: int) -> int:
    outcomes = collections.Counter[str]()
    for seed in range(count):
        outcome, share = verdict(seed)
        outcomes[outcome] += 1
        if outcome == "WRONG":
            print(f"\nseed {seed}: off by {share:.1%} of the tip's motion, without a warning")
        if sys.stderr.isatty():
            print(f"\r{seed + 1} of {count}", end="", file=sys.stderr)
    print(*(f"{number:6d}  {outcome}" for outcome, number in outcomes.most_common()), sep="\n")
    return 1 if outcomes["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100))
