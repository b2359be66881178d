"""Modes about a steady motion agree with closed forms of blades and pendulums; unsteady motions are refused."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.cli.modes import first_in_motion, rates_of
from flexlink.errors import ArgumentError
from tests.conftest import flexible, make_scene
from tests.support.words import refused, refused_line, reviewed

ROOT = Path(__file__).parents[2]
OMEGA, OFFSET, LENGTH, MASS = 20.0, 0.1, 0.8, 1.5  # rad/s, m, m, kg
BAR = fl.RigidBody(
    mass=MASS, center=(LENGTH / 2, 0.0, 0.0), inertia=(0.0, MASS * LENGTH**2 / 12, MASS * LENGTH**2 / 12)
)
UP = fl.Link(name="shaft", hub=fl.RigidBody(inertia=(0.1, 0.1, 0.1)))


def blade(axis: tuple[float, float, float], offset: float = OFFSET, **fields: object) -> fl.Chain:
    """A rigid bar on a hinge about an axis, at a distance from a shaft about Z."""
    bar = fl.Link(name="blade", mount=fl.Mount(xyz=(offset, 0.0, 0.0)), joint=fl.Joint(axis=axis), hub=BAR)
    return fl.lump(make_scene(UP, bar, **{"gravity": (0.0, 0.0, 0.0), **fields}))


@pytest.mark.parametrize(("axis", "stiff"), [((0.0, 1.0, 0.0), 1.0), ((0.0, 0.0, 1.0), 0.0)], ids=["flap", "lag"])
def test_a_hinged_blade_has_the_flap_and_lag_frequencies_of_a_helicopter_blade(axis, stiff) -> None:
    """(ω/Ω)² = 1 + 3 e/(2 l) across the plane of rotation, 3 e/(2 l) in it, for a hinge at radius e (Johnson 1980)."""
    found = fl.small_motion.modes_in_motion(blade(axis), {"shaft": OMEGA})
    assert found.frequencies[0] / OMEGA == pytest.approx(np.sqrt(stiff + 1.5 * OFFSET / LENGTH), rel=1e-9)
    assert found.kinds == ("pendulum",)


def test_a_conical_pendulum_has_the_closed_form_cone_angle_and_frequency() -> None:
    """A bar hinged to a vertical shaft: sin β = −g/(Ω² ⅔ l) for the angle β from horizontal, and ω = Ω cos β."""
    chain = blade((0.0, 1.0, 0.0), offset=0.0, gravity=(0.0, 0.0, -9.81))
    below = np.arcsin(9.81 / (OMEGA**2 * 2 / 3 * LENGTH))
    rest = fl.small_motion.equilibrium_in_motion(chain, {"shaft": OMEGA}, [0.0, 0.3])
    assert rest.q[1] == pytest.approx(below, abs=1e-9)
    assert rest.stable
    found = fl.small_motion.modes_in_motion(chain, {"shaft": OMEGA}, [0.0, 0.3])
    assert found.frequencies[0] == pytest.approx(OMEGA * np.cos(below), rel=1e-7)


def test_a_rotating_beam_has_the_published_flap_frequencies(capsys: pytest.CaptureFixture[str]) -> None:
    """Flap frequencies of a clamped beam, √(EI/ρAL⁴) = 1: 4.1373 and 11.2023 at Ω = 2, 10 (Wright et al. 1982)."""
    scene = fl.load_scene(ROOT / "validation" / "scenes" / "spinning_beam.toml")
    flap = scene.varied({"link.beam.mount.rpy_deg": [90.0, 0.0, 0.0], "link.beam.lumping": "lobatto4",
                         "link.beam.segments": 17})  # fmt: skip
    for rate, published in ((2.0, 4.1373), (10.0, 11.2023)):
        found = fl.small_motion.modes_in_motion(fl.lump(flap), {"hub": rate}, count=1)
        assert found.frequencies[0] == pytest.approx(published, abs=2e-4)
    of_command = ["modes", str(ROOT / "validation" / "scenes" / "spinning_beam.toml"), "--count", "1"]
    turned = ["link.beam.mount.rpy_deg=[90,0,0]", "link.beam.lumping=lobatto4", "link.beam.segments=17"]
    sets = [word for each in turned for word in ("--set", each)]
    assert main([*of_command, *sets, "--rate", "hub=10rad/s"]) == 0
    *_, mode, last = capsys.readouterr().out.splitlines()
    assert float(mode.split()[1]) == pytest.approx(11.2023 / (2 * np.pi), abs=3e-5)
    assert [part for part in (f"{mode.split()[1]} Hz", "(pendulum)", "hub=10rad/s") if part not in last] == []
    reviewed("steady motion: lowest frequency", last)


def test_the_lowest_frequency_is_that_of_the_first_mode_that_swings() -> None:
    found: Any = SimpleNamespace(
        hertz=np.array([0.0, 2.0, 5.0]), kinds=("rigid", "pendulum", "elastic"), first_elastic_hertz=5.0
    )  # fmt: skip
    text = first_in_motion(found, ["shaft=1rpm"])
    assert re.findall(r"(\d) Hz", text) == ["2", "5"] and "(pendulum)" in text


@pytest.mark.parametrize("rate", ["60rpm", "360 deg/s", f"{2 * np.pi}rad/s"])
def test_a_turn_a_second_may_be_given_in_three_units(rate: str) -> None:
    assert rates_of(blade((0.0, 0.0, 1.0)), [f"shaft={rate}"]) == {"shaft": pytest.approx(2 * np.pi)}


def test_modes_of_a_swept_tip_are_about_its_rotating_equilibrium() -> None:
    """The configuration is a relative equilibrium up to rounding, and far from the straight one."""
    swept = flexible("tip", "xyz", 3, length=0.4, joint=fl.Joint(locked=True), section="square")
    scene = make_scene(
        UP, flexible("beam", "xyz", 5, length=2.0, joint=fl.Joint(locked=True)), swept, gravity=(0.0, 0.0, 0.0),
        initial=fl.InitialState(joint_deg=(0.0, 0.0, 45.0)),
    ).varied({"section.square": fl.Section(shape="rectangle", height=0.01, width=0.04)})  # fmt: skip
    chain = fl.lump(scene)
    rest = fl.small_motion.equilibrium_in_motion(chain, {"shaft": 30.0})
    qd = np.zeros(chain.n)
    qd[0] = 30.0
    left = fl.bias_torque(chain, rest.q, qd) + fl.elastic_torque(chain, rest.q)
    assert np.abs(left[1:]).max() < 1e-9 * np.abs(fl.bias_torque(chain, 0 * qd, qd)).max()
    assert np.abs(rest.q[1:]).max() > 0.01
    about = fl.modes(chain, rest.q, qd, locked=["shaft"]).frequencies
    np.testing.assert_array_equal(fl.small_motion.modes_in_motion(chain, {"shaft": 30.0}).frequencies, about)


def test_an_arm_on_a_slide_at_constant_speed_vibrates_as_at_rest() -> None:
    lift = fl.Link(name="lift", joint=fl.Joint(kind="prismatic", armature=1.0), hub=fl.RigidBody(mass=5.0))
    boom = flexible("boom", "yz", 5, joint=fl.Joint(locked=True))
    chain = fl.lump(make_scene(lift, boom, gravity=(0.0, 0.0, -9.81)))
    still, moving = (fl.small_motion.modes_in_motion(chain, {"lift": rate}).frequencies for rate in (0.0, 3.0))
    np.testing.assert_allclose(moving, still, rtol=1e-12)


def test_a_spinning_wheel_on_a_boom_must_be_axisymmetric() -> None:
    def with_wheel(inertia: tuple[float, float, float]) -> fl.Chain:
        wheel = fl.Link(name="wheel", joint=fl.Joint(axis=(1.0, 0.0, 0.0)), hub=fl.RigidBody(mass=2.0, inertia=inertia))
        return fl.lump(
            make_scene(flexible("boom", "xyz", 3, joint=fl.Joint(locked=True)), wheel, gravity=(0.0, 0.0, -9.81))
        )

    still, spun = (
        fl.small_motion.modes_in_motion(with_wheel((0.2, 0.1, 0.1)), {"wheel": r}, count=2).hertz for r in (0.0, 300.0)
    )
    assert spun[0] < 0.99 * still[0] < still[1] < spun[1]  # gyroscopic splitting of both frequencies
    with refused(ArgumentError, "no-steady-motion"):
        fl.small_motion.modes_in_motion(with_wheel((0.2, 0.15, 0.05)), {"wheel": 300.0})


def test_unsteady_motions_and_unknown_names_are_refused() -> None:
    across = fl.lump(make_scene(flexible("a", "xyz", 3), gravity=(0.0, -9.81, 0.0)))
    with refused(ArgumentError, "no-steady-motion"):
        fl.small_motion.modes_in_motion(across, {"a": 5.0})
    level = fl.lump(make_scene(flexible("a", "xyz", 3), flexible("b", "z", 3), gravity=(0.0, 0.0, 0.0)))
    with refused(ArgumentError, "no-steady-motion"):
        fl.small_motion.modes_in_motion(level, {"a": 5.0}, tip_wrench=[0, 0.1, 0, 0, 0, 0], locked=["b"])
    fl.small_motion.modes_in_motion(level, {"a": 5.0}, tip_wrench=[0, 0.1, 0, 0, 0, 0], frame="tip", locked=["b"])
    for rates, id, parts in (
        ({"a.1.z": 1.0}, "rate-of-hinge", ("'a.1.z'", ": a, b")), ({"c": 1.0}, "unknown-joint", ("'c'",)),
        ({}, "wrong-type", ("rates = {}",)), (5.0, "wrong-type", ("rates = 5.0",)),
        ({"a": np.inf}, "not-finite", ("rates['a']",)),
    ):  # fmt: skip
        with refused(ArgumentError, id) as caught:
            fl.small_motion.modes_in_motion(level, rates)
        assert [part for part in parts if part not in str(caught.value)] == []
    with refused(ArgumentError, "locked-and-moving"):
        fl.small_motion.modes_in_motion(level, {"a": 5.0}, locked=["a"])


@pytest.mark.parametrize(
    ("rate", "id", "parts"),
    [
        ("waist=60", "option-value", ("NAME=RATE", "hub=500rpm", "rpm, deg/s, rad/s, m/s")),
        ("upper=5m/s", "option-value", ("rpm, deg/s, rad/s",)), ("upper=fastrpm", "option-value", ("NAME=RATE",)),
        ("waist=5rpm", "locked-and-moving", ("'waist'", "joint.locked")), ("hub=5rpm", "unknown-joint", ("'hub'",)),
    ],
)  # fmt: skip
def test_an_impossible_rate_gives_one_line_and_exit_code_2(rate: str, id: str, parts: tuple[str, ...], capsys) -> None:
    scene = ROOT / "models" / "paper_fig5.toml"
    assert main(["modes", str(scene), "--rate", rate]) == 2
    printed = capsys.readouterr().err
    assert len(printed.splitlines()) == 1
    text = refused_line(printed, id)
    assert [part for part in parts if part not in text] == []
