"""Fixed tendons over two hinges of a compiled MuJoCo model, as springs and dampers between joints.

A tendon of length L = c·q, slack at L₀, with stiffness s and damping d has the torques

    −s c (c·q − L₀) − d c (c·q̇)

It adds s c cᵀ to K and d c cᵀ to D. Rest angles of all springs together, K θ₀ = Σ k_i θ_i + Σ s c L₀, are those of the
joints, unless a tendon is slack elsewhere than the springs of its joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.engines.couplings import COUPLED_FIELDS


def add_tendons(model: Any, joints: dict[str, Array]) -> dict[str, Any]:
    """Stiffness, damping and rest angles of joints with those of tendons over two of them, and `COUPLED_FIELDS`."""
    matrices = {field: np.diag(joints[field]) for field in COUPLED_FIELDS.values()}
    constants = {field: _coefficients(model, field)[0] for field in matrices}
    torque, rest, apart = np.zeros(model.nv), joints["rest"], _apart(model)
    for number in np.flatnonzero(_between_two(model)):
        pair, c = _ends(model, number)
        for field, matrix in matrices.items():
            matrix[np.ix_(pair, pair)] += constants[field][number] * np.outer(c, c)
        torque[pair] += constants["stiffness"][number] * apart[number] * c
    if torque.any():
        rest = rest + np.linalg.pinv(matrices["stiffness"], hermitian=True) @ torque
    own = {field: np.diag(matrix).copy() for field, matrix in matrices.items()}
    between = {name: matrices[field] - np.diag(own[field]) for name, field in COUPLED_FIELDS.items()}
    return {**own, **between, "rest": rest}


def slack_elsewhere(model: Any) -> bool:
    """Whether a tendon over two joints is slack elsewhere than the springs of its joints."""
    return bool(_apart(model).any())


def _apart(model: Any) -> Array:
    """L₀ less the length at the rest angles of the joints, of tendons over two of them, shape (tendons,) [rad]."""
    # of the length of a tendon at the rest angles of its joints
    rounding = 8 * float(np.finfo(np.float64).eps)
    apart = np.zeros(model.ntendon)
    for number in np.flatnonzero(_between_two(model)):
        pair, c = _ends(model, number)
        rest = model.qpos_spring[model.jnt_qposadr[model.dof_jntid[pair]]]
        apart[number] = model.tendon_lengthspring[number, 0] - c @ rest
        if abs(apart[number]) <= rounding * (np.abs(c) @ np.abs(rest)):
            apart[number] = 0.0
    return apart


def others(model: Any) -> Iterator[int]:
    """Tendons that act otherwise than by a linear spring and damper between two joints."""
    yield from np.flatnonzero((_acting(model)[0] | _more(model)) & ~_between_two(model)).tolist()


def disable_others(model: Any) -> None:
    """Take springs, dampers and inertia of these tendons out of the model; limits and friction are constraints."""
    numbers = list(others(model))
    for name in (*COUPLED_FIELDS.values(), "armature"):
        for values in _constants(model, name):
            values[numbers] = 0


def name_of(model: Any, number: int) -> str:
    """The name of a tendon."""
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, number) or f"tendon {number}"


def _coefficients(model: Any, name: str) -> tuple[Array, Any]:
    """Of all tendons the coefficient "stiffness" or "damping", and whether it depends on length or speed."""
    if not model.ntendon:
        return np.zeros(0), np.zeros(0, dtype=bool)
    columns = np.hstack([values.reshape(len(values), -1) for values in _constants(model, name)])
    return columns[:, 0], columns[:, 1:].any(axis=1)


def _constants(model: Any, name: str) -> list[Array]:
    """The model's own arrays of a coefficient, constant part first; an older MuJoCo has no other."""
    return [getattr(model, key) for key in (f"tendon_{name}", f"tendon_{name}poly") if hasattr(model, key)]


def _acting(model: Any) -> tuple[Any, Any]:
    """Which tendons have a spring or a damper, and which of them have linear ones."""
    found = [_coefficients(model, name) for name in COUPLED_FIELDS.values()]
    curved = np.logical_or.reduce([polynomial for _, polynomial in found])
    return np.logical_or.reduce([values != 0 for values, _ in found]) | curved, ~curved


def _more(model: Any) -> Any:
    """Which tendons have inertia, or a limit or dry friction that acts."""
    more, off = model.tendon_armature != 0, model.opt.disableflags
    for bit, values in (("LIMIT", model.tendon_limited), ("FRICTIONLOSS", model.tendon_frictionloss)):
        flags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}")
        if not off & int(flags):
            more |= values != 0
    return more


def _between_two(model: Any) -> Any:
    """Which tendons are linear springs and dampers between two joints, and no more."""
    acts, linear = _acting(model)
    found = acts & linear & ~_more(model)
    for number in range(model.ntendon):
        part = _part(model, number)
        fixed = bool((model.wrap_type[part] == mujoco.mjtWrap.mjWRAP_JOINT).all())
        slack, taut = model.tendon_lengthspring[number]
        found[number] &= fixed and len(set(model.wrap_objid[part])) == model.tendon_num[number] == 2 and slack == taut
    return found


def _part(model: Any, number: int | np.intp) -> slice:
    """What a tendon runs along, in the model's list."""
    return slice(model.tendon_adr[number], model.tendon_adr[number] + model.tendon_num[number])


def _ends(model: Any, number: np.intp) -> tuple[Indices, Array]:
    """The degrees of freedom of the two joints of a tendon, and its coefficients."""
    part = _part(model, number)
    return model.jnt_dofadr[model.wrap_objid[part]], model.wrap_prm[part]
