"""Load the exported URDF into Pinocchio.

Pinocchio has no springs, and its `aba` ignores damping and dry friction. flexlink therefore computes −T_FL − T_FR,
including springs and dampers between joints and rotation-vector springs, and adds it to the joint torques. Pinocchio's
M, recursive Newton-Euler algorithm and `aba` include the armature, which a custom element stores because URDF cannot.

A floating base is Pinocchio's `JointModelFreeFlyer`, whose coordinates are converted (`coordinates`).

With prescribed joints p, the equations of the free joints f remain (Featherstone 2008, section 9.2):

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
from flexlink.engines.rotation_springs import OwnElements, excess_of, refuse_in_files
from flexlink.engines.steps import run_in_steps
from flexlink.formats.document import loaded_tip, xml_joint_names
from flexlink.formats.urdf import LIMIT, to_urdf
from flexlink.formats.urdf_reading import read_urdf


class PinocchioEngine(OwnElements):
    """A chain in Pinocchio.

    Attributes
    ----------
    model, data
        Pinocchio's model and its data, with gravity and armature set.
    coordinates
        Map between flexlink's and Pinocchio's coordinates.
    tip
        Index of the tip frame at which the wrench acts.
    stiffness, rest, damping, coulomb, coulomb_width, gear
        Joint properties read from the file, shape (n,); see `ReadBack`.
    couplings
        Springs and dampers between joints, of dtype `COUPLING`, read from flexlink's custom elements.
    unspecified
        Fields of `ReadBack` that the file does not specify.
    prescribed
        Joints with a prescribed motion, which the file does not contain.
    """

    name = "pinocchio"
    version: str = pin.__version__

    def __init__(self, chain: Chain) -> None:
        exported = to_urdf(chain, shapes=False)
        self._parse(exported, xml_joint_names(chain), loaded_tip(chain).name)
        self.excess = excess_of(chain, lambda: read_urdf(exported))
        prescribed = chain.held
        self.prescribed, self._free = np.flatnonzero(prescribed), np.flatnonzero(~prescribed)

    @classmethod
    def from_file(cls, file: ForeignFile) -> Self:
        """Load a foreign URDF file; continuous joints become revolute joints with wide limits.

        Raises
        ------
        ArgumentError
            Pinocchio refuses the file, or it has joint types that flexlink does not support.
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
        """Load a document with joints in the order of `names`, by default in the model's order.

        The base floats if `base` is given or the document specifies its rotation.
        """
        # attributes of flexlink's custom elements
        not_in_urdf = ("stiffness", "rest", "coulomb_width", "armature")
        floating = Floating(velocity_in_base=True, spin_in_base=True, turn_first=False, scalar_first=False)
        robot = ET.fromstring(text)
        own_element = robot.find("flexlink")
        rotation = "" if own_element is None else own_element.get(BASE, "")
        if base is None and rotation:
            base = np.reshape([float(x) for x in rotation.split()], (3, 3))
        floats = () if base is None else (pin.JointModelFreeFlyer(),)
        self.model = model = pin.buildModelFromXML(text, *floats)
        pinocchio_reader.require_joints_of(model)
        if model.nv > 600:  # pinocchio.Data allocates four n³ arrays for second derivatives: 7 GB
            raise ArgumentError(
                f"{model.nv} joints: Pinocchio's data would take {32e-9 * model.nv**3:.0f} GB; at most 600 joints are "
                "supported; use another engine or fewer segments",
                id="too-many-joints",
            )
        self.data, self.n = pin.Data(model), model.nv  # `createData` would copy the model
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
        """Return the arm's properties as Pinocchio has read them, with the file's springs and transmissions."""
        own = {name: getattr(self, name) for name in ("stiffness", "rest", "coulomb_width", "gear")}
        own |= couplings.to_matrices(self.couplings, self.n)
        return pinocchio_reader.read(self.model, self.coordinates, self.names, own, self.unspecified)

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify."""
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
        """Do nothing, because Pinocchio has no settings that act at a given state."""

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
        """Return q̈ from the articulated-body algorithm (`aba`); prescribed joints keep their rates."""
        return self._accelerations(q, qd, tau, tip_wrench, follows=False, prescribed=np.zeros(self.n))

    def integrate(self, scene: Scene) -> Samples:
        """Run the scene's Runge-Kutta method as a plain loop over `aba`."""
        return run_in_steps(self.name, fixed_steps_problem(scene), self._accelerations, self.coordinates)

    def _accelerations(
        self, q: Array, qd: Array, tau: Array, wrench: Array | None, *, follows: bool, prescribed: Array
    ) -> Array:
        """Return q̈, with the accelerations `prescribed` at prescribed joints."""
        pushed = tau if wrench is None else tau + self._wrench_torque(q, wrench, follows=follows)
        total = pushed - self.elastic_torque(q)
        total -= self.friction_torque(qd)
        p = self.prescribed
        if len(p) == 0:
            theirs = self.coordinates
            state = theirs.position(q), theirs.rates(q, qd)
            a = pin.aba(self.model, self.data, *state, theirs.torques(q, total))
            return theirs.our_accelerations(q, qd, a)
        f, M = self._free, self.mass_matrix(q)
        qdd, rhs = prescribed.copy(), total - self.bias_torque(q, qd) - M[:, p] @ prescribed[p]
        qdd[f] = np.linalg.solve(M[np.ix_(f, f)], rhs[f])
        return qdd

    def _wrench_torque(self, q: Array, wrench: Array | None, *, follows: bool = False) -> Array:
        """Return Jᵀ F with the Jacobian of the tip origin in axes of frame 0 or of the tip, linear part first."""
        if wrench is None:
            return np.zeros(self.n)
        frame = pin.ReferenceFrame.LOCAL if follows else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        theirs = self.coordinates
        J = pin.computeFrameJacobian(self.model, self.data, theirs.position(q), self.tip, frame)
        return theirs.our_torques(q, J.T @ wrench)


def _own(elements: Sequence[ET.Element | None], key: str) -> Array:
    """Return an attribute of flexlink's custom elements, joint by joint; 0 if there is none."""
    return np.array([0.0 if element is None else float(element.get(key, 0)) for element in elements])
