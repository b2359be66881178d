"""Predictions of the model for all data, and their Jacobian, at several points of the search at once."""

import operator
from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import FlexlinkError, or_error, or_raise
from flexlink.common.interruption import deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.variants import Variants
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source
from flexlink.motion.batch import outcomes
from flexlink.motion.side_by_side import Block
from flexlink.motion.slopes_of_runs import CENTRAL, FORWARD, Places, mirrored, moved, neighbours
from flexlink.results.stop_reasons import InterruptedRunError
from flexlink.results.trajectory import Trajectory

Model = list[list[Array]]  # predictions for every block of every source
Slopes = list[list[Array]]  # Jacobians of these predictions with respect to all coordinates; empty if not requested
STEP = 1e-3  # finite-difference step of x, relative to the parameter or its unit
FINER = 0.01
"""Step for frequency responses relative to the step for runs: they are exact, and change quickly at a resonance."""
KEPT = 4  # size of the cache of points; a search evaluates predictions, Jacobian and noise at the same points


class Signals:
    """Predictions of the sources, the measurements, as functions of the coordinates, the parameters."""

    def __init__(self, sources: Sequence[Source], coordinates: Sequence[Coordinate]) -> None:
        self.sources, self.coordinates = sources, coordinates
        self.runs = 0  # number of simulated runs
        own = [[k for k, one in enumerate(coordinates) if one.run in ("", source.name)] for source in sources]
        self._own = [[k for k in indices if not coordinates[k].timing] for indices in own]
        self._timing = [[k for k in indices if coordinates[k].timing] for indices in own]
        self._points: dict[bytes, tuple[Model, Slopes]] = {}
        self._most = KEPT
        controlled = any(source.scene.run.controlled for source in sources)
        self._beside = 2 * max(map(len, self._own)) < Block.lanes and not controlled
        self._variants = [
            Variants(source.scene, [coordinates[k].path for k in indices])
            for source, indices in zip(sources, self._own, strict=True)
        ]

    def scene(self, number: int, x: Array) -> Scene:
        """Scene of a source at a point."""
        indices = [self.coordinates[k] for k in self._own[number]]
        values = [one.value(float(x[k])) for k, one in zip(self._own[number], indices, strict=True)]
        return self._variants[number].varied({one.path: v for one, v in zip(indices, values, strict=True)})

    def model(self, x: Array) -> Model:
        """Predictions at one point."""
        return (self._points.get(x.tobytes()) or self._kept(x, slopes=self._beside))[0]

    def ahead(self, points: Sequence[Array]) -> None:
        """Compute the predictions at several points in parallel, and cache the successful ones."""
        new = {x.tobytes(): x for x in points if x.tobytes() not in self._points}
        parts = [self._computed(number, list(new.values())) for number in range(len(self.sources))]
        self._most = KEPT + len(new)
        for x, *model in zip(new.values(), *parts, strict=True):
            good = [values for values in model if not isinstance(values, FlexlinkError)]
            if len(good) == len(model):
                self._points[x.tobytes()] = good, []

    def slopes(self, x: Array, places: Places = CENTRAL, step: float = STEP) -> Slopes:
        """Jacobian of the predictions of every block, shape (n, coordinates)."""
        if places != CENTRAL:
            return [self._of_source(number, x, places, step)[1] for number in range(len(self.sources))]
        return self._kept(x, slopes=True)[1]

    def _kept(self, x: Array, *, slopes: bool) -> tuple[Model, Slopes]:
        """Predictions and Jacobian at a point, from the cache of the last few points."""
        key = x.tobytes()
        point = self._points.get(key)
        if point is None or (slopes and not point[1]):
            parts = [self._of_source(k, x, CENTRAL if slopes else None, STEP) for k in range(len(self.sources))]
            point = [values for values, _ in parts], [of_part for _, of_part in parts] if slopes else []
            self._points[key] = point
            while len(self._points) > self._most:
                self._points.pop(next(iter(self._points)))
        return point

    def around(self, x: Array, places: Places, step: float = STEP) -> list[Array]:
        """The point, followed by the neighbouring points for finite differences."""
        return [x, *(moved(x, k, step * at) for k in range(len(x)) for at in self._places(k, x, places, step))]

    def _of_source(self, number: int, x: Array, places: Places | None, step: float) -> tuple[list[Array], list[Array]]:
        """Predictions of one source at a point, and their Jacobian, computed in one batch."""
        indices = [*self._own[number], *self._timing[number]] if places is not None else []
        step *= FINER if self.sources[number].response is not None else 1.0
        steps = np.zeros(len(x))
        steps[indices] = step
        at = [self._places(k, x, places or CENTRAL, step) for k in range(len(x))]
        values, beside = neighbours(lambda points: self._many(number, points), x, steps, at)
        slopes = [np.zeros((len(block.y), len(x))) for block in self.sources[number].blocks]
        for k, one in zip(indices, map(or_raise, beside), strict=True):
            for j, slope in enumerate(slopes):
                slope[:, k] = one.slope(values[j], operator.itemgetter(j))
        return values, slopes

    def _places(self, k: int, x: Array, places: Places, step: float) -> Places:
        low, high = self.coordinates[k].bounds
        far = step * max(places)
        return FORWARD if x[k] - far < low else mirrored(FORWARD) if x[k] + far > high else places

    def _many(self, number: int, points: Sequence[Array]) -> list[list[Array] | FlexlinkError]:
        """Predictions of one source at several points, taken from the cache or computed by parallel runs."""
        known = [self._points.get(x.tobytes()) for x in points]
        new = iter(self._computed(number, [x for x, point in zip(points, known, strict=True) if point is None]))
        return [next(new) if point is None else point[0][number] for point in known]

    def _computed(self, number: int, points: Sequence[Array]) -> list[list[Array] | FlexlinkError]:
        source, keys = self.sources[number], [x[self._own[number]].tobytes() for x in points]
        scenes: dict[bytes, Scene | FlexlinkError] = {}  # points that differ in times only have one scene
        for key, x in zip(keys, points, strict=True):
            if key not in scenes:
                scenes[key] = or_error(self.scene, number, x)
        if source.at_rest is not None:
            single = {
                key: scene if isinstance(scene, FlexlinkError) else or_error(source.at_rest, scene)
                for key, scene in scenes.items()
            }
            return [single[key] for key in keys]
        good = [scene for scene in scenes.values() if isinstance(scene, Scene)]
        self.runs += len(good)
        with deferred() as stop:
            ends = iter(outcomes(good, stop, compared=0))  # warnings of single runs are not shown
        runs = {key: scene if isinstance(scene, FlexlinkError) else next(ends) for key, scene in scenes.items()}
        return [self._of_run(number, runs[key], x) for key, x in zip(keys, points, strict=True)]

    def _of_run(self, number: int, end: object, x: Array) -> list[Array] | FlexlinkError:
        if isinstance(end, InterruptedRunError):
            raise end
        if isinstance(end, Trajectory):
            return self.sources[number].model(end, [(self.coordinates[k], float(x[k])) for k in self._timing[number]])
        assert isinstance(end, FlexlinkError)
        return end
