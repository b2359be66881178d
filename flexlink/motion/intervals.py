"""Intervals of what a scene predicts, if some of its inputs are uncertain, to second order in each input.

    y ≈ y₀ + Σ a z + b z²               a = (y(√3) − y(−√3)) / 2√3,  b = (y(√3) + y(−√3) − 2 y₀) / 6
    one-sided input, z ≥ 0              a = 2 y(1) − y(2)/2 − 3/2 y₀,  b = y(2)/2 − y(1) + y₀/2

Interval and shares are those of this sum for normal z. A few samples of the scene itself, with all inputs at once, show
where it does not hold: a term b z² moves the ends of a 95 % interval by 6 % for b = 0.03 σ, and is then 0.05 σ (rms).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.describe.scene import FIELDS, Scene
from flexlink.describe.uncertain import Input, inputs_of
from flexlink.motion.simulate import simulate
from flexlink.results.trajectory import Trajectory, deflections

DRAWS, SAMPLES, LINEAR = 20_000, 30, 0.05
"""Draws of the sum, samples of the scene, and how far these may be off [σ]."""


class Intervals(NamedTuple):
    """Predictions of a scene, shape (k,), and their 95 % intervals; shares of the inputs in the variance, (p, k)."""

    inputs: tuple[str, ...]
    value: Array
    median: Array  # not the value of the scene, if an input such as a clamp changes it in one direction
    low: Array
    high: Array
    shares: Array
    linear: Array  # whether samples of the scene agree

    @property
    def varying(self) -> list[int]:
        """Indices of the predictions that vary."""
        fixed = np.isnan(self.value) | (self.high - self.low <= 1e-9 * np.abs(self.value))
        return list(np.flatnonzero(~fixed).tolist())

    def ranked(self, k: int) -> str:
        """The three inputs with the largest shares in the variance of a prediction, and a note if it is not linear."""
        first = sorted(zip(self.shares[:, k].tolist(), self.inputs, strict=True), reverse=True)[:3]
        due = ", ".join(f"{path} {100 * share:.0f} %" for share, path in first if share >= 0.005)
        return due + ("" if self.linear[k] else "; not linear, rough: find its distribution by flexlink sweep")

    def lines(self, names: Sequence[str]) -> list[str]:
        """A line for every prediction that varies."""
        return [f"medians and 95 % intervals with {plural(len(self.inputs), 'uncertain input')}"] + [
            f"{names[k]}: {self.median[k]:.4g} ({self.low[k]:.4g} … {self.high[k]:.4g}), due to {self.ranked(k)}"
            for k in self.varying
        ]

    def document(self, names: Sequence[str]) -> list[dict[str, object]]:
        """Value, median, interval and shares of every prediction, for JSON."""
        return [
            {"of": name, "value": self.value[k], "median": self.median[k], "low": self.low[k], "high": self.high[k],
             "linear": bool(self.linear[k]), "shares": dict(zip(self.inputs, self.shares[:, k].tolist(), strict=True))}
            for k, name in enumerate(names)
        ]  # fmt: skip


def intervals(scene: Scene, predict: Callable[[Scene], Array]) -> Intervals:
    """Intervals of predictions; an error if no input is uncertain, or a varied scene has none."""
    inputs = inputs_of(scene, FIELDS)
    if not inputs:
        why = "no input, and no clamp at a joint with inertia"
        raise ArgumentError(f'uncertain: {why}; name one, such as "material.steel.young" = 0.02', id="missing-key")
    nominal = predict(scene)

    def of(changes: dict[str, object]) -> Array:
        return np.array(predict(scene.varied(changes))[: len(nominal)])

    terms = np.array([_terms(one, nominal, of) for one in inputs])
    a, b = terms[:, 0], terms[:, 1]
    z = np.random.default_rng(0).standard_normal((DRAWS, len(inputs)))
    z = np.where([one.one_sided for one in inputs], np.abs(z), z)
    parts = z.T[:, :, None] * a[:, None] + (z * z).T[:, :, None] * b[:, None]
    y, variances = nominal + parts.sum(axis=0), parts.var(axis=1)
    sampled = [of({p: x for one, t in zip(inputs, row, strict=True) for p, x in one.changes(t).items()}) for row in
               z[:SAMPLES].tolist()]  # fmt: skip
    off = np.sqrt(np.mean((np.array(sampled) - y[:SAMPLES]) ** 2, axis=0))
    low, median, high = np.quantile(y, (0.025, 0.5, 0.975), axis=0)
    shares = variances / np.maximum(variances.sum(axis=0), 1e-300)
    linear = off <= LINEAR * y.std(axis=0) + 1e-9 * np.abs(nominal)
    return Intervals(tuple(one.path for one in inputs), nominal, median, low, high, shares, linear)


def _terms(one: Input, nominal: Array, of: Callable[[dict[str, object]], Array]) -> Array:
    """a and b of an input, (2, k)."""
    if one.one_sided:
        near, far = of(one.changes(1.0)), of(one.changes(2.0))
        return np.array([2 * near - far / 2 - 1.5 * nominal, far / 2 - near + nominal / 2])
    up, down = of(one.changes(3**0.5)), of(one.changes(-(3**0.5)))
    return np.array([(up - down) / 12**0.5, (up + down - 2 * nominal) / 6])


def names_at_rest(modes: int) -> list[str]:
    """Names of the tip's position at rest, then of natural frequencies."""
    return [*(f"tip {axis} at rest [m]" for axis in "xyz"), *(f"mode {k} [Hz]" for k in range(1, modes + 1))]


def of_run(scene: Scene, run: Trajectory) -> tuple[list[str], Intervals]:
    """Names and intervals of `ends_and_peaks` of a scene, whose run this is."""
    # a fixed step may be unstable with the springs of a clamp, and differences show errors of steps
    exact = scene.varied({"run.relative_tolerance": 1e-5, "run.accuracy": "tip"})
    return list(ends_and_peaks(run)), intervals(exact, lambda x: np.array([*ends_and_peaks(simulate(x)).values()]))


def ends_and_peaks(run: Trajectory) -> dict[str, float]:
    """The final tip, the largest deflection, and the largest torques and forces of drives."""
    found = {f"final tip {axis} [m]": float(x) for axis, x in zip("xyz", run.tip[-1], strict=True)}
    found["largest deflection [m]"] = float(deflections(run).max())
    drives = ((name.partition(" ")[2], column) for name, column in run.columns.items() if name.startswith("tau "))
    return found | {f"largest drive {name}": float(np.abs(column).max()) for name, column in drives}
