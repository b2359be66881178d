"""The command `flexlink modes`."""

import argparse
import re
from collections.abc import Iterable

import numpy as np

from flexlink.chain.arguments import integer
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.cli.shared import prefix_errors, save_plot, varied_scene
from flexlink.common.errors import ArgumentError, ConvergenceError
from flexlink.common.notebook import drawing_module
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.tie import refuse_ties
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import Modes, modes
from flexlink.dynamics.vibration.steady import first_elastic_frequency, modes_in_motion, rest_of, steady_joint
from flexlink.motion.inputs.actuation import initial_wrench
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.intervals import intervals, names_at_rest


def print_modes(scene: Scene, found: Modes, which: Iterable[int]) -> None:
    """Print frequency, damping ratio and kind of modes, and the ratio that links specify at this frequency."""
    bending = [link for link in scene.arm.links if link.flex != "rigid"]
    constant = [link.damping.ratio for link in bending if link.damping is not None and link.damping.is_constant]
    η = [scene.arm.loss_time(link) for link in bending if link.damping is None or not link.damping.is_constant]
    is_specified = any(η) or any(constant)
    print("mode  frequency [Hz]  damping ratio  kind" + "      specified" * is_specified)
    for k in which:
        hertz, ratio = f"{found.hertz[k]:.6g}", f"{found.damping_ratios[k]:.4g}"
        if np.isnan(found.hertz[k]):
            hertz, ratio = "none (unstable)", "–"
        line = f"{k + 1:4d}  {hertz:>14}  {ratio:>13}  {found.kinds[k]:<8}"
        ratios = [*(each * found.frequencies[k] / 2 for each in η), *constant]
        bounds = [f"{bound(ratios):.4g}" for bound in (min, max)] if is_specified else []
        print("  ".join([line, " … ".join(dict.fromkeys(bounds))]).rstrip())


def as_document(found: Modes) -> list[dict[str, object]]:
    """Frequency [Hz], damping ratio and kind of every mode, for JSON."""
    rows = zip(found.hertz.tolist(), found.damping_ratios.tolist(), found.kinds, strict=True)
    return [{"frequency_hz": hertz, "damping_ratio": ratio, "kind": kind} for hertz, ratio, kind in rows]


def elastic_hertz(scene: Scene, chain: Chain, q: Array) -> float | None:
    """The first elastic frequency at rest with the driven joints locked [Hz]; None if there is no equilibrium."""
    wrench, frame = initial_wrench(scene, chain)
    try:
        return first_elastic_frequency(chain, q, tip_wrench=wrench, frame=frame)
    except ConvergenceError:
        return None


def first_elastic(hertz: float | None) -> str:
    """The first elastic frequency in words; it is unknown if `hertz` is None."""
    if hertz is None:
        return "first elastic frequency: unknown; no equilibrium with the driven joints locked"
    value = f"{hertz:.6g} Hz" if np.isfinite(hertz) else "none"
    return f"first elastic frequency: {value}, at rest with the driven joints locked"


def rates_of(chain: Chain, texts: Iterable[str]) -> dict[str, float]:
    """Rates of joints by name [rad/s, m/s], from strings such as hub=500rpm."""
    # conversion factors from the units of `--rate` to rad/s or m/s
    units = {"rpm": 2 * np.pi / 60, "deg/s": np.pi / 180, "rad/s": 1.0, "m/s": 1.0}
    rates = {}
    for text in texts:
        name, _, rate = text.partition("=")
        found = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(rpm|deg/s|rad/s|m/s)\s*", rate)
        if not found:
            why = f"--rate {text}: expected NAME=RATE with a unit, such as hub=500rpm; {', '.join(units)}"
            raise ArgumentError(why, id="option-value")
        of_joint = chain.joint_kinds[steady_joint(chain, name)]
        allowed = [unit for unit in units if (unit == "m/s") == (of_joint.si == "m")]
        if found[2] not in allowed:
            wanted = f"{name} {of_joint.moves}; allowed are {', '.join(allowed)}"
            raise ArgumentError(f"--rate {text}: {wanted}", id="option-value")
        rates[name] = float(found[1]) * units[found[2]]
    return rates


def first_in_motion(found: Modes, texts: Iterable[str]) -> str:
    """Text on the lowest frequency about a steady motion, and what restores it: springs or loads (centrifugal, …)."""
    hertz, motion = found.first_elastic_hertz, f"with {', '.join(texts)}"
    elastic = f"{hertz:.6g} Hz" if np.isfinite(hertz) else "none among these modes"
    swings = np.flatnonzero(found.hertz > 0)
    first = int(swings[np.argmin(found.hertz[swings])]) if len(swings) else 0
    if not len(swings) or found.kinds[first] == "elastic":
        return f"first elastic frequency: {elastic}, {motion}"
    by_loads = f"{found.hertz[first]:.6g} Hz, restored by loads ({found.kinds[first]})"
    return f"lowest frequency: {by_loads}; lowest restored by springs (elastic): {elastic}, {motion}"


def _modes(scene: Scene, options: argparse.Namespace) -> tuple[Chain, Modes, str]:
    """The chain, its modes as the options ask for them, and a line on the first elastic frequency."""
    chain = lump(open_chain(scene))
    names = {*chain.link_names, *chain.joint_names}
    locked = [int(name) if name.isdecimal() and name not in names else name for name in options.lock]
    wrench, frame = initial_wrench(scene, chain)
    posture = initial_state(scene, chain)[0]
    if options.rate:
        refuse_ties(scene.ties, "--rate and ties together are not supported")
        rates, count = rates_of(chain, options.rate), options.count
        found = modes_in_motion(chain, rates, posture, tip_wrench=wrench, frame=frame, locked=locked, count=count)
        return chain, found, first_in_motion(found, options.rate)
    found = modes(chain, posture, locked=locked, tip_wrench=wrench, frame=frame, count=options.count, ties=scene)
    if held := ["ties"] * bool(scene.ties) + [f"{', '.join(options.lock)} locked"] * bool(options.lock):
        return chain, found, first_in_motion(found, held)
    return chain, found, first_elastic(elastic_hertz(scene, chain, posture))


def _predicted(scene: Scene, options: argparse.Namespace) -> Array:
    """The tip at rest with the driven joints locked [m], nan if that is not known, and frequencies [Hz]."""
    chain, found, _ = _modes(scene, options)
    tip, (wrench, frame) = np.full(3, np.nan), initial_wrench(scene, chain)
    if not (scene.ties or scene.arm.base.free):
        tip = tip_position(chain, rest_of(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame).q)
    return np.concatenate([tip, found.hertz])


def run_command(options: argparse.Namespace) -> int:
    """Print modes, slowest first, and plot them on request."""
    scene = varied_scene(options.scene, options)
    integer("--count", options.count, 1)
    with prefix_errors(options.scene):
        chain, found, first = _modes(scene, options)
        if options.uncertain:
            expected = intervals(scene, lambda varied: _predicted(varied, options))
            names = names_at_rest(len(found.hertz))
    options.document = {"scene": scene.name, "modes": as_document(found), "summary": first}
    print_modes(scene, found, range(len(found.eigenvalues)))
    print(first)
    if options.uncertain:
        options.document |= {"intervals": expected.document(names)}
        print(*expected.lines(names), sep="\n")
    if options.plot is not None:
        save_plot(drawing_module("results.plotting").plot_modes(found, chain, options.count), options.plot)
    return 0
