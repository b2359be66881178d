"""Frames of a film of a run: positions of all parts of the arm at equidistant times."""

import dataclasses

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import frames
from flexlink.results.pictures.colouring import Colour, Colouring, colouring
from flexlink.results.pictures.outline import Outline, outline_of
from flexlink.results.pictures.view import View, view_of
from flexlink.results.samples import RunSamples, picked

MOST_FRAMES = 3000  # about two minutes of film; a GIF with more frames would not fit into memory


@dataclasses.dataclass(frozen=True, eq=False)
class Film:
    """An arm in motion, in frame 0; body 0 is the fixed base, the last body the tip frame."""

    name: str  # of the chain
    about: str  # the scene's description
    magnify: float  # magnification of the deflections
    speed: float  # seconds of the run per second of the film
    fps: float  # frames per second of the film
    outline: Outline
    view: View
    colouring: Colouring
    t: Array  # (f,) time of each frame in the run [s]
    R: Array  # (f, b, 3, 3) rotations of the bodies
    p: Array  # (f, b, 3) their origins [m]
    trace: Array  # (m, 3) path of the tip [m]
    trace_t: Array  # (m,) its times [s]

    @property
    def bodies(self) -> Array:
        """Origins of all bodies of the arm, from the base outward, followed by `rails`, shape (f, ·, 3) [m]."""
        return np.concatenate([self.p[:, self.outline.base :], self.rails], axis=1)

    @property
    def points(self) -> Array:
        """Stations of the outline in frame 0, shape (f, s, 3) [m]."""
        body = self.outline.body
        return np.asarray(self.p[:, body] + np.einsum("fsij,sj->fsi", self.R[:, body], self.outline.place))

    @property
    def rails(self) -> Array:
        """Zero positions of sliding joints in frame 0, shape (f, r, 3) [m]."""
        body, place = self.outline.rails
        return np.asarray(self.p[:, body] + np.einsum("frij,rj->fri", self.R[:, body], place))

    @property
    def axes(self) -> Array:
        """Axes y and z of the section at every station, in frame 0, shape (f, s, 2, 3)."""
        return np.asarray(np.einsum("fsij,saj->fsai", self.R[:, self.outline.body], self.outline.axes))

    @property
    def ball(self) -> Array:
        """Centre of the payload in frame 0, shape (f, 3) [m]."""
        return np.asarray(self.p[:, -1] + self.R[:, -1] @ self.outline.center)

    @property
    def reach(self) -> float:
        """Length of the arm [m], the reference for the size of small parts."""
        length = sum(piece.length for piece in self.outline.pieces)
        return length or float(np.ptp(self.bodies, axis=(0, 1)).max()) or 1.0


def film_of(run: RunSamples, *, magnify: float, colour: Colour, fps: float, speed: float) -> Film:
    """Film of a run with a frame every `speed`/`fps` seconds of the run; each frame shows the nearest sample."""
    if run.scene is None or not len(run.t):
        what = "scene = None: a film needs the scene of" if len(run.t) else "samples = 0: a film needs samples of"
        raise ArgumentError(f"{what} {run.chain.name!r}; expected a run of `simulate`", id="wrong-type")
    run.warn_of_vibrations()  # the colours show loads
    scene: Scene = run.scene
    wanted = run.t[0] + np.arange(frame_count(float(run.t[-1] - run.t[0]), fps, speed)) * speed / fps
    after = np.clip(np.searchsorted(run.t, wanted), min(1, len(run.t) - 1), len(run.t) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.asarray(np.where(wanted - run.t[before] < run.t[after] - wanted, before, after))
    shown = picked(run, rows)
    bent, rest, passive = run.q.copy(), run.chain.rest, np.array([c.link > 0 for c in run.chain.coordinates])
    passive[run.chain.active] = False
    bent[:, passive] = rest[passive] + magnify * (run.q[:, passive] - rest[passive])
    along = np.unique(np.linspace(0, len(run.t) - 1, min(len(run.t), 1500)).round().astype(int))
    R, p = placed(run.chain, bent[rows])
    outline = outline_of(scene, run.chain)
    true = (R, p) if magnify == 1 else placed(run.chain, run.q[rows])
    trace = frames(run.chain, bent[along]).points[:, -1]
    found = colouring(colour, scene.arm, outline, true, shown)
    about, view = (run.chain.name, scene.about, magnify, speed, fps), view_of(run.chain)
    return Film(*about, outline, view, found, shown.t, R, p, trace, run.t[along])


def frame_count(lasts: float, fps: float, speed: float) -> int:
    """Number of frames in the film of a run that lasts `lasts` [s], at most `MOST_FRAMES`."""
    count = 1 + int(lasts * fps / speed + 1e-6)
    if count > MOST_FRAMES:
        text = f"fps = {fps:g}, speed = {speed:g}: {count} frames for {lasts:g} s, more than {MOST_FRAMES}; use a "
        text += f"speed of at least {1.01 * lasts * fps / MOST_FRAMES:.3g}, or a lower fps"
        raise ArgumentError(text, id="too-many-frames")
    return count


def placed(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Rotations and origins of the base and the bodies."""
    placed = frames(chain, q)
    base = np.broadcast_to(np.eye(3), (len(q), 1, 3, 3)), np.zeros((len(q), 1, 3))
    return np.concatenate([base[0], placed.rotations], axis=1), np.concatenate([base[1], placed.points], axis=1)
