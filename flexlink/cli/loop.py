"""The command `flexlink loop`."""

import argparse

from flexlink.chain.arguments import integer
from flexlink.cli.shared import prefix_errors, save_plot, varied_scene
from flexlink.common.notebook import drawing_module
from flexlink.motion.loop.instability import instability
from flexlink.motion.loop.loop import Loop, loop


def run_command(options: argparse.Namespace) -> int:
    """Print poles, margins and limits of the loop; return 1 if it is unstable."""
    scene, count = varied_scene(options.scene, options), integer("--count", options.count, 1)
    with prefix_errors(options.scene):
        found = loop(scene)
        along = found.over(options.over, options.values) if options.over else []
        rows = [{options.over: x, "growth": each.growth} for x, each in zip(options.values, along, strict=True)]
        options.document = as_document(found, count) | ({"over": rows} if rows else {})
        _show(found, count)
        for row in rows:
            print(f"{options.over} = {row[options.over]:g}: growth {row['growth']:.6g}")
        if options.plot:
            if along:
                drawing = drawing_module("results.plotting")
                poles = [[pole.z for pole in each.poles] for each in along]
                figure = drawing.plot_poles(poles, sampled=bool(found.rate), title=options.over, values=options.values)
            else:
                figure = found.plot(options.kind, options.input or 0)
            save_plot(figure, options.plot)
    return 0 if found.stable else 1


def as_document(found: Loop, count: int) -> dict[str, object]:
    """The loop as numbers with units, for JSON."""
    poles = [{"z": [p.z.real, p.z.imag], "frequency_hz": p.hertz, "motion": p.motion} for p in found.poles[:count]]
    return {
        "stable": found.stable, "growth": found.growth, "rate_hz": found.rate, "delay_s": found.delay, "poles": poles,
        "margins": [each._asdict() for each in found.margins],
        "largest_delay_s": found.largest("drive.delay") if found.rate else None,
        "largest_gain": found.largest("gain"),
    }  # fmt: skip


def _show(found: Loop, count: int) -> None:
    per = "a sample" if found.rate else "a second"
    print(f"{'stable' if found.stable else 'UNSTABLE'}: small motion changes by a factor of {found.growth:.6g} {per}")
    print("   |z|        frequency [Hz]  motion" if found.rate else "   Re s [1/s]  frequency [Hz]  motion")
    for pole in found.poles[:count]:
        print(f"   {abs(pole.z) if found.rate else pole.s.real:<10.6g}  {pole.hertz:>13.5g}  {pole.motion}")
    if not found.stable and found.rate:
        print("; ".join(instability(found)))
        return
    for each in found.margins:
        low, high = each.gain
        gains = f"stable with {low:.3g} … {high:.3g} times the torque, phase margin {each.phase:.3g}°"
        rest = f"bandwidth {each.bandwidth:.3g} Hz, sensitivity peak {each.sensitivity:.3g}"
        print(f"{each.input}: {gains}, delay margin {1e3 * each.delay:.3g} ms, disk margin {each.disk:.3g}, {rest}")
    if found.rate:
        print(
            f"all torques together: stable up to {1e3 * found.largest('drive.delay'):.3g} ms of delay, "
            f"{found.largest('gain'):.3g} times the torque, and down to {found.largest('drive.rate'):.4g} Hz"
        )
