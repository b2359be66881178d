"""Scenes in files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexlink.common.errors import SceneError
from flexlink.common.wording import truncated
from flexlink.data import documents
from flexlink.describe.scene import Scene, scene_from
from flexlink.describe.scene_checks import check_named


def load_scene(path: str | Path) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path
        A TOML file in the format of the scenes in `models/`. Files that it names (`method`, `lumping`) are sought
        from its own folder.

    Returns
    -------
    Scene
        As the file says.

    Raises
    ------
    ArgumentError
        `path` is no path.
    SceneError
        The message names the file, the key path, the value and what is allowed.
    DataFileError
        The file of a rule or method that the scene names is not valid.

    Examples
    --------
    >>> scene = fl.load_scene("models/three_links.toml")
    >>> print(scene.name, scene.run.duration)
    three_links 8.0
    """
    path = documents.require_path("path", path)
    raw = documents.beside(path.parent, documents.read_toml(path))
    with documents.errors_of(path):
        scene = scene_from(raw, finite=documents.is_finite(raw))
        check_named(scene.arm, scene.run)
        return scene


def scene_named(document: dict[str, Any], folder: Path) -> Scene:
    """Take `scene` out of what a TOML parser returned of a file in a folder, and read the scene that it names.

    Raises
    ------
    SceneError, DataFileError
        It is no path; or as in `load_scene`.
    """
    name = document.pop("scene")
    if not isinstance(name, str):
        raise SceneError(f"scene = {truncated(name)}: expected the path of a scene file", id="wrong-type")
    return load_scene(folder / name)
