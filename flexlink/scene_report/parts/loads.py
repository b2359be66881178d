"""Loads along the run: bending moments, torques and forces between segments, and drive torques."""

from typing import NamedTuple

import numpy as np

from flexlink.pages.colours import CYCLE
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import NAMED_CURVES, stacked_axes
from flexlink.pages.tables import Cell, Table
from flexlink.pages.verdict import Fact
from flexlink.results.pictures.colouring import colouring
from flexlink.results.pictures.film import placed
from flexlink.results.pictures.outline import has_rectangle_instead, outline_of
from flexlink.results.plotting import panels
from flexlink.results.samples import RunSamples, picked
from flexlink.scene_report.study import Study


def made(study: Study) -> Part:
    """Build the chapter."""
    run, chain = study.run, study.chain
    bending = np.linalg.norm(run.loads.moment[:, :-1, 1:], axis=2)
    row, body = np.unravel_index(int(bending.argmax()), bending.shape)
    at = f"{_place(study, int(body))}, {number(float(run.t[row]))} s"
    sentences = [
        f"Largest bending moment: {number(float(bending[row, body]))} N m at {at}.",
        "Bending moment and shear are the resultants of the two components across the beam.",
    ]
    peaks = np.abs(run.tau).max(axis=0)
    if driven := [int(k) for k in chain.active if peaks[k] > 0]:
        for kind, joints in reversed([*chain.by_unit(driven)]):
            most = max(joints, key=lambda k: peaks[k])
            largest = f"{number(float(peaks[most]))} {kind.torque} at {chain.joint_name(most)}"
            sentences.insert(1, f"Largest drive {kind.load}: {largest}.")
    peak, facts = peak_stress(run), tuple[Fact, ...]()
    if peak is not None and peak.pascals != 0.0:
        where = f"{peak.link}, {number(peak.along)} m from its root, at {number(peak.time)} s"
        section = "; section treated as a rectangle" if peak.rectangle else ""
        facts = (Fact(f"{number(1e-6 * peak.pascals)} MPa", f"Largest bending stress of the run ({where}{section})"),)
    sentences[1:1] = [f"{fact.label}: {fact.value}." for fact in facts]
    pictures = (_picture(study, driven), *([_of_ties(study)] if study.scene.ties else []))
    return Part(tuple(sentences), facts=facts, pictures=pictures, tables=(_table(study),))


def _place(study: Study, body: int) -> str:
    chain = study.chain
    first, stop = int(chain.bodies["first"][body]), int(chain.bodies["stop"][body])
    return chain.joint_name(first) if stop > first else f"body {body} (fixed)"


def _table(study: Study) -> Table:
    chain = study.chain
    heads = ("location", "tension [N]", "compression [N]", "shear [N]", "torque [N m]", "bending [N m]", "drive [N m]")
    if "m" in chain.joint_units:
        heads = (*heads[:-1], "drive [N m; N]")
    moving = [k for k in range(len(chain.bodies) - 1) if chain.bodies["stop"][k] > chain.bodies["first"][k]]
    lines: list[tuple[Cell, ...]] = []
    for body in moving:
        force, moment = study.run.loads.force[:, body], study.run.loads.moment[:, body]
        first = int(chain.bodies["first"][body])
        drive = float(np.abs(study.run.tau[:, first]).max()) if first in chain.active else None
        lines.append((
            _place(study, body), float(max(force[:, 0].max(), 0)), float(max(-force[:, 0].min(), 0)),
            float(np.linalg.norm(force[:, 1:], axis=1).max()), float(np.abs(moment[:, 0]).max()),
            float(np.linalg.norm(moment[:, 1:], axis=1).max()), drive,
        ))  # fmt: skip
    return Table("loads", "Largest loads during the run", heads, tuple(lines))


def _picture(study: Study, driven: list[int]) -> Picture:
    run, chain = study.run, study.chain
    drives = [draw for name, draw in panels(run) if name == "drives"]
    _, axes = stacked_axes(1 + len(drives), 2.2)
    columns = {"t [s]": run.t}
    bending = np.linalg.norm(run.loads.moment[..., 1:], axis=2)
    for place, body in enumerate(roots := [chain.body(int(k)) for k in chain.active] or [0]):
        name = f"bending {_place(study, body)} [N m]"
        columns[name] = bending[:, body : (*roots, len(chain.bodies) - 1)[place + 1]].max(axis=1)
        label = _place(study, body) if place < NAMED_CURVES else None
        axes[0].plot(run.t, columns[name], color=CYCLE[place % len(CYCLE)], label=label)
    axes[0].set_ylabel("bending [N m]")
    for draw, panel in zip(drives, axes[1:], strict=True):
        draw(panel)
    columns |= {f"drive {chain.joint_name(k)} [{chain.torque_units[k]}]": run.tau[:, k] for k in driven}
    caption = "Largest bending moment of each link" + ("; drive torques." if driven else ".")
    return picture_of("loads", "Loads over time", caption, axes, "time [s]", columns, each=True)


def _of_ties(study: Study) -> Picture:
    """Plot the forces of ties, and the torques of those on revolute joints; of forces with a direction, the size."""
    run, arm, columns = study.run, study.scene.arm, {"t [s]": study.run.t}
    units = [arm.links[arm.number(t.link or 1) - 1].joint.terms.torque if t.on_joint else "N" for t in study.scene.ties]
    _, axes = stacked_axes(len(kinds := sorted(set(units))), 2.2)
    for place, ((name, force), unit) in enumerate(zip(run.tie_forces.items(), units, strict=True)):
        columns[f"{name} [{unit}]"] = size = force if force.ndim == 1 else np.linalg.norm(force, axis=1)
        look = {"color": CYCLE[place % len(CYCLE)], "label": name if place < NAMED_CURVES else None}
        axes[kinds.index(unit)].plot(run.t, size, **look)
    for panel, unit in zip(axes, kinds, strict=True):
        panel.set_ylabel(f"{'torque' if unit == 'N m' else 'force'} [{unit}]")
    caption = "Positive where a tie pulls. Of ties that hold a point in several directions: the size of the force."
    return picture_of("ties", "Forces of ties", caption, axes, "time [s]", columns, each=True)


AT_ONCE = 500  # samples per batch, which limits the memory


class PeakStress(NamedTuple):
    """Largest bending stress E ε at the surface of a flexible link."""

    pascals: float
    link: str
    along: float  # distance from the root of the link's beam [m]
    time: float  # time at which it occurs [s]
    rectangle: bool  # whether a general section, of unknown surface, is replaced by a rectangle of equal inertia


def peak_stress(run: RunSamples) -> PeakStress | None:
    """Largest bending stress over all samples; None if no flexible link has a section and a material."""
    if run.scene is None or not len(run.t):
        return None
    arm, outline = run.scene.arm, outline_of(run.scene, run.chain)
    young = [arm.materials[name].young if (name := arm.links[k - 1].material) else np.nan for k in outline.link]
    best: PeakStress | None = None
    for first in range(0, len(run.t), AT_ONCE):
        part = picked(run, np.arange(first, min(first + AT_ONCE, len(run.t))))
        stress = 1e-6 * colouring("strain", arm, outline, placed(part.chain, part.q), part).values * np.array(young)
        if not np.isfinite(stress).any():
            return None
        row, station = np.unravel_index(int(np.nanargmax(stress)), stress.shape)
        link = arm.links[outline.link[station] - 1]
        if best is None or stress[row, station] > best.pascals:
            begin, end = outline.pieces[outline.piece[station]].part
            along = float(begin + outline.part[station] * (end - begin))  # as a fraction of the link's length
            best = PeakStress(
                float(stress[row, station]), link.name, along * float(link.beam.length),
                float(part.t[row]), bool(link.section and has_rectangle_instead(arm.sections[link.section])),
            )  # fmt: skip
    return best
