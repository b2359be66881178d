"""Values in a wrong unit get a hint with the likely unit; sensible arms get no hints."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.wording import id_of
from flexlink.describe.plausibility.hints import hints
from flexlink.dynamics.notes import notes
from flexlink.scene_report.parts import model
from flexlink.scene_report.study import Study
from tests.conftest import ALUMINIUM, ROOT, SQUARE, flexible, make_scene
from tests.support.sensible import sensible_arm
from tests.support.words import line, reviewed

STEEL = fl.Material(young=2.1e11, density=7850.0)
CRANE = fl.Scene(
    name="crane", gravity=(0.0, 0.0, -9.81),
    arm=fl.Arm(
        materials={"steel": STEEL},
        sections={"tube": fl.Section(shape="tube", outer=0.12, inner=0.11),
                  "profile": fl.Section(shape="general", area=1.8e-3, i_y=3e-6, i_z=3e-6, torsion=6e-6)},
        links=(
            fl.Link(name="boom", length=2.5, material="steel", section="tube", flex="yz", segments=3,
                    mount=fl.Mount(xyz=(0.0, 0.0, 0.8), rpy_deg=(90.0, 0.0, 0.0)),
                    joint=fl.Joint(armature=0.4, gear_stiffness=2e6, limits_deg=(-170.0, 170.0)),
                    damping=fl.Damping(ratio=0.02, at_hz=5.0)),
            fl.Link(name="jib", length=1.8, material="steel", section="profile", flex="yz", segments=3,
                    mount=fl.Mount(xyz=(0.05, 0.0, 0.0))),
        ),
        tip=fl.RigidBody(mass=200.0, center=(0.1, 0.0, 0.0), inertia=(5.0, 5.0, 5.0)),
    ),
    initial=fl.InitialState(joint_deg=(90.0, -45.0)),
    drive=fl.Drive(kind="constant", torque=(9000.0, 3000.0)),
    wrench=fl.Wrench(times=(0.0, 0.5, 1.0), forces=((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    sensor=(fl.Sensor(name="gauge", kind="strain", link="boom", x=0.1, fibre=(0.06, 0.0), delay=0.002),),
    run=fl.RunSettings(tolerance=1e-3, duration=2.0),
)  # fmt: skip
PD = {"kind": "pd", "kp": [1e5, 1e5], "kd": [1e3, 1e3]}
PLANTED: list[tuple[dict[str, Any], str, str]] = [
    ({"material.steel.young": 210.0}, "material.steel.young", "GPa"),
    ({"material.steel.young": 210e3}, "material.steel.young", "MPa"),
    ({"material.steel.young": 210e6}, "material.steel.young", "kPa"),
    ({"material.steel.density": 7.85}, "material.steel.density", "g/cm³"),
    ({"material.steel.density": 7.85e-6}, "material.steel.density", "kg/mm³"),
    ({"material.steel.density": 7.85e-9}, "material.steel.density", "t/mm³"),
    ({"material.steel.loss_time": 0.3}, "material.steel.loss_time", "ms"),
    ({"link.boom.damping.ratio": 2.0}, "link.boom.damping.ratio", "%"),
    ({"link.boom.damping.ratio": 1.0}, "link.boom.damping.ratio", "%"),
    ({"link.boom.length": 2500.0}, "link.boom.length", "mm"),
    ({"section.tube": {"shape": "tube", "outer": 120.0, "inner": 110.0}}, "section.tube.outer", "mm"),
    ({"section.tube": {"shape": "circle", "diameter": 12.0}}, "section.tube.diameter", "mm"),
    ({"section.tube": {"shape": "tube", "outer": 3.0, "inner": 2.8}}, "section.tube.outer", "mm"),
    ({"section.profile.area": 1800.0}, "section.profile.area", "mm²"),
    ({"section.profile.i_y": 3e6}, "section.profile.i_y", "mm⁴"),
    ({"link.boom.curvature": 30.0}, "link.boom.curvature", "°/m"),
    ({"link.boom.twist": 90.0}, "link.boom.twist", "°/m"),
    ({"initial": {"q": [20.0, 0, 0, 0, -40.0, 0, 0, 0], "qd": [0.0] * 8}}, "initial.q", "°"),
    ({"uncertain": {"tip.mass": 5.0}}, "uncertain.tip.mass", "%"),
    ({"section.tube.inner": 0.005}, "section.tube.inner", "wall"),
    ({"drive": {**PD, "reference": {"profile": "quintic", "to_deg": [60.0, 0.0], "duration": 1.0, "start": 500.0}}},
     "drive.reference.start", "ms"),
    ({"tie": [{"name": "rope", "kind": "distance", "link": "jib", "to": {"point": [2.0, 0.0, 3.0]},
               "times": [0.0, 1500.0], "lengths": [3.0, 2.0]}]}, "tie.rope.times[1]", "ms"),
    ({"sensor": [{"name": "motor", "kind": "current", "link": "boom", "torque_constant": 0.1}]},
     "sensor.motor.torque_constant", "A"),
    ({"gravity": [0.0, 0.0, -9810.0]}, "gravity", "mm/s²"),
    ({"gravity": [0.0, 0.0, -1.0]}, "gravity", "g"),
    ({"sensor.gauge.fibre": [60.0, 0.0]}, "sensor.gauge.fibre", "mm"),
    ({"section.profile.area": 6.4}, "section.profile.area", "cm²"),
    ({"drive": {**PD, "target_deg": [30.0, 60.0], "rate": 1e3, "delay": 2.0}}, "drive.delay", "ms"),
    ({"sensor.gauge.delay": 2.0}, "sensor.gauge.delay", "ms"),
    ({"tip.mass": 200e3}, "tip.mass", "g"),
    ({"tip.center": [150.0, 0.0, 0.0]}, "tip.center", "mm"),
    ({"link.boom.end": {"mass": 5.0, "center": [30.0, 0.0, 0.0]}}, "link.boom.end.center", "mm"),
    ({"tip.inertia": [5e6, 5e6, 5e6]}, "tip.inertia", "kg mm²"),
    ({"link.jib.mount.xyz": [500.0, 0.0, 0.0]}, "link.jib.mount.xyz", "mm"),
    ({"link.boom.joint.gear_stiffness": 2000.0}, "link.boom.joint.gear_stiffness", "kN m/rad"),
    ({"link.boom.root_stiffness.y": 2000.0}, "link.boom.root_stiffness.y", "kN m/rad"),
    ({"link.boom.joint.armature": 4e6}, "link.boom.joint.armature", "kg cm²"),
    ({"initial.joint_deg.boom": 0, "link.boom.joint.limits_deg": [-2.9671, 2.9671]},
     "link.boom.joint.limits_deg", "rad"),
    ({"initial.joint_deg": [1.5708, -0.7854]}, "initial.joint_deg", "rad"),
    ({"initial.joint_deg": [1.57, 0.0]}, "initial.joint_deg", "rad"),
    ({"link.boom.mount.rpy_deg": [1.5708, 0.0, 0.0]}, "link.boom.mount.rpy_deg", "rad"),
    ({"link.boom.mount": {"rpy": [90.0, 0.0, 0.0]}}, "link.boom.mount.rpy", "deg"),
    ({"drive": {**PD, "target_deg": [0.5236, 1.0472]}}, "drive.target_deg", "rad"),
    ({"drive": {**PD, "reference": {"from_deg": [1.5708, -0.7854], "to_deg": [30.0, 60.0], "profile": "quintic",
                                    "duration": 1.0}}}, "drive.reference.from_deg", "rad"),
    ({"drive": {**PD, "target_deg": [30.0, 60.0], "rate": 1.0}}, "drive.rate", "kHz"),
    ({"drive": {**PD, "target_deg": [30.0, 60.0], "rate": 0.01}}, "drive.rate", "s"),
    ({"drive": {"kind": "computed_torque", "kp": [4e5, 2e5], "kd": [4e4, 1e4], "target_deg": [30.0, 60.0]}},
     "drive.kp", "1/s²"),
    ({"drive": {"kind": "cascade", "kp": [4e5, 2e5], "kd": [4e4, 1e4], "target_deg": [30.0, 60.0], "rate": 1e3}},
     "drive.kp", "1/s"),
    ({"drive.torque": [9e6, 0.0]}, "drive.torque.boom", "N mm"),
    ({"wrench.times": [0.0, 500.0, 1000.0]}, "wrench.times[2]", "ms"),
    ({"run.tolerance": 1.0}, "run.tolerance", "mm"),
    ({"run.duration": 2000.0}, "run.duration", "ms"),
    ({"initial.joint_deg": [0.52, -1.05]}, "initial.joint_deg", "rad"),
    ({"link.*.flex": "rigid", "sensor": [], "link.boom.hub.mass": 2e6}, "link.boom.hub.mass", "g"),
    ({"link.*.flex": "rigid", "sensor": [], "tip.mass": 2e5}, "tip.mass", "g"),
]  # fmt: skip


@pytest.mark.parametrize(("mistake", "path", "unit"), PLANTED, ids=lambda x: x if isinstance(x, str) else "")
def test_a_hint_names_a_mistaken_value_and_its_likely_unit(mistake: dict[str, Any], path: str, unit: str) -> None:
    (hint,) = hints(CRANE.varied(mistake))
    assert hint.startswith(f"{path} = ")
    assert names_unit(hint, unit), hint
    id = {"rad": "likely-radians", "deg": "likely-degrees"}.get(unit, "likely-unit")
    assert getattr(hint, "id", id) == id
    reviewed(id, hint)


@pytest.mark.parametrize(
    ("area", "i_y", "real"),
    [(0.8, 0.05, True), (0.8, 0.2, True), (0.95, 0.05, True), (0.95, 0.2, False), (1, 0.05, False), (0.8, 1e-7, False)],
)
def test_a_density_is_doubted_unless_its_only_section_is_a_placeholder(area: float, i_y: float, real: bool) -> None:
    """A placeholder has an area of 1, two properties beyond 0.9 m² or 0.1 m⁴, or an impossible shape."""
    section = fl.Section(shape="general", area=area, i_y=i_y, i_z=0.05, torsion=0.05)
    scene = CRANE.varied({"link.boom.section": "profile", "section.profile": section, "material.steel.density": 7.85})
    doubted = [hint for hint in hints(scene) if hint.startswith("material.steel.density = ")]
    assert bool(doubted) == real


def test_a_table_of_negative_torques_in_newton_millimetres_gets_a_hint() -> None:
    (hint,) = hints(
        CRANE.varied({"drive": {"kind": "table", "times": [0.0, 1.0], "torques": [[0.0, 0.0], [-9e6, 0.0]]}})
    )
    path, unit = "drive.torques.boom = ", "N mm"
    assert hint.startswith(path) and names_unit(hint, unit)
    reviewed("likely-unit", hint)


BEAM_OF_BOOM = 7850.0 * math.pi / 4 * (0.12**2 - 0.11**2) * 2.5


@pytest.mark.parametrize(("mistake", "path", "id"), [
    ({"link.boom.end": {"mass": 5.0, "center": [2.5, 0.0, 0.0]}}, "link.boom.end.center", "length-twice"),
    ({"tip.center": [1.8, 0.0, 0.0]}, "tip.center", "length-twice"),
    ({"link.jib.mount.xyz": [2.5, 0.0, 0.0]}, "link.jib.mount.xyz", "length-twice"),
    ({"link.jib.end": {"mass": 200.0, "center": [0.1, 0.0, 0.0]}}, "link.jib.end.mass", "mass-twice"),
    ({"link.boom.hub": {"mass": 1.1 * BEAM_OF_BOOM, "center": [1.3, 0.0, 0.0]}}, "link.boom.hub.mass", "mass-twice"),
    ({"link.boom.flex": "z", "sensor.gauge.fibre": [0.0, 0.06]}, "sensor.gauge.fibre", "no-effect"),
])  # fmt: skip
def test_a_length_or_a_mass_given_twice_and_a_gauge_without_strain_get_a_hint(mistake: Any, path: str, id: str) -> None:
    (hint,) = hints(CRANE.varied(mistake))
    assert hint.startswith(f"{path} = ")
    reviewed(id, hint)


@pytest.mark.parametrize("intended", [
    {"link.boom.end": {"mass": 5.0, "center": [-2.5, 0.0, 0.0]}},
    {"link.jib.end": {"mass": 200.0}},  # elsewhere
    {"link.boom.hub": {"mass": 2 * BEAM_OF_BOOM, "center": [1.25, 0.0, 0.0]}},  # a heavy pipe inside
    {"link.boom.hub": {"mass": BEAM_OF_BOOM, "center": [0.0, 0.0, 0.0]}},  # a motor
    {"sensor.gauge.fibre": [0.0, 0.06]},  # bends in both planes
    {"section.tube.inner": 0.02},
    {"sensor": [{"name": "valve", "kind": "current", "link": "boom", "torque_constant": 400.0}]},
    {"sensor": [{"name": "force", "kind": "joint", "link": "jib", "rate": 100.0}]},
])  # fmt: skip
def test_parts_that_are_alike_by_intention_get_no_hint(intended: dict[str, Any]) -> None:
    assert hints(CRANE.varied(intended)) == ()


def names_unit(hint: str, unit: str) -> bool:
    """Whether a hint names a unit after the value and its path."""
    return re.search(rf"(?<!\S){re.escape(unit)}(?!\w)", hint.partition(": ")[2]) is not None


@pytest.mark.parametrize(("mistake", "path"), [
    ({"link.boom.drag": {"coefficient": 1.2}, "air_density": 1000.0}, "air_density"),
    ({"link.boom.drag": {"coefficient": 1.2, "breadth": [120.0, 120.0]}, "air_density": 1.2}, "link.boom.drag.breadth"),
    ({"tie": [{"name": "gear", "kind": "joint", "link": "jib", "stiffness": 1e4, "play": 2.0}]}, "tie.gear.play"),
])  # fmt: skip
def test_water_a_breadth_in_millimetres_and_a_play_in_degrees_get_a_hint(mistake: dict[str, Any], path: str) -> None:
    (hint,) = hints(CRANE.varied(mistake))
    assert hint.startswith(f"{path} = ")
    reviewed(hint.id, hint)


def test_accelerations_beside_positions_that_stay_get_a_hint() -> None:
    """As an accelerogram of a base is given; integrated, it gets none, nor do coarse columns of a motion."""
    t, size = np.linspace(0, 2, 101), np.radians(2.0)
    whole = {"angle_deg": 89 + np.cos(3 * t), "rate_deg": -3 * np.sin(3 * t), "acceleration_deg": -9 * np.cos(3 * t)}
    record = {"angle_deg": 90 + 0 * t, "rate_deg": 0 * t, "acceleration_deg": size * np.sin(6 * t)}
    moved = {"angle_deg": 90 + size * (t - np.sin(6 * t) / 6) / 6, "rate_deg": size * (1 - np.cos(6 * t)) / 6}
    wrong = ["columns-disagree"]
    for columns, every, expected in ((whole, 1, []), (whole, 25, []), (record, 1, wrong), (record | moved, 1, [])):
        motion = {"link": "boom", "times": t[::every].tolist()}
        motion |= {name: column[::every].tolist() for name, column in columns.items()}
        found = CRANE.varied({"motion": [motion], "drive": None})
        assert [hint.id for hint in hints(found)] == expected
        for hint in hints(found):
            reviewed(hint.id, hint)


@pytest.mark.parametrize(("angle", "rate", "id"), [
    (lambda t: 60 * t**2 * (3 - 2 * t), lambda t: np.radians(360 * t * (1 - t)), "likely-radians"),
    (lambda t: (350 + 30 * t**2) % 360, lambda t: 60 * t, "likely-wrapped"),
    (lambda t: 60 * t**2 * (3 - 2 * t), lambda t: 360 * t * (1 - t), None),
    (lambda t: 20 * t**2, lambda t: 40 * t, None),
])  # fmt: skip
def test_rates_of_a_motion_in_radians_and_angles_that_begin_a_turn_again_get_a_hint(angle, rate, id) -> None:
    t = np.linspace(0, 1, 11)
    motion = {"link": "boom", "times": t.tolist(), "angle_deg": angle(t).tolist(), "rate_deg": rate(t).tolist()}
    motion["acceleration_deg"] = [0.0] * 11
    free = {"initial.joint_deg.boom": motion["angle_deg"][0], "link.boom.joint.limits_deg": [-400.0, 400.0]}
    found = hints(CRANE.varied({"motion": [motion], **free}))
    assert [hint.id for hint in found] == [id] * (id is not None)
    for hint in found:
        reviewed(hint.id, hint)


def test_the_resolution_of_a_joint_sensor_in_degrees_gets_a_hint() -> None:
    encoder = {"name": "encoder", "kind": "joint", "link": "boom"}
    (hint,) = hints(CRANE.varied({"sensor": [{**encoder, "resolution": 0.022}]}))
    assert hint.startswith("sensor.encoder.resolution = ") and names_unit(hint, "deg")
    reviewed("likely-unit", hint)
    for fine in ({"resolution": 1.5e-3}, {"resolution": 0.022, "unit": "deg", "gain": 180 / math.pi}):
        assert hints(CRANE.varied({"sensor": [{**encoder, **fine}]})) == ()


@pytest.mark.parametrize(("effort", "hinted"), [(5.0, True), (3500.0, True), (4000.0, False)])
def test_an_effort_that_does_not_hold_the_arm_gets_a_note(effort: float, hinted: bool) -> None:
    """The drive of the level jib must hold 9.81 m/s² (1.9 m × 200 kg + 0.9 m × 25 kg) = 3.95 kN m."""
    level = CRANE.varied({"initial.joint_deg": [0.0, 0.0], "drive.effort": [1e5, effort], "sensor": []})
    found = [note for note in notes(level) if note.startswith("drive.effort.jib = ")]
    assert len(found) == hinted
    for note in found:
        reviewed("weak-drive", note)


def test_a_sweep_prints_the_hints_on_its_first_and_last_member_once(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("flexlink.cli.sweep.fill", lambda *_: None)  # hints are printed before the run
    CRANE.varied({"run.duration": 0.01}).save(tmp_path / "crane.toml")
    sweep = tmp_path / "sweep.toml"
    sweep.write_text(
        'scene = "crane.toml"\n[set]\nmaterial.steel.loss_time = 0.3\n[grid]\ngravity = [[0, 0, -1], [0, 0, -9.81]]\n'
        'link.boom.damping.ratio = [0.02, 2.0]\n[quantity]\nx = { of = "tip x [m]" }\n',
        encoding="utf-8",
    )
    words = ["sweep", str(sweep), "--out", str(tmp_path / "sweep.db")]
    assert main(words) == 0
    printed = capsys.readouterr().err
    for path in ("material.steel.loss_time = 0.3", "gravity = [0, 0, -1]", "link.boom.damping.ratio = 2"):
        assert line(printed, f"warning: {path}")
    assert main([*words, "--quiet-hints"]) == 0
    assert "likely" not in capsys.readouterr().err


def test_sensible_arms_get_no_hints() -> None:
    hinted = {seed: found for seed in range(200) if (found := hints(sensible_arm(seed)))}
    assert len(hinted) <= 2, hinted


FILES = [path for folder in ("models", "validation/scenes", "docs") for path in sorted((ROOT / folder).rglob("*.toml"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_scenes_of_the_repository_get_no_hints(path: Path) -> None:
    try:
        scene = fl.load_scene(path)
    except fl.errors.SceneError:  # the file describes a sweep
        return
    assert hints(scene) == ()


def test_the_command_line_and_the_run_show_the_hints(tmp_path: Path, capsys: Any) -> None:
    scene = CRANE.varied({"material.steel.loss_time": 0.3, "run.duration": 0.01})
    path = scene.save(tmp_path / "crane.toml")
    (hint,) = hints(scene)
    for command in (["info"], ["simulate"], ["modes"]):
        assert main([*command, str(path)]) == 0
        printed = line(capsys.readouterr().err, "material.steel.loss_time = 0.3 s")
        assert printed == f"warning: {hint}{id_of(hint)}", command
        assert main([*command, str(path), "--quiet-hints"]) == 0
        assert "loss_time" not in capsys.readouterr().err, command
    run = fl.simulate(scene)
    assert run.hints == hints(scene) != ()
    assert re.search(r"\b1\b", repr(run).rpartition(";")[2])
    reviewed("hints: repr of a run", repr(run))


def test_a_hint_is_printed_even_if_the_run_is_refused(tmp_path: Path, capsys: Any) -> None:
    path = "material.steel.density"
    scene = CRANE.varied({path: 7.85, "run.step": 1e-3})
    assert main(["simulate", str(scene.save(tmp_path / "crane.toml"))]) == 2
    (hint,) = hints(scene)
    assert hint.startswith(f"{path} = 7.85 kg/m³")
    assert f"warning: {hint}{id_of(hint)}" in capsys.readouterr().err.splitlines()


def test_a_report_shows_the_hints_and_the_default_settings() -> None:
    scene = CRANE.varied({"material.steel.loss_time": 0.3, "run": {"duration": 1.0}})
    sentences = model.made(Study(scene)).sentences
    (hint,) = hints(scene)
    (shown,) = (text for text in sentences if hint in text)
    reviewed("hints: in a report", shown)
    (defaults,) = (text for text in sentences if "5.87 mm" in text and "auto" in text)
    reviewed("hints: defaults of a run in a report", defaults)


HELD = fl.Joint(locked=True)


BAR = make_scene(flexible("bar", length=2.0), gravity=(0.0, -9.81, 0.0))
CLAMPED = BAR.varied({"link.bar.joint": HELD})
SLIDE = fl.Joint(kind="prismatic", axis=(0.0, 1.0, 0.0))
CAR = fl.Link(name="car", length=2.0, material="aluminium", section="square", joint=SLIDE)
CARRIED = make_scene(CAR, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_m=(0.0,)))
WEIGHT = 2700.0 * 0.04**2 * 2.0 * 9.81
MOMENT = 0.1 * 70e9 * (0.04**4 / 12) / 0.02 - WEIGHT * 1.0  # strain · E I/c, minus the moment of the weight


LIMITS: dict[str, tuple[fl.Scene, Callable[[float], dict[str, Any]]]] = {
    # the strain of a clamped bar is 0.1
    "tip.mass": (CLAMPED, lambda part: {"tip": fl.RigidBody(mass=part * MOMENT / 9.81 / 2.0)}),
    "wrench.force": (CLAMPED, lambda part: {"wrench": fl.Wrench(force=(0.0, part * MOMENT / 2.0, 0.0))}),
    "wrench.moment": (CLAMPED, lambda part: {"wrench": fl.Wrench(moment=(0.0, 0.0, part * MOMENT))}),
    # a point is 3 times the reach away, a radius of gyration is the reach, a root or gear spring bends by 0.5 rad
    "tip.center": (BAR, lambda part: {"tip": fl.RigidBody(mass=1e-6, center=(0.0, 6.0 * part, 0.0))}),
    "tip.inertia": (BAR, lambda part: {"tip": fl.RigidBody(mass=1.0, inertia=(3.0 * (3.0 * part**2),) * 3)}),
    "link.bar.root_stiffness.z": (
        CLAMPED, lambda part: {"link.bar.root_stiffness": fl.details.RootStiffness(z=WEIGHT / (0.5 * part))}),
    "link.bar.joint.gear_stiffness": (
        BAR, lambda part: {"link.bar.joint": fl.Joint(gear_stiffness=WEIGHT / (0.5 * part), armature=0.01)}),
    "drive.torque.bar": (
        BAR, lambda part: {"drive": fl.Drive(kind="constant", torque=(300.0 * WEIGHT * part,))}),
    # the weight stretches a spring by 0.5 m
    "link.car.joint.gear_stiffness": (
        CARRIED, lambda part: {f"link.car.joint.{key}": value
                               for key, value in {"gear_stiffness": WEIGHT / (0.5 * part), "armature": 1.0}.items()}),
}  # fmt: skip


@pytest.mark.parametrize("key", LIMITS)
def test_a_value_beyond_its_limit_has_a_hint(key: str) -> None:
    scene, change = LIMITS[key]
    below, above = (
        [hint for hint in hints(scene.varied(change(part))) if hint.startswith(f"{key} = ")] for part in (0.99, 1.01)
    )
    assert not below
    (hint,) = above
    reviewed(hint.id, hint)


@pytest.mark.parametrize(
    ("angle", "radians"),
    [*((one, True) for one in (1.5708, 1.57, 0.524, 3.1416)), *((one, False) for one in (1.6, 0.528, 0.53, 2))],
)
def test_an_angle_with_the_digits_of_a_round_angle_in_radians_has_a_hint(angle: float, radians: bool) -> None:
    """The number is a multiple of 5° in radians, rounded to its decimals; with two decimals, only 90° has a hint."""
    scene = make_scene(flexible("a"), gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(angle,)))
    found = [hint for hint in hints(scene) if hint.id == "likely-radians"]
    assert len(found) == radians
    for hint in found:
        reviewed(hint.id, hint)


@pytest.mark.parametrize(("length", "side", "key"), [(30.0, 5e-3, "link.bar.length"), (0.03, 0.04, "section.square.")])
def test_a_link_too_slender_or_too_short_for_a_beam_has_a_hint(length: float, side: float, key: str) -> None:
    """If L/h = 6000, the length is probably wrong; if the link is wider than long, the section is probably wrong."""
    section = fl.Section(shape="rectangle", height=side, width=side)
    scene = make_scene(flexible("bar", length=length), gravity=(0.0, 0.0, 0.0)).varied({"section.square": section})
    (hint,) = hints(scene)
    assert hint.startswith(key)
    assert f" {length / side:.2g} " in hint
    reviewed("likely-unit", hint)


assert ALUMINIUM.young == 70e9
assert SQUARE.properties.i_z == pytest.approx(0.04**4 / 12)
