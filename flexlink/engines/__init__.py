"""Engines behind one small protocol; each loads the exported file, so that the exporter is what is compared."""

from __future__ import annotations

import importlib
from typing import NamedTuple

from flexlink.chain.arguments import choice, given
from flexlink.chain.chain import Chain
from flexlink.common.errors import MissingDependencyError
from flexlink.engines.base import Engine, File
from flexlink.engines.child_process import IsolatedEngine


class Adapter(NamedTuple):
    """Where the class of an engine is, which extra it needs, and whether it takes a process of its own."""

    module: str
    factory: str
    extra: str = ""
    isolated: bool = False


ENGINES = {
    "native": Adapter("flexlink.diagnosis.native", "NativeEngine"),
    "pinocchio": Adapter("flexlink.engines.pinocchio", "PinocchioEngine", "engines"),
    "mujoco": Adapter("flexlink.engines.mujoco", "MujocoEngine", "engines"),
    "exudyn": Adapter("flexlink.engines.exudyn", "ExudynEngine", "witness"),
    "drake": Adapter("flexlink.engines.drake", "DrakeEngine", "witness", isolated=True),
}
"""By name: the class, and the extra that installs what its module imports."""

__all__ = ["ENGINES", "Adapter", "Engine", "load"]


def load(name: str, chain: Chain) -> Engine:
    """Build a chain in an engine.

    Parameters
    ----------
    name
        One of `ENGINES`; the module is imported only now.
    chain
        The chain; engines other than "native" get it as the text of an exported file.

    Raises
    ------
    ArgumentError
        Unknown engine, or one that cannot hold this chain.
    MissingDependencyError
        The engine is not installed.
    EngineError
        The process that the engine takes for itself ended.
    """
    if choice("engine", name, ENGINES).isolated:
        return IsolatedEngine(name, given("chain", chain, Chain))
    return load_here(name, chain)


def load_here(name: str, source: Chain | File) -> Engine:
    """As `load`, also of a file of somebody else's, in this process, whatever the engine does to it."""
    adapter = choice("engine", name, ENGINES)
    try:
        module = importlib.import_module(adapter.module)
    except ImportError as error:
        raise MissingDependencyError(
            f"engine {name!r} cannot be imported ({error}); "
            f"install it with: python -m pip install 'flexlink[{adapter.extra}]'"
        ) from error
    kind = getattr(module, adapter.factory)
    engine: Engine = kind.from_file(source) if isinstance(source, File) else kind(given("chain", source, Chain))
    return engine
