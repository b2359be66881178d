"""What a difference between an engine and the native dynamics looks like, and what may have caused it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.engines.states import State

Array = NDArray[np.float64]

CAUSES = {
    "M": "masses, centres, inertias, placements or armature",
    "T_G": "gravity, masses or placements",
    "T_GC": "terms in q̇: inertias or axes",
    "T_GC with tip wrench": "the tip frame or the wrench's point or axes",
    "T_FL": "stiffness or rest angle",
    "T_FR": "damping or Coulomb friction",
    "q̈": "the solver, or a term left out of forward dynamics",
}


def diagnosis(chain: Chain, name: str, k: int, states: Sequence[State], got: Array, expected: Array) -> str:
    """In words, what the difference at joint `k` looks like over all states; values (states, n) or (states, n, n)."""
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
    if square == 0 or np.abs(got - factor * expected).max() > 1e-3 * np.abs(got - expected).max():
        return ""
    return f" (factor {factor:.6g})" if abs(factor - 1) > 1e-3 else f" (factor 1 {factor - 1:+.3g})"
