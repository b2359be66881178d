"""The message about an unstable sampled loop: what grows, how fast, and one change that makes it stable."""

import math

import numpy as np

from flexlink.motion.loop.loop import STABLE, Loop

FASTEST = 1e4  # highest sampling rate that is proposed [Hz]


def instability(loop: Loop) -> tuple[str, str]:
    """What is unstable, in one line, and remedies, each of which makes the linear loop stable."""
    pole = loop.poles[0]
    late = f" with {1e3 * loop.delay:.3g} ms of delay" if loop.delay else ""
    frequency = f", {pole.hertz:.3g} Hz," if pole.hertz else ""
    grows = f"{pole.motion}{frequency} grows {loop.growth:.3g}-fold a sample"
    text = f"control loop unstable at {loop.rate:g} Hz{late}: {grows}"
    gains = (("kp",), ("kd", "ki")) if loop.scene.drive.kind == "cascade" else (("kd",), ("kp", "kd"))
    changes = [_of_delay(loop), _of_rate(loop), *(_of_gain(loop, *names) for names in gains), _of_armature(loop)]
    if any(changes):
        return text, f"stable with {' or with '.join(filter(None, changes))}"
    tried = f"delay 0, rates up to {FASTEST:g} Hz, a hundredth of the gains, armature"
    return text, f"unstable with each of these alone: {tried}; combine them, and give the links their damping"


def _of_delay(loop: Loop) -> str:
    if not loop.delay:
        return ""
    largest = _rounded(loop.largest("drive.delay"))
    good = largest > 0 and math.isfinite(largest) and loop.growth_with(delay=largest) <= STABLE
    return f"drive.delay ≤ {1e3 * largest:.3g} ms" if good else ""


def _of_rate(loop: Loop) -> str:
    """A multiple of the rate, so that samples and steps that fit the rate remain so."""
    least = loop.largest("drive.rate")
    if not least <= FASTEST:
        return ""
    rate = math.ceil(least / loop.rate) * loop.rate
    return f"drive.rate = {rate:.6g} Hz" if loop.growth_with(rate=rate) <= STABLE else ""


def _of_gain(loop: Loop, *names: str) -> str:
    gains = {f"drive.{name}": getattr(loop.scene.drive, name) or () for name in names}

    def growth(factor: float) -> float:
        changes = {path: tuple(factor * gain for gain in row) for path, row in gains.items() if row}
        return loop.with_scene(loop.scene.varied(changes)).growth

    factor, step, least = 1.0, 1.3, 0.01
    while factor > least and growth(factor) > STABLE:
        factor /= step
    factor = _rounded(factor)
    good = factor > least and growth(factor) <= STABLE
    return f"{' and '.join(names)} times {factor:.2g}" if good else ""


def _of_armature(loop: Loop) -> str:
    """Least inertia of motors, of ½ … 8 times k_d T, that makes the loop stable; "" if none, or if units differ."""
    links = loop.scene.arm.links
    driven = [links[loop.plant.chain.coordinates[k].link - 1].joint for k in loop.plant.chain.active[loop.plant.moving]]
    units = {name.partition("[")[2].removesuffix("]") for name in loop.inputs}
    if len(units) > 1:
        return ""
    unit = {"N": "kg", "N m": "kg m²"}[units.pop()]
    rates = loop.law.K[:, loop.plant.chain.n + loop.plant.chain.active[loop.plant.moving]]
    scale = -float(np.diag(rates).min()) * (1.0 / loop.rate + loop.delay)
    for factor in (0.5, 1.0, 2.0, 4.0, 8.0):
        value = _rounded(factor * scale)
        larger = value > max(joint.armature for joint in driven)
        if larger and loop.varied("link.*.joint.armature", value).growth <= STABLE:
            return f"link.*.joint.armature = {value:.2g} {unit}"
    return ""


def _rounded(value: float) -> float:
    """The value rounded down to two digits, away from the boundary of stability."""
    if not math.isfinite(value) or value <= 0:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit * (1 - 1e-9)) * unit:.2g}")
