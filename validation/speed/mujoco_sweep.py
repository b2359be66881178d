"""Run members of a sweep in one process with MuJoCo; optionally, each run also compiles its model, or writes its text.

No results are read from the runs, which favours MuJoCo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.engines.mujoco import quiet
from flexlink.formats.mjcf import to_mjcf
from flexlink.motion.inputs.initial_state import initial_state
from validation.speed.evaluations import from_python
from validation.speed.races import Work
from validation.speed.steps import take_in_mujoco


def works(members: Sequence[Scene]) -> Mapping[str, Work]:
    """Jobs that cycle through the members and run each to its end by RK4 with its own step."""
    texts = [_text(scene) for scene in members]
    models = list(map(_compiled, texts))
    starts = [initial_state(scene, lump(scene)) for scene in members]
    datas = list(map(mujoco.MjData, models))

    def run(k: int) -> None:
        _run(members[k], models[k], datas[k], starts[k])

    def compile_and_run(k: int) -> None:
        model = _compiled(texts[k])
        _run(members[k], model, mujoco.MjData(model), starts[k])

    def write_compile_and_run(k: int) -> None:
        model = _compiled(_text(members[k]))
        _run(members[k], model, mujoco.MjData(model), initial_state(members[k], lump(members[k])))

    each = {"run": run, "compile, run": compile_and_run, "write, compile, run": write_compile_and_run}
    return {name: from_python(one, len(members)) for name, one in each.items()}


def _text(scene: Scene) -> str:
    return to_mjcf(lump(scene), shapes=False)


def _compiled(text: str) -> mujoco.MjModel:
    with quiet():
        return mujoco.MjModel.from_xml_string(text)


def _run(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: tuple[Any, Any]) -> None:
    model.opt.timestep = scene.run.fixed_step
    take_in_mujoco(scene, model, data, start, round(scene.run.duration / scene.run.fixed_step))
