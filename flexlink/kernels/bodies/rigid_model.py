"""The arm as modelled by its controller: one rigid link after every driven joint."""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rne import rne
from flexlink.kernels.tools.compiler import recursion
from flexlink.kernels.tools.vec3 import vector


class RigidModel(NamedTuple):
    """A chain of d hinges with its motion and scratch arrays."""

    chain: Any
    rne: Any
    wrench: Any  # (6,) zero
    q: Any  # (d,); all arrays below as well
    qd: Any
    qdd: Any
    tau: Any


@recursion
def model_torque(model):
    """Write τ = M q̈ + T_GC of the model for its motion."""
    gravity = vector(model.chain.gravity)
    rne(model.chain, gravity, model.wrench, model.q, model.qd, model.qdd, model.tau, model.rne)
