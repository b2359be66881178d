"""Random tied arms in MuJoCo, from their files: their motion approaches that of flexlink as MuJoCo's step is reduced.

    OPENBLAS_NUM_THREADS=1 python -m tests.campaigns.ties_in_mujoco 0 100   # seeds; exit code 1: a file moves otherwise

Points, hinges, welds, rods, springs with and without play, and springs of joints. MuJoCo's equalities are soft, so that
its error is of the order of the step or its square; a wrong number in a file leaves a difference at any step.
"""

import sys
import warnings
from typing import Any

import mujoco
import numpy as np

import flexlink as fl
from flexlink.chain.rigid import rpy_from_matrix
from flexlink.engines.mujoco import quiet
from tests.campaigns.random_ties import Maker, torque_of
from tests.support.loops import Torque, places, turned

STEPS, FINER = (4e-6, 2e-6, 1e-6), (2.5e-7,)  # s; finer: of arms that are unstable with the others
DURATION, SAMPLE, ALLOWED = 0.01, 0.005, 1e-6  # difference of points, relative to the size of the arm


class TiedMaker(Maker):
    """Random arms with ties of all kinds that MJCF holds."""

    def tie(self, name: str, kind: str, link: str, other: str, at: tuple[Any, ...]) -> dict[str, Any]:
        dice, found = self.dice, super().tie(name, kind, link, other, at)
        if kind == "hinge" and dice.chance(0.4):
            del found["axis"], found["to"]["axis"]
            turn = (turned(*at, other).T if other else np.eye(3)) @ turned(*at, link)
            found["kind"], found["to"]["rpy_deg"] = "weld", np.degrees(rpy_from_matrix(turn)).tolist()
        elif kind == "distance" and dice.chance(0.6):
            free = dice.one_of({"damping": dice.decades(-1, 1)}, {"play": 0.01}, {"only": "pull"}, {"only": "push"})
            found |= {"stiffness": dice.decades(2, 4), **free, "length": found["length"] * dice.linear(0.95, 1.05)}
        elif kind == "point" and dice.chance(0.2):
            found |= {"stiffness": dice.decades(2, 4)}
        return found

    def ties(self, *at: Any) -> list[dict[str, Any]]:
        found, k = super().ties(*at), self.dice.decades(0, 2)
        on_joint = {"name": "joint", "kind": "joint", "link": "l0", "stiffness": k}
        free = self.dice.one_of({"damping": 0.1}, {"play": 0.1})
        return [*found, on_joint | free] if self.dice.chance(0.3) else found


def tied(seed: int) -> fl.Scene:
    """The scene of a seed, as far as MuJoCo runs it here."""
    return TiedMaker(seed).scene().varied({"drive.rate": None, "wrench": {}})


def given(scene: fl.Scene, chain: fl.Chain) -> Torque:
    """Torques that are not in files: of the drive, dry friction and quadratic dampers."""
    law, hinges, dampers = torque_of(scene, chain), chain.hinges, chain.force("dampers")

    def torque(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        τ = law(t, q, qd) - hinges["coulomb"] * np.tanh(qd / hinges["coulomb_width"])
        at = dampers["hinge"]
        τ[at] -= dampers["quadratic"] * np.abs(qd[at]) * qd[at]
        return τ

    return torque


def in_mujoco(problem: fl.Problem, q: np.ndarray, qd: np.ndarray, h: float) -> np.ndarray:
    """Angles (samples, n) of a run in MuJoCo with a step h."""
    scene, chain = problem.scene, problem.chain
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain, initial=(q, qd), timestep=h, ties=scene))
    data, torque = mujoco.MjData(model), given(scene, chain)
    order = np.array([model.joint(name).qposadr[0] for name in chain.joint_names])
    mujoco.mj_resetDataKeyframe(model, data, 0)

    def more(_: Any, data: Any) -> None:
        data.qfrc_passive[order] += torque(data.time, data.qpos[order], data.qvel[order])

    found = [q]
    with quiet():
        mujoco.set_mjcb_passive(more)
        try:
            for _ in range(round(DURATION / SAMPLE)):
                mujoco.mj_step(model, data, round(SAMPLE / h))
                found.append(data.qpos[order].copy())
        finally:
            mujoco.set_mjcb_passive(None)
    return np.array(found)


def judged(seed: int, steps: tuple[float, ...] = STEPS) -> tuple[str, list[float]]:
    """Kinds of the ties of a seed, and differences of points, relative to the size, by step; nan: an unstable step."""
    scene = tied(seed)
    run = {"duration": DURATION, "sample": SAMPLE, "tolerance": 1e-8}
    problem = fl.Problem(scene.varied({f"run.{key}": value for key, value in run.items()}))
    ours = problem.simulate()
    here, chain = places(ours.chain, ours.q), ours.chain
    kinds = "+".join(tie.kind + " spring" * (tie.stiffness is not None) for tie in scene.tie)
    found = []
    for h in steps:
        with np.errstate(all="ignore"):
            there = places(chain, in_mujoco(problem, ours.q[0], ours.qd[0], h))
        off = np.abs(there - here).max() / chain.size
        found.append(off if off < 1.0 else np.nan)
    return kinds, found


if __name__ == "__main__":
    warnings.simplefilter("ignore", RuntimeWarning)
    wrong = []
    for seed in range(*map(int, sys.argv[1:3])):
        try:
            kinds, off = judged(seed)
            off += [] if off[-1] <= ALLOWED else judged(seed, FINER)[1]
        except fl.FlexlinkError as error:
            print(seed, error.id, error)
            continue
        print(f"{seed} {kinds}:", *(f"{each:.1e}" for each in off), flush=True)
        wrong += [] if off[-1] <= ALLOWED else [seed]
    print(f"more than {ALLOWED:g}: {wrong}")
    sys.exit(bool(wrong))
