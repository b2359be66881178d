"""Read the record (`ReadBack`) of a compiled MuJoCo model, with the settings that act or have changed numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from flexlink.chain.rotation import matrix_from_quaternion
from flexlink.common.types import Array, Indices
from flexlink.engines import mujoco_actuators, mujoco_tendons
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates, Floating
from flexlink.engines.read_back import ReadBack, merge_bodies, require_joints


def coordinates(model: Any, order: Indices, reference: Array | None = None) -> Coordinates:
    """Return the map between flexlink's and the model's coordinates, for joints in this order.

    `reference` is the rotation of a floating base at zero angles, by default its initial rotation.
    """
    floating = Floating(velocity_in_base=False, spin_in_base=True, turn_first=False, scalar_first=True)
    if not floats(model):
        return Coordinates(order)
    if reference is None:
        reference = matrix_from_quaternion(model.qpos0[3:7].tolist())
    return Coordinates(order, reference, floating)


def floats(model: Any) -> bool:
    """Whether the first joint is the free joint of a floating base."""
    return bool(model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)


def joint_names(model: Any) -> tuple[str, ...]:
    """Return the names of all degrees of freedom, with flexlink's names for a floating base."""
    base = BASE_JOINTS if floats(model) else ()
    return (*base, *(_joint(model, k) for k in range(floats(model), model.njnt)))


def rest_angles(model: Any) -> Array:
    """Return the rest angles of the springs, shape (nv,); 0 for a floating base."""
    rest = np.zeros(model.nv)
    rest[model.jnt_dofadr[floats(model) :]] = model.qpos_spring[model.jnt_qposadr[floats(model) :]]
    return rest


def fill(model: Any, theirs: Coordinates, fields: Mapping[str, Array]) -> None:
    """Set stiffness, rest angle and armature, if given, of joints in flexlink's order."""
    joints = model.dof_jntid[theirs.order]
    moving = model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE
    if "armature" in fields:
        model.dof_armature[theirs.order] = fields["armature"]
    if "stiffness" in fields:
        model.jnt_stiffness[joints[moving]] = fields["stiffness"][moving]
    if "rest" in fields:
        model.qpos_spring[model.jnt_qposadr[joints[moving]]] = fields["rest"][moving]


def read(model: Any, spec: Any = None, reference: Array | None = None) -> ReadBack:
    """Return the record of a model; with its MjSpec, also the settings that changed values."""
    _require_joints(model)
    data, joints = mujoco.MjData(model), model.dof_jntid
    zero = coordinates(model, np.arange(model.nv), reference)
    data.qpos[:] = zero.position(np.zeros(model.nv))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    behind, R = _behind(model), data.ximat.reshape(-1, 3, 3)
    inertias = R @ (model.body_inertia[:, :, None] * R.mT)
    points, axes, widths = data.xanchor[joints], data.xaxis[joints], np.ones(model.nv)
    slides = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE
    if zero.reference is not None:
        axes[:6], slides[:3] = [*np.eye(3), *zero.reference.T], True
    bodies = merge_bodies(behind, model.body_mass, data.xipos, inertias, points)
    on = {name: float(_on(model, bit)) for name, bit in (("spring", "SPRING"), ("damper", "DAMPER"))}
    frames = data.xmat.reshape(-1, 3, 3)[model.dof_bodyid]
    damping, armature = (mujoco_actuators.added(model, name) for name in ("damping", "armature"))
    own = {
        "stiffness": _first(model.jnt_stiffness)[joints], "damping": _first(model.dof_damping) + damping,
        "rest": rest_angles(model),
    }  # fmt: skip
    springs = mujoco_tendons.add_tendons(model, own)
    for flag, fields in (("spring", ("stiffness", "coupled_stiffness")), ("damper", ("damping", "coupled_damping"))):
        springs |= {field: on[flag] * springs[field] for field in fields}
    if model.nuser_jnt:
        moving = model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE
        widths[moving] = model.jnt_user[joints[moving], 0]
    return ReadBack(
        joint_names(model), _parents(model, behind),
        axes, points, frames, **bodies, slides=slides, **mujoco_actuators.at_joints(model),
        **springs, coulomb=model.dof_frictionloss.copy(), coulomb_width=widths, armature=model.dof_armature + armature,
        gravity=float(_on(model, "GRAVITY")) * model.opt.gravity,
        tip=_tip(model, data), unspecified=frozenset() if model.nuser_jnt else frozenset({"coulomb_width"}),
        settings=dict(_active_settings(model)) | dict(_changing_settings(model, spec)),
        integrator=_integrator(model), step=float(model.opt.timestep),
        bodies=tuple(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b) or "" for b in model.dof_bodyid),
    )  # fmt: skip


def _require_joints(model: Any) -> None:
    kinds = []
    for k, kind in enumerate(model.jnt_type):
        name = mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower()
        known = name in {"hinge", "slide"} or (name == "free" and k == 0)
        kinds.append((_joint(model, k), "" if known else name))
    require_joints(kinds)


def _first(values: Array) -> Array:
    """Return the constant term of coefficients that may be polynomials."""
    return np.array(values.reshape(len(values), -1)[:, 0])


def _on(model: Any, flag: str) -> bool:
    return not model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")


def _joint(model: Any, k: int) -> str:
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) or f"joint {k}"


def _behind(model: Any) -> Indices:
    """For each body, return its last joint, or the last joint of its nearest moving ancestor; −1 if it is fixed."""
    last = np.full(model.nbody, -1, dtype=np.intp)
    for b in range(1, model.nbody):
        own = model.body_dofnum[b]
        last[b] = model.body_dofadr[b] + own - 1 if own else last[model.body_parentid[b]]
    return last


def _parents(model: Any, behind: Indices) -> Indices:
    first = model.body_dofadr[model.dof_bodyid]
    parents = behind[model.body_parentid[model.dof_bodyid]]
    k = np.arange(model.nv)
    return np.where(k == first, parents, k - 1)


def _tip(model: Any, data: Any) -> Array | None:
    for kind, places in ((mujoco.mjtObj.mjOBJ_BODY, data.xpos), (mujoco.mjtObj.mjOBJ_SITE, data.site_xpos)):
        number = mujoco.mj_name2id(model, kind, "tip")
        if number >= 0:
            return np.array(places[number])
    return None


def _active_settings(model: Any) -> Iterator[tuple[str, str]]:
    """Yield settings that act when the model runs, named as in `diagnosis/data/mistakes.toml`."""
    opt = model.opt
    if _on(model, "CONSTRAINT"):
        yield from _active_constraints(model)
    if model.body_gravcomp.any():
        bodies = int((model.body_gravcomp != 0).sum())
        yield "gravcomp", f"{bodies} bod{'y' if bodies == 1 else 'ies'}"
    if opt.density or opt.viscosity:
        yield "fluid", f"density {opt.density:g}, viscosity {opt.viscosity:g}"
    if others := list(mujoco_actuators.others(model)):
        yield "other actuators", ", ".join(others)
    if tendons := [mujoco_tendons.name_of(model, number) for number in mujoco_tendons.others(model)]:
        yield "tendons", ", ".join(map(repr, tendons[:3])) + " …" * (len(tendons) > 3)
    if _on(model, "AUTORESET"):
        yield "autoreset", ""


def _integrator(model: Any) -> str:
    name: str = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    explicit = name == "EULER" and not _on(model, "EULERDAMP")
    return (name if name == "RK4" else name.capitalize()) + " without eulerdamp" * explicit


def _active_constraints(model: Any) -> Iterator[tuple[str, str]]:
    colliding = int(((model.geom_contype != 0) | (model.geom_conaffinity != 0)).sum())
    if _on(model, "CONTACT") and colliding > 1:
        yield "contacts", f"{colliding} geoms"
    wide = 1e6  # rad; URDF requires limits, even for unlimited joints
    limited = int(((model.jnt_limited != 0) & (np.abs(model.jnt_range).min(axis=1) < wide)).sum())
    if _on(model, "LIMIT") and limited:
        yield "limits", f"{limited} joints"
    dry = int((model.dof_frictionloss != 0).sum())
    if _on(model, "FRICTIONLOSS") and dry:
        yield "frictionloss", f"{dry} joints"
    if _on(model, "EQUALITY") and model.neq:
        yield "equality", f"{model.neq}"


def _changing_settings(model: Any, spec: Any) -> Iterator[tuple[str, str]]:
    """Yield settings that change values between file and model, named as in `diagnosis/data/mistakes.toml`."""
    if not _on(model, "SPRING"):
        yield "no springs", ""
    if not _on(model, "DAMPER"):
        yield "no dampers", ""
    if model.qpos0[7 * floats(model) :].any():
        yield "ref", ""
    if mujoco_tendons.slack_elsewhere(model):
        yield "springlength", ""
    if spec is None:
        return
    if any(np.any(joint.springdamper) for joint in spec.joints):
        yield "springdamper", ""
    compiler = spec.compiler
    yes = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    active = {
        "degree": compiler.degree, "inertiafromgeom": compiler.inertiafromgeom == yes,
        "boundmass": compiler.boundmass > 0, "boundinertia": compiler.boundinertia > 0,
        "balanceinertia": compiler.balanceinertia, "settotalmass": compiler.settotalmass > 0,
    }  # fmt: skip
    yield from ((name, "") for name, value in active.items() if value)
