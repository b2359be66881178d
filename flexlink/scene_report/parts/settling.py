"""Settling of the arm at the target of its drive."""

import math

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.steady import rest_of
from flexlink.pages.colours import BLUE, GREY, INK
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from flexlink.pages.tables import Table, table_csv
from flexlink.scene_report.study import Study

TOLERANCES = (1e-2, 1e-3, 1e-4)  # tolerances for settling, as fractions of the tip's travel


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if (goal := _goal(study)) is None:
        return None
    if study.scene.ties:
        return Part(("The settling of arms with ties is not computed.",))
    angles, end = goal
    chain, run = study.chain, study.run
    at = run.q[-1].copy()
    at[chain.active] = angles
    target = tip_position(chain, rest_of(chain, at, **study.load).q)
    if end >= run.t[-1]:
        ends = f"The reference ends at {number(end)} s, the run at {number(float(run.t[-1]))} s."
        return Part((f"{ends} To see the arm settle, make the run longer (run.duration).",))
    if not study.moves:
        return Part(("The tip does not move, so there is no settling.",))
    way = float(np.linalg.norm(target - run.tip[0]))
    off = float(np.linalg.norm(run.tip[-1] - target))
    left = run.residual_vibration(after=end)
    text = f"Residual vibration: {number(1e3 * left)} mm after the reference ends ({number(end)} s). At the end of the "
    text += f"run the tip is {number(1e3 * off)} mm from its target, its static position at the final joint angles "
    sentences = [f"{text}including gravity sag."]
    if way > 0:
        sentences.append(f"Overshoot: {number(1e3 * run.overshoot(target=target))} mm.")
    return Part(tuple(sentences), pictures=(_picture(study, target, end),), tables=(_table(study, target, end),))


def _goal(study: Study) -> tuple[Array, float] | None:
    """Return the final angles of the driven joints [rad], and the time [s] when the reference reaches them; or None."""
    scene, chain = study.scene, study.chain
    if not scene.drive.controls or scene.motion:
        return None
    if (course := scene.course) is not None:
        end = float(course.knots[-1])
        return course(end)[0], end
    return scene.joint_targets[[chain.coordinates[k].link - 1 for k in chain.active]], scene.initial.time


def _table(study: Study, target: Array, end: float) -> Table:
    heads = ("tolerance [m]", "part of the travel [%]", "settling time [s]")
    lines = []
    for part in TOLERANCES:
        time = study.run.settling_time(target=target, tolerance=part * study.travel, after=end)
        lines.append((part * study.travel, 100 * part, time if math.isfinite(time) else "not reached"))
    return Table("settling", f"Settling time, counted from {number(end)} s", heads, tuple(lines))


def _picture(study: Study, target: Array, end: float) -> Picture:
    run = study.run
    off = np.linalg.norm(run.tip - target, axis=1)
    figure, (axes,) = stacked_axes(1, 2.6)
    seen = off > 0
    axes.plot(run.t[seen], off[seen], color=BLUE)
    axes.axvline(end, color=INK, linestyle="--", linewidth=1.0)
    for part in TOLERANCES:
        axes.axhline(part * study.travel, color=GREY, linewidth=0.8)
    axes.set(yscale="log", xlabel="time [s]", ylabel="distance to target [m]")
    csv = table_csv(("t [s]", "distance to target [m]"), zip(run.t.tolist(), off.tolist(), strict=True))
    caption = "Distance of the tip from its target. Dashed: end of the reference. Grey: tolerances of the table."
    return Picture("settling", "Settling of the tip", figure, caption, csv)
