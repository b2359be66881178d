"""flexlink's own dynamics with the interface of an engine."""

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.common.versions import __version__
from flexlink.describe.scene import Scene
from flexlink.dynamics import accelerations, terms
from flexlink.engines.base import Samples
from flexlink.engines.read_back import ReadBack, of_chain
from flexlink.motion.simulate import simulate


class NativeEngine:
    """The functions of `flexlink.dynamics` and `flexlink.simulate` for one chain, without drag, which files lack."""

    name = "native"
    version = __version__

    def __init__(self, chain: Chain) -> None:
        self.chain = chain.without_forces()
        self.n = chain.n

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix M(q) by the composite-rigid-body algorithm."""
        return terms.mass_matrix(self.chain, q)

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """Torque T_GC of gravity, centrifugal and Coriolis forces by recursive Newton-Euler."""
        return terms.bias_torque(self.chain, q, qd, tip_wrench=tip_wrench)

    def gravity_torque(self, q: Array) -> Array:
        """Gravity torque T_G by recursive Newton-Euler."""
        return terms.gravity_torque(self.chain, q)

    def elastic_torque(self, q: Array) -> Array:
        """Torque T_FL of the springs."""
        return terms.elastic_torque(self.chain, q)

    def friction_torque(self, qd: Array) -> Array:
        """Torque T_FR of friction."""
        return terms.friction_torque(self.chain, qd)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Accelerations q̈ by the default solver of `flexlink.forward_dynamics`."""
        return accelerations.forward_dynamics(self.chain, q, qd, tau, tip_wrench=tip_wrench)

    def read_back(self) -> ReadBack:
        """Record of the chain."""
        return of_chain(self.chain)

    def integrate(self, scene: Scene) -> Samples:
        """Samples t, q, q̇ of the scene's run by `flexlink.simulate`."""
        run = simulate(scene)
        return run.t, run.q, run.qd
