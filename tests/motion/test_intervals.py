"""Intervals of predictions with uncertain inputs against samples of closed forms and of measured beams."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import flexlink as fl
from flexlink.cli.main import main
from flexlink.dynamics.vibration.modal import modes
from flexlink.motion.intervals import intervals
from tests.support.words import refused

U = {"material.steel.young": 0.03, "section.strip.height": 0.02, "link.beam.length": 0.001}
CLAMP = {"link.beam.root_stiffness": 0.0}


def beam(uncertain: dict[str, float], length: float = 0.759, thickness: float = 0.00514, tip: float = 0.0) -> fl.Scene:
    """A steel cantilever that bends in a horizontal plane; its inputs are uncertain."""
    link = fl.Link(
        name="beam", length=length, flex="z", segments=21, lumping="gauss", material="steel", section="strip",
        joint=fl.Joint(locked=True),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"steel": fl.Material(young=200e9, density=7850.0)},
        sections={"strip": fl.Section(shape="rectangle", width=0.05066, height=thickness)}, tip=fl.RigidBody(mass=tip),
    )  # fmt: skip
    return fl.Scene(name="beam", arm=arm, gravity=(0.0, 0.0, 0.0), uncertain=uncertain)


def hertz(scene: fl.Scene, count: int = 8) -> np.ndarray:
    chain = fl.lump(scene)
    return modes(chain, chain.rest, count=count).hertz[:count]


def test_the_interval_of_a_cantilever_is_that_of_its_closed_form() -> None:
    """f ~ √E h / L²: the logarithm is normal, with the variances of its inputs, which are also their shares."""
    scene = beam(U | CLAMP)
    found = intervals(scene, hertz)
    parts = np.array([0.5 * 0.03, 0.02, 2 * 0.001]) ** 2
    ends = found.value * np.exp(np.outer([-1.96, 1.96], [np.sqrt(parts.sum())] * 8))
    width = ends[1] - ends[0]
    noise = 4 * np.sqrt(0.025 * 0.975 / 20_000) / 0.0584 / 3.92  # four deviations of a quantile of 20,000 draws
    assert np.abs(found.low - ends[0]).max() < noise * width.max()
    assert (np.abs(found.high - ends[1]) < (noise + 0.01) * width).all()
    assert found.shares[:, 0] == pytest.approx(parts / parts.sum(), abs=0.02)
    assert found.linear.all()
    assert found.inputs == tuple(U)


def spring_beam(ε: float) -> float:
    """f / f(0) of a cantilever whose root has a spring, ε = EI / (k L), by its frequency equation; f ~ β²."""
    equation = lambda β, ε: 1 + np.cos(β) * np.cosh(β) + ε * β * (np.cos(β) * np.sinh(β) - np.sin(β) * np.cosh(β))  # noqa: E731
    return (brentq(equation, 1.2, 1.9, args=(ε,)) / brentq(equation, 1.2, 1.9, args=(0.0,))) ** 2


def test_a_clamp_is_uncertain_by_default_and_lowers_frequencies() -> None:
    found = intervals(beam({}), lambda scene: hertz(scene, 1))
    assert found.inputs == tuple(CLAMP)
    low, high = found.low[0] / found.value[0] - 1, found.high[0] / found.value[0] - 1
    assert low == pytest.approx(spring_beam(0.02 * 2.241) - 1, rel=0.03)  # 97.5 % of |z| are below 2.241
    assert high == pytest.approx(spring_beam(0.02 * 0.0313) - 1, rel=0.3)  # 2.5 % of |z| are below 0.0313
    given = beam({}).varied({"link.beam.root_stiffness": {"z": 1e4}})
    with refused(fl.errors.ArgumentError, "missing-key"):
        intervals(given, hertz)


def test_intervals_agree_with_samples_or_are_marked_as_rough() -> None:
    rng, checked = np.random.default_rng(3), []
    for scale in (1.0, 1.0, 12.0):
        u = {"material.steel.young": 0.05 * scale, "section.strip.height": 0.02 * scale, "tip.mass": 0.1 * scale}
        scene = beam(u | CLAMP, tip=rng.uniform(0.1, 1.0))
        sag = scene.varied({"gravity": (0.0, -9.81, 0.0)})

        def predicted(varied: fl.Scene) -> np.ndarray:
            chain = fl.lump(varied)
            rest = fl.solve_static(chain, chain.rest)
            return np.append(modes(chain, rest.q, count=3).hertz[:3], fl.tip_position(chain, rest.q)[1])

        found = intervals(sag, predicted)
        values = {"material.steel.young": 200e9, "section.strip.height": 0.00514, "tip.mass": scene.arm.tip.mass}
        sampled = [
            predicted(sag.varied({path: x * np.exp(u[path] * rng.standard_normal()) for path, x in values.items()}))
            for _ in range(1000)
        ]
        low, high = np.quantile(sampled, (0.025, 0.975), axis=0)
        wrong = np.abs((found.high - found.low) / (high - low) - 1) > 0.12  # 3 deviations of 1000 samples are 9 %
        assert not (wrong & found.linear).any()
        checked.append(bool(found.linear.all()))
    assert checked == [True, True, False]


MEASURED = [6.599, 41.45, 117.932, 230.011, 380.346, 569.214, 797.428, 1057.231]  # Hz, tests/motion/cantilever.md


def test_uncertain_inputs_explain_a_beam_that_is_thinner_than_stated() -> None:
    """Its thickness is stated as 5.14 mm and explains none of 8 frequencies, which are 7 to 10 % lower."""
    u = {"material.steel.young": 0.02, "section.strip.height": 0.03, "link.beam.length": 0.001, "tip.mass": 0.2}
    found = intervals(beam(u, tip=0.0058), hertz)
    inside = (found.low < MEASURED) & (found.high > MEASURED)
    assert inside.mean() >= 0.9
    assert ((found.high - found.low) / found.value < 0.2).all()


@pytest.mark.parametrize(
    ("id", "uncertain"),
    [
        ("cannot-set", {"tip.masss": 0.1}),
        ("not-a-number", {"name": 0.1}),
        ("wrong-value", {"tip.mass": -1.0}),
    ],
)
def test_inputs_are_checked_when_a_scene_is_read(id: str, uncertain: dict[str, float]) -> None:
    with refused(fl.errors.SceneError, id):
        beam(uncertain)


def test_scenes_keep_uncertain_inputs_and_commands_print_intervals(tmp_path: Path, capsys) -> None:
    angle = "initial.joint_deg.beam"
    scene = beam({"material.steel.young": 0.02, angle: 1.0}, tip=0.1)
    path = scene.varied({"run.duration": 0.05, "gravity.y": -9.81}).save(tmp_path / "beam.toml")
    assert fl.load_scene(path).uncertain == scene.uncertain
    assert main(["modes", str(path), "--uncertain", "--count", "2"]) == 0
    assert "mode 2 [Hz]" in capsys.readouterr().out
    assert main(["modes", str(path), "--uncertain", "--count", "2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["intervals"]
    assert [row["of"] for row in said] == [f"tip {x} at rest [m]" for x in "xyz"] + ["mode 1 [Hz]", "mode 2 [Hz]"]
    assert said[3]["low"] < said[3]["value"] < said[3]["high"]
    assert said[1]["shares"][angle] > 0.9  # 1° moves the tip by 13 mm
    afloat = scene.varied({"base": {"kind": "free", "mass": 1.0, "inertia": [1.0] * 3}, "uncertain": {"tip.mass": 0.1}})
    assert main(["modes", str(afloat.save(tmp_path / "afloat.toml")), "--uncertain", "--json"]) == 0
    drifting = json.loads(capsys.readouterr().out)["intervals"]
    assert [row["value"] for row in drifting[:3]] == [None] * 3  # a floating arm has no position at rest
    assert main(["simulate", str(path), "--uncertain", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["intervals"]
    assert [row["of"] for row in said][3:] == ["largest deflection [m]"]
