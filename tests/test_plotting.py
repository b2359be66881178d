"""Plots: every curve is readable, and no legend covers one."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import flexible, make_scene
from matplotlib.backends.backend_agg import FigureCanvasAgg

import flexlink as fl
from flexlink.results import plotting


@pytest.fixture
def run(models) -> fl.Trajectory:
    return fl.simulate(fl.load_scene(models / "paper_fig5.toml"), duration=0.05)


@pytest.mark.slow
def test_no_legend_covers_a_curve(run: fl.Trajectory) -> None:
    figure = plotting.plot_trajectory(run)
    FigureCanvasAgg(figure).draw()
    assert len(figure.axes) == 6
    for panel in figure.axes:
        legend = panel.get_legend().get_window_extent()
        assert not legend.overlaps(panel.get_window_extent())
        assert legend.xmax <= figure.bbox.xmax


def test_every_energy_spans_a_fifth_of_its_panel(run: fl.Trajectory) -> None:
    """The constant total energy is excluded. With an arbitrary zero of gravity energy, all curves would look flat."""
    figure = plotting.plot_trajectory(run)
    for panel in figure.axes[-3:]:
        low, high = panel.get_ylim()
        for line in panel.lines:
            if line.get_label() != "total":
                assert np.ptp(line.get_ydata()) > 0.2 * (high - low)


def test_panels_without_content_are_left_out() -> None:
    rigid = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0))
    locked = make_scene(flexible("beam", joint=fl.Joint(locked=True)), gravity=(0.0, 9.81, 0.0))
    labels = [
        [panel.get_ylabel() for panel in plotting.plot_trajectory(fl.simulate(scene, duration=0.01)).axes]
        for scene in (rigid, locked)
    ]
    assert [len(found) for found in labels] == [4, 5]
    assert not any("passive" in label or "elastic" in label for label in labels[0])
    assert not any("active" in label and "passive" not in label for label in labels[1])


def test_drive_torques_and_forces_have_separate_panels_with_joint_names() -> None:
    links = (flexible("trolley", joint=fl.Joint(kind="prismatic")), flexible("boom"))
    scene = make_scene(*links, drive=fl.Drive(kind="constant", torque=(3.0, 2.0)), initial=fl.InitialState())
    *_, torques, forces = plotting.plot_trajectory(fl.simulate(scene, duration=0.01)).axes
    for panel, label, value, name in (
        (torques, "drive torques\n[N m]", 2.0, "boom"), (forces, "drive forces\n[N]", 3.0, "trolley"),
    ):  # fmt: skip
        (curve,) = panel.lines
        assert panel.get_ylabel() == label
        assert curve.get_label() == name
        assert (np.asarray(curve.get_ydata()) == value).all()
