"""Draw and write the figures of a report in several processes, since this takes most of the time of a report."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl

from flexlink.pages.picture import Picture
from flexlink.pages.style import RC
from flexlink.pages.verdict import Shown
from reports import curves
from reports.chapters import chapter_of_kinds
from reports.figures import figure
from reports.findings import finding
from reports.results import Results

WORTH_A_PROCESS = 10  # series per process: starting one takes as long as writing three or four figures


class Drawn(NamedTuple):
    """A figure whose files have been written: id of its chapter, and SVG definitions that figures may share."""

    chapter: str
    shown: Shown
    definitions: dict[str, str]


def figures_of(results: Results, out: Path) -> tuple[dict[str, list[Shown]], dict[str, str]]:
    """Write the files of all figures to `out`; return chapter id → figures, and the shared SVG definitions.

    Each of n processes writes every n-th figure; the result does not depend on n.
    """
    shown: dict[str, list[Shown]] = {}
    definitions: dict[str, str] = {}
    processes = max(1, min(os.cpu_count() or 1, sum(map(len, results.series.values())) // WORTH_A_PROCESS))
    with contextlib.ExitStack() as stack:
        shares = []
        if processes > 1:
            context = multiprocessing.get_context("spawn")
            pool = stack.enter_context(ProcessPoolExecutor(processes - 1, mp_context=context))
            shares = [pool.submit(_share, results, out, k, processes) for k in range(1, processes)]
        parts = [_share(results, out, 0, processes), *(share.result() for share in shares)]
    for place in range(sum(map(len, parts))):
        drawn = parts[place % processes][place // processes]
        shown.setdefault(drawn.chapter, []).append(drawn.shown)
        definitions.update(drawn.definitions)
    return shown, definitions


def _share(results: Results, out: Path, first: int, step: int) -> list[Drawn]:
    """Write every `step`-th figure from `first` on; all are made in each process, since only writing takes time."""
    return [_written(*made, out) for made in islice(pictures(results), first, None, step)]


def _written(chapter: str, picture: Picture, out: Path) -> Drawn:
    definitions: dict[str, str] = {}
    return Drawn(chapter, picture.shown(out, definitions), definitions)


def pictures(results: Results) -> Iterator[tuple[str, Picture]]:
    """(chapter id, picture) from reports/figures/, then of each remaining series, which no maker takes."""
    taken, chapter_of = figure.taken | finding.taken, chapter_of_kinds()
    with mpl.rc_context(RC):
        yield from figure.made(results)
        for case, found in results.series.items():
            for series in found:
                if series.what not in taken:
                    yield chapter_of[results.cases[case][0].kind], curves.picture(case, series)
