"""flexlink as a solver of cosseratbench."""

import dataclasses
import tomllib
from importlib.metadata import EntryPoint

import numpy as np
import pytest

pytest.importorskip("cosseratbench")
from cosseratbench.experiment import run
from cosseratbench.experiments.cantilever import cantilever
from cosseratbench.experiments.pendulum import pendulum
from cosseratbench.experiments.twist import twist
from cosseratbench.scenario import EndCondition, Material, PointLoad, Rod, Scenario
from flexlink_cosseratbench import FlexlinkSolver

from tests.conftest import ROOT


def test_the_entry_point_is_the_solver() -> None:
    described = tomllib.loads((ROOT / "plugins" / "cosseratbench" / "pyproject.toml").read_text("utf-8"))
    (entry,) = described["project"]["entry-points"]["cosseratbench.solvers"].items()
    assert EntryPoint(*entry, "cosseratbench.solvers").load() is FlexlinkSolver


def test_the_cantilever_is_within_a_thousandth_of_beam_theory() -> None:
    """Shear and large bending change the linear theory by 6e-4."""
    (error, _) = run(cantilever, FlexlinkSolver(), n_elements=20).summary()["metrics"].values()
    assert error <= 1e-3


@pytest.mark.slow
def test_the_cable_swings_with_the_period_of_theory_and_keeps_its_amplitude() -> None:
    """At 2 cm the period of the linear theory is 2e-5 too short."""
    found = run(pendulum, FlexlinkSolver(), n_elements=30).summary()["metrics"]
    assert found["period_error"] <= 3e-5
    assert abs(found["amplitude_change"]) <= 1e-4


def test_positions_and_directors_are_those_of_the_rod() -> None:
    """A rod along a skew line, unloaded, remains where it is; a pulled one stretches by F L/EA."""
    root, end, soft = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.4, 1.2]), Material(1e6, 1e6 / 3, 1000.0)
    load = PointLoad(force=tuple((0.01 * 1e6 * np.pi * 1e-4 * end / np.linalg.norm(end)).tolist()))
    rod = Rod((tuple(root), tuple(root + end)), 0.01, soft, (1.0, 0.0, 0.0), EndCondition.CLAMPED)
    for loads, strain in ((), 0.0), ((load,), 0.01):
        loaded = dataclasses.replace(rod, loads=loads)
        scenario = Scenario((loaded,), 1.0, self_contact=False, quasi_static=True)
        found = FlexlinkSolver().run(scenario, n_elements=6, n_frames=2)
        (positions,), (directors,) = found.positions, found.directors
        np.testing.assert_allclose(positions[0], rod.nodes(6), atol=1e-12)
        np.testing.assert_allclose(positions[1, -1], root + (1 + strain) * end, atol=1e-12)
        np.testing.assert_allclose(directors, np.broadcast_to(rod.directors(6), directors.shape), atol=1e-12)


@pytest.mark.parametrize("change", ["contact", "both ends", "space"])
def test_what_flexlink_cannot_simulate_is_not_implemented(change: str) -> None:
    scenario = {
        "contact": dataclasses.replace(cantilever.build(), self_contact=True),
        "both ends": twist.scenario_for(),
        "space": dataclasses.replace(cantilever.build(), gravity=(0.0, 9.81, 0.0)),
    }[change]
    with pytest.raises(NotImplementedError):
        FlexlinkSolver().run(scenario, n_elements=4, n_frames=2)
