"""Read fixed tendons over two hinges of a compiled MuJoCo model as springs and dampers between joints.

A tendon of length L = c·q, slack length L₀, stiffness s and damping d exerts the torques

    −s c (c·q − L₀) − d c (c·q̇)

It adds s c cᵀ to K and d c cᵀ to D. The rest angles of all springs together follow from K θ₀ = Σ k_i θ_i + Σ s c L₀.
If every tendon has its slack length at the joints' rest angles, θ₀ are these rest angles.
"""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.engines.read_back import COUPLED_FIELDS


def add_tendons(model: Any, joints: dict[str, Array]) -> dict[str, Any]:
    """Return stiffness, damping and rest angles of joints including two-joint tendons, and `COUPLED_FIELDS`."""
    matrices = {field: np.diag(joints[field]) for field in COUPLED_FIELDS.values()}
    constants = {field: _coefficients(model, field)[0] for field in matrices}
    torque, rest, off = np.zeros(model.nv), joints["rest"], apart(model)
    for number in np.flatnonzero(_between_two(model)):
        pair, c = _ends(model, number)
        for field, matrix in matrices.items():
            matrix[np.ix_(pair, pair)] += constants[field][number] * np.outer(c, c)
        torque[pair] += constants["stiffness"][number] * off[number] * c
    if torque.any():
        rest = rest + np.linalg.pinv(matrices["stiffness"], hermitian=True) @ torque
    own = {field: np.diag(matrix).copy() for field, matrix in matrices.items()}
    between = {name: matrices[field] - np.diag(own[field]) for name, field in COUPLED_FIELDS.items()}
    return {**own, **between, "rest": rest}


def apart(model: Any) -> Array:
    """Return L₀ − L at the joints' rest angles for all two-joint tendons, shape (tendons,) [rad]."""
    rounding = 8 * float(np.finfo(np.float64).eps)  # relative, of a tendon's length at the rest angles
    found = np.zeros(model.ntendon)
    for number in np.flatnonzero(_between_two(model)):
        pair, c = _ends(model, number)
        rest = model.qpos_spring[model.jnt_qposadr[model.dof_jntid[pair]]]
        found[number] = model.tendon_lengthspring[number, 0] - c @ rest
        if abs(found[number]) <= rounding * (np.abs(c) @ np.abs(rest)):
            found[number] = 0.0
    return found


def others(model: Any) -> Iterator[int]:
    """Yield the tendons that are anything other than a linear spring and damper between two joints."""
    yield from np.flatnonzero((_acting(model)[0] | _more(model)) & ~_between_two(model)).tolist()


def disable_others(model: Any) -> None:
    """Set springs, dampers and inertia of the `others` to zero; limits and friction of tendons are constraints."""
    numbers = list(others(model))
    for name in (*COUPLED_FIELDS.values(), "armature"):
        for values in _constants(model, name):
            values[numbers] = 0


def _coefficients(model: Any, name: str) -> tuple[Array, Any]:
    """Return the "stiffness" or "damping" of all tendons, and whether it depends on length or speed."""
    if not model.ntendon:
        return np.zeros(0), np.zeros(0, dtype=bool)
    columns = np.hstack([values.reshape(len(values), -1) for values in _constants(model, name)])
    return columns[:, 0], columns[:, 1:].any(axis=1)


def _constants(model: Any, name: str) -> list[Array]:
    """Return the model's arrays of a coefficient, constant part first; older MuJoCo versions have only this part."""
    return [getattr(model, key) for key in (f"tendon_{name}", f"tendon_{name}poly") if hasattr(model, key)]


def _acting(model: Any) -> tuple[Any, Any]:
    """Return which tendons have a spring or damper, and which have only linear springs and dampers."""
    found = [_coefficients(model, name) for name in COUPLED_FIELDS.values()]
    curved = np.logical_or.reduce([polynomial for _, polynomial in found])
    return np.logical_or.reduce([values != 0 for values, _ in found]) | curved, ~curved


def _more(model: Any) -> Any:
    """Return which tendons have inertia, or an active limit or dry friction."""
    more, off = model.tendon_armature != 0, model.opt.disableflags
    for bit, values in (("LIMIT", model.tendon_limited), ("FRICTIONLOSS", model.tendon_frictionloss)):
        flags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}")
        if not off & int(flags):
            more |= values != 0
    return more


def _between_two(model: Any) -> Any:
    """Return which tendons are only linear springs and dampers between two joints."""
    acts, linear = _acting(model)
    found = acts & linear & ~_more(model)
    for number in range(model.ntendon):
        part = _part(model, number)
        fixed = bool((model.wrap_type[part] == mujoco.mjtWrap.mjWRAP_JOINT).all())
        slack, taut = model.tendon_lengthspring[number]
        found[number] &= fixed and len(set(model.wrap_objid[part])) == model.tendon_num[number] == 2 and slack == taut
    return found


def _part(model: Any, number: int | np.intp) -> slice:
    """Return the slice of a tendon's elements in the model's `wrap` arrays."""
    return slice(model.tendon_adr[number], model.tendon_adr[number] + model.tendon_num[number])


def _ends(model: Any, number: np.intp) -> tuple[Indices, Array]:
    """Return the degrees of freedom of a tendon's two joints, and its coefficients."""
    part = _part(model, number)
    return model.jnt_dofadr[model.wrap_objid[part]], model.wrap_prm[part]
