"""python -m validation.trade.references: compute the trade study's references, by two methods that agree to 1e-10.

Both methods are explicit and run within their stability limits: RK10, and RK4 with half its step. Steps are halved
until both agree. No implicit method of the trade study contributes to its own reference. A scene with a valid stored
reference is skipped, so the program can be stopped and continued at any time. All scenes together take a few minutes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import flexlink as fl
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.reference_values import look_up, reference_file, store_reference
from validation.runs import stable_steps
from validation.trade.scenes import Seen, is_of, probe, reference_name, scenes, seen, trade_scene

AGREE = 1e-10  # of the motion; a hundredth of the smallest error that the trade study uses
OF_STABLE = 0.9  # fraction of the largest stable step at the initial state; later configurations may shorten it
HALVINGS = 9


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute missing references; return 0 if every scene has a reference."""
    parser = argparse.ArgumentParser(prog="python -m validation.trade.references", description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(scenes()), help="names (default: all)")
    missing = [name for name in parser.parse_args(arguments).scenes if not is_there(name)]
    failed = False
    for name in missing:
        try:
            print(f"{name}: agree to {compute(name):.1e} of the motion", flush=True)
        except FlexlinkError as error:
            failed = True
            print(f"trade_references: {error}", file=sys.stderr)
    return 2 if failed else 0


def is_there(name: str) -> bool:
    """Whether a complete reference of exactly this scene is stored."""
    path = reference_file(reference_name(name))
    return path.is_file() and "bend" in look_up(reference_name(name)) and is_of(trade_scene(name), name)


def compute(name: str) -> float:
    """Compute and store a reference; return the distance of the two methods, relative to the motion.

    Raises
    ------
    FlexlinkError
        The methods do not agree, or a run fails.
    """
    scene, start = trade_scene(name), time.process_time()
    for halvings in range(HALVINGS):
        try:
            tenth, step10 = _run(scene, "RK10", 2**halvings)
            fourth, step4 = _run(scene, "RK4", 2 ** (halvings + 1))
        except DivergenceError:  # the largest stable step decreases during the run
            continue
        agree = largest_distance(tenth.tip, fourth.tip) / tip_travel(tenth.tip)
        if agree <= AGREE:
            store_reference(
                reference_name(name),
                f"Tip of the trade's scene {name!r} at its outputs, and its deflection, in frame 0. {scene.about}",
                "python -m validation.trade.references",
                time.process_time() - start,
                reference={
                    "probe": probe(scene).tolist(), "steps_s": {"RK10": step10, "RK4": step4}, "agree": agree,
                    "t_s": scene.run.times.tolist(), "tip": tenth.tip.tolist(), "bend": tenth.bend.tolist(),
                },
            )  # fmt: skip
            return agree
    raise FlexlinkError(f"{name}: RK10 and RK4 do not agree after halving their steps {HALVINGS - 1} times")


def _run(scene: Scene, method: str, divided: int) -> tuple[Seen, float]:
    """Outputs of a run and its step: the largest stable step that divides the sample time, divided by `divided`."""
    step = scene.run.spacing / (divided * stable_steps(scene, method, OF_STABLE))
    return seen(fl.lump(scene), fl.simulate(scene, method=method, step=step).q), step


if __name__ == "__main__":
    sys.exit(main())
