"""flexlink's own dynamics with the interface of an engine."""

from collections.abc import Callable
from typing import Any

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.common.versions import __version__
from flexlink.describe.scene import Scene
from flexlink.dynamics import accelerations, terms
from flexlink.engines.base import Delegate, Samples
from flexlink.engines.read_back import ReadBack, of_chain
from flexlink.motion.simulate import simulate


class NativeEngine(Delegate):
    """The functions of `flexlink.dynamics` and `flexlink.simulate` for one chain, without drag, which files lack."""

    name = "native"
    version = __version__

    def __init__(self, chain: Chain) -> None:
        self.chain = chain.without_forces()
        self.n = chain.n

    def _evaluate(self, name: str, *arguments: Array, **named: Any) -> Array:
        term: Callable[..., Array] = getattr(accelerations if name == "forward_dynamics" else terms, name)
        return term(self.chain, *arguments, **named)

    def read_back(self) -> ReadBack:
        """Record of the chain."""
        return of_chain(self.chain)

    def integrate(self, scene: Scene) -> Samples:
        """Samples t, q, q̇ of the scene's run by `flexlink.simulate`."""
        run = simulate(scene)
        return run.t, run.q, run.qd
