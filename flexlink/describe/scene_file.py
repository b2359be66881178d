"""Read scenes from files."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from flexlink.common.errors import SceneError, errors_at
from flexlink.common.wording import truncated
from flexlink.data import documents
from flexlink.describe.scene import FIELDS, Scene, scene_from
from flexlink.describe.scene_checks import check_named
from flexlink.describe.spec import Spec, check_keys, fields_of
from flexlink.describe.vary import apply_changes


def load_scene(path: str | Path, *, changes: Mapping[str, object] = MappingProxyType({})) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path
        A TOML file in the format of the scenes in `models/`. Paths in it (`method`, `lumping`) are relative to its
        folder.
    changes
        Values by path, as in `Scene.varied`; they may repair a scene that is refused as it is.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    ArgumentError
        `path` is not a path.
    SceneError
        The scene is invalid; the message names the file, the key path, the value and what is allowed.
    DataFileError
        A rule or method file named by the scene is invalid.

    Examples
    --------
    >>> scene = fl.load_scene("models/three_links.toml")
    >>> print(scene.name, scene.run.duration)
    three_links 8.0
    """
    path = documents.require_path("path", path)
    raw = documents.with_absolute_paths(path.parent, documents.read_toml(path))
    with errors_at(f"{path}: "):
        if "scene" in raw and "link" not in raw:  # the file names a scene
            what, command = ("fit problem", "fit") if "parameter" in raw else ("sweep", "sweep")
            raise SceneError(f"this is a {what}, not a scene; run it by flexlink {command}", id="is-no-scene")
        try:
            scene = _checked(raw)
        except SceneError:
            if not changes:
                raise
            return _checked(apply_changes(raw, FIELDS, changes))
        return scene.varied(changes) if changes else scene


def _checked(raw: dict[str, Any]) -> Scene:
    scene = scene_from(raw, finite=documents.is_finite(raw))
    check_named(scene.arm, scene.run)
    return scene


def scene_named(document: dict[str, Any], path: Path, form: type[Spec], what: str) -> tuple[Scene, dict[str, Any]]:
    """Remove `scene` from a parsed file of this form, and read the scene that it names; also the types of all keys.

    A scene given instead of such a file, unknown keys and missing ones are refused.
    """
    if "link" in document and "scene" not in document:
        example = "models/fits/tapped.toml" if "fit" in what else "models/sweeps/payload.toml"
        text = f"this is a scene; {what} names one by scene = {path.name!r} and adds what to vary, as {example} does"
        raise SceneError(text, id="is-a-scene")
    fields = fields_of(form)
    check_keys(document, [each.encode_name for each in fields], [each.encode_name for each in fields if each.required])
    name = document.pop("scene")
    if not isinstance(name, str):
        raise SceneError(f"scene = {truncated(name)}: expected the path of a scene file", id="wrong-type")
    return load_scene(path.parent / name), {each.encode_name: each.type for each in fields}
