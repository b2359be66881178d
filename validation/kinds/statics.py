"""Large static deflection under a tip load: error by rule and hinges; MuJoCo's torques check the equilibrium."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

import flexlink as fl
from flexlink import engines
from flexlink.chain.arguments import require_one_of
from flexlink.common.types import Array
from flexlink.engines import Engine
from validation.case import Case, Measured
from validation.facts import Facts, in_words
from validation.physics.hinge_sweep import Point, Sweep, published, report
from validation.physics.tip_loads import TIP_LOADS, TipLoad
from validation.physics.variant import Rule, Variant, existing
from validation.store import Series


class Settings(Sweep, frozen=True, kw_only=True):
    """Loads of a benchmark; `best` is the chain compared with the published numbers.

    An error is relative to the length of the beam or to the exact displacement of the tip; the error of the sweep is
    the largest over all loads.
    """

    loads: str
    only: tuple[float, ...] = ()  # sizes of loads; default: all
    best: Rule
    relative_to: Literal["length", "displacement"] = "length"


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the sweep, then every load on the best chain, native and in MuJoCo."""
    loads = _loads(case, settings)
    points = []
    for at, (scene,) in existing(case, settings.rules):
        chain = fl.lump(scene)
        worst = max(_error(settings, chain, load, _equilibrium(chain, load)) for load in loads)
        points.append(Point(at, {"tip": worst}))
    yield from report(settings, points, case.about)
    chain = fl.lump(Variant().build(case, settings.best))
    engine = engines.load("mujoco", chain)
    pairs = []
    for load in loads:
        facts: Facts = {**load.facts, **settings.best.facts}
        q = _equilibrium(chain, load)
        u = fl.tip_position(chain, q) - fl.tip_position(chain, np.zeros(chain.n))
        pairs.append((in_words(load.facts), float(np.linalg.norm(load.displacement)), float(np.linalg.norm(u))))
        note = f"Displacement {_list(u)} m, published or exact {_list(load.displacement)} m. {load.note}".strip()
        yield Measured("tip error", _error(settings, chain, load, q), varied=facts, note=note)
        yield Measured("MuJoCo's residual", _residual(engine, chain, load, q), "", "mujoco", facts)
    yield published(pairs, f"{case.title} ({settings.best})")


def error_at(case: Case, settings: Settings, at: Rule) -> float:
    """Error of the worst load, for a data sheet."""
    chain = fl.lump(Variant().build(case, at))
    return max(_error(settings, chain, load, _equilibrium(chain, load)) for load in _loads(case, settings))


def _loads(case: Case, settings: Settings) -> list[TipLoad]:
    all_loads = require_one_of(f"{case.path}: settings.loads", settings.loads, TIP_LOADS)
    return [load for load in all_loads() if not settings.only or load.size in settings.only]


def _equilibrium(chain: fl.Chain, load: TipLoad) -> Array:
    return fl.solve_static(chain, tip_wrench=load.wrench, frame=load.frame).q


def _error(settings: Settings, chain: fl.Chain, load: TipLoad, q: Array) -> float:
    rest = fl.tip_position(chain, np.zeros(chain.n))
    size = np.linalg.norm(rest if settings.relative_to == "length" else load.displacement)
    return float(np.linalg.norm(fl.tip_position(chain, q) - rest - load.displacement) / size)


def _residual(engine: Engine, chain: fl.Chain, load: TipLoad, q: Array) -> float:
    """Largest residual torque of flexlink's equilibrium in the engine, relative to the largest spring torque."""
    turn = fl.frames(chain, q).rotations[-1] if load.frame == "tip" else np.eye(3)
    wrench = np.concatenate([turn @ load.wrench[:3], turn @ load.wrench[3:]])
    left = engine.bias_torque(q, np.zeros(chain.n), tip_wrench=wrench) + engine.elastic_torque(q)
    return float(np.abs(left).max() / np.abs(engine.elastic_torque(q)).max())


def _list(u: Array) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in u) + ")"
