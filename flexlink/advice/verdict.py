"""What advice says: the model, its error, what it costs, and why, a line a choice."""

from __future__ import annotations

import dataclasses

from flexlink.describe.scene import Scene
from flexlink.results.convergence import Limit


@dataclasses.dataclass(frozen=True, eq=False)
class Advice:
    """The cheapest model that was found for a scene, an accuracy and a motion.

    Attributes
    ----------
    met
        Whether its error is within the tolerance.
    scene
        The scene with this model and its steps, ready to run and to save (`scene.to_toml()`).
    error, tolerance
        Largest error of the tip at any sample, as far as it can be, and the one that is allowed [m].
    motion
        How far the tip gets from its start [m].
    seconds
        CPU time of its run [s], by its evaluations.
    limit
        What finer and finer models converge to, better than any one of them; None where rigid links are enough.
    horizon
        Time up to which the tolerance holds [s]: the end if it is met.
    runs, effort
        Number of runs that the advice took, and their CPU time [s], by their evaluations.
    lines
        What was decided, with its numbers, a line a choice: `print(advice)`.
    """

    met: bool
    scene: Scene
    error: float
    tolerance: float
    motion: float
    seconds: float
    limit: Limit | None
    horizon: float
    runs: int
    effort: float
    lines: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def __repr__(self) -> str:
        said = f"error {self.error:.2g} m of {self.tolerance:.2g} m"
        return f"<Advice {self.scene.name!r}: {'met' if self.met else 'cannot'}, {said}, {self.runs} runs>"


def line(word: str, text: str) -> str:
    """A line of advice."""
    return f"{word:<10} {text}"


def time(seconds: float) -> str:
    """A time with its unit."""
    return f"{seconds * 1e3:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"


def length(metres: float) -> str:
    """A length with its unit."""
    return (
        f"{metres:.3g} m" if metres >= 0.1 else f"{metres * 1e3:.3g} mm" if metres >= 1e-4 else f"{metres * 1e6:.3g} µm"
    )
