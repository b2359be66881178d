"""The arm as its controller knows it: one rigid link behind every driven joint."""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rne import rne
from flexlink.kernels.tools.compiler import recursion
from flexlink.kernels.tools.vec3 import vector


class RigidModel(NamedTuple):
    """A chain of d hinges, with the motion that it is asked about, and scratch."""

    chain: Any
    rne: Any
    wrench: Any  # (6,) none
    q: Any  # (d,), and so on
    qd: Any
    qdd: Any
    tau: Any


@recursion
def model_torque(model):
    """Write τ = M q̈ + T_GC of the model in motion."""
    gravity = vector(model.chain.gravity)
    rne(model.chain, gravity, model.wrench, model.q, model.qd, model.qdd, model.tau, model.rne)
