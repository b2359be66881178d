"""Numbers and words that a slip of the pen would change: each is found once more by hand or by a closed form."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from conftest import flexible, make_scene
from msgspec.structs import replace

import flexlink as fl
from flexlink.advice.advise import Advisor
from flexlink.advice.goal import Goal, TipErrorNorm
from flexlink.advice.model import by_rule
from flexlink.advice.model_runner import Stepping
from flexlink.advice.verdict import time
from flexlink.diagnosis.diagnosis import Diagnosis, _missing
from flexlink.diagnosis.differences import _differing
from flexlink.diagnosis.matching import Match
from flexlink.diagnosis.quantities import Difference
from flexlink.engines.read_back import of_chain
from flexlink.formats.features import not_held
from flexlink.identification.coordinates import coordinate_of
from flexlink.identification.identifiability import Direction
from flexlink.pages.numbers import number
from flexlink.pages.tables import table_csv
from flexlink.results.pictures import stress
from reports.measurements import Group

ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


@pytest.mark.parametrize(("value", "digits", "text"), [(999.7, 3, "1000"), (-99.97, 2, "−100"), (9999.7, 4, "10000")])
def test_a_number_that_is_rounded_up_to_one_digit_more_has_no_letter_e(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_a_time_of_almost_a_second_is_a_second() -> None:
    assert (time(0.9997), time(0.9994)) == ("1 s", "999 ms")


def test_a_zero_stands_in_a_table_and_nothing_does_not() -> None:
    assert table_csv(("a", "b"), [(0.0, None), (0, False)]) == "a,b\n0.0,\n0,False\n"


def test_of_a_direction_the_first_number_goes_ten_percent() -> None:
    assert "a +10 %, b -5 % changes nothing" in Direction(("a", "b"), (0.8, -0.4), 2.0, True).text


@pytest.mark.parametrize(("between", "tried"), [((0.5, 2.0), (0.5, 2.0)), ((1e-9, 1e9), (1e-3, 1e3))])
def test_a_logarithm_is_sought_between_its_ends_and_a_thousand_times_its_start(between: Any, tried: Any) -> None:
    assert coordinate_of(ROD, fl.FitParameter(path="tip.mass", between=between)).between == pytest.approx(tried)


def test_a_vibration_at_the_band_does_not_count_and_one_at_a_tenth_does() -> None:
    """A window of two periods of the band is blind to it: the first zero of Hann's."""
    t = 1e-3 * np.arange(2001)
    norm = TipErrorNorm(Goal(1e-3, band=10.0), 1e-3)
    at = {hertz: norm.lengths(np.sin(2 * np.pi * hertz * t)[:, None])[200:-200].max() for hertz in (10.0, 1.0)}
    assert at[10.0] < 1e-2
    assert at[1.0] > 0.95


def test_fixed_steps_are_told_as_a_part_of_the_stable_one() -> None:
    runner = SimpleNamespace(stable_step=lambda _: 0.01, postures=[None] * 5)
    outcome = SimpleNamespace(stepping=Stepping("RK4", step=0.004))
    said = Advisor._steps(cast("Any", SimpleNamespace(runner=runner)), (by_rule("z", 3),), cast("Any", outcome))
    assert "0.40 of the stable step (smallest over 5 postures)" in said


def test_the_uncertainty_of_a_negative_number_is_positive() -> None:
    columns = {"E": np.array([0.1]), "D": np.array([-2.0]), "u_val": np.array([0.1])}
    group = Group("case", "title", "group", columns)
    assert (group.error.tolist(), group.u_val.tolist()) == ([-5.0], [5.0])


def test_a_peak_of_stress_has_the_time_of_its_sample_however_many_are_looked_at(monkeypatch: Any) -> None:
    scene = make_scene(flexible("beam", lumping="gauss"), gravity=(0.0, -9.81, 0.0), tip=fl.RigidBody(mass=2.0))
    run = fl.simulate(scene.varied({"run": {"step": 1e-4, "duration": 0.02, "sample": 1e-3}}))
    whole = stress.peak_stress(run)
    assert whole is not None and whole.time > 0.005
    monkeypatch.setattr(stress, "AT_ONCE", 4)
    assert stress.peak_stress(run) == whole


@pytest.mark.parametrize("format", ["urdf", "sdf"])
def test_where_an_arm_starts_is_in_no_file_of_a_format_without_states(format: str) -> None:
    scene = ROD.varied({"initial.joint_deg.rod": 10.0})
    assert not_held(scene, fl.lump(scene), format=format)["initial state"] == "all zero"


def test_the_fall_of_a_free_base_is_counted_from_the_start_of_its_run() -> None:
    base = fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3))
    scene = replace(ROD, arm=replace(ROD.arm, base=base)).varied({"gravity": (0.0, 0.0, -9.81), "run.duration": 0.01})
    later = fl.simulate(scene.varied({"initial.time": 2.0}))
    assert later.momentum_error is not None
    assert max(later.momentum_error) < 1e-9


def test_a_reference_below_a_lower_limit_is_refused() -> None:
    drive = fl.Drive(
        kind="pd", kp=(9.0,), kd=(1.0,), reference=fl.Reference(profile="quintic", to_deg=(-46.0,), duration=1)
    )
    with pytest.raises(fl.errors.SceneError, match="reaches -46 deg: outside limits_deg"):
        ROD.varied({"link.rod.joint.limits_deg": (-45.0, 90.0), "drive": drive})


def test_an_arm_in_denser_air_is_another_chain() -> None:
    scene = make_scene(flexible("beam", drag=fl.Drag(coefficient=1.2)))
    thin, dense = (fl.lump(replace(scene, air_density=ρ)) for ρ in (1.0, 3.0))
    np.testing.assert_allclose(dense.drag["drag"], 3 * thin.drag["drag"], rtol=1e-14)


class TestTheirFile:
    CHAIN = make_scene(*(flexible(name, segments=2, joint=fl.Joint(coulomb=0.5)) for name in "ab"))

    def test_without_friction_its_width_is_no_difference(self) -> None:
        ours = of_chain(fl.lump(self.CHAIN))
        theirs = dataclasses.replace(ours, coulomb=0 * ours.coulomb, coulomb_width=2 * ours.coulomb_width)
        assert set(_differing(ours, theirs)) == {"coulomb"}

    def test_what_it_lacks_is_taken_from_the_joint_of_the_same_name(self) -> None:
        """Their joints are c, a, b, or so: a circle, which is not its own inverse."""
        ours = of_chain(fl.lump(self.CHAIN))
        ours = dataclasses.replace(ours, armature=np.arange(1.0, ours.n + 1))
        order = np.roll(np.arange(ours.n), 1)
        match = Match(order, None, ours, True, [])
        filled = _missing(ours, dataclasses.replace(ours, unspecified=frozenset({"armature"})), match)
        assert filled["armature"][order].tolist() == ours.armature.tolist()

    def test_the_largest_of_the_differences_that_nothing_explains_is_named(self) -> None:
        rows = tuple(
            Difference("mujoco", name, error, "a", cast("Any", None)) for name, error in (("M", 2.0), ("T_G", 9.0))
        )
        assert "the largest is in T_G at joint 'a'" in str(Diagnosis("mujoco", rows, (), explained=False))
