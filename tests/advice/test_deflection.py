"""In all parts of the library, deflection is the tip displacement due to all springs, of links and of gears."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.advice.goal import Goal, TipErrorNorm
from flexlink.advice.model_runner import ModelRunner, Stepping
from flexlink.advice.refinement import RefinementStudy
from flexlink.dynamics.placement import unbent
from flexlink.results.deflection import deflections
from flexlink.scene_report.study import Study
from flexlink.sweeps.measures import column_of
from tests.conftest import ROOT
from validation.trade.scenes import seen

GEAR = 0.5 * 2 * np.sin(0.01 / 2)  # tip displacement [m] of a 0.5 m arm whose gear spring turns by 0.01 rad
STEEL = fl.Material(young=210e9, density=7850.0)


@pytest.fixture(scope="module")
def two_masses() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "two_mass_joint.toml")


def test_advice_sweeps_reports_and_trade_agree_on_the_deflection_of_a_gear(two_masses: fl.Scene) -> None:
    run = fl.simulate(two_masses)
    assert deflections(run)[0] == pytest.approx(GEAR, rel=1e-12)
    assert deflections(run).max() == pytest.approx(GEAR, rel=1e-3)  # the tip vibrates with this amplitude
    assert np.array_equal(column_of(run, "deflection [m]"), deflections(run))
    assert np.array_equal(Study(two_masses).bent_by, deflections(run))
    assert np.linalg.norm(seen(run.chain, run.q).bend, axis=1) == pytest.approx(deflections(run), abs=1e-15)


def test_an_advice_goal_relative_to_the_deflection_includes_the_gear(two_masses: fl.Scene) -> None:
    scene = two_masses.varied({"initial": fl.InitialState(joint_deg=(0.0,)), "link.1.material": "steel",
                               "link.1.section": "bar", "material.steel": STEEL, "gravity": (0.0, -9.81, 0.0),
                               "section.bar": fl.Section(shape="circle", diameter=0.02)})  # fmt: skip
    runner = ModelRunner(scene, 1.0)
    refinement = RefinementStudy(
        runner, TipErrorNorm(Goal(1e-2), 1e-3), Goal(1e-2, deflection=True), ("z",), Stepping("Radau5", tolerance=1e-5)
    )
    refinement.refine()
    run = refinement.finest.outcome.run
    assert run is not None
    assert refinement.deflection == deflections(run).max()
    hinges = [c.segment > 0 for c in run.chain.coordinates]
    links_alone = np.linalg.norm(run.tip - fl.tip_position(run.chain, np.where(hinges, 0.0, run.q)), axis=1)
    assert refinement.deflection > 1.5 * links_alone.max()  # the displacement due to the gear is included


def test_the_unbent_configuration_puts_springs_at_their_rest_angles(two_masses: fl.Scene) -> None:
    chain = fl.lump(two_masses)
    turned = with_rest(chain, 0.3)
    assert unbent(turned, np.array([0.7, 0.1])) == pytest.approx([0.7, 0.3])


def with_rest(chain: fl.Chain, angle: float) -> fl.Chain:
    """The same chain with this rest angle [rad] of the gear spring."""
    hinges = chain.hinges.copy()
    hinges["rest"][chain.stiffness > 0] = angle
    return dataclasses.replace(chain, hinges=hinges)
