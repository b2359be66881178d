"""Bricks bend like a beam; a frame with linear modes is right in small motions; Exudyn's agrees with its equations."""

import importlib

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import eigh

from validation.case import CASES, load_case
from validation.formulations.beam_bricks import CORNERS, bricks
from validation.formulations.exact_modes import in_a_frame, on_a_hub, scaled
from validation.formulations.ladder import Formulation
from validation.formulations.task import Outcome, task_of
from validation.kinds import floating_frames as kind
from validation.oracles import hub_beam
from validation.runner import kind_of

L, EI, MASS, TIP = 1.0, 5.0, 0.6, 0.3
CASE = load_case(CASES / "floating_frames.toml")
_, SETTINGS = kind_of(CASE)
PULSE = task_of("torque_pulse", SETTINGS.driven)


def test_bricks_have_the_mass_of_the_beam_and_resist_bending_but_not_rigid_motion() -> None:
    made = bricks(L, EI, MASS, 3, TIP)
    x, y, z = made.nodes.T
    still, κ = np.zeros_like(x), 0.2

    def energy(*parts: np.ndarray) -> float:
        u = np.stack(parts, axis=1).ravel()
        return float(u @ made.K @ u) / 2

    bent = energy(-κ * x * y, κ * x**2 / 2, still)
    assert bent == pytest.approx(EI * κ**2 * L / 2, rel=1e-5)
    for turned in ((-y, x, still), (still, -z, y), (z, still, -x), (still + 1, still, still)):
        assert abs(energy(*turned)) < 1e-9 * energy(x, still, still)
    along = np.tile([1.0, 0.0, 0.0], len(x))
    assert along @ made.M @ along == pytest.approx(MASS * L + TIP)
    about = np.stack([still, x, still], axis=1).ravel()
    assert about @ made.M @ about == pytest.approx(MASS * L**3 / 3 + TIP * L**2)


def test_clamped_bricks_have_the_frequencies_of_the_clamped_beam() -> None:
    """With displacements in the plane of bending only."""
    made = bricks(L, EI, MASS, 6, TIP)
    free = np.arange(3 * CORNERS, len(made.K))
    own = free[free % 3 < 2]
    found = np.sqrt(eigh(made.K[np.ix_(own, own)], made.M[np.ix_(own, own)], eigvals_only=True, subset_by_index=[0, 1]))
    exact = hub_beam.modes(hub_beam.Beam(L, EI, MASS, tip_mass=TIP), 2).ω
    assert found == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
def test_linear_modes_are_right_for_a_small_torque_and_wrong_for_the_full_one() -> None:
    little = scaled(PULSE, 1e-4)
    way = kind._way(little._replace(reference=kind.Reference(exact := on_a_hub(little, 2), 0.0)))
    assert np.abs(in_a_frame(little, 2) - exact).max() < 2e-5 * way
    assert PULSE.error(in_a_frame(PULSE, 2)) > 0.1


def test_a_scaled_torque_drives_both_the_scene_and_other_programs() -> None:
    half = scaled(PULSE, 0.5)
    assert half.torque is not None and PULSE.torque is not None
    assert half.torque(0.3) == PULSE.torque(0.3) / 2
    assert half.scene.drive.torques is not None and PULSE.scene.drive.torques is not None
    assert np.array_equal(np.array(half.scene.drive.torques), np.array(PULSE.scene.drive.torques) / 2)


def test_errors_are_of_the_way_and_a_missing_program_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def off(task, _element, setting) -> Outcome:
        return Outcome(np.add(task.reference.tip, [0.0, 10.0 ** -setting["modes"] * task.length, 0.0]), 0.0, 1)

    monkeypatch.setattr(Formulation, "run", property(lambda self: off))
    monkeypatch.setitem(kind.FORMULATIONS, kind.FRAME, Formulation("exudyn", "nowhere", "", ""))
    *rows, series = kind.run(CASE, replace(SETTINGS, modes=(1, 2), torques=(1.0,)))
    found = {(each.quantity, each.varied.get("formulation"), each.varied.get("modes")): each for each in rows}
    assert "nowhere" in found["programs compared", None, None].note
    way = kind._way(PULSE)
    assert found["error", kind.OURS, 1].value == pytest.approx(0.1 / way)
    assert found[kind.FALL, kind.OURS, 2].value == pytest.approx(0.1)
    assert found[kind.MUCH, kind.OURS, 2].value == pytest.approx(0.01 / way)
    ratio = found[kind.RATIO, kind.TEXTBOOK, 2].value
    assert ratio == pytest.approx(found["error", kind.TEXTBOOK, 2].value * 100 * way)
    assert found[kind.SPUN, kind.OURS, 3].value == pytest.approx(1e-3)
    assert series.columns["modes"].tolist() == [1, 1, 2, 2]


@pytest.mark.slow
def test_exudyns_frame_has_the_motion_of_separate_equations() -> None:
    pytest.importorskip("exudyn")
    frames = importlib.import_module("validation.formulations.exudyn_frames")
    outcome = frames.run(PULSE, "", {"elements": 10, "modes": 2, "step": 1e-3, "radius": 1.0})
    assert outcome.coordinates == 8, "six of the frame and two modes"
    assert np.abs(outcome.tip - in_a_frame(PULSE, 2)).max() < 3e-4 * PULSE.length
