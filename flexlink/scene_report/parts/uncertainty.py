"""Medians and intervals of what the scene predicts, due to its uncertain inputs, and which inputs matter most."""

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import modes
from flexlink.motion.intervals import Intervals, intervals, names_at_rest, of_run
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.tables import Cell, Table
from flexlink.pages.verdict import Fact
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if not (study.uncertain or study.scene.uncertain):
        return None
    sentences, lines, facts = list[str](), list[tuple[Cell, ...]](), list[Fact]()
    for what in ("At rest", "Run"):
        try:
            names, found = _at_rest(study) if what == "At rest" else of_run(study.scene, study.run)
        except FlexlinkError as error:
            sentences.append(f"{what}: no intervals: {error}.")
            continue
        for k in found.varying:
            value, median, low, high = (float(one[k]) for one in (found.value, found.median, found.low, found.high))
            share = 50 * (high - low) / abs(median) if median else None
            lines.append((names[k], value, median, low, high, share, found.ranked(k)))
            if names[k] in ("mode 1 [Hz]", "largest deflection [m]"):
                of, _, unit = names[k].rstrip("]").partition(" [")
                facts.append(Fact(f"{number(low)} … {number(high)} {unit}", f"95 % interval, uncertain inputs: {of}"))
    if not lines:
        return Part(tuple(sentences))
    sentences.append(
        "Each interval contains the truth in 95 of 100 cases if nothing but these inputs is wrong; inputs are ranked "
        "by their shares in the variance. A beam without root_stiffness counts as softly clamped."
    )
    heads = ("prediction", "this scene", "median", "low", "high", "± [%]", "due to")
    table = Table("intervals", "95 % intervals", heads, tuple(lines))
    return Part(tuple(sentences), facts=tuple(facts), tables=(table,))


def _at_rest(study: Study) -> tuple[list[str], Intervals]:
    """The tip and the first natural frequencies, as in the chapters on statics and vibration."""
    count = 4

    def predict(scene: Scene) -> Array:
        varied = Study(scene)
        hertz = modes(varied.chain, varied.rest.q, locked=varied.held, ties=scene, **varied.load).hertz[:count]
        return np.array([*tip_position(varied.chain, varied.rest.q), *hertz])

    return names_at_rest(count), intervals(study.scene, predict)
