"""flexlink's own dynamics with the interface of an engine."""

from __future__ import annotations

from functools import partial

from flexlink.chain.chain import Chain
from flexlink.common.versions import __version__
from flexlink.describe.scene import Scene
from flexlink.dynamics import accelerations, terms
from flexlink.engines.base import Samples
from flexlink.engines.read_back import of_chain
from flexlink.motion.simulate import simulate


class NativeEngine:
    """The functions of `flexlink.dynamics` and `flexlink.simulate` for one chain, without drag, which files lack."""

    name = "native"
    version = __version__

    def __init__(self, chain: Chain) -> None:
        self.chain = own = chain.without_forces()
        self.n = chain.n
        self.mass_matrix = partial(terms.mass_matrix, own)
        self.bias_torque = partial(terms.bias_torque, own)
        self.gravity_torque = partial(terms.gravity_torque, own)
        self.elastic_torque = partial(terms.elastic_torque, own)
        self.friction_torque = partial(terms.friction_torque, own)
        self.forward_dynamics = partial(accelerations.forward_dynamics, own)
        self.read_back = partial(of_chain, own)

    def integrate(self, scene: Scene) -> Samples:
        """Samples t, q, q̇ of the scene's run by `flexlink.simulate`."""
        run = simulate(scene)
        return run.t, run.q, run.qd
