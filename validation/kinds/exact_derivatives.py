"""Derivatives of random arms against finite differences in 60 digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.dynamics.rounding import EPS, ROUNDINGS
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles.spatial_chain import derivatives
from validation.random_arms import random_arm

DERIVATIVES = "∂q̈/∂q", "∂q̈/∂q̇", "∂q̈/∂T_EX"
CLOSE_TO = 1e-12


def run(case: Case, arms: int, joints: tuple[int, int], seed: int = 0) -> Iterator[Measured]:
    """For each derivative, yield the largest error, also relative to rounding, and the share of arms within `CLOSE_TO`.

    Only arms whose number of joints is in the range `joints` count; `seed` is the first seed.
    """
    errors, seeds, conditions, sizes = [], [], [], []
    for number, chain in _arms(arms, joints, seed):
        rng = np.random.default_rng(number)
        q, qd = rng.uniform(-np.pi, np.pi, chain.n), rng.uniform(-10.0, 10.0, chain.n)
        q = np.where(np.isin(np.arange(chain.n), chain.active), q, q / 6)  # passive hinge angles are up to 30°
        tau, wrench = rng.normal(size=chain.n), rng.normal(size=6)
        found = fl.forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=wrench)
        exact = derivatives(chain, q, qd, tau, wrench)
        errors.append(
            [_error(ours, theirs) for ours, theirs in zip((found.dq, found.dqd, found.dtau), exact, strict=True)]
        )
        conditions.append(np.linalg.cond(fl.mass_matrix(chain, q)))
        sizes.append(chain.n)
        seeds.append(number)
    facts: Facts = {"arms": arms}
    for name, column in zip(DERIVATIVES, np.transpose(errors), strict=True):
        k = int(np.argmax(column))
        note = f"Largest for arm {seeds[k]}, with cond(M) = {conditions[k]:.1e}."
        yield Measured(name, float(column[k]), "random arms", "native", facts, note=note)
        explained = column / (ROUNDINGS * EPS * np.sqrt(sizes) * conditions)
        yield Measured(f"{name}, by rounding", float(explained.max()), "random arms", "native", facts)
        yield Measured(f"{name}, share", float(np.mean(column <= CLOSE_TO)), "random arms", "native", facts)


def _arms(arms: int, joints: tuple[int, int], seed: int) -> Iterator[tuple[int, Chain]]:
    fewest, most = joints
    for _ in range(arms):
        while not fewest <= (chain := lump(random_arm(seed))).n <= most:
            seed += 1
        yield seed, chain
        seed += 1


def _error(ours: NDArray[np.float64], exact: NDArray[np.float64]) -> float:
    """Largest error relative to the largest element; absolute if all elements are zero to the last digit."""
    largest = np.abs(exact).max()
    return float(np.abs(ours - exact).max() / (largest if largest > 1e-30 else 1.0))
