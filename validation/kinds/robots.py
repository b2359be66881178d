"""Imported arms against the original URDF in Pinocchio; flexible arms against the same arms, rigid.

The files of robots come with an optional package; an arm whose file is not installed is left out, and told.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import flexlink as fl
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.diagnosis.states import random_states
from flexlink.dynamics.rounding import acceleration_error
from flexlink.robots.collection import import_known, known_arm
from flexlink.robots.tuning import tuned
from validation.case import MODELS, Case, Measured
from validation.physics.source_urdf import Original

BENDING = "_flexible"
"""End of the names of arms that bend; without it, they are those of the same arms, rigid."""


def run(case: Case, samples: int, hertz: tuple[float, ...] = ()) -> Iterator[Measured]:
    """Largest errors at random states; frequencies that were asked for, and what `modes` finds.

    `hertz` are the frequencies that links of arms that bend are to get [Hz].
    """
    left_out = []
    for scene in case.load_scenes():
        if scene.name.endswith(BENDING):
            yield from _against_rigid(scene, samples)
            yield from _frequencies(scene, hertz)
            continue
        try:
            original = _original(scene)
        except MissingDependencyError as error:
            left_out.append(str(error))
            continue
        yield from _against_original(scene, original, samples)
    yield Measured("arms left out", float(len(left_out)), note=left_out[0] if left_out else "")


def _original(scene: fl.Scene) -> Original:
    arm = known_arm(scene.name)
    path = import_known(scene.name).path
    joints = [part.joint.name for part in path.parts]
    return Original(arm.path, joints, path.positions, np.array(scene.gravity))


def _against_original(scene: fl.Scene, original: Original, samples: int) -> Iterator[Measured]:
    """M and T_GC over their largest element and joint by joint, q̈ in units of what rounding explains."""
    chain, largest = fl.lump(scene), np.zeros(5)
    for s in random_states(chain, samples):
        M, T = original.mass_matrix(s.q), original.bias_torque(s.q, s.qd)
        theirs = original.acceleration(s.q, s.qd, s.tau - fl.friction_torque(chain, s.qd))
        pair = fl.forward_dynamics(chain, s.q, s.qd, s.tau), theirs
        size = original.sizes(s.q)
        ΔM, ΔT = fl.mass_matrix(chain, s.q) - M, fl.bias_torque(chain, s.q, s.qd) - T
        found = (
            np.abs(ΔM).max() / np.abs(M).max(),
            np.abs(ΔM / np.outer(size, size)).max(),
            np.abs(ΔT).max() / np.abs(T).max(),
            np.abs(ΔT / size).max() / np.abs(T / size).max(),
            acceleration_error(chain, s.q, s.qd, s.tau, solutions=pair).max(),
        )
        largest = np.maximum(largest, found)
    for quantity, value in zip(("M", "M by joints", "T_GC", "T_GC by joints", "q̈"), largest, strict=True):
        yield Measured(quantity, float(value), scene.name, "pinocchio", {"states": samples})


def _against_rigid(scene: fl.Scene, samples: int) -> Iterator[Measured]:
    """The driven joints' block of M, and their T_GC, with springs slack."""
    chain, rigid = (
        fl.lump(scene),
        fl.lump(fl.load_scene(MODELS / "robots" / f"{scene.name.removesuffix(BENDING)}.toml")),
    )
    block, largest = np.ix_(chain.active, chain.active), np.zeros(2)
    for s in random_states(rigid, samples):
        q, qd = np.zeros((2, chain.n))
        q[chain.active], qd[chain.active] = s.q, s.qd
        M, T = fl.mass_matrix(chain, q)[block], fl.bias_torque(chain, q, qd)[chain.active]
        pairs = (fl.mass_matrix(rigid, s.q), M), (fl.bias_torque(rigid, s.q, s.qd), T)
        largest = np.maximum(largest, [_apart(one, other) for one, other in pairs])
    for quantity, value in zip(("M, rigid block", "T_GC, rigid block"), largest, strict=True):
        yield Measured(quantity, float(value), scene.name, "native", {"states": samples})


def _frequencies(scene: fl.Scene, hertz: Sequence[float]) -> Iterator[Measured]:
    """First mode of each flexible link with all other joints and hinges held, without gravity, at the start."""
    for asked_for in hertz:
        for link in [link.name for link in scene.arm.links if link.flex != "rigid"]:
            asked = tuned(scene, link, asked_for).varied({"gravity": (0.0, 0.0, 0.0)})
            chain = fl.lump(asked)
            q, _ = fl.initial_state(asked, chain)
            held = [name for name in chain.joint_names if not name.startswith(f"{link}.")]
            error = float(fl.modes(chain, q, locked=held).hertz[0] / asked_for - 1)
            yield Measured("frequency", abs(error), scene.name, varied={"link": link, "asked": asked_for})


def _apart(one: Array, other: Array) -> float:
    """Largest difference of two arrays over their largest element."""
    return float(np.abs(one - other).max() / np.abs(other).max())
