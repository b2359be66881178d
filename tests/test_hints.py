"""Values in a wrong unit, off by powers of ten, get a hint with the likely unit; sensible arms get none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from sensible import sensible_arm

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.wording import id_of
from flexlink.describe.plausibility.hints import hints
from flexlink.scene_report.parts import model
from flexlink.scene_report.study import Study
from tests.words import line, reviewed

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
    ({"link.boom.length": 2500.0}, "link.boom.length", "mm"),
    ({"section.tube": {"shape": "tube", "outer": 120.0, "inner": 110.0}}, "section.tube.outer", "mm"),
    ({"section.tube": {"shape": "circle", "diameter": 12.0}}, "section.tube.diameter", "mm"),
    ({"section.tube": {"shape": "tube", "outer": 3.0, "inner": 2.8}}, "section.tube.outer", "mm"),
    ({"section.profile.area": 1800.0}, "section.profile.area", "mm²"),
    ({"section.profile.i_y": 3e6}, "section.profile.i_y", "mm⁴"),
    ({"gravity": [0.0, 0.0, -9810.0]}, "gravity", "mm/s²"),
    ({"gravity": [0.0, 0.0, -1.0]}, "gravity", "g"),
    ({"sensor.gauge.fibre": [60.0, 0.0]}, "sensor.gauge.fibre", "mm"),
    ({"sensor.gauge.delay": 2.0}, "sensor.gauge.delay", "ms"),
    ({"tip.mass": 200e3}, "tip.mass", "g"),
    ({"tip.center": [150.0, 0.0, 0.0]}, "tip.center", "mm"),
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
    ({"drive": {**PD, "target_deg": [30.0, 60.0], "rate": 1.0}}, "drive.rate", "kHz"),
    ({"drive.torque": [9e6, 0.0]}, "drive.torque.boom", "N mm"),
    ({"wrench.times": [0.0, 500.0, 1000.0]}, "wrench.times[2]", "ms"),
    ({"run.tolerance": 1.0}, "run.tolerance", "mm"),
]  # fmt: skip


@pytest.mark.parametrize(("mistake", "path", "unit"), PLANTED, ids=lambda x: x if isinstance(x, str) else "")
def test_a_hint_names_a_mistaken_value_and_its_likely_unit(mistake: dict[str, Any], path: str, unit: str) -> None:
    (hint,) = hints(CRANE.varied(mistake))
    assert hint.startswith(f"{path} = ")
    assert names_unit(hint, unit), hint
    id = {"rad": "likely-radians", "deg": "likely-degrees"}.get(unit, "likely-unit")
    assert getattr(hint, "id", id) == id
    reviewed(id, hint)


def names_unit(hint: str, unit: str) -> bool:
    """Whether a hint names a unit after the value and its path."""
    return re.search(rf"(?<!\S){re.escape(unit)}(?!\w)", hint.partition(": ")[2]) is not None


def test_all_lengths_in_millimetres_get_a_hint_each() -> None:
    mm = {
        "link.boom.length": 2500.0, "link.jib.length": 1800.0, "link.jib.mount.xyz": [50.0, 0.0, 0.0],
        "section.tube": {"shape": "tube", "outer": 120.0, "inner": 110.0},
        "section.profile": {"shape": "general", "area": 1800.0, "i_y": 3e6, "i_z": 3e6, "torsion": 6e6},
    }  # fmt: skip
    found = {hint.partition(" = ")[0]: hint for hint in hints(CRANE.varied(mm))}
    units = {
        "link.boom.length": "mm",
        "link.jib.length": "mm",
        "section.tube.outer": "mm",
        "section.profile.area": "mm²",
        **dict.fromkeys((f"section.profile.{key}" for key in ("i_y", "i_z", "torsion")), "mm⁴"),
    }
    assert units.keys() <= found.keys()
    assert {path: found[path] for path, unit in units.items() if not names_unit(found[path], unit)} == {}


def test_the_right_value_is_in_the_hint() -> None:
    (hint,) = hints(CRANE.varied({"material.steel.young": 210.0}))
    assert re.findall(r"\d\S* Pa", hint) == ["210 Pa", "1e6 Pa", "2.1e11 Pa", "1.2e12 Pa", "2.1e+11 Pa"]


def test_sensible_arms_get_no_hints() -> None:
    hinted = {seed: found for seed in range(200) if (found := hints(sensible_arm(seed)))}
    assert len(hinted) <= 2, hinted


FILES = [path for folder in ("models", "validation/scenes", "docs") for path in sorted((ROOT / folder).rglob("*.toml"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_scenes_of_the_repository_get_no_hints(path: Path) -> None:
    try:
        scene = fl.load_scene(path)
    except fl.errors.SceneError:  # a sweep
        return
    assert hints(scene) == ()


def test_the_command_line_and_the_result_have_the_hints(tmp_path: Path, capsys: Any) -> None:
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


def test_a_report_has_the_hints_and_the_defaults_of_the_run() -> None:
    scene = CRANE.varied({"material.steel.loss_time": 0.3, "run": {"duration": 1.0}})
    sentences = model.made(Study(scene)).sentences
    (hint,) = hints(scene)
    (shown,) = (text for text in sentences if hint in text)
    reviewed("hints: in a report", shown)
    (defaults,) = (text for text in sentences if "5.87 mm" in text and "auto" in text)
    reviewed("hints: defaults of a run in a report", defaults)
