"""Solid pictures of a film, and MuJoCo's viewer: shapes of a robot's own file, and the arm's tubes and bars.

MuJoCo reads the robot's shapes and draws; it computes no motion. Shapes move with the bodies of the imported arm,

    T_shape(q) = T_body(q) T_body(0)⁻¹ T_shape(0)        0: moving joints at zero, springs unloaded

with the body after their joint or, as those of a tool without a joint, with the end of the link before it.
"""

import contextlib
import importlib
import itertools
import math
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import to_rgba

from flexlink.chain.chain import Chain
from flexlink.chain.layout import base_body
from flexlink.chain.lumping import open_chain, pieces
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError, Diagnostic, EngineError, imported
from flexlink.common.types import Array, Indices
from flexlink.common.wording import short_list
from flexlink.data.documents import read_regular
from flexlink.describe.scene import Scene
from flexlink.results.pictures.drawing import GREY, Drawing, colours_of
from flexlink.results.pictures.film import Film, placed
from flexlink.results.pictures.projection import Projected
from flexlink.results.pictures.view import level
from flexlink.results.samples import RunSamples

SEEN = 0  # group of geoms that are drawn


class Shapes(NamedTuple):
    """A robot's shapes: MuJoCo's description of them and, for each geom, the body that carries it."""

    spec: Any
    body: Indices  # (g,), 0 is the fixed base
    bends: Indices  # those of links that bend, as indices of geoms
    R: Array  # (g, 3, 3), orientations in the bodies' frames
    p: Array  # (g, 3), positions there [m]
    corners: Array  # (seen, 8, 3) of boxes around the shapes that are drawn, in the frames of their bodies [m]
    boxed: Indices  # (seen,) these bodies


def shapes_of(path: Path, scene: Scene, chain: Chain) -> Shapes:
    """Shapes of the URDF or MJCF file from which a scene was imported."""
    mujoco = imported("mujoco", "meshes are read and drawn by MuJoCo;", "engines")
    spec, model = _compiled(mujoco, path)
    seen = np.flatnonzero(model.geom_group == SEEN)
    if not len(seen):
        why = f"{path}: has no shape that MuJoCo reads (.stl, .obj); convert its meshes, or leave them out"
        raise DataFileError(why, id="no-shapes")
    data, links = mujoco.MjData(model), scene.arm.links
    of_link = {link.name: k for k, link in enumerate(links, 1)}
    of_joint = {link.joint_name: k for k, link in enumerate(links, 1)}
    first, last = {0: base_body(chain)}, {0: base_body(chain)}
    for piece in pieces(open_chain(scene)):
        first.setdefault(piece.link, piece.body)
        last[piece.link] = piece.body
    link, own = [0], [False]  # of each body, or of the body that it is fixed to
    for b, parent in enumerate(model.body_parentid[1:], 1):
        joint = int(model.body_jntadr[b])
        known = of_joint.get(model.joint(joint).name, 0) if joint >= 0 else 0
        known = known or of_link.get(model.body(b).name, 0)
        link.append(known or link[parent])
        own.append(bool(known))
        if joint >= 0 and known and links[known - 1].joint.locked:
            data.qpos[model.jnt_qposadr[joint]] += scene.joint_positions[known - 1]
    if not any(own):
        why = f"no joint of the file is in the scene, which has {short_list([each.joint_name for each in links])}"
        raise ArgumentError(f"{path}: {why}; expected the file from which it was imported", id="other-robot")
    mujoco.mj_kinematics(model, data)
    q = chain.rest.copy()
    q[chain.active] = 0.0
    R, p = (part[0] for part in placed(chain, q[None]))
    moving = [(b, int(model.body_jntadr[b])) for b, k in enumerate(link) if own[b] and not links[k - 1].joint.locked]
    off = [math.dist(p[first[link[b]]], data.xanchor[joint]) for b, joint in moving if joint >= 0]
    if max(off, default=0.0) > 0.01 * chain.reach:
        why = f"its joints are up to {max(off):.3g} m from those of the scene when all are at zero"
        raise ArgumentError(f"{path}: {why}; import the scene again from this file, without `locked`", id="other-robot")
    geoms = model.geom_bodyid.tolist()
    body = np.array([(first if own[b] else last)[link[b]] for b in geoms], dtype=np.int64)
    bends = np.array([g for g, b in enumerate(geoms) if own[b] and first[link[b]] != last[link[b]]], dtype=np.int64)
    of_shape, there = data.geom_xmat.reshape(-1, 3, 3), np.swapaxes(R[body], 1, 2)
    turned, placed_at = there @ of_shape, np.einsum("gij,gj->gi", there, data.geom_xpos - p[body])
    middles, halves = np.swapaxes(model.geom_aabb[seen].reshape(-1, 2, 3), 0, 1)
    boxes = middles[:, None] + halves[:, None] * np.array([*itertools.product((-1, 1), repeat=3)])
    corners = placed_at[seen, None] + np.einsum("gij,gkj->gki", turned[seen], boxes)
    return Shapes(spec, body, bends, turned, placed_at, corners, body[seen])


def _compiled(mujoco: Any, path: Path) -> tuple[Any, Any]:
    """MuJoCo's description of a robot, and the model that it compiles from it."""
    heard = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)  # its warnings would go to a file in the current folder
    try:
        spec = _specification(mujoco, path)
        return spec, spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        if isinstance(error, DataFileError):
            raise
        why = " ".join(str(error).split())
        raise DataFileError(f"{path}: MuJoCo cannot load the file: {why}", id="engine-cannot-load") from None
    finally:
        mujoco.set_mju_user_warning(heard)


def _specification(mujoco: Any, path: Path) -> Any:
    """MuJoCo's description of a robot; shapes that are meant to be seen are in the group `SEEN`, others are not."""
    data = read_regular(path, largest=safe_xml.LARGEST, error=DataFileError)
    root = safe_xml.parse(data, str(path), namespaces=False)
    if root.tag == "robot":
        spec = mujoco.MjSpec.from_string(_with_meshes(root, path))
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # meshes may be open
        for geom in spec.geoms:
            geom.group = SEEN
        return spec
    spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies:
        touching = [bool(geom.contype or geom.conaffinity) for geom in body.geoms]
        for geom, touches in zip(body.geoms, touching, strict=True):
            hidden = geom.type == mujoco.mjtGeom.mjGEOM_PLANE or (touches and not all(touching))
            geom.group = SEEN + hidden
    return spec


def _with_meshes(root: ET.Element, path: Path) -> str:
    """Text of a URDF file with the paths of its meshes; of a link's shapes the visual ones, if they can be read."""
    bare = []
    for link in root.iter("link"):
        for inertial in link.findall("inertial"):  # not needed, and refused by MuJoCo where it is not exact
            link.remove(inertial)
        shapes = [*link.findall("visual"), *link.findall("collision")]
        for shape in shapes:
            shape.attrib.clear()  # of its name, which may be that of another shape
            files = [(mesh, _located(path, mesh.get("filename", ""))) for mesh in shape.iter("mesh")]
            if any(file is None or file.suffix.lower() not in {".stl", ".obj"} for _, file in files):
                link.remove(shape)
            for mesh, file in files:
                mesh.set("filename", str(file))
        for shape in link.findall("collision") if link.find("visual") is not None else ():
            link.remove(shape)
        if shapes and link.find("visual") is None and link.find("collision") is None:
            bare.append(link.get("name", ""))
    if bare:
        text = f"{path}: no shape of {short_list(bare)} can be read (.stl, .obj); not drawn"
        warnings.warn(Diagnostic(text, "shapes-not-drawn"), RuntimeWarning, stacklevel=5)
    for own in root.findall("mujoco"):  # MuJoCo reads one
        root.remove(own)
    options = {"strippath": "false", "fusestatic": "false", "discardvisual": "false", "balanceinertia": "true"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", options, boundmass="1e-6", boundinertia="1e-9")
    return ET.tostring(root, encoding="unicode")


def _located(path: Path, name: str) -> Path | None:
    """File of a mesh that is named as package://PACKAGE/PLACE, as file://PLACE or relative to the robot's file."""
    parts = Path(name.partition("://")[2] or name).parts
    folders = [path.resolve().parent, *path.resolve().parents]
    found = (folder.joinpath(*parts[k:]) for k in range(len(parts)) for folder in folders)  # complete names first
    return next((file for file in found if file.is_file()), None)


class Rendering(Drawing):
    """The picture of a film with solid shapes instead of outlines; texts, path of the tip and shadow are the same."""

    marks = ()

    def __init__(self, film: Film, width: int, shapes: Shapes) -> None:
        self._shapes = shapes
        R, p = film.R[:, shapes.boxed], film.p[:, shapes.boxed, None]
        super().__init__(film, width, p + np.einsum("fgij,gkj->fgki", R, shapes.corners))

    def _arm(self) -> tuple[tuple[Artist, ...], tuple[Artist, ...]]:
        right, up, eye = self.film.view.axes
        self._solid = solid = Solid(self.film, self._shapes, np.array([right, -eye, up]))
        window, size = self.window, (self.scene_height, self.size[0])
        look = solid.model.vis.global_
        look.fovy, (look.offheight, look.offwidth) = window.top - window.bottom, size
        solid.camera.orthographic, solid.camera.azimuth, solid.camera.elevation = 1, 90.0, 0.0
        solid.camera.distance, middle = 5 * self.film.reach, float((self.film.bodies @ -eye).mean())
        solid.camera.lookat[:] = (window.left + window.right) / 2, middle, (window.bottom + window.top) / 2
        try:
            self._memory = _memory(solid, *size)
        except Exception as error:  # each system of windows raises its own
            why = f"MuJoCo cannot draw: {error}; set MUJOCO_GL=egl, or leave out the meshes"
            raise EngineError(why, id="cannot-render") from None
        blank = np.zeros((*size, 4), np.uint8)
        self._picture = self.axes.imshow(blank, extent=tuple(window), interpolation="nearest", animated=True)
        return (self._picture,), ()

    def _place_arm(self, k: int) -> None:
        mujoco, scene, memory = self._solid.mujoco, self._solid.placed(k), self._memory[1]
        image = np.zeros((self.scene_height, self.size[0], 3), np.uint8)
        frame = mujoco.MjrRect(0, 0, *image.shape[1::-1])
        self._memory[0].make_current()  # another film may have been drawn meanwhile
        mujoco.mjr_render(frame, scene, memory)
        mujoco.mjr_readPixels(image, None, frame, memory)
        seen = (image < 255).any(axis=2, keepdims=True)  # the background is white
        self._picture.set_data(np.concatenate([image, np.where(seen, 255, 0).astype(np.uint8)], axis=2)[::-1])


def _memory(solid: "Solid", height: int, width: int) -> tuple[Any, Any]:
    """Memory into which MuJoCo draws, and the system of windows that keeps it; EGL without a screen that opens."""
    chosen, linux = os.environ.get("MUJOCO_GL", ""), sys.platform == "linux"
    if not chosen and linux and os.environ.get("DISPLAY"):
        with contextlib.suppress(Exception), warnings.catch_warnings(action="ignore"):
            return _memory_of("mujoco.gl_context", solid, height, width)
    systems = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa", "": "mujoco.egl" if linux else "mujoco.gl_context"}
    return _memory_of(systems.get(chosen, "mujoco.gl_context"), solid, height, width)


def _memory_of(name: str, solid: "Solid", height: int, width: int) -> tuple[Any, Any]:
    system = importlib.import_module(name).GLContext(width, height)
    system.make_current()
    memory = solid.mujoco.MjrContext(solid.model, solid.mujoco.mjtFontScale.mjFONTSCALE_100)
    solid.mujoco.mjr_setBuffer(solid.mujoco.mjtFramebuffer.mjFB_OFFSCREEN, memory)
    return system, memory


class Solid:
    """MuJoCo's model of a film: shapes of the robot's file, tubes and bars for links with sections, the payload."""

    def __init__(self, film: Film, shapes: Shapes, axes: Array) -> None:
        """`axes` (3, 3) are those of MuJoCo's world, whose z points up, in frame 0."""
        self.mujoco = mujoco = imported("mujoco", "meshes are read and drawn by MuJoCo;", "engines")
        self.film, self.shapes, self.axes, outline, projected = film, shapes, axes, film.outline, Projected(film)
        self.spans, own, spec, kinds = projected.spans, list[Any](), shapes.spec.copy(), mujoco.mjtGeom
        half = np.linalg.norm(np.diff(film.points[0], axis=0)[self.spans], axis=1) / 2
        across = np.maximum(outline.across, projected.thinnest[0])[self.spans]
        for (a, b), h, is_round in zip(across, half, outline.round[self.spans], strict=True):
            kind, size = (kinds.mjGEOM_CAPSULE, [a, h, 0]) if is_round else (kinds.mjGEOM_BOX, [a, b, h])
            own.append(spec.worldbody.add_geom(type=kind, size=size))
        ball = [projected.ball_radius or 1e-9, 0, 0]
        own.append(spec.worldbody.add_geom(type=kinds.mjGEOM_SPHERE, size=ball, rgba=to_rgba(GREY)))
        for direction in ((0.3, 1.0, -0.8), (-0.8, 0.5, -0.3)):
            spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=direction, diffuse=[0.3] * 3)
        sky, flat = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_FLAT
        for texture in [each for each in spec.textures if each.type == sky]:
            spec.delete(texture)
        spec.add_texture(type=sky, builtin=flat, rgb1=[1] * 3, rgb2=[1] * 3, width=8, height=8)
        spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.25] * 3
        self.model = spec.compile()
        self.data, self.own = mujoco.MjData(self.model), np.array([geom.id for geom in own])
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self.model.stat.extent, self.model.stat.center[:] = film.reach, axes @ film.bodies.mean(axis=(0, 1))
        self.of_file = np.setdiff1d(np.arange(self.model.ngeom), self.own)
        seen_through, of = self.of_file[shapes.bends], self.model.geom_matid
        painted = seen_through[of[seen_through] >= 0]
        self.model.geom_rgba[painted] = self.model.mat_rgba[of[painted]]
        self.model.geom_rgba[seen_through, 3] *= 0.35  # so that the beam inside is seen
        self.model.vis.map.znear, self.model.vis.map.zfar = 0.01, 50.0
        self.scene, self.options = mujoco.MjvScene(self.model, 10_000), mujoco.MjvOption()
        self.camera, self.options.geomgroup[:] = mujoco.MjvCamera(), np.arange(6) == SEEN
        self.options.sitegroup[:] = self.options.tendongroup[:] = 0  # MuJoCo placed them

    def placed(self, k: int) -> Any:
        """MuJoCo's scene with all shapes placed and coloured as in frame k."""
        film, V = self.film, self.axes
        R, p = film.R[k, self.shapes.body], film.p[k, self.shapes.body]
        of_file = R @ self.shapes.R, p + np.einsum("gij,gj->gi", R, self.shapes.p)
        ends, across = film.points[k], film.axes[k, self.spans]  # y and z of the sections
        along = np.diff(ends, axis=0)[self.spans]
        frames = np.stack([*np.moveaxis(across, 1, 0), along / np.linalg.norm(along, axis=1, keepdims=True)], axis=-1)
        middles = np.concatenate([ends[self.spans] + along / 2, film.ball[k][None]])
        own = np.concatenate([frames, np.eye(3)[None]]), middles
        for where, (R, p) in ((self.of_file, of_file), (self.own, own)):
            self.data.geom_xpos[where], self.data.geom_xmat[where] = p @ V.T, (V @ R).reshape(-1, 9)
        self.model.geom_rgba[self.own[:-1]] = colours_of(film, self.spans, k)
        every = self.mujoco.mjtCatBit.mjCAT_ALL
        self.mujoco.mjv_updateScene(self.model, self.data, self.options, None, self.camera, every, self.scene)
        return self.scene


def view(run: RunSamples, film: Film, meshes: Path) -> None:
    """Play a film in MuJoCo's viewer, again and again, until its window is closed."""
    viewer, v = imported("mujoco.viewer", "the viewer is MuJoCo's;", "engines"), film.view.vertical
    assert run.scene is not None
    shapes, begun = shapes_of(meshes, run.scene, run.chain), time.perf_counter()
    solid = Solid(film, shapes, np.array([level(v), np.cross(v, level(v)), v]))
    parts = "type dataid objtype objid category matid size pos mat rgba specular shininess transparent modelrbound"
    with viewer.launch_passive(solid.model, solid.data, show_left_ui=False, show_right_ui=False) as window:
        window.opt.sitegroup[:] = window.opt.geomgroup[:] = 0  # shown are copies of the shapes placed here
        while window.is_running():
            scene = solid.placed(int((time.perf_counter() - begun) * film.fps) % len(film.t))
            with window.lock():
                window.user_scn.ngeom = scene.ngeom
                for shown, geom in zip(window.user_scn.geoms[: scene.ngeom], scene.geoms, strict=False):
                    for part in parts.split():
                        setattr(shown, part, getattr(geom, part))
            window.sync()
            time.sleep(1 / film.fps)
