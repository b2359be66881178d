"""compare(scene, engines) → Comparison: the same arm in several engines at random states, term by term.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Error of a quantity at one state: max |Δ| / max |native|, over all joints; then the maximum over the states. The
error of q̈ is divided by what rounding alone may do to a linear solve, 10 · eps · cond(M).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.checks import all_given, given, integer
from flexlink.engines import Engine, load
from flexlink.scene import Scene

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)

RATE, TORQUE, WRENCH = 10.0, 10.0, 10.0
"""Ranges of the random states: |q̇| [rad/s], |T_EX| on active joints [N m], tip force and moment [N, N m]."""


class State(NamedTuple):
    """A random state with its loads."""

    q: Array
    qd: Array
    tau: Array
    wrench: Array


class Quantity(NamedTuple):
    """How one term of the equation of motion is evaluated, and the largest error that rounding explains."""

    evaluate: Callable[[Engine, State], Array]
    bound: float


QUANTITIES: dict[str, Quantity] = {
    "M": Quantity(lambda e, s: e.mass_matrix(s.q), 1e-13),
    "T_G": Quantity(lambda e, s: e.gravity_torque(s.q), 1e-12),
    "T_GC": Quantity(lambda e, s: e.bias_torque(s.q, s.qd), 1e-12),
    "T_GC with tip wrench": Quantity(lambda e, s: e.bias_torque(s.q, s.qd, s.wrench), 1e-12),
    "T_FL": Quantity(lambda e, s: e.elastic_torque(s.q), 1e-12),
    "T_FR": Quantity(lambda e, s: e.friction_torque(s.qd), 1e-12),
    "q̈": Quantity(lambda e, s: e.forward_dynamics(s.q, s.qd, s.tau, s.wrench), 1.0),
}
"""M, T_GC, …: relative; q̈: in units of 10 · eps · cond(M)."""

CAUSES = {
    "M": "masses, centres, inertias, placements or armature",
    "T_G": "gravity, masses or placements",
    "T_GC": "terms in q̇: inertias or axes",
    "T_GC with tip wrench": "the tip frame or the wrench's point or axes",
    "T_FL": "stiffness or rest angle",
    "T_FR": "damping or Coulomb friction",
    "q̈": "the solver, or a term left out of forward dynamics",
}


@dataclasses.dataclass(frozen=True)
class Difference:
    """Largest difference of one quantity between one engine and the native dynamics.

    Attributes
    ----------
    engine, quantity
        What was compared.
    error, bound
        Largest error over the states, and what rounding explains.
    joint
        Name of the joint (of M: of the row) with the largest difference at the worst state.
    worst
        The state with the largest error.
    hint
        In words, what differs and how, if the bound is exceeded.
    """

    engine: str
    quantity: str
    error: float
    bound: float
    joint: str
    worst: State
    hint: str

    @property
    def passed(self) -> bool:
        """The error is within the bound (nan is not)."""
        return self.error <= self.bound


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Rows of `Difference` of one scene; prints as a table with the diagnosis below."""

    scene: str
    samples: int
    rows: tuple[Difference, ...]

    @property
    def passed(self) -> bool:
        """Every quantity of every engine is within its bound."""
        return all(row.passed for row in self.rows)

    @property
    def diagnosis(self) -> str:
        """One sentence per engine: what agrees, what differs, at which joint, and the likely cause."""
        return "\n".join(self._diagnose(engine) for engine in dict.fromkeys(row.engine for row in self.rows))

    def _diagnose(self, engine: str) -> str:
        rows = [row for row in self.rows if row.engine == engine]
        bad = {row.quantity: row for row in rows if not row.passed}
        if not bad:
            return f"{engine}: all {len(rows)} quantities agree"
        roots = [bad[name] for name in bad if not any(part in bad for part in PARTS.get(name, ()))]
        good = [row.quantity for row in rows if row.passed]
        told = "; ".join(f"{row.quantity} differs: {row.hint}" for row in roots)
        follows = [name for name in bad if name not in {row.quantity for row in roots}]
        tail = f" ({', '.join(follows)} differ with it)" if follows else ""
        return f"{engine}: {', '.join(good) or 'nothing'} agree{'s' if not good else ''}, but {told}{tail}"

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self.samples} random states against native"]
        lines.append(f"{'engine':<12}{'quantity':<24}{'error':>12}{'bound':>12}  {'':<6}worst joint")
        for row in self.rows:
            verdict = "ok" if row.passed else "FAILED"
            lines.append(
                f"{row.engine:<12}{row.quantity:<24}{row.error:>12.2e}{row.bound:>12.2e}  {verdict:<7}{row.joint}"
            )
        return "\n".join([*lines, self.diagnosis])


PARTS = {
    "T_GC": ("M", "T_G"),
    "T_G": ("M",),
    "T_GC with tip wrench": ("T_GC",),
    "q̈": ("M", "T_GC", "T_GC with tip wrench", "T_FL", "T_FR"),
}
"""A quantity that differs because one of these does is not named as a cause of its own."""


def compare(
    scene: Scene, engines: Sequence[str] = ("pinocchio", "mujoco"), samples: int = 200, seed: int = 0
) -> Comparison:
    """Compare engines, which load the exported arm, with the native dynamics at random states.

    Angles over the full range (−π, π), rates, drive torques and wrench up to `RATE`, `TORQUE`, `WRENCH`.

    Parameters
    ----------
    scene
        The scene; its chain and gravity are used, its initial state, drive and motions are not.
    engines
        Names that `flexlink.engines.load` knows.
    samples
        Number of random states.
    seed
        Of the random numbers (PCG64).

    Raises
    ------
    ArgumentError
        `scene` is no Scene, `samples` < 1, `seed` < 0, or an unknown engine.
    MissingDependencyError
        An engine is not installed.
    """
    given("scene", scene, Scene)
    samples, seed, engines = (
        integer("samples", samples, 1),
        integer("seed", seed, 0),
        all_given("engines", engines, str),
    )
    chain = msgspec.structs.replace(scene, motion=()).chain()  # prescribed joints are free in the exported files
    native = load("native", chain)
    loaded = [load(name, chain) for name in engines]
    return Comparison(scene.name, samples, compare_engines(chain, native, loaded, random_states(chain, samples, seed)))


def compare_engines(
    chain: Chain, native: Engine, engines: Sequence[Engine], states: Sequence[State]
) -> tuple[Difference, ...]:
    """Every quantity of every engine against `native` at the given states."""
    bounds = [10 * EPS * np.linalg.cond(native.mass_matrix(s.q)) for s in states]
    rows = []
    for name, quantity in QUANTITIES.items():
        expected = np.array([quantity.evaluate(native, s) for s in states])
        unit = np.array(bounds) if name == "q̈" else np.ones(len(states))
        for engine in engines:
            got = np.array([quantity.evaluate(engine, s) for s in states])
            rows.append(_difference(chain, engine.name, name, quantity.bound, states, got, expected, unit))
    order = [engine.name for engine in engines]
    return tuple(sorted(rows, key=lambda row: order.index(row.engine)))


def random_states(chain: Chain, samples: int, seed: int = 0) -> list[State]:
    """Independent uniform states over the ranges that `compare` states."""
    random = np.random.default_rng(seed)
    states = []
    for _ in range(samples):
        tau = np.zeros(chain.n)
        q, qd = random.uniform(-np.pi, np.pi, chain.n), random.uniform(-RATE, RATE, chain.n)
        tau[chain.active] = random.uniform(-TORQUE, TORQUE, len(chain.active))
        states.append(State(q, qd, tau, random.uniform(-WRENCH, WRENCH, 6)))
    return states


def _difference(
    chain: Chain,
    engine: str,
    name: str,
    bound: float,
    states: Sequence[State],
    got: Array,
    expected: Array,
    unit: Array,
) -> Difference:
    delta = np.abs(got - expected).reshape(len(states), chain.n, -1).max(axis=2)
    size = np.abs(expected).reshape(len(states), -1).max(axis=1)
    error = delta.max(axis=1) / np.where(size > 0, size, 1.0) / unit
    worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
    k = int(np.argmax(delta[worst]))
    hint = "" if error[worst] <= bound else _hint(chain, name, k, states, got, expected)
    return Difference(engine, name, float(error[worst]), bound, chain.joint_name(k), states[worst], hint)


def _hint(chain: Chain, name: str, k: int, states: Sequence[State], got: Array, expected: Array) -> str:
    """What the difference at the worst joint looks like over all states."""
    where = f"at joint {chain.joint_name(k)!r}"
    if not np.isfinite(got).all():
        return f"{where} the engine returns numbers that are not finite"
    if name == "M":
        return _mass_hint(where, k, got, expected)
    fits = {"T_FL": _elastic_shapes, "T_FR": _friction_shapes}
    y = got[:, k] - expected[:, k]
    if name in fits:
        shapes = fits[name](chain, k, states)
        basis = np.stack(list(shapes.values()), axis=1)
        amounts, *_ = np.linalg.lstsq(basis, y, rcond=None)
        if np.abs(basis @ amounts - y).max() <= 1e-6 * np.abs(y).max():
            shares = np.abs(basis * amounts).max(axis=0)
            found = [
                f"{label} {amount:+.6g}"
                for label, amount, share in zip(shapes, amounts, shares, strict=True)
                if share > 1e-6 * shares.max()
            ]
            return f"{where} by {' and '.join(found)}{_factor(got[:, k], expected[:, k])}"
    return f"{where}{_factor(got[:, k], expected[:, k])}; look at {CAUSES[name]}"


def _elastic_shapes(chain: Chain, k: int, states: Sequence[State]) -> dict[str, Array]:
    return {"stiffness k": np.array([s.q[k] for s in states]), "offset −k·rest": np.ones(len(states))}


def _friction_shapes(chain: Chain, k: int, states: Sequence[State]) -> dict[str, Array]:
    rates = np.array([s.qd[k] for s in states])
    return {"damping d": rates, "Coulomb torque c": np.tanh(rates / chain.hinges[k]["coulomb_width"])}


def _mass_hint(where: str, k: int, got: Array, expected: Array) -> str:
    delta = got - expected
    others = np.delete(delta[:, k], k, axis=1)
    diagonal = delta[:, k, k]
    scale = np.abs(expected).max()
    if np.ptp(diagonal) <= 1e-12 * scale and np.abs(others).max(initial=0.0) <= 1e-12 * scale:
        return f"{where} by a constant {diagonal[0]:+.6g} kg m² on the diagonal: armature"
    return f"{where}{_factor(got.ravel(), expected.ravel())}; look at {CAUSES['M']}"


def _factor(got: Array, expected: Array) -> str:
    """Words for one constant factor that explains the difference, or none."""
    square = float(expected @ expected)
    factor = float(got @ expected) / square if square else 0.0
    same = square > 0 and np.abs(got - factor * expected).max() <= 1e-6 * np.abs(got).max()
    return f" (factor {factor:.6g})" if same else ""
