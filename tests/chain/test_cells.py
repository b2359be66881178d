"""Cells of coupled springs: the lumping rule, the resulting chain, and every algorithm that uses them."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy import integrate

import flexlink as fl
from flexlink.describe.data_files import names
from flexlink.describe.schemes.cells import Cells, cell_of
from flexlink.describe.schemes.lumping_rules import Element, LumpingRule, lumping_rule
from flexlink.errors import SceneError
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.layout import COUPLING, FORCES, Rare
from tests.conftest import ALUMINIUM, SQUARE, compiled, flexible, make_scene
from tests.support.beams import cantilever
from tests.support.words import refused

EPS = np.finfo(float).eps
HINGES = range(2, 7)
RULES = sorted(name for name in names("lumping") if lumping_rule(name).cells is not None)
DAMPED = fl.Damping(ratio=0.02, at_hz=10.0)


def rule_file(folder: Path, p: int, tip: float = 8.0) -> str:
    path = folder / f"cells{p}.toml"
    path.write_text(
        f'about = "cells of {p}"\nsource = "here"\nalternate_axes = true\n[cells]\nhinges = {p}\ntip = {tip}\n',
        encoding="utf-8",
    )
    return str(path)


def arm(flex: str = "xyz", rule: str = "lobatto2", segments: int = 5, **fields: object) -> fl.Scene:
    """An arm with a free and a driven link; every spring has a damper."""
    links = (
        flexible("upper", flex, segments, lumping=rule, damping=DAMPED),
        flexible("fore", flex, 3, lumping="lobatto2"),
    )
    return make_scene(*links, gravity=(1.0, -9.0, 2.0), **fields)


def state(chain: fl.Chain, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=chain.n) * 0.3, rng.normal(size=chain.n), rng.normal(size=chain.n)


# The rule.


@pytest.mark.parametrize(
    "p, hinges", [(2, [1 / 6, 5 / 6]), (3, [1 / 12, 1 / 2, 11 / 12]), (4, [1 / 20, 29 / 90, 61 / 90, 19 / 20])]
)
def test_hinges_are_placed_at_cumulative_lobatto_weights(p: int, hinges: list[float]) -> None:
    nodes, weights = Cells(hinges=p, tip=1.0).place(2 * p)
    assert nodes == pytest.approx([x / 2 + e / 2 for e in (0, 1) for x in hinges], abs=4 * EPS)
    assert (weights > 0).all()


def test_the_stiffness_matrix_of_a_two_hinge_cell_is_exact() -> None:
    assert cantilever("lobatto2", 2).matrix("stiffness") == pytest.approx(np.array([[7, -1], [-1, 7]]) / 3, rel=1e-14)


@pytest.mark.parametrize("p", HINGES)
def test_the_curvature_matrix_of_a_cell_is_exact_for_polynomials(p: int) -> None:
    """C computes the curvature d x^(d−1) from the jumps of θ = x^d, for d ≤ p; the norm of C is at most 3 p²."""
    cell = cell_of(p)
    for d in range(1, p + 1):
        jumps = np.diff(cell.nodes**d)
        assert cell.curvature @ jumps == pytest.approx(d * cell.points ** (d - 1), abs=50 * p**2 * EPS)


@pytest.mark.parametrize("p", HINGES)
def test_quadratures_of_a_cell_are_exact_up_to_their_degree(p: int) -> None:
    cell = cell_of(p)
    for d in range(2 * p):
        assert cell.lengths @ cell.nodes**d == pytest.approx(1 / (d + 1), abs=8 * EPS)
        assert cell.weights @ cell.points**d == pytest.approx(1 / (d + 1), abs=8 * EPS)


@pytest.mark.parametrize("p", HINGES)
def test_a_wrong_hinge_count_is_refused_and_the_two_nearest_are_named(p: int, tmp_path: Path) -> None:
    with refused(SceneError, "hinges-of-rule"):
        cantilever(rule_file(tmp_path, p), p + 1)


def test_a_cell_rule_with_matched_twist_or_a_second_kind_of_rule_is_refused() -> None:
    cells = Cells(hinges=2, tip=4.0)
    with refused(SceneError, "rule-kind"):
        LumpingRule(about="", source="", cells=cells, matched_twist=True)
    with refused(SceneError, "rule-kind"):
        LumpingRule(about="", source="", cells=cells, element=Element(nodes=(0.5,), weights=(1.0,)))


def test_a_tip_factor_that_makes_a_segment_inertia_negative_is_refused(tmp_path: Path) -> None:
    with refused(SceneError, "segment-inertia-negative"):
        cantilever(rule_file(tmp_path, 2, 50.0), 2)


# The chain.


@pytest.mark.parametrize("p", HINGES)
@pytest.mark.parametrize("tip", ["square", "small"])
def test_row_sums_of_the_mass_matrix_agree_with_the_continuous_beam(p: int, tip: str, tmp_path: Path) -> None:
    """If all segments rotate by the same angle, Σ_j A_ij = l_i ∫ μ(max(s_i, x)) dx with the mass μ(x) outboard of x."""
    count, small = 2 * p, msgspec.structs.replace(SQUARE, height=0.5 * SQUARE.height, width=0.5 * SQUARE.width)
    link = flexible("a", "z", count + 1, lumping=rule_file(tmp_path, p, 0.0), section_tip=tip, length=1.0)
    sections = {"square": SQUARE, "small": small}
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections=sections)
    scene = fl.Scene(name="taper", arm=arm, initial=fl.InitialState(joint_deg=(0.0,)))
    chain = fl.lump(scene)
    material, shrink = scene.arm.materials["aluminium"], 0.5 if tip == "small" else 0.0

    def beyond(x: float) -> float:
        """Mass outboard of x, ∫ ρA from x to the end."""
        return material.density * SQUARE.properties[0] * integrate.quad(lambda y: (1 - shrink * y) ** 2, x, 1)[0]

    s, lengths = Cells(hinges=p, tip=0.0).segments(count)
    J = chain.bodies["inertia"][:-1, 2, 2] - _rotary(scene, s, lengths, shrink)
    m, c = chain.bodies["mass"][:-1], chain.bodies["center"][:-1, 0]
    outer = np.append(np.cumsum(m[::-1])[::-1][1:], 0.0)
    pull = m * c + lengths * outer
    A = np.array([[lengths[min(i, j)] * pull[max(i, j)] for j in range(count + 1)] for i in range(count + 1)])
    np.fill_diagonal(A, J + m * c**2 + lengths**2 * outer)
    wanted = [l * (x * beyond(x) + integrate.quad(beyond, x, 1)[0]) for x, l in zip(s, lengths, strict=True)]
    assert A.sum(axis=1) == pytest.approx(np.array(wanted), rel=1e-13)


@pytest.mark.parametrize("p", HINGES)
def test_the_last_segment_takes_its_inertia_from_the_previous_one(p: int, tmp_path: Path) -> None:
    """The inertia of the last segment grows by `tip` m l²/3, and the previous segment loses the same inertia."""
    bare, given = (cantilever(rule_file(tmp_path, p, tip), 2 * p).bodies for tip in (0.0, 2.0))
    change = (given["inertia"] - bare["inertia"])[:, 2, 2]
    last = given["mass"][-2] * (given["translation"][-1, 0]) ** 2 * 2.0 / 3
    assert change[-3:-1] == pytest.approx([-last, last], rel=1e-9)
    assert not change[:-3].any()


def _rotary(scene: fl.Scene, s: np.ndarray, lengths: np.ndarray, shrink: float) -> np.ndarray:
    """Rotary inertia l ρ I_z of each segment, at its node."""
    return scene.arm.materials["aluminium"].density * SQUARE.properties[2] * lengths * (1 - shrink * s) ** 4


@pytest.mark.parametrize("p", HINGES)
def test_a_tapered_link_that_twists_has_the_inertia_of_its_sections_at_the_nodes(p: int, tmp_path: Path) -> None:
    """Lobatto quadrature of ½ ∫ ρ I_p θ̇² is exact up to degree 2p − 1, so that twist converges with order 2p."""
    small = msgspec.structs.replace(SQUARE, height=0.5 * SQUARE.height, width=0.5 * SQUARE.width)
    link = flexible("a", "xyz", 2 * p + 1, lumping=rule_file(tmp_path, p), section_tip="small", length=1.0)
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE, "small": small})
    chain = fl.lump(fl.Scene(name="taper", arm=arm, initial=fl.InitialState(joint_deg=(0.0,))))
    s, lengths = Cells(hinges=p, tip=0.0).segments(2 * p)
    polar = ALUMINIUM.density * sum(SQUARE.properties[1:3])
    own = chain.bodies["inertia"][:, 0, 0]
    own = own[own > 0]
    assert own == pytest.approx(polar * lengths * (1 - s / 2) ** 4, rel=1e-12)
    assert own.sum() == pytest.approx(polar * integrate.quad(lambda x: (1 - x / 2) ** 4, 0, 1)[0], rel=3e-4)


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
@pytest.mark.parametrize("p", [2, 3, 4])
def test_every_axis_has_the_stiffness_of_the_cell_and_proportional_damping(flex: str, p: int, tmp_path: Path) -> None:
    """K = Cᵀ diag(w EI) C / h for bending, with GJ for twist, and D = η K, also if the axes are in reverse order."""
    scene = make_scene(flexible("a", flex, 2 * p + 1, lumping=rule_file(tmp_path, p), damping=DAMPED))
    chain, cell = fl.lump(scene), cell_of(p)
    material, (_, i_y, i_z, torsion) = scene.arm.materials["aluminium"], SQUARE.properties
    rigidity = {1: material.shear * torsion, 2: material.young * i_y, 3: material.young * i_z}
    K, h = chain.matrix("stiffness"), 1.25 / 2
    for axis, value in rigidity.items():
        if (axis == 1 and flex != "xyz") or (axis == 2 and flex == "z"):
            continue
        own = [chain.index("a", segment, axis) for segment in range(1, 2 * p + 1)]
        one = value / h * cell.curvature.T @ np.diag(cell.weights) @ cell.curvature
        assert K[np.ix_(own, own)] == pytest.approx(np.kron(np.eye(2), one), rel=1e-13, abs=1e-13 * one.max())
        K[np.ix_(own, own)] = 0.0
    assert not K.any()
    loss = scene.arm.loss_time(scene.arm.links[0])
    np.testing.assert_array_equal(chain.couplings["damping"], loss * chain.couplings["stiffness"])


def test_products_with_coupled_springs_equal_products_with_the_full_matrix() -> None:
    chain = fl.lump(arm())
    φ = np.random.default_rng(0).normal(size=(3, chain.n))
    for field in ("stiffness", "damping"):
        K = chain.matrix(field)
        bound = 4 * EPS * np.abs(φ) @ np.abs(K)
        assert (np.abs(chain.times(field, φ) - φ @ K) <= bound).all()
        assert (np.abs(chain.times(field, φ, absolute=True) - np.abs(φ) @ np.abs(K)) <= bound).all()


@pytest.mark.parametrize(
    "pairs, wanted",
    [
        ([], []),
        ([(0, 1), (2, 3)], [0, 0, 2, 2, 4]),
        ([(0, 2), (1, 3)], [0, 0, 0, 0, 4]),
        ([(0, 2), (2, 4)], [0, 0, 0, 0, 0]),
        ([(1, 4), (2, 3)], [0, 1, 1, 1, 1]),
    ],
)
def test_overlapping_coupled_springs_form_one_cell(pairs: list[tuple[int, int]], wanted: list[int]) -> None:
    couplings = np.array([(*pair, 1.0, 0.0) for pair in pairs], dtype=COUPLING)
    others = (np.zeros(0, FORCES[name]) for name in Rare._fields[1:])
    assert cells_of(5, Rare(couplings, *others)).tolist() == wanted


# The algorithms.


def coupled_abroad(chain: fl.Chain) -> fl.Chain:
    """The same chain with a coupled spring across two joints, which merges all hinges in between into one cell."""
    across = np.array([(0, chain.n - 1, 0.1 * chain.stiffness.max(), 0.2)], dtype=COUPLING)
    chain = fl.Chain(**{name: getattr(chain, name) for name in ("name", "bodies", "hinges", "gravity", "coordinates")},
                     link_names=chain.link_names, couplings=np.concatenate([chain.couplings, across]))  # fmt: skip
    return chain


TURNED = make_scene(
    flexible("a", lumping="lobatto2"), flexible("b", lumping="lobatto4", mount=fl.Mount(rpy_deg=(180.0, 0.0, 0.0)))
)
CHAINS = {
    "plane": lambda _: fl.lump(arm("z")),
    "plane, across opposite axes": lambda _: coupled_abroad(fl.lump(TURNED)),
    "T2": lambda _: fl.lump(arm("yz", "lobatto4")),
    "T3": lambda _: fl.lump(arm("xyz")),
    "T3, cells of 3": lambda folder: fl.lump(arm("xyz", rule_file(folder, 3), 7)),
    "T3, cells of 4": lambda _: fl.lump(arm("xyz", "lobatto4")),
    "T3, across joints": lambda _: coupled_abroad(fl.lump(arm("xyz"))),
}
SPRUNG = [name for name in CHAINS if "across" not in name]  # chains whose K is positive definite for the sprung joints


RUNS = {
    "RK4": {"run.method": "RK4", "run.step": 5e-6, "run.duration": 1e-3, "run.sample": 2e-4},
    "DOP853": {"run.method": "DOP853", "run.relative_tolerance": 1e-6, "run.duration": 0.01, "run.sample": 5e-3},
    "Radau5": {"run.method": "Radau5", "run.relative_tolerance": 1e-6, "run.duration": 0.04, "run.sample": 0.01},
    "Gauss4": {"run.method": "Gauss4", "run.step": 1e-4, "run.duration": 0.01, "run.sample": 5e-3},
}


@compiled
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("method", ["Radau5", "Radau9"])
def test_coupled_springs_do_not_increase_the_number_of_newton_iterations(method: str, rule: str) -> None:
    """If the Newton matrix had only the diagonals of K and D, at least 1.4 times as many iterations would be needed."""
    passes = {}
    for name in ("gauss", rule):
        link = flexible("a", "z", 13, lumping=name, damping=DAMPED)
        scene = make_scene(link, gravity=(0.0, -9.81, 0.0), run=fl.RunSettings(duration=0.5, sample=0.1))
        steps = fl.simulate(scene, method=method, tolerance=1e-5).steps
        passes[name] = steps.evaluations / (steps.taken + steps.rejected)
    assert passes[rule] <= 1.05 * passes["gauss"]
