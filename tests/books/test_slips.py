"""Values that a small mistake in the code would change, checked by hand or by a closed form."""

from __future__ import annotations

import dataclasses
import re
from functools import partial
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.advice.goal import Goal, TipErrorNorm
from flexlink.advice.verdict import time
from flexlink.cli import fit, import_robot
from flexlink.data.smoothing import smoothed
from flexlink.diagnosis.diagnosis import _missing
from flexlink.diagnosis.differences import _differing
from flexlink.diagnosis.matching import Match
from flexlink.dynamics.sensors.instrument import Instrument
from flexlink.engines.read_back import of_chain
from flexlink.formats.features import unsupported
from flexlink.identification.coordinates import coordinate_of
from flexlink.identification.identifiability import Check, Direction
from flexlink.pages.numbers import number
from flexlink.pages.tables import table_csv
from flexlink.results.pictures import stress
from flexlink.results.samples import Steps
from flexlink.robots.collection import KnownArm
from flexlink.robots.kinematic_tree import Mimic, Robot
from reports.measurements import Group
from tests.conftest import flexible, make_scene
from tests.support.words import line, refused, reviewed

ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


class TestOutputs:
    def test_numbers_rounded_to_one_more_digit_are_written_out_and_zeros_stay_in_tables(self) -> None:
        assert [number(999.7), number(-99.97, 2), number(9999.7, 4)] == ["1000", "−100", "10000"]
        assert (time(0.9997), time(0.9994)) == ("1 s", "999 ms")
        assert table_csv(("a", "b"), [(0.0, None), (0, False)]) == "a,b\n0.0,\n0,False\n"

    def test_the_first_parameter_of_a_direction_changes_by_ten_percent(self) -> None:
        text = Direction(("a", "b"), (0.8, -0.4), 2.0, True).text
        assert "+10 %" in text and "-5 %" in text
        reviewed("slips: direction", text)

    def test_the_uncertainty_of_a_negative_number_is_positive(self) -> None:
        columns = {"E": 0.1, "D": -2.0, "u_val": 0.1}
        group = Group("case", "title", "group", {name: np.array([x]) for name, x in columns.items()})
        assert (group.error.tolist(), group.u_val.tolist()) == ([-5.0], [5.0])

    def test_rejected_steps_are_printed_even_if_all_were_solved(self) -> None:
        text = str(Steps("RK4", 10, 48, rejected=2))
        assert [int(number) for number in re.findall(r"\b\d+", text)] == [10, 2, 0, 48]
        reviewed("slips: steps", text)

    def test_a_check_prints_half_widths_of_intervals(self, capsys: Any) -> None:
        fit._print_check(Check(("mass",), np.ones(1), (), np.array([0.01])))
        row = line(capsys.readouterr().out, "mass", "± 2 %", "95 %")
        reviewed("slips: check of a parameter", row)

    def test_formats_without_states_cannot_store_the_initial_state(self) -> None:
        scene = ROD.varied({"initial.joint_deg.rod": 10.0})
        urdf, sdf = (unsupported(scene, fl.lump(scene), format=format)["initial state"] for format in ("urdf", "sdf"))
        assert urdf == sdf
        reviewed("slips: initial state in a file", urdf)

    def test_the_time_of_peak_stress_does_not_depend_on_the_block_size_of_samples(self, monkeypatch: Any) -> None:
        scene = make_scene(flexible("beam", lumping="gauss"), gravity=(0.0, -9.81, 0.0), tip=fl.RigidBody(mass=2.0))
        run = fl.simulate(scene.varied({"run": {"step": 1e-4, "duration": 0.02, "sample": 1e-3}}))
        whole = stress.peak_stress(run)
        assert whole is not None and whole.time > 0.005
        monkeypatch.setattr(stress, "AT_ONCE", 4)
        assert stress.peak_stress(run) == whole


class TestInputs:
    @pytest.mark.parametrize(("given", "tried"), [((0.5, 2.0), (0.5, 2.0)), ((1e-9, 1e9), (1e-3, 1e3))])
    def test_by_default_a_parameter_is_fitted_within_a_factor_of_a_thousand(self, given: Any, tried: Any) -> None:
        assert coordinate_of(ROD, fl.fits.FitParameter(path="tip.mass", between=given)).between == pytest.approx(tried)

    def test_a_reference_below_a_lower_limit_is_refused(self) -> None:
        drive = {
            "kind": "pd",
            "kp": [9.0],
            "kd": [1.0],
            "reference": {"profile": "quintic", "to_deg": [-46.0], "duration": 1.0},
        }
        with refused(fl.errors.SceneError, "wrench-out-of-reach"):
            ROD.varied({"link.rod.joint.limits_deg": (-45.0, 90.0), "drive": drive})

    def test_the_band_filter_removes_its_frequency_and_passes_a_tenth_of_it(self) -> None:
        """The Hann window of two periods of the band has its first zero at the band frequency."""
        t = 1e-3 * np.arange(2001)
        norm = TipErrorNorm(Goal(1e-3, band=10.0), 1e-3)
        fast, slow = (norm.lengths(np.sin(2 * np.pi * f * t)[:, None])[200:-200].max() for f in (10.0, 1.0))
        assert fast < 0.01
        assert slow > 0.95

    def test_a_lock_on_the_command_line_replaces_the_stored_one(self) -> None:
        nothing = {key: [] for key in ("posture", "flexible", "armature")}
        options = SimpleNamespace(base=None, tip=None, free_base=False, locked=["b=90"], **nothing)
        known = KnownArm(file="arm.urdf", locked={"a": 0.1, "b": 0.2})
        arguments = import_robot._arguments(cast("Any", SimpleNamespace(joints={})), known, cast("Any", options))
        assert arguments["locked"] == {"a": 0.1, "b": np.pi / 2}

    def test_the_position_of_a_locked_slide_is_in_metres(self) -> None:
        slide = fl.Link(name="slide", length=1.0, joint=fl.Joint(kind="prismatic", axis=(1, 0, 0), locked=True))
        arm = make_scene(slide, fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0))
        chain = fl.lump(arm.varied({"initial.joint_m": (0.3, 0.0)}))
        np.testing.assert_allclose(fl.tip_position(chain, np.zeros(chain.n)), [2.3, 0.0, 0.0], atol=1e-15)

    def test_a_joint_that_mimics_a_mimic_follows_the_leader_of_both(self) -> None:
        mimics = {"a": None, "b": Mimic("a", 3.0, 5.0), "c": Mimic("b", 2.0, 1.0)}
        joints = {name: SimpleNamespace(name=name, mimic=mimic) for name, mimic in mimics.items()}
        robot = cast("Any", SimpleNamespace(joints=joints))
        robot.rule = partial(Robot.rule, robot)
        assert Robot.position(robot, cast("Any", joints["c"]), {"a": 0.5}) == 2 * (3 * 0.5 + 5) + 1

    def test_air_density_is_part_of_the_chain(self) -> None:
        scene = make_scene(flexible("beam", drag=fl.Drag(coefficient=1.2)))
        thin, dense = (fl.lump(replace(scene, air_density=ρ)) for ρ in (1.0, 3.0))
        np.testing.assert_allclose(dense.drag["drag"], 3 * thin.drag["drag"], rtol=1e-14)


class TestRuns:
    def test_the_momentum_of_a_falling_base_is_relative_to_the_start_of_its_run(self) -> None:
        base = fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3))
        falling = replace(ROD, arm=replace(ROD.arm, base=base), gravity=(0.0, 0.0, -9.81))
        later = fl.simulate(falling.varied({"run.duration": 0.01, "initial.time": 2.0}))
        assert later.momentum_error is not None and max(later.momentum_error) < 1e-9

    def test_step_errors_between_samples_count_like_those_at_samples(self) -> None:
        rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
        scene = make_scene(rod, gravity=(9.81, 0.0, 0.0)).varied(
            {"initial.joint_deg.a": 170.0, "run": {"step": 0.17, "duration": 34.0}}
        )
        warnings = (fl.simulate(scene, sample=sample).warnings for sample in (0.17, 0.85))
        sums = (next(found for text in texts if (found := re.search(r"(\S+) m\b", text))) for texts in warnings)
        often, seldom = (float(found[1]) for found in sums)
        assert seldom == pytest.approx(often, rel=0.5)

    def test_sensitivities_of_a_later_start_use_the_torques_at_that_time(self) -> None:
        drive = fl.Drive(kind="table", times=(0.0, 1.0, 2.0), torques=((0.0,), (5.0,), (-5.0,)))
        scene = ROD.varied({"drive": drive, "initial.time": 1.0, "run": {"step": 1e-3, "duration": 0.5, "sample": 0.1}})
        ends = [fl.simulate(scene.varied({"tip.mass": 1.0 + δ})).tip for δ in (1e-4, -1e-4)]
        found = fl.sensitivities(scene, ["tip.mass"]).tip[..., 0]
        np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-4, atol=1e-6)

    def test_arms_with_different_torque_limits_give_equal_runs_in_a_batch_and_alone(self) -> None:
        drive = fl.Drive(kind="pd", kp=(100.0,), kd=(1.0,), target_deg=(60.0,), effort=(1.0,))
        short = ROD.varied({"drive": drive, "run.duration": 0.01})
        scenes = [short.varied({"drive.effort": (effort,)}) for effort in (1.0, 2.0)]
        for run, scene in zip(fl.simulate_many(scenes), scenes, strict=True):
            np.testing.assert_allclose(run.q, fl.simulate(scene).q, rtol=1e-9)

    def test_axes_of_an_accelerometer_have_independent_noise(self) -> None:
        instrument = Instrument(fl.Sensor(name="a", kind="accelerometer", link="rod", noise=1.0), 0.01)
        t = 0.01 * np.arange(500)
        instrument.signal.add(t, np.zeros((500, 3)))
        assert np.abs(np.corrcoef(instrument.readings(t).T) - np.eye(3)).max() < 0.2

    def test_the_gain_of_a_filtered_sensor_applies_to_its_output(self) -> None:
        sensor = fl.Sensor(name="a", kind="joint", link="rod", low_pass=5.0)
        scenes = (replace(ROD, sensor=(replace(sensor, gain=gain),)) for gain in (1.0, 3.0))
        one, three = (
            fl.linearize(fl.lump(ROD), [0.2], outputs=[fl.small_motion.SensorOutputs(scene)]) for scene in scenes
        )
        np.testing.assert_allclose(three.C, 3 * one.C, rtol=1e-14)

    def test_smoothing_does_not_depend_on_the_direction_of_time(self, rng: np.random.Generator) -> None:
        t, y = 0.01 * np.arange(40), rng.normal(size=40)
        back = smoothed(t, y[::-1].copy(), 10.0)
        for order, (one, other) in enumerate(zip(smoothed(t, y, 10.0), back, strict=True)):
            np.testing.assert_allclose((-1) ** order * other[::-1], one, rtol=1e-6, atol=1e-6 * np.abs(one).max())

    def test_rates_of_a_keyframe_are_in_the_order_of_its_angles(self) -> None:
        names = (("a", "base"), ("b", "base"), ("c", "a"))
        links = (fl.Link(name=name, on=on, length=1.0, material="aluminium", section="square") for name, on in names)
        chain = fl.lump(make_scene(*links))
        (key,) = ElementTree.fromstring(fl.to_mjcf(chain, initial=([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]))).iter("key")
        assert key.get("qpos") == key.get("qvel") == "1.0 3.0 2.0"

    def test_the_energy_of_coupled_springs_is_relative_to_their_rest_angles(self, rng: np.random.Generator) -> None:
        chain = fl.lump(make_scene(flexible("a", segments=5, lumping="lobatto2")))
        hinges, q = chain.hinges.copy(), rng.normal(size=chain.n)
        hinges["rest"] = np.where(chain.stiffness > 0, rng.normal(size=chain.n), 0.0)
        stretch = q - hinges["rest"]
        energy = fl.energy(dataclasses.replace(chain, hinges=hinges), q, np.zeros(chain.n))
        assert energy.elastic == pytest.approx(stretch @ chain.matrix("stiffness") @ stretch / 2, rel=1e-12)


class TestTheirFile:
    CHAIN = make_scene(*(flexible(name, segments=2, joint=fl.Joint(coulomb=0.5)) for name in "ab"))

    def test_the_friction_width_is_not_compared_without_friction(self) -> None:
        ours = of_chain(fl.lump(self.CHAIN))
        theirs = dataclasses.replace(ours, coulomb=0 * ours.coulomb, coulomb_width=2 * ours.coulomb_width)
        assert set(_differing(ours, theirs)) == {"coulomb"}

    def test_missing_data_are_taken_from_the_joint_of_the_same_name(self) -> None:
        ours = of_chain(fl.lump(self.CHAIN))
        ours = dataclasses.replace(ours, armature=np.arange(1.0, ours.n + 1))
        order = np.roll(np.arange(ours.n), 1)  # a cyclic permutation differs from its inverse
        theirs = dataclasses.replace(ours, unspecified=frozenset({"armature"}))
        filled = _missing(ours, theirs, Match(order, None, ours, True, []))
        assert filled["armature"][order].tolist() == ours.armature.tolist()
