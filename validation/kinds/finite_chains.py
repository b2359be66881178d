"""Chains of a few cells against the exact values of the same chains: theory and code must agree to rounding error.

Since nothing is approximated, any wrong mass, lever arm or spring is visible, however small the error.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

import flexlink as fl
from flexlink import engines
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles import bending_chain, coupled_cells, hencky
from validation.physics.parity import chain_frequencies, load_stiffness, springs
from validation.physics.variant import Rule, Variant
from validation.reference_values import look_up, reference_array

CLOSED_FORMS = {"paper": "paper", "midpoint": "midpoint", "hencky": "nodal_2k"}  # rule → name in hencky_closed_forms
PUSH_ALONG_CHAIN = np.array([-1.0, 0, 0, 0, 0, 0])  # N on the tip, along the chain
ELASTICA_RULES = {"paper": "paper", "midpoint": "midpoint", "hencky": "nodal2k"}


class Settings(Spec, frozen=True):
    """Numbers of cells n of the chains; loads α = PL²/EI of the elastica; hinges of chains with 40-digit references.

    `coupled` are rules with coupled springs, each with a number of hinges.
    """

    cells: tuple[int, ...]
    elastica_cells: tuple[int, ...]
    elastica_loads: tuple[str, ...]
    turns: tuple[str, ...]
    rules: tuple[str, ...]
    hinges: int
    coupled: dict[str, int] = msgspec.field(default_factory=dict)


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Yield the largest error of each quantity and chain."""
    yield from _frequencies(case, settings)
    yield from _arm(case)
    yield from _buckling(case, settings)
    yield from _elastica(case, settings)
    yield from _roll_up(case, settings)


def _chain(case: Case, rule: str, cells: int, scene: str = "") -> fl.Chain:
    hinges = cells - 1 if rule == "paper" else cells
    return fl.lump(Variant(scene=scene).build(case, Rule(rule=rule, hinges=hinges)))


def _relative(found: ArrayLike, exact: ArrayLike) -> float:
    return float(np.abs(np.asarray(found) / np.asarray(exact) - 1).max())


def _both(chain: fl.Chain) -> Iterator[tuple[str, Array]]:
    """Frequencies of a clamped chain by flexlink and by MuJoCo, from the exported file."""
    yield "native", fl.natural_frequencies(chain)
    yield "mujoco", chain_frequencies(engines.load("mujoco", chain))


def _frequencies(case: Case, settings: Settings) -> Iterator[Measured]:
    for rule, name in CLOSED_FORMS.items():
        for n in settings.cells:
            facts: Facts = {"rule": rule, "cells": n}
            exact = reference_array("hencky_closed_forms", "dimensionless_omega_rod_chain", f"CF,{name},n={n}")
            chain = _chain(case, rule, n)
            for engine, found in _both(chain):
                yield Measured("bending frequencies", _relative(found[: len(exact)], exact), "", engine, facts)
            if rule != "hencky":  # a hencky chain's root disc would need half its inertia
                bar = _chain(case, rule, n, "torsion_bar")
                bending = [k for k, c in enumerate(bar.coordinates) if c.axis != 1]
                found = fl.natural_frequencies(bar, locked=bending)
                yield Measured("twisting frequencies", _relative(found, hencky.twist(rule, n)), varied=facts)
    for rule in settings.rules:
        at = Rule(rule=rule, hinges=settings.hinges)
        exact = bending_chain.frequencies(*lumping_rule(rule).hinges(at.hinges))
        for engine, found in _both(fl.lump(Variant().build(case, at))):
            yield Measured("all bending modes, 40 digits", _relative(found, exact), "", engine, at.facts)
    for rule, hinges in settings.coupled.items():
        at, kind = Rule(rule=rule, hinges=hinges), lumping_rule(rule).cells
        if kind is None:
            raise ArgumentError(f"{case.path}: settings.coupled: {rule} has no cells")
        exact = coupled_cells.frequencies(kind.hinges, hinges, kind.tip)
        for engine, found in _both(fl.lump(Variant().build(case, at))):
            yield Measured("all bending modes, 40 digits", _relative(found, exact), "", engine, at.facts)


def _arm(case: Case) -> Iterator[Measured]:
    """Compare with the errors that an independent program found for the straight arm with a locked elbow."""
    exact = reference_array("two_link_locked_lumped", "exact_omega")
    for rule in ("paper", "midpoint"):
        for n, errors in look_up("two_link_locked_lumped", "rel_error_first3", rule).items():
            chain = _chain(case, rule, int(n), "unit_two_links")
            found = fl.natural_frequencies(chain, locked=[int(k) for k in chain.active])[:3]
            yield Measured(
                "two-link arm", _relative(found, exact * (1 + np.array(errors))), varied={"rule": rule, "cells": int(n)}
            )


def _buckling(case: Case, settings: Settings) -> Iterator[Measured]:
    for rule in CLOSED_FORMS:
        for n in settings.cells:
            chain, exact = _chain(case, rule, n), hencky.buckling(rule, n)
            facts: Facts = {"rule": rule, "cells": n}
            loads = fl.strength.buckling_loads(chain, tip_wrench=PUSH_ALONG_CHAIN)
            yield Measured("buckling loads", _relative(loads, exact), varied=facts)
            engine = engines.load("mujoco", chain)
            geometric = load_stiffness(engine, np.zeros(chain.n), PUSH_ALONG_CHAIN)
            loads = np.sort(1 / linalg.eigvals(-geometric, springs(engine)).real)
            yield Measured("buckling loads", _relative(loads, exact), "", "mujoco", facts)


def _elastica(case: Case, settings: Settings) -> Iterator[Measured]:
    for rule, name in ELASTICA_RULES.items():
        for load in settings.elastica_loads:
            for n in settings.elastica_cells:
                exact = look_up("discrete_elastica", f"alpha={load},rule={name}", str(n))
                chain = _chain(case, rule, n)
                q = fl.solve_static(chain, tip_wrench=[0, float(load), 0, 0, 0, 0]).q
                x, y, _ = fl.tip_position(chain, q)
                error = np.array([y, 1 - x, q.sum()]) - np.array([exact[k] for k in ("w/L", "u/L", "theta_tip")], float)
                facts: Facts = {"rule": rule, "cells": n, "PL²/EI": float(load)}
                yield Measured("discrete elastica", float(np.abs(error).max()), varied=facts)


def _roll_up(case: Case, settings: Settings) -> Iterator[Measured]:
    for turns in settings.turns:
        for n in settings.cells[1:]:
            values = look_up("rollup_end_moment", "discrete_closed_form", f"n={n},ML/2piEI={turns}")
            for rule, exact in values.items():
                chain = _chain(case, rule, n)
                q = fl.solve_static(chain, tip_wrench=[0, 0, 0, 0, 0, 2 * np.pi * float(turns)]).q
                x, y, _ = fl.tip_position(chain, q)
                error = np.array([x, y, q.sum()]) - np.array([exact[k] for k in ("x/L", "y/L", "theta_tip")], float)
                facts: Facts = {"rule": rule, "cells": n, "turns": float(turns)}
                yield Measured("roll-up", float(np.abs(error).max()), varied=facts)
