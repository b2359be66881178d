"""hints(scene): reports numbers that were likely given in another unit, one line each."""

import fnmatch
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.memo import keep_last
from flexlink.data.documents import paths_of
from flexlink.describe.material import BREADTHS
from flexlink.describe.plausibility import loads, sizes
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names


@keep_last(64)
def hints(scene: Scene) -> tuple[Diagnostic, ...]:
    """Numbers that were probably given in another unit, each with plausible values and the likely unit, one line each.

    It never raises, and only does arithmetic on the scene's numbers, without lumping. Units are inferred from ranges of
    material properties, slenderness, sizes relative to the arm, strains under its load, and the digits of angles.
    """
    try:
        return tuple(_hints(scene))
    except ArithmeticError:  # overflow is refused when the chain is built
        return ()


def _hints(scene: Scene) -> Iterator[Diagnostic]:
    arm, about, g = scene.arm, loads.situation_of(scene), math.hypot(*scene.gravity)
    causes = [*sizes.of_materials(arm), *sizes.of_sections(arm)]
    causes += sizes.hint_if_outside("gravity", scene.gravity, "gravity_of_one" if g == 1.0 else "gravity", g)
    causes += [*loads.of_places(scene, about), *loads.of_masses(scene, about)]
    yield from causes
    document, names = scene.document(), {"link": "name", "tie": "name", "sensor": "name", "motion": "link"}
    named = {key: {str(part[name]): part for part in document[key]} for key, name in names.items()}
    numbers = list(paths_of(document | named))
    yield from of_numbers(numbers)
    yield from loads.of_bodies(scene, about)
    yield from _of_turns(scene)
    yield from of_times(scene, about, numbers)
    yield from of_sensors(scene, about)
    if not causes:  # these hints depend on the numbers checked above
        yield from list(loads.of_loads(scene, about)) or loads.of_joints(scene, about)


def of_numbers(numbers: Sequence[tuple[str, Any]]) -> Iterator[Diagnostic]:
    """Hints on numbers that are implausible by themselves, at the `paths` of their quantity."""
    patterns = {pattern: name for name, known in sizes.ranges().items() for pattern in known.paths}
    for path, value in numbers:
        for pattern, name in patterns.items():
            if fnmatch.fnmatchcase(path, pattern) and np.any(value):
                yield from sizes.hint_if_outside(path, value, name, float(np.abs(value).max()))
                yield from _of_angles(path, value if isinstance(value, list) else [value]) if name == "angle" else ()


def of_sensors(scene: Scene, about: loads.Situation) -> Iterator[Diagnostic]:
    """Hints on gauges outside their link's section or where no strain is, on rates, currents, and resolutions."""
    arm = scene.arm
    for sensor in scene.sensor:
        path, k = f"sensor.{sensor.name}", arm.number(sensor.link) - 1 if sensor.kind in {"strain", "current"} else 0
        if sensor.torque_constant is not None and not arm.links[k].joint.slides:
            amperes = about.pull * about.first_moment(k) / sensor.torque_constant
            given, detail = sensor.torque_constant, f" {amperes:.2g} A"
            yield from sizes.hint_if_outside(f"{path}.torque_constant", given, "current", amperes, -1.0, detail)
        if sensor.rate is not None and sensor.rate * scene.run.duration < 1:
            yield from sizes.hint_if_outside(f"{path}.rate", sensor.rate, "rate", sensor.rate)
        if sensor.resolution is not None and column_names((sensor,), arm) == (f"{sensor.name} [rad]",):
            yield from sizes.hint_if_outside(f"{path}.resolution", sensor.resolution, "resolution", sensor.resolution)
        if sensor.fibre is None:
            continue
        if not sensor.fibre[0] and arm.links[k].flex == "z":
            text = f"{path}.fibre = {sizes.shown(sensor.fibre)} m: no strain at y = 0, as the link bends only about z"
            yield Diagnostic(f"{text}; give y, such as [{max(sensor.fibre) or 0.01:g}, 0]", "no-effect")
        section = arm.sections.get(arm.links[k].section or "")
        if section is not None:
            whole = sizes.largest_dimension(section)[1]
            sides = [getattr(section, key) for key in reversed(BREADTHS.get(section.shape, ()))] or [whole, whole]
            part = max(abs(place) / (side / 2) for place, side in zip(sensor.fibre, sides, strict=True))
            yield from sizes.hint_if_outside(f"{path}.fibre", sensor.fibre, "fibre", part)


def _of_angles(path: str, values: Sequence[float]) -> Iterator[Diagnostic]:
    """Hints on angles in degrees whose digits match multiples of 5° in radians."""
    nonzero = [value for value in values if value]
    several = len(nonzero) > 1 and all(_looks_like_radians(value, 15) for value in nonzero)
    found = several or any(map(_looks_like_radians, nonzero))
    if nonzero and max(map(abs, nonzero)) <= 2 * math.pi + 0.01 and found:
        inner = ", ".join(f"{math.degrees(value):.4g}" for value in values)
        why = f"the digits match round angles in radians; likely given in rad: in degrees [{inner}]"
        yield Diagnostic(f"{path} = {sizes.shown(values)} deg: {why}", "likely-radians")


def _of_turns(scene: Scene) -> Iterator[Diagnostic]:
    """Hints on tables through more than a turn that end at no whole degree, as degrees in a column of radians do.

    Also on tables that jump by a turn, on rates that are as much too small as radians are in degrees, and on columns
    of a motion that contradict each other.
    """
    reference = scene.drive.reference
    columns = {f"motion.{motion.link}": motion.angle_deg for motion in scene.motion}
    if reference is not None and reference.angle_deg:
        rows = zip(scene.arm.links, zip(*reference.angle_deg, strict=True), strict=True)
        columns |= {f"drive.reference, joint {link.name!r}": column for link, column in rows}
    for path, angles in columns.items():
        if angles and max(angles) - min(angles) > 360.0 and abs(angles[-1] - round(angles[-1])) > 1e-6:
            turns = (max(angles) - min(angles)) / 360.0
            remedy = "if the column was in degrees, write [deg] in its name instead of [rad]"
            yield Diagnostic(f"{path}: {turns:.3g} turns; {remedy}", "likely-degrees")
        steps = np.abs(np.diff(angles or ()))
        if len(steps) > 6 and 180.0 < steps.max() <= 360.0 and 360.0 - steps.max() <= 2 * np.median(steps):
            row = f"{path}: jumps by {steps.max():.4g}° at row {int(steps.argmax()) + 1}, counted from 0"
            remedy = "likely an encoder that begins a turn again: numpy.unwrap(angles, period=360) makes it continuous"
            yield Diagnostic(f"{row}; {remedy}", "likely-wrapped")
    for motion in scene.motion:
        if motion.angle_deg and motion.rate_deg and motion.times:
            rates, change = np.array(motion.rate_deg), np.abs(np.diff(motion.angle_deg)).sum()
            by_rates = (np.abs(rates[1:] + rates[:-1]) / 2 * np.diff(motion.times)).sum()
            if by_rates and abs(math.radians(change / by_rates) - 1) < 0.1:
                why = f"the angles change {change / by_rates:.3g} times as fast; likely given in rad/s"
                yield Diagnostic(f"motion.{motion.link}.rate_deg: {why}: multiply by 57.2958", "likely-radians")
        for (key, given), (slope, slopes) in itertools.pairwise(zip(motion.keys, motion.columns, strict=True)):
            change, mean = np.abs(np.diff(given)).sum(), (np.array(slopes[1:]) + slopes[:-1]) / 2
            if len(given) > 8 and (total := np.abs(mean * np.diff(motion.times)).sum()) > 10.0 * change:
                why = f"adds up to {total:.3g}, while {key} changes by {change:.3g}; the joint follows both"
                remedy = "integrate the record, or give a file of positions with cutoff = 'auto'"
                yield Diagnostic(f"motion.{motion.link}.{slope}: {why}; {remedy}", "columns-disagree")


def _looks_like_radians(value: float, coarse: int = 90) -> bool:
    """Whether the decimals match a multiple of 5° in radians, or, if there are only two, of a coarser angle [deg]."""
    decimals = len(f"{abs(value):.12g}".partition(".")[2])
    if decimals < 2 or "e" in f"{value:.12g}":
        return False
    unit = math.radians(5 if decimals > 2 else coarse)
    nearest = round(abs(value) / unit) * unit
    return nearest > 0 and abs(abs(value) - nearest) <= 1.1 * 10.0**-decimals


def of_times(scene: Scene, about: loads.Situation, numbers: Sequence[tuple[str, Any]]) -> Iterator[Diagnostic]:
    """Hints on tables much longer than the run, and on tolerances large for the arm's reach."""
    run = scene.run
    for path, times in numbers:
        if path.endswith(".times") and run.duration > 0 and (last := times[-1]) > 10.0:
            yield from sizes.hint_if_outside(f"{path}[{len(times) - 1}]", last, "times", last / run.duration)
    if run.tolerance is not None and about.reach > 0:
        part = run.tolerance / about.reach
        yield from sizes.hint_if_outside("run.tolerance", run.tolerance, "tolerance", part, 1.0, f" {part:.2g}")
