"""Plots: every curve is readable, and no legend covers one."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text

import flexlink as fl
from flexlink.pages import colours, style
from flexlink.results import plotting
from tests.conftest import flexible, make_scene
from tests.support.words import refused


@pytest.fixture
def run(models) -> fl.Trajectory:
    return fl.simulate(fl.load_scene(models / "paper_fig5.toml"), duration=0.05)


def test_figures_have_the_colours_of_pages() -> None:
    assert (style.RC["text.color"], style.RC["figure.facecolor"]) == (colours.INK, colours.PAPER)
    assert style.RC["grid.color"] == style.RC["legend.edgecolor"] == colours.GREY


@pytest.mark.slow
def test_no_legend_covers_a_curve(run: fl.Trajectory) -> None:
    figure = plotting.plot_trajectory(run, "all")
    FigureCanvasAgg(figure).draw()
    assert len(figure.axes) == 6
    for panel in figure.axes:
        legend = panel.get_legend().get_window_extent()
        assert not legend.overlaps(panel.get_window_extent())
        assert legend.xmax <= figure.bbox.xmax


@pytest.mark.parametrize("of_figure", [False, True])
def test_a_legend_with_short_and_long_names_is_not_wider_than_its_figure(of_figure: bool) -> None:
    figure = Figure(figsize=(style.WIDTH, 3.0), layout="constrained")
    panel = figure.subplots()
    for name in ("a", "b", *("one of the longer names " + letter for letter in "cde")):
        panel.plot([0.0], label=name)
    style.legend_over(panel, figure=figure if of_figure else None)
    (legend,) = figure.findobj(Legend)
    figure.draw_without_rendering()
    assert legend.get_window_extent().xmax <= figure.bbox.xmax


@pytest.mark.parametrize("of_figure", [False, True])
def test_a_legend_has_as_many_columns_as_fit(of_figure: bool) -> None:
    figure = Figure(figsize=(style.WIDTH, 3.0), layout="constrained")
    panel = figure.subplots()
    for letter in "abcdef":
        panel.plot([0.0], label=f"letters {letter * 3}")
    style.legend_over(panel, figure=figure if of_figure else None)
    (legend,) = figure.findobj(Legend)
    figure.draw_without_rendering()
    width, whole = legend.get_window_extent().width, (figure.bbox if of_figure else panel.get_window_extent()).width
    assert width <= whole < width * (1 + 1 / legend._ncols)


def test_a_flat_arm_has_a_low_panel_and_a_mast_a_high_one() -> None:
    for angle, least, most in ((0.0, 0.1, 0.3), (90.0, 1.0, 1.5)):
        figure = make_scene(flexible("a"), initial=fl.InitialState(joint_deg=(angle,))).plot()
        width, height = figure.get_size_inches()
        assert least < (height - 0.75) / width < most  # 0.75 inches are for labels


def test_every_energy_spans_a_fifth_of_its_panel(run: fl.Trajectory) -> None:
    """The constant total energy is excluded. With an arbitrary zero of gravity energy, all curves would look flat."""
    figure = plotting.plot_trajectory(run, "all")
    for panel in figure.axes[-3:]:
        low, high = panel.get_ylim()
        for line in panel.lines:
            if line.get_label() != "total":
                assert np.ptp(line.get_ydata()) > 0.2 * (high - low)


@pytest.mark.slow
def test_a_dollar_in_a_name_is_a_dollar_in_every_picture_and_page(tmp_path: Path) -> None:
    """matplotlib reads two dollars as mathematics, and stops at wrong ones."""
    name = r"a $\frac{$ <b>"
    hold = fl.Drive(kind="pd", kp=(9e3, 9e3), kd=(9e2, 9e2), target_deg=(0.0, 0.0), rate=1000.0)
    scene = make_scene(flexible(name), flexible("b $x_$ {{data}}"), drive=hold).varied({"name": name, "run": None})
    run, loop = fl.simulate(scene, duration=0.01), fl.loop(scene)
    modes = fl.modes(run.chain, run.q[0])
    figures = run.plot(), modes.plot(run.chain), scene.plot(), run.chain.plot(), loop.plot(), loop.plot("poles")
    for figure in figures:
        figure.savefig(tmp_path / "figure.png")
    assert all(any(name in text.get_text() for text in figure.findobj(Text)) for figure in figures[:2])
    fl.report(scene.varied({"run.duration": 0.01}), tmp_path / "report")
    assert "mathdefault" not in (tmp_path / "report" / "index.html").read_text(encoding="utf-8")


def test_chosen_panels_and_columns_are_drawn_in_this_order_into_the_axes_that_are_given(run: fl.Trajectory) -> None:
    figure = Figure()
    beside = figure.subplots(1, 3)
    what = ["tip", "q fore [rad]", "joints"]
    assert run.plot(what=what, ax=beside) is figure
    assert [len(panel.lines) for panel in beside] == [3, 1, len(run.chain.active)]
    np.testing.assert_array_equal(beside[1].lines[0].get_ydata(), run.columns["q fore [rad]"])
    assert [len(run.plot(what=names).axes) for names in ("tip", what, None, "all")] == [1, 3, 2, 6]
    assert run.plot(what="tip", ax=beside[2]) is figure
    for wrong, id in (({"what": "tips"}, "unknown-name"), ({"ax": beside}, "wrong-shape")):
        with refused(fl.errors.ArgumentError, id):
            run.plot(**wrong)


def test_postures_end_at_the_tip_and_loads_are_largest_where_the_moment_is(run: fl.Trajectory) -> None:
    (panel,) = run.plot(what="postures").axes
    *arms, path = panel.lines
    assert len(arms) == len({line.get_alpha() for line in arms}) == len(run.t)  # of at most twelve
    for arm, sample in ((arms[0], 0), (arms[-1], -1)):
        ends = np.column_stack([arm.get_xdata(), arm.get_ydata()])
        tip = np.array([path.get_xdata()[sample], path.get_ydata()[sample]])
        assert np.linalg.norm(ends - tip, axis=1).min() < 1e-12
    np.testing.assert_allclose(path.get_xdata(), run.tip[:, 0], rtol=1e-12)
    M = run.plot(what="loads").axes[2].lines[2]
    assert M.get_label().startswith("M_z at")
    assert np.abs(M.get_ydata()).max() == np.abs(run.loads.M_z).max()
    assert M.get_xdata()[-1] == pytest.approx(2.5, rel=1e-6)  # length of the arm
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        run.plot(what="loads", ax=Figure().subplots(1, 2))


def test_the_phase_of_a_loop_falls_by_more_than_a_turn_without_a_jump() -> None:
    phase = plotting.plot_bode(hertz := np.geomspace(0.1, 100.0, 200), (1 + 1j * hertz) ** -5.0, "-").axes[1].lines[0]
    assert phase.get_ydata() == pytest.approx(-5 * np.degrees(np.arctan(hertz)))


def test_every_plot_draws_into_the_axes_that_are_given() -> None:
    hold = fl.Drive(kind="pd", kp=(9e3, 9e3), kd=(9e2, 9e2), target_deg=(0.0, 0.0), rate=1000.0)
    scene = make_scene(flexible("a"), flexible("b"), drive=hold)
    chain, loop = fl.lump(scene), fl.loop(scene)
    found = fl.modes(chain, np.zeros(chain.n))
    plots: dict[str, tuple[int, Callable[..., object]]] = {
        "scene": (1, scene.plot), "chain": (1, chain.plot), "modes": (3, partial(found.plot, chain, count=3)),
        "bode": (2, loop.plot), "nyquist": (1, partial(loop.plot, "nyquist")),
        "poles": (1, partial(loop.plot, "poles")),
    }  # fmt: skip
    for name, (count, plot) in plots.items():
        figure = Figure()
        axes = figure.subplots(1, count + 1)
        assert plot(ax=axes[:count]) is figure, name
        assert [panel.has_data() for panel in axes] == [True] * count + [False], name
        with refused(fl.errors.ArgumentError, "wrong-shape"):
            plot(ax=axes)


def test_panels_without_content_are_left_out() -> None:
    rigid = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0))
    locked = make_scene(flexible("beam", joint=fl.Joint(locked=True)), gravity=(0.0, 9.81, 0.0))
    labels = [
        [panel.get_ylabel() for panel in plotting.plot_trajectory(fl.simulate(scene, duration=0.01), "all").axes]
        for scene in (rigid, locked)
    ]
    assert [len(found) for found in labels] == [4, 5]
    assert not any("passive" in label or "elastic" in label for label in labels[0])
    assert not any("active" in label and "passive" not in label for label in labels[1])


def test_drive_torques_and_forces_have_separate_panels_with_joint_names() -> None:
    links = (flexible("trolley", joint=fl.Joint(kind="prismatic")), flexible("boom"))
    scene = make_scene(*links, drive=fl.Drive(kind="constant", torque=(3.0, 2.0)), initial=fl.InitialState())
    *_, torques, forces = plotting.plot_trajectory(fl.simulate(scene, duration=0.01), "all").axes
    for panel, label, value, name in (
        (torques, "drive torques\n[N m]", 2.0, "boom"), (forces, "drive forces\n[N]", 3.0, "trolley"),
    ):  # fmt: skip
        (curve,) = panel.lines
        assert panel.get_ylabel() == label
        assert curve.get_label() == name
        assert (np.asarray(curve.get_ydata()) == value).all()
