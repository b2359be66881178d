"""Times against n as a table: every engine beside ours."""

from __future__ import annotations

from collections.abc import Iterator

from reports.curves import curves
from reports.finding import Finding
from reports.results import Results

SECTION = "speed"
ORDER = ("native", "public", "pinocchio", "pinocchio, fastest", "mujoco")


def find(results: Results) -> Iterator[Finding]:
    """One table a job."""
    for case, found in results.series.items():
        for name, series in found.items():
            if not name.startswith("cost."):
                continue
            times: dict[tuple[str, float], dict[str, float]] = {}
            for curve in curves(series):
                family, _, engine = curve.label.partition(" | ")
                for n, time in zip(curve.x, curve.y, strict=True):
                    times.setdefault((family, float(n)), {})[engine] = float(time)
            engines = [engine for engine in ORDER if any(engine in row for row in times.values())]
            lines = tuple((family, n, *(row.get(engine) for engine in engines)) for (family, n), row in times.items())
            sentence = "Microseconds; ours in a compiled loop, “public” the checked call, engines from Python."
            heads = ("chain", "n", *engines)
            yield Finding(
                f"{case}.{name.replace(' ', '_')}.times", series.title, (sentence,), heads, lines, to_look_up=True
            )
