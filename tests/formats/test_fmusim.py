"""FMUs of five models in a second importer, `fmusim`, against FMPy and flexlink's solver.

The runner of Modelica's Reference FMUs, in C, up to version 0.0.39, checks modelDescription.xml and has its own CVODE.
Its options to store states crash with every FMU: it frees a state by its value instead of a pointer to it.
"""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import ROOT
from tests.formats.test_code import needs_a_compiler

RUNNER = shutil.which("fmusim")
SCENES: dict[str, tuple[dict[str, Any], tuple[float, ...]]] = {  # changes of a model, and forces of its drives
    "paper_fig5": ({}, (0.0, 0.0, 0.0)),  # in a plane
    "t3_spatial": ({}, (6.0, -12.0, -4.0)),  # twist, friction, a load on the tip
    "two_mass_joint": ({}, (30.0,)),  # a motor behind an elastic gear
    "gantry": ({"link.boom.segments": 3}, (300.0, -80.0, 0.0)),  # slides
    "satellite": ({"link.*.segments": 3}, (5.0, -4.0, 3.0, 0.0, 0.0)),  # a free base, a tree
}
END, STEP = 0.3, 0.005


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.skipif(RUNNER is None, reason="needs fmusim, the runner of the Reference FMUs, on the path")
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", SCENES)
def test_two_importers_compute_the_same_numbers(name: str, fmi: int, tmp_path: Path) -> None:
    fmpy, path, (changes, forces) = pytest.importorskip("fmpy"), tmp_path / "arm.fmu", SCENES[name]
    run = fl.RunSettings(tolerance=1e-10, duration=END, sample=STEP)
    scene = fl.load_scene(ROOT / f"models/{name}.toml")
    scene = scene.varied({"drive": fl.Drive(kind="constant", torque=forces), "run": run} | changes)
    run = fl.simulate(scene)
    path.write_bytes(fl.to_fmu(run.chain, fl.initial_state(scene, run.chain), fmi=fmi))
    variables = fmpy.read_model_description(path).modelVariables
    driven = [k for k, link in enumerate(scene.arm.links) if not link.joint.locked]
    loads = [*np.array(forces)[driven], *(scene.wrench.force + scene.wrench.moment if scene.wrench else (0.0,) * 6)]
    inputs = [each.name for each in variables if each.causality == "input"]
    start = dict(zip(inputs, map(float, loads), strict=True)) | {"step": 1e-4}
    outputs = [each.name for each in variables if each.causality == "output"]
    given = [text for key, value in start.items() for text in ("--start-value", key, repr(value))]
    for kind, short in ("CoSimulation", "cs"), ("ModelExchange", "me"):
        table, options = tmp_path / f"{short}.csv", f"--solver cvode --tolerance 1e-9 --stop-time {END}".split()
        options += ["--output-interval", str(STEP), "--interface-type", short, "--output-file", str(table)]
        told = subprocess.run([str(RUNNER), *options, *given, path], capture_output=True, text=True, check=True)
        assert told.stdout + told.stderr == ""
        assert table.read_text(encoding="utf-8").splitlines()[0] == ",".join(f'"{key}"' for key in ["time", *outputs])
        found = np.loadtxt(table, delimiter=",", skiprows=1)
        settings = {"start_values": start, "relative_tolerance": 1e-9, "stop_time": END, "output_interval": STEP}
        other = fmpy.simulate_fmu(path, fmi_type=kind, solver="CVode", output=outputs, **settings)
        assert np.abs(found - np.array(other.tolist())).max() <= 1e-12
        tip = found[:, [1 + outputs.index(f"tip.{axis}") for axis in "xyz"]]
        assert np.abs(tip - run.tip).max() <= 1e-6
