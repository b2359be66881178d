"""Load the exported URDF into Pinocchio.

Pinocchio has no springs, and its `aba` ignores damping and dry friction. flexlink therefore computes −T_FL − T_FR,
including springs and dampers between joints and rotation-vector springs, and adds it to the joint torques. Pinocchio's
M, recursive Newton-Euler algorithm and `aba` include the armature, which a custom element stores because URDF cannot.

A floating base is Pinocchio's `JointModelFreeFlyer`, whose coordinates are converted (`coordinates`).

With joints p of given motion, the equations of the free joints f remain (Featherstone 2008, section 9.2):

    M_ff q̈_f = (T_EX − T_FL − T_FR − T_GC)_f − M_fp q̈_p

A tie acts along u at its end b on e = p_a − p_b, which moves relative to axes at b by ė = D q̇ and ë = D q̈ + a:

    g = u · e − l        g̈ = u · (D q̈ + a) + (ė² − (u · ė)²) / |e| − l̈        fraction: of distances, u = e / |e|

Exact rows, J q̈ + γ = 0, leave the motions Z, J Z = 0; springs pull by λ. With b = −J⁺ (J q̈⁰ + γ), q̈⁰ without ties,
q̈ = q̈⁰ + b − Z (Zᵀ M Z)⁻¹ Zᵀ (M b + Jᵀ λ).
"""

from collections.abc import Mapping, Sequence
from typing import Any, Self
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from flexlink.chain.arguments import vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Indices
from flexlink.describe.arm import BASE
from flexlink.describe.scene import Scene
from flexlink.dynamics.ties import Rows, tie_rows
from flexlink.engines import base
from flexlink.engines import read_back as records
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates, Floating
from flexlink.engines.read_back import COUPLED_FIELDS, Parts, ReadBack
from flexlink.formats.document import body_names, loaded_tip, xml_joint_names
from flexlink.formats.urdf import LIMIT, read_urdf, to_urdf
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.stepping.tie_rows import KIND


class PinocchioEngine(base.OtherProgram):
    """A chain in Pinocchio: its `model` and `data`, with the numbers of flexlink's custom elements as in `ReadBack`."""

    name, title = "pinocchio", "Pinocchio"
    version: str = pin.__version__

    def __init__(self, chain: Chain, ties: Scene | None = None) -> None:
        exported = to_urdf(chain, shapes=False)
        self._parse(exported, xml_joint_names(chain), loaded_tip(chain).name)
        self.excess = base.excess_of(chain, lambda: read_urdf(exported))
        self.held, self._free = np.flatnonzero(chain.held), np.flatnonzero(~chain.held)
        self.has_ties, rows = ties is not None, tie_rows(ties, chain)
        if rows is not None:
            (self.rows, self.lengths), names = rows, body_names(chain)
            self.ends = [[self._end(names, row, end) for end in "ab"] for row in self.rows]
            self.tied = self._tied

    def _end(self, names: Sequence[str], row: np.void, end: str) -> tuple[int, Any]:
        """Joint that moves an end of a tie, and its place in the axes of the joint; 0 if the tie is on joints."""
        fixed = row["kind"] == KIND.joint or row[end] < 0
        on = self.model.frames[0 if fixed else self.model.getFrameId(names[row[end]], pin.FrameType.BODY)]
        return on.parentJoint, on.placement * pin.SE3(np.eye(3), row[f"point_{end}"])

    @classmethod
    def from_file(cls, file: base.ForeignFile) -> Self:
        """Load a foreign URDF file; continuous joints become revolute joints with wide limits."""
        base.refuse_in_files(cls.title, file.path)
        robot = ET.parse(file.path).getroot()
        for joint in robot.findall("joint[@type='continuous']"):
            joint.set("type", "revolute")
            ET.SubElement(joint, "limit", LIMIT)
        engine = cls.__new__(cls)
        try:
            engine._parse(ET.tostring(robot, encoding="unicode"), reference=file.base)
        except (ValueError, RuntimeError) as error:
            raise base.cannot_load("Pinocchio", "the file", error) from error
        engine.held, engine._free = np.zeros(0, dtype=np.intp), np.arange(engine.n)
        return engine

    def _parse(self, text: str, names: Sequence[str] = (), tip: str = "", reference: Array | None = None) -> None:
        """Load a document with joints in the order of `names`, by default in the model's order.

        The base floats if `reference`, its rotation, is given or the document specifies it.
        """
        not_in_urdf = ("stiffness", "rest", "coulomb_width", "armature")  # attributes of flexlink's custom elements
        floating = Floating(velocity_in_base=True, spin_in_base=True, turn_first=False, scalar_first=False)
        robot = ET.fromstring(text)
        own_element = robot.find("flexlink")
        rotation = "" if own_element is None else own_element.get(BASE, "")
        if reference is None and rotation:
            reference = np.reshape([float(x) for x in rotation.split()], (3, 3))
        floats = () if reference is None else (pin.JointModelFreeFlyer(),)
        self.model = model = pin.buildModelFromXML(text, *floats)
        degrees = degrees_of_freedom(model)
        if model.nv > 600:  # pinocchio.Data allocates four n³ arrays for second derivatives: 7 GB
            why = f"{model.nv} joints: Pinocchio's data would take {32e-9 * model.nv**3:.0f} GB"
            remedy = "at most 600 joints are supported; use another engine or fewer segments"
            raise ArgumentError(f"{why}; {remedy}", id="too-many-joints")
        self.data, self.n = pin.Data(model), model.nv  # `createData` would copy the model
        self.names = tuple(names or degrees)
        order = np.array([degrees[name] for name in self.names])
        self.coordinates = Coordinates(order, reference, floating)
        own = {joint.get("name"): joint.find("flexlink") for joint in robot.findall("joint")}
        elements = [own.get(name) for name in self.names]
        self.stiffness, self.rest, self.coulomb_width, armature = (
            np.array([0.0 if each is None else float(each.get(key, 0)) for each in elements]) for key in not_in_urdf
        )
        self.coulomb_width[[name in BASE_JOINTS for name in self.names]] = 1.0
        self.damping, self.coulomb = np.array(model.damping)[order], np.array(model.friction)[order]
        self.gear = transmissions(robot, self.names)
        self.couplings = records.of_elements(robot.findall("flexlink/coupling"), self.names)
        plain = all(element is None for element in elements)
        self.unspecified = frozenset((*not_in_urdf, *COUPLED_FIELDS) if plain else ())
        if own_element is None:
            self.unspecified |= {"gravity"}
        else:
            model.gravity.linear = vector("gravity", [float(x) for x in own_element.get("gravity", "").split()], 3)
        model.armature = armature[np.argsort(order)]
        self.tip = model.getFrameId(tip or robot.findall("link")[-1].attrib["name"], pin.FrameType.BODY)

    def read_back(self) -> ReadBack:
        """Return the arm's properties as Pinocchio has read them, with the file's springs and transmissions."""
        own = {name: getattr(self, name) for name in ("stiffness", "rest", "coulomb_width", "gear")}
        own |= records.to_matrices(self.couplings, self.n)
        return read(self.model, self.coordinates, self.names, own, self.unspecified)

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify, gravity and armature in the model."""
        super().fill_missing(fields)
        if "gravity" in fields:
            self.model.gravity.linear = fields["gravity"]
        if "armature" in fields:
            self.model.armature = fields["armature"][np.argsort(self.coordinates.order)]

    def mass_matrix(self, q: Array) -> Array:
        """Return M(q) by the composite-rigid-body algorithm (`crba`)."""
        theirs = self.coordinates
        return theirs.our_matrix(q, pin.crba(self.model, self.data, theirs.position(q)))

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return T_GC from `nle` (`rnea` with a floating base) minus Jᵀ F."""
        theirs = self.coordinates
        place, v, drift = theirs.position(q), theirs.rates(q, qd), theirs.drift(q, qd)
        if drift is None:
            torque = pin.nle(self.model, self.data, place, v)
        else:
            torque = pin.rnea(self.model, self.data, place, v, drift)
        return np.array(theirs.our_torques(q, torque) - self._wrench_torque(q, tip_wrench))

    def gravity_torque(self, q: Array) -> Array:
        """Return T_G from `computeGeneralizedGravity`."""
        theirs = self.coordinates
        return theirs.our_torques(q, pin.computeGeneralizedGravity(self.model, self.data, theirs.position(q)))

    def elastic_torque(self, q: Array) -> Array:
        """Return T_FL from the springs in the file."""
        φ = q - self.rest
        return np.asarray(self.stiffness * φ + self._between("stiffness", φ) + self._beyond(q))

    def friction_torque(self, qd: Array) -> Array:
        """Return T_FR from the damping and dry friction in the file."""
        return np.asarray(self.damping * qd + self._between("damping", qd) + self._friction(qd))

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return q̈ from the articulated-body algorithm (`aba`); joints with a given motion keep their rates."""
        return self.accelerations(q, qd, tau, tip_wrench, follows=False, held=np.zeros(self.n))

    def integrate(self, scene: Scene) -> base.Samples:
        """Run the scene's Runge-Kutta method as a plain loop over `aba`."""
        return self.run_in_steps(base.fixed_steps_problem(scene, tied=self.has_ties))

    def accelerations(
        self, q: Array, qd: Array, tau: Array, wrench: Array | None, *, follows: bool, held: Array
    ) -> Array:
        """Return q̈, with the accelerations `held` at joints with a given motion."""
        pushed = tau if wrench is None else tau + self._wrench_torque(q, wrench, follows=follows)
        total, p = pushed - self.elastic_torque(q) - self.friction_torque(qd), self.held
        if len(p) == 0:
            theirs = self.coordinates
            a = pin.aba(self.model, self.data, theirs.position(q), theirs.rates(q, qd), theirs.torques(q, total))
            return theirs.our_accelerations(q, qd, a)
        f, M = self._free, self.mass_matrix(q)
        qdd, rhs = held.copy(), total - self.bias_torque(q, qd) - M[:, p] @ held[p]
        qdd[f] = np.linalg.solve(M[np.ix_(f, f)], rhs[f])
        return qdd

    def _tied(self, t: float, q: Array, qd: Array, qdd: Array) -> base.Tied:
        rows, theirs, M, l = self.rows, self.coordinates, self.mass_matrix(q), np.zeros((3, len(self.rows)))
        drift, v = theirs.drift(q, qd), theirs.rates(q, qd)
        pin.forwardKinematics(self.model, self.data, theirs.position(q), v, 0 * v if drift is None else drift)
        pin.computeJointJacobians(self.model, self.data)
        found = [self._row(row, ends, q, v) for row, ends in zip(rows, self.ends, strict=True)]
        g, J, γ = map(np.array, zip(*found, strict=True))
        follow(self.lengths, t, *l)
        J, l[0], exact = theirs.our_torques(q, J.T).T, l[0] + rows["length"], np.isinf(rows["stiffness"])
        λ = pulls(rows, g := g - l[0], gd := J @ qd - l[1], l[0])
        U, sizes, V = np.linalg.svd(np.vstack([J[exact], np.eye(self.n)[self.held]]))
        r, off = np.count_nonzero(sizes > 1e-10), (J @ qdd + γ - l[2])[exact]
        b, Z = -V[:r].T @ (U[: len(off), :r].T @ off / sizes[:r]), V[r:].T
        tied = qdd + b - Z @ np.linalg.solve(Z.T @ M @ Z, Z.T @ (M @ b + J.T @ λ))
        return tied, M @ (qdd - tied), np.stack([np.where(exact, g, λ), gd], axis=1)

    def _row(self, row: np.void, ends: Sequence[tuple[int, Any]], q: Array, v: Array) -> tuple[float, Array, float]:
        """g + l, J and J̇ v of a row of ties, in Pinocchio's coordinates."""
        if row["kind"] == KIND.joint:
            J = np.eye(self.n)[row["a"]] - row["ratio"] * (row["b"] >= 0) * np.eye(self.n)[row["b"]]
            return J @ q, self.coordinates.torques(q, J), 0.0
        A, B = (self.data.oMi[joint] * place for joint, place in ends)
        at = [(self.model, self.data, *end, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED) for end in ends]
        J_a, J_b = (pin.getFrameJacobian(*each).reshape(6, -1) for each in at)
        γ_a, γ_b = (pin.getFrameClassicalAcceleration(*each).vector for each in at)
        e, ω, α = A.translation - B.translation, J_b[3:] @ v, γ_b[3:]
        D = J_a[:3] - J_b[:3] + pin.skew(e) @ J_b[3:]
        w, far = D @ v, np.linalg.norm(e) if row["kind"] == KIND.distance else np.inf
        a = γ_a[:3] - γ_b[:3] - np.cross(α, e) - np.cross(ω, 2 * w + np.cross(ω, e))
        u = B.rotation @ row["along"] if far == np.inf else e / far
        return u @ e, u @ D, u @ a + (w @ w - (u @ w) ** 2) / far

    def _wrench_torque(self, q: Array, wrench: Array | None, *, follows: bool = False) -> Array:
        """Return Jᵀ F with the Jacobian of the tip origin in axes of frame 0 or of the tip, linear part first."""
        if wrench is None:
            return np.zeros(self.n)
        frame = pin.ReferenceFrame.LOCAL if follows else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        theirs = self.coordinates
        J = pin.computeFrameJacobian(self.model, self.data, theirs.position(q), self.tip, frame)
        return theirs.our_torques(q, J.T @ wrench)


def pulls(rows: Rows, g: Array, v: Array, l: Array) -> Array:
    """λ of springs at g, ġ and l; 0 of exact rows."""
    oil, A, β = rows["bulk"] > 0, rows["areas"], rows["bulk"][:, None]
    full = np.where(oil[:, None], rows["volumes"] + A * l[:, None], 1.0)
    p = rows["pressures"] + β * np.log(full / (full + A * g[:, None]))
    δ, k = g - np.clip(g, rows["low"], rows["high"]), np.where(oil | np.isinf(rows["stiffness"]), 0, rows["stiffness"])
    λ = k * δ * np.maximum(0.0, 1.0 + rows["dissipation"] * np.sign(δ) * v) + rows["damping"] * v
    return np.asarray(λ - (A * np.maximum(-101325.0, p)).sum(axis=1))  # 1 atm below the air: empty


# Record of a Pinocchio model; springs and other values that URDF cannot store come from flexlink's custom elements.


FREE_FLYER = "JointModelFreeFlyer"


def degrees_of_freedom(model: Any) -> dict[str, int]:
    """Map names of supported joints to the model's numbers; a floating base has six, under flexlink's names."""
    kinds, found = list[tuple[str, str]](), dict[str, int]()
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        kind = joint.shortname()
        plain = kind.startswith(("JointModelR", "JointModelP")) and joint.nq == joint.nv == 1
        kinds.append((name, "" if plain or kind == FREE_FLYER else kind))
        names = BASE_JOINTS if kind == FREE_FLYER else (name,)
        found |= {each: joint.idx_v + k for k, each in enumerate(names)}
    records.require_joints(kinds)
    return dict(sorted(found.items(), key=lambda pair: pair[1]))


def transmissions(robot: ET.Element, names: Sequence[str]) -> Array:
    """Return the reduction of every joint's <transmission>, 0 if it has none, shape (n,)."""
    gear = dict.fromkeys(names, 0.0)
    for element in robot.findall("transmission"):
        reduction = element.findtext(".//mechanicalReduction") or "1"
        for joint in element.findall("joint"):
            name = joint.get("name", "")
            try:
                gear[name] = float(reduction)
            except ValueError:
                why = f"joint {name!r}: mechanicalReduction = {reduction!r} is not a number"
                raise ArgumentError(why, id="number-in-file") from None
    return np.array([gear[name] for name in names])


def read(
    model: Any, theirs: Coordinates, names: Sequence[str], own: Mapping[str, Any], unspecified: frozenset[str]
) -> ReadBack:
    """Return the record of a model with joints in the order of `names`; `own` contains fields stored by the adapter."""
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, theirs.position(np.zeros(model.nv)))
    n, moving = model.nv, list(model.joints)[1:]
    joints = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in moving])  # joint number per coordinate
    last = np.array([-1, *(joint.idx_v + joint.nv - 1 for joint in moving)])
    first = np.array([joint.idx_v for joint in moving])
    parents = np.arange(n) - 1
    parents[first] = last[model.parents.tolist()[1:]]
    J = data.J.reshape(6, n)
    slides = ~J[3:].any(axis=0)
    axes = np.where(slides, J[:3], J[3:]).T
    if theirs.reference is not None:
        axes[:3] = np.eye(3)  # along the axes of frame 0, as in flexlink
    places = [np.array([getattr(place, part) for place in data.oMi]) for part in ("translation", "rotation")]
    inertias = [np.array([getattr(link, part) for link in model.inertias]) for part in ("mass", "lever", "inertia")]
    (p, R), (masses, levers, I) = places, inertias
    points = p[joints]
    bodies = records.merge_bodies(last, masses, p + np.einsum("bij,bj->bi", R, levers), R @ I @ R.mT, points)
    most = np.array(model.upperEffortLimit)
    most[(most <= 0) | (most >= float(LIMIT["effort"]))] = np.inf  # as URDF requires a number where there is no limit
    # links that joints move; other links are fixed to them
    links = {frame.parentJoint: frame.name for frame in reversed(model.frames) if frame.type == pin.FrameType.BODY}
    tip = None
    if model.existFrame("tip", pin.FrameType.BODY):
        frame = model.frames[model.getFrameId("tip", pin.FrameType.BODY)]
        tip = np.array((data.oMi[frame.parentJoint] * frame.placement).translation)
    nothing: dict[str, Any] = {name: np.zeros_like(values) for name, values in own.items()}
    record = ReadBack(
        names=("",) * n, parents=parents, axes=axes, points=points, frames=R[joints], slides=slides,
        **bodies | {"parts": _parts(model, R, last)},
        **nothing | records.no_actuators(n) | {"effort": np.stack([-most, most], axis=1)},
        damping=np.array(model.damping), coulomb=np.array(model.friction), armature=np.array(model.armature),
        gravity=np.array(model.gravity.linear), tip=tip, unspecified=unspecified,
        bodies=tuple(links.get(k, "") for k in joints),
    )  # fmt: skip
    return record.in_order(theirs.order, names=tuple(names), **own)


def _parts(model: Any, R: Array, last: Indices) -> Parts:
    """Return inertias of the links welded to each joint's link (stored in fixed frames), and of that link alone."""
    parts, rest = list[tuple[int, Any]](), list(model.inertias)
    for frame in model.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass and frame.parentJoint:
            part = frame.placement.act(frame.inertia)
            rest[frame.parentJoint] = rest[frame.parentJoint] - part
            parts.append((frame.parentJoint, part))
    parts += [(k, part) for k, part in enumerate(rest) if k]
    joints = np.array([k for k, _ in parts], dtype=np.intp)
    return Parts(last[joints], R[joints] @ np.array([part.inertia for _, part in parts]) @ R[joints].mT)
