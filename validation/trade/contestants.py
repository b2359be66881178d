"""What takes part in a work-precision study: a program with one scene, prepared once, that runs it by some method.

`prepare` of a `with_…` module makes a contestant; a setting is a number of steps between two samples, or a tolerance.
Drake and Exudyn may crash, so their runs are made in a child process.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError, MissingDependencyError
from flexlink.describe.scene import Scene
from flexlink.engines.child_process import ChildProcess
from validation.runs import stable_steps
from validation.trade.scenes import point, seen, trade_scene
from validation.trade.work_precision import Point, Run, ladder

WITNESSES = {"drake": "Drake", "exudyn": "Exudyn"}  # programs in a child process → display names


class TooDearError(FlexlinkError):
    """A run takes longer than its limit."""


class Contestant(Protocol):
    """A program with one scene."""

    scene: Scene
    chain: Chain

    def run(self, method: str, setting: float) -> Run:
        """Run once.

        Raises
        ------
        FlexlinkError
            The program gives up, or the run takes too long (`TooDearError`).
        """


class Stepped(Contestant, Protocol):
    """A program with fixed steps."""

    def seconds_a_step(self, method: str, steps: int) -> float:
        """CPU seconds per step, from the first steps of a run with `steps` steps between samples."""


def attempt(name: str, contestant: Contestant, method: str, setting: float, value: float | None = None) -> Point:
    """A run on a scene of the trade study as a point, with `value` as its setting; its error is infinite if it fails.

    Raises
    ------
    TooDearError
        The run takes too long.
    MissingDependencyError
        The program is not installed.
    """
    value = setting if value is None else value
    try:
        found = contestant.run(method, setting)
    except (TooDearError, MissingDependencyError):
        raise
    except FlexlinkError:
        return Point(value, math.inf, 0.0)
    return point(name, seen(contestant.chain, found.q), value, found.seconds, found.evaluations)


def refined(
    name: str,
    contestant: Contestant,
    method: str,
    settings: Iterable[float],
    ends: Callable[[Point], bool] = lambda _: False,
) -> list[Point]:
    """Run with each of the settings until one takes too long or a point `ends` the ladder."""
    points: list[Point] = []
    for setting in settings:
        try:
            points.append(attempt(name, contestant, method, setting))
        except TooDearError:
            break
        if ends(points[-1]):
            break
    return points


def by_steps(name: str, contestant: Contestant, method: str, first: int, budget: float, smallest: float) -> list[Point]:
    """Run with `first` and more and more steps between samples."""
    spacing = contestant.scene.run.spacing

    def run(steps: int) -> Point:
        return attempt(name, contestant, method, steps, spacing / steps)

    return ladder(run, first, budget, smallest)


def stepped(
    name: str, contestant: Stepped, methods: Iterable[str], budget: float, smallest: float
) -> dict[str, list[Point]]:
    """Run all methods with finer and finer steps; if stable steps of RK4 exceed the budget, only estimate its time."""
    found, run = {}, contestant.scene.run
    for method in methods:
        explicit = method.startswith("RK4")
        first = stable_steps(contestant.scene, "RK4") if explicit else 1
        whole = contestant.seconds_a_step(method, first) * first * (run.samples - 1) if explicit else 0.0
        if whole > budget:
            found[method] = [Point(run.spacing / first, math.nan, whole)]
        else:
            found[method] = by_steps(name, contestant, method, first, budget, smallest)
    return found


def witnessed(program: str, name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Runs of a program in a child process, with all its methods and finer and finer settings.

    Raises
    ------
    MissingDependencyError
        The program is not installed.
    EngineError
        The program's process died.
    """
    words = f"{WITNESSES[program]}: runs of {name}"
    found: dict[str, list[Point]] = ChildProcess().call(words, 0.0, _witnessed, program, name, budget, smallest)
    return found


def _witnessed(program: str, name: str, budget: float, smallest: float) -> Mapping[str, list[Point]]:
    try:
        module = importlib.import_module(f"validation.trade.with_{program}")
    except ImportError as error:
        raise MissingDependencyError(
            f"{WITNESSES[program]} cannot be imported ({error}); "
            "install it with: python -m pip install 'flexlink[witness]'"
        ) from None
    found: Mapping[str, list[Point]] = module.points(name, trade_scene(name), budget, smallest)
    return found
