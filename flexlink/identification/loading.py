"""Read an identification problem from its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexlink.data import documents
from flexlink.data.documents import paths_of
from flexlink.describe.mistakes import mistakes, raise_together
from flexlink.describe.scene_file import refuse_scene, scene_named
from flexlink.describe.spec import check_keys, decode, fields_of
from flexlink.identification.problem import FitProblem


def load_fit(path: str | Path) -> FitProblem:
    """Read a problem from a TOML file.

    Parameters
    ----------
    path
        A TOML file: `scene`, a path relative to the file, then `[[parameter]]`, and the measurements in `[[run]]`,
        `[[modes]]`, `[[static]]` and `[[frf]]`.

    Returns
    -------
    FitProblem
        The problem; files of recorded runs are read when it is fitted.

    Raises
    ------
    ArgumentError
        `path` is not a path.
    SceneError
        The problem is invalid; the message names the file, the key path, the value and the allowed values.
    DataFileError
        The file of a lumping rule or method in the scene is not valid.

    Examples
    --------
    >>> problem = fl.fits.load_fit("models/fits/tapped.toml")
    >>> print(problem.scene.name, [parameter.path for parameter in problem.parameter])
    three_links ['material.aluminium.young', 'tip.mass']
    """
    path = documents.require_path("path", path)
    raw = documents.read_toml(path)
    with documents.errors_of(path):
        fields = {field.encode_name: field for field in fields_of(FitProblem)}
        refuse_scene(raw, path, "a fit")
        check_keys(raw, fields, required=("scene", "parameter"))
        scene = scene_named(raw, path.parent)
        for part in ("run", "modes", "static", "frf"):
            if isinstance(raw.get(part), list):
                raw[part] = documents.with_absolute_paths(path.parent, [_as_paths(table) for table in raw[part]])
        raise_together(wrong for key, value in raw.items() for wrong in mistakes(value, fields[key].type, key))
        parts = {key: decode(value, fields[key].type, key) for key, value in raw.items()}
        return FitProblem(scene=scene, **parts)


def _as_paths(table: Any) -> Any:
    """Rejoin the keys of `set` and `before` into paths; TOML has split them at their dots."""
    if not isinstance(table, dict):
        return table
    apart = (key for key in ("set", "before") if isinstance(table.get(key), dict))
    return table | {key: dict(paths_of(table[key])) for key in apart}
