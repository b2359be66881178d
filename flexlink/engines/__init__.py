"""Engines behind one small protocol; each loads the exported file, so that the exporter is what is compared."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from flexlink.chain.arguments import choice, given
from flexlink.chain.chain import Chain
from flexlink.common.errors import MissingDependencyError
from flexlink.engines.base import Engine

ENGINES = {"native": "NativeEngine", "pinocchio": "PinocchioEngine", "mujoco": "MujocoEngine"}
"""Module of this package: class in it."""

__all__ = ["ENGINES", "Engine", "load"]


def load(name: str, chain: Chain) -> Engine:
    """Build a chain in an engine.

    Parameters
    ----------
    name
        "native", "pinocchio" or "mujoco"; the module is imported only now.
    chain
        The chain; engines other than "native" get it as the text of an exported file.

    Raises
    ------
    ArgumentError
        Unknown engine, or one that cannot hold this chain.
    MissingDependencyError
        The engine is not installed.
    """
    given("chain", chain, Chain)
    engine: Engine = engine_class(name)(chain)
    return engine


def engine_class(name: str) -> Callable[[Chain], Engine]:
    """The class of an engine, imported only now; errors as in `load`."""
    factory = choice("engine", name, ENGINES)
    try:
        module = importlib.import_module(f"flexlink.engines.{name}")
    except ImportError as error:
        raise MissingDependencyError(
            f"engine {name!r} cannot be imported ({error}); "
            "install the engines with: python -m pip install 'flexlink[engines]'"
        ) from error
    made: Callable[[Chain], Engine] = getattr(module, factory)
    return made
