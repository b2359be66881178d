"""Lumping rules as quadratures of the curvature integral, and the hinges that they give a link."""

import numpy as np
import pytest
from scipy import special

from flexlink import Joint, bias_torque, elastic_torque, energy, forward_dynamics, friction_torque, lump, mass_matrix
from flexlink.describe.data_files import names
from flexlink.describe.schemes.lumping_rules import Element, Grid, Jacobi, LumpingRule, lumping_rule
from flexlink.dynamics import rounding
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.engines import load
from flexlink.errors import SceneError
from tests.conftest import flexible, make_scene
from tests.support.beams import cantilever, thin_arm, thin_link, torsion_bar
from tests.support.words import refused
from validation.physics.hinge_sweep import order

TIP_FREE = {"clamped", "hencky"}
"""Rules for a torque-free tip, where the bending moment vanishes: they omit the node and the weight at the tip."""

EXACT_DEGREE = {
    "paper": -1, "hencky": 1, "clamped": 2, "midpoint": 1, "open": 1, "gregory": 3, "gauss": 3, "legendre": 23,
    "gauss_matched": 3, "gauss_rotation": 3,
}  # fmt: skip
"""Highest d up to which 12 hinges integrate the moments (1 − x)^d exactly; for rules in `TIP_FREE`, d starts at 2.

All hinge counts here are multiples of 6, because some rules have groups of two or three hinges.
"""


def integral(rule, count, f):
    nodes, weights = rule.hinges(count)
    return float(weights @ f(nodes))


def test_every_built_in_rule_is_tested_here_or_as_cells():
    cells = {name for name in names("lumping") if lumping_rule(name).cells is not None}
    assert set(names("lumping")) - cells == set(EXACT_DEGREE)


@pytest.mark.parametrize("name", EXACT_DEGREE)
def test_nodes_increase_on_the_link_and_weights_are_positive(name):
    for count in (6, 12, 18, 30):
        nodes, weights = lumping_rule(name).hinges(count)
        assert len(nodes) == len(weights) == count
        assert (np.diff(nodes) > 0).all()
        assert nodes[0] >= 0
        assert nodes[-1] < 1
        assert (weights > 0).all()


@pytest.mark.parametrize("name", EXACT_DEGREE)
def test_bending_is_exact_under_moments_up_to_the_listed_degree(name):
    highest = EXACT_DEGREE[name]
    errors = [integral(lumping_rule(name), 12, lambda x, d=d: (1 - x) ** d) - 1 / (d + 1) for d in range(highest + 2)]
    assert np.array(errors[2 if name in TIP_FREE else 0 : -1]) == pytest.approx(0, abs=1e-14)
    assert name.startswith("legendre") or abs(errors[-1]) > 1e-9  # Legendre rules are exact within rounding


@pytest.mark.parametrize(
    "name, expected",
    [("paper", 1), ("hencky", 2), ("midpoint", 2), ("open", 3), ("gauss", 4), ("gregory", 4), ("clamped", 4)],
)
def test_the_curvature_integral_converges_with_the_order_of_the_rule(name, expected):
    """The moment is smooth and vanishes at the tip with its slope, as at a free end."""

    def error(n):
        exact = 2 * np.e - 5  # ∫ (1 − x)² eˣ dx
        return integral(lumping_rule(name), n, lambda x: (1 - x) ** 2 * np.exp(x)) - exact

    assert order({n: error(n) for n in (12, 24, 48)}) == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize(("root", "tip"), [(0.0, 0.0), (0.0, 2.0), (1.5, 0.0), (0.5, 2.0)])
def test_a_jacobi_rule_is_exact_for_its_weight_times_polynomials(root: float, tip: float) -> None:
    """∫ (1 − x)^tip x^(root + d) dx = B(root + d + 1, tip + 1) is exact up to d = 2N − 1 only."""
    rule, count = LumpingRule(about="a", source="b", jacobi=Jacobi(root=root, tip=tip)), 5
    wrong = []
    for d in range(2 * count + 1):
        exact = special.beta(root + d + 1, tip + 1)
        wrong.append(integral(rule, count, lambda x, d=d: (1 - x) ** tip * x ** (root + d)) / exact - 1)
    assert wrong[:-1] == pytest.approx(np.zeros(2 * count), abs=1e-12)  # nodes of roots_jacobi are accurate to 1e-14
    assert abs(wrong[-1]) > 1e-8


def test_a_user_defined_rule_is_read_from_a_file(tmp_path):
    path = tmp_path / "simpson.toml"
    path.write_text(
        'about = "Maclaurin, 3 points"\nsource = "mine"\n[element]\n'
        "nodes = [0.16666666666666666, 0.5, 0.8333333333333334]\nweights = [0.375, 0.25, 0.375]\n",
        encoding="utf-8",
    )
    rule = lumping_rule(str(path))
    assert integral(rule, 6, lambda x: x**3) == pytest.approx(1 / 4, rel=1e-14, abs=0)
    assert cantilever(str(path), 6).n == 6


@pytest.mark.parametrize(
    "fields, message",
    [
        ({}, "rule-kind"),
        ({"grid": Grid(first=1.0, last=1.0), "jacobi": Jacobi()}, "rule-kind"),
        ({"element": lambda: Element(nodes=(0.5,), weights=(0.5, 0.5))}, "rule-weights"),
        ({"element": lambda: Element(nodes=(0.75, 0.25), weights=(0.5, 0.5))}, "rule-nodes"),
        ({"element": lambda: Element(nodes=(0.25, 0.75), weights=(0.5, -0.5))}, "wrong-value"),
        ({"element": lambda: Element(nodes=(0.25, 1.25), weights=(0.5, 0.5))}, "rule-nodes"),
        ({"element": lambda: Element(nodes=(0.25, 0.75), weights=(0.5, 0.501))}, "rule-weights"),
        ({"jacobi": lambda: Jacobi(tip=-0.5)}, "wrong-value"),
    ],
)
def test_an_invalid_rule_is_refused_with_the_reason(fields, message):
    with refused(SceneError, message):
        LumpingRule(about="", source="", **{key: f() if callable(f) else f for key, f in fields.items()})


@pytest.mark.parametrize("name, too_few", [("gregory", 5), ("open", 3), ("clamped", 2), ("gauss", 3)])
def test_a_number_of_hinges_that_a_rule_does_not_have_is_refused(name, too_few):
    with pytest.raises(SceneError, match="segments"):
        cantilever(name, too_few)


@pytest.mark.parametrize("name", sorted(TIP_FREE))
def test_a_hinge_at_a_free_joint_is_refused_and_at_a_locked_one_is_allowed(name):
    assert cantilever(name, 6).n == 6
    with refused(SceneError, "hinge-without-inertia"):
        thin_arm(thin_link(name, 6, free=True))


def test_a_hinge_at_the_links_end_is_refused(tmp_path):
    path = tmp_path / "both_ends.toml"
    path.write_text('about = "trapezoid"\nsource = "mine"\n[grid]\nfirst = 0.0\nlast = 0.0\n', encoding="utf-8")
    with refused(SceneError, "hinge-without-inertia"):
        cantilever(str(path), 5)


@pytest.mark.parametrize("name", EXACT_DEGREE)
@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
def test_every_rule_gives_every_flex_type_a_chain_that_moves(name, flex):
    """Hinges are bent up to 50°, far beyond the useful range and the limit of `gauss_matched`."""
    chain = lump(
        make_scene(
            flexible("upper", flex, 7, lumping=name, joint=Joint(locked=name in TIP_FREE)),
            flexible("fore", flex, 7, lumping=name, joint=Joint(locked=name in TIP_FREE)),
        )
    )
    rng = np.random.default_rng(3)
    for _ in range(20):
        q, qd, tau = rng.uniform(-0.87, 0.87, chain.n), rng.uniform(-10, 10, chain.n), rng.uniform(-1, 1, chain.n)
        M = mass_matrix(chain, q)
        assert np.linalg.eigvalsh(M).min() > 0
        assert energy(chain, q, qd).kinetic == pytest.approx(qd @ M @ qd / 2, rel=1e-12, abs=0)
        torque = tau - bias_torque(chain, q, qd) - elastic_torque(chain, q) - friction_torque(chain, qd)
        expected = np.linalg.solve(M, torque)
        for method in SOLVERS:
            solved = forward_dynamics(chain, q, qd, tau, solver=method)
            assert rounding.acceleration_error(chain, q, qd, tau, solutions=(solved, expected)).max() <= 1


def test_rotors_of_matched_twist_act_only_on_relative_motion():
    """Only twist hinges have (negative) rotors; accelerating a uniform twist needs the torques of the real bar."""
    chain, bending = torsion_bar("gauss_matched", 6)
    nodes, weights = lumping_rule("gauss_matched").hinges(6)
    rotors, twisting = chain.hinges["armature"], np.setdiff1d(np.arange(chain.n), bending)
    assert (rotors[bending] == 0).all()
    assert (rotors[twisting] < 0).all()
    even = np.zeros(chain.n)
    even[twisting] = weights  # unit twist per length
    torque, rigid = mass_matrix(chain, np.zeros(chain.n)) @ even, (1 - nodes**2) / 2
    assert torque[twisting] == pytest.approx(rigid, rel=1e-12)
    assert not np.allclose((torque - rotors * even)[twisting], rigid, rtol=1e-3)


def test_axes_alternate_only_if_the_rule_specifies_it():
    paper, gauss = (lump(make_scene(flexible("arm", "xyz", 5, lumping=name))) for name in ("paper", "gauss"))
    assert paper.hinges["axis"].tolist() == [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2]
    assert gauss.hinges["axis"].tolist() == [2, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0]
    for chain in (paper, gauss):
        for k, axis in enumerate(chain.hinges["axis"][1:], start=1):
            assert chain.coordinate(k).axis == axis + 1
            assert chain.index(*chain.coordinate(k)) == k


@pytest.mark.parametrize("name", EXACT_DEGREE)
@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_other_engines_load_chains_of_every_rule(name, engine):
    """M and q̈ from exported files agree, including negative rotors, alternating axes and hinges at the root."""
    pytest.importorskip(engine)
    locked = Joint(locked=name in TIP_FREE)
    chain = lump(make_scene(*(flexible(link, "xyz", 7, lumping=name, joint=locked) for link in ("upper", "fore"))))
    other, rng = load(engine, chain), np.random.default_rng(4)
    for _ in range(5):
        q, qd, tau = rng.uniform(-0.5, 0.5, chain.n), rng.uniform(-3, 3, chain.n), rng.uniform(-1, 1, chain.n)
        assert np.abs(other.mass_matrix(q) - mass_matrix(chain, q)).max() <= rounding.of_mass_matrix(chain, q)
        solutions = other.forward_dynamics(q, qd, tau), forward_dynamics(chain, q, qd, tau, solver="lu")
        assert rounding.acceleration_error(chain, q, qd, tau, solutions=solutions).max() <= 1
