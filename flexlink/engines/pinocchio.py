"""Pinocchio, from the exported URDF.

Pinocchio has no springs, and its `aba` ignores damping and dry friction: −T_FL − T_FR, computed by us, join the joint
torques, those of springs and dampers between joints, and of springs of rotation vectors, included. The armature is in
its M, its recursive Newton-Euler and its `aba` alike, but not in URDF, so it is read from our element.

A free base is Pinocchio's `JointModelFreeFlyer`, whose coordinates are turned into ours (`coordinates`).

Joints whose motion is prescribed, p, leave the rows of the others, f, to be solved (Featherstone 2008, section 9.2):

    M_ff q̈_f = (T_EX − T_FL − T_FR − T_GC)_f − M_fp q̈_p
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from flexlink.chain.arguments import vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.arm import BASE
from flexlink.describe.scene import Scene
from flexlink.engines import couplings, pinocchio_reader
from flexlink.engines.base import ForeignFile, Samples, fixed_steps_problem
from flexlink.engines.coordinates import BASE_JOINTS, Coordinates, Floating
from flexlink.engines.read_back import ReadBack
from flexlink.engines.rotation_springs import Excess, excess_of, refuse_in_files
from flexlink.engines.steps import run_in_steps
from flexlink.formats.document import loaded_tip, xml_joint_names
from flexlink.formats.urdf import LIMIT, to_urdf
from flexlink.formats.urdf_reading import read_urdf


class PinocchioEngine:
    """A chain in Pinocchio.

    Attributes
    ----------
    model, data
        Pinocchio's own, gravity and armature set.
    coordinates
        How they follow from ours.
    tip
        Index of the frame of the tip at which the wrench acts.
    stiffness, rest, damping, coulomb, coulomb_width, gear
        As read from the file, shape (n,).
    couplings
        Springs and dampers between joints, of dtype `COUPLING`, as read from our own elements.
    unspecified
        Fields of `ReadBack` that the file does not specify.
    prescribed
        Joints with a prescribed motion, which is not in the file.
    """

    name = "pinocchio"
    version: str = pin.__version__
    _excess: Excess | None = None

    def __init__(self, chain: Chain) -> None:
        exported = to_urdf(chain, shapes=False)
        self._parse(exported, xml_joint_names(chain), loaded_tip(chain).name)
        self._excess = excess_of(chain, lambda: read_urdf(exported))
        prescribed = chain.hinges["prescribed"] != 0
        self.prescribed, self._free = np.flatnonzero(prescribed), np.flatnonzero(~prescribed)

    @classmethod
    def from_file(cls, file: ForeignFile) -> Self:
        """Load a foreign URDF file; continuous joints become revolute joints with wide limits.

        Raises
        ------
        ArgumentError
            Pinocchio refuses the file, or it has joints of other types than ours.
        """
        refuse_in_files("Pinocchio", file.path)
        robot = ET.parse(file.path).getroot()
        for joint in robot.findall("joint[@type='continuous']"):
            joint.set("type", "revolute")
            ET.SubElement(joint, "limit", LIMIT)
        engine = cls.__new__(cls)
        try:
            engine._parse(ET.tostring(robot, encoding="unicode"), base=file.base)
        except (ValueError, RuntimeError) as error:
            raise ArgumentError(f"Pinocchio cannot load the file: {error}", id="engine-cannot-load") from error
        engine.prescribed, engine._free = np.zeros(0, dtype=np.intp), np.arange(engine.n)
        return engine

    def _parse(self, text: str, names: Sequence[str] = (), tip: str = "", base: Array | None = None) -> None:
        """Load a document, with joints in the order of their names, that of the model by default.

        A base floats that is given, or of which the document says so.
        """
        # attributes of our own elements
        not_in_urdf = ("stiffness", "rest", "coulomb_width", "armature")
        floating = Floating(velocity_in_base=True, spin_in_base=True, turn_first=False, scalar_first=False)
        robot = ET.fromstring(text)
        own_element = robot.find("flexlink")
        said = "" if own_element is None else own_element.get(BASE, "")
        if base is None and said:
            base = np.reshape([float(x) for x in said.split()], (3, 3))
        floats = () if base is None else (pin.JointModelFreeFlyer(),)
        self.model = model = pin.buildModelFromXML(text, *floats)
        pinocchio_reader.require_joints_of(model)
        if model.nv > 600:  # pinocchio.Data holds four arrays of n³ numbers, for second derivatives: 7 GB
            raise ArgumentError(
                f"{model.nv} joints: Pinocchio's data would take {32e-9 * model.nv**3:.0f} GB; at most 600 joints are "
                "supported; use another engine or fewer segments",
                id="too-many-joints",
            )
        self.data, self.n = pin.Data(model), model.nv  # createData copies it
        degrees = pinocchio_reader.degrees_of_freedom(model)
        self.names = tuple(names or degrees)
        order = np.array([degrees[name] for name in self.names])
        self.coordinates = Coordinates(order, base, floating)
        own = {joint.get("name"): joint.find("flexlink") for joint in robot.findall("joint")}
        elements = [own.get(name) for name in self.names]
        self.stiffness, self.rest, self.coulomb_width, armature = (_own(elements, key) for key in not_in_urdf)
        self.coulomb_width[[name in BASE_JOINTS for name in self.names]] = 1.0
        self.damping, self.coulomb = np.array(model.damping)[order], np.array(model.friction)[order]
        self.gear = pinocchio_reader.transmissions(robot, self.names)
        self.couplings = couplings.of_elements(robot.findall("flexlink/coupling"), self.names)
        plain = all(element is None for element in elements)
        self.unspecified = frozenset((*not_in_urdf, *couplings.COUPLED_FIELDS) if plain else ())
        if own_element is None:
            self.unspecified |= {"gravity"}
        else:
            model.gravity.linear = vector("gravity", [float(x) for x in own_element.get("gravity", "").split()], 3)
        model.armature = armature[np.argsort(order)]
        self.tip = model.getFrameId(tip or robot.findall("link")[-1].attrib["name"], pin.FrameType.BODY)

    def read_back(self) -> ReadBack:
        """The arm as Pinocchio has read it, with springs of our own elements and the transmissions of the file."""
        own = {name: getattr(self, name) for name in ("stiffness", "rest", "coulomb_width", "gear")}
        own |= couplings.to_matrices(self.couplings, self.n)
        return pinocchio_reader.read(self.model, self.coordinates, self.names, own, self.unspecified)

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set fields of `ReadBack` that the file does not specify."""
        for field, values in fields.items():
            if field == "gravity":
                self.model.gravity.linear = values
            elif field == "armature":
                self.model.armature = values[np.argsort(self.coordinates.order)]
            elif field not in couplings.COUPLED_FIELDS:
                setattr(self, field, np.array(values))
        if couplings.COUPLED_FIELDS.keys() <= fields.keys():
            self.couplings = couplings.of_matrices(fields)

    def neutralize_settings(self) -> None:
        """Nothing to do: Pinocchio has no such settings."""

    def mass_matrix(self, q: Array) -> Array:
        """M(q) by composite rigid bodies (`crba`)."""
        theirs = self.coordinates
        return theirs.own_matrix(q, pin.crba(self.model, self.data, theirs.position(q)))

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC by `nle`, of a free base by `rnea`, less Jᵀ F."""
        theirs = self.coordinates
        place, v, drift = theirs.position(q), theirs.rates(q, qd), theirs.drift(q, qd)
        if drift is None:
            torque = pin.nle(self.model, self.data, place, v)
        else:
            torque = pin.rnea(self.model, self.data, place, v, drift)
        return np.array(theirs.own_torques(q, torque) - self._wrench_torque(q, tip_wrench))

    def gravity_torque(self, q: Array) -> Array:
        """T_G by `computeGeneralizedGravity`."""
        theirs = self.coordinates
        return theirs.own_torques(q, pin.computeGeneralizedGravity(self.model, self.data, theirs.position(q)))

    def elastic_torque(self, q: Array) -> Array:
        """T_FL, from the springs in the file."""
        torque: Array = self.stiffness * (q - self.rest)
        if len(self.couplings):
            torque += couplings.torque(self.couplings, "stiffness", q - self.rest)
        if self._excess is not None:
            torque += self._excess(q)
        return torque

    def friction_torque(self, qd: Array) -> Array:
        """T_FR, from the damping and dry friction in the file."""
        torque: Array = self.damping * qd
        if len(self.couplings):
            torque += couplings.torque(self.couplings, "damping", qd)
        if self.coulomb.any():
            torque += self.coulomb * np.tanh(qd / self.coulomb_width)
        return torque

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈ by the articulated-body algorithm (`aba`); a joint whose motion is prescribed keeps its rate."""
        return self._accelerations(q, qd, tau, tip_wrench, follows=False, prescribed=np.zeros(self.n))

    def integrate(self, scene: Scene) -> Samples:
        """The scene's Runge-Kutta method, as a plain loop over `aba`."""
        return run_in_steps(self.name, fixed_steps_problem(scene), self._accelerations, self.coordinates)

    def _accelerations(
        self, q: Array, qd: Array, tau: Array, wrench: Array | None, *, follows: bool, prescribed: Array
    ) -> Array:
        """q̈, for prescribed joints as in `prescribed`."""
        pushed = tau if wrench is None else tau + self._wrench_torque(q, wrench, follows=follows)
        total = pushed - self.elastic_torque(q)
        total -= self.friction_torque(qd)
        p = self.prescribed
        if len(p) == 0:
            theirs = self.coordinates
            state = theirs.position(q), theirs.rates(q, qd)
            a = pin.aba(self.model, self.data, *state, theirs.torques(q, total))
            return theirs.own_accelerations(q, qd, a)
        f, M = self._free, self.mass_matrix(q)
        qdd, rhs = prescribed.copy(), total - self.bias_torque(q, qd) - M[:, p] @ prescribed[p]
        qdd[f] = np.linalg.solve(M[np.ix_(f, f)], rhs[f])
        return qdd

    def _wrench_torque(self, q: Array, wrench: Array | None, *, follows: bool = False) -> Array:
        """Jᵀ F with the Jacobian of the tip's origin in axes of frame 0 or of the tip, linear part first."""
        if wrench is None:
            return np.zeros(self.n)
        frame = pin.ReferenceFrame.LOCAL if follows else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        theirs = self.coordinates
        J = pin.computeFrameJacobian(self.model, self.data, theirs.position(q), self.tip, frame)
        return theirs.own_torques(q, J.T @ wrench)


def _own(elements: Sequence[ET.Element | None], key: str) -> Array:
    """An attribute of our own elements, joint by joint; 0 where there is none."""
    return np.array([0.0 if element is None else float(element.get(key, 0)) for element in elements])
