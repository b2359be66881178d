"""The model: the arm with its hinges, links, joints and springs, and remarks on inputs that have no effect."""

from collections.abc import Iterator

import numpy as np

from flexlink.common.wording import plural, short_list
from flexlink.describe.hinges import hinges_of
from flexlink.describe.link import Link
from flexlink.describe.plausibility.hints import hints
from flexlink.dynamics.notes import defaults, notes
from flexlink.dynamics.placement import frames
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture
from flexlink.pages.tables import Cell, Table, table_csv
from flexlink.scene_report.arm_picture import plot_chain
from flexlink.scene_report.study import Study


def made(study: Study) -> Part:
    """Build the chapter."""
    chain, scene = study.chain, study.scene
    springs = int((chain.stiffness > 0).sum())
    mass = float(chain.bodies["mass"].sum())
    length = float(np.linalg.norm(chain.bodies["translation"], axis=1).sum())
    moves = "planar" if chain.is_planar else "spatial"
    size = f"{plural(len(scene.arm.links), 'link')}, {number(length)} m from joint to joint, {number(mass)} kg."
    counted = f"{plural(len(chain.active), 'driven joint')}, {plural(springs, 'spring')}"
    size += f" Model: {plural(chain.freedoms, 'degree')} of freedom ({counted}), {moves} motion."
    gravity = f"Gravity: ({', '.join(map(number, scene.gravity))}) m/s² in frame 0."
    drive = f"Drive: {scene.drive.kind}." if scene.drive.kind != "none" else "No drive: the joints turn freely."
    if scene.motion:
        drive += f" Prescribed motions: {', '.join(str(motion.link) for motion in scene.motion)}."
    drive += f" Ties: {', '.join(f'{tie.name} ({tie.kind})' for tie in scene.ties)}." if scene.ties else ""
    remarks = [f"Check {hint}." for hint in hints(scene)]
    remarks += [f"Note: {note}." for note in (*defaults(scene), *notes(scene))]
    sentences = (*((scene.about + ".",) if scene.about else ()), size, f"{gravity} {drive}", *remarks)
    tables = [_links(study), *_joints(study), *_springs(study)]
    return Part(sentences, pictures=(_drawing(study),), tables=tuple(tables), files={"scene.toml": scene.to_toml()})


def _drawing(study: Study) -> Picture:
    chain, (q, _) = study.chain, study.start
    points = frames(chain, q).points
    figure = plot_chain(chain, q, study.scene)
    csv = table_csv(("body", "x [m]", "y [m]", "z [m]"), [(k, *p) for k, p in enumerate(points.tolist())])
    falls = ", gravity downwards" if chain.gravity.any() else ""
    seen = f"Side view{falls}" + ("; below: top view." if len(figure.axes) > 1 else ".")
    return Picture("arm", "The arm at the start", figure, seen, csv)


def _links(study: Study) -> Table:
    heads = ("link", "length [m]", "bends about", "EI_y [N m²]", "EI_z [N m²]", "hinges", "rule", "material", "section")
    arm = study.scene.arm
    lines: list[tuple[Cell, ...]] = []
    for link, (nodes, _) in zip(arm.links, hinges_of(arm), strict=True):
        EI, rule, made_of = arm.bending_stiffness(link) or (None, None), "", (link.material or "", link.section or "")
        length, loss = link.length, None
        if link.flex != "rigid":
            length, rule = link.beam.length, link.lumping
            loss = None if link.damping is not None and link.damping.is_constant else arm.loss_time(link)
        lines.append((link.name, float(length), link.flex, *EI, len(nodes), rule, *made_of, loss))
    return Table("links", "Links", (*heads, "damping time [s]"), tuple(lines))


def _joints(study: Study) -> Iterator[Table]:
    turning = (
        "start [deg]", "limits [deg]", "viscous friction [N m s/rad]", "dry friction [N m]", "rotor inertia [kg m²]"
    )  # fmt: skip
    sliding = ("start [m]", "limits [m]", "viscous friction [N s/m]", "dry friction [N]", "rotor [kg]")
    arm, starts = study.scene.arm, study.scene.starts
    kinds = [("joints", "Joints", turning, False), ("sliding", "Prismatic joints", sliding, True)]
    for key, title, columns, slides in kinds:
        links = [(link, start) for link, start in zip(arm.links, starts, strict=True) if link.joint.slides == slides]
        if links:
            yield Table(key, title, ("joint", *columns), tuple(_joint(link, start) for link, start in links))


def _joint(link: Link, start: float) -> tuple[Cell, ...]:
    joint = link.joint
    if joint.locked:
        return (f"{link.name} (locked)", start, "", None, None, None)
    limits = "none" if joint.limits is None else " … ".join(map(number, joint.limits))
    return link.joint_name, start, limits, joint.viscous, joint.coulomb, joint.armature


def _springs(study: Study) -> Iterator[Table]:
    chain, titles = study.chain, {"rad": ("springs", "Springs"), "m": ("belts", "Springs of prismatic joints")}
    rest, start = (chain.in_own_units(si).tolist() for si in (chain.rest, study.start[0]))
    for kind, springs in chain.by_unit(np.flatnonzero(chain.stiffness > 0).tolist()):
        name = f"rest {kind.place}" if kind.si == "rad" else "rest"
        heads = "spring", *(f"{what}/{kind.si}]" for what in (f"stiffness [{kind.torque}", f"damping [{kind.torque} s"))
        heads += f"{name} [{kind.unit}]", f"start [{kind.unit}]"
        coupled = len(chain.couplings) > 0 and kind.si == "rad"
        lines = tuple(
            (chain.joint_name(k), float(chain.stiffness[k]), float(chain.damping[k]), rest[k], start[k])
            + ((short_list(list(map(chain.joint_name, chain.coupled_joints[k]))),) if coupled else ())
            for k in springs
        )
        yield Table(*titles[kind.si], heads + ("coupled with",) * coupled, lines, to_look_up=True)
