"""Table of CPU times against n for flexlink and every engine."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.tables import Table
from reports.curves import curves, panels_of
from reports.results import Results

SECTION = "speed"
ORDER = ("native", "public", "pinocchio", "pinocchio, fastest", "mujoco")


def find(results: Results) -> Iterator[Table]:
    """One table per job."""
    for case, series in results.showing("cost"):
        times: dict[tuple[str, float], dict[str, float]] = {}
        for family, part in panels_of(series):
            for curve in curves(part):
                for n, time in zip(curve.x, curve.y, strict=True):
                    times.setdefault((family, float(n)), {})[curve.label] = float(time)
        engines = [engine for engine in ORDER if any(engine in row for row in times.values())]
        lines = tuple((family, n, *(row.get(engine) for engine in engines)) for (family, n), row in times.items())
        sentence = (
            "native: flexlink in a compiled loop; public: its checked call from Python. Engines are called from Python."
        )
        heads = ("chain", "n", *(f"{engine} [µs]" for engine in engines))
        yield Table(f"{case}.{series.name}.times", series.title, heads, lines, (sentence,), to_look_up=True)
