"""A fit reports that its model is wrong, and names a physical cause; the beam has its own equations."""

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.signal import lfilter

import flexlink as fl
from flexlink.common.errors import Diagnostic
from flexlink.identification.block import Block
from flexlink.identification.columns import Floor, excess, floor_of, warnings_of_floors
from flexlink.identification.coordinates import coordinates_of, guess_of
from flexlink.identification.data import sources_of
from flexlink.identification.faults import causes
from flexlink.identification.signals import Signals
from tests.campaigns.random_fits import drawn, problem_of, record, scene_of
from tests.identification.test_page import column
from tests.support.fits import CLAMPED, boom, problem
from tests.support.words import reviewed

T = 0.005 * np.arange(1001)
MOTION = np.where(T > 1, 0.3 * np.cos(9 * (T - 1)) * np.exp(1 - T), 0.3)


def measured(e: np.ndarray, **more: object) -> Block:
    return Block("tip y [m]", MOTION + e, np.full(len(T), 2e-3), bool(more.pop("stated", False)), T, **more)  # type: ignore[arg-type]


def coloured(seed: int) -> np.ndarray:
    """Noise of standard deviation 1e-3 with a correlation of 0.8 between neighbours."""
    return np.asarray(lfilter([0.6e-3], [1.0, -0.8], np.random.default_rng(seed).standard_normal(len(T) + 99))[99:])


class TestNoise:
    def test_it_comes_from_the_user_a_repeat_the_rest_or_high_frequencies_but_not_from_a_residual(self) -> None:
        white = 1e-3 * np.random.default_rng(0).standard_normal(len(T))
        other = measured(coloured(2))
        moving = MOTION + 0.1 * np.sin(9 * T)
        for block, y, repeats, words in (
            (measured(white, stated=True), MOTION, [], "as stated"),
            (measured(coloured(1)), moving, [other], "from a repeated run"),
            (measured(coloured(1)), MOTION, [], "from the rest before the move"),
            (measured(white), moving, [], "from high frequencies"),
        ):
            found = floor_of(block, y, repeats)
            assert found is not None and found.words == words
            wanted = 2e-3 if words == "as stated" else 1e-3
            assert abs(found.σ / wanted - 1) < 4 / np.sqrt(2 * found.freedom)  # four deviations of a deviation
        assert floor_of(measured(coloured(1)), moving, []) is None

    @pytest.mark.parametrize("part", [0.0, 0.5])
    def test_a_slow_motion_of_half_the_noise_is_seen_in_the_lower_part_of_the_spectrum(self, part: float) -> None:
        e = 1e-3 * np.random.default_rng(3).standard_normal(len(T)) + part * 1e-3 * np.sin(7 * T)
        whole, *parts = excess(e, Floor(1e-3, 400, "", white=True))
        assert whole[0] == pytest.approx(1 + part**2 / 2, abs=4 * np.sqrt(2 / len(T)))
        assert (max(F for F, _ in parts) > 1.5) == (part > 0)

    def test_the_rest_and_unknown_noise_are_reported(self) -> None:
        y = np.sin(np.arange(200) / 9.0)
        one = column("a", "fit", y, y, y + 0.1)
        assert one.unexplained == pytest.approx(10 / y.std())
        far, unknown = dataclasses.replace(one, floor=0.02, floor_from="as stated", within=False), one
        for several, named in (((far,), []), ((one,), [Diagnostic("better explained by x", "likely-cause")])):
            (text,) = warnings_of_floors(several, named)
            assert text.id == "not-explained"
            reviewed("not-explained", text)
        (text,) = warnings_of_floors((unknown,), [])
        reviewed("noise-not-known", text)
        assert not [*warnings_of_floors((dataclasses.replace(one, within=True),), [])]


def applying(of: fl.fits.FitProblem) -> set[str]:
    coordinates = coordinates_of(of)
    return {one.unknown.path for one in causes(Signals(sources_of(of, "fit"), coordinates), guess_of(coordinates))}


def test_causes_are_those_that_the_scene_allows_and_that_are_not_sought() -> None:
    t = tuple(0.005 * np.arange(41))
    run = fl.fits.FitRun(name="a", columns={"t [s]": t, "tip y [m]": (0.0,) * 41})
    free = applying(problem(boom(), ("link.*.joint.armature",), run))
    joint, sought = {"link.boom.joint.coulomb", "link.boom.joint.quadratic"}, "tip.mass"
    there = joint | {sought, "section.strip_tip.height", "material.steel.young"}
    assert there < free
    assert not [path for path in free if path.endswith(".armature")]
    longer = problem(boom(), (sought,), replace(run, set={"link.boom.length": 1.1}))
    assert sought not in applying(longer)
    clamped = applying(problem(CLAMPED, (sought,), run))
    assert not any("joint" in path for path in clamped)
    assert [path for path in clamped if path.endswith("drag.coefficient")]


def test_a_shorter_link_keeps_the_sensors_at_its_end() -> None:
    sensors = (fl.Sensor(name="end", kind="gyroscope", link="boom", axis=(0, 0, 1), x=1.0),
               fl.Sensor(name="root", kind="strain", link="boom", x=0.05, fibre=(0.002, 0.0)))  # fmt: skip
    t = tuple(0.005 * np.arange(41))
    run = fl.fits.FitRun(name="a", columns={"t [s]": t, "end [rad/s]": (0.0,) * 41, "root [1]": (0.0,) * 41})
    of = problem(boom(sensor=sensors), ("tip.mass",), run)
    coordinates = coordinates_of(of)
    found = causes(Signals(sources_of(of, "fit"), coordinates), guess_of(coordinates))
    (length,) = (one for one in found if one.unknown.path == "link.boom.length")
    shorter = length.sources[0].scene.varied({"link.boom.length": 0.9})
    assert [one.x for one in shorter.sensor] == [None, 0.05]
    assert length.stated and length.unknown.start == 1.0


@pytest.mark.slow
class TestBench:
    @pytest.mark.parametrize(("seed", "kind", "path"), [
        (1, "dry friction", "link.l0.joint.coulomb"), (3, "soft root", "link.l0.root_stiffness.z"),
        (5, "half payload", "tip.mass"), (55, "length", "link.l0.length"),
    ])  # fmt: skip
    def test_a_bench_whose_scene_lacks_a_cause_is_reported_with_it(self, seed: int, kind: str, path: str) -> None:
        of, true = problem_of(seed, kind)
        found = fl.fit(of)
        assert not found.passed and not found.explained
        named = next(one for one in found.warnings if one.id.startswith("likely-"))
        assert named.id == "likely-cause" and f"fit {path} = " in named
        reviewed("likely-cause", named, values=False)
        value = float(named.partition(" = ")[2].partition(" ")[0])
        sought = (*of.parameter, fl.fits.FitParameter(path=path, start=value, scale="log"))
        at_end = of.scene.varied({"sensor.acc.x": None, "sensor.gyro.x": None})  # a sought length moves its sensors
        repaired = fl.fit(replace(of, scene=at_end, parameter=sought))
        assert repaired.explained
        assert all(abs(repaired[one].value - was) < 2 * repaired[one].half for one, was in true.items())

    def test_a_record_agrees_with_a_fine_chain_to_a_tenth_of_its_noise(self) -> None:
        p = drawn(np.random.default_rng(100))
        fine = {"link.l0.segments": 15, "run.relative_tolerance": 1e-8, "run.tolerance": None}
        run = fl.simulate(scene_of(p, 0.2).varied(fine))
        for head, y in record(p, 0.2).items():
            assert np.sqrt(np.mean((run.columns[head] - y) ** 2)) <= 0.1 * 0.01 * np.ptp(y)

    def test_a_right_model_is_explained(self) -> None:
        of, true = problem_of(2, "")
        found = fl.fit(of)
        assert found.explained
        assert all(abs(found[one].value - was) < 2 * found[one].half for one, was in true.items())
        assert found.document()["explained"] and 0 < found.document()["columns"][0]["unexplained"] < 10
