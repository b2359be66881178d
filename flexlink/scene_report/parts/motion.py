"""The run: configurations at equal time intervals, joints, tip, and deflection of the links."""

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.dynamics.placement import frames
from flexlink.pages.colours import CYCLE, GREY
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import colour_along, stacked_axes
from flexlink.pages.tables import columns_csv, table_csv
from flexlink.pages.verdict import Verdict
from flexlink.results import plotting
from flexlink.results.pictures.view import views_of
from flexlink.scene_report.arm_picture import draw_shadow, of_arm, panels
from flexlink.scene_report.study import Study


def made(study: Study) -> Part:
    """Build the chapter."""
    if isinstance(study.attempt, FlexlinkError):
        reason = str(study.attempt)
        return Part((f"The run failed: {reason}.",), (Verdict("Run", "fail", "failed", f"{reason}."),))
    run = study.run
    most = int(np.argmax(study.bent_by))
    far = f"The tip moves up to {number(study.travel)} m from its initial position."
    sentences = [f"Simulated time: {number(run.t[-1] - run.t[0])} s; {run.steps}. {far}"]
    if study.bends:
        bent = f"Tip deflection: up to {number(1e3 * study.bent_by[most])} mm, at {number(run.t[most])} s"
        sentences.append(f"{bent} (distance from the tip of the same arm with straight links).")
    sentences += [f"Warning: {warning}." for warning in run.warnings]
    pictures = (_postures(study), _in_time(study))
    return Part(tuple(sentences), pictures=pictures, files={"run.csv": columns_csv(run.columns)})


def _postures(study: Study) -> Picture:
    run, chain = study.run, study.chain
    chosen = np.unique(np.linspace(0, len(run.t) - 1, 9).astype(int))
    points = np.array([frames(chain, run.q[k]).points for k in chosen])
    seen = of_arm(chain, points)
    views = views_of(chain, seen)
    figure, axes = panels(views, chain, np.concatenate([seen.reshape(-1, 3), run.tip]))
    for panel, view in zip(axes, views, strict=True):
        panel.plot(*view.flat(run.tip), color=GREY, linewidth=0.8, zorder=1)
        for posture, part in zip(points, np.linspace(0, 1, len(chosen)), strict=True):
            draw_shadow(panel, view, posture, chain, color=colour_along(part), zorder=1)
    heads = ("time [s]", "body", "x [m]", "y [m]", "z [m]")
    times = run.t[chosen].tolist()
    lines = [(t, k, *p) for t, posture in zip(times, points.tolist(), strict=True) for k, p in enumerate(posture)]
    caption = f"{len(chosen)} configurations from {times[0]:g} s (light) to {times[-1]:g} s (dark). Grey: tip path."
    return Picture("postures", "Configurations at equal time intervals", figure, caption, table_csv(heads, lines))


def _in_time(study: Study) -> Picture:
    run, chain, own = study.run, study.chain, study.chain.in_own_units(study.run.q)
    drawn = [draw for name, draw in plotting.panels(run) if name in ("joints", "tip")]
    _, axes = stacked_axes(len(drawn) + study.bends, 1.9)
    for draw, panel in zip(drawn, axes, strict=False):
        draw(panel)
    columns = {"t [s]": run.t}
    for kind, joints in chain.by_unit(chain.active.tolist()):
        columns |= {f"{chain.joint_name(k)} [{kind.unit}]": own[:, k] for k in joints}
    columns |= {name: column for name, column in run.columns.items() if name.startswith("tip ")}
    if study.bends:
        axes[-1].plot(run.t, 1e3 * study.bent_by, color=CYCLE[3])
        axes[-1].set_ylabel("deflection [mm]")
        columns["tip deflection [m]"] = study.bent_by
    caption = f"Driven joints; tip position in frame 0{'; tip deflection' * study.bends}."
    return picture_of("motion", "Joint positions and tip", caption, axes, "time [s]", columns, each=True)
