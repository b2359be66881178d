"""Animations are to scale and upright, show the whole arm at all times, and colour it by its loads."""

import dataclasses
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image, ImageSequence

import flexlink as fl
from flexlink.cli.main import main
from flexlink.results.pictures.animate import turned_window
from flexlink.results.pictures.film import Film, film_of
from flexlink.results.pictures.projection import Projected
from flexlink.results.pictures.view import view_of
from tests.conftest import ROOT, flexible, make_scene, nasty_scene
from tests.support.browser import CHROMIUM, DRIVER, Browser, axe, browser
from tests.support.words import refused

SCENES = ("paper_fig5", "t3_spatial", "ptp_move", "steel_strips", "nasty")
FFMPEG = shutil.which("ffmpeg")


def scene_of(name: str) -> fl.Scene:
    if name == "nasty":
        return nasty_scene()
    return fl.load_scene(ROOT / ("docs" if name == "steel_strips" else "models") / f"{name}.toml")


def run_of(name: str, duration: float = 0.1, **changes: object) -> fl.Trajectory:
    return fl.simulate(scene_of(name).varied(changes) if changes else scene_of(name), duration=duration)


def filmed(run: fl.Trajectory, **options: object) -> Film:
    return film_of(run, **{"magnify": 1.0, "colour": "moment", "fps": 25.0, "speed": 1.0, **options})


def hanging(**fields: object) -> fl.Scene:
    """A clamped beam with a load, bent by gravity and at rest."""
    beam = flexible("beam", "yz", 5, lumping="gauss", joint=fl.Joint(locked=True), **fields)
    initial = fl.InitialState(joint_deg=(0.0,), passive="static")
    return make_scene(beam, tip=fl.RigidBody(mass=2.0), gravity=(0.0, -9.81, -3.0), initial=initial)


def replace_chain(run: fl.Trajectory, hinges: np.ndarray) -> fl.Trajectory:
    """A copy of the run whose chain has other hinges."""
    return dataclasses.replace(run, chain=dataclasses.replace(run.chain, hinges=hinges))


@pytest.mark.parametrize("magnify", [1.0, 30.0])
@pytest.mark.parametrize("name", SCENES)
def test_the_whole_arm_is_in_the_window_at_all_times(name: str, magnify: float) -> None:
    projected = Projected(filmed(run_of(name), magnify=magnify, fps=50.0))
    left, right, bottom, top = projected.window
    balls = [(projected.ball, projected.ball_radius)] if projected.ball_radius else []
    discs = [*zip(np.moveaxis(projected.joints, 1, 0), projected.joint_radii, strict=True), *balls]
    corners = np.concatenate([projected.outlines(k)[0].reshape(-1, 2) for k in range(len(projected.film.t))])
    for points, radius in [(corners, 0.0), (projected.trace, 0.0), (np.zeros((1, 2)), projected.base_half), *discs]:
        assert (points[:, 0] - radius > left).all()
        assert (points[:, 0] + radius < right).all()
        assert (points[:, 1] - radius > bottom).all()
        assert (points[:, 1] + radius < top).all()
    assert np.ptp(corners, axis=0).max() > 0.6 * (projected.window.size) or projected.view.spatial


@pytest.mark.parametrize("name", SCENES)
def test_the_arm_stays_in_the_window_of_the_page_at_any_view_angle(name: str) -> None:
    film = filmed(run_of(name), magnify=30.0)
    pivot, (left, right, bottom, top) = turned_window(Projected(film))
    v = film.view.vertical
    V = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    for angle in np.radians(np.arange(0, 360, 15)) if film.view.spatial else [0.0]:
        turn = np.eye(3) + np.sin(angle) * V + (1 - np.cos(angle)) * V @ V
        x, y, _ = np.moveaxis((film.points - pivot) @ turn.T @ film.view.axes.T, -1, 0)
        thick = film.outline.across.max(initial=0.0)
        assert x.min() - thick > left
        assert x.max() + thick < right
        assert y.min() - thick > bottom
        assert y.max() + thick < top


@pytest.mark.parametrize("gravity", [(0, 0, 9.81), (0, 0, -9.81), (0, 9.81, 0), (0, -9.81, 0), (1.0, -2.0, 9.0)])
def test_gravity_points_down_in_the_picture_for_any_gravity_vector(gravity: tuple[float, float, float]) -> None:
    lying = make_scene(flexible("a"), gravity=gravity)  # turns about Z
    standing = make_scene(flexible("a", mount=fl.Mount(rpy_deg=(-90.0, 0.0, 0.0))), gravity=gravity)  # about Y
    spatial = make_scene(flexible("a", "yz"), gravity=gravity)
    for scene in (lying, standing, spatial):
        view = view_of(fl.lump(scene))
        assert np.linalg.det(view.axes) == pytest.approx(1.0)
        right, up, towards = view(np.array(gravity))
        assert right == pytest.approx(0.0, abs=1e-12)
        assert up <= 1e-12
        assert up < -0.5 * np.linalg.norm(gravity) or towards < 0  # seen from above


def test_a_planar_arm_is_viewed_perpendicular_to_its_plane() -> None:
    for axis in [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 2.0, -2.0)]:
        chain = fl.lump(
            make_scene(fl.Link(name="a", length=1.0, joint=fl.Joint(axis=axis)), tip=fl.RigidBody(mass=1.0))
        )
        assert abs(view_of(chain).axes[2] @ chain.axes[0]) == pytest.approx(1.0)
        assert not view_of(chain).spatial
    for joint in (fl.Joint(), fl.Joint(axis=(0.0, 1.0, 0.0))):
        tree = fl.lump(make_scene(flexible("a"), flexible("b"), flexible("c", on="a", joint=joint)))
        assert view_of(tree).spatial is (joint != fl.Joint())


@pytest.mark.parametrize("roll", [-90.0, -60.0, 0.0, 60.0, 90.0, 180.0])
def test_a_planar_arm_has_x_to_the_right_on_whichever_side_its_axis_points(roll: float) -> None:
    """Rolled about X, the axis of the joint is (0, −sin, cos) of the angle; gravity points along −Z."""
    mount = fl.Mount(rpy_deg=(roll, 0.0, 0.0))
    view = view_of(fl.lump(make_scene(flexible("a", mount=mount), gravity=(0.0, 0.0, -9.81))))
    assert view.axes[0] == pytest.approx([1.0, 0.0, 0.0])
    assert view.labels[0] == "x [m]"


def test_without_gravity_a_planar_arm_is_viewed_with_x_to_the_right() -> None:
    view = view_of(fl.lump(make_scene(flexible("a"), gravity=(0.0, 0.0, 0.0))))
    assert view.axes == pytest.approx(np.eye(3))


def test_a_round_link_has_its_diameter_from_every_view() -> None:
    pipe = fl.Section(shape="circle", diameter=0.04)
    links = flexible("a", "yz", 3, section="pipe", mount=fl.Mount(rpy_deg=(25.0, 40.0, 10.0)))
    arm = fl.Arm(links=(links,), sections={"pipe": pipe}, materials={"aluminium": fl.Material(70e9, 2700.0)})
    run = fl.simulate(fl.Scene("pipe", arm, fl.InitialState(joint_deg=(0.0,))), duration=0.0)
    quads, _ = Projected(filmed(run)).outlines(0)
    assert np.linalg.norm(quads[:, 0] - quads[:, 3], axis=1) == pytest.approx(0.04)


def test_near_segments_hide_far_ones() -> None:
    projected = Projected(filmed(run_of("t3_spatial", 0.0)))
    _, order = projected.outlines(0)
    depth = projected.points[0, projected.spans, 2] + projected.points[0, projected.spans + 1, 2]
    assert (np.diff(depth[order]) >= 0).all()
    towards = projected.view.axes[2]
    assert projected.view(towards)[2] == pytest.approx(1.0)  # a larger value is nearer to the viewer


def pendulum(center: tuple[float, float, float], mass: float = 3.0) -> fl.Trajectory:
    rod = fl.Link(name="a", length=1.0)
    tip, start = fl.RigidBody(mass=mass, center=center), fl.InitialState(joint_deg=(30.0,))
    return fl.simulate(make_scene(rod, tip=tip, initial=start, gravity=(0.0, -9.81, 0.0)), duration=0.2)


def test_the_payload_turns_with_the_tip() -> None:
    run = pendulum((0.0, 0.5, 0.0))
    placed = fl.frames(run.chain, run.q[[0, 8]])
    assert filmed(run).ball[[0, 1]] == pytest.approx(placed.points[:, -1] + 0.5 * placed.rotations[:, -1, :, 1])


def test_a_payload_offset_from_the_tip_is_in_the_window() -> None:
    projected = Projected(filmed(pendulum((0.0, 2.0, 0.0))))
    left, right, bottom, top = projected.window
    x, y, _ = projected.ball.T
    assert left < x.min() - projected.ball_radius < x.max() + projected.ball_radius < right
    assert bottom < y.min() - projected.ball_radius < y.max() + projected.ball_radius < top


def test_a_payload_is_drawn_as_a_steel_ball_of_its_mass() -> None:
    assert 7850.0 * 4 / 3 * np.pi * Projected(
        filmed(pendulum((0.0, 0.0, 0.0), 50.0))
    ).ball_radius ** 3 == pytest.approx(50.0)
    assert Projected(filmed(run_of("paper_fig5", 0.0))).ball_radius == 0.0


def test_bodies_are_drawn_in_place_and_links_as_wide_as_their_sections() -> None:
    wide = fl.Section(shape="rectangle", height=0.2, width=0.05)
    slim = fl.Section(shape="rectangle", height=0.1, width=0.05)
    link = flexible("a", "z", 5, section="wide", section_tip="slim")
    arm = fl.Arm(
        links=(link,), sections={"wide": wide, "slim": slim}, materials={"aluminium": fl.Material(70e9, 2700.0)}
    )
    run = fl.simulate(
        fl.Scene("taper", arm, fl.InitialState(joint_deg=(0.0,)), gravity=(0.0, -9.81, 0.0)), duration=0.02
    )
    film = filmed(run, fps=100.0)
    assert film.points[-1, -1] == pytest.approx(run.tip[-1], abs=1e-12)
    quads, _ = Projected(film).outlines(0)
    sides = np.linalg.norm(quads[:, 0] - quads[:, 3], axis=1), np.linalg.norm(quads[:, 1] - quads[:, 2], axis=1)
    assert sides[0][0] == pytest.approx(0.2)
    assert sides[1][-1] == pytest.approx(0.1)
    assert np.ptp(np.diff(sides[0])) == pytest.approx(0.0, abs=1e-3)


def test_deflections_are_magnified_about_the_straight_arm() -> None:
    run = fl.simulate(hanging(), duration=0.0)
    straight = np.array([1.25, 0.0, 0.0])
    true, large = (filmed(run, magnify=factor).p[0, -1] - straight for factor in (1.0, 5.0))
    assert true == pytest.approx(run.tip[0] - straight, abs=1e-12)
    assert large[1:] == pytest.approx(5 * true[1:], rel=1e-2)


def test_colours_show_the_moments_and_strains_at_the_hinges() -> None:
    scene = hanging().varied({"section.square.width": 0.02})
    run = fl.simulate(scene, duration=0.0)
    moment, strain = (filmed(run, colour=colour).colouring for colour in ("moment", "strain"))
    outline = filmed(run).outline
    at_hinge = (outline.part == 0) & (outline.piece > 0)
    assert np.count_nonzero(at_hinge) == 4
    bending = np.linalg.norm(run.loads.moment[0, :-1, 1:], axis=1)
    assert moment.values[0, at_hinge] == pytest.approx(bending)
    gauges = [
        fl.strength.beam_strain(scene, run.q[0], link="beam", fibre=(y, z)).strain
        for y in (-0.02, 0.02)
        for z in (-0.01, 0.01)
    ]
    assert strain.values[0, at_hinge] == pytest.approx(1e6 * np.max(gauges, axis=0), rel=1e-6)
    assert moment.values[0, -1] == pytest.approx(0.0, abs=1e-9)  # a load at the tip has no lever arm there
    assert moment.label.endswith("[N m]")
    assert strain.label.endswith("[µm/m]")


def test_moments_along_a_bent_spatial_arm_balance_its_loads() -> None:
    """Moments are in axes of the segment outboard of each cut, to which the station at a hinge belongs."""
    run = run_of("t3_spatial", 0.1)
    film = filmed(run)
    starts = np.flatnonzero((film.outline.part == 0) & (film.outline.link > 1))  # link 1 is the waist
    bodies = film.outline.body[starts] - 1
    cuts = run.loads.moment[np.searchsorted(run.t, film.t - 1e-9)]
    assert film.colouring.values[:, starts] == pytest.approx(np.linalg.norm(cuts[:, bodies, 1:], axis=2), rel=1e-9)


def test_magnification_does_not_change_the_loads() -> None:
    run = run_of("t3_spatial", 0.1)
    true, large = (filmed(run, magnify=factor).colouring.values for factor in (1.0, 30.0))
    assert large == pytest.approx(true)


def test_driven_joints_are_not_magnified() -> None:
    rigid = make_scene(
        fl.Link(name="a", length=1.0, material="aluminium", section="square"), gravity=(0.0, 9.81, 0.0)
    ).varied({"initial.joint_deg": (20.0,)})
    run = fl.simulate(rigid, duration=0.05)
    assert (filmed(run, magnify=30.0).p == filmed(run).p).all()


def test_deflections_are_magnified_about_the_angles_at_rest() -> None:
    run = fl.simulate(hanging(), duration=0.0)
    hinges = run.chain.hinges.copy()
    hinges["rest"] = run.q[0]
    slack = replace_chain(run, hinges)
    assert filmed(slack, magnify=5.0).p == pytest.approx(filmed(run).p, abs=1e-12)


def test_the_clamped_end_carries_the_moment_of_the_load() -> None:
    light = hanging(section="square").varied({"material.aluminium.density": 1e-6, "gravity": (0.0, -9.81, 0.0)})
    found = filmed(fl.simulate(light, duration=0.0)).colouring
    lever = fl.simulate(light, duration=0.0).tip[0, 0]
    assert found.values[0, 0] == pytest.approx(2.0 * 9.81 * lever, rel=1e-6)


def test_rigid_links_have_no_strain() -> None:
    found = filmed(run_of("t3_spatial", 0.0), colour="strain")
    waist = found.outline.link == 1
    assert np.isnan(found.colouring.values[:, waist]).all()
    assert np.isfinite(found.colouring.values[:, ~waist]).all()


def test_links_without_section_have_no_colour() -> None:
    run = fl.simulate(fl.load_scene(ROOT / "models" / "two_mass_joint.toml"), duration=0.01)
    assert filmed(run).colouring.largest == 0.0


def test_frame_times_follow_from_fps_and_speed() -> None:
    run = run_of("paper_fig5", 0.2)
    assert filmed(run, fps=50.0, speed=0.5).t == pytest.approx(np.arange(21) * 0.01)
    assert filmed(run, fps=10.0).t == pytest.approx([0.0, 0.1, 0.2])


def test_a_gif_lasts_as_long_as_the_run_and_moves(tmp_path: Path) -> None:
    done: list[float] = []
    path = run_of("paper_fig5", 0.3).animate(tmp_path / "arm.gif", width=320, fps=10.0, progress=done.append)
    with Image.open(path) as film:
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
        assert film.info["duration"] == 100
    assert len(frames) == 4
    assert done[0] == 0.0
    assert done[-1] == 1.0
    assert frames[0].shape[1] == 320
    assert (frames[0] != frames[-1]).any()


def test_no_part_of_the_arm_is_drawn_beyond_the_edge_of_the_picture(tmp_path: Path) -> None:
    path = run_of("steel_strips", 0.3).animate(tmp_path / "arm.gif", width=320, fps=10.0)
    with Image.open(path) as film:
        for frame in ImageSequence.Iterator(film):
            pixels = np.asarray(frame.convert("L"))
            assert pixels[:, :8].min() > 240
            assert pixels[:, -8:].min() > 240


@pytest.mark.parametrize(
    "kind", ["gif", pytest.param("mp4", marks=pytest.mark.skipif(not FFMPEG, reason="needs ffmpeg"))]
)
def test_a_signal_stops_the_drawing_and_leaves_the_old_file(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"arm.{kind}"
    path.write_text("before")

    def send(part: float) -> None:
        if part > 0:
            signal.raise_signal(signal.SIGINT)

    with refused(KeyboardInterrupt, "test-pictures"):
        run_of("paper_fig5", 0.3).animate(path, width=320, progress=send)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "before"


@pytest.mark.slow
@pytest.mark.skipif(not FFMPEG, reason="needs ffmpeg")
def test_a_video_has_every_frame(tmp_path: Path) -> None:
    path = run_of("t3_spatial", 0.1).animate(tmp_path / "arm.mp4", width=321, fps=50.0)
    subprocess.run([str(FFMPEG), "-loglevel", "error", "-i", path, tmp_path / "%d.png"], check=True)
    assert len(list(tmp_path.glob("*.png"))) == 6
    with Image.open(tmp_path / "6.png") as last:
        assert last.size[0] == 322


def test_a_film_without_ffmpeg_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused(fl.errors.MissingDependencyError, "package-missing"):
        run_of("paper_fig5", 0.0).animate(tmp_path / "arm.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not shutil.which("false"), reason="needs the program false")
def test_no_file_remains_of_a_video_that_ffmpeg_refuses(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "ffmpeg").symlink_to(str(shutil.which("false")))
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused(fl.errors.EngineError, "ffmpeg-failed"):
        run_of("paper_fig5", 0.0).animate(tmp_path / "arm.mp4")
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"path": "arm.avi"}, "unknown-format"),
        ({"magnify": -1.0}, "out-of-range"),
        ({"colour": "stress"}, "unknown-name"),
        ({"fps": 0.0}, "out-of-range"),
        ({"speed": 1e-6}, "too-many-frames"),
        ({"width": 10}, "out-of-range"),
        ({"progress": 3}, "wrong-type"),
    ],
)
def test_an_invalid_option_is_refused_and_named(options, message, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = run_of("paper_fig5", 0.01)
    with refused(fl.errors.ArgumentError, message):
        run.animate(**{"path": "arm.gif", **options})
    assert list(tmp_path.iterdir()) == []


def test_the_smallest_speed_that_the_message_names_is_allowed(monkeypatch) -> None:
    monkeypatch.setattr("flexlink.results.pictures.film.MOST_FRAMES", 20)
    run = run_of("paper_fig5", 0.01)
    with pytest.raises(fl.errors.ArgumentError) as refused:
        filmed(run, speed=1e-6)
    named = float(str(refused.value).split("at least ")[1].split(",")[0])
    assert len(filmed(run, speed=named).t) == 20


def test_a_run_without_a_scene_cannot_be_drawn(tmp_path: Path) -> None:
    run = run_of("paper_fig5", 0.0)
    bare = fl.Trajectory(run.chain, run.t, run.q, run.qd, run.tau, run.tip, run.energy)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        bare.animate(tmp_path / "arm.gif")


def test_a_run_stores_its_scene_with_the_settings_used() -> None:
    scene = scene_of("paper_fig5")
    run = fl.simulate(scene, duration=0.01)
    assert run.scene == replace(scene, run=replace(scene.run, duration=0.01))
    many = fl.simulate_many([run.scene, run.scene.varied({"tip.mass": 1.0})])
    assert [one.scene.arm.tip.mass for one in many if one.scene] == [0.0, 1.0]


def test_the_command_writes_the_film(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    scene = str(ROOT / "models" / "paper_fig5.toml")
    assert main(["show", scene, "--duration", "0.05", "--magnify", "20", "--colour", "strain"]) == 0
    name = "paper_fig5.html"
    assert capsys.readouterr().out == f"film: {name}\n"
    assert "deflections × 20" in (tmp_path / name).read_text(encoding="utf-8")
    monkeypatch.setattr("flexlink.cli.show.simulate", None)  # options are checked before the simulation
    for wrong in (
        ["--speed", "1e-9"],
        ["-o", "arm.avi"],
        ["-o", "nowhere/arm.gif"],
        ["--colour", "red"],
        ["--fps", "-1"],
    ):
        assert main(["show", scene, "--duration", "0.05", *wrong]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_the_arm_of_the_readmes_first_picture_visibly_bends() -> None:
    run = run_of("steel_strips", 0.5)
    film = filmed(run)
    for number, link in enumerate(scene_of("steel_strips").arm.links, start=1):
        points = film.points[:, film.outline.link == number]
        root = points[:, 1] - points[:, 0]
        root /= np.linalg.norm(root, axis=1, keepdims=True)
        whole = points[:, -1] - points[:, 0]
        off = np.linalg.norm(whole - (whole * root).sum(axis=1, keepdims=True) * root, axis=1)
        assert off.max() > 0.1 * link.length


@pytest.mark.slow
def test_the_readmes_first_picture_is_small_and_made_by_its_command(tmp_path: Path, monkeypatch) -> None:
    picture = ROOT / "docs" / "steel_strips.gif"
    assert picture.stat().st_size <= 400_000
    text = (ROOT / "docs/development/commands.md").read_text(encoding="utf-8")
    command = next(line for line in text.splitlines() if line.startswith("flexlink show docs/steel_strips.toml"))
    words = command.split()[1:]
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    (tmp_path / "docs" / "steel_strips.gif").unlink()
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--duration", "0.2"]) == 0
    with Image.open(tmp_path / "docs" / "steel_strips.gif") as made, Image.open(picture) as kept:
        assert made.size[0] == kept.size[0]
        assert made.info["duration"] == kept.info["duration"]


DESK, PHONE = (1280, 800), (390, 844)
BEYOND = """
const beyond = []
for (const angle of film.spatial ? [-180, -120, -60, 0, 60, 120] : [0]) {
  turn.value = angle; turned()
  for (let k = 0; k < frames; k++) {
    const all = bodies(k)
    film.body.map((b, s) => pixel(placed(all[b], at(place, s)))).forEach(([x, y]) => {
      if (!(x > 4 && x < canvas.width - 4 && y > 4 && y < canvas.height - 4)) beyond.push([angle, k, x, y])
    })
  }
}
return beyond
"""
INK = """
const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data
let drawn = 0
for (let i = 3; i < data.length; i += 4) drawn += data[i] > 128
return drawn
"""
LABEL, CLOCK = "return play.textContent", "return one('.clock').textContent"
PLAYING, SEEN = "return running !== null", "return canvas.toDataURL()"
WIDTH, LEGEND = "return document.documentElement.scrollWidth", "return one('.legend').getBoundingClientRect().bottom"
VIOLATIONS = "const done = arguments[0]; axe.run().then(found => done(found.violations.map(v => v.id)))"


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    films = {}
    for name in ("paper_fig5", "t3_spatial"):
        run = fl.simulate(fl.load_scene(ROOT / "models" / f"{name}.toml"), duration=0.4)
        films[name] = run.animate(folder / f"{name}.html", magnify=10.0)
    return films


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
@pytest.mark.parametrize("name", ["paper_fig5", "t3_spatial"])
def test_the_arm_is_within_its_canvas_and_nothing_is_wider_than_the_screen(name, size, window, pages) -> None:
    window.open(pages[name], *size)
    assert window.run(BEYOND) == []
    assert window.run(INK) > 1000
    assert window.run(WIDTH) <= size[0]
    assert window.run(LEGEND) <= size[1]


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
def test_the_player_plays_stops_and_follows_the_slider(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *PHONE)
    assert window.run(LABEL) == "Pause"  # it starts playing
    window.run("play.click()")
    assert window.run(LABEL) == "Play"
    window.run("slider.value = 5; slider.dispatchEvent(new Event('input'))")
    assert window.run(CLOCK) == "t = 0.20 s"
    spoken = window.run("return slider.getAttribute('aria-valuetext')")
    assert spoken == "0.20 seconds"
    window.run("play.focus(); play.click()")
    playing = window.run(f"{PLAYING} && document.activeElement === play")
    assert playing


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
def test_the_player_works_without_a_mouse(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *DESK)
    stops = "[...document.querySelectorAll('button, input')].filter(e => e.checkVisibility() && e.tabIndex >= 0)"
    assert window.run(f"return {stops}.length") == 3
    window.run("document.activeElement.blur()")
    before = window.run(PLAYING)
    window.run("document.body.dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}))")
    assert window.run(PLAYING) != before


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
def test_turning_the_view_changes_the_picture(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *DESK)
    window.run("stop(); slider.value = 3; show()")
    seen = window.run(SEEN)
    window.run("turn.value = 90; turn.dispatchEvent(new Event('input'))")
    assert window.run(SEEN) != seen
    spoken = window.run("return turn.getAttribute('aria-valuetext')")
    assert spoken == "90 degrees"


@pytest.mark.slow
@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
@pytest.mark.skipif(axe() is None, reason="needs axe-core")
def test_the_page_is_accessible(window: Browser, pages: dict[str, Path]) -> None:
    for page in pages.values():
        window.open(page, *PHONE)
        found = axe()
        assert found is not None
        window.run(found.read_text(encoding="utf-8"))
        assert window.run_async(VIOLATIONS) == []
