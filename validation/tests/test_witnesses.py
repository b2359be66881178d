"""Drake, Exudyn and Exudyn's beams as independent references: wrong results are rejected, missing engines reported."""

from types import SimpleNamespace

import numpy as np
import pytest

from flexlink import Chain, engines, load_scene
from flexlink.common.errors import DataFileError
from flexlink.describe.spec import decode
from flexlink.errors import ArgumentError, MissingDependencyError
from tests.conftest import ROOT
from tests.support.words import refused, reviewed
from validation.case import CASES, Measured, load_case
from validation.kinds import KINDS, motions, witnesses
from validation.physics import beam_references
from validation.physics.beam_references import beam_reference, beam_scene, plane_of
from validation.trade.first_order import FirstOrder

CASE = load_case(CASES / "trajectory_witnesses.toml")
BEAMS = load_case(CASES / "exudyn_beams.toml")


def test_engines_that_are_not_installed_are_skipped_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {name: MissingDependencyError(f"no engine {name!r}") for name in ("drake", "exudyn")}

    def missing(name: str, chain: Chain) -> None:
        raise errors[name]

    monkeypatch.setattr(engines, "load", missing)
    (row,) = witnesses.run(CASE, **CASE.settings)
    assert row.value == 2
    reviewed("study: engines not installed", f"{row.quantity}\n{row.note}")
    assert all(str(error) in row.note for error in errors.values())


def test_the_stored_beams_belong_to_their_scenes_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in beam_references.SCENES:
        tip, own = beam_reference(name)
        assert tip.shape == (len(beam_scene(name).run.times), 3)
        assert 0 < own < 1e-5
    beam_reference.cache_clear()
    monkeypatch.setitem(beam_references.SCENES, "paper_fig5", {"material.aluminium.density": 2701.0})
    with refused(DataFileError, "test-witnesses"):
        beam_reference("paper_fig5")


def test_the_arm_of_figure_5_is_in_the_plane_of_its_joints() -> None:
    plane = plane_of(beam_scene("paper_fig5"))
    np.testing.assert_array_equal(plane.gravity, [0.0, -9.81])
    np.testing.assert_array_equal(np.degrees([beam.angle for beam in plane.beams]), [-80.0, -90.0])
    start = plane.axes[:, :2] @ sum(
        beam.length * np.array([np.cos(beam.angle), np.sin(beam.angle)]) for beam in plane.beams
    )
    np.testing.assert_allclose(beam_reference("paper_fig5")[0][0], start, atol=1e-15)


def test_an_arm_that_bends_in_space_is_not_a_plane_of_beams() -> None:
    with refused(ArgumentError, "test-witnesses"):
        plane_of(load_scene(ROOT / "models" / "t3_spatial.toml"))


def test_a_run_is_compared_with_the_finer_run_of_the_other_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Allowed are ten tolerances and the distance of the two runs of the other solver, which is much larger here."""
    path, aside, ε = np.arange(6.0).reshape(2, 3), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), 1e-6

    def by(_: object, solver: str, relative: float) -> SimpleNamespace:
        return SimpleNamespace(tip=path + 90 * ε * (relative > 1e-6) * aside)

    monkeypatch.setattr(FirstOrder, "by", by)
    monkeypatch.setattr(motions, "simulate", lambda *_, **__: SimpleNamespace(tip=path + 20 * ε * aside))
    witness = motions.Witness(solver="Radau", relative=(1e-5, 1e-7))
    found = list(motions.other_solvers(CASE, {"pulse11": (witness,)}, {"RK4": ε}))
    assert [each.value for each in found] == pytest.approx([90 * ε, 0.2, 0.0])


def test_a_chain_farther_from_the_beams_than_both_errors_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    def ratio(offset: float) -> float:
        monkeypatch.setattr(motions, "_tip", lambda scene, *_: beam_reference(scene.name)[0] + offset)
        beams = KINDS["exact_beams"]
        rows = beams.measurements(BEAMS, decode(BEAMS.settings, beams.settings))
        return max(row.value for row in rows if isinstance(row, Measured) and row.quantity == "tip apart / allowed")

    assert ratio(0.0) == 0
    assert ratio(1e-5) > 1
