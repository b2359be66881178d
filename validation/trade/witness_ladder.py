"""What an error costs with engines that are optional, each in a process of its own, which may crash."""

from __future__ import annotations

import importlib
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from flexlink.common.errors import EngineError, MissingDependencyError
from validation.trade.work_precision import Point

NAMES = {"drake": "Drake", "exudyn": "Exudyn"}  # as in `flexlink.engines`, in words


def points(engine: str, name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Ladders of all integrators of an engine on a scene of the trade.

    Raises
    ------
    MissingDependencyError
        It is not installed.
    EngineError
        Its process ended.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_silence) as process:
        try:
            return process.submit(_points, engine, name, budget, smallest).result()
        except BrokenProcessPool as error:
            raise EngineError(f"{NAMES[engine]}: its process ended while {name} ran") from error


def _points(engine: str, name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    try:
        module = importlib.import_module(f"validation.trade.{engine}_ladder")
    except ImportError as error:
        raise MissingDependencyError(
            f"{NAMES[engine]} cannot be imported ({error}); install it with: python -m pip install 'flexlink[witness]'"
        ) from None
    found: dict[str, list[Point]] = module.points(name, budget, smallest)
    return found


def _silence() -> None:
    """Both engines talk, from C++."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nothing, stream)
