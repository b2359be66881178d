"""Natural frequencies against the continuous beam: error by rule and hinges, published numbers, MuJoCo's frequencies.

Rigid-body modes, one for each free joint, are excluded; alternatively, only modes of some kinds count. If the arm
rotates steadily, its modes are vibrations about that motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import BASE_JOINTS
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.rounding import of_mass_matrix
from flexlink.dynamics.terms import mass_matrix
from flexlink.dynamics.vibration.modal import Modes, modes, relieved
from flexlink.dynamics.vibration.stability import stable_step
from flexlink.motion.inputs.initial_state import initial_state
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.physics.hinge_sweep import Point, Sweep, by_rule, order, published, report
from validation.physics.parity import load_stiffness, springs, symmetric_squares
from validation.physics.variant import Rule, Variant, existing
from validation.reference_values import reference_array
from validation.store import Series, table


class Settings(Sweep, frozen=True, kw_only=True):
    """Settings of the comparison.

    The error of a mode in the sweep is the largest over the variants; with `apart`, each variant has separate measures.
    `best` is the chain compared with the published numbers. The reference file contains ω if `power` is 1 and √ω if it
    is 2, in rad/s or Hz. `axes` are the hinge axes that move: 1 twists, 2 and 3 bend. If `kinds` are named, only modes
    of these kinds of `fl.modes` count. `price` adds the largest stable step of each chain.
    """

    reference: str
    best: Rule
    variant: tuple[Variant, ...]
    modes: int = 3
    power: Literal[1, 2] = 1
    unit: Literal["rad/s", "Hz"] = "rad/s"
    axes: tuple[int, ...] = (1, 2, 3)
    kinds: tuple[str, ...] = ()
    apart: bool = False
    price: bool = False


def error_at(case: Case, settings: Settings, at: Rule) -> float:
    """Largest relative error of a frequency over all variants and modes, for a data sheet."""
    return _worst(case, settings, at, lambda scene, variant: _frequencies(scene, variant, settings))


def mujoco_error_at(case: Case, settings: Settings, at: Rule) -> float:
    """Largest relative error of a frequency by MuJoCo's M and torques, from the exported file.

    Raises
    ------
    ArgumentError
        The settings select modes by kind, which MuJoCo does not determine.
    """
    if settings.kinds:
        raise ArgumentError("MuJoCo does not determine the kinds of modes")

    def found(scene: Scene, variant: Variant) -> Array:
        state = _state(scene, variant, settings)
        squares = _mujoco_squares(state)[state.rigid :][: settings.modes]
        ω = np.append(np.sqrt(squares), np.full(settings.modes - len(squares), np.inf))
        return ω / (2 * np.pi) if settings.unit == "Hz" else ω

    return _worst(case, settings, at, found)


@kind(sheet={"native": error_at, "mujoco": mujoco_error_at})
def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the sweep over rules and hinges, then every variant with the best chain, native and in MuJoCo."""
    points = []
    for at, scenes in existing(case, settings.rules, settings.variant):
        errors = [
            np.abs(_frequencies(scene, variant, settings) / _exact(variant, settings) - 1)
            for scene, variant in zip(scenes, settings.variant, strict=True)
        ]
        points.append(Point(at, _measures(errors, settings)))
    yield from report(settings, points, case.about)
    if not settings.apart:
        first = settings.last("mode 1", by_rule(points, "mode 1").get(settings.best.rule, {}))
        if len(first) > 1:
            yield Measured("order of the best rule in mode 1", order(first), varied={"rule": settings.best.rule})
    if settings.price:
        yield from _price(case, settings, points)
    pairs = []
    for variant in settings.variant:
        scene = variant.build(case, settings.best)
        ours, exact = _frequencies(scene, variant, settings), _exact(variant, settings)
        for k in range(settings.modes):
            pairs.append((", ".join(part for part in (variant.name, f"mode {k + 1}") if part), exact[k], ours[k]))
            note = f"{ours[k]:.8g} {settings.unit}, published or exact {exact[k]:.8g}."
            error = abs(ours[k] / exact[k] - 1)
            yield Measured(f"error of mode {k + 1}", error, varied=_facts(variant, settings), note=note)
        yield _parity(scene, variant, settings)
    yield published(pairs, f"{case.title} ({settings.best})")


def _worst(case: Case, settings: Settings, at: Rule, found: Callable[[Scene, Variant], Array]) -> float:
    pairs = ((found(v.build(case, at), v), _exact(v, settings)) for v in settings.variant)
    return max(float(np.abs(ω / exact - 1).max()) for ω, exact in pairs)


def _measures(errors: Sequence[Array], settings: Settings) -> dict[str, float]:
    """Errors by measure, from the errors of each variant's modes."""
    if not settings.apart:
        return {f"mode {k + 1}": float(e) for k, e in enumerate(np.max(errors, axis=0))}
    named = zip(settings.variant, errors, strict=True)
    return {f"{variant.name}, mode {k + 1}": float(e) for variant, found in named for k, e in enumerate(found)}


def _facts(variant: Variant, settings: Settings) -> Facts:
    return ({"situation": variant.name} if variant.name else {}) | {**settings.best.facts}


def _exact(variant: Variant, settings: Settings) -> Array:
    return reference_array(settings.reference, *variant.keys)[: settings.modes] ** settings.power


class _State(NamedTuple):
    """A chain and the state about which it vibrates."""

    chain: Chain
    q: Array
    qd: Array
    still: list[int]  # joints that are locked or rotate steadily
    rigid: int  # number of rigid modes

    @property
    def modes(self) -> Modes:
        """All modes."""
        return modes(self.chain, self.q, self.qd, locked=self.still)

    @property
    def mass(self) -> Array:
        """M of the modes: cells under tension lend less inertia to the last segment of a link."""
        return mass_matrix(relieved(self.chain, self.q, self.qd, np.zeros(6), "world")[0], self.q)


def _state(scene: Scene, variant: Variant, settings: Settings) -> _State:
    chain = lump(scene)
    held = [chain.index(scene.arm.number(link), 0, 0) for link in variant.hold]
    still = [k for k, c in enumerate(chain.coordinates) if c.link and c.axis and c.axis not in settings.axes]
    rigid = len(chain.active) - len(held) + BASE_JOINTS * chain.has_free_base
    return _State(chain, *initial_state(scene, chain), held + still, rigid)


def _frequencies(scene: Scene, variant: Variant, settings: Settings) -> Array:
    state = _state(scene, variant, settings)
    found = state.modes
    counts = np.isin(found.kinds, settings.kinds) if settings.kinds else np.arange(len(found.kinds)) >= state.rigid
    ω = found.frequencies[counts][: settings.modes]
    ω = np.append(ω, np.full(settings.modes - len(ω), np.inf))  # ω of modes that the chain does not have
    return ω / (2 * np.pi) if settings.unit == "Hz" else ω


def _parity(scene: Scene, variant: Variant, settings: Settings) -> Measured:
    """Largest difference of ω² in units of ‖M⁻¹‖₂ ΔM ω_max², with ΔM the rounding error of M."""
    state = _state(scene, variant, settings)
    chain, q, _, locked, rigid = state
    free = np.setdiff1d(np.arange(chain.n), np.array(locked, dtype=np.intp))
    theirs = _mujoco_squares(state)
    ours = state.modes.frequencies**2
    inverse = 1 / np.linalg.norm(state.mass[np.ix_(free, free)], -2)  # −2: the smallest singular value
    unit = inverse * of_mass_matrix(chain, q) * ours.max()
    first = np.abs(np.sqrt(theirs[rigid : rigid + settings.modes] / ours[rigid : rigid + settings.modes]) - 1).max()
    note = f"The first {settings.modes} frequencies differ relatively by at most {first:.1g}."
    value = float(np.abs(theirs - ours).max() / unit)
    return Measured("MuJoCo's frequencies", value, "", "mujoco", _facts(variant, settings), note=note)


def _mujoco_squares(state: _State) -> Array:
    """ω² of all modes, from MuJoCo's M and torques."""
    chain, q, qd, locked, _ = state
    free = np.setdiff1d(np.arange(chain.n), np.array(locked, dtype=np.intp))
    engine = engines.load("mujoco", chain)
    freed = state.mass - mass_matrix(chain, q)
    return symmetric_squares(engine, q, springs(engine) + load_stiffness(engine, q, qd=qd), free, freed)


def _price(case: Case, settings: Settings, points: Sequence[Point]) -> Iterator[Measured | Series]:
    """Yield the largest stable RK4 step of every chain of the first variant, and hinges × steps per second."""
    rows = []
    for point in points:
        step = stable_step(lump(settings.variant[0].build(case, point.at)))
        rows.append((point.at.rule, point.at.hinges / step, point.errors["mode 1"]))
        if point.at.hinges == settings.best.hinges:
            yield Measured("stable step of RK4", step, varied=point.at.facts)
    columns = table(("rule", "hinges × steps per second", "error"), rows)
    yield Series(
        "price", "Price of the first mode", columns, "hinges × steps per second", "hinges × RK4 steps per second",
        "error of mode 1", "log", "log", group="rule",
    )  # fmt: skip
