"""Film of a run in a file: arguments are checked, frames are drawn, and a GIF, a video or an HTML page is written."""

from __future__ import annotations

import base64
import contextlib
import html
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from importlib.resources import files
from pathlib import Path
from types import ModuleType
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, positive, require_callable, require_one_of
from flexlink.common.errors import ArgumentError, EngineError, MissingDependencyError, imported
from flexlink.common.interruption import StoppedError, deferred, word
from flexlink.common.output import write_or_keep
from flexlink.common.types import Array
from flexlink.data.documents import require_path
from flexlink.results.files import ending
from flexlink.results.pictures import projection
from flexlink.results.pictures.colouring import STOPS, UNKNOWN, Colour
from flexlink.results.pictures.film import Film, film_of
from flexlink.results.pictures.projection import Projected, floor_level, thickest

if TYPE_CHECKING:
    from flexlink.results.pictures.drawing import Drawing
    from flexlink.results.samples import RunSamples

    Base = Path
else:
    Base = type(Path())  # before Python 3.12 only the class of this system's paths can be subclassed

Progress = Callable[[float], None]

FORMATS = (".gif", ".mp4", ".html")
COLOURS: dict[str, Colour] = {"moment": "moment", "strain": "strain"}


class PlayedPath(Base):
    """Path of a film, which a notebook plays if it is the value of a cell."""

    def _repr_html_(self) -> str | None:
        # largest file that a cell embeds [bytes]
        if not self.is_file() or self.stat().st_size > 20_000_000:
            return None  # the notebook shows the path
        if self.suffix == ".html":
            text = html.escape(self.read_text(encoding="utf-8"))
            return f'<iframe srcdoc="{text}" width="100%" height="640" style="border: 0"></iframe>'
        data = base64.b64encode(self.read_bytes()).decode()
        if self.suffix == ".mp4":
            return f'<video controls loop style="max-width: 100%" src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="{html.escape(self.name)}" style="max-width: 100%" src="data:image/gif;base64,{data}">'


class Shot(NamedTuple):
    """Checked arguments of `Trajectory.animate`."""

    path: Path
    magnify: float
    colour: Colour
    fps: float
    speed: float
    width: int
    meshes: Path | None


def shot(
    path: str | Path,
    *,
    magnify: float,
    colour: str,
    fps: float,
    speed: float,
    width: int,
    meshes: str | Path | None = None,
) -> Shot:
    """Check the arguments; errors as in `Trajectory.animate`."""
    path = require_path("path", path)
    ending(path, FORMATS, "a film")
    if path.suffix != ".html":
        drawing_room()
    if path.suffix == ".mp4":
        require_ffmpeg()
    fps, width = positive("fps", fps), integer("width", width, 320, 3840)
    if path.suffix == ".gif":
        ticks = 100  # per second; a GIF shows each frame for an integer number of ticks
        fps = ticks / max(round(ticks / fps), 2)
    magnify, speed = positive("magnify", magnify), positive("speed", speed)
    width += width % 2  # a video needs an even width
    if meshes is not None and path.suffix == ".html":
        raise ArgumentError(
            f"meshes = {str(meshes)!r}: a page draws no meshes; use .gif or .mp4", id="page-with-meshes"
        )
    robot = None if meshes is None else require_path("meshes", meshes)
    return Shot(path, magnify, require_one_of("colour", colour, COLOURS), fps, speed, width, robot)


def animate(run: RunSamples, wanted: Shot, progress: Progress | None = None) -> PlayedPath:
    """Draw the specified film of a run and write it to its file; errors as in `Trajectory.animate`."""
    require_callable("progress", progress)
    report, path = progress or (lambda _: None), wanted.path
    film = film_of(run, magnify=wanted.magnify, colour=wanted.colour, fps=wanted.fps, speed=wanted.speed)
    drawing = None if path.suffix == ".html" else drawing_of(run, film, wanted)
    report(0.0)

    def pulse(part: float) -> None:
        report(part)
        if stop.signal is not None:
            raise StoppedError(stop.signal, f"{path}: {word(stop.signal)}, not written")

    with deferred() as stop:
        write_or_keep(path, lambda place: _write(film, drawing, place, wanted, pulse))
    return PlayedPath(path)


def drawing_room(name: str = "drawing") -> ModuleType:
    """The module that draws outlines, or `solid` shapes."""
    return imported(f"flexlink.results.pictures.{name}", "a film needs matplotlib; use .html, or", "report")


def drawing_of(run: RunSamples, film: Film, wanted: Shot) -> Drawing:
    """The pictures of a film, with solid shapes if a robot's file with meshes is given."""
    if wanted.meshes is None or run.scene is None:
        flat: Drawing = drawing_room().Drawing(film, wanted.width)
        return flat
    room = drawing_room("solid")
    solid: Drawing = room.Rendering(film, wanted.width, room.shapes_of(wanted.meshes, run.scene, run.chain))
    return solid


def _write(film: Film, drawing: Drawing | None, place: Path, wanted: Shot, report: Progress) -> None:
    if drawing is None:
        place.write_bytes(page(film, wanted.width).encode())
        report(1.0)
        return
    count = len(film.t)

    def images() -> Iterator[Image]:
        for k in range(count):
            yield drawing.image(k)
            report((k + 1) / count)

    if wanted.path.suffix == ".mp4":
        write_mp4(place, images(), drawing.size, film.fps)
    else:
        like = [drawing.image(int(k)) for k in np.linspace(0, count - 1, 6)]
        write_gif(place, images(), like, round(1000 / film.fps))


Image = NDArray[np.uint8]


def write_gif(place: Path, images: Iterable[Image], like: Iterable[Image], milliseconds: int) -> None:
    """Write frames (height, width, 3), each shown for this time, as an endless GIF with one palette, that of `like`."""
    from PIL import Image as Pillow  # noqa: PLC0415  needed only for drawing

    palette = Pillow.fromarray(np.concatenate(list(like))).quantize(256, dither=Pillow.Dither.NONE)
    frames = (Pillow.fromarray(image).quantize(palette=palette, dither=Pillow.Dither.NONE) for image in images)
    first = next(frames)
    first.save(place, format="GIF", save_all=True, append_images=frames, duration=milliseconds, loop=0, optimize=False)


def require_ffmpeg() -> str:
    """Path of the program ffmpeg, which must be installed."""
    found = shutil.which("ffmpeg")
    if found is None:
        text = "an .mp4 needs the program ffmpeg, which is not on the PATH; install it (ffmpeg.org, or your system's "
        raise MissingDependencyError(f"{text}package ffmpeg), or use .gif or .html", id="package-missing")
    return found


def write_mp4(place: Path, images: Iterable[Image], size: tuple[int, int], fps: float) -> None:
    """Write frames of shape (height, width, 3), height and width even, as H.264, which every browser plays."""
    width, height = size
    command = [
        require_ffmpeg(), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
        "-r", f"{fps:.6f}", "-i", "-", "-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(place),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as output:
        code = _fed(command, images, output)
        output.seek(0)
        reason = " ".join(output.read().decode(errors="replace").split())
    if code:
        text = f"ffmpeg failed with exit code {code}: {reason[-300:]}; use .gif or .html"
        raise EngineError(text, id="ffmpeg-failed")


def _fed(command: list[str], images: Iterable[Image], output: IO[bytes]) -> int:
    """Feed the frames to a program and return its exit code; in its separate session, Ctrl-C does not stop it."""
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=output, stderr=output, start_new_session=True
    ) as process:
        assert process.stdin is not None
        try:
            for image in images:
                process.stdin.write(image.tobytes())
        except BrokenPipeError:
            pass  # the program has ended; its output gives the reason
        except BaseException:
            process.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
    return process.returncode


def page(film: Film, width: int) -> str:
    """Return the HTML page, that is, the template filled with title, data and texts."""
    template = (files("flexlink.results.pictures") / "data" / "player.html").read_text(encoding="utf-8")
    data = json.dumps(data_of(film), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    parts = {"title": film.name.replace("&", "&amp;").replace("<", "&lt;"), "width": str(width), "data": data}
    # all at once, since a name may contain {{data}}
    return re.sub(r"\{\{(title|width|data)\}\}", lambda part: parts[part[1]], template)


def data_of(film: Film) -> dict[str, Any]:
    """Data for the player; arrays are float32, and colours are bytes; the byte 255 means no value."""
    projected, outline, found = Projected(film), film.outline, film.colouring
    pivot, window = turned_window(projected)
    poses = np.concatenate([film.p, film.R[..., 1], film.R[..., 2]], axis=-1)  # origin, y and z of every body
    level = found.values / found.largest * 254 if found.largest else found.values * 0 + 255
    return {
        "name": film.name, "about": film.about, "subtitle": projection.subtitle(film), "fps": film.fps,
        "digits": projection.digits_of_time(film), "bodies": film.p.shape[1], "t": _floats(film.t),
        "poses": _floats(poses),
        "values": base64.b64encode(np.nan_to_num(level, nan=255.0).round().astype(np.uint8).tobytes()).decode(),
        "link": outline.link.tolist(), "body": outline.body.tolist(), "place": _floats(outline.place),
        "axes": _floats(outline.axes), "across": _floats(outline.across), "round": outline.round.astype(int).tolist(),
        "railBody": outline.rails[0].tolist(), "railPlace": _floats(outline.rails[1]), "order": outline.order.tolist(),
        "joints": outline.joints.tolist(), "radii": projected.joint_radii.tolist(), "ball": projected.ball_radius,
        "base": projected.base_half, "baseBody": outline.base, "center": outline.center.tolist(),
        "trace": _floats(film.trace), "traceT": _floats(film.trace_t), "view": film.view.axes.tolist(),
        "vertical": film.view.vertical.tolist(), "spatial": film.view.spatial, "pivot": pivot.tolist(),
        "window": window, "thinnest": projected.thinnest[0],
        "floor": projection.floor_of(film).tolist() if film.view.spatial else [], "level": floor_level(film),
        "stops": list(STOPS), "unknown": UNKNOWN, "label": found.label if found.largest else "",
        "ticks": [projection.number(part * found.largest) for part in (0.0, 0.5, 1.0)],
    }  # fmt: skip


def turned_window(projected: Projected) -> tuple[Array, list[float]]:
    """Return the point in the middle of the window [m], and its left, right, bottom and top edges from there [m].

    The window contains the arm at all times, and a spatial arm for any rotation about the vertical through that point.
    If the view is from an angle e above the horizon, the height in the picture of a point at height h and distance r
    from that vertical is at most h cos e + r sin e.
    """
    film, view = projected.film, projected.view
    if not view.spatial:
        return np.zeros(3), list(projected.window)
    found, v = np.concatenate([part.reshape(-1, 3) for part in (film.points, film.bodies, film.ball)]), view.vertical
    heights, level = found @ v, found - (found @ v)[:, None] * v
    pivot = (level.min(axis=0) + level.max(axis=0)) / 2
    r = float(np.linalg.norm(level - pivot, axis=1).max()) + thickest(film)
    cos_e, sin_e, room = float(view(v)[1]), float(view.axes[2] @ v), projection.AROUND * 2 * r
    low, high = cos_e * min(heights.min(), floor_level(film)), cos_e * (heights.max() + thickest(film))
    return pivot, [-r - room, r + room, low - sin_e * r - room, high + sin_e * r + room]


def _floats(values: ArrayLike) -> str:
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()
