"""The page of a report on one scene: chapter after chapter, what fails as a sentence, and all files beside it."""

from __future__ import annotations

import dataclasses
import importlib
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import write_text
from flexlink.pages.page import DATA, make_folder, template
from flexlink.pages.picture import Shown
from flexlink.pages.style import RC
from flexlink.pages.verdict import Report
from flexlink.scene_report.part import Part
from flexlink.scene_report.study import Study

PARTS = (
    "model", "motion", "theirs", "measurements", "agreement", "energy", "accuracy", "statics", "vibration", "settling",
    "loads", "reproduce",
)  # fmt: skip
"""Modules of `flexlink.scene_report.parts`, in the order of the page."""


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A part, its files written."""

    id: str
    title: str
    short: str
    part: Part
    figures: tuple[Shown, ...] = ()
    failure: str = ""


def build(study: Study, folder: Path, told: Callable[[str], None]) -> Report:
    """Write all files; the page last, and whole. Errors as in `report`."""
    study.chain  # noqa: B018  without one there is nothing to report on
    make_folder(folder)
    definitions: dict[str, str] = {}
    chapters = []
    for name in PARTS:
        began = time.perf_counter()
        chapter = _chapter(importlib.import_module(f"flexlink.scene_report.parts.{name}"), study, folder, definitions)
        if chapter is not None:
            chapters.append(chapter)
            told(f"{chapter.title}: {chapter.failure or 'done'} ({time.perf_counter() - began:.1f} s)")
    verdicts = tuple(verdict for chapter in chapters for verdict in chapter.part.verdicts)
    page = folder / "index.html"
    filled = template(DATA / "scene.html").render(
        title=f"{study.scene.name}: flexlink report", name=study.scene.name, chapters=chapters, verdicts=verdicts,
        definitions=definitions,
    )  # fmt: skip
    write_text(page, filled)
    return Report(page, verdicts, tuple(f"{c.title}: {c.failure}" for c in chapters if c.failure))


def _chapter(module: ModuleType, study: Study, folder: Path, definitions: dict[str, str]) -> Chapter | None:
    try:
        with mpl.rc_context(RC), np.errstate(all="ignore"):
            part: Part | None = module.made(study)
    except Exception as error:  # of whatever engine: the other chapters are not lost by it
        told = str(error) if isinstance(error, FlexlinkError) else f"{type(error).__name__}: {error}"
        return Chapter(module.ID, module.TITLE, module.SHORT, Part(), failure=" ".join(told.split()))
    if part is None:
        return None
    figures = tuple(picture.shown(folder, definitions) for picture in part.pictures)
    for table in part.tables:
        write_text(folder / f"{table.name}.csv", table.csv)
    for name, text in part.files.items():
        write_text(folder / name, text)
    return Chapter(module.ID, module.TITLE, module.SHORT, part, figures)
