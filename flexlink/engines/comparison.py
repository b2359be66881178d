"""compare(scene, engines) → Comparison: the same arm in several engines, term by term, at many states.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Every error is in units of what rounding explains (`dynamics.rounding`), so that 1 is the most that two right programs
may differ by. Accelerations are compared as the torques M Δq̈ that the difference stands for.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.arguments import all_given, given, integer
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import in_units
from flexlink.engines import Engine, load
from flexlink.engines.diagnosis import diagnosis
from flexlink.engines.states import State, mixed_states

Array = NDArray[np.float64]

MOST_SAMPLES = 100_000  # at some milliseconds each
STUDIED = 200  # states at which a difference is looked at for its cause
PIECES = 200  # progress is reported about this often


class Term(NamedTuple):
    """How one term of the equation of motion is evaluated, and two values compared: (n,) or (n, n), 1 is allowed."""

    evaluate: Callable[[Engine, State], Array]
    error: Callable[[Chain, State, Array, Array], Array]


QUANTITIES: dict[str, Term] = {
    "M": Term(
        lambda e, s: e.mass_matrix(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_mass_matrix(c, s.q)),
    ),
    "T_G": Term(
        lambda e, s: e.gravity_torque(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, np.zeros(c.n))),
    ),
    "T_GC": Term(
        lambda e, s: e.bias_torque(s.q, s.qd),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, s.qd)),
    ),
    "T_GC with tip wrench": Term(
        lambda e, s: e.bias_torque(s.q, s.qd, tip_wrench=s.wrench),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, s.qd, tip_wrench=s.wrench)),
    ),
    "T_FL": Term(
        lambda e, s: e.elastic_torque(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_elastic_torque(c, s.q)),
    ),
    "T_FR": Term(
        lambda e, s: e.friction_torque(s.qd),
        lambda c, s, one, other: in_units(one - other, rounding.of_friction_torque(c, s.qd)),
    ),
    "q̈": Term(
        lambda e, s: e.forward_dynamics(s.q, s.qd, s.tau, tip_wrench=s.wrench),
        lambda c, s, one, other: rounding.acceleration_error(
            c, s.q, s.qd, s.tau, solutions=(one, other), tip_wrench=s.wrench
        ),
    ),
}


@dataclasses.dataclass(frozen=True)
class Difference:
    """Largest difference of one quantity between one engine and the native dynamics.

    Attributes
    ----------
    engine, quantity
        What was compared.
    error
        Largest error over the states and joints, in units of what rounding explains.
    joint
        Name of the joint (of M: of the row) where it is largest.
    worst
        The state with the largest error.
    hint
        In words, what differs and how, if the error is more than rounding explains.
    """

    engine: str
    quantity: str
    error: float
    joint: str
    worst: State = dataclasses.field(repr=False)
    hint: str

    @property
    def passed(self) -> bool:
        """Rounding explains the error (never nan)."""
        return self.error <= 1


@dataclasses.dataclass(frozen=True, repr=False)
class Comparison:
    """Rows of `Difference` of one scene; prints as a table with the diagnosis below."""

    scene: str
    samples: int
    rows: tuple[Difference, ...]

    def __repr__(self) -> str:
        agree = sum(row.passed for row in self.rows)
        return f"<Comparison {self.scene!r}: {agree} of {len(self.rows)} quantities agree at {self.samples} states>"

    @property
    def passed(self) -> bool:
        """Rounding explains every difference."""
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
        lines = [f"{self.scene}: {self.samples} states against native; up to 1, rounding explains the difference"]
        lines.append(f"{'engine':<12}{'quantity':<24}{'error / what rounding explains':<32}{'':<8}worst joint")
        for row in self.rows:
            dots = row.quantity.count("\u0308")  # of q̈: a character that takes no room
            verdict, joint = "ok" if row.passed else "FAILED", row.joint if row.error else "–"
            lines.append(f"{row.engine:<12}{row.quantity:<{24 + dots}}{row.error:<32.2g}{verdict:<8}{joint}")
        return "\n".join([*lines, self.diagnosis])


PARTS = {
    "T_GC": ("M", "T_G"),
    "T_G": ("M",),
    "T_GC with tip wrench": ("T_GC",),
    "q̈": ("M", "T_GC", "T_GC with tip wrench", "T_FL", "T_FR"),
}
"""A quantity that differs because one of these does is not named as a cause of its own."""


def compare(
    scene: Scene,
    *,
    engines: Sequence[str] = ("pinocchio", "mujoco"),
    samples: int = 200,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare engines, which load the exported arm, with the native dynamics at states of every kind.

    Half of the states are drawn at random, a quarter are balanced, a quarter stretched out (`states.mixed_states`).

    Parameters
    ----------
    scene
        The scene; its chain and gravity are used, its initial state, drive and motions are not.
    engines
        Names that `flexlink.engines.load` knows.
    samples
        Number of states, up to `MOST_SAMPLES`.
    seed
        Of the random numbers (PCG64).
    progress
        Called with the finished fraction, from 0 to 1, now and then.

    Returns
    -------
    Comparison
        For every engine and quantity the largest difference, and what it looks like; prints as a table.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, `samples` out of range, `seed` < 0, an unknown engine, or one that cannot hold this arm.
    MissingDependencyError
        An engine is not installed.
    SingularMassError
        M is positive definite at none of the postures tried.
    """
    given("scene", scene, Scene)
    samples, seed = integer("samples", samples, 1, MOST_SAMPLES), integer("seed", seed, 0)
    engines = all_given("engines", engines, str)
    chain = lump(scene.varied({"motion": ()}))  # prescribed joints are free in the exported files
    native = load("native", chain)
    loaded = [load(name, chain) for name in engines]
    rows = compare_engines(chain, native, loaded, mixed_states(chain, samples, seed=seed), progress=progress)
    return Comparison(scene.name, samples, rows)


def compare_engines(
    chain: Chain,
    native: Engine,
    engines: Sequence[Engine],
    states: Sequence[State],
    *,
    progress: Callable[[float], None] | None = None,
) -> tuple[Difference, ...]:
    """Every quantity of every engine against `native` at the given states."""
    worst: dict[tuple[int, str], _Worst] = {}
    for number, state in enumerate(states):
        for name, quantity in QUANTITIES.items():
            expected = quantity.evaluate(native, state)
            for each, engine in enumerate(engines):
                error = quantity.error(chain, state, quantity.evaluate(engine, state), expected)
                found = _largest(error.reshape(chain.n, -1), state)
                worst[each, name] = max(worst.get((each, name), found), found, key=lambda one: one.rank)
        if progress is not None and (number + 1) % max(1, len(states) // PIECES) == 0:
            progress((number + 1) / len(states))
    some = states[:STUDIED]
    return tuple(
        _difference(chain, native, engine, name, worst[each, name], some)
        for each, engine in enumerate(engines)
        for name in QUANTITIES
    )


class _Worst(NamedTuple):
    error: float
    k: int
    state: State

    @property
    def rank(self) -> float:
        """Numbers that are not finite are the worst of all."""
        return math.inf if math.isnan(self.error) else self.error


def _largest(error: Array, state: State) -> _Worst:
    """Of (n, …) errors, with its row."""
    rows = np.where(np.isnan(error), np.inf, error).max(axis=1)
    k = int(np.argmax(rows))
    return _Worst(float(error[k].max()), k, state)


def _difference(
    chain: Chain, native: Engine, engine: Engine, name: str, worst: _Worst, states: Sequence[State]
) -> Difference:
    hint = ""
    if not worst.error <= 1:
        seen = [worst.state, *states]
        got, expected = (np.array([QUANTITIES[name].evaluate(e, s) for s in seen]) for e in (engine, native))
        hint = diagnosis(chain, name, worst.k, seen, got, expected)
    return Difference(engine.name, name, worst.error, chain.joint_name(worst.k), worst.state, hint)
