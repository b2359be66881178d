"""Chains against theory: domain of validity, exact values of chains, tables of rigidity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

import flexlink as fl
from flexlink import engines
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import modes
from flexlink.dynamics.vibration.steady import equilibrium_in_motion
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.oracles import bending_chain, coupled_cells, hencky, thick_beam, transfer_beam
from validation.oracles.thick_beam import Beam
from validation.oracles.transfer_beam import Columns
from validation.physics.parity import chain_frequencies, load_stiffness, springs
from validation.physics.variant import Rule, Variant
from validation.reference_values import look_up, reference_array
from validation.store import Series, table

SHEAR_FACTOR = 5 / 6  # shear correction factor of a rectangle
RIGID = 1e30  # N: shear stiffness of a beam without shear


class ValiditySettings(Spec, frozen=True, kw_only=True):
    """Length-to-height ratios, ascending; the number of modes; axial forces relative to Euler's load; hinges.

    `within` is the largest error that counts as valid; `thin` is the slenderness of the compressed link, `stubby` that
    of the link with shear, `stations` its numbers of hinges, and `spin` the rate of the turning bar [rad/s].
    """

    slenderness: tuple[Positive, ...]
    modes: int
    within: Positive
    push: tuple[float, ...]
    hinges: tuple[int, ...]
    thin: Positive
    stubby: Positive
    stations: tuple[int, int]
    spin: Positive


@kind
def validity(case: Case, settings: ValiditySettings) -> Iterator[Measured | Series]:
    """Domain of validity: the largest relative thickness and the largest axial load at which a chain is accurate.

    By default a chain models an Euler-Bernoulli beam, without shear. The reference is Timoshenko's beam, also for a
    link with `shear`. For a link under an axial compressive force the reference is the slender beam under that force,
    and the error is due to the hinges. A turning link with `stretch` has the extension u of a bar,
    u'' + k² (x + u) = 0, with k = ω √(ρ/E).

    Yield the least slenderness at which each mode is valid, and the largest axial force for the first mode.
    """
    scene, turning = case.load_scenes()
    yield from _with_shear(scene, settings)
    yield _extension(turning, settings)
    errors = np.array([_by_shear(scene, ratio, settings.modes) for ratio in settings.slenderness])
    rows = []
    for k in range(settings.modes):
        name = f"mode {k + 1}"
        least = _crossing(np.log(settings.slenderness)[::-1], np.log(errors[::-1, k]), math.log(settings.within))
        note = f"At L/h = {settings.slenderness[0]:g} the error is {100 * errors[0, k]:.2g} %."
        yield Measured("least slenderness", math.exp(least), scene.name, varied={"measure": name}, note=note)
        rows += [(name, ratio, error) for ratio, error in zip(settings.slenderness, errors[:, k], strict=True)]
    columns = table(("mode", "L / h", "error"), rows)
    axes = "L / h", "length over height [1]", "frequency too high by [1]"
    yield Series("slenderness", case.title, columns, *axes, "log", "log", group="mode", part="shear")
    pushed = []
    for hinges in settings.hinges:
        found = np.array([_under_push(scene, settings.thin, part, hinges) for part in settings.push])
        most = _crossing(np.array(settings.push), found, settings.within)
        yield Measured("largest push", most, scene.name, varied={"hinges": hinges})
        pushed += [(f"{hinges} hinges", part, error) for part, error in zip(settings.push, found, strict=True)]
    columns = table(("hinges", "P / Pₑ", "error"), pushed)
    axes = "P / Pₑ", "push, of Euler's load [1]", "error of mode 1 [1]"
    yield Series("push", case.title, columns, *axes, "linear", "log", group="hinges", part="axial load")


def _beam(scene: Scene, ratio: float) -> tuple[Scene, Beam]:
    """The scene's link with a square section of height length / ratio, and the equivalent Timoshenko beam."""
    (link,), (material,) = scene.arm.links, scene.arm.materials.values()
    h = link.length / ratio
    thick = scene.varied({"section.bar.height": h, "section.bar.width": h})
    shear = SHEAR_FACTOR * material.young / (2 * (1 + material.poisson)) * h**2
    I = h**4 / 12
    return thick, Beam(material.young * I, material.density * h**2, material.density * I, shear, link.length)


def _by_shear(scene: Scene, ratio: float, count: int) -> Array:
    """Relative errors of the first frequencies due to shear."""
    thick, beam = _beam(scene, ratio)
    return np.asarray(modes(lump(thick)).frequencies[:count] / thick_beam.frequencies(beam, count) - 1)


def _with_shear(scene: Scene, settings: ValiditySettings) -> Iterator[Measured]:
    """Errors of the frequencies of a thick link with `shear`, and their orders."""
    thick, beam = _beam(scene, settings.stubby)
    exact, errors = thick_beam.frequencies(beam, settings.modes), []
    for count in settings.stations:
        chain = lump(thick.varied({"link.beam.shear": True, "link.beam.segments": count + 1}))
        errors.append(np.abs(modes(chain).frequencies[: settings.modes] / exact - 1))
    refined = math.log(settings.stations[1] / settings.stations[0])
    for k in range(settings.modes):
        facts: Facts = {"measure": f"mode {k + 1}", "hinges": settings.stations[0]}
        yield Measured("frequency error with shear", float(errors[0][k]), scene.name, varied=facts)
        order = math.log(errors[0][k] / errors[1][k]) / refined
        yield Measured("order with shear", order, scene.name, varied={"measure": f"mode {k + 1}"})


def _extension(scene: Scene, settings: ValiditySettings) -> Measured:
    """Relative error of the extension of a bar that turns at a constant rate."""
    (link,), (material,) = scene.arm.links, scene.arm.materials.values()
    count, L = settings.stations[0], link.length
    changes = {"stretch": True, "lumping": "gauss", "segments": count + 1}
    chain = lump(scene.varied({f"link.{link.name}.{key}": value for key, value in changes.items()}))
    found = tip_position(chain, equilibrium_in_motion(chain, {link.name: settings.spin}).q)[0] - L
    k = settings.spin * math.sqrt(material.density / material.young)
    exact = math.tan(k * L) / k - L
    note = f"{1e3 * exact:.3g} mm at {settings.spin:g} rad/s."
    return Measured("extension error", abs(found / exact - 1), scene.name, varied={"hinges": count}, note=note)


def _under_push(scene: Scene, ratio: float, part: float, hinges: int) -> float:
    """|error| of a chain's first frequency under the axial force `part` × Euler's load."""
    thin, beam = _beam(scene, ratio)
    push = part * math.pi**2 / 4 * beam.EI / beam.length**2
    chain = lump(thin.varied({"link.beam.segments": hinges + 1}))
    found = modes(chain, tip_wrench=[-push, 0, 0, 0, 0, 0]).frequencies[0]
    exact = thick_beam.frequencies(beam._replace(rotary=0.0, shear=RIGID, push=push), 1)[0]
    return float(abs(found / exact - 1))


def _crossing(x: Array, error: Sequence[float] | Array, bound: float) -> float:
    """Linearly interpolated x at which an error that grows along x passes a bound; nan if it does not."""
    for k in range(1, len(x)):
        low, high = error[k - 1], error[k]
        if low <= bound < high:
            return float(x[k - 1] + (x[k] - x[k - 1]) * (bound - low) / (high - low))
    return math.nan


CLOSED_FORMS = {"paper": "paper", "midpoint": "midpoint", "hencky": "nodal_2k"}  # rule → name in hencky_closed_forms
PUSH_ALONG_CHAIN = np.array([-1.0, 0, 0, 0, 0, 0])  # N on the tip, along the chain
ELASTICA_RULES = {"paper": "paper", "midpoint": "midpoint", "hencky": "nodal2k"}


class FiniteChainsSettings(Spec, frozen=True):
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


@kind
def finite_chains(case: Case, settings: FiniteChainsSettings) -> Iterator[Measured]:
    """Chains of a few cells against the exact values of the same chains: theory and code must agree to rounding error.

    Since nothing is approximated, any wrong mass, lever arm or spring is visible, however small the error.

    Yield the largest error of each quantity and chain.
    """
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


def _frequencies(case: Case, settings: FiniteChainsSettings) -> Iterator[Measured]:
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


def _buckling(case: Case, settings: FiniteChainsSettings) -> Iterator[Measured]:
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


def _elastica(case: Case, settings: FiniteChainsSettings) -> Iterator[Measured]:
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


def _roll_up(case: Case, settings: FiniteChainsSettings) -> Iterator[Measured]:
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


@kind
def rigidity_tables(
    case: Case, modes: int, chains: tuple[Rule, ...], force: Positive, fibre: float
) -> Iterator[Measured]:
    """Links given by tables of rigidity and mass: frequencies, curvature, strain.

    Yield errors of the first frequencies, and of curvature and strain under a small transverse tip force [N].

    `fibre` is the distance of the gauge from the line through the centroids [m].
    """
    for scene in case.load_scenes():
        columns = _columns(scene)
        exact = transfer_beam.frequencies(columns, modes)
        for rule in chains:
            cut = Variant(scene=scene.name).build(case, rule)
            found = fl.modes(fl.lump(cut), count=modes).frequencies
            for k in range(modes):
                note = f"{found[k]:.8g} rad/s, transfer matrix {exact[k]:.8g}."
                error = abs(found[k] / exact[k] - 1)
                yield Measured(f"mode {k + 1}", error, scene.name, varied=rule.facts, note=note)
            rest = fl.solve_static(fl.lump(cut), tip_wrench=[0, force, 0, 0, 0, 0])
            gauges = fl.strength.beam_strain(cut, rest.q, link=1, fibre=(fibre, 0.0))
            κ = np.array(transfer_beam.curvature(columns, force, gauges.x.tolist()))
            of_κ = float(np.abs(gauges.curvature[:, 2] / κ - 1).max())
            yield Measured("curvature", of_κ, scene.name, varied=rule.facts)
            yield Measured(
                "strain", float(np.abs(gauges.strain / (-fibre * κ) - 1).max()), scene.name, varied=rule.facts
            )


def _columns(scene: fl.Scene) -> Columns:
    """x, EI and ρA from the scene's file."""
    (link,), arm = scene.arm.links, scene.arm
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        assert table.ei_z is not None
        return table.x, table.ei_z, table.rho_a
    material, section = arm.materials[str(link.material)], arm.sections[str(link.section)]
    assert section.i_z is not None and section.area is not None
    return (0.0, link.length), 2 * (material.young * section.i_z,), 2 * (material.density * section.area,)
