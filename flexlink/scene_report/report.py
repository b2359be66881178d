"""report(scene, folder) → Report: one page about a user's own arm, and the files beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.errors import ArgumentError
from flexlink.data.documents import require_path
from flexlink.describe.scene import Scene
from flexlink.pages.builders import builder
from flexlink.pages.verdict import Report
from flexlink.scene_report.study import MEASURED, Study


def report(
    scene: Scene,
    folder: str | Path,
    *,
    against: str | Path | None = None,
    command: str = "",
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Write a report on a scene: what was modelled, whether engines agree, how good it is, what it costs, what it does.

    One page that stands alone, offline and on a phone; beside it a CSV a table, a PNG, SVG and CSV a picture. A chapter
    that cannot be computed says why in its place.

    Parameters
    ----------
    scene
        The scene, with the model and the steps that are judged.
    folder
        For the page and its files; made if missing. Files of the same names are replaced.
    against
        MJCF, URDF or SDF of the same arm, written by whomever, which is compared and diagnosed; or what was measured:
        a CSV whose columns are "t [s]" and some of `Trajectory.columns`, angles also in deg, lengths in mm.
    command
        What the page says that it was made by.
    progress
        Called with a line on every chapter that is done.

    Returns
    -------
    Report
        The page, and what its first screen says.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, `against` no file of a kind that is read, or not there.
    SceneError, DataFileError
        Of the scene's chain, as in `lump`.
    MissingDependencyError
        matplotlib or jinja2 is not installed.
    OutputError
        The folder cannot be made, or a file in it not be written.

    Examples
    --------
    >>> written = fl.report(scene, "two_links_report")
    >>> print(written.page, written.passed)
    two_links_report/index.html True
    """
    study = Study(require_type("scene", scene, Scene), None if against is None else _beside(against), command)
    require_callable("progress", progress)
    found: Report = building().build(study, require_path("folder", folder), progress or (lambda _: None))
    return found


def building() -> ModuleType:
    """The module that builds pages, which needs matplotlib and jinja2.

    Raises
    ------
    MissingDependencyError
        One of them is not installed.
    """
    return builder("flexlink.scene_report.building", "report")


def _beside(against: str | Path) -> Path:
    path, arms = require_path("against", against), (".urdf", ".xml", ".mjcf", ".sdf")
    if path.suffix.lower() not in (*arms, MEASURED):
        raise ArgumentError(
            f"against = {str(path)!r}: expected {', '.join(arms)}, or {MEASURED} of measurements", id="wrong-type"
        )
    if not path.is_file():
        raise ArgumentError(f"against = {str(path)!r}: there is no such file", id="no-such-file")
    return path
