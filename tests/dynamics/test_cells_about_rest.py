"""Deflections, modes, strain and reports of chains with coupled springs agree with full matrices."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg

import flexlink as fl
from flexlink.cli import info
from flexlink.dynamics.forces import deflections
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.kernels.forward.mass_plus_plane import plane_posture
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue
from flexlink.pages.tables import Table
from flexlink.results.convergence import resolved
from flexlink.scene_report.parts import model
from flexlink.scene_report.study import Study
from tests.chain.test_cells import CHAINS, RUNS, SPRUNG, arm, state
from tests.conftest import flexible, make_scene
from tests.motion.test_sensitivity import check
from tests.support.beams import cantilever
from tests.support.words import reviewed


@pytest.mark.parametrize("name", SPRUNG)
def test_deflections_follow_from_the_inverse_of_the_stiffness_matrix(name: str, tmp_path: Path) -> None:
    chain = CHAINS[name](tmp_path)
    K, torques = chain.matrix("stiffness"), np.random.default_rng(6).normal(size=(3, chain.n))
    block = np.ix_(chain.bending, chain.bending)
    wanted = np.zeros_like(torques)
    wanted[:, chain.bending] = np.linalg.solve(K[block], torques[:, chain.bending].T).T
    bound = 10 * np.finfo(float).eps * np.linalg.cond(K[block]) * np.abs(wanted).max()
    assert np.abs(deflections(chain, torques) - wanted).max() <= bound
    assert deflections(chain, torques[0]) == pytest.approx(deflections(chain, torques)[0], abs=0)


@pytest.mark.parametrize("path", ["material.aluminium.young", "link.upper.length"])
def test_sensitivities_of_a_run_from_equilibrium_agree_with_finite_differences(path: str) -> None:
    """The initial configuration depends on the stiffness of the springs."""
    still = {"initial.passive": "static", "initial.joint_deg": [20.0, -30.0]}
    check(arm("z", "lobatto4").varied({**RUNS["RK4"], **still}), path)


@pytest.mark.parametrize("name", SPRUNG)
def test_elastic_energy_fractions_agree_with_the_quadratic_forms(name: str, tmp_path: Path) -> None:
    """The only energies are E = φ* (K + |λ| D) φ of springs and P = |φ* K_load φ| of loads: joints have no friction."""
    chain = CHAINS[name](tmp_path)
    q = 0.1 * state(chain)[0]
    found = fl.modes(chain, q)
    k, D = chain.matrix("stiffness"), chain.matrix("damping")
    load = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6)) - k
    for λ, φ, share in zip(found.eigenvalues, found.shapes, found.elastic_shares, strict=True):
        E, P = (φ.conj() @ (k + abs(λ) * D) @ φ).real, abs(φ.conj() @ load @ φ)
        assert share == pytest.approx(E / (E + P), rel=1e-9)
    assert {"elastic", "pendulum"} <= set(found.kinds)


@pytest.mark.parametrize("rule, least", [("gauss", 6), ("lobatto2", 6), ("lobatto4", 6)])
def test_modes_with_two_hinges_per_half_wave_count_as_resolved(rule: str, least: int) -> None:
    """One mode per two hinges is resolved, as with independent springs; higher modes are not physical."""
    column = cantilever(rule, 12)
    flags = resolved(fl.modes(column), column)
    assert flags == (True,) * least + (False,) * (12 - least)


@pytest.mark.parametrize("name", SPRUNG)
def test_the_highest_frequency_is_exact_with_enough_iterations(name: str, tmp_path: Path) -> None:
    """The usual result is inexact only because few iterations suffice, not because a coupling is missing."""
    chain = CHAINS[name](tmp_path)
    q, coupled = 0.3 * state(chain)[0], np.ascontiguousarray(chain.couplings["stiffness"])
    posture = (plane_posture if chain.is_planar else space_posture)(chain.arrays)
    found = largest_eigenvalue(chain.arrays, q, chain.stiffness, coupled, 100_000, 1e-13, posture)
    wanted = linalg.eigh(chain.matrix("stiffness"), fl.mass_matrix(chain, q), eigvals_only=True)[-1]
    assert found == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_strain_gauges_at_gauss_points_measure_the_local_moment(rule: str) -> None:
    """Under a small transverse tip force, κ = M/EI to second order; cells represent a linear moment exactly."""
    link = flexible("a", "xyz", 9, lumping=rule, joint=fl.Joint(locked=True))
    scene = make_scene(link, gravity=(0.0, 0.0, 0.0))
    chain, small = fl.lump(scene), 1e-3
    q = fl.solve_static(chain, tip_wrench=[0, small, 2 * small, 3 * small, 0, 0]).q
    gauge = fl.strength.beam_strain(scene, np.array([q, 2 * q]), link="a", fibre=(0.01, 0.02))
    assert len(gauge.x) == 8
    assert (np.diff(gauge.x) > 0).all()
    points = np.polynomial.legendre.leggauss(int(rule[-1]))[0]
    assert gauge.x[: len(points)] == pytest.approx(1.25 * (1 + points) / 2 * len(points) / 8, rel=1e-14)
    material, (_, i_y, i_z, torsion) = scene.arm.materials["aluminium"], scene.arm.sections["square"].properties
    κ, arm_left = gauge.curvature[0], link.length - gauge.x
    assert κ[:, 0] == pytest.approx(3 * small / (material.shear * torsion), rel=1e-5)
    assert κ[:, 1] == pytest.approx(-2 * small * arm_left / (material.young * i_y), rel=1e-5)
    assert κ[:, 2] == pytest.approx(small * arm_left / (material.young * i_z), rel=1e-5)
    assert gauge.strain[0] == pytest.approx(0.02 * κ[:, 1] - 0.01 * κ[:, 2], rel=1e-12)
    assert gauge.curvature[1] == pytest.approx(2 * κ, rel=1e-14)


def test_info_and_notebooks_show_coupled_hinges() -> None:
    chain = fl.lump(arm("z"))
    assert chain.coupled_joints == ((), (2,), (1,), (4,), (3,), (), (7,), (6,))
    stiffness, hinge = info._kind(chain, 2).split(", ")
    assert stiffness == f"k = {chain.stiffness[2]:.6g} N m/rad"
    assert re.findall(r"\d+", hinge) == ["1"]
    reviewed("cells about rest: coupled hinge", hinge)
    assert info._kind(chain, 0) == "driven"
    html = chain._repr_html_()
    assert "coupled with" in html
    assert "coupled with" not in cantilever("gauss", 2)._repr_html_()


def test_a_report_lists_coupled_springs() -> None:
    def springs(rule: str) -> Table:
        return model.made(Study(arm("z", rule, 5))).tables[-1]

    table, alone = springs("lobatto4"), model.made(Study(make_scene(flexible("a")))).tables[-1]
    assert table.heads == (*alone.heads, "coupled with")
    assert table.lines[1][-1] == ", ".join(f"upper.{k}.z" for k in (1, 3, 4))
    assert len(table.lines) == 6


def test_a_chain_without_structural_damping_has_no_damper() -> None:
    chain = fl.lump(arm("z"))
    bare = info._without_structural_damping(chain)
    assert not bare.matrix("damping").any()
    np.testing.assert_array_equal(bare.matrix("stiffness"), chain.matrix("stiffness"))
    assert info._without_structural_damping(bare) is bare
