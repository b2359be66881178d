"""The command `flexlink invert`."""

import argparse

import numpy as np

from flexlink.cli import shared
from flexlink.motion.inversion import Inversion, ShapedMove, invert


def run_command(options: argparse.Namespace) -> int:
    """Print pre-actuation, torques and errors beside those of a shaped move; 1 if the tip misses the tolerance."""
    scene = shared.varied_scene(options.scene, options)
    with shared.prefix_errors(options.scene):
        found = invert(scene, options.tip, duration=options.duration, tolerance=options.tolerance)
        beside = found.shaped(options.shaper)
    shared.print_lines("warning", found.warnings)
    options.document = {
        "scene": found.scene.name, "starts_s": found.starts, "ends_s": found.ends,
        "starts_before_s": found.starts_before, "ends_after_s": found.ends_after,
        "largest_torques": {f"{name} [{unit}]": x for name, unit, x in _torques(found)}, "tip_error_m": found.error,
        "residual_m": found.residual, "distance_m": found.distance, "beam_error_m": found.beam_error,
        "settles_s": found.settles, "met": found.met,
        "shaped": {"kind": options.shaper, "lag_m": beside.lag, "settles_s": beside.settles},
    }  # fmt: skip
    _print(found, beside, options.shaper)
    if options.out is not None:
        found.scene.save(options.out)
        shared.print_path("scene", options.out)
    if options.plot is not None:
        shared.save_plot(found.run.plot(), options.plot)
    return 0 if found.met else 1


def _torques(found: Inversion) -> list[tuple[str, str, float]]:
    """Names of the driven joints, and units and values of their largest torques."""
    chain = found.run.chain
    largest = zip(chain.active.tolist(), np.abs(found.torques).max(axis=0).tolist(), strict=True)
    return [(chain.joint_name(k), chain.torque_units[k], torque) for k, torque in largest]


def _print(found: Inversion, beside: ShapedMove, shaper: str) -> None:
    print(f"{found.scene.name}: the tip moves from {found.starts:.4g} to {found.ends:.4g} s")
    print(f"torques: begin {found.starts_before:.3g} s before the move, end {found.ends_after:.3g} s after it")
    print(f"largest torques: {', '.join(f'{name} {x:.4g} {unit}' for name, unit, x in _torques(found))}")
    error, after, distance = (f"{1e3 * x:.3g} mm" for x in (found.error, found.residual, found.distance))
    print(f"tip error of the nonlinear run: {error}, after the move {after}; in all directions {distance}")
    beam = f"{1e3 * found.beam_error:.3g} mm" if np.isfinite(found.beam_error) else "not known"
    print(f"tip error of a continuous beam, from a run with more hinges: {beam}")
    within = f"within {1e3 * found.tolerance:g} mm"
    print(f"{within}: {_settles(found.settles)}")
    lags = f"lags by {1e3 * beside.lag:.3g} mm"
    print(f"beside it, joint PD with shaper {shaper}: {lags}, {within} {_settles(beside.settles)}")


def _settles(seconds: float) -> str:
    return f"{seconds:.3g} s after the move" if np.isfinite(seconds) else "not by the end of the run"
