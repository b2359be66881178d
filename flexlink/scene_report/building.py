"""Build the page of a report on one scene, with its files; if a chapter fails, a sentence replaces it."""

import dataclasses
import importlib
import time
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import begin_page
from flexlink.data.documents import read_toml
from flexlink.pages.page import Part, write_page, written
from flexlink.pages.style import RC
from flexlink.pages.verdict import Chapter, Fact, Report, Verdict
from flexlink.scene_report.study import Study

CHAPTERS = read_toml(Path(__file__).parent / "parts" / "chapters.toml")
"""Modules of `flexlink.scene_report.parts` in page order, each with its heading and name in the table of contents."""


def build(study: Study, folder: Path, progress: Callable[[str], None]) -> Report:
    """Write all files, and finally the complete page; errors are listed at `report`."""
    study.chain  # noqa: B018  fail early: without a chain there is nothing to report
    begin_page(folder)
    definitions: dict[str, str] = {}
    chapters: list[Chapter] = []
    verdicts: list[Verdict] = []
    facts: list[Fact] = []
    for name, (title, short) in CHAPTERS.items():
        began, module = time.perf_counter(), importlib.import_module(f"flexlink.scene_report.parts.{name}")
        chapter = Chapter(name, title, short)
        try:
            with mpl.rc_context(RC), np.errstate(all="ignore"):
                part: Part | None = module.made(study)
        except Exception as error:  # an error in one chapter must not stop the others
            reason = str(error) if isinstance(error, FlexlinkError) else f"{type(error).__name__}: {error}"
            chapters.append(dataclasses.replace(chapter, failure=" ".join(reason.split())))
        else:
            if part is None:  # the chapter does not apply
                continue
            chapters.append(written(chapter, part, folder, definitions))
            verdicts += part.verdicts
            facts += part.facts
        progress(f"{title}: {chapters[-1].failure or 'done'} ({time.perf_counter() - began:.1f} s)")
    page = write_page(folder, study.scene.name, "report", chapters, verdicts, facts, definitions)
    return Report(page, tuple(verdicts), chapters)
