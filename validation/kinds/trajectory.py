"""Complete motions against other engines with the same method and step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.engines import load
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.runs import motion_series, points_of, run_facts
from validation.store import Series

LONG = True


def run(case: Case, engines: tuple[str, ...]) -> Iterator[Measured | Series]:
    """Yield the largest differences of joint angles and rates over the run, and the panels of figure 5."""
    for scene in case.load_scenes():
        ours = simulate(scene)
        yield from motion_series(scene, ours)
        differences = {"time [s]": ours.t}
        for name in engines:
            t, q, qd = load(name, ours.chain).integrate(scene)
            yield from motion_series(scene, points_of(scene, ours.chain, t, q, qd), name)
            differences[name] = np.abs(q - ours.q).max(axis=1)
            yield Measured("max |Δq|", float(differences[name].max()), scene.name, name, run_facts(scene.run))
            yield Measured("max |Δq̇|", float(np.abs(qd - ours.qd).max()), scene.name, name, run_facts(scene.run))
        title = f"{scene.name}: difference from flexlink, same method and step"
        yield Series(
            "difference", title, differences, "time [s]", "time [s]", "max |Δq| [rad]", y_scale="log", scene=scene.name
        )
