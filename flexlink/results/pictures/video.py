"""Frames as a GIF by Pillow, which comes with matplotlib, or as a video by ffmpeg."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import EngineError, MissingDependencyError

Image = NDArray[np.uint8]


def write_gif(place: Path, images: Iterable[Image], like: Iterable[Image], milliseconds: int) -> None:
    """Write frames of shape (height, width, 3), each shown for this time, as a GIF that repeats endlessly.

    All frames use the same 256 colours, chosen for the images `like`; a palette that changes would cause flicker.
    """
    from PIL import Image as Pillow  # noqa: PLC0415  needed only for drawing

    palette = Pillow.fromarray(np.concatenate(list(like))).quantize(256, dither=Pillow.Dither.NONE)
    frames = (Pillow.fromarray(image).quantize(palette=palette, dither=Pillow.Dither.NONE) for image in images)
    first = next(frames)
    first.save(place, format="GIF", save_all=True, append_images=frames, duration=milliseconds, loop=0, optimize=False)


def require_ffmpeg() -> str:
    """Path of the program ffmpeg.

    Raises
    ------
    MissingDependencyError
        ffmpeg is not installed.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise MissingDependencyError(
            "an .mp4 needs the program ffmpeg, which is not on the PATH; install it (ffmpeg.org, or your system's "
            "package ffmpeg), or use .gif or .html",
            id="package-missing",
        )
    return found


def write_mp4(place: Path, images: Iterable[Image], size: tuple[int, int], fps: float) -> None:
    """Write frames of shape (height, width, 3), height and width even, as H.264, which every browser plays.

    Raises
    ------
    MissingDependencyError
        ffmpeg is not installed.
    EngineError
        ffmpeg failed.
    """
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
        raise EngineError(
            f"ffmpeg failed with exit code {code}: {reason[-300:]}; use .gif or .html", id="ffmpeg-failed"
        )


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
