"""Plots of trajectories, modes and loops; this module needs matplotlib, so it is imported only for plotting."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeAlias, TypeVar, cast

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from flexlink.chain.arguments import require_one_of, sequence
from flexlink.chain.coordinates import Kind
from flexlink.chain.layout import as_lines
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural
from flexlink.dynamics.forces import has_potential
from flexlink.dynamics.placement import frames
from flexlink.pages.colours import BLUE, CYCLE, GREY, INK, VERMILION
from flexlink.results.convergence import resolved
from flexlink.results.pictures.view import view_of_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flexlink.chain.chain import Chain
    from flexlink.dynamics.vibration.modal import Modes
    from flexlink.results.samples import RunSamples
    from flexlink.results.trajectory import Trajectory

    Draw = Callable[[Axes], None]
    Given: TypeAlias = Axes | Sequence[Axes] | None

Drawing = TypeVar("Drawing", bound=Callable[..., object])


def literal(draw: Drawing) -> Drawing:
    """Let a function that draws show every `$` in a name as a `$`, not as the start of mathematics."""
    return cast(Drawing, mpl.rc_context({"text.parse_math": False})(draw))


class NotebookFigure(Figure):  # type: ignore[misc]  # mypy does not read matplotlib's types
    """A figure that pyplot does not manage, since pyplot would draw it again at the end of the cell."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def axes_of(
    ax: Given, count: int, size: tuple[float, float], title: str, columns: int = 1, **grid: object
) -> tuple[NotebookFigure, list[Axes]]:
    """The user's axes, which must be `count`, or panels of a new figure of this size [in], and their figure."""
    if ax is None:
        figure = NotebookFigure(figsize=size, layout="constrained")
        widest = max(map(len, title.split("\n")))
        if title:
            figure.suptitle(title, fontsize="small" if widest > 60 else "large", parse_math=False)
        return figure, list(figure.subplots(-(-count // columns), columns, squeeze=False, **grid).flat)
    axes = list(np.ravel(ax))
    if len(axes) != count:
        raise ArgumentError(f"ax: {len(axes)} axes for {plural(count, 'panel')}; give one for each", id="wrong-shape")
    return axes[0].figure, axes


@literal
def plot_trajectory(run: Trajectory, what: str | Sequence[str] | None = None, ax: Given = None) -> NotebookFigure:
    """Plot `panels` and columns of a run against time, or the arm, as `Trajectory.plot` describes."""
    over_time, beside = what not in ("postures", "loads"), {}
    draw: Callable[[list[Axes], Trajectory], None] = postures if what == "postures" else loads
    count, size = (1, (7.2, 4.2)) if what == "postures" else (3, (7.2, 6.4))
    if over_time:
        shown = _chosen(run, what)
        draw, count, size = partial(_over_time, shown), len(shown), (8.4, 1.9 * len(shown) + 0.7)
    if ax is None and over_time:
        beside = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
    figure, axes = axes_of(ax, count, size, run.chain.name, sharex=True)
    draw(axes, run)
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small", **beside)
    return figure


def _over_time(shown: Sequence[Draw], axes: Sequence[Axes], _: Trajectory) -> None:
    """Draw each of the panels."""
    for draw, panel in zip(shown, axes, strict=True):
        panel.set_prop_cycle(color=(*CYCLE, GREY, INK))  # each curve of a legend has a different colour
        draw(panel)
    axes[-1].set_xlabel("time [s]")


def _chosen(run: Trajectory, what: str | Sequence[str] | None) -> list[Draw]:
    """The panels with these names, and panels of the named columns; None: joints and tip."""
    there: dict[str, list[Draw]] = {}
    for name, draw in panels(run):
        there.setdefault(name, []).append(draw)
    there["all"] = [draw for several in there.values() for draw in several]
    usual = [name for name in ("joints", "tip") if name in there]
    names = usual if what is None else [what] if isinstance(what, str) else sequence("what", what, "str")
    columns = run.columns
    own = {n: [partial(_lines, run=run, names=[n], values=columns[n][:, None])] for n in names if n in columns}
    return [draw for n in names for draw in own.get(n) or require_one_of("what", n, there, "no panel, no column")]


COORDINATES = {
    ("joints", "rad"): "active joints [deg]", ("joints", "m"): "sliding joints [m]",
    ("springs", "rad"): "passive joints [deg]", ("springs", "m"): "springs of\nsliding joints [m]",
}  # fmt: skip
"""Labels of the panels of coordinates, by the name of the panel and the SI unit."""


def panels(run: RunSamples) -> Iterator[tuple[str, Draw]]:
    """Names of the panels of a run, and functions that draw them, from top to bottom."""
    chain = run.chain
    for name in ("joints", "springs"):
        for unit, joints in chain.by_unit(chain.where(*(kind for kind in Kind if kind.panel == name)).tolist()):
            values = chain.in_own_units(run.q[:, joints], np.array(joints))
            yield name, partial(_curves, run=run, joints=joints, values=values, label=COORDINATES[name, unit.si])
    springs, elastic = bool(chain.stiffness.any()) or has_potential(chain), np.asarray(run.energy.elastic)[:, None]
    there = (
        ("base", partial(_lines, names="xyz", values=run.q, label="base, frame 0 [m]"), chain.has_free_base),
        ("tip", partial(_lines, names="xyz", values=run.tip, label="tip, frame 0 [m]"), True),
        ("energy", exchanged_energy, True),
        # often thousands of times smaller than the other energies
        ("elastic", partial(_lines, names=["elastic"], values=elastic, label="elastic\nenergy [J]"), springs),
        ("balance", imbalance, run.work is not None),
    )  # fmt: skip
    yield from ((name, partial(draw, run=run)) for name, draw, shown in there if shown)
    for unit, joints in chain.by_unit(chain.active.tolist()):
        if run.drive_torques[:, joints].any():
            label = f"drive {unit.load}s\n[{unit.torque}]"
            yield "drives", partial(_curves, run=run, joints=joints, values=run.drive_torques[:, joints], label=label)


def _lines(panel: Axes, run: RunSamples, names: Sequence[str], values: Array, label: str = "") -> None:
    """Plot the first columns of values (samples, …) with these names."""
    for name, column in zip(names, values.T, strict=False):
        panel.plot(run.t, column, label=name)
    panel.set_ylabel(label)


def exchanged_energy(panel: Axes, run: RunSamples) -> None:
    """Plot changes of kinetic, gravity and total energy since the start, as the zero of gravity energy is arbitrary."""
    for name, style in (("kinetic", {}), ("gravity", {}), ("total", {"color": INK, "linestyle": "--"})):
        values = np.asarray(getattr(run.energy, name))
        panel.plot(run.t, values - values[0], label=name, **style)
    panel.set_ylabel("energy since\nthe start [J]")


def imbalance(panel: Axes, run: RunSamples) -> None:
    """Plot the energy error of the discretisation."""
    panel.plot(run.t, run.imbalance, label="E − E(0) − W", color=VERMILION)
    panel.set_ylabel("power\nbalance [J]")
    panel.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3))


def postures(axes: Sequence[Axes], run: Trajectory, count: int = 12) -> None:
    """Draw the arm at equal intervals of time, the later the darker, and the path of its tip."""
    chosen = np.unique(np.linspace(0, len(run.t) - 1, count).round().astype(int))
    chain, points = run.chain, frames(run.chain, run.q[chosen]).points
    view = view_of_motion(chain, np.broadcast_to(points[0], points.shape), points)
    for k, (sample, each) in enumerate(zip(chosen, points, strict=True)):
        ends = f"{run.t[sample]:.3g} s" if k in {0, len(chosen) - 1} else None
        x, y = view.flat(as_lines(chain, each))
        axes[0].plot(x, y, color=BLUE, alpha=0.2 + 0.8 * k / max(len(chosen) - 1, 1), label=ends)
    axes[0].plot(*view.flat(run.tip), color=VERMILION, linewidth=0.8, label="path of the tip")
    axes[0].set(xlabel=view.labels[0], ylabel=view.labels[1])
    axes[0].set_aspect("equal", adjustable="datalim")


def loads(axes: Sequence[Axes], run: Trajectory) -> None:
    """Draw N, V and M along the arm when a moment is largest, and within which limits they are during the run."""
    chain, found = run.chain, run.loads
    path = [chain.loaded]
    while parent := int(chain.bodies["parent"][path[0]]):
        path.insert(0, parent - 1)
    worst = int(np.linalg.norm(found.moment[:, path], axis=2).max(axis=1).argmax())
    points = frames(chain, run.q[worst]).points[path]
    s = np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()])
    labels = ("N",), ("V_y", "V_z"), ("T", "M_y", "M_z")
    for panel, names, unit in zip(axes, labels, ("N", "N", "N m"), strict=True):
        for name in names:
            values = getattr(found, name)[:, path]
            (line,) = panel.plot(s, values[worst], label=f"{name} at {run.t[worst]:.4g} s")
            panel.fill_between(s, values.min(axis=0), values.max(axis=0), color=line.get_color(), alpha=0.15)
        panel.set_ylabel(f"{', '.join(names)} [{unit}]")
    axes[-1].set_xlabel("distance along the arm [m]")


@literal
def plot_modes(found: Modes, chain: Chain, count: int = 8, width: float = 7.2, ax: Given = None) -> NotebookFigure:
    """Plot mode shapes as displaced arms, one panel per mode, each in the view that shows its motion best."""
    shown = min(count, len(found.eigenvalues))
    reach = np.ptp(found.points, axis=0).max() or 1.0
    size = width, 0.42 * width * -(-shown // 2) + 0.6
    fine = resolved(found, chain)
    note = "" if all(fine[:shown]) else "\ndashed: fewer than two hinges per half-wave"
    figure, panels = axes_of(ax, shown, size, f"{chain.name}: mode shapes, amplitude not to scale{note}", 2)
    for panel in panels[shown:]:
        panel.set_visible(False)
    for k, panel in enumerate(panels[:shown]):
        path = path_of(found, k)
        bent = found.points + 0.12 * reach / (np.abs(path).max() or 1.0) * path
        view = view_of_motion(chain, found.points, bent)
        panel.plot(*view.flat(as_lines(chain, found.points, base=False)), color=GREY, linewidth=1.0, label="posture")
        colour, line, words = (BLUE, "-", "") if fine[k] else (VERMILION, "--", ", not resolved")
        style = {"color": colour, "marker": ".", "markersize": 4, "label": f"mode {k + 1}"}
        panel.plot(*view.flat(as_lines(chain, bent, base=False)), line, **style)
        frequency = f"{found.hertz[k]:.4g} Hz" if np.isfinite(found.hertz[k]) else "unstable, no frequency"
        panel.set_title(f"{k + 1}: {frequency}{words}", fontsize="medium")
        panel.set(xlabel=view.labels[0], ylabel=view.labels[1])
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(alpha=0.3)
    return figure


def path_of(found: Modes, k: int) -> Array:
    """Displacements of all bodies in a mode, where its phase makes them real."""
    path = found.paths[k]
    return np.asarray(path.real if path.real.any() else path.imag)


def _curves(panel: Axes, run: RunSamples, joints: list[int], values: Array, label: str) -> None:
    """Plot one column of values per joint."""
    legend_entries = 8  # more entries do not fit next to a panel
    for place, k in enumerate(joints):
        name = run.chain.joint_name(k) if place < legend_entries else None
        panel.plot(run.t, values[:, place], label=name, linewidth=1.0)
    if len(joints) > legend_entries:
        label += f"\n(first {legend_entries} of {len(joints)} named)"
    panel.set_ylabel(label)


def plot_bode(hertz: Array, L: Complex, title: str, ax: Given = None) -> NotebookFigure:
    """Magnitude and phase of a loop broken at one input."""
    figure, (size, phase) = axes_of(ax, 2, (7.0, 5.6), f"loop broken at {title}", sharex=True)
    size.loglog(hertz, np.abs(L), color=BLUE)
    size.axhline(1.0, color=GREY, linewidth=0.8)
    size.set_ylabel("|L|")
    phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(L))), color=BLUE)
    phase.axhline(-180.0, color=GREY, linewidth=0.8)
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    for panel in (size, phase):
        panel.grid(alpha=0.3)
    return figure


@literal
def plot_nyquist(hertz: Array, L: Complex, title: str, ax: Given = None) -> NotebookFigure:
    """The loop in the complex plane near −1; `hertz` is not drawn."""
    shown = f"loop broken at {title}, {hertz[0]:.3g} … {hertz[-1]:.3g} Hz"
    figure, (panel,) = axes_of(ax, 1, (6.0, 6.0), shown)
    panel.plot(L.real, L.imag, color=BLUE, label="L")
    panel.plot(L.real, -L.imag, color=BLUE, linewidth=0.8, linestyle="--", label="negative frequencies")
    panel.plot(-1.0, 0.0, "+", color=VERMILION, markersize=12, label="−1")
    _circle(panel)
    panel.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0), aspect="equal", xlabel="Re L", ylabel="Im L")
    panel.grid(alpha=0.3)
    panel.legend(loc="upper right", fontsize="small")
    return figure


@literal
def plot_poles(
    poles: Sequence[Sequence[complex]], *, sampled: bool, title: str, values: Sequence[float] = (), ax: Given = None
) -> NotebookFigure:
    """Poles z inside or outside the unit circle, or s left or right of the axis; a root locus if there are `values`."""
    figure, (panel,) = axes_of(ax, 1, (6.6, 6.0), "poles of the closed loop" if values else title)
    own = values or [float(k) for k in range(len(poles))]
    z = np.concatenate([np.asarray(each, complex) for each in poles])
    colour = np.concatenate([np.full(len(each), value) for each, value in zip(poles, own, strict=True)])
    both, colours = np.concatenate([z, z.conj()]), np.concatenate([colour, colour])
    look = {"c": colours, "cmap": "viridis"} if values else {"color": BLUE}
    dots = panel.scatter(both.real, both.imag, s=14, zorder=3, **look)
    if values:
        figure.colorbar(dots, ax=panel, label=title)
    if sampled:
        _circle(panel)
        panel.set(aspect="equal", xlabel="Re z", ylabel="Im z")
    else:
        panel.axvline(0.0, color=GREY, linewidth=0.8)
        panel.set(xlabel="Re s [1/s]", ylabel="Im s [1/s]")
    panel.grid(alpha=0.3)
    return figure


def _circle(panel: object) -> None:
    φ = np.linspace(0.0, 2 * np.pi, 361)
    panel.plot(np.cos(φ), np.sin(φ), color=GREY, linewidth=0.8)  # type: ignore[attr-defined]
