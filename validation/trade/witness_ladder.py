"""Cost of a given error with optional engines, each in a separate process, which may crash."""

from __future__ import annotations

import importlib

from flexlink.common.errors import MissingDependencyError
from flexlink.engines.child_process import ChildProcess
from validation.trade.work_precision import Point

NAMES = {"drake": "Drake", "exudyn": "Exudyn"}  # name in `flexlink.engines` → display name


def points(engine: str, name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators of an engine, with finer and finer settings, on a scene of the trade study.

    Raises
    ------
    MissingDependencyError
        The engine is not installed.
    EngineError
        The engine's process died.
    """
    found: dict[str, list[Point]] = ChildProcess().call(
        f"{NAMES[engine]}: runs of {name}", 0.0, _points, engine, name, budget, smallest
    )
    return found


def _points(engine: str, name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    try:
        module = importlib.import_module(f"validation.trade.{engine}_ladder")
    except ImportError as error:
        raise MissingDependencyError(
            f"{NAMES[engine]} cannot be imported ({error}); install it with: python -m pip install 'flexlink[witness]'"
        ) from None
    found: dict[str, list[Point]] = module.points(name, budget, smallest)
    return found
