"""Everything needed to reproduce the page: versions, machine, command and scene."""

import datetime
import os
import platform

from flexlink.common.versions import processor, system, versions
from flexlink.pages.page import Part
from flexlink.pages.tables import Cell, Table
from flexlink.scene_report.study import Study


def made(study: Study) -> Part:
    """Build the chapter."""
    lines: list[tuple[Cell, ...]] = [
        ("made", datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")), ("system", system()),
        ("processor", processor()), ("cores", str(os.cpu_count() or "")), ("python", platform.python_version()),
    ]  # fmt: skip
    packages = ("flexlink", "numpy", "scipy", "numba", "pin", "mujoco", "exudyn", "drake", "matplotlib", "jinja2")
    lines += [(name, version or "not installed") for name, version in versions(packages).items()]
    made_by = f"Command: {study.command}" if study.command else "Made with flexlink.report(scene, folder)."
    sentences = made_by, "The only input is the scene below, also in scene.toml next to this page."
    table = Table("machine", "Machine and versions", ("what", "value"), tuple(lines), to_look_up=True)
    return Part(sentences, tables=(table,), literal=study.scene.to_toml())
