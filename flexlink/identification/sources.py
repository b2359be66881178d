"""All measurements of a problem as sources: recorded runs, and single measurements and responses at rest."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import modes
from flexlink.identification.block import Block
from flexlink.identification.data import Source, recorded
from flexlink.identification.frequency_response import at_rest, measured_response, predicted
from flexlink.identification.problem import FitFrf, FitModes, FitProblem, FitStatic, Use


def tapped(problem: FitProblem, part: FitModes, number: int) -> Source:
    """Source of measured natural frequencies and damping ratios."""
    name = f"modes {number}"
    indices = np.array(part.numbers or range(1, len(part.hertz) + 1)) - 1
    σ = np.broadcast_to(np.array(part.deviation), len(part.hertz)).astype(float)
    blocks = [Block("frequency [Hz]", np.array(part.hertz), σ, True)]
    if part.ratios:
        ratios = np.array(part.ratios)
        blocks.append(Block("damping ratio [1]", ratios, np.full(len(ratios), part.ratio_deviation), True))

    def of(scene: Scene) -> list[Array]:
        chain, rest, load = at_rest(scene)
        held = chain.active.tolist() if part.locked is None else list(part.locked)
        found = modes(chain, rest.q, **load, locked=held)
        elastic = np.flatnonzero(np.array(found.kinds) == "elastic")
        if len(elastic) <= indices.max():
            raise ArgumentError(
                f"{name}: mode {indices.max() + 1} was measured; the model has only {len(elastic)} elastic modes",
                id="unknown-mode",
            )
        which = elastic[indices]
        return [found.hertz[which], found.damping_ratios[which]][: len(blocks)]

    scene = problem.scene.varied(part.set) if part.set else problem.scene
    return Source(name, part.use, scene, tuple(blocks), at_rest=of)


def sagged(problem: FitProblem, part: FitStatic, number: int) -> Source:
    """Source of one measured coordinate of the tip at rest, or of the change of this coordinate between two states."""

    def tip(scene: Scene) -> float:
        chain, rest, _ = at_rest(scene)
        return float(tip_position(chain, rest.q)["xyz".index(part.axis)])

    def of(scene: Scene) -> list[Array]:
        before = 0.0 if part.before is None else tip(scene.varied(part.before))
        return [np.array([tip(scene) - before])]

    scene = problem.scene.varied(part.set) if part.set else problem.scene
    block = Block(f"tip {part.axis} [m]", np.array([part.value]), np.array([part.deviation]), True)
    return Source(f"static {number}", part.use, scene, (block,), at_rest=of)


def responded(problem: FitProblem, part: FitFrf, number: int) -> Source:
    """Source of a measured frequency response: its real part and its imaginary part."""
    coarse = 0.1  # standard deviation of a logarithm in the first search, which the whole curve then determines
    name, scene = f"frf {number}", problem.scene.varied(part.set) if part.set else problem.scene
    found = measured_response(scene, part, name)

    def parts(scene: Scene) -> list[Array]:
        H = predicted(scene, found.input, found.output, found.f)
        return [H.real.copy(), H.imag.copy()]

    def log_size(scene: Scene) -> list[Array]:
        return [np.log(_not_zero(np.abs(predicted(scene, found.input, found.output, found.f))))]

    magnitude = _not_zero(np.abs(found.H))
    size = Block(f"ln {found.name}", np.log(magnitude), np.maximum(found.σ / magnitude, coarse), True)
    rough = Source(name, part.use, scene, (size,), at_rest=log_size, response=found)
    real = Block(f"Re {found.name}", found.H.real.copy(), found.σ, True)
    imaginary = Block(f"Im {found.name}", found.H.imag.copy(), found.σ, True)
    return Source(name, part.use, scene, (real, imaginary), at_rest=parts, response=found, rough=rough)


def _not_zero(size: Array) -> Array:
    """Magnitudes with zeros, whose logarithm is infinite, replaced by a small part of the largest one."""
    least = 1e-12
    return np.asarray(np.maximum(size, least * (size.max() or 1.0)))


def sources_of(problem: FitProblem, use: Use) -> list[Source]:
    """All sources with one use, "fit" or "check"."""
    found: list[Source] = []
    for run in problem.run:
        if run.use == use:
            try:
                found.append(recorded(problem, run))
            except (DataFileError, SceneError) as error:
                text = str(error)
                raise type(error)(text if text.startswith("run ") else f"run {run.name!r}: {text}") from None
    found += [tapped(problem, one, k) for k, one in enumerate(problem.modes, 1) if one.use == use]
    found += [sagged(problem, one, k) for k, one in enumerate(problem.static, 1) if one.use == use]
    found += [responded(problem, one, k) for k, one in enumerate(problem.frf, 1) if one.use == use]
    return found
