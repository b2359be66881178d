"""report(scene, folder) → Report: one page about a user's arm, with its data files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import builder
from flexlink.data.documents import require_path
from flexlink.describe.scene import Scene
from flexlink.pages.verdict import Report
from flexlink.scene_report.study import Study


def report(
    scene: Scene, folder: str | Path, *, against: str | Path | None = None, command: str = "",
    uncertain: bool = False, progress: Callable[[str], None] | None = None,
) -> Report:  # fmt: skip
    """Write a report on a scene: the model, agreement of engines, accuracy, cost and results.

    The page works offline and on a phone. Each table is also a CSV file; each picture is also a PNG, SVG and CSV file.
    A chapter that cannot be computed states the reason instead.

    Parameters
    ----------
    scene
        The scene, with the model and the steps to check.
    folder
        Folder for the page and its files; created if missing. Existing files with the same names are replaced.
    against
        An MJCF, URDF or SDF file of the same arm from any source, which is compared and diagnosed; or a CSV file of
        measurements with a column "t [s]" and columns of `Trajectory.columns`, where deg and mm are also allowed.
    command
        Command that made the page, to be printed on the page.
    uncertain
        Whether to give intervals by the uncertain inputs of the scene and of its clamps, as always if
        `scene.uncertain` lists inputs.
    progress
        Called with one line for each finished chapter.

    Returns
    -------
    Report
        The page, and the verdicts on its first screen.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene, or `against` has an unsupported type or does not exist.
    SceneError, DataFileError
        The chain cannot be built, as in `lump`.
    MissingDependencyError
        matplotlib or jinja2 is not installed.
    OutputError
        The folder or a file in it cannot be written.

    Examples
    --------
    >>> written = fl.report(scene, "two_links_report")
    >>> print(written.page, written.passed)
    two_links_report/index.html True
    """
    study = Study(
        require_type("scene", scene, Scene), None if against is None else _beside(against), command, uncertain
    )
    require_callable("progress", progress)
    building = builder("flexlink.scene_report.building", "report")
    found: Report = building.build(study, require_path("folder", folder), progress or (lambda _: None))
    return found


def _beside(against: str | Path) -> Path:
    path, arms = require_path("against", against), (".urdf", ".xml", ".mjcf", ".sdf")
    if path.suffix.lower() not in (*arms, ".csv"):
        why = f"against = {str(path)!r}: expected {', '.join(arms)}, or .csv of measurements"
        raise ArgumentError(why, id="wrong-type")
    if not path.is_file():
        raise ArgumentError(f"against = {str(path)!r}: there is no such file", id="no-such-file")
    return path
