"""flexlink's own dynamics with the interface of an engine."""

import functools
from collections.abc import Callable
from typing import Any

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.common.versions import __version__
from flexlink.describe.scene import Scene
from flexlink.dynamics import accelerations, terms
from flexlink.engines.base import Engine, Samples
from flexlink.engines.read_back import ReadBack, of_chain
from flexlink.motion.simulate import simulate


def _of_chain(method: Any, function: Callable[..., Array]) -> Any:
    """A method of `Engine` that calls this function of a chain."""
    return functools.wraps(method)(lambda engine, *arguments, **named: function(engine.chain, *arguments, **named))


class NativeEngine:
    """The functions of `flexlink.dynamics` and `flexlink.simulate` for one chain, without drag, which files lack."""

    name = "native"
    version = __version__

    def __init__(self, chain: Chain) -> None:
        self.chain = chain.without_forces()
        self.n = chain.n

    mass_matrix = _of_chain(Engine.mass_matrix, terms.mass_matrix)
    bias_torque = _of_chain(Engine.bias_torque, terms.bias_torque)
    gravity_torque = _of_chain(Engine.gravity_torque, terms.gravity_torque)
    elastic_torque = _of_chain(Engine.elastic_torque, terms.elastic_torque)
    friction_torque = _of_chain(Engine.friction_torque, terms.friction_torque)
    forward_dynamics = _of_chain(Engine.forward_dynamics, accelerations.forward_dynamics)

    def read_back(self) -> ReadBack:
        """Record of the chain."""
        return of_chain(self.chain)

    def integrate(self, scene: Scene) -> Samples:
        """Samples t, q, q̇ of the scene's run by `flexlink.simulate`."""
        run = simulate(scene)
        return run.t, run.q, run.qd
