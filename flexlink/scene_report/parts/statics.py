"""The arm in static equilibrium, driven joints locked or ties closed: sag, holding torques, buckling load."""

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.dynamics.equilibrium import buckling_loads
from flexlink.dynamics.placement import frames, tip_position, unbent
from flexlink.dynamics.terms import bias_torque
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over
from flexlink.pages.tables import Table, table_csv
from flexlink.pages.verdict import Fact
from flexlink.results.pictures.view import views_of
from flexlink.scene_report.arm_picture import draw_arm, draw_shadow, panels
from flexlink.scene_report.study import Study


def made(study: Study) -> Part:
    """Build the chapter."""
    chain, q = study.chain, study.start[0]
    if not study.bends and not study.scene.ties:
        held = bias_torque(chain, q, np.zeros(chain.n), **study.load)
        rigid = ("All links are rigid. The joints are locked at their initial angles.",)
        return Part(rigid, facts=_held(study, held), tables=_holding(study, q, held))
    rest = study.rest
    sag = _without_rounding(tip_position(chain, rest.q) - tip_position(chain, unbent(chain, rest.q)))
    size = float(np.linalg.norm(sag))
    x, y, z = (number(1e3 * part) for part in sag)
    bend = "gravity and the tip wrench bend" if size > 0 else "no load bends"
    sagged = f"Static tip deflection: {number(1e3 * size)} mm, ({x}, {y}, {z}) mm in frame 0. "
    sagged += f"This equilibrium is {'stable' if rest.stable else 'unstable'}."
    sentences = f"At rest, {study.holding}; {bend} the links.", sagged, _buckling(study)
    pictures, tables = (_picture(study, size),) if size > 0 else (), _holding(study, rest.q, rest.tau)
    sags = Fact(f"{number(1e3 * size)} mm", f"Sag of the tip under gravity and load, {study.holding}")
    facts = (*((sags,) if size > 0 else ()), *_held(study, rest.tau))
    return Part(tuple(filter(None, sentences)), facts=facts, pictures=pictures, tables=tables)


def _held(study: Study, tau: Array) -> tuple[Fact, ...]:
    """Return the largest holding torques, for the first screen of the page; zeros are left out."""
    chain, torques, shown = study.chain, _without_rounding(tau), 2  # as many values as fit on one line
    largest = sorted(filter(torques.__getitem__, study.held), key=lambda k: -abs(torques[k]))[:shown]
    if not largest:
        return ()
    some, units = [number(abs(float(torques[k]))) for k in largest], [chain.torque_units[k] for k in largest]
    several = len(set(units)) > 1
    each = [f"{value} {unit}" if several else value for value, unit in zip(some, units, strict=True)]
    values = "; ".join(each) + ("" if several else f" {units[0]}")
    names = ", ".join(chain.joint_name(k) for k in largest)
    return (Fact(values, f"{'Largest h' if len(study.held) > shown else 'H'}olding torques: {names}"),)


def _holding(study: Study, q: Array, tau: Array) -> tuple[Table, ...]:
    """Return tables of the holding torques and forces of the driven joints."""
    chain, tau, tables = study.chain, _without_rounding(tau), []
    own = chain.in_own_units(q)
    for kind, joints in chain.by_unit(study.held):
        heads = ("joint", f"{kind.place} [{kind.unit}]", f"{kind.load} [{kind.torque}]")
        lines = tuple((chain.joint_name(k), float(own[k]), float(tau[k])) for k in joints)
        tables.append(Table("holding" if kind.load == "torque" else "forces", f"Holding {kind.load}s", heads, lines))
    return tuple(tables)


def _buckling(study: Study) -> str:
    chain, wrench = study.chain, study.load["tip_wrench"]
    if study.load["frame"] == "tip" or not (chain.gravity.any() or wrench.any()):
        return ""
    try:
        factors = buckling_loads(chain, study.rest.q, tip_wrench=wrench, locked=study.held, ties=study.scene)
    except FlexlinkError as error:
        return f"Buckling load not computed: {error}."
    if not len(factors):
        return "The arm does not buckle at any multiple of the load."
    return f"Buckling load: {number(float(factors[0]))} times the load (linearised about this equilibrium)."


def _picture(study: Study, size: float) -> Picture:
    chain, rest = study.chain, study.rest
    straight, bent = (frames(chain, q).points for q in (unbent(chain, rest.q), rest.q))
    visible = 0.08  # smallest sag of the tip in the picture, as a fraction of the arm's size
    wanted = visible * study.chain.size / size
    power = 10.0 ** np.floor(np.log10(wanted))  # rounded down to 1, 2, 5, 10, 20, …
    scale = max(1.0, float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1 + 1e-12))))
    shown = straight + scale * (bent - straight)
    both = np.stack([straight, shown])
    views = views_of(chain, both)
    figure, axes = panels(views, chain, both)
    for panel, view in zip(axes, views, strict=True):
        draw_shadow(panel, view, straight, chain, label="undeformed", zorder=1)
        draw_arm(panel, view, shown, chain)
    legend_over(axes[0], figure=figure)
    csv = table_csv(
        ("body", "x straight [m]", "y straight [m]", "z straight [m]", "x bent [m]", "y bent [m]", "z bent [m]"),
        [(k, *a, *b) for k, (a, b) in enumerate(zip(straight.tolist(), bent.tolist(), strict=True))],
    )
    magnified = f"deflection × {scale:g}" if scale > 1 else "true to scale"
    return Picture("sag", "Static deflection", figure, f"Grey: undeformed. Blue: deformed, {magnified}.", csv)


def _without_rounding(values: Array) -> Array:
    """Set values below the rounding error of the largest value to zero."""
    return np.where(np.abs(values) > 1e-12 * np.abs(values).max(initial=0.0), values, 0.0)
