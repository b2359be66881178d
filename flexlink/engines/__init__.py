"""Adapters that give other multibody codes a common interface; each loads the exported file and so tests the export."""

import importlib
from typing import NamedTuple

from flexlink.chain.arguments import require_one_of, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.forces import refuse_states
from flexlink.chain.shapes import refuse_shapes
from flexlink.common.errors import MissingDependencyError, how_to_install
from flexlink.describe.scene import Scene
from flexlink.describe.tie import refuse_ties
from flexlink.engines.base import Engine, ForeignFile, refuse_held_joints
from flexlink.engines.child_process import IsolatedEngine


class Adapter(NamedTuple):
    """Module and class of an engine, the extra that installs it, and whether it runs in a child process."""

    module: str
    class_name: str
    extra: str = ""
    isolated: bool = False
    between_joints: bool = True  # whether it has springs and dampers between two joints; if not, flexlink computes them
    holds: bool = False  # whether joints may have a given motion
    ties: bool = True  # whether a scene may have ties


ENGINES = {
    "native": Adapter("flexlink.diagnosis.native", "NativeEngine", holds=True),
    "pinocchio": Adapter("flexlink.engines.pinocchio", "PinocchioEngine", "engines", between_joints=False, holds=True),
    "mujoco": Adapter("flexlink.engines.mujoco", "MujocoEngine", "engines"),
    "exudyn": Adapter("flexlink_witnesses.exudyn", "ExudynEngine", "witness", ties=False),
    "drake": Adapter("flexlink_witnesses.drake", "DrakeEngine", "witness", True, between_joints=False, ties=False),
}

__all__ = ["ENGINES", "Adapter", "Engine", "load"]


def load(name: str, chain: Chain, *, ties: Scene | None = None) -> Engine:
    """Build a chain, with the ties of a scene, in one of `ENGINES`; others than "native" load the text of its export.

    Errors: the engine is unknown, is not installed, cannot represent this chain, or its child process ended.
    """
    adapter = require_one_of("engine", name, ENGINES)
    require_type("chain", chain, Chain)
    refuse_ties([] if ties is None or adapter.ties else ties.ties, f"engine {name!r} has no ties")
    if name != "native":
        refuse_states(chain, "other engines do not support it")
        refuse_shapes(chain, f"engine {name!r}")
    return IsolatedEngine(name, chain) if adapter.isolated else load_here(name, chain, ties=ties)


def load_here(name: str, source: Chain | ForeignFile, *, ties: Scene | None = None) -> Engine:
    """Build a chain or a foreign file in an engine, like `load`, but always in this process."""
    adapter = require_one_of("engine", name, ENGINES)
    try:
        module = importlib.import_module(adapter.module)
    except ImportError as error:
        why = f"engine {name!r} cannot be imported ({error}); install it with: {how_to_install(adapter.extra)}"
        raise MissingDependencyError(why, id="package-missing") from error
    cls = getattr(module, adapter.class_name)
    foreign = isinstance(source, ForeignFile)
    if not foreign and not adapter.holds:
        refuse_held_joints(cls.title, require_type("chain", source, Chain))
    held = () if ties is None or name == "native" else (ties,)
    engine: Engine = cls.from_file(source) if foreign else cls(require_type("chain", source, Chain), *held)
    return engine
