"""Notes on the data before a fit, warnings about the estimates after it, and why a parameter has no effect."""

from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.describe.link import AXES
from flexlink.describe.scene import Scene
from flexlink.describe.vary import parts_of
from flexlink.identification.block import noise_in, unit_in
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source
from flexlink.identification.fitted import Estimate, FittedColumn
from flexlink.identification.identifiability import Check, Direction
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found
from flexlink.motion.simulate import simulate


def notes(sources: Sequence[Source]) -> list[Diagnostic]:
    """Notes on the data that were read, and on assumed noise."""
    even = 0.1  # allowed variation of the sampling interval, relative to its mean
    found = []
    for source in sources:
        several = len({len(block.y) for block in source.blocks}) > 1 and source.is_run
        names = ", ".join(f"{block.name} ({len(block.y)})" if several else block.name for block in source.blocks)
        use, count = f" ({source.use})" if source.use != "fit" else "", max(len(block.y) for block in source.blocks)
        text = f"{count} samples at {source.rate:.4g} Hz, {source.shows}" if source.is_run else plural(count, "number")
        found.append(Diagnostic(f"{source.name}{use}: {names}; {text}", "data-read"))
        found += _doubts(source) if source.is_run else []
        steps = {block.name: np.diff(block.t) for block in source.blocks if block.t is not None}
        uneven = [name for name, between in steps.items() if np.ptp(between) > even * between.mean()]
        if uneven:
            text = f"{source.name}: samples of {', '.join(uneven)} are unevenly spaced, as after an empty cell or a "
            text += "lost row; intervals assume even spacing"
            found.append(Diagnostic(text, "uneven-samples"))
        found += _of_noise(source) if source.use == "fit" else []
    return found


def _of_noise(source: Source) -> list[Diagnostic]:
    """Notes on noise that is not stated: its estimate from the data, or that it is assumed."""
    unknown = [(block, noise_in(block)) for block in source.blocks if not block.stated]
    found = [
        Diagnostic(
            f"{source.name}: noise of {block.name} is not stated; estimated from the data: {σ:.2g}", "estimated-noise"
        )
        for block, σ in unknown if σ is not None
    ]  # fmt: skip
    assumed = ", ".join(block.name for block, σ in unknown if σ is None)
    text = f"{source.name}: noise of {assumed} is not stated; 1 % of the range is assumed"
    return [*found, *([Diagnostic(text, "assumed-noise")] if assumed else [])]


def _doubts(source: Source) -> list[Diagnostic]:
    return [Diagnostic(f"{source.name}: {doubt}", doubt.id) for doubt in source.doubts]


def ranges_apart(at: Likelihood) -> list[Diagnostic]:
    """Warnings about columns whose range differs from the prediction by a large factor, so the unit may be wrong."""
    rounded = 1e-9  # a predicted range is rounding error if, relative to the values, it is smaller than this
    apart = 100.0  # factor between measured and predicted range above which the unit may be wrong
    found = []
    for source, part in zip(at.sources, at.rows, strict=True):
        for block, y, *_ in part:
            measured, ours = float(np.ptp(block.y)), float(np.ptp(y))
            moves = ours > rounded * max(measured, float(np.abs(y).max()))
            if block.t is not None and not block.gain and moves and not 1 / apart < measured / ours < apart:
                text = f"{source.name}: {block.name} ranges over {measured:.3g} {block.unit}, its prediction at the "
                text += f"initial guess over {ours:.3g} {block.unit}; check the unit of the column"
                found.append(Diagnostic(text, "likely-unit"))
    return found


def _times_fitted(one: FittedColumn, columns: Sequence[FittedColumn]) -> float:
    """Ratio of the RMS residuals of a column in a check run and in fitted runs, or the stated noise; 0: not fitted."""
    residuals = [other.residual(other.after) for other in columns if other.use == "fit" and other.name == one.name]
    largest = max(*residuals, one.noise * one.stated) if residuals else 0.0  # one reading is fitted exactly
    return one.off(one.after) / largest if one.use == "check" and largest > 0 else 0.0


def mixed_up(at: Likelihood) -> list[Diagnostic]:
    """Warnings about single numbers in another unit or of the other sign, by their predictions at the initial guess."""
    found, mistakes = [], (  # by the unit: the measured over the predicted number, its tolerance, and what is likely
        ("Hz", 2 * np.pi, 1.05, "2π times", "likely given in rad/s: in Hz"),
        ("m", 1e3, 3.0, "about 1000 times", "likely given in mm: in m"),
        ("m", -1.0, 3.0, "opposite to", "check the axis and the sign of the load: likely"),
    )  # fmt: skip
    for source, part in zip(at.sources, at.rows, strict=True):
        for block, y, *_ in part:
            ratio = np.divide(block.y, y, out=np.zeros(y.shape), where=y != 0)
            for unit, factor, within, times, likely in mistakes * (block.t is None):
                if unit == block.unit and ((ratio / factor > 1 / within) & (ratio / factor < within)).all():
                    given, true = (", ".join(f"{f:.4g}" for f in row) for row in (block.y, block.y / factor))
                    text = f"{source.name}: {block.name} = [{given}]: {times} the predictions at the initial guess; "
                    found.append(Diagnostic(f"{text}{likely} [{true}]", "likely-unit"))
    return found


def warnings(
    numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], check: Check, found: Sequence[Found],
    columns: Sequence[FittedColumn], sources: Sequence[Source],
) -> tuple[Diagnostic, ...]:  # fmt: skip
    """Warnings about the estimates of a fit and its model."""
    far = 2.0  # ratio of residual to stated noise, or to the residual of the fitted runs, above which to warn
    fitted = [one for one in columns if one.use == "fit"]
    at_noise = bool(fitted) and all(one.stated and one.times_noise <= far for one in fitted)
    same = 1 + sum(bool(np.allclose(end.x, found[0].x, rtol=0, atol=1e-4)) for end in found[1:])
    found_warnings = _of_estimates(numbers, coordinates, settled=at_noise or 1 < len(found) == same)
    found_warnings += [one.text for one in check.directions]
    found_warnings += [
        Diagnostic(
            f"{one.source}, {one.name}: the residual is {one.times_noise:.2g} times the stated noise; the noise is "
            "larger, or the model is incomplete", "residual-above-noise",
        )
        for one in fitted if one.stated and one.times_noise > far
    ]  # fmt: skip
    found_warnings += [doubt for source in sources for doubt in _doubts(source)]
    found_warnings += [
        Diagnostic(
            f"{one.source}, {one.name}: the residual is {times:.2g} times as large as in the fitted runs; the "
            "estimates are too inaccurate for this run (fit it as well), or the model is incomplete",
            "worse-than-fitted-runs",
        )
        for one in columns if (times := _times_fitted(one, columns)) > far
    ]  # fmt: skip
    if same < len(found):
        text = f"{same} of {len(found)} initial guesses led to the best solution; others end at a higher cost"
        found_warnings.append(Diagnostic(text, "several-minima"))
    return tuple(found_warnings)


def _of_estimates(numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], *, settled: bool) -> list[Diagnostic]:
    """Warnings about estimates; `settled`: there is likely no better solution near the initial guess."""
    away = 10.0  # factor between estimate and initial guess of a positive parameter above which to warn
    apart = 3.0  # distance from the prior's mean above which to warn, in standard deviations of the prior
    wider = "its interval is wider than the linear estimate: it ends where the likelihood ratio rejects a value"
    doubt = "there may be a better solution near the initial guess: try --starts, or set between"
    remedy = "check the units of the measurements if this is unexpected" if settled else doubt
    # ids of doubts that other warnings already report
    stated = {"estimate-at-bound", "unbounded-interval", "grid-error", "input-error"}
    found = [
        Diagnostic(f"{one.name} ended at its bound, {one.value:.6g}", "estimate-at-bound")
        for one in numbers if one.at_bound
    ]  # fmt: skip
    found += [
        Diagnostic(f"{one.name} is {one.verdict}", one.doubt.id)
        for one in numbers if one.doubt is not None and one.doubt.id not in stated
    ]  # fmt: skip
    found += [
        Diagnostic(f"{one.name} moved from {one.start:.4g} to {one.value:.4g}; {remedy}", "far-from-initial-guess")
        for one, by in zip(numbers, coordinates, strict=False)
        if by.log and max(one.value / one.start, one.start / one.value) > away
    ]
    found += [Diagnostic(f"{one.name}: {wider}", "interval-widened") for one in numbers if one.widened]
    for one, by in zip(numbers, coordinates, strict=False):
        mean, deviation = by.prior or (one.value, 1.0)
        if (far := abs(one.value - mean) / deviation) > apart:
            text = f"{one.name} = {one.value:.4g} is {far:.2g} standard deviations from its prior, {mean:.4g} ± "
            text += f"{deviation:.2g}; the prior is wrong, or the parameter compensates for something that the model "
            found.append(Diagnostic(f"{text}lacks", "far-from-prior"))
    return found


def with_reasons(signals: Signals, x: Array, directions: Sequence[Direction]) -> tuple[Direction, ...]:
    """The same directions, with a reason for each single parameter that is not identifiable."""
    number = {one.name: k for k, one in enumerate(signals.coordinates)}
    return tuple(
        one._replace(why=_why(signals, x, number[one.names[0]]))
        if one.lost and len(one.names) == 1 and one.names[0] in number else one
        for one in directions
    )  # fmt: skip


def _why(signals: Signals, x: Array, k: int) -> str:
    if signals.coordinates[k].timing:
        return ""
    reasons = [_moves(signals, x, k), _axis(signals.sources[0].scene, signals.coordinates[k].path)]
    return "".join(f"; {reason}" for reason in reasons if reason)


def _moves(signals: Signals, x: Array, k: int) -> str:
    """Columns that the parameter affects in the first run that depends on it."""
    count = 2  # largest number of columns to name
    # Smallest range of a column, absolute and relative to its largest value: a constant column varies by rounding
    # errors, 1e-11 rad/s in the stages of a long explicit step.
    rounded = 1e-6
    moves = 1e-3  # smallest change that counts, relative to the range of all columns of the same unit
    by = 0.05  # change of the coordinate x_k, whose effect on the columns is computed
    own = signals.coordinates[k].run
    first = next((n for n, one in enumerate(signals.sources) if one.is_run and own in ("", one.name)), None)
    if first is None:
        return ""
    source, moved_point = signals.sources[first], x.copy()
    moved_point[k] += by if x[k] + by < signals.coordinates[k].bounds[1] else -by
    try:
        before, after = (simulate(signals.scene(first, point)).columns for point in (x, moved_point))
    except FlexlinkError:
        return ""
    names = [name for name in before if name != "t [s]" and unit_in(name) != "J"]
    ranges: dict[str, float] = {}
    for name in names:
        still = rounded * (1.0 + float(np.abs(before[name]).max()))
        ranges[unit_in(name)] = max(ranges.get(unit_in(name), 0.0), still, float(np.ptp(before[name])))
    moved = {name: float(np.abs(after[name] - before[name]).max()) / ranges[unit_in(name)] for name in names}
    measured = {block.name for block in source.blocks}
    free = (name for name in names if moved[name] > moves and name not in measured)
    most = sorted(free, key=lambda name: (name.startswith("q"), -float(f"{moved[name]:.3g}")))  # beam hinges last
    data = ", ".join(sorted(measured))
    if most:
        return f"it affects {' and '.join(most[:count])}; the data of {source.name} are {data}"
    return f"in {source.name} it changes no column by more than {moves:.1%} of its range"


def _axis(scene: Scene, path: str) -> str:
    """Text that names both axes if a root spring acts about an axis other than the bending axis; otherwise ""."""
    diagonal = 0.7  # axes differ if the cosine of their angle is at most this; at 45° both are bending axes
    parts = parts_of(path)
    if len(parts) != 4 or parts[0] != "link" or parts[2] not in {"root_stiffness", "root_damping"} or parts[1] == "*":
        return ""
    link = scene.arm.links[scene.arm.number(int(parts[1]) if parts[1].isdigit() else parts[1]) - 1]
    bent = [link.beam.frame[:, axis - 1] for axis in AXES[link.flex] if axis > 1]  # axis 1 is torsion
    if not bent or max(abs(float(axis["xyz".index(parts[3])])) for axis in bent) > diagonal:
        return ""
    about = " and ".join(map(_named, bent))
    text = f"{parts[2]}.{parts[3]} acts about the link's {parts[3]}, but with flex = {link.flex!r} the link bends about"
    return f"{text} its {about}: the axes of a section follow the joint axis, or `up`"


def _named(axis: Array) -> str:
    """Name of an axis (x, y or z), or its components if it is none of these."""
    largest = int(np.abs(axis).argmax())
    return "xyz"[largest] if abs(axis[largest]) > 0.999 else str([round(float(part), 3) + 0.0 for part in axis])
