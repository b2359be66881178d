"""Robots whose files close loops: ties return from MJCF, and hold as MuJoCo's own equalities do."""

import re
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.common.errors import DataFileError, MissingDependencyError
from flexlink.describe.scene import scene_from
from flexlink.dynamics.ties import gaps, tie_rows
from flexlink.robots.importing import ImportResult, import_urdf
from tests.campaigns.ties_in_mujoco import TiedMaker
from tests.support.words import line, refused, reviewed

FOUR_BAR = """<mujoco model="four bar">
  <default>
    <joint axis="0 -1 0" damping="0.1" armature="0.02"/> <geom type="capsule" size="0.02"/>
    <default class="off"><equality active="false"/></default>
  </default>
  <worldbody>
    <body name="crank"> <joint name="a"/> <geom fromto="0 0 0 0.4 0 0"/>
      <body name="coupler" pos="0.4 0 0"> <joint name="b"/> <geom fromto="0 0 0 1 0 0"/> <body name="plate"/>
        <site name="end" pos="1 0 0"/> </body> </body>
    <body name="rocker" pos="1.1 0 0"> <joint name="c"/> <geom fromto="0 0 0 0.8 0 0"/>
      <site name="top" pos="0.8 0 0"/> </body>
  </worldbody>
  <tendon> <fixed name="rope"> <joint joint="a" coef="1"/> </fixed> </tendon>
  <equality>
    <connect name="pin" site1="end" site2="top"/>
    <weld class="off" body1="coupler"/>
    <joint joint1="c" joint2="b" polycoef="0 1 1 0 0"/>
    <joint joint1="c" joint2="b" polycoef="0.1 1 0 0 0"/>
    <tendon name="short" tendon1="rope"/>
    <connect name="loose" body1="coupler" body2="plate" anchor="0 0 0"/>
  </equality>
</mujoco>"""
ODD = """<mujoco>
  <option gravity="0 0 -1.6" density="1.2"/>
  <worldbody>
    <body name="post" pos="0.1 0.2 0.3" euler="10 20 30">
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
      <body pos="0.3 0 0" quat="0.7 0.1 -0.3 0.2">
        <joint name="lift" type="slide" axis="1 2 0" ref="0.1" range="-1 1"/>
        <joint name="yaw" axis="0 1 3" pos="0.1 -0.2 0" ref="25" stiffness="7"/>
        <joint name="roll" axis="1 0 0" pos="0 0.3 0.1" armature="0.3"/>
        <geom type="box" contype="0" size="0.1 0.2 0.05" pos="0.1 0 0" euler="20 0 50"/>
        <body name="hand" pos="0.2 0.1 0" euler="0 50 0">
          <joint name="grip" axis="0 0 1" damping="0.2" frictionloss="0.4"/>
          <inertial pos="0.1 0 0" mass="2" fullinertia="0.03 0.04 0.05 0.01 0 0.002"/>
        </body> </body> </body>
  </worldbody>
  <equality>
    <weld name="held" body1="hand" body2="post" anchor="0.1 0 0" relpose="{}"/>
    <connect name="ball" body1="hand" anchor="0.3 0.1 0"/>
    <joint name="geared" joint1="grip" joint2="roll" polycoef="0 -2 0 0 0"/>
  </equality>
</mujoco>"""


def saved(folder: Path, text: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(text, encoding="utf-8")
    return path


def exported(folder: Path, chain: fl.Chain, scene: fl.Scene) -> Path:
    """A file of a scene as if another program had written it: without the texts of flexlink."""
    root = ET.fromstring(fl.to_mjcf(chain, shapes=False, timestep=1e-3, ties=scene))
    root.remove(next(root.iter("custom")))
    return saved(folder, ET.tostring(root, encoding="unicode"))


def of_mujoco(path: Path, found: ImportResult, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """M, and rows and residuals of all equalities, at positions of the joints of an imported arm."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, order = mujoco.MjData(model), [model.joint(part.joint.name).dofadr[0] for part in found.path.parts]
    data.qpos[order] += q
    mujoco.mj_forward(model, data)
    M, own = np.zeros((model.nv, model.nv)), data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    mujoco.mj_fullM(model, data, M)
    return M[np.ix_(order, order)], data.efc_J.reshape(-1, model.nv)[own][:, order], data.efc_pos[own]


def ours(found: ImportResult, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """The same for the imported scene."""
    chain = fl.lump(open_chain(found.scene))
    g, J, _ = gaps(tie_rows(found.scene, chain), chain, q)
    return fl.mass_matrix(chain, q), J, g


def space(J: np.ndarray) -> np.ndarray:
    """The projection onto the rows of J, which does not depend on how a program writes the same conditions."""
    return np.linalg.pinv(J, rcond=1e-9) @ J


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 24, 26, 30, 34])
def test_ties_return_from_mjcf_and_hold_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    """Hinges, a weld, points in frame 0 and between links; two points are a hinge."""
    scene = TiedMaker(seed).scene().varied({"drive": {}, "wrench": {}})
    scene = scene.varied({"tie": [tie for tie in scene.tie if tie.stiffness is None]})
    chain = fl.Problem(scene).chain
    closed, _ = fl.initial_state(scene, chain)
    path = exported(tmp_path, chain, scene)
    found = import_urdf(path, gravity=scene.gravity)
    order = [chain.joint_names.index(part.joint.name) for part in found.path.parts]
    (M, J, g), (their_M, their_J, their_g) = ours(found, closed[order]), of_mujoco(path, found, closed[order])
    original = gaps(tie_rows(scene, chain), chain, closed)[1][:, order]
    np.testing.assert_allclose(M, their_M, atol=1e-13 * np.abs(M).max())
    np.testing.assert_allclose(space(J), space(their_J), atol=1e-12)
    np.testing.assert_allclose(space(J), space(original), atol=1e-12)
    assert max(np.abs(g).max(), np.abs(their_g).max()) < 1e-13
    opened = closed[order] + np.random.default_rng(seed).uniform(-0.3, 0.3, len(order))
    if {tie.kind for tie in found.scene.tie} == {"point"}:
        gap = np.linalg.norm(of_mujoco(path, found, opened)[2])
        assert np.linalg.norm(ours(found, opened)[2]) == pytest.approx(gap, rel=1e-12) and gap > 1e-3


def test_ties_return_from_mjcf_with_their_names_and_values(tmp_path: Path) -> None:
    link = {"joint": {"axis": [0, 1, 0]}, "hub": {"mass": 1.0, "center": [0.2, 0, 0], "inertia": [0.1] * 3}}
    ties = [
        {"name": "pin", "kind": "point", "link": "c", "point": [0.5, 0, 0.1], "to": {"point": [0.3, 0, 0]}},
        {"name": "gears", "kind": "joint", "link": "b", "to": {"link": "a"}, "ratio": -0.5},
        {"name": "plate", "kind": "weld", "link": "c", "point": [0.1, 0, 0],
         "to": {"link": "a", "point": [0.2, 0, 0.3], "rpy_deg": [10.0, -20.0, 30.0]}},
    ]  # fmt: skip
    scene = scene_from(
        {"name": "three", "link": [{"name": name, "length": 0.4, **link} for name in "abc"], "tie": ties}
    )
    found = import_urdf(path := exported(tmp_path, fl.lump(open_chain(scene)), scene)).scene
    assert ET.parse(path).find("default/equality").get("solref") == "0.002 1.0"  # two steps
    assert [(tie.name, tie.kind) for tie in found.tie] == [(tie.name, tie.kind) for tie in scene.tie]
    for tie, first in zip(found.tie, scene.tie, strict=True):
        for end, other in ((tie, first), (tie.to, first.to)):
            assert [end.point, end.rpy_deg] == [pytest.approx(other.point), pytest.approx(other.rpy_deg)]
        assert tie.ratio == first.ratio


def test_an_odd_mjcf_has_the_mass_matrix_and_the_equalities_of_mujoco(tmp_path: Path) -> None:
    """Several joints in a body, each at its own place and zero, a body without joints, and masses of shapes."""
    q = np.array([0.2, 0.5, -0.7, 0.9])
    model = mujoco.MjModel.from_xml_string(ODD.format("0 0 0 1 0 0 0"))
    data, turn = mujoco.MjData(model), np.zeros(4)
    data.qpos += q
    mujoco.mj_kinematics(model, data)
    hand, post = data.body("hand"), data.body("post")
    mujoco.mju_mulQuat(turn, hand.xquat * [1, -1, -1, -1], post.xquat)
    apart = hand.xmat.reshape(3, 3).T @ (post.xpos + post.xmat.reshape(3, 3) @ [0.1, 0, 0] - hand.xpos)
    path = saved(tmp_path, ODD.format(" ".join(map(repr, map(float, [*apart, *turn])))))
    found = import_urdf(path)
    (M, J, g), (their_M, their_J, their_g) = ours(found, q), of_mujoco(path, found, q)
    np.testing.assert_allclose(M, their_M, atol=1e-14 * np.abs(M).max())
    np.testing.assert_allclose(space(J), space(their_J), atol=1e-12)
    np.testing.assert_allclose(g[:9], np.zeros(9), atol=1e-14)  # the weld is closed
    assert np.linalg.norm(g[9:12]) == pytest.approx(np.linalg.norm(their_g[6:9])) and g[12] == pytest.approx(their_g[9])
    joints = {part.joint.name: part.joint for part in found.path.parts}
    assert joints["lift"].limits == pytest.approx((-1.1, 0.9)) and joints["grip"].friction == 0.4
    for text in ("<joint spring>: ", "<option gravity>: ", "ignored: 1 <geom>"):
        reviewed("import: of mjcf", line(str(found), text))
    assert "<option fluid>: " in str(found)


def test_a_four_bar_keeps_to_its_closed_form(tmp_path: Path) -> None:
    """Freudenstein: d/a cos φ − d/c cos θ + (a² − b² + c² + d²) / 2ac = cos(θ − φ), with the ground d."""
    found = import_urdf(saved(tmp_path, FOUR_BAR), posture={"a": 1.0, "b": -0.5, "c": 1.6})
    with pytest.warns(RuntimeWarning, match="ties closed"):
        run = fl.simulate(found.scene, duration=0.2, sample=0.1, tolerance=1e-4)
    (θ, _, φ), (a, b, c, d) = run.q.T, (0.4, 1.0, 0.8, 1.1)
    left = d / a * np.cos(φ) - d / c * np.cos(θ) + (a * a - b * b + c * c + d * d) / (2 * a * c)
    np.testing.assert_allclose(left, np.cos(θ - φ), atol=1e-12)
    assert np.ptp(θ) > 0.1


def test_what_is_no_tie_is_named(tmp_path: Path) -> None:
    found = import_urdf(path := saved(tmp_path, FOUR_BAR))
    assert [(tie.name, tie.kind) for tie in found.scene.tie] == [("pin", "point")]
    reviewed("loop-tied", line(str(found), "pin: "))
    for name in ("equality 1", "equality 2", "equality 3", "short", "loose"):
        reviewed("loop-left-out", line(str(found), f"{name}: "))
    part = import_urdf(path, tip="coupler")
    reviewed("loop-left-out", note := line(str(part), "pin: "))
    tips = re.findall(r"--tip (\w+)", note)
    assert not part.scene.tie and import_urdf(path, tip=tips).scene.tie == found.scene.tie
    assert sum(note.id.startswith("loop-") for note in found.notes) == 6


def test_a_tie_of_a_locked_joint_or_a_floating_base_is_named(tmp_path: Path) -> None:
    path = saved(tmp_path, ODD.format("0 0 0 1 0 0 0"))
    reviewed("loop-left-out", line(str(import_urdf(path, locked={"roll": 0.1})), "geared: "))
    afloat = import_urdf(path, base="post", free_base=True)
    reviewed("loop-left-out", line(str(afloat), "held: "))
    assert [tie.name for tie in afloat.scene.tie] == ["ball", "geared"]
    start, turn = afloat.scene.initial.base, Rotation.from_euler("XYZ", [10, 20, 30], degrees=True)
    assert start.xyz == (0.1, 0.2, 0.3) and start.rpy_deg == pytest.approx(turn.as_euler("xyz", degrees=True))


def test_mjcf_that_cannot_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with refused(DataFileError, "engine-cannot-load", values=False):
        import_urdf(saved(tmp_path, FOUR_BAR.replace('site2="top"', 'site2="none"')))
    with refused(DataFileError, "exported-by-flexlink"):
        import_urdf(saved(tmp_path, fl.to_mjcf(fl.lump(fl.load_scene("models/paper_fig5.toml")))))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with refused(MissingDependencyError, "package-missing"):
        import_urdf(saved(tmp_path, FOUR_BAR))
