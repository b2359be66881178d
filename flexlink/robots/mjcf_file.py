"""MJCF → `Robot`, as MuJoCo compiles it: with defaults, classes, included files, and masses of shapes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from flexlink.chain.coordinates import unique
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia, matrix_from_quaternion
from flexlink.common.errors import DataFileError, imported
from flexlink.common.types import Array
from flexlink.robots.kinematic_tree import Closure, JointKind, Robot, TreeJoint


def read_mjcf(path: Path) -> Robot:
    """Read a robot with the root `world` from an MJCF file; each joint of a body moves a link, the last one the body.

    Poses are those of bodies, and of links, which begin at their joints, in frame 0, as drawn: there, positions are 0.
    """
    mujoco = imported("mujoco", "MJCF is read by MuJoCo;", "engines")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
        raise DataFileError(f"MuJoCo cannot load the file: {why}", id="engine-cannot-load") from None
    data, counts = mujoco.MjData(model), {"body": model.nbody, "joint": model.njnt, "equality": model.neq}
    names = dict[str, list[str]]()
    for what, count in (counts | {"tendon": model.ntendon}).items():
        kind = getattr(mujoco.mjtObj, f"mjOBJ_{what.upper()}")
        names[what] = unique(mujoco.mj_id2name(model, kind, k) or f"{what} {k}" for k in range(count))
    mujoco.mj_kinematics(model, data)
    places = [Pose(R.reshape(3, 3), p) for R, p in zip(data.xmat, data.xpos, strict=True)]
    bodies, joints = names["body"], names["joint"]
    fixed, between = unique([*joints, *bodies])[model.njnt :], unique([*bodies, *joints])[model.nbody :]
    frames, links, tree = [HERE], {"world": NOTHING}, dict[str, TreeJoint]()
    for b, up in enumerate(model.body_parentid.tolist()[1:], 1):
        parent, above, last = bodies[up], frames[up], model.body_jntadr[b] + model.body_jntnum[b] - 1
        for j in range(model.body_jntadr[b], last + 1) if model.body_jntnum[b] else [-1]:
            frame, name = (places[b], fixed[b]) if j < 0 else (Pose(places[b].R, data.xanchor[j]), joints[j])
            link = between[j] if j < last else bodies[b]
            tree[name] = _joint(model, j, name, (parent, link), above.inverse.then(frame))
            links[link], parent, above = NOTHING, link, frame
        R, own = data.ximat[b].reshape(3, 3), model.body_inertia[b]
        links[parent] = SpatialInertia(float(model.body_mass[b]), data.xipos[b], R * own @ R.T).moved(above.inverse)
        frames.append(above)
    inside = [(name, F.inverse.then(X)) for name, F, X in zip(bodies, frames, places, strict=True)]
    children = [(tree[name].child, HERE) for name in joints]
    closures = [_closure(model, e, name, inside, children) for e, name in enumerate(names["equality"])]
    return Robot(model.names.split(b"\0")[0].decode(), links, tree, _left_out(model, names), (), closures, "MJCF")


def _joint(model: Any, j: int, name: str, ends: tuple[str, str], origin: Pose) -> TreeJoint:
    """Joint j of a model, −1: a fixed one."""
    if j < 0:
        return TreeJoint(name, "fixed", *ends, origin, np.zeros(3), None, 0.0, 0.0, None)
    number, limited, k = model.jnt_type[j], bool(model.jnt_limited[j]), model.jnt_dofadr[j]
    turning, endless, sliding, _, floating, _, ball = get_args(JointKind)
    kind = (floating, ball, sliding, turning if limited else endless)[number]
    low, high = (model.jnt_range[j] - model.qpos0[model.jnt_qposadr[j]]).tolist()
    fields = (model.dof_damping, model.dof_frictionloss, model.dof_armature)
    damping, friction, armature = (float(np.ravel(values[k])[0]) for values in fields)
    axis, limits = model.jnt_axis[j] * (number > 1), (low, high) if limited else None
    return TreeJoint(name, kind, *ends, origin, axis, limits, damping, friction, None, armature)


def _closure(
    model: Any, e: int, name: str, bodies: Sequence[tuple[str, Pose]], joints: Sequence[tuple[str, Pose]]
) -> Closure:
    """Equality e of a model; `bodies` are their links and their places in them, `joints` the links that they move."""
    kind = ("connect", "weld", "joint", "tendon")[min(model.eq_type[e], 3)]
    pair, data = [model.eq_obj1id[e], model.eq_obj2id[e]], model.eq_data[e]
    lacks = "" if model.eq_active0[e] else "it is not active"
    if kind == "tendon":
        return Closure(name, kind, (bodies[0], bodies[0]), lacks="it holds no bodies or joints, as ties do")
    if kind == "joint":
        one, other = (joints[j] if j >= 0 else bodies[0] for j in pair)
        if data[0] or data[2:5].any():
            lacks = lacks or f"polycoef = {_words(data[:5])}: a tie holds a ratio, without offset"
        return Closure(name, kind, (one, other), float(data[1]), lacks)
    points, turns = data[:6].reshape(2, 3), np.eye(4)[[0, 0]]
    if kind == "weld":
        points, turns = points[::-1], np.array([data[6:10], turns[1]])
    if model.eq_objtype[e] != 1:  # sites, not bodies
        points, turns, pair = model.site_pos[pair], model.site_quat[pair], model.site_bodyid[pair]
    frames = [Pose(matrix_from_quaternion(turn), point) for turn, point in zip(turns, points, strict=True)]
    one, other = ((bodies[b][0], bodies[b][1].then(frame)) for b, frame in zip(pair, frames, strict=True))
    return Closure(name, kind.replace("connect", "point"), (one, other), lacks=lacks)


def _left_out(model: Any, names: Mapping[str, Sequence[str]]) -> dict[str, list[tuple[str, str]]]:
    """What acts on the motion in MuJoCo and is not read."""
    springs, lifted = [float(np.ravel(k)[0]) for k in model.jnt_stiffness], model.body_gravcomp
    gravity, colliding = _words(model.opt.gravity), (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    found = {
        "<joint spring>": [(name, f"{k:g}") for name, k in zip(names["joint"], springs, strict=True) if k],
        "<body gravcomp>": [(name, f"{k:g}") for name, k in zip(names["body"], lifted, strict=True) if k],
        "<option gravity>": [("option", gravity)] * (gravity != "0 0 -9.81"),
        "<option fluid>": [("option", "")] * bool(model.opt.density or model.opt.viscosity),
        "<tendon>": [(name, "") for name in names["tendon"]],
        "<actuator>": [("", "")] * model.nu,
        "<geom> in contacts": [("", "")] * int(colliding.sum()),
    }
    return {what: owners for what, owners in found.items() if owners}


def _words(values: Array) -> str:
    return " ".join(f"{value:g}" for value in values)
