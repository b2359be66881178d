"""Drake, Exudyn and its beams as witnesses: what they confirm, that they can deny, and that their absence is told."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT

from flexlink import Chain, engines, load_scene
from flexlink.common.errors import DataFileError
from flexlink.describe.spec import decode
from flexlink.errors import ArgumentError, MissingDependencyError
from validation.case import CASES, Measured, load_case
from validation.kinds import SETTINGS, exact_beams, measurements, witnesses
from validation.physics import beam_references
from validation.physics.beam_references import beam_reference, beam_scene, plane_of
from validation.physics.formulas import pulse

CASE = load_case(CASES / "trajectory_witnesses.toml")
BEAMS = load_case(CASES / "exudyn_beams.toml")
SHORT = {"motions": ["t3_spatial"], "duration": 0.02, "samples": 5}
with_exudyn = pytest.mark.skipif(importlib.util.find_spec("exudyn") is None, reason="not run: exudyn is not installed")


def judged(name: str, methods: list[str]) -> dict[str, float]:
    """Worst value over tolerance of every quantity that has one, in a short run of the case."""
    worst: dict[str, float] = {}
    for found in witnesses.run(CASE, {name: methods}, **SHORT):
        tolerance = CASE.quantity[found.quantity].tolerance
        if tolerance is not None:
            value = found.value / tolerance if tolerance else np.inf * found.value if found.value else 0.0
            worst[found.quantity] = max(worst.get(found.quantity, 0.0), value)
    return worst


@with_exudyn
@pytest.mark.slow
def test_a_spring_or_damper_wrong_by_a_millionth_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("flexlink.engines.exudyn")
    read = module.read_urdf

    def with_wrong(field: str) -> Callable[[str], Chain]:
        def wrong(text: str) -> Chain:
            chain = read(text)
            hinges = chain.hinges.copy()
            hinges[field] *= 1 + 1e-6
            return dataclasses.replace(chain, hinges=hinges)

        return wrong

    monkeypatch.setattr(module, "read_urdf", with_wrong("stiffness"))
    found = judged("exudyn", ["RK4"])
    assert {name for name, value in found.items() if value > 1} == {"T_FL", "q̈", "max |Δq|"}
    monkeypatch.setattr(module, "read_urdf", with_wrong("damping"))
    found = judged("exudyn", ["RK4"])
    assert {name for name, value in found.items() if value > 1} >= {"T_FR", "max |Δq|"}


def test_witnesses_that_are_not_installed_are_left_out_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, chain: Chain) -> None:
        raise MissingDependencyError(f"engine {name!r} cannot be imported")

    monkeypatch.setattr(engines, "load", missing)
    (row,) = witnesses.run(CASE, **CASE.settings)
    assert (row.quantity, row.value) == ("witnesses left out", 2)
    assert row.note == "not run: engine 'drake' cannot be imported; not run: engine 'exudyn' cannot be imported"


def test_the_stored_beams_are_those_of_the_scenes_and_of_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in beam_references.SCENES:
        tip, own = beam_reference(name)
        assert tip.shape == (len(beam_scene(name).run.times), 3)
        assert 0 < own < 1e-5
    beam_reference.cache_clear()
    monkeypatch.setitem(beam_references.SCENES, "paper_fig5", {"material.aluminium.density": 2701.0})
    with pytest.raises(DataFileError, match="exudyn_beams/paper_fig5: of another scene; compute it anew: python -m"):
        beam_reference("paper_fig5")


def test_figure_5_lies_in_the_plane_of_its_joints() -> None:
    plane = plane_of(beam_scene("paper_fig5"))
    np.testing.assert_array_equal(plane.gravity, [0.0, -9.81])
    np.testing.assert_array_equal(np.degrees([beam.angle for beam in plane.beams]), [-80.0, -90.0])
    start = plane.axes[:, :2] @ sum(
        beam.length * np.array([np.cos(beam.angle), np.sin(beam.angle)]) for beam in plane.beams
    )
    np.testing.assert_allclose(beam_reference("paper_fig5")[0][0], start, atol=1e-15)


def test_an_arm_that_bends_in_space_is_no_plane_of_beams() -> None:
    with pytest.raises(ArgumentError, match="t3_spatial: not flexible links one after another in a plane"):
        plane_of(load_scene(ROOT / "models" / "t3_spatial.toml"))


def test_a_chain_apart_from_the_beams_by_more_than_both_state_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    def ratio(offset: float) -> float:
        monkeypatch.setattr(exact_beams, "_tip", lambda scene, *_: beam_reference(scene.name)[0] + offset)
        rows = measurements(exact_beams, BEAMS, decode(BEAMS.settings, SETTINGS["exact_beams"]))
        return max(row.value for row in rows if isinstance(row, Measured) and row.quantity == "tip apart / allowed")

    assert ratio(0.0) == 0
    assert ratio(1e-5) > 1


def test_the_pulse_ends() -> None:
    np.testing.assert_array_equal(pulse([0.0, 1.2, 1.3]), 0.0)
    assert pulse(0.3) == 4.0 == -pulse(0.9)


@with_exudyn
@pytest.mark.slow
def test_the_program_of_the_beams_stores_what_it_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beams: ModuleType = importlib.import_module("validation.physics.exudyn_beams")
    monkeypatch.setattr("validation.reference_values.REFERENCE_FOLDER", tmp_path)
    monkeypatch.setattr(beams, "FINEST", beams.Numerics(elements=4, step=1e-3, stiffness=1e4, residual=1e-12))
    coarser = {"elements": (2, 15), "step": (2e-3, 1), "stiffness": (1e3, 9), "residual": (1e-11, 9)}
    monkeypatch.setattr(beams, "COARSER", coarser)
    assert beams.main(["paper_fig5"]) == 0
    text = (tmp_path / "exudyn_beams" / "paper_fig5.json").read_text()
    assert '"own_error_m"' in text and '"shear_and_stretch_m"' in text
