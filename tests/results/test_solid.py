"""A robot's shapes are where MuJoCo's kinematics of its file places them, and in pictures where the view does."""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli import show
from flexlink.cli.main import main
from flexlink.common.errors import ArgumentError, DataFileError, EngineError
from flexlink.results.pictures import solid
from flexlink.results.pictures.film import Film, film_of
from tests.support.words import refused, reviewed

mujoco = pytest.importorskip("mujoco")

CORNERS = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.06) for z in (0.0, 0.04)]
FACES = "1 2 4|1 4 3|5 7 8|5 8 6|1 5 6|1 6 2|3 4 8|3 8 7|1 3 7|1 7 5|2 6 8|2 8 4"
BLOCK = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join(f"f {each}\n" for each in FACES.split("|"))
MESH = '<visual name="same"><origin xyz="{0}" rpy="0.3 -0.2 0.5"/><geometry><mesh filename="{1}"/></geometry></visual>'
BOX = '<collision><origin xyz="0.2 0 0"/><geometry><box size="0.3 0.02 0.02"/></geometry></collision>'
COLOUR = '<material name="red"><color rgba="1 0 0 1"/></material>'
RED = f'<visual><geometry><box size="0.05 0.05 0.05"/></geometry>{COLOUR}</visual>'
INERTIA = '<inertia ixx="1e-2" iyy="3e-2" izz="3e-2" ixy="0" ixz="0" iyz="0"/>'
MASS = f'<inertial><origin xyz="0.2 0 0"/><mass value="2"/>{INERTIA}</inertial>'
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}" rpy="{5}"/>
    <axis xyz="{6}"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>"""
LINKS = {
    "base": MESH.format("0 0 0.1", "package://robot/parts/block.obj"),
    "upper": MASS + MESH.format("0.1 0 0", "parts/block.obj") + BOX,
    "fore": MASS + MESH.format("0 0 0", "parts/block.dae") + BOX,
    "slide": MASS + BOX,
    "tool": RED,
}
JOINTS = [
    ("shoulder", "continuous", "base", "upper", "0 0 0.3", "0.4 0 0", "0 0.6 0.8"),
    ("elbow", "continuous", "upper", "fore", "0.5 0 0", "0 0.2 0", "0 1 0"),
    ("rail", "prismatic", "fore", "slide", "0.4 0 0", "0 0 0.7", "1 0 0"),
    ("flange", "fixed", "slide", "tool", "0.3 0 0.05", "0 0 0", "1 0 0"),
]


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A robot of skew axes; its mesh is found by package, by path; or only its collision shape can be read."""
    (tmp_path / "robot" / "parts").mkdir(parents=True)
    for name in ("block.obj", "block.dae"):
        (tmp_path / "robot" / "parts" / name).write_text(BLOCK)
    links = "".join(f'<link name="{name}">{inside}</link>' for name, inside in LINKS.items())
    joints = "".join(JOINT.format(*joint) for joint in JOINTS)
    path = tmp_path / "robot" / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joints}</robot>')
    return path


def as_mjcf(path: Path) -> Path:
    """The same robot as MuJoCo writes it, with a floor, and with a second shape that is only for contacts."""
    spec = mujoco.MjSpec.from_string(solid._with_meshes(solid.safe_xml.parse(path.read_bytes(), ""), path))
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    spec.body("fore").add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.3, 0, 0])
    for body in spec.bodies[1:]:
        body.explicitinertial, body.mass, body.inertia = True, 1.0, [0.01] * 3
    spec.compile()
    out = path.with_suffix(".xml")
    out.write_text(spec.to_xml())
    return out


def filmed(scene: fl.Scene) -> tuple[fl.Trajectory, Film]:
    run = fl.simulate(scene.varied({"run.duration": 0.3, "run.sample": 0.05}))
    return run, film_of(run, magnify=1.0, colour="moment", fps=10.0, speed=1.0)


@pytest.mark.parametrize("convert", [lambda path: path, as_mjcf], ids=["urdf", "mjcf"])
def test_shapes_are_where_mujoco_moves_them_in_its_own_model_of_the_file(robot: Path, convert) -> None:
    path = convert(robot)
    scene = fl.import_urdf(path, posture={"shoulder": 0.5, "elbow": -0.8, "rail": 0.1}).scene
    run, film = filmed(scene)
    shapes = solid.shapes_of(path, scene, run.chain)
    model = shapes.spec.compile()
    assert (model.geom_group == solid.SEEN).sum() == 5
    data = mujoco.MjData(model)
    for k, t in enumerate(film.t):
        row = int(np.argmin(abs(run.t - t)))
        for name, q in zip(("shoulder", "elbow", "rail"), run.q[row, run.chain.active], strict=True):
            data.joint(name).qpos[0] = q
        mujoco.mj_kinematics(model, data)
        R, p = film.R[k, shapes.body], film.p[k, shapes.body]
        np.testing.assert_allclose(p + np.einsum("gij,gj->gi", R, shapes.p), data.geom_xpos, rtol=0, atol=1e-12)
        np.testing.assert_allclose(R @ shapes.R, data.geom_xmat.reshape(-1, 3, 3), rtol=0, atol=1e-12)


def test_the_tool_of_a_link_that_bends_moves_with_its_end(robot: Path) -> None:
    """The fixed tool is beyond the slide, whose link bends: its box stays where the arm's tip, the tool's frame, is."""
    scene = fl.import_urdf(robot, flexible={"upper": fl.FlexibleLink(frequency_hz=3.0)}, tip="tool").scene
    run, film = filmed(scene)
    shapes = solid.shapes_of(robot, scene, run.chain)
    assert shapes.bends.tolist() == [1]
    tool = np.einsum("fij,j->fi", film.R[:, shapes.body[-1]], shapes.p[-1]) + film.p[:, shapes.body[-1]]
    np.testing.assert_allclose(tool, run.tip[[int(np.argmin(abs(run.t - t))) for t in film.t]], rtol=0, atol=1e-12)
    assert np.ptp(run.q, axis=0)[[k for k in range(run.chain.n) if k not in run.chain.active]].max() > 0.01


def test_a_solid_picture_shows_the_tool_where_the_view_projects_it(robot: Path) -> None:
    scene = fl.import_urdf(robot, posture={"shoulder": 0.5, "elbow": -0.8}).scene
    run, film = filmed(scene)
    shapes = solid.shapes_of(robot, scene, run.chain)
    try:
        drawing = solid.Rendering(film, 480, shapes)
    except EngineError as error:
        pytest.skip(str(error))
    for k in (0, len(film.t) - 1):
        image = drawing.image(k).astype(int)
        rows, columns = np.nonzero((image[..., 0] > 90) & (image[..., 1:].max(axis=2) < 40))
        body = shapes.body[-1]
        x, y, _ = film.view(film.p[k, body] + film.R[k, body] @ shapes.p[-1])
        left, right, bottom, top = drawing.window
        place = (x - left) / (right - left) * 480, 54 + (top - y) / (top - bottom) * drawing.scene_height
        assert np.hypot(columns.mean() + 0.5 - place[0], rows.mean() + 0.5 - place[1]) < 1.5  # pixels
        assert len(rows) > 50


def test_a_film_with_meshes_is_written_and_pages_refuse_them(robot: Path, tmp_path: Path) -> None:
    run, _ = filmed(fl.import_urdf(robot).scene)
    with refused(ArgumentError, "page-with-meshes"):
        run.animate(tmp_path / "arm.html", meshes="arm.urdf")
    with contextlib.suppress(EngineError):  # of a machine that cannot draw
        assert run.animate(tmp_path / "arm.gif", width=320, meshes=robot).stat().st_size > 10_000


def test_show_draws_meshes_and_reads_them_before_the_run(robot: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    scene = fl.import_urdf(robot).scene
    Path("arm.toml").write_text(scene.varied({"run.duration": 0.1}).to_toml())
    shapes = solid.shapes_of(robot, scene, fl.lump(scene))
    seen = list[str]()
    monkeypatch.setattr(show, "has_screen", lambda: False)
    assert main(["show", "arm.toml", "--meshes", str(robot), "--view"]) == 2
    monkeypatch.setattr(show, "has_screen", lambda: True)
    monkeypatch.setattr(solid, "shapes_of", lambda *_: seen.append("read") or shapes)
    monkeypatch.setattr(show, "simulate", lambda scene, **_: seen.append("run") or fl.simulate(scene))
    monkeypatch.setattr(show, "animate", lambda run, wanted, _: seen.append(str(wanted.meshes)))
    monkeypatch.setattr(solid, "view", lambda run, film, meshes: seen.append(f"{len(film.t)}"))
    assert main(["show", "arm.toml", "--meshes", str(robot)]) == 0
    assert main(["show", "arm.toml", "--meshes", str(robot), "--view", "--fps", "20"]) == 0
    assert seen == ["read", "run", str(robot), "read", "run", "3"]


@pytest.mark.parametrize(
    ("old", "new", "error", "id"),
    [
        ('"0.5 0 0"', '"0.2 0 0"', ArgumentError, "other-robot"),
        ("shoulder|elbow|rail|flange|upper|fore|slide|tool", r"my_\g<0>", ArgumentError, "other-robot"),
        ("block", "bloc", DataFileError, "no-shapes"),
        ("v ", "# ", DataFileError, "engine-cannot-load"),
    ],
)
def test_files_that_do_not_fit_the_scene_are_refused(robot: Path, monkeypatch, old, new, error, id) -> None:
    """Their joints are elsewhere or have other names; they have no meshes, or meshes that cannot be read."""
    scene = fl.import_urdf(robot).scene
    text = robot.read_text() if id != "no-shapes" else robot.read_text().replace(BOX, "").replace(RED, "")
    robot.write_text(re.sub(old, new, text))
    mesh = robot.parent / "parts" / "block.obj"
    mesh.write_text(mesh.read_text().replace(old, new))
    monkeypatch.chdir(robot.parent)
    with refused(error, id, values=False):
        solid.shapes_of(Path("arm.urdf"), scene, fl.lump(scene))
    assert [*Path().glob("*.TXT")] == []


def test_links_without_readable_shapes_are_named(robot: Path) -> None:
    scene = fl.import_urdf(robot).scene
    robot.write_text(robot.read_text().replace("parts/block.obj", "parts/lost.obj").replace(BOX, ""))
    with pytest.warns(RuntimeWarning) as caught:
        assert len(solid.shapes_of(robot, scene, fl.lump(scene)).body) == 1
    reviewed("shapes-not-drawn", str(caught[0].message).removeprefix(f"{robot}: "))


def test_shapes_that_fit_need_the_name_of_the_joint_or_of_the_link_only(robot: Path) -> None:
    scene = fl.import_urdf(robot).scene
    expected = solid.shapes_of(robot, scene, fl.lump(scene)).body
    robot.write_text(robot.read_text().replace('"shoulder"', '"hip"'))
    assert (solid.shapes_of(robot, scene, fl.lump(scene)).body == expected).all()


def test_a_link_named_as_another_joint_keeps_its_own_shapes(robot: Path) -> None:
    robot.write_text(robot.read_text().replace('"fore"', '"shoulder"'))
    scene = fl.import_urdf(robot).scene
    assert solid.shapes_of(robot, scene, fl.lump(scene)).body.tolist() == [0, 1, 2, 3, 3]


def test_a_mesh_is_that_of_its_package_and_a_file_may_have_options_for_mujoco(robot: Path) -> None:
    parts = robot.parent.parent / "gripper" / "parts"
    parts.mkdir(parents=True)
    (parts / "block.obj").write_text(BLOCK)
    found = [solid._located(robot, f"package://{package}/parts/block.obj") for package in ("gripper", "robot")]
    assert found == [parts / "block.obj", robot.parent / "parts" / "block.obj"]
    robot.write_text(robot.read_text().replace("</robot>", "<mujoco><compiler angle='radian'/></mujoco></robot>"))
    scene = fl.import_urdf(robot).scene
    assert len(solid.shapes_of(robot, scene, fl.lump(scene)).body) == 5


def test_the_sky_the_planes_and_the_sites_of_a_file_are_not_drawn_and_materials_are_kept(robot: Path) -> None:
    path = as_mjcf(robot)
    assets = (
        '<texture name="s" type="skybox" builtin="gradient" width="8" height="8"/><material name="m" rgba="0 1 0 1"/>'
    )
    text = path.read_text().replace("<worldbody>", '<worldbody><site name="s" size="0.1"/>', 1)
    text = text.replace("<asset>", f'<visual><map znear="0.5" zfar="2"/></visual><asset>{assets}', 1)
    path.write_text(re.sub('(<geom name="[^"]*"|<geom) ', r'\1 material="m" ', text))
    scene = fl.import_urdf(path, flexible={"upper": fl.FlexibleLink(frequency_hz=3.0)}).scene
    run, film = filmed(scene)
    shapes = solid.shapes_of(path, scene, run.chain)
    drawn = solid.Solid(film, shapes, np.eye(3))
    assert {geom.objtype for geom in drawn.placed(0).geoms[: drawn.scene.ngeom]} == {mujoco.mjtObj.mjOBJ_GEOM}
    assert (drawn.model.vis.map.znear, int(drawn.model.ntex)) == (pytest.approx(0.01), 1)
    (seen_through,) = drawn.model.geom_rgba[drawn.of_file[shapes.bends]]
    assert seen_through == pytest.approx([0.0, 1.0, 0.0, 0.35])


def test_shapes_wider_than_the_arm_are_inside_the_picture_also_where_no_screen_opens(robot: Path, monkeypatch) -> None:
    wide = RED.replace("0.05 0.05 0.05", "0.05 0.9 0.7")
    robot.write_text(robot.read_text().replace(RED, wide))
    scene = fl.import_urdf(robot).scene
    run, film = filmed(scene)
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    try:
        drawing = solid.Rendering(film, 480, solid.shapes_of(robot, scene, run.chain))
    except EngineError as error:
        pytest.skip(str(error))
    for k in range(len(film.t)):
        picture = drawing.image(k)[54 : 54 + drawing.scene_height].astype(int)
        red = (picture[..., 0] > 90) & (picture[..., 1:].max(axis=2) < 40)
        assert red.sum() > 1000
        assert not (red[0].any() or red[-1].any() or red[:, 0].any() or red[:, -1].any())


def test_a_body_of_mjcf_without_visual_shapes_shows_those_that_touch_and_pairs_may_name_hidden_ones(
    robot: Path,
) -> None:
    path = as_mjcf(robot)
    spec = mujoco.MjSpec.from_file(str(path))
    hidden, touching = spec.body("fore").geoms[-1], spec.body("slide").geoms[0]
    hidden.name, touching.name, touching.contype = "hidden", "touching", 1
    spec.add_pair(geomname1="hidden", geomname2="touching")
    spec.compile()
    path.write_text(spec.to_xml())
    scene = fl.import_urdf(path).scene
    shapes = solid.shapes_of(path, scene, fl.lump(scene))
    shown = {geom.name for geom in shapes.spec.geoms if geom.group == solid.SEEN}
    assert "touching" in shown
    assert "hidden" not in shown
    assert len(shapes.boxed) == 5
