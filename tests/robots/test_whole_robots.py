"""Complete robots: every revolute or prismatic joint of an imported robot moves as in the robot's file."""

import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.describe.scene import scene_from
from flexlink.dynamics.rounding import in_units, of_bias_torque, of_mass_matrix
from flexlink.formats import read_sdf, read_urdf
from flexlink.robots.collection import folder
from flexlink.robots.importing import ImportResult
from flexlink.robots.robot_file import read_robot
from tests.robots.test_robots import installed, with_files
from tests.support.urdf_texts import RandomRobot, named_tree, saved
from tests.support.words import line, refused, refused_line, reviewed
from validation.physics.source_urdf import Original

FILES = sorted(file.relative_to(folder()).as_posix() for file in folder().rglob("*.urdf")) if installed() else []
QUICK = ["panda_description/urdf/panda.urdf", "baxter_description/urdf/baxter.urdf"]
NO_ROBOTS = {
    "hector_description/robots/quadrotor_base.urdf": "no-movable-joint",
    "iris_description/robots/iris_simple.urdf": "no-movable-joint",
    "ur_description/urdf/ur3.urdf": "no-link",
    "alex_description/urdf/alex_psyonic_hands.urdf": "mimic",
}
"""Files of example-robot-data without joints or links, or with an invalid leader: id of the error."""
FLOATING = [
    f"{name}.urdf"
    for name in (
        "a1_description/urdf/a1", "anymal_b_simple_description/robots/anymal-kinova", "b1_description/urdf/b1-z1",
        "bolt_description/robots/bolt", "borinot_description/urdf/borinot_flying_arm_2",
        "g1_description/urdf/g1_29dof_rev_1_0", "hextilt_description/urdf/hextilt_flying_arm_5",
        "icub_description/robots/icub", "simple_humanoid_description/urdf/simple_humanoid",
        "solo_description/robots/solo12", "talos_data/robots/talos_full_v2",
    )
]  # fmt: skip
"""Robots that walk or fly."""
FREE = ["j1", "j3", "j4", "j5", "j7", "j8", *(f"b{k}" for k in range(1, 10))]
"""Joints of a random robot that move; j4 slides, and d1 … d9 follow b1 … b9."""


@pytest.fixture
def random_robot(tmp_path: Path) -> tuple[RandomRobot, Path]:
    described, path = RandomRobot(5), tmp_path / "random.urdf"
    path.write_text(described.text(), encoding="utf-8")
    return described, path


def written(tmp_path: Path, *joints: str, masses: dict[str, float] | None = None) -> Path:
    """Write a robot with joints "name kind parent child …", whose links are balls of 1 kg unless stated."""
    words = [joint.split(maxsplit=4) for joint in joints]
    links = dict.fromkeys(link for _, _, parent, child, *_ in words for link in (parent, child))
    text = ""
    for link in links:
        mass = (masses or {}).get(link, 1.0)
        inertia = "".join(
            f'i{axes}="{0.01 * mass * (axes[0] == axes[1])}" ' for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        body = f'<inertial><mass value="{mass}"/><inertia {inertia}/></inertial>' if mass else ""
        text += f'<link name="{link}">{body}</link>'
    for name, kind, parent, child, *more in words:
        limit = '<limit lower="-1" upper="2" effort="1" velocity="1"/>' if kind in {"revolute", "prismatic"} else ""
        text += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        text += f'<origin xyz="0.1 0 0.2"/>{limit}{"".join(more)}</joint>'
    path = saved(tmp_path, f'<robot name="robot">{text}</robot>')
    return path


def original(path: Path, found: ImportResult) -> Original:
    joints = [part.joint.name for part in found.path.parts]
    free = found.scene.arm.base.free
    return Original(path, joints, found.path.positions, np.array(found.scene.gravity), free_base=free)


def check_against_file(path: Path, *, states: int) -> None:
    """Check M to 1e-14 and T_GC to 1e-13 of the largest value, also relative to the body that each joint moves.

    For a finger of 1.5 cm at 1.5 m from frame 0, positions are rounded to 100 eps of its length, so M to 3e-14.
    """
    found = fl.import_urdf(path)
    chain, theirs, random = fl.lump(found.scene), original(path, found), np.random.default_rng(0)
    for _ in range(states):
        q, qd = random.uniform(-3, 3, chain.n), random.uniform(-10, 10, chain.n)
        M, T, size = theirs.mass_matrix(q), theirs.bias_torque(q, qd), theirs.sizes(q)
        ΔM, ΔT = fl.mass_matrix(chain, q) - M, fl.bias_torque(chain, q, qd) - T
        assert np.abs(ΔM).max() <= 1e-14 * np.abs(M).max()
        assert np.abs(ΔM / np.outer(size, size)).max() <= 3e-14
        assert np.abs(ΔT).max() <= 1e-13 * np.abs(T).max()
        assert np.abs(ΔT / size).max() <= 1e-13 * np.abs(T / size).max()


def check_free_base_against_file(path: Path) -> None:
    """The base moves without spin, because with spin v̇ of Pinocchio's free flyer is a different acceleration."""
    found = fl.import_urdf(path, free_base=True)
    chain, theirs, random = fl.lump(found.scene), original(path, found), np.random.default_rng(6)
    for _ in range(3):
        q, qd = np.append(np.zeros(6), random.uniform(-3, 3, chain.n - 6)), random.uniform(-10, 10, chain.n)
        qd[3:6] = 0.0
        M, T = theirs.mass_matrix(q), theirs.bias_torque(q, qd)
        assert fl.mass_matrix(chain, q) == pytest.approx(M, rel=0, abs=1e-14 * np.abs(M).max())
        assert fl.bias_torque(chain, q, qd) == pytest.approx(T, rel=0, abs=1e-13 * np.abs(T).max())


def test_the_list_contains_forty_robots() -> None:
    assert not FILES or len(set(FILES) - set(NO_ROBOTS)) >= 60


@with_files
@pytest.mark.parametrize("file", [pytest.param(f, marks=() if f in QUICK else pytest.mark.slow) for f in FILES])
def test_a_whole_robot_has_the_dynamics_of_its_file(file: str) -> None:
    if file in NO_ROBOTS:
        with pytest.raises((ArgumentError, DataFileError)) as caught:
            fl.import_urdf(folder() / file)
        assert caught.value.id == NO_ROBOTS[file]
    else:
        check_against_file(folder() / file, states=5)


@pytest.mark.slow
@with_files
@pytest.mark.parametrize("file", FLOATING)
def test_a_robot_that_walks_or_flies_moves_as_pinocchios_free_flyer(file: str) -> None:
    check_free_base_against_file(folder() / file)


def test_a_random_tree_on_a_free_base_moves_as_pinocchios_free_flyer(random_robot) -> None:
    check_free_base_against_file(random_robot[1])


def test_a_random_tree_has_the_dynamics_of_pinocchio_with_held_mimic_joints(random_robot) -> None:
    described, path = random_robot
    found = fl.import_urdf(path, posture=described.posture)
    chain, theirs, random = fl.lump(found.scene), original(path, found), np.random.default_rng(1)
    assert sorted(part.joint.name for part in found.path.parts) == sorted(FREE)
    for _ in range(5):
        q, qd = random.uniform(-3, 3, (2, chain.n))
        assert in_units(fl.mass_matrix(chain, q) - theirs.mass_matrix(q), of_mass_matrix(chain, q)).max() <= 1
        ΔT = fl.bias_torque(chain, q, qd) - theirs.bias_torque(q, qd)
        assert in_units(ΔT, of_bias_torque(chain, q, qd)).max() <= 1


def test_every_tip_is_where_its_link_is_in_pinocchio(random_robot) -> None:
    import pinocchio as pin  # noqa: PLC0415

    described, path = random_robot
    found = fl.import_urdf(path, posture=described.posture)
    chain, theirs = fl.lump(found.scene), original(path, found)
    q = np.random.default_rng(2).uniform(-2, 2, chain.n)
    pin.framesForwardKinematics(theirs.model, theirs.data, theirs._posture(q))
    assert [tip.link for tip in found.path.tips] == [f"a{k}" for k in range(1, 10)]
    for tip in found.path.tips:
        place = theirs.data.oMf[theirs.model.getFrameId(f"{tip.link} link")].translation
        assert fl.tip_position(chain, q, tip=tip.link) == pytest.approx(place, abs=1e-13)


def test_coordinates_are_ordered_path_by_path_as_in_the_file(tmp_path: Path) -> None:
    path = written(
        tmp_path, "lift prismatic base torso", "left revolute torso l1", "right revolute torso r1",
        "head continuous base h", "elbow revolute l1 l2", "tool fixed l2 tool0", "grip prismatic r1 r2",
    )  # fmt: skip
    found = fl.import_urdf(path, posture={"lift": 0.5, "left": np.pi / 2})
    names = ["torso", "l1", "l2", "tool0", "r1", "r2", "h"]
    assert [link.name for link in found.scene.arm.links] == names
    assert [link.on for link in found.scene.arm.links] == ["", "", "", "", "torso", "", "base"]
    assert found.scene.initial.joint_m == (0.5, 0, 0, 0, 0, 0, 0)
    assert found.scene.initial.joint_deg == (0, 90.0, 0, 0, 0, 0, 0)
    assert found.scene.arm.links[0].joint.limits_m == (-1.0, 2.0)
    assert fl.lump(found.scene).joint_units == ("m", "rad", "rad", "rad", "m", "rad")
    reviewed("repr: imported robot", repr(found))
    assert re.match(r"<\w+ 'robot': 6 \D+ base ", repr(found))
    assert repr(found).endswith(" tool0, r2, h>")
    (tmp_path / "scene.toml").write_text(found.scene.to_toml(), encoding="utf-8")
    assert fl.load_scene(tmp_path / "scene.toml") == found.scene


def test_only_the_paths_to_the_named_tips_move(tmp_path: Path) -> None:
    joints = ["lift prismatic base torso", "left revolute torso l1", "elbow revolute l1 l2", "right revolute torso r1"]
    path = written(tmp_path, *joints, "head revolute base h")
    found = fl.import_urdf(path, tip=["r1", "l1"], locked={"lift": 0.25})
    assert [part.joint.name for part in found.path.parts] == ["left", "right"]
    assert [part.folded for part in found.path.parts] == [("l2",), ()]
    assert found.path.held == ("lift", "elbow")
    assert found.scene.arm.links[0].mount.xyz == pytest.approx((0.2 + 0.25, 0.0, 0.4))
    assert fl.import_urdf(path, tip=["l1"]).scene == fl.import_urdf(path, tip="l1").scene


def test_a_tip_on_the_way_to_another_has_a_separate_frame(tmp_path: Path) -> None:
    path = written(tmp_path, "a revolute base l1", "b revolute l1 l2", "c fixed l2 tool")
    found = fl.import_urdf(path, tip=["l1", "l2", "tool"])
    assert [link.name for link in found.scene.arm.links] == ["l1", "l1 frame", "l2", "l2 frame", "tool"]
    assert set(fl.lump(found.scene).tips) == {"l1 frame", "l2 frame", "tool"}


def test_a_part_named_base_is_renamed_if_links_are_attached_to_the_base(tmp_path: Path) -> None:
    path = written(tmp_path, "a revolute world base", "b revolute world other")
    found = fl.import_urdf(path)
    assert [(link.name, link.on) for link in found.scene.arm.links] == [("base_2", ""), ("other", "base")]
    assert found.scene.arm.parents == (0, 0)
    alone = fl.import_urdf(path, tip="base")
    assert [link.name for link in alone.scene.arm.links] == ["base"]


def test_a_free_base_has_the_inertia_of_its_link_and_arms_are_unchanged(random_robot) -> None:
    described, path = random_robot
    posture = described.posture | described.locked
    fixed, free = (fl.import_urdf(path, posture=posture, free_base=free) for free in (False, True))
    one, other = fl.lump(fixed.scene), fl.lump(free.scene)
    assert other.has_free_base
    assert other.n == one.n + 6
    assert other.mass == pytest.approx(sum(body.mass for body in read_robot(path).links.values()), rel=1e-14)
    q = np.random.default_rng(3).uniform(-2, 2, one.n)
    M = fl.mass_matrix(other, np.append(np.zeros(6), q))[6:, 6:]
    assert in_units(M - fl.mass_matrix(one, q), of_mass_matrix(one, q)).max() <= 1


def test_a_free_base_starts_at_its_link_and_omits_other_parts(tmp_path: Path) -> None:
    path = written(
        tmp_path, "drift floating world hull", "arm revolute hull l1", "mast fixed hull m", "other revolute world o"
    )
    found = fl.import_urdf(path, base="hull", free_base=True)
    assert found.scene.initial.base.xyz == (0.1, 0.0, 0.2)
    assert found.scene.arm.links[0].mount.xyz == (0.1, 0.0, 0.2)
    assert found.scene.arm.base.mass == 2.0
    assert fl.lump(found.scene).mass == pytest.approx(3.0)
    note = line("\n".join(found.notes), "hull: ")
    reviewed("import: free base", note)
    assert "2 kg" in note
    assert note.endswith(" m")


def test_a_free_base_without_inertia_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "arm revolute hull l1", masses={"hull": 0.0})
    with refused(DataFileError, "base-mass"):
        fl.import_urdf(path, free_base=True)


def test_joints_without_inertia_beyond_them_are_held_and_noted(tmp_path: Path) -> None:
    joints = ["arm revolute base l1", "a revolute l1 l2", "b prismatic l2 l3", "c fixed l3 tool", "d revolute l1 l4"]
    path = written(tmp_path, *joints, masses={"l2": 0.0, "l3": 0.0, "tool": 0.0})
    found = fl.import_urdf(path)
    assert [part.joint.name for part in found.path.parts] == ["arm", "d"]
    note = line("\n".join(found.notes), ": a, b")
    reviewed("import: joints without inertia", note)
    assert [part.joint.name for part in fl.import_urdf(path, armature={"b": 0.1}).path.parts] == ["arm", "a", "b", "d"]
    with refused(DataFileError, "no-mass"):
        fl.import_urdf(path, tip="tool")


def test_a_file_without_inertia_is_refused_with_all_options(tmp_path: Path) -> None:
    """98 of 322 unseen files have no inertia, and no choice of tip makes them valid."""
    links = ("base", "l1", "l2", "l3")
    path = written(
        tmp_path, "a revolute base l1", "b revolute l1 l2", "c revolute l2 l3", masses=dict.fromkeys(links, 0.0)
    )
    for options in ({}, {"tip": "l3"}, {"tip": "l1"}, {"free_base": True}, {"armature": {"a": 0.1}, "tip": "l3"}):
        with refused(DataFileError, "no-mass"):
            fl.import_urdf(path, **options)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_other_kinds_are_refused_by_name(kind: str, tmp_path: Path) -> None:
    path = written(tmp_path, f"drift {kind} world hull", "arm revolute hull l1", "other revolute world o")
    with refused(ArgumentError, "joint-type-in-file"):
        fl.import_urdf(path)
    assert [part.joint.name for part in fl.import_urdf(path, tip="o").path.parts] == ["other"]
    assert [part.joint.name for part in fl.import_urdf(path, base="hull").path.parts] == ["arm"]


def test_a_spherical_joint_is_refused_and_a_free_base_in_its_place_is_not_advised(tmp_path: Path) -> None:
    """A free base would move away from the joint's centre."""
    ball, hinge = '<joint name="j" type="ball"/>', '<joint name="k" axis="1 0 0"/>'
    weight = '<geom type="sphere" size="0.1" pos="0 0 1"/>'
    inner = f'<body name="b" pos="0 0 1">{hinge}{weight}</body>'
    path = tmp_path / "ball.xml"
    path.write_text(f'<mujoco><worldbody><body name="a">{ball}{weight}{inner}</body></worldbody></mujoco>')
    with refused(ArgumentError, "joint-type-in-file"):
        fl.import_urdf(path)


def test_child_links_of_a_flexible_link_are_attached_to_the_end_of_its_beam(tmp_path: Path) -> None:
    """With slack springs, M equals the mass matrix of the rigid robot."""
    joints = ["lift prismatic base torso", "left revolute torso l1", "right revolute torso r1", "elbow revolute l1 l2"]
    path = written(tmp_path, *joints)
    beam = fl.FlexibleLink(frequency_hz=9.0, line=((0.0, 0.0, 0.0), (0.03, 0.0, 0.05)))
    rigid, bent = (fl.import_urdf(path, flexible=links, gravity=(0.0, 0.0, 0.0)) for links in ({}, {"torso": beam}))
    one, other = fl.lump(rigid.scene), fl.lump(bent.scene)
    q = np.zeros(other.n)
    q[other.active] = np.random.default_rng(4).uniform(-1, 1, one.n)
    for tip in ("l2", "r1"):  # r1 follows l2 in the scene
        place = fl.tip_position(one, q[other.active], tip=tip)
        assert fl.tip_position(other, q, tip=tip) == pytest.approx(place, abs=1e-14)
    ours = fl.mass_matrix(other, q)[np.ix_(other.active, other.active)]
    assert ours == pytest.approx(fl.mass_matrix(one, q[other.active]), abs=1e-14)
    found = fl.modes(other, np.zeros(other.n), locked=[n for n in other.joint_names if not n.startswith("torso.")])
    assert found.hertz[0] == pytest.approx(9.0, rel=1e-9)


def test_the_command_line_accepts_several_tips_slides_in_metres_and_a_free_base(tmp_path: Path, capsys) -> None:
    path = written(
        tmp_path, "lift prismatic base torso", "left revolute torso l1", "right revolute torso r1", "h fixed r1 h"
    )
    out = tmp_path / "out.toml"
    words = [
        "import", str(path), "--tip", "l1", "--tip", "h", "--locked", "lift=0.5", "--posture", "left=90", "--free-base",
    ]  # fmt: skip
    assert main([*words, "-o", str(out)]) == 0
    summary = line(capsys.readouterr().out, "robot: ")
    reviewed("import: summary", summary)
    assert re.match(r"robot: 2 \D+ l1, h; ", summary)
    assert " base " in summary
    same = fl.import_urdf(path, tip=("l1", "h"), locked={"lift": 0.5}, posture={"left": np.pi / 2}, free_base=True)
    assert fl.load_scene(out) == same.scene
    assert main(["import", str(path), "--tip", "x"]) == 2
    refusal = refused_line(capsys.readouterr().err, "unknown-name")
    assert "tip = 'x'" in refusal
    assert "base, torso" in refusal


def test_impossible_tips_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "lift prismatic base torso", "left revolute torso l1", "foot fixed base f")
    for tip, id, part in (
        ((), "unknown-link", "tip = ()"),
        (("l1", 3), "unknown-name", "tip = 3"),
        (("l1", "f"), "no-movable-joint", "'f'"),
    ):
        with refused(ArgumentError, id) as caught:
            fl.import_urdf(path, tip=tip)
        assert part in str(caught.value)
    with refused(ArgumentError, "unknown-joint"):
        fl.import_urdf(path, tip="torso", locked={"left": 0.0})


def moving(text: str) -> set[str]:
    """Names of the joints in a URDF, MJCF or SDF text that move; no joint that is fixed may have one of them."""
    joints = [each for each in ET.fromstring(text).iter("joint") if len(each) or each.get("axis")]
    names = {
        kind: [each.get("name", "") for each in joints if (each.get("type") == "fixed") == kind] for kind in (0, 1)
    }
    assert not {*names[0]} & {*names[1]}
    return {*names[0]}


@pytest.mark.parametrize("seed", range(12))
def test_joints_keep_their_names_from_a_file_to_a_scene_its_exports_and_back(seed: int, tmp_path: Path) -> None:
    text, links = named_tree(seed)
    (tmp_path / "tree.urdf").write_text(text, encoding="utf-8")
    scene = fl.import_urdf(tmp_path / "tree.urdf").scene
    assert [link.joint.name for link in scene.arm.links if not link.joint.locked] == [*fl.lump(scene).joint_names]
    assert scene_from(tomllib.loads(scene.to_toml())) == scene
    chain = fl.lump(scene)
    assert {*chain.joint_names} == {*links}
    texts = [write(chain, shapes=False) for write in (fl.to_urdf, fl.to_mjcf)]
    assert [moving(each) for each in texts] == [{*links}] * 2
    assert {name.replace("::", ".") for name in links} == moving(fl.to_sdf(chain, shapes=False))
    assert read_urdf(texts[0]).joint_names == chain.joint_names
    assert read_sdf(fl.to_sdf(chain)).joint_names == chain.joint_names
    plain = re.sub("<flexlink[^>]*>", "", texts[0])  # as another program writes it
    (tmp_path / "again.urdf").write_text(plain, encoding="utf-8")
    again = fl.lump(fl.import_urdf(tmp_path / "again.urdf").scene)
    assert again.joint_names == chain.joint_names
    q = np.random.default_rng(seed).uniform(-1, 1, chain.n)
    assert fl.mass_matrix(again, q) == pytest.approx(fl.mass_matrix(chain, q), rel=1e-12, abs=1e-12)


def test_results_and_files_of_torques_have_the_names_of_joints_and_links_still_select_them(tmp_path: Path) -> None:
    """The names are exchanged on purpose: the joint "l2" moves the link l1, and the joint "l1" the link l2."""
    scene = fl.import_urdf(written(tmp_path, "l2 revolute base l1", "l1 revolute l1 l2", "l3 revolute l2 l4")).scene
    (tmp_path / "torques.csv").write_text("t [s],tau l1 [N m],tau l2 [N m],tau l3 [N m]\n0,1,2,3\n1,1,2,3\n", "utf-8")
    scene = scene.varied({"drive": fl.Drive(kind="table", file=str(tmp_path / "torques.csv")), "run.duration": 0.01})
    run, chain = fl.simulate(scene), fl.lump(scene)
    assert chain.joint_names == ("l2", "l1", "l3")
    assert [float(run.columns[f"tau {name} [N m]"][0]) for name in chain.joint_names] == [2.0, 1.0, 3.0]
    assert [chain.joint_index("joint", name) for name in ("l1", "l2", "l4")] == [1, 0, 2]
    run.save(tmp_path / "run.npz")
    assert fl.Trajectory.load(tmp_path / "run.npz").chain.joint_names == chain.joint_names
    twice = fl.Link(name="l5", joint=fl.Joint(name="l3"))
    with refused(SceneError, "name-twice"):
        replace(scene.arm, links=(*scene.arm.links, twice))
    with refused(SceneError, "empty-name"):
        fl.Joint(name="")
