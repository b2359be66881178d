"""Robots in SDF: their masses, placements and loops."""

import re
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.common.errors import DataFileError
from flexlink.robots.importing import import_urdf
from flexlink.robots.robot_file import read_robot
from tests.campaigns.ties_in_mujoco import TiedMaker
from tests.support.words import line, refused, reviewed

DRAWN = np.radians([60.0, 26.971151626305424, 90.62775979865539])
"""Angles of crank, coupler and rocker in the file, where the four-bar is closed."""
MASS = "<mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia>"
FOUR_BAR = f"""<sdf version="1.10"><world name="lab"><model name="four bar">
  <pose>0 0 0.5 0 0 0</pose>
  <link name="crank">
    <pose degrees="true">0 0 0 0 -60 0</pose> <inertial><pose>0.2 0 0 0 0 0</pose>{MASS}</inertial>
  </link>
  <link name="coupler">
    <pose relative_to="b"/> <inertial><pose>0.5 0 0 0 0 0</pose>{MASS}</inertial>
  </link>
  <link name="rocker">
    <pose>1.1 0 0 0 {-DRAWN[2]:.17g} 0</pose> <inertial><pose>0.4 0 0 0 0 0</pose>{MASS}</inertial>
  </link>
  <frame name="end" attached_to="coupler"><pose>1 0 0 0 0 0</pose></frame>
  <joint name="a" type="continuous">
    <parent>world</parent> <child>crank</child> <axis><xyz>0 -1 0</xyz></axis>
  </joint>
  <joint name="b" type="revolute">
    <pose relative_to="crank">0.4 0 0 0 {DRAWN[0] - DRAWN[1]:.17g} 0</pose>
    <parent>crank</parent> <child>coupler</child>
    <axis><xyz>0 -1 0</xyz> <limit><lower>-2</lower><upper>2</upper></limit></axis>
  </joint>
  <joint name="c" type="revolute">
    <parent>world</parent> <child>rocker</child>
    <axis><xyz expressed_in="__model__">0 -2 0</xyz> <limit><lower>-inf</lower><upper>inf</upper></limit>
      <dynamics><damping>0.1</damping><spring_stiffness>3</spring_stiffness></dynamics></axis>
  </joint>
  <joint name="pin" type="revolute">
    <pose relative_to="end">0 0 0 1 2 3</pose>
    <parent>coupler</parent> <child>rocker</child>
    <axis><xyz expressed_in="crank">0 -1 0</xyz> <dynamics><damping>0.1</damping></dynamics></axis>
  </joint>
</model></world></sdf>"""


def saved(folder: Path, text: str) -> Path:
    path = folder / "robot.sdf"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 7, 16])
def test_an_exported_arm_has_the_same_mass_matrix(seed: int, tmp_path: Path) -> None:
    """As if another program had written the file: without the attributes of flexlink."""
    chain = fl.lump(TiedMaker(seed).arm())
    text = re.sub(r' (xmlns:)?flexlink(:\w+)?="[^"]*"', "", fl.to_sdf(chain, shapes=False))
    found = import_urdf(saved(tmp_path, re.sub("<flexlink:coupling [^>]*/>", "", text)))
    order = [chain.joint_names.index(part.joint.name) for part in found.path.parts]
    q = np.random.default_rng(seed).uniform(-0.5, 0.5, chain.n)
    M, armature = fl.mass_matrix(chain, q)[np.ix_(order, order)], np.diag(chain.hinges["armature"][order])
    here = fl.lump(open_chain(found.scene))
    np.testing.assert_allclose(fl.mass_matrix(here, q[order]), M - armature, atol=1e-12 * np.abs(M).max())


@pytest.mark.slow
def test_a_four_bar_keeps_to_its_closed_form(tmp_path: Path) -> None:
    """Freudenstein: d/a cos φ − d/c cos θ + (a² − b² + c² + d²) / 2ac = cos(θ − φ), with the ground d."""
    found = import_urdf(saved(tmp_path, FOUR_BAR))
    assert found.scene.arm.links[0].mount.xyz == (0, 0, 0.5)  # of the model
    (tie,) = found.scene.tie
    assert (tie.name, tie.kind, tie.link, tie.point) == ("pin", "hinge", "rocker", pytest.approx((0.8, 0, 0)))
    assert (tie.to.link, tie.to.point) == ("coupler", pytest.approx((1, 0, 0)))
    assert [np.abs(axis) for axis in (tie.axis, tie.to.axis)] == [pytest.approx((0, 1, 0))] * 2
    run = fl.simulate(found.scene, duration=0.2, sample=0.1, tolerance=1e-4)
    (θ, _, φ), (a, b, c, d) = run.q.T + DRAWN[[0, 1, 2], None], (0.4, 1.0, 0.8, 1.1)
    left = d / a * np.cos(φ) - d / c * np.cos(θ) + (a * a - b * b + c * c + d * d) / (2 * a * c)
    np.testing.assert_allclose(left, np.cos(θ - φ), atol=1e-12)
    np.testing.assert_allclose(run.q[0], np.zeros(3), atol=1e-12)
    assert np.ptp(θ) > 0.1
    joints = {part.joint.name: part.joint for part in found.path.parts}
    assert (joints["b"].limits, joints["c"].limits, joints["c"].damping) == ((-2, 2), None, 0.1)
    reviewed("loop-tied", line(str(found), "pin: "))
    reviewed("left-out", line(str(found.warnings[0]), "spring_stiffness"))


@pytest.mark.parametrize(("kind", "tie"), [("ball", "point"), ("fixed", "weld"), ("screw", None)])
def test_another_joint_that_closes_a_loop(kind: str, tie: str | None, tmp_path: Path) -> None:
    found = import_urdf(saved(tmp_path, FOUR_BAR.replace('name="pin" type="revolute"', f'name="pin" type="{kind}"')))
    assert [each.kind for each in found.scene.tie] == ([tie] if tie else [])
    if tie:
        start, _ = fl.initial_state(found.scene, fl.lump(open_chain(found.scene)))
        np.testing.assert_allclose(start, np.zeros(3), atol=1e-12)  # as drawn
    else:
        reviewed("loop-left-out", line(str(found), "pin: "))


def test_axes_of_a_hinge_that_closes_a_loop_are_those_of_each_link(tmp_path: Path) -> None:
    """The rocker's frame is that of its joint, here turned by 90° about x; an axis that is not given is z."""
    joint = '<joint name="c" type="revolute">'
    turned = FOUR_BAR.replace(joint, f'{joint}<pose degrees="1">0 0 0 90 0 0</pose>')
    (tie,) = import_urdf(saved(tmp_path, turned)).scene.tie
    assert [np.abs(axis) for axis in (tie.axis, tie.to.axis)] == [pytest.approx((0, 0, 1)), pytest.approx((0, 1, 0))]
    without = saved(tmp_path, FOUR_BAR.replace("<axis><xyz>0 -1 0</xyz></axis>", ""))
    assert read_robot(without).joints["a"].axis == pytest.approx((0, 0, 1))


def test_what_a_link_does_not_state_of_its_inertia_is_1_kg_and_1_kg_m2(tmp_path: Path) -> None:
    text = FOUR_BAR.replace(f"<inertial><pose>0.4 0 0 0 0 0</pose>{MASS}</inertial>", "")
    world, *links = read_robot(saved(tmp_path, text.replace("<mass>1</mass>", ""))).links.values()
    assert [world.mass, *(link.mass for link in links), *links[-1].inertia.flat] == [0, 1, 1, 1, *np.eye(3).flat]


def test_a_model_is_placed_with_all_that_is_in_it(tmp_path: Path) -> None:
    """A quarter turn about z takes the rocker's pivot from x to y."""
    turned = FOUR_BAR.replace("<pose>0 0 0.5 0 0 0</pose>", '<pose degrees="true">0 0 0.5 0 0 90</pose>')
    joints = read_robot(saved(tmp_path, turned)).joints
    assert [joints[name].origin.p for name in "ac"] == [pytest.approx(p) for p in ([0, 0, 0.5], [0, 1.1, 0.5])]


def test_the_first_link_of_a_model_without_the_world_is_fixed(tmp_path: Path) -> None:
    text = FOUR_BAR.replace(
        '<joint name="c" type="revolute">\n    <parent>world', '<joint name="c" type="revolute">\n    <parent>crank'
    )
    text = re.sub('(?s)<joint name="a".*?</joint>', "", text)
    found = import_urdf(saved(tmp_path, text))
    assert [part.joint.name for part in found.path.parts] == ["b", "c"] and found.path.base == "world"


WRONG = {
    "circle": (('attached_to="coupler"', 'attached_to="end"'), "link-missing-in-file"),
    "no frame": (('relative_to="end"', 'relative_to="start"'), "link-missing-in-file"),
    "no parent": (("<parent>coupler<", "<parent>ground<"), "link-missing-in-file"),
    "two models": (("</model>", '</model><model name="m"/>'), "element-twice"),
    "no link": ((FOUR_BAR, '<sdf version="1.9"><model name="m"/></sdf>'), "element-twice"),
    "masses of shapes": (("<inertial><pose>0.4", '<inertial auto="true"><pose>0.4'), "missing-in-file"),
    "ours": (("<sdf", '<sdf xmlns:flexlink="urn:flexlink"'), "exported-by-flexlink"),
    "quaternion": (("0 0 0 1 2 3", "0 0 0 1 0 0 0"), "number-in-file"),
}


@pytest.mark.parametrize("name", WRONG)
def test_sdf_that_cannot_be_read_is_refused(name: str, tmp_path: Path) -> None:
    pair, id = WRONG[name]
    with refused(DataFileError, id):
        import_urdf(saved(tmp_path, FOUR_BAR.replace(*pair)))
