"""What a scene predicts after one number p was fitted to one reading r at rest, while other inputs x are uncertain.

    r(x, p) = r(x₀, p̂ exp(u z))        u: relative standard deviation of p̂, due to the error of the reading

In every varied scene the number is fitted again, so what it makes up for, such as a soft clamp, is not counted twice.
"""

import math
import warnings

import numpy as np
from msgspec.structs import replace
from scipy.optimize import root_scalar

from flexlink.common.errors import ArgumentError, IdentifiabilityError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.steady import modes_at_rest
from flexlink.identification.data import sources_of
from flexlink.identification.fitted import Fitted
from flexlink.identification.frequency_response import at_rest
from flexlink.identification.problem import Use
from flexlink.motion.intervals import Intervals, intervals, names_at_rest


def predictions(found: Fitted) -> tuple[list[str], list[tuple[float, float]], Intervals]:
    """Names and intervals of the number, the readings that check it, the tip at rest and the first elastic modes.

    Also the values of these readings, with their standard deviations. Driven joints are locked.
    """
    one, problem, count = found.numbers[0], found.problem, 4

    def read(scene: Scene, use: Use) -> Array:
        sources = sources_of(replace(problem, scene=scene), use)
        return np.concatenate([*(y for each in sources if each.at_rest for y in each.at_rest(each.scene)), []])

    if problem.run or len(found.numbers) > 1 or len(read(found.scene, "fit")) > 1:
        why = "expects one parameter, one frequency or position to fit, and no [[run]]"
        raise ArgumentError(f"--predict: {why}", id="needs-another-argument")

    def fitted(scene: Scene) -> Scene:
        """The scene with the number that explains the reading, by secants in its logarithm."""
        (value, *_) = scene.values_at(one.path)
        wanted = read(found.scene.varied({one.path: value}), "fit")[0]

        def again(x: float) -> Scene:
            return scene.varied({one.path: value * math.exp(x)})

        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # the result shows it
            root = root_scalar(lambda x: read(again(x), "fit")[0] / wanted - 1, x0=0.0, x1=1e-3, xtol=1e-7, maxiter=20)
        if not root.converged:
            why = "does not explain the reading for other values of the uncertain inputs; fit another number"
            raise IdentifiabilityError(f"{one.path}: {why}", found.check)
        return again(root.root)

    def predict(scene: Scene) -> Array:
        chain, rest, load = at_rest(again := fitted(scene))
        shapes = modes_at_rest(chain, rest, **load)
        hertz = shapes.hertz[np.array(shapes.kinds) == "elastic"][:count]
        return np.array([*again.values_at(one.path)[:1], *read(again, "check"), *tip_position(chain, rest.q), *hertz])

    uncertain = found.scene.uncertain | {one.path: one.deviation / abs(one.value)}
    expected = intervals(found.scene.varied({"uncertain": uncertain}), predict)
    checks = [(source.name, block) for source in sources_of(problem, "check") for block in source.blocks]
    names = [f"{name}, {block.name}, {k}" for name, block in checks for k in range(1, len(block.y) + 1)]
    readings = [pair for _, block in checks for pair in zip(block.y.tolist(), block.σ.tolist(), strict=True)]
    return [f"{one.name} [{one.unit or 1}]", *names, *names_at_rest(count)][: len(expected.value)], readings, expected
