"""Sections that couple twist and bending: Kirchhoff's rod by shooting, Ritz's beam, rotated sections, refused input."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Legendre, legendre
from scipy.integrate import quad_vec
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.dynamics.tangent import stiffness_matrix
from tests.matrix.case import close, difference
from tests.support.beams import rod
from tests.support.words import refused

Array = np.ndarray
ROOT = np.array([[0.8, 0.3, 0.1], [0.3, 2.0, 0.2], [0.1, 0.2, 1.0]])
TIP = np.array([[0.4, -0.1, 0.1], [-0.1, 0.9, 0.0], [0.1, 0.0, 0.6]])
FORCE = np.array([0.0, 1.0, 2.0])


def table(x: Any, K: Any, ρI: float = 1e-4, **fields: Any) -> fl.Rigidity:
    """Sections of stiffness K (rows, 3, 3) at places x, with ρA = 1."""
    K, one = np.asarray(K), np.ones(len(x))
    names = {"gj": (0, 0), "ei_y": (1, 1), "ei_z": (2, 2), "k_xy": (0, 1), "k_xz": (0, 2), "k_yz": (1, 2)}
    columns = {name: tuple(K[:, i, j].tolist()) for name, (i, j) in names.items()}
    return fl.Rigidity(x=x, rho_a=one, rho_i_y=ρI * one, rho_i_z=ρI * one, **columns, **fields)


def scene(rule: str, hinges: int, K: Any = (ROOT, ROOT), x: Any = (0.0, 1.0), **fields: Any) -> fl.Scene:
    usual = {"flex": "xyz", "length": x[-1], "joint": fl.Joint(locked=True)}
    link = fl.Link(name="blade", segments=hinges + 1, lumping=rule, rigidity="t", **{**usual, **fields})
    return fl.Scene(name="blade", arm=fl.Arm(links=(link,), rigidities={"t": table(x, K)}), gravity=(0.0, 0.0, 0.0))


def errors_of(rule: str, truth: Array, *counts: int, **fields: Any) -> Array:
    """Distance of the tip under FORCE from the truth, by number of hinges."""
    chains = [fl.lump(scene(rule, count, **fields)) for count in counts]
    tips = [fl.tip_position(c, fl.solve_static(c, tip_wrench=[*FORCE, 0, 0, 0]).q) for c in chains]
    return np.linalg.norm(np.array(tips) - truth, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "largest", "order"),
    [("gauss", 4.1e-4, 2), ("lobatto2", 3.8e-4, 2), ("gauss_rotation", 1.4e-4, 2), ("lobatto2_rotation", 9.2e-7, 4)],
)
@pytest.mark.parametrize("end", [ROOT, TIP])
def test_a_coupled_section_bends_in_space_as_the_rod(rule: str, largest: float, order: int, end: Array) -> None:
    """Large deflection in space; the end of the taper has a third of the stiffness and a coupling of the other sign."""
    truth = rod(lambda s: ROOT + s * (end - ROOT), lambda s: np.zeros(3), FORCE)
    coarse, fine = errors_of(rule, truth, 16, 32, K=(ROOT, end))
    assert coarse < largest * (1 if end is ROOT else 4)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)


@pytest.mark.slow
def test_a_curved_coupled_link_bends_as_the_rod() -> None:
    truth = rod(ROOT, lambda s: [2.0, 1.0, 1.0], FORCE)
    for rule in ("gauss", "lobatto4"):
        coarse, fine = errors_of(rule, truth, 32, 64, curvature=(1.0, 1.0), twist=2.0)
        assert fine < 1.5e-4
        assert np.log2(coarse / fine) == pytest.approx(2, abs=0.2)


def ritz(K: Array, ρI: float, count: int = 12) -> Array:
    """Frequencies of a clamped beam of ρA = L = 1: curvatures about x, y, z are sums of Legendre polynomials."""
    x, w = legendre.leggauss(40)
    s, ds = (x + 1) / 2, w / 2
    P = [Legendre.basis(k, domain=[0, 1]) for k in range(count)]
    θ = np.array([one.integ(lbnd=0)(s) for one in P]) * np.sqrt(ds)
    y = np.array([one.integ(2, lbnd=0)(s) for one in P]) * np.sqrt(ds)
    bent = np.array([one(s) for one in P]) * np.sqrt(ds)
    own = ρI * θ @ θ.T
    M = np.kron(np.diag([2.0, 1.0, 1.0]), own) + np.kron(np.diag([0.0, 1.0, 1.0]), y @ y.T)
    return np.sqrt(eigh(np.kron(K, bent @ bent.T), M, eigvals_only=True))


@pytest.mark.parametrize(("rule", "order"), [("lobatto2", 4), ("lobatto2_rotation", 4), ("lobatto4", 4), ("gauss", 2)])
def test_a_coupled_beam_has_the_frequencies_of_ritz(rule: str, order: int) -> None:
    """The twist of `gauss` has order 2."""
    truth = ritz(ROOT, 0.1)[:3]
    found = []
    for count in (16, 32):
        stiff = scene(rule, count).varied({"rigidity.t.rho_i_y": (0.1, 0.1), "rigidity.t.rho_i_z": (0.1, 0.1)})
        found.append(np.abs(fl.natural_frequencies(fl.lump(stiff))[:3] / truth - 1).max())
    assert np.log2(found[0] / found[1]) == pytest.approx(order, abs=0.35)
    assert found[1] < 1e-3


@pytest.mark.parametrize("rule", ["gauss", "midpoint", "legendre", "lobatto2", "lobatto4", "lobatto2_rotation"])
@pytest.mark.parametrize("flex", ["yz", "xyz"])
def test_a_section_turned_in_its_plane_is_the_same_section(rule: str, flex: str) -> None:
    """K in turned axes is coupled; turning the section back gives the uncoupled beam and its frequencies."""
    turn = Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix()
    plain = [np.diag([0.8, 2.0, 1.0]), np.diag([0.5, 0.5, 0.7])]
    turned = [turn.T @ K @ turn for K in plain]
    up = tuple(turn.T @ [0.0, 0.0, 1.0])
    assert abs(turned[0][1, 2]) > 0.3
    both = [fl.lump(scene(rule, 8, K, flex=flex, up=axis)) for K, axis in ((plain, (0.0, 0.0, 1.0)), (turned, up))]
    one, other = (fl.natural_frequencies(chain) for chain in both)
    assert not len(both[0].couplings) or "lobatto" in rule
    np.testing.assert_allclose(other, one, rtol=1e-10)


def test_axes_about_which_a_link_does_not_bend_have_no_couplings() -> None:
    blade = scene("gauss", 4, (ROOT, TIP), flex="yz")
    free = blade.varied({"rigidity.t.k_xy": None, "rigidity.t.k_xz": None})
    assert np.array_equal(fl.lump(blade).hinges, fl.lump(free).hinges)
    assert np.array_equal(fl.lump(blade).couplings, fl.lump(free).couplings)
    assert len(fl.lump(blade).couplings) == 4
    in_plane = blade.varied({"link.blade.flex": "z"})
    assert not len(fl.lump(in_plane).couplings)
    twice = fl.lump(blade.varied({"rigidity.t.stiffness_factor": 2.0}))
    np.testing.assert_allclose(twice.matrix("stiffness"), 2 * fl.lump(blade).matrix("stiffness"), rtol=1e-14)


@pytest.mark.parametrize("rule", ["gauss", "midpoint", "legendre"])
def test_springs_of_coupled_tables_with_jumps_are_positive_and_have_their_compliance(
    rule: str, rng: np.random.Generator
) -> None:
    for _ in range(5):
        x = np.concatenate([[0.0], np.sort(rng.uniform(0, 1, 2)).repeat(2), [1.0]])
        B = rng.normal(size=(6, 3, 3))
        K = (B @ B.transpose(0, 2, 1) + 0.1 * np.eye(3)) * 10 ** rng.uniform(-1, 1, (6, 1, 1))
        springs = fl.lump(scene(rule, 8, K, x)).matrix("stiffness")
        assert np.linalg.eigvalsh(springs).min() > 0

        def at(s: float, x: Array = x, K: Array = K) -> Array:
            k = min(int(np.searchsorted(x, s, side="right")) - 1, 4)
            return np.linalg.inv(K[k] + (s - x[k]) / (x[k + 1] - x[k]) * (K[k + 1] - K[k]))

        whole, _ = quad_vec(at, 0, 1, epsrel=1e-11, points=x[1:-1], limit=1000)
        flexible = np.linalg.inv(springs)
        axes = fl.lump(scene(rule, 8, K, x)).hinges["axis"]
        total = [[flexible[np.ix_(axes == a, axes == b)].sum() for b in range(3)] for a in range(3)]
        np.testing.assert_allclose(total, whole, rtol=1e-8, atol=1e-8 * np.abs(whole).max())


@pytest.mark.parametrize("rule", ["gauss", "legendre", "lobatto2", "lobatto4", "lobatto2_rotation"])
def test_gauges_on_a_coupled_blade_read_its_curvature(rule: str) -> None:
    """κ = K⁻¹ M, with M = (0, −F_z, F_y) (L − x) of a small tip force, on both sides of a jump and of a taper."""
    x, K = (0.0, 0.37, 0.37, 1.0), (2 * ROOT, 2 * ROOT, ROOT, TIP)
    F = 1e-6 * FORCE
    places = [0.1, 0.3, 0.4, 0.7]
    gauges = [fl.Sensor(name=f"{place}", kind="strain", link="blade", x=place, fibre=(0.01, 0.02)) for place in places]
    blade = scene(rule, 8, K, x).varied({"sensor": gauges, "run.duration": 0.0})
    chain = fl.lump(blade)
    q = fl.solve_static(chain, tip_wrench=[*F, 0, 0, 0]).q

    def bent(s: float) -> Array:
        section = 2 * ROOT if s < 0.37 else ROOT + (s - 0.37) / 0.63 * (TIP - ROOT)
        return np.linalg.solve(section, [0, -F[2] * (1 - s), F[1] * (1 - s)])

    found = fl.strength.beam_strain(blade, q, link="blade", fibre=(0.01, 0.02))
    exact = np.array([bent(s) for s in found.x])
    np.testing.assert_allclose(found.curvature, exact, atol=2e-6 * np.abs(exact).max())
    run = fl.simulate(blade.varied({"wrench.force": tuple(F), "initial.passive": "static"}))
    for place in places:
        κ = bent(place)
        assert run.columns[f"{place} [1]"][0] == pytest.approx(0.02 * κ[1] - 0.01 * κ[2], rel=1e-5)


def energy_of_cells(chain: fl.Chain, q: Array, K: Callable[[float], Array]) -> float:
    """Energy of a beam in cells of two hinges: κ = Θ' − ½ Θ × Θ' at both Gauss points, Θ through −φ₁, 0, φ₂."""
    φ = []
    for first in range(0, chain.n, 3):
        axes = chain.hinges["axis"][first : first + 3]
        order = "".join("XYZ"[axis] for axis in axes)
        φ.append(Rotation.from_euler(order, q[first : first + 3]).as_rotvec())
    h, energy = 2 / len(φ), 0.0
    for cell, (one, two) in enumerate(zip(φ[::2], φ[1::2], strict=True)):
        for t in (-1 / np.sqrt(12), 1 / np.sqrt(12)):  # from the middle of the cell
            Θ = t * (two + one) + 2 * t**2 * (two - one)
            slope = (two + one) + 4 * t * (two - one)
            κ = (slope - np.cross(Θ, slope) / 2) / h
            energy += h / 4 * κ @ K((cell + 0.5 + t) * h) @ κ
    return energy


@pytest.mark.parametrize("size", [1e-3, 0.4, 1.0])
def test_springs_of_rotation_vectors_in_cells_have_the_energy_of_the_sections(size: float) -> None:
    chain, zero = fl.lump(scene("lobatto2_rotation", 8)), np.zeros(24)
    q = np.random.default_rng(3).uniform(-size, size, chain.n)

    def energy(q: Array) -> float:
        return fl.energy(chain, q, zero).elastic

    assert energy(q) == pytest.approx(energy_of_cells(chain, q, lambda s: ROOT), rel=1e-11)
    torques = np.array([difference(lambda h, e=e: energy(q + h * e)) for e in np.eye(chain.n)])
    close(fl.elastic_torque(chain, q), torques, 1e-10)
    K = stiffness_matrix(chain, q, zero, np.zeros(6))
    assert np.abs(K - K.T).max() <= 1e-13 * np.abs(K).max()
    slopes = [difference(lambda h, e=e: fl.elastic_torque(chain, q + h * e)) for e in np.eye(chain.n)]
    close(K, np.array(slopes).T, 1e-10)


CSV = "x [m],GJ [N m²],EI_y [N m²],EI_z [N m²],K_xy [kN m²],rhoA [kg/m],rhoI_z [kg m]\n0,8,9,9,0.002,1,1\n"
CSV += "1,4,9,9,-0.001,1,1\n"


def test_couplings_are_read_from_a_csv_file(tmp_path: Path) -> None:
    (tmp_path / "blade.csv").write_text(CSV, encoding="utf-8")
    read = fl.Rigidity(file=str(tmp_path / "blade.csv"))
    assert read.k_xy == (2.0, -1.0)
    assert read.k_yz is None


@pytest.mark.parametrize(
    ("change", "id", "part"),
    [
        ({"k_xy": (1.0, 3.0)}, "section-not-stiff", "k_xy[1] = 3.0"),
        ({"k_yz": (1.0, 1.5)}, "section-not-stiff", "k_yz[1] = 1.5"),
        ({"k_xz": (1.0,)}, "one-per-row", "k_xz"),
        ({"k_xy": (0.1, 0.1), "gj": None}, "needs-another-key", "gj"),
    ],
)
def test_an_impossible_coupling_is_refused(change: dict[str, Any], id: str, part: str) -> None:
    two = {"x": (0.0, 1.0), "rho_a": (1.0, 1.0), "gj": (4.0, 2.0), "ei_y": (3.0, 3.0), "ei_z": (2.0, 0.5)}
    with refused(fl.errors.SceneError, id) as caught:
        fl.Rigidity(**{**two, **change})
    assert part in str(caught.value)


def test_tendons_that_cannot_hold_a_coupling_are_refused() -> None:
    strong = np.array([[1.0, 0.95, 0.5], [0.95, 1.0, 0.45], [0.5, 0.45, 1.0]])
    with refused(fl.errors.ArgumentError, "tendon-stiffness") as caught:
        fl.to_mjcf(fl.lump(scene("midpoint", 1, (strong, strong))))
    assert "URDF" in str(caught.value)
