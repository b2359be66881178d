"""The result of advice: the model with its error and cost, and one line with the reason for each choice."""

import dataclasses
import math
from typing import Any

import numpy as np

from flexlink.common.notebook import html_table
from flexlink.describe.scene import Scene
from flexlink.motion.simulate import simulate
from flexlink.results.convergence import Limit


@dataclasses.dataclass(frozen=True, eq=False)
class Advice:
    """The cheapest model for a scene, its motion and an accuracy."""

    met: bool  # whether the error is within the tolerance
    scene: Scene  # with this model and its steps, ready to run and to save (`scene.to_toml()`)
    error: float  # bound on the largest error of the tip at any sample, and the allowed error [m]
    tolerance: float
    tip_travel: float  # largest distance of the tip from its start [m]
    run_time: float  # measured CPU time [s] of `simulate(advice.scene)`, with set-up: the minimum of a few runs
    again_time: float  # of each further run of that scene, or of one `Problem`, which is prepared only once
    converged_tip: Limit | None  # path of the tip to which finer models converge; None if rigid links are enough
    horizon: float  # time up to which the tolerance is met [s]; the end of the run if throughout
    runs: int  # number of runs made for the advice, and their CPU time [s], including any compilation of kernels
    compute_time: float
    lines: tuple[str, ...]  # the choices with their numbers, as printed; only the last line depends on the machine

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def __repr__(self) -> str:
        error = f"error {self.error:.2g} m of {self.tolerance:.2g} m"
        return f"<Advice {self.scene.name!r}: {'met' if self.met else 'cannot'}, {error}, {self.runs} runs>"

    def plot(self, *, ax: Any = None) -> Any:
        """Run `scene`, and plot its tip against time; dotted, the limit of finer models. Needs matplotlib.

        Returns the figure of `ax`, axes to draw in, or a new one.
        """
        run = simulate(self.scene)
        figure = run.plot(what="tip", ax=ax)
        panel = figure.axes[0] if ax is None else np.ravel(ax)[0]
        if self.converged_tip is not None:
            panel.plot(run.t, self.converged_tip.tip, "k:")
        if ax is None:
            figure.suptitle(repr(self))
        return figure

    def _repr_html_(self) -> str:
        rows = [(word, text.strip()) for word, _, text in (line.partition(" ") for line in self.lines)]
        return html_table(repr(self), ("choice", "why"), rows)


def line(word: str, text: str) -> str:
    """A line of advice."""
    return f"{word:<10} {text}"


def payback(took: float, own: float, again: float) -> str:
    """State after how many runs advice that `took` [s] pays off, if each run takes `again` instead of `own` [s]."""
    if math.isnan(own):
        return ""
    if own <= again:
        return "; a run of the original scene takes no longer"
    runs = max(1, math.ceil(took / (own - again)))
    each = f" ({time(own)} each)" if own < math.inf else ""
    return f"; pays off after {runs} run{'s' * (runs > 1)} of the original scene{each}"


def time(seconds: float) -> str:
    """A time with its unit."""
    return f"{seconds * 1e3:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


def length(metres: float) -> str:
    """A length with its unit."""
    unit, size = ("m", 1.0) if metres >= 0.1 else ("mm", 1e3) if metres >= 1e-4 else ("µm", 1e6)
    return f"{metres * size:.3g} {unit}"
