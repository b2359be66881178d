"""Scene files are checked strictly: one line names the place of a mistake, the value, and the allowed values."""

import os
from pathlib import Path

import numpy as np
import pytest

from flexlink import Arm, Joint, Link, RunSettings, Section, load_scene, lump, simulate
from flexlink.describe import data_files
from flexlink.describe.numbers import whole
from flexlink.errors import SceneError
from tests.conftest import ALUMINIUM, ROOT, SQUARE, flexible, make_scene
from tests.support.words import refused

PAPER = (ROOT / "models" / "paper_fig5.toml").read_text(encoding="utf-8")

BAD = {  # text of the good scene, its replacement, the id of the error, and parts of the message: names and values
    "unknown key": ("young   =", "yung =", "unknown-key", ["material.aluminium.yung", "'young'?"]),
    "unknown table": ("[initial]", "[initil]", "unknown-key", ["initil", "initial"]),
    "nested unknown key": ("locked =", "loked =", "unknown-key", ["link.waist.joint.loked", "'locked'?"]),
    "wrong type": ("length   = 1.25", 'length = "long"', "wrong-value", ["link.upper.length", "'long'"]),
    "missing key": ('name    = "paper_fig5"', "", "missing-key", ["name"]),
    "missing material": (
        '"aluminium"\nsection', '"steel"\nsection',
        "unknown-name", ["link.upper.material", "'steel'", "aluminium"],
    ),
    "missing section": (
        'section  = "square"', 'section = "round"',
        "unknown-name", ["link.upper.section", "'round'", "square"],
    ),
    "negative length": ("length   = 1.25", "length = -1.25", "wrong-value", ["link.upper.length", "-1.25", ">= 0"]),
    "zero length": ("length   = 1.25", "length = 0.0", "needs-a-length", ["link.upper.length", "0.0", "> 0"]),
    "negative young": (
        "young   = 70e9", "young = -70e9",
        "wrong-value", ["material.aluminium.young", "-70000000000.0", "> 0"],
    ),
    "zero density": ("density = 2700.0", "density = 0", "wrong-value", ["material.aluminium.density", "0", "> 0"]),
    "zero step": ("step     = 1e-4", "step = 0.0", "wrong-value", ["run.step", "0.0", "> 0"]),
    "negative payload": ("[initial]", "[tip]\nmass = -1.0\n[initial]", "wrong-value", ["tip.mass", "-1.0", ">= 0"]),
    "key of an optional table": (
        "[initial]", "[link.damping]\nratio = 0.1\nat_Hz = 4\n[initial]",
        "unknown-key", ["link.fore.damping.at_Hz = 4", "'at_hz'?"],
    ),
    "torque on a locked joint": (
        "[initial]", "[drive]\nkind = 'constant'\ntorque = [5.0, 0.0, 0.0]\n[initial]",
        "locked-and-moving", ["drive.torque.waist", "5.0", "'waist'"],
    ),
    "gain on a locked joint": (
        "[initial]", "[drive]\nkind = 'pd'\nkp = [1, 1, 1]\nkd = [0, 0, 0]\ntarget_deg = [9, 0, 0]\n[initial]",
        "locked-and-moving", ["drive.kp.waist", "1.0", "'waist'"],
    ),
    "drive incomplete": (
        "[initial]", "[drive]\nkind = 'constant'\n[initial]",
        "missing-key", ["drive.torque: missing; "],
    ),
    "nan": ("young   = 70e9", "young = nan", "not-finite", ["material.aluminium.young", "nan"]),
    "infinity": ("9.81", "inf", "not-finite", ["gravity[2]", "inf"]),
    "one segment": ("segments = 5", "segments = 1", "too-few-segments", ["link.upper.segments", "1", "2"]),
    "fractional segments": ("segments = 5", "segments = 4.5", "wrong-value", ["link.upper.segments", "4.5"]),
    "unknown flex": ('flex     = "z"', 'flex = "w"', "wrong-value", ["link.upper.flex", "'w'", "'xyz'"]),
    "flex misspelt": ('flex     = "z"', 'flex = "xzy"', "wrong-value", ["link.upper.flex", "'xzy'", "'xyz'", "twist"]),
    "shape misspelt": ('"rectangle"', '"rectangel"', "wrong-value", ["section.square.shape", "'rectangle'?"]),
    "material misspelt": (
        '"aluminium"\nsection', '"aluminum"\nsection',
        "unknown-name", ["link.upper.material", "'aluminium'?"],
    ),
    "section misspelt": (
        'section  = "square"', 'section = "Square"',
        "unknown-name", ["link.upper.section", "'square'?"],
    ),
    "rule misspelt": ('lumping  = "paper"', 'lumping = "papr"', "unknown-name", ["link.upper.lumping", "'paper'?"]),
    "rule in capitals": ('lumping  = "paper"', 'lumping = "PAPER"', "unknown-name", ["link.upper.lumping", "'paper'?"]),
    "method misspelt": ('"RK4"', '"rk4"', "unknown-name", ["run.method", "'rk4'", "'RK4'?"]),
    "solver misspelt": ('"RK4"', '"RK4"\nsolver = "articulate"', "wrong-value", ["run.solver", "'articulated'?"]),
    "link misspelt": (
        "[initial]", "[[motion]]\nlink = 'uper'\ntimes = [0]\nangle_deg = [0]\nrate_deg = [0]\n"
        "acceleration_deg = [0]\n[initial]",
        "unknown-link", ["motion.uper.link", "'uper'", "'upper'?"],
    ),
    "unknown rule": (
        '"paper"\n\n[[link]]\nname     = "fore"', '"papr"\n[[link]]\nname = "fore"',
        "unknown-name", ["link.upper.lumping", "'papr'", "midpoint"],
    ),
    "rule does not fit": (
        'segments = 5\nflex     = "z"\nlumping  = "paper"', 'segments = 4\nflex = "z"\nlumping = "gauss"',
        "hinges-of-rule", ["link.upper.segments", "= 4", " 3 ", "'gauss'", " 2 ", "3 or 5"],
    ),
    "rule of at least": (
        'segments = 5\nflex     = "z"\nlumping  = "paper"', 'segments = 3\nflex = "z"\nlumping = "gregory"',
        "segments-of-rule", ["link.upper.segments", "= 3", " 2 ", "'gregory'", " 7 "],
    ),
    "too many nodes to find": (
        'segments = 5\nflex     = "z"\nlumping  = "paper"', 'segments = 100001\nflex = "z"\nlumping = "legendre"',
        "segments-of-rule", ["link.upper.segments", "'legendre'", " 1001 "],
    ),
    "section beyond float64": ("width  = 0.04", "width = 1e308", "overflow", ["section.square.height", "1e+308: "]),
    "section below float64": ("width  = 0.04", "width = 1e-200", "overflow", ["section.square.height", "i_y"]),
    "sample no multiple": (
        "sample   = 0.005", "sample = 0.00123",
        "not-a-multiple", ["run.sample", "0.00123", "step = "],
    ),
    "step no divisor": ("step     = 1e-4", "step = 3e-4", "not-a-multiple", ["run.sample", "0.005", "step = "]),
    "joints too few": ("[0.0, -80.0, -10.0]", "[0.0, -80.0]", "one-per-link", ["initial.joint_deg", "3"]),
    "unknown method": ('"RK4"', '"RK5"', "unknown-name", ["run.method", "'RK5'", "RK2"]),
    "two names": ('name     = "fore"', 'name = "upper"', "name-twice", ["link.3.name", "'upper'"]),
    "gravity of two": ("[0.0, 0.0, 9.81]", "[0.0, 9.81]", "wrong-value", ["gravity", "[m/s²]", "2"]),
    "property of a material in a link": (
        'name     = "fore"', 'name = "fore"\nyoung = 2e11', "unknown-key", ["link.fore.young", "[material.NAME]"],
    ),
    "payload below another table": ("[run]", "[run]\ntip.mass = 2.0", "unknown-key", ["run.tip", "a separate table"]),
    "a flexible link without its section": (
        'section  = "square"', "", "missing-key", ["link.upper.section", "material", "flexible"],
    ),
    "forces without directions": (
        "[initial]", "[wrench]\ntimes = [0.0, 1.0]\nforces = [0, -50]\n[initial]",
        "wrong-value", ["wrench.forces[0]", "[N]"],
    ),
    "wall of a tube": ("width  = 0.04", "thickness = 0.04", "unknown-key", ["section.square.thickness", "outer"]),
    "integral term": (
        "[initial]", "[drive]\nkind = 'pid'\n[initial]", "wrong-value", ["drive.kind", "'pd'", "control=law"],
    ),
    "rates under another name": (
        "joint_deg = [", "joint_rate_deg = [0.0]\njoint_deg = [", "unknown-key", ["initial.joint_rate_deg", "rate_deg"],
    ),
    "section instead of its name": (
        'section  = "square"', "section = { diameter = 0.1 }", "wrong-value", ["link.upper.section", "[section.NAME]"],
    ),
    "stiffness of which axis": (
        'name     = "fore"', 'name = "fore"\nroot_stiffness = 350.0',
        "wrong-value", ["link.fore.root_stiffness", "z = "],
    ),
    "section incomplete": ("width  = 0.04", "", "missing-key", ["section.square.width", "rectangle"]),
    "section of another shape": (
        "width  = 0.04", "diameter = 1.0",
        "key-of-another-kind", ["section.square.diameter", "height, width"],
    ),
    "poisson": ("poisson = 0.33", "poisson = 0.6", "wrong-value", ["material.aluminium.poisson", "0.6", "0.5"]),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_a_bad_scene_is_refused_in_one_line_that_helps(what: str, tmp_path: Path) -> None:
    old, new, id, parts = BAD[what]
    assert old in PAPER
    path = tmp_path / "scene.toml"
    path.write_text(PAPER.replace(old, new, 1), encoding="utf-8")
    with refused(SceneError, id) as caught:
        load_scene(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: {parts[0]}")
    assert [part for part in parts if part not in message] == []
    assert "\n" not in message


NO_SCENES = {
    "file-empty": [b"", b"  \n\n"],
    "not-toml": [
        b"name = ", b"{ json: true }", b"name = crane", "name = “crane”".encode(), b"tip.center = 0, 0, 1",
        b"x = { young = 210e9 Pa, density = 7850 }", b"x = { young = 2,1e11 }",
        b"x = { young = 2.1e11, density = 7850 ]", b"x = { young = 2.1e11\n density = 7850 }",
        b"x = { young = 2.1e11 density = 7850 }", b"tip.mass = 1\ntip.mass = 2\nname = 1",
        b"[link]\nname = 1\n[link]\nname = 2", b"[link]\nname = 1\n[[link]]\nname = 2", b"locked = True", b"length 5",
        b'length = 4.0 // m', b'{\n"name": "crane"\n}', b"joint_deg = [20; -40]", b"axis = (0, -1, 0)",
        b"young = 210*1e9", b"joint = {\n axis = [0, -1, 0],\n}", b"tip = { mass = 1, }",
        b"link = [\n { name = 'a',\n }]", b"import flexlink as fl", b"t [s],q boom [deg]\n0,1\n",
    ],
    "is-no-scene": [b"scene = 'arm.toml'\ngrid.x = [1, 2]", b"scene = 'arm.toml'\nparameter = []"],
    "not-utf8": [b"name = '\xff\xfe'", "name = 1".encode("utf-16"), b"PK\x03\x04\xff[Content_Types].xml", b"\x1f\x8b"],
    "file-too-large": [b"#" * 1_000_001],
}  # fmt: skip


@pytest.mark.parametrize("id", NO_SCENES)
def test_files_that_are_not_scenes_are_refused(id: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    for content in NO_SCENES[id]:
        path.write_bytes(content)
        with refused(SceneError, id):
            load_scene(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.toml", tmp_path):
        with refused(SceneError, "cannot-read"):
            load_scene(path)


def test_a_byte_order_mark_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(PAPER, encoding="utf-8-sig")
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    without = ROOT / "models" / "paper_fig5.toml"
    assert load_scene(path) == load_scene(without)


def one_hinge_rule(node: float) -> str:
    return f'about = "a"\nsource = "b"\n[element]\nnodes = [{node}]\nweights = [1.0]\n'


@pytest.mark.parametrize("beside", [1e20, 1e300])
def test_a_rule_with_hinges_closer_than_float64_resolves_is_refused(beside: float, tmp_path: Path) -> None:
    rule = tmp_path / "rule.toml"
    rule.write_text(f'about = "a"\nsource = "b"\n[grid]\nfirst = {beside}\nlast = {beside}\n', encoding="utf-8")
    with refused(SceneError, "rule-resolution"):
        lump(make_scene(flexible("a", segments=4, lumping=str(rule))))


def test_a_scene_with_its_own_rule_and_method_reads_back_from_any_folder(tmp_path: Path, monkeypatch) -> None:
    folder = tmp_path / "sub"
    folder.mkdir()
    (folder / "rule.toml").write_text(one_hinge_rule(0.5), encoding="utf-8")
    (folder / "own.toml").write_text(
        (ROOT / "flexlink" / "describe" / "data" / "methods" / "RK4.toml").read_text("utf-8"), "utf-8"
    )
    text = PAPER.replace('"paper"\n\n', '"rule.toml"\n\n').replace('"RK4"', '"own.toml"')
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    scene = load_scene("sub/scene.toml")
    for copy in (folder / "copy.toml", tmp_path / "copy.toml"):
        copy.write_text(scene.to_toml(), encoding="utf-8")
        assert load_scene(copy) == scene
    monkeypatch.chdir(ROOT)
    np.testing.assert_array_equal(lump(scene).stiffness, lump(load_scene(folder / "copy.toml")).stiffness)


def test_a_rule_path_in_python_is_relative_to_the_folder_at_that_time(tmp_path: Path, monkeypatch) -> None:
    links = []
    for folder, node in (("a", 0.25), ("b", 0.75)):
        (tmp_path / folder).mkdir()
        monkeypatch.chdir(tmp_path / folder)
        Path("rule.toml").write_text(one_hinge_rule(node), encoding="utf-8")
        os.utime("rule.toml", ns=(0, 0))  # a file of the same name, time and size
        links.append(flexible("link", segments=2, lumping="rule.toml"))
    monkeypatch.chdir(tmp_path)
    placed = [lump(make_scene(link)).bodies["translation"][1, 0] for link in links]
    assert placed == [0.25 * 1.25, 0.75 * 1.25]


def test_the_chain_of_a_scene_follows_its_rule_when_the_file_changes(tmp_path: Path) -> None:
    rule, placed = tmp_path / "rule.toml", []
    rule.write_text(one_hinge_rule(0.25), encoding="utf-8")
    scene = make_scene(flexible("link", segments=2, lumping=str(rule)))
    for node in (0.25, 0.125):
        rule.write_text(one_hinge_rule(node), encoding="utf-8")
        placed.append(lump(scene).bodies["translation"][1, 0])
    assert placed == [0.25 * 1.25, 0.125 * 1.25]


def test_python_objects_are_checked_like_files() -> None:
    with refused(SceneError, "wrong-value"):
        Link(name="a", length=-1.0)
    with refused(SceneError, "needs-a-length"):
        Link(name="a", material="aluminium", section="square")
    with refused(SceneError, "not-finite"):
        Joint(armature=float("nan"))
    with refused(SceneError, "unknown-name"):
        Arm(links=(flexible("a", material="steel"),), materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE})
    with refused(SceneError, "nothing-to-move"):
        lump(make_scene(Link(name="a", joint=Joint(locked=True))))
    with refused(SceneError, "section-walls"):
        Section(shape="tube", outer=0.1, inner=0.2)


@pytest.mark.parametrize("path", sorted((ROOT / "models").glob("*.toml")), ids=lambda path: path.stem)
def test_equal_scenes_have_equal_hashes(path: Path) -> None:
    scene, same = load_scene(path), load_scene(path)
    assert {scene: "found"}[same] == "found"
    reordered = scene.varied({"section": dict(reversed(scene.arm.sections.items()))}) if scene.arm.sections else same
    assert (reordered == scene, hash(reordered)) == (True, hash(scene))
    assert scene.varied({"gravity": (0.0, 1.0, 0.0)}) not in {scene}


def test_a_description_is_built_without_reading_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rule and method files are read by the chain and the run, not by the scene."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a file was read")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", refuse)
        patched.setattr(data_files, "load", refuse)
        scene = make_scene(flexible("a", lumping="papr"), run=RunSettings(method="RK5"))
        scene.to_toml()
    with refused(SceneError, "unknown-name"):
        lump(scene)
    with refused(SceneError, "unknown-name"):
        simulate(make_scene(flexible("a"), run=RunSettings(method="RK5")))


@pytest.mark.parametrize(("value", "unit"), [(0.005, 1e-4), (5.0, 0.005), (0.3, 0.1), (0.0, 1.0), (1e9, 1e-6)])
def test_decimal_multiples_count_as_multiples(value: float, unit: float) -> None:
    whole("a", value, "b", unit)


@pytest.mark.parametrize(
    ("value", "unit"),
    [(1.0, 0.3), (0.1, 0.2), (1e300, 1e-300), (1e-12, 1.0), (1.0005, 1.0), (1 + 2e-9, 1.0), (1000.000002, 1.0)],
)
def test_other_ratios_are_refused(value: float, unit: float) -> None:
    with refused(SceneError, "not-a-multiple"):
        whole("a", value, "b", unit)
