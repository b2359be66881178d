"""Rigid model of the arm for its controller: one rigid link outboard of every driven joint."""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rne import rne
from flexlink.kernels.tools.compiler import inlined
from flexlink.kernels.tools.vec3 import vector


class RigidModel(NamedTuple):
    """A rigid chain of d hinges, with the motion to evaluate, the torques and scratch."""

    chain: Any
    rne: Any
    wrench: Any  # (6,) zeros
    q: Any  # (d,), like the next three
    qd: Any
    qdd: Any
    tau: Any


@inlined
def model_torque(model):
    """Write τ = M q̈ + T_GC of the model, for its q, q̇ and q̈."""
    gravity = vector(model.chain.gravity)
    rne(model.chain, gravity, model.wrench, model.q, model.qd, model.qdd, model.tau, model.rne)
