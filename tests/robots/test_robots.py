"""The arms of models/robots: their import from the files of the robots, and the commands for it."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import MissingDependencyError
from flexlink.robots.collection import PACKAGE, folder, import_known, known_arms
from tests.conftest import ROOT
from tests.support.urdf_texts import RandomRobot, saved
from tests.support.words import refused_line, reviewed
from validation.case import load_case

SCENES = sorted((ROOT / "models" / "robots").glob("*.toml"))
ARMS = list(known_arms())


def installed() -> bool:
    try:
        return bool(importlib.metadata.version(PACKAGE))
    except importlib.metadata.PackageNotFoundError:
        return False


with_files = pytest.mark.skipif(not installed(), reason=f"needs {PACKAGE}, extra robots")


def flat(value: object, path: str = "") -> dict[str, object]:
    """All numbers and texts of a document by path."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if items is None:
        return {path: value}
    return {key: leaf for name, item in items for key, leaf in flat(item, f"{path}.{name}").items()}


def test_every_arm_of_the_table_has_its_scene_and_is_validated() -> None:
    assert sorted(ARMS) == [path.stem for path in SCENES]
    assert len([name for name in ARMS if not name.endswith("_flexible")]) >= 25
    case = load_case(ROOT / "validation" / "cases" / "robots_all.toml")
    assert sorted(case.scenes) == [f"robots/{path.stem}" for path in SCENES]


@with_files
@pytest.mark.parametrize("name", ARMS)
def test_a_stored_scene_equals_the_result_of_its_import(name: str) -> None:
    """The scenes agree up to rounding that differs between machines: a modulus is computed from an eigenvalue."""
    stored = flat(fl.load_scene(ROOT / "models" / "robots" / f"{name}.toml").document())
    made = flat(import_known(name).scene.document())
    assert stored.keys() == made.keys()
    for key, value in stored.items():
        assert made[key] == (pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value), key


@pytest.mark.parametrize("path", SCENES, ids=[path.stem for path in SCENES])
def test_every_stored_arm_can_move(path: Path) -> None:
    scene = fl.load_scene(path)
    chain = fl.lump(scene)
    q, qd = fl.initial_state(scene, chain)
    assert np.linalg.eigvalsh(fl.mass_matrix(chain, q))[0] > 0
    assert np.isfinite(fl.forward_dynamics(chain, q, qd, np.zeros(chain.n))).all()


def test_the_import_command_accepts_degrees_metres_and_beams(tmp_path: Path, capsys) -> None:
    urdf, out = tmp_path / "robot.urdf", tmp_path / "arm.toml"
    urdf.write_text(RandomRobot(0).text(), encoding="utf-8")
    beam = "p3={ frequency_hz = 12, line = [[0, 0, 0], [0.1, 0.1, 0.2]], segments = 7 }"
    words = ["import", str(urdf), "--base", "p1", "--tip", "p8", "--posture", "j3=90", "--locked", "j4=0.2", "--locked"]
    words += ["j7=-30", "--armature", "j5=0.1", "--flexible", beam, "--set", "run.duration=2.0", "-o", str(out)]
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(out)
    scene = fl.load_scene(out)
    p3, p5 = scene.arm.links[0], scene.arm.links[1]
    assert (p3.segments, p5.joint.armature, scene.run.duration) == (7, 0.1, 2.0)
    assert scene.initial.joint_deg[0] == 90.0
    flexible = {"p3": fl.FlexibleLink(frequency_hz=12.0, line=((0, 0, 0), (0.1, 0.1, 0.2)), segments=7)}
    same = fl.import_urdf(
        urdf, base="p1", tip="p8", posture={"j3": np.pi / 2}, locked={"j4": 0.2, "j7": np.radians(-30.0)},
        armature={"j5": 0.1}, flexible=flexible,
    )  # fmt: skip
    assert scene == same.scene.varied({"run.duration": 2.0})


@pytest.mark.parametrize(
    ("words", "id", "part"),
    [
        (["--posture", "j3"], "option-value", "--posture j3: "),
        (["--posture", "j3=left"], "option-value", "--posture j3=left: "),
        (["--posture", "j3=400"], "out-of-range", "'j3' = 6.981317007977318 rad (400°): "),
        (["--base", ""], "unknown-name", "base = '': "),
        (["--locked", "j4=[1"], "option-value", "--locked j4=[1: "),
        (["--flexible", "p3=12"], "wrong-value", "flexible.p3 = 12: "),
        (["--flexible", "p3={ frequency = 12 }"], "unknown-key", "flexible.p3.frequency = 12: "),
        (["--flexible", "p3={ segments = 5 }"], "missing-key", "flexible.p3.section: "),
        (["--armature", "j3=much"], "out-of-range", "'j3' = 'much': "),
        (["-o", "/no/where.toml"], "no-such-folder", "/no"),
    ],
)
def test_wrong_options_are_refused_in_one_line(words: list[str], id: str, part: str, tmp_path: Path, capsys) -> None:
    urdf = saved(tmp_path, RandomRobot(0).text())
    assert main(["import", str(urdf), "--tip", "p8", "--locked", "j4=0", *words]) == 2
    printed = capsys.readouterr().err
    assert len(printed.splitlines()) == 1
    assert part in refused_line(printed, id)


@pytest.mark.slow
@with_files
def test_robots_are_listed_with_joints_mass_and_file(tmp_path: Path, capsys) -> None:
    assert main(["robots", "--out", str(tmp_path)]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split()[:5] == ["name", "joints", "mass", "[kg]", "file"]
    reviewed("robots: head of the list", head)
    name, joints, mass, file = lines[ARMS.index("ur5")].split(maxsplit=3)
    assert (name, joints, mass) == ("ur5", "6", "16.99")
    assert Path(file).name == f"{name}_robot.urdf"
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(ARMS)


def test_missing_robots_are_reported_with_the_command_that_installs_them(monkeypatch, capsys) -> None:
    def missing(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    folder.cache_clear()
    assert main(["import", "ur5"]) == 2
    assert "'flexlink[robots]'" in refused_line(capsys.readouterr().err, "package-missing")
    with pytest.raises(MissingDependencyError):
        import_known("panda")
