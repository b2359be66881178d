"""Imported arms against the original URDF in Pinocchio; flexible arms against the same arms with rigid links.

The robots' files come with an optional package; an arm without its file is skipped and reported.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import flexlink as fl
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import random_states
from flexlink.dynamics.rounding import acceleration_error
from flexlink.robots.collection import import_known, known_arm
from flexlink.robots.importing import tuned
from validation.case import MODELS, Case, Measured
from validation.kinds import kind
from validation.physics.source_urdf import Original

BENDING = "_flexible"
"""Suffix of the names of flexible arms; the name without it belongs to the same arm with rigid links."""


@kind
def run(case: Case, samples: int, hertz: tuple[float, ...] = ()) -> Iterator[Measured]:
    """Yield the largest errors at random states, and errors of the frequencies that `modes` finds for tuned links.

    `hertz` are the frequencies [Hz] to which links of flexible arms are tuned.
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
    """Yield errors of M and T_GC, relative to their largest element and by joint, and of q̈ in units of rounding."""
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
    """Yield errors of M and T_GC of the driven joints, with unloaded springs, against the rigid arm."""
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
    """Yield the error of each flexible link's first frequency, with other joints and hinges locked, without gravity."""
    for wanted in hertz:
        for link in [link.name for link in scene.arm.links if link.flex != "rigid"]:
            adapted = tuned(scene, link, wanted).varied({"gravity": (0.0, 0.0, 0.0)})
            chain = fl.lump(adapted)
            q, _ = fl.initial_state(adapted, chain)
            held = [name for name in chain.joint_names if not name.startswith(f"{link}.")]
            error = float(fl.modes(chain, q, locked=held).hertz[0] / wanted - 1)
            yield Measured("frequency", abs(error), scene.name, varied={"link": link, "asked": wanted})


def _apart(one: Array, other: Array) -> float:
    """Largest difference of two arrays, relative to their largest element."""
    return float(np.abs(one - other).max() / np.abs(other).max())
