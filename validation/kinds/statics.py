"""Large deflections and critical loads of beams, native and in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from scipy import linalg

import flexlink as fl
from flexlink import engines
from flexlink.chain.arguments import require_one_of
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.describe.spec import Spec, Vector3
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.engines import Engine
from flexlink.engines.mujoco import MujocoEngine
from validation.case import Case, Measured
from validation.facts import Fact, Facts, in_words
from validation.kinds import kind
from validation.physics.hinge_sweep import Point, Sweep, published, report
from validation.physics.parity import follower_stiffness, load_stiffness, springs, squares
from validation.physics.variant import Rule, Variant, existing
from validation.reference_values import look_up, reference_array
from validation.store import Series

PRINCETON_ANGLES = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]  # deg


class TipLoad(NamedTuple):
    """A load on the tip and the resulting displacement."""

    facts: Facts  # size and direction of the load
    wrench: Array  # (6,) [N, N m]
    displacement: Array  # (3,) [m]
    note: str = ""  # published value
    frame: Frame = "world"  # axes of the wrench: of the world for a dead load, or of the tip

    @property
    def size(self) -> Fact:
        """The first fact."""
        return next(iter(self.facts.values()))


def elastica() -> Iterator[TipLoad]:
    """Transverse dead force α = PL²/EI on a beam with EI = L = 1 (Bisshopp & Drucker 1945)."""
    for α, exact in look_up("elastica_tip_load").items():
        u, w = float(exact["u/L (tip shortening)"]), float(exact["w/L (transverse tip deflection)"])
        yield TipLoad({"PL²/EI": float(α)}, np.array([0, float(α), 0, 0, 0, 0]), np.array([-u, w, 0]))


def roll_up() -> Iterator[TipLoad]:
    """End moment ML/2πEI on a beam with EI = L = 1: a full turn closes the circle."""
    for exact in look_up("rollup_end_moment", "continuum").values():
        x, y, turns = (float(exact[name]) for name in ("x/L", "y/L", "turns"))
        yield TipLoad({"turns": turns}, np.array([0, 0, 0, 0, 0, 2 * np.pi * turns]), np.array([x - 1, y, 0]))


def princeton() -> Iterator[TipLoad]:
    """Princeton beam (Dowell & Traybar 1975): three weights at seven angles β from the height axis of the section."""
    ansys = look_up("princeton_beam", "ansys_beam_tip |uy|,uz (m) for beta=0..90 step 15")
    for exact in look_up("princeton_beam", "kirchhoff").values():
        force, angle = float(exact["force_N"]), float(exact["beta_deg"])
        β = np.radians(angle)
        wrench = np.array([0, -force * np.cos(β), force * np.sin(β), 0, 0, 0])
        displacement = np.array([exact["ux"], exact["uy(height dir)"], exact["uz(flap dir)"]])
        note = ""
        if f"{force:g}" in ansys:
            y, z = (ansys[f"{force:g}"][axis][PRINCETON_ANGLES.index(angle)] for axis in "yz")
            note = f"ANSYS, with shear and stretch: |uy| = {y:.6g} m, uz = {z:.6g} m."
        yield TipLoad({"force": force, "angle": angle}, wrench, displacement, note)


def follower() -> Iterator[TipLoad]:
    """Follower force PL²/EI at the tip of a beam with EI = L = 1; it stays normal to the beam."""
    for size, exact in look_up("bent_rods", "follower").items():
        x, y, angle = map(float, exact)
        note = f"The tip turns by {angle:.4g} rad."
        wrench = np.array([0, float(size), 0, 0, 0, 0])
        yield TipLoad({"PL²/EI": float(size)}, wrench, np.array([x - 1, y, 0]), note, "tip")


def skew() -> Iterator[TipLoad]:
    """Oblique dead force on a beam with GJ, EI_y, EI_z = 0.7, 1, 3 and L = 1: it bends about two axes and twists."""
    exact = look_up("bent_rods", "space")
    force = np.array(exact["force"])
    displacement = np.array(exact["tip"]) - [1.0, 0.0, 0.0]
    facts: Facts = {"force": float(np.linalg.norm(force))}
    yield TipLoad(facts, np.concatenate([force, np.zeros(3)]), displacement)


TIP_LOADS: dict[str, Callable[[], Iterator[TipLoad]]] = {
    "elastica": elastica,
    "roll_up": roll_up,
    "princeton": princeton,
    "follower": follower,
    "skew": skew,
}


class StaticsSettings(Sweep, frozen=True, kw_only=True):
    """Loads of a benchmark; `best` is the chain compared with the published numbers.

    An error is relative to the length of the beam or to the exact displacement of the tip; the error of the sweep is
    the largest over all loads.
    """

    loads: str
    only: tuple[float, ...] = ()  # sizes of loads; default: all
    best: Rule
    relative_to: Literal["length", "displacement"] = "length"


def error_at(case: Case, settings: StaticsSettings, at: Rule) -> float:
    """Error of the worst load, for a data sheet."""
    chain = fl.lump(Variant().build(case, at))
    return max(_error(settings, chain, load, _equilibrium(chain, load)) for load in _loads(case, settings))


@kind(sheet={"native": error_at})
def statics(case: Case, settings: StaticsSettings) -> Iterator[Measured | Series]:
    """Large static deflection under a tip load: error by rule and hinges; MuJoCo's torques check the equilibrium.

    Yield the sweep, then every load on the best chain, native and in MuJoCo.
    """
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


def _loads(case: Case, settings: StaticsSettings) -> list[TipLoad]:
    all_loads = require_one_of(f"{case.path}: settings.loads", settings.loads, TIP_LOADS)
    return [load for load in all_loads() if not settings.only or load.size in settings.only]


def _equilibrium(chain: fl.Chain, load: TipLoad) -> Array:
    return fl.solve_static(chain, tip_wrench=load.wrench, frame=load.frame).q


def _error(settings: StaticsSettings, chain: fl.Chain, load: TipLoad, q: Array) -> float:
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


class Load(Spec, frozen=True):
    """A load and its critical value: a tip force of unit size, gravity set by the variant, or a follower force.

    `bracket` is a load below the onset of flutter and a load above it. A `guided` tip stays on the line of the force.
    """

    name: str
    key: str
    variant: Variant = Variant()
    force: Vector3 = (0.0, 0.0, 0.0)
    instability: Literal["buckling", "flutter"] = "buckling"
    bracket: tuple[float, float] = (0.0, 0.0)
    guided: bool = False


class BucklingSettings(Sweep, frozen=True, kw_only=True):
    """Loads; the sweep has one measure per load. `best` is the chain compared with the published numbers."""

    load: tuple[Load, ...]
    best: Rule


def buckling_error_at(case: Case, settings: BucklingSettings, at: Rule) -> float:
    """Largest relative error of a critical load, for a data sheet."""
    return _worst(case, settings, at, _critical)


def mujoco_buckling_error_at(case: Case, settings: BucklingSettings, at: Rule) -> float:
    """Largest relative error of a critical load computed with MuJoCo's torques, from the exported file."""
    return _worst(case, settings, at, _critical_in_mujoco)


@kind(sheet={"native": buckling_error_at, "mujoco": mujoco_buckling_error_at})
def buckling(case: Case, settings: BucklingSettings) -> Iterator[Measured | Series]:
    """Critical loads of clamped beams in flexlink and MuJoCo: by linear buckling, of a follower load by flutter.

    Yield the sweep, then every load on the best chain, native and in MuJoCo.
    """
    exact = {load.name: float(reference_array("critical_loads", load.key)) for load in settings.load}
    points = []
    for at, scenes in existing(case, settings.rules, [load.variant for load in settings.load]):
        errors = {
            load.name: _critical(fl.lump(scene), load) / exact[load.name] - 1
            for scene, load in zip(scenes, settings.load, strict=True)
        }
        points.append(Point(at, errors))
    yield from report(settings, points, case.about)
    pairs = []
    for load in settings.load:
        chain = fl.lump(load.variant.build(case, settings.best))
        ours = _critical(chain, load)
        pairs.append((load.name, exact[load.name], ours))
        note = f"{ours:.8g}, published or exact {exact[load.name]:.8g}."
        facts: Facts = {"load": load.name, **settings.best.facts}
        yield Measured("critical load", abs(ours / exact[load.name] - 1), varied=facts, note=note)
        theirs = _critical_in_mujoco(chain, load)
        yield Measured("MuJoCo's critical load", abs(theirs / ours - 1), "", "mujoco", facts)
    yield published(pairs, f"{case.title} ({settings.best})")


def _worst(case: Case, settings: BucklingSettings, at: Rule, found: Callable[[fl.Chain, Load], float]) -> float:
    exact = {load.name: float(reference_array("critical_loads", load.key)) for load in settings.load}
    chains = {load.name: fl.lump(load.variant.build(case, at)) for load in settings.load}
    return max(abs(found(chains[load.name], load) / exact[load.name] - 1) for load in settings.load)


def _wrench(load: Load, size: float) -> Array:
    return np.array([*(size * np.array(load.force)), 0.0, 0.0, 0.0])


def _critical(chain: fl.Chain, load: Load) -> float:
    if load.guided:
        at_rest = np.zeros(chain.n), np.zeros(chain.n)
        K = stiffness_matrix(chain, *at_rest, np.zeros(6))
        pushed = stiffness_matrix(chain, *at_rest, _wrench(load, 1.0)) - K
        return _guided(K, pushed, lambda wrench: fl.bias_torque(chain, *at_rest, tip_wrench=wrench))
    if load.instability == "buckling":
        return float(fl.strength.buckling_loads(chain, tip_wrench=_wrench(load, 1.0))[0])
    return bisect(lambda size: fl.modes(chain, tip_wrench=_wrench(load, size), frame="tip").stable, load.bracket)


def _guided(K: Array, pushed: Array, torque: Callable[[Array], Array]) -> float:
    """The least load P at which K + P `pushed` is singular for motions that leave the tip's y coordinate unchanged.

    `torque` maps a tip wrench w to T_G − Jᵀ w, so differences of its values give Jᵀ.
    """
    across = torque(np.zeros(6)) - torque(np.eye(6)[1])
    Z = linalg.null_space(across[None, :])
    inverse = linalg.eigvalsh(-Z.T @ (pushed + pushed.T) / 2 @ Z, Z.T @ K @ Z)
    return float(1 / inverse.max())


def bisect(stable: Callable[[float], bool], bracket: tuple[float, float]) -> float:
    """Largest load for which `stable` is true, found by bisection from a stable and an unstable load."""
    low, high = bracket
    for _ in range(40):  # the bracket shrinks to rounding error
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _critical_in_mujoco(chain: fl.Chain, load: Load) -> float:
    engine, q = MujocoEngine(chain), np.zeros(chain.n)
    elastic = springs(engine)
    if load.guided:
        pushed = load_stiffness(engine, q, _wrench(load, 1.0))
        return _guided(elastic, pushed, lambda wrench: engine.bias_torque(q, np.zeros(chain.n), tip_wrench=wrench))
    if load.instability == "buckling":
        inverse = linalg.eigvals(-load_stiffness(engine, q, _wrench(load, 1.0)), elastic)
        real = inverse.real[(np.abs(inverse.imag) <= 1e-9 * np.abs(inverse).max()) & (inverse.real > 0)]
        return float(1 / real.max())
    geometric = follower_stiffness(engine, q, np.array(load.force))  # linear in the force, no gravity
    every = np.arange(chain.n)

    def stable(size: float) -> bool:
        ω2 = squares(engine, q, elastic + size * geometric, every)
        return bool(np.abs(np.sqrt(-ω2.astype(complex)).real).max() <= 1e-8 * np.sqrt(np.abs(ω2).max()))

    return bisect(stable, load.bracket)
