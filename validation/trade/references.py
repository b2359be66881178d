"""python -m validation.trade.references: the references of the trade, by two methods that agree to 1e-10.

Both are explicit, at steps within their limits of stability: RK10, and RK4 at half its step; halved until they agree.
No implicit method that the trade judges has a part in its own reference. A scene whose file is there, of the same
scene, is skipped: stopped at any time, the program goes on where it was. All of it takes some minutes.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import sys
import time
from collections.abc import Sequence

import numpy as np

import flexlink as fl
from flexlink.common.errors import FlexlinkError
from flexlink.common.output import write_whole
from flexlink.describe.scene import Scene
from flexlink.inputs.initial_state import initial_state
from flexlink.results.tip_motion import tip_travel
from validation.reference_values import REFERENCE_FOLDER, look_up
from validation.trade.scenes import Seen, is_of, probe, reference_name, scenes, seen, trade_scene

AGREE = 1e-10  # of the motion; a hundredth of the smallest error that the trade asks for
OF_STABLE = 0.9  # of the largest stable step at the start, which postures passed later may shorten
HALVINGS = 6


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute what is not there; 0 if every scene has its reference."""
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
    """Whether the reference of this very scene is stored, whole."""
    path = REFERENCE_FOLDER / f"{reference_name(name)}.json"
    return path.is_file() and "bend" in look_up(reference_name(name)) and is_of(trade_scene(name), name)


def compute(name: str) -> float:
    """Compute and store; how far the two methods are apart, over the motion.

    Raises
    ------
    FlexlinkError
        They do not agree, or a run fails.
    """
    scene, start = trade_scene(name), time.process_time()
    for halvings in range(HALVINGS):
        tenth, step10 = _run(scene, "RK10", 2**halvings)
        fourth, step4 = _run(scene, "RK4", 2 ** (halvings + 1))
        apart = float(np.linalg.norm(tenth.tip - fourth.tip, axis=1).max()) / tip_travel(tenth.tip)
        if apart <= AGREE:
            methods = {"RK10": step10, "RK4": step4}
            _store(name, scene, tenth, apart, methods, time.process_time() - start)
            return apart
    raise FlexlinkError(f"{name}: RK10 at {step10:g} s and RK4 at {step4:g} s are {apart:.1e} of the motion apart")


def _run(scene: Scene, method: str, divided: int) -> tuple[Seen, float]:
    """What is seen at the outputs, and the step: the largest stable one that divides a sample, divided."""
    chain, sample = fl.lump(scene), scene.run.sample
    stable = fl.stable_step(chain, initial_state(scene, chain)[0], method=method)
    step = sample / (divided * math.ceil(sample / (OF_STABLE * stable)))
    return seen(chain, fl.simulate(scene, method=method, step=step).q), step


def _store(name: str, scene: Scene, found: Seen, apart: float, methods: dict[str, float], seconds: float) -> None:
    document = {
        "about": f"Tip of the trade's scene {name!r} at its outputs, and its deflection, in frame 0. {scene.about}",
        "source": "python -m validation.trade.references",
        "date": datetime.date.today().isoformat(),
        "cpu_seconds": round(seconds, 1),
        "reference": {
            "probe": probe(scene).tolist(),
            "steps_s": methods,
            "agree": apart,
            "t_s": scene.run.times.tolist(),
            "tip": found.tip.tolist(),
            "bend": found.bend.tolist(),
        },
    }
    path = REFERENCE_FOLDER / f"{reference_name(name)}.json"
    path.parent.mkdir(exist_ok=True)
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))


if __name__ == "__main__":
    sys.exit(main())
