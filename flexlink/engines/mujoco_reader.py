"""Read the record (`ReadBack`) of a compiled MuJoCo model, with the settings that act or have changed numbers."""

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from flexlink.chain.rigid import matrix_from_quaternion
from flexlink.common.types import Array, Indices
from flexlink.engines import mujoco_tendons
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates, Floating
from flexlink.engines.read_back import ACTUATOR_FIELDS, ReadBack, merge_bodies, no_limits, require_joints


def coordinates(model: Any, order: Indices, reference: Array | None = None) -> Coordinates:
    """Map to the model's coordinates; `reference`: rotation of a floating base at zero angles (None: at the start)."""
    floating = Floating(velocity_in_base=False, spin_in_base=True, turn_first=False, scalar_first=True)
    if not floats(model):
        return Coordinates(order)
    if reference is None:
        reference = matrix_from_quaternion(model.qpos0[3:7].tolist())
    return Coordinates(order, reference, floating)


def floats(model: Any) -> bool:
    """Whether the first joint is the free joint of a floating base."""
    return bool(model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)


def fill(model: Any, theirs: Coordinates, fields: Mapping[str, Array]) -> None:
    """Set gravity, and stiffness, rest angle and armature of joints in flexlink's order, if given."""
    model.opt.gravity[:] = fields.get("gravity", model.opt.gravity)
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
    kinds = []
    for number, kind in enumerate(model.jnt_type):
        name = mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower()
        known = name in {"hinge", "slide"} or (name == "free" and number == 0)
        kinds.append((_name(model, "joint", number), "" if known else name))
    require_joints(kinds)
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
    damping, armature = (added(model, name) for name in ("damping", "armature"))
    own = {"stiffness": _first(model.jnt_stiffness)[joints], "damping": _first(model.dof_damping) + damping}
    own["rest"] = np.zeros(model.nv)  # 0 for a floating base
    own["rest"][model.jnt_dofadr[floats(model) :]] = model.qpos_spring[model.jnt_qposadr[floats(model) :]]
    springs = mujoco_tendons.add_tendons(model, own)
    for flag, fields in (("spring", ("stiffness", "coupled_stiffness")), ("damper", ("damping", "coupled_damping"))):
        springs |= {field: on[flag] * springs[field] for field in fields}
    if model.nuser_jnt:
        moving = model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE
        widths[moving] = model.jnt_user[joints[moving], 0]
    k, parents = np.arange(model.nv), behind[model.body_parentid[model.dof_bodyid]]
    parents = np.where(k == model.body_dofadr[model.dof_bodyid], parents, k - 1)
    base = BASE_JOINTS if floats(model) else ()
    names = (*base, *(_name(model, "joint", k) for k in range(floats(model), model.njnt)))
    return ReadBack(
        names, parents, axes, points, frames, **bodies, slides=slides, **at_joints(model),
        **springs, coulomb=model.dof_frictionloss.copy(), coulomb_width=widths, armature=model.dof_armature + armature,
        gravity=float(_on(model, "GRAVITY")) * model.opt.gravity,
        tip=_tip(model, data), unspecified=frozenset() if model.nuser_jnt else frozenset({"coulomb_width"}),
        settings=_settings(model, spec),
        integrator=_integrator(model), step=float(model.opt.timestep),
        bodies=tuple(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b) or "" for b in model.dof_bodyid),
    )  # fmt: skip


def _first(values: Array) -> Array:
    """Return the constant term of coefficients that may be polynomials."""
    return np.array(values.reshape(len(values), -1)[:, 0])


def _on(model: Any, flag: str) -> bool:
    return not model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")


def _name(model: Any, kind: str, k: int) -> str:
    return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), k) or f"{kind} {k}"


def _behind(model: Any) -> Indices:
    """For each body, return its last joint, or the last joint of its nearest moving ancestor; −1 if it is fixed."""
    last = np.full(model.nbody, -1, dtype=np.intp)
    for b in range(1, model.nbody):
        own = model.body_dofnum[b]
        last[b] = model.body_dofadr[b] + own - 1 if own else last[model.body_parentid[b]]
    return last


def _tip(model: Any, data: Any) -> Array | None:
    for kind, places in ((mujoco.mjtObj.mjOBJ_BODY, data.xpos), (mujoco.mjtObj.mjOBJ_SITE, data.site_xpos)):
        number = mujoco.mj_name2id(model, kind, "tip")
        if number >= 0:
            return np.array(places[number])
    return None


def _settings(model: Any, spec: Any) -> dict[str, str]:
    """Return settings that act in a run or have changed numbers, named as in `diagnosis/data/mistakes.toml`."""
    opt, constrained = model.opt, _on(model, "CONSTRAINT")
    colliding = int(((model.geom_contype != 0) | (model.geom_conaffinity != 0)).sum())
    wide = 1e6  # rad; URDF requires limits, even for unlimited joints
    limited = int(((model.jnt_limited != 0) & (np.abs(model.jnt_range).min(axis=1) < wide)).sum())
    dry, lifted = int((model.dof_frictionloss != 0).sum()), int((model.body_gravcomp != 0).sum())
    kinds = [(number, _kind(model, number)) for number in _acting(model)]  # "": a motor or servo at a joint
    others = [f"{_name(model, 'actuator', number)!r} ({kind})" for number, kind in kinds if kind]
    tendons = [_name(model, "tendon", number) for number in mujoco_tendons.others(model)]
    settings: dict[str, tuple[Any, str]] = {
        "contacts": (constrained and _on(model, "CONTACT") and colliding > 1, f"{colliding} geoms"),
        "limits": (constrained and _on(model, "LIMIT") and limited, f"{limited} joints"),
        "frictionloss": (constrained and _on(model, "FRICTIONLOSS") and dry, f"{dry} joints"),
        "equality": (constrained and _on(model, "EQUALITY") and model.neq, f"{model.neq}"),
        "gravcomp": (lifted, f"{lifted} bod{'y' if lifted == 1 else 'ies'}"),
        "fluid": (opt.density or opt.viscosity, f"density {opt.density:g}, viscosity {opt.viscosity:g}"),
        "other actuators": (others, ", ".join(others)),
        "tendons": (tendons, ", ".join(map(repr, tendons[:3])) + " …" * (len(tendons) > 3)),
        "autoreset": (_on(model, "AUTORESET"), ""),
        "no springs": (not _on(model, "SPRING"), ""),
        "no dampers": (not _on(model, "DAMPER"), ""),
        "ref": (model.qpos0[7 * floats(model) :].any(), ""),
        "springlength": (mujoco_tendons.apart(model).any(), ""),
    }
    if spec is not None:
        compiler, yes = spec.compiler, mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        changing = {
            "springdamper": any(np.any(joint.springdamper) for joint in spec.joints),
            "degree": compiler.degree, "inertiafromgeom": compiler.inertiafromgeom == yes,
            "boundmass": compiler.boundmass > 0, "boundinertia": compiler.boundinertia > 0,
            "balanceinertia": compiler.balanceinertia, "settotalmass": compiler.settotalmass > 0,
        }  # fmt: skip
        settings |= {name: (value, "") for name, value in changing.items()}
    return {name: text for name, (active, text) in settings.items() if active}


def _integrator(model: Any) -> str:
    name: str = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    explicit = name == "EULER" and not _on(model, "EULERDAMP")
    return (name if name == "RK4" else name.capitalize()) + " without eulerdamp" * explicit


# Actuators of a compiled MuJoCo model as `ACTUATOR_FIELDS` of its joints.
#
# An actuator at a joint with gear r, gain g and bias b₀ + b₁ l + b₂ l̇, where l = r q is its length, exerts
#
#     T = r (g u + b₀) + r² b₁ q + r² b₂ q̇        limited to r · forcerange and to the joint's actuatorfrcrange
#
# A motor has no bias; its command u is a torque if r g = 1. A servo's command u is an angle if r g = −r² b₁, or a rate
# if r g = −r² b₂.


AT_JOINTS = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}


def at_joints(model: Any) -> dict[str, Any]:
    """Return `ACTUATOR_FIELDS`: motors and servos summed per joint, except those at a floating base."""
    fields: dict[str, Array] = {name: np.zeros(model.nv) for name in ACTUATOR_FIELDS if name != "effort"}
    fields["effort"] = no_limits(model.nv)
    limits = [list[Array]() for _ in range(model.nv)]
    servos = np.ones(model.nv)
    for number in _acting(model):
        if _kind(model, number):
            continue
        k, r = int(model.jnt_dofadr[model.actuator_trnid[number, 0]]), float(model.actuator_gear[number, 0])
        affine = model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
        b0, b1, b2 = model.actuator_biasprm[number, :3].tolist() if affine else (0.0, 0.0, 0.0)
        gain = r * float(model.actuator_gainprm[number, 0])
        fields["constant_torque"][k] += r * b0
        fields["servo_stiffness"][k] -= r**2 * b1
        fields["servo_damping"][k] -= r**2 * b2
        if b1 or b2:
            servos[k] *= gain / (-(r**2) * (b1 or b2))
        else:
            fields["gear"][k] += gain
        limits[k].append(_limit(model, number, r, None if b1 or b2 else gain))
    for k, some in enumerate(limits):
        if some:
            fields["gear"][k] = (fields["gear"][k] or 1.0) * servos[k]
            fields["effort"][k] = np.sum(some, axis=0)
        if model.jnt_actfrclimited[joint := model.dof_jntid[k]]:
            fields["effort"][k] = _narrower(fields["effort"][k], model.jnt_actfrcrange[joint])
    return fields


def added(model: Any, name: str) -> Array:
    """Return r² times the armature or damping of actuators, summed per joint; zero before MuJoCo 3.5."""
    total, own = np.zeros(model.nv), getattr(model, f"actuator_{name}", ())
    for number in range(len(own)):
        if mujoco.mjtTrn(model.actuator_trntype[number]) in AT_JOINTS:
            joint = model.actuator_trnid[number, 0]
            total[model.jnt_dofadr[joint]] += model.actuator_gear[number, 0] ** 2 * np.ravel(own[number])[0]
    return total


def _acting(model: Any) -> Iterator[int]:
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        return
    for number, group in enumerate(model.actuator_group):  # groups >= 31 cannot be disabled
        if not (0 <= group < 31 and model.opt.disableactuator >> int(group) & 1):
            yield number


def _kind(model: Any, number: int) -> str:
    """Return MuJoCo's keyword that excludes an actuator from comparison; "" for a motor or servo at a joint."""
    named = (
        ("trntype", mujoco.mjtTrn, AT_JOINTS), ("dyntype", mujoco.mjtDyn, {mujoco.mjtDyn.mjDYN_NONE}),
        ("gaintype", mujoco.mjtGain, {mujoco.mjtGain.mjGAIN_FIXED}),
        ("biastype", mujoco.mjtBias, {mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE}),
    )  # fmt: skip
    for field, kinds, plain in named:
        if (value := kinds(getattr(model, f"actuator_{field}")[number])) not in plain:
            return f"{field} {value.name.rpartition('_')[2].lower()}"
    free = model.jnt_type[model.actuator_trnid[number, 0]] == mujoco.mjtJoint.mjJNT_FREE
    return "at a floating base" if free else ""


def _limit(model: Any, number: int, r: float, gain: float | None) -> Array:
    """Return the smallest and largest torque of an actuator; a motor is also limited by its control range."""
    limit: Array = no_limits(1)[0]
    if model.actuator_forcelimited[number]:
        limit = _narrower(limit, np.sort(r * model.actuator_forcerange[number]))
    if gain is not None and model.actuator_ctrllimited[number]:
        limit = _narrower(limit, np.sort(gain * model.actuator_ctrlrange[number]))
    return limit


def _narrower(one: Array, other: Array) -> Array:
    """Return the intersection of two ranges; nan stays nan."""
    return np.array([np.maximum(one[0], other[0]), np.minimum(one[1], other[1])])
