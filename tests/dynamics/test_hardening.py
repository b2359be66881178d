"""Hardening joint springs, c q³, agree with closed forms; every force element with a potential is part of T_FL."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.special
from msgspec.structs import replace

import flexlink as fl
from flexlink.formats.features import unsupported
from flexlink.kernels.forces.elements import KINDS
from flexlink.kernels.layout import FORCES, Rare
from tests.matrix.case import case
from tests.support.words import refused

ROOT = Path(__file__).parents[2]
C, M, L, G = 4.0, 0.5, 0.8, 9.81
FIXED = 1e-9  # allowed error of runs with steps of 1 ms
WAYS = [("RK4", FIXED), ("Gauss4", FIXED), ("Radau5", 1e-6), ("DOP853", 1e-6), ("Radau9", 1e-8), ("auto", 1e-5)]
HARD = "link.wheel.joint.hardening"


def wheel(**changes: object) -> fl.Scene:
    """A wheel of 1 kg m² on a spring of 4 N m/rad³ swings from rest at 1 rad for one period."""
    joint = fl.Joint(hardening=C, armature=1.0)
    arm = fl.Arm(links=(fl.Link(name="wheel", joint=joint, hub=fl.RigidBody(mass=1.0)),))
    period = 4 * scipy.special.ellipk(0.5) / np.sqrt(C)
    run = fl.RunSettings(duration=period, sample=period / 8, step=period / 4096)
    return fl.Scene(name="wheel", arm=arm, run=run, initial=fl.InitialState(q=(1.0,), qd=(0.0,))).varied(changes)


def pendulum(pull: float) -> fl.Chain:
    """A point mass M on a weightless rod L; its weight pulls along the rod at angle zero (`pull` 1) or pushes (−1)."""
    link = fl.Link(name="rod", length=L, joint=fl.Joint(hardening=C), end=fl.RigidBody(mass=M))
    return fl.lump(fl.Scene(name="rod", arm=fl.Arm(links=(link,)), gravity=(pull * G, 0.0, 0.0)))


@pytest.mark.parametrize(("method", "tolerance"), WAYS)
def test_a_wheel_swings_by_the_elliptic_cosine_of_duffing(method: str, tolerance: float) -> None:
    by_tolerance = {"run.relative_tolerance": tolerance} if tolerance > FIXED else {}
    run = fl.simulate(wheel(**{"run.method": method, **by_tolerance}))
    np.testing.assert_allclose(run.q[:, 0], scipy.special.ellipj(np.sqrt(C) * run.t, 0.5)[1], atol=20 * tolerance)
    assert run.q[-1, 0] == pytest.approx(1.0, abs=20 * tolerance)
    assert np.abs(run.imbalance).max() <= 20 * tolerance
    np.testing.assert_allclose(run.energy.elastic, C / 4 * run.q[:, 0] ** 4, rtol=1e-12)


def test_small_motion_about_a_deflected_rest_has_the_stiffness_of_weight_and_spring() -> None:
    chain, tau = pendulum(1.0), 3.0
    rest = fl.solve_static(chain, tau=[tau])
    (q,) = rest.q
    assert C * q**3 + M * G * L * np.sin(q) == pytest.approx(tau, rel=1e-12)
    k = M * G * L * np.cos(q) + 3 * C * q**2
    assert rest.stable
    assert fl.natural_frequencies(chain, rest.q)[0] ** 2 == pytest.approx(k / (M * L**2), rel=1e-9)
    assert fl.modes(chain, rest.q).eigenvalues[0].imag ** 2 == pytest.approx(k / (M * L**2), rel=1e-9)
    A = fl.linearize(chain, rest.q, tau=rest.tau).A
    np.testing.assert_allclose(A, [[0.0, 1.0], [-k / (M * L**2), 0.0]], atol=1e-12)


def test_a_standing_arm_leans_until_its_spring_is_stiff_enough_and_buckles_by_the_closed_form() -> None:
    chain = pendulum(-1.0)
    (q,) = fl.solve_static(chain, [0.5]).q
    assert abs(q) > 0.5
    assert C * q**3 == pytest.approx(M * G * L * np.sin(q), rel=1e-9)
    factor = 3 * C * q**2 / (M * G * L * np.cos(q))  # K_elastic / −K_load
    np.testing.assert_allclose(fl.strength.buckling_loads(chain, [q]), [factor], rtol=1e-12)
    assert not fl.solve_static(chain, [0.0]).stable


def test_a_spring_with_no_slope_at_the_start_is_found_in_equilibrium() -> None:
    chain = fl.lump(wheel())
    for start in (0.0, 0.3, 2.0):
        found = fl.solve_static(chain, [start], tau=[C])
        np.testing.assert_allclose(found.q, [1.0], rtol=1e-9)
        assert found.stable


def test_the_recipe_of_a_force_law_names_files_that_exist_and_tables_that_agree() -> None:
    text = (ROOT / "docs" / "development" / "recipes.md").read_text(encoding="utf-8")
    text = text.split("## A force law\n")[1].split("\n## ")[0]
    files = re.findall(r"`((?:flexlink|tests|docs)/[\w/.]+\.\w+)`", text)
    assert len(re.findall(r"^\d\. ", text, re.MULTILINE)) == 8
    assert [path for path in files if not (ROOT / path).is_file()] == []
    assert tuple(FORCES) == Rare._fields
    assert KINDS.keys() == {*FORCES, "rotation"}
    assert len(set(FORCES.values())) == len(FORCES), "elements differ by the dtypes of their rows"


def test_implicit_steps_know_the_stiffness_of_a_hardening_spring() -> None:
    braked = {"run.method": "Radau5", "run.relative_tolerance": 1e-4, "link.wheel.joint.viscous": 1e6, HARD: 1e9}
    run = fl.simulate(wheel(**braked))
    assert run.steps.evaluations <= 750  # 666; without the spring's slope 858
    np.testing.assert_allclose(run.q[1:, 0], (1 + 2e3 * run.t[1:]) ** -0.5, atol=1e-5)  # inertia hardly matters


def test_archives_continued_runs_sweeps_and_fits_include_hardening_springs(tmp_path) -> None:
    scene = wheel()
    whole = fl.simulate(scene)
    whole.save(tmp_path / "run.npz")
    assert fl.Trajectory.load(tmp_path / "run.npz").chain.forces["hardening"]["cubic"].tolist() == [C]
    start = fl.InitialState(q=tuple(whole.q[4]), qd=tuple(whole.qd[4]), time=float(whole.t[4]))
    again = fl.simulate(replace(scene.varied({"run.duration": float(whole.t[4])}), initial=start))
    np.testing.assert_allclose(again.q[-1], whole.q[-1], atol=1e-9)
    many = fl.simulate_many([scene.varied({HARD: c}) for c in (1.0, C)])
    np.testing.assert_array_equal(many[1].q, whole.q)
    head, σ = "q wheel [rad]", 1e-6
    seen = fl.fits.FitRun(name="swing", columns={"t [s]": whole.t, head: whole.columns[head]}, noise={head: σ})
    start_value = scene.varied({HARD: 1.1 * C})
    found = fl.fit(fl.fits.FitProblem(scene=start_value, parameter=(fl.fits.FitParameter(path=HARD),), run=(seen,)))
    assert found[HARD].value == pytest.approx(C, rel=1e-6)


def test_exports_and_engines_without_hardening_springs_report_it() -> None:
    scene = case("hardening").scene
    chain = fl.lump(scene)
    for format in ("urdf", "mjcf", "sdf"):
        assert "hardening springs" in unsupported(scene, chain, format=format)
    with refused(fl.FlexlinkError, "arguments-not-counted"):
        fl.compare_trajectories(scene, engines=["mujoco"])
