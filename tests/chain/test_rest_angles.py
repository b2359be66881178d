"""Links that are curved or twisted at rest: Kirchhoff's rod by shooting, Ritz's arch, closed forms, refused input.

The rod and the arch share no model and no code with the chain: SciPy integrates r' = R e_x, R' = R [κ₀ + K⁻¹ Rᵀ m]×.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.polynomial import Legendre, legendre
from scipy.linalg import eigh

import flexlink as fl
from flexlink.chain.rest_angles import rotations
from flexlink.describe.rest_shape import Along, RestCurvature
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.dynamics.placement import frames
from flexlink.dynamics.sensors.signals import placement_of
from tests.support.beams import THIN, rod, thin_arm, thin_link
from tests.support.words import refused

Array = np.ndarray
QUARTER = np.pi / 2
"""Curvature of a quarter circle of length 1 [1/m]."""


def link(rule: str, hinges: int, flex: str = "z", **shape: Any) -> fl.Link:
    return replace(thin_link(rule, hinges), **{"flex": flex, **shape})


def scene_of(one: fl.Link) -> fl.Scene:
    thin = fl.Section(shape="general", area=1.0, i_y=THIN, i_z=THIN, torsion=THIN)
    arm = fl.Arm(links=(one,), materials={"unit": fl.Material(young=1 / THIN, poisson=-0.5, density=1.0)},
                 sections={"thin": thin})  # fmt: skip
    return fl.Scene(name="arc", arm=arm, gravity=(0, 0, 0), run=fl.RunSettings(step=1e-3, duration=0.01))


def bent_tip(chain: fl.Chain, force: Array) -> Array:
    return fl.tip_position(chain, fl.solve_static(chain, tip_wrench=[*force, 0, 0, 0]).q)


SECOND = (
    "gauss", "gauss_matched", "gauss_rotation", "legendre", "midpoint", "hencky", "clamped", "open", "paper", "gregory",
)  # fmt: skip
ORDERS = dict.fromkeys(SECOND, 2)
ORDERS |= {"lobatto2": 4, "lobatto2_rotation": 4, "lobatto4": 8}
"""Order of the error of the tip at rest of a quarter circle, by rule."""
FACTORS = {2: 0.2, 4: 0.032, 8: 1.7e-3}


@pytest.mark.parametrize("rule", ORDERS)
def test_a_quarter_circle_at_rest_ends_where_the_circle_does(rule: str) -> None:
    for hinges in (8, 16, 32, 64, 128):
        chain, order = thin_arm(link(rule, hinges, curvature=QUARTER)), ORDERS[rule]
        error = np.linalg.norm(fl.tip_position(chain, chain.rest) - [1 / QUARTER, 1 / QUARTER, 0])
        assert error <= FACTORS[order] / hinges**order + 1e-13
        assert chain.rest.sum() == pytest.approx(QUARTER, abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "hinges", "largest", "order"),
    [("gauss", 8, 1.1e-3, 2), ("lobatto2", 8, 5.95e-6, 4), ("lobatto4", 4, 1.02e-6, 8)],
)
def test_a_quarter_circle_unrolls_as_the_rod(rule: str, hinges: int, largest: float, order: int) -> None:
    force = np.array([1.0, 0.0, 0.0])
    truth = rod(np.eye(3), lambda s: [0, 0, QUARTER], force)
    chains = [thin_arm(link(rule, n, curvature=QUARTER)) for n in (hinges, 2 * hinges)]
    coarse, fine = (np.linalg.norm(bent_tip(chain, force) - truth) for chain in chains)
    assert coarse <= largest
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


def helix(count: int) -> Array:
    """Points of a helix, in axes of its beginning: x along it, y towards its axis."""
    a, R, rise = np.linspace(0, 3, count), 0.3, 0.1
    x = np.array([R, 0, rise]) / np.hypot(R, rise)
    y = np.array([0, 1, 0])
    return np.column_stack([R * np.sin(a), R * (1 - np.cos(a)), rise * a]) @ np.array([x, y, np.cross(x, y)]).T


@pytest.mark.parametrize("twist", [0.0, -1.0, {"x": (0, 0.3 * np.sqrt(10)), "rate": (3, 0), "root": 0.4}])
def test_a_link_at_rest_follows_the_measured_points_of_its_centre_line(tmp_path: Path, twist: Any) -> None:
    """Also if its sections turn about the line."""
    points = helix(31)
    np.savetxt(tmp_path / "line.csv", points, delimiter=",", header="x [m],y [m],z [m]", comments="")
    read = RestCurvature(file=str(tmp_path / "line.csv"))
    measured = RestCurvature(points=points)
    assert read == measured
    assert measured.x[-1] == pytest.approx(3 * np.hypot(0.3, 0.1), rel=1e-6)
    errors, fine = [], helix(60_001)
    for hinges in (30, 60):
        one = replace(link("gauss", hinges, "xyz"), length=0.0, curvature=measured, twist=twist)
        assert one.length == measured.x[-1]
        chain = fl.lump(scene_of(one))
        off = [np.linalg.norm(fine - point, axis=1).min() for point in frames(chain, chain.rest).points]
        errors.append(max(off))
        assert np.linalg.norm(fl.tip_position(chain, chain.rest) - points[-1]) < 1.1 * errors[-1]
    assert errors[1] < 1.1e-4
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_curvatures_about_axes_that_twist_does_not_turn_may_jump() -> None:
    shape = {"x": (0, 0.4, 0.4, 1), "z": (1, 1, -2, 1), "untwisted": True}
    twists = (0.0, {"x": (0, 1), "rate": (2, 2), "root": 0.5})
    chains = [thin_arm(link("gauss", 100, "xyz", curvature=shape, twist=twist)) for twist in twists]
    straight, turned = (fl.tip_position(chain, chain.rest) for chain in chains)
    np.testing.assert_allclose(turned, straight, atol=1e-5)


def test_centre_lines_that_are_none_are_refused(tmp_path: Path) -> None:
    points = helix(31)
    wrong: tuple[tuple[str, dict[str, Any]], ...] = (
        ("centre-line", {"points": points[:3]}), ("centre-line", {"points": points + 1.0}),
        ("centre-line", {"points": np.repeat(points, 2, axis=0)}), ("centre-line", {"points": points[:, ::-1]}),
        ("both-given", {"points": points, "z": (1.0,)}), ("both-given", {"points": points, "file": "line.csv"}),
    )  # fmt: skip
    for id, given in wrong:
        with refused(fl.errors.SceneError, id):
            RestCurvature(**given)
    (tmp_path / "line.csv").write_text("x [m],y [m]\n0,0\n", encoding="utf-8")
    with refused(fl.errors.DataFileError, "no-such-column"):
        RestCurvature(file=str(tmp_path / "line.csv"))
    with refused(fl.errors.SceneError, "rigidity-table"):
        replace(link("gauss", 4), curvature=RestCurvature(points=points))


SPACE = {"curvature": (1.0, 2.0), "twist": 2.0}
TABLES = {
    "curvature": {"x": (0, 1), "y": (0, 1), "z": (2, 2)},
    "twist": {"x": (0, 1), "rate": (2, 0)},
}


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "κ"),
                         [(SPACE, lambda s: [2, 1, 2]), (TABLES, lambda s: [2 - 2 * s, s, 2])])  # fmt: skip
@pytest.mark.parametrize("rule", ["gauss", "lobatto2", "lobatto4"])
def test_a_twisted_rod_bends_in_space_with_order_two(rule: str, shape: dict[str, Any], κ: Callable[..., Any]) -> None:
    force = np.array([0.3, 0.2, 1.0])
    truth = rod(np.eye(3), κ, force)
    tips = [bent_tip(thin_arm(link(rule, n, "xyz", **shape)), force) for n in (16, 32, 64)]
    first, second, third = (np.linalg.norm(tip - truth) for tip in tips)
    assert third < 1.3e-4
    assert np.log2([first / second, second / third]) == pytest.approx([2, 2], abs=0.2)
    assert np.linalg.norm((4 * tips[2] - tips[1]) / 3 - truth) < 8e-6  # extrapolated


@pytest.mark.parametrize(
    ("flex", "rule", "largest"),
    [("z", "gauss", 2.8e-5), ("z", "midpoint", 9e-5), ("yz", "gauss", 2.1e-5), ("yz", "lobatto2", 2.5e-5)],
)
def test_a_rod_that_bends_about_some_axes_of_its_twisted_sections_has_order_two(
    flex: str, rule: str, largest: float
) -> None:
    force, stiff = np.array([0.0, 0.2, 0.4]), 1e12
    truth = rod(np.diag([stiff, 1.0 if flex == "yz" else stiff, 1.0]), lambda s: [1.5, 0, 0.3], force)
    shape = {"curvature": 0.3, "twist": 1.5}
    tips = [bent_tip(thin_arm(link(rule, n, flex, **shape)), force) for n in (8, 16, 32)]
    first, second, third = (np.linalg.norm(tip - truth) for tip in tips)
    assert third < largest
    assert np.log2([first / second, second / third]) == pytest.approx([2, 2], abs=0.3)


@pytest.mark.slow
def test_the_45_degree_bend_of_bathe_and_bolourchi() -> None:
    """Int. J. Numer. Meth. Eng. 14 (1979) 961: an eighth of a circle of radius 100, square 1 × 1, E = 1e7, load 600."""
    length, force, I = 25 * np.pi, np.array([0.0, 0.0, 600.0]), 1 / 12
    section = fl.Section(shape="rectangle", height=1.0, width=1.0)
    K = 1e7 * np.diag([section.properties.torsion / 2, I, I])
    truth = rod(K, lambda s: [0, 0, 0.01], force, length)
    assert truth == pytest.approx([46.893, 15.558, 53.601], abs=6e-4)

    def tip(hinges: int) -> Array:
        bend = fl.Link(name="bend", joint=fl.Joint(locked=True), length=length, flex="xyz", segments=hinges + 1,
                       lumping="lobatto4", curvature=0.01, material="m", section="s")  # fmt: skip
        arm = fl.Arm(links=(bend,), materials={"m": fl.Material(young=1e7, density=1.0, poisson=0.0)},
                     sections={"s": section})  # fmt: skip
        return bent_tip(fl.lump(fl.Scene(name="bend", arm=arm, gravity=(0, 0, 0))), force)

    errors = [np.linalg.norm(tip(hinges) - truth) / length for hinges in (16, 32, 64)]
    assert errors == pytest.approx([6.12e-4, 1.69e-4, 4.32e-5], rel=0.03)


def arch(angle: float, count: int = 14) -> Array:
    """Frequencies of a clamped inextensible arch, EI = ρA = L = 1, by Ritz: δκ is a sum of Legendre polynomials."""
    x, w = legendre.leggauss(60)
    s, ds = (x + 1) / 2, w / 2
    basis = [Legendre.basis(k, domain=[0, 1]) for k in range(count)]
    turns = [one.integ(lbnd=0) for one in basis]
    u = s[:, None] * s  # places inboard of every s
    moved = [[turn(u) * sign * of(angle * u) @ ds * s for turn in turns]
             for sign, of in ((-1, np.sin), (1, np.cos))]  # fmt: skip
    M = sum((np.array(part) * ds) @ np.array(part).T for part in moved)
    P = np.array([one(s) for one in basis])
    return np.sqrt(eigh((P * ds) @ P.T, M, eigvals_only=True))


def test_a_clamped_quarter_circle_has_the_frequencies_of_the_arch() -> None:
    assert arch(1e-9)[0] == pytest.approx(1.8751040687**2, rel=1e-9)
    truth = arch(QUARTER)[0]
    for hinges, error in ((8, 3.31e-5), (16, 2.07e-6), (32, 1.3e-7)):
        ω = fl.natural_frequencies(thin_arm(link("lobatto4", hinges, curvature=QUARTER)))[0]
        assert abs(ω / truth - 1) == pytest.approx(error, rel=0.03)


@pytest.mark.parametrize("gradient", [10.0, 1e4])
def test_a_link_warmed_on_one_side_bows_to_a_circle(gradient: float) -> None:
    """The fibre at +y is longer, so the tip moves to −y: by κ L²/2 if the bow is slight."""
    warm = {"gradient": gradient, "expansion": 2e-5}
    chain = thin_arm(link("lobatto4", 8, thermal=warm))
    κ = 2e-5 * gradient
    circle = [np.sin(κ) / κ, -2 * np.sin(κ / 2) ** 2 / κ, 0]
    assert fl.tip_position(chain, fl.solve_static(chain).q) == pytest.approx(circle, abs=1e-14)
    assert κ > 1e-2 or circle[1] == pytest.approx(-κ / 2, rel=1e-8)
    across = {"gradient": (0.0, gradient), "expansion": 2e-5}
    up = thin_arm(link("lobatto4", 8, "yz", thermal=across))
    assert fl.tip_position(up, up.rest) == pytest.approx([circle[0], 0, circle[1]], abs=1e-14)


@pytest.mark.parametrize("rule", ORDERS)
def test_jumps_of_curvature_are_integrated_exactly(rule: str) -> None:
    bend = Along(np.array([0, 0.3, 0.3, 0.71, 0.71, 1]), np.array([0, 0, 2, 4, 0, 0]))
    of_rule = lumping_rule(rule)
    nodes, _ = of_rule.hinges(8)
    v = rotations(bend, of_rule, nodes)
    total, moment = 0.41 * 3, 0.41 * (0.3 * 3 + 0.41 * (1 + 2 / 3))
    assert v.sum() == pytest.approx(total, rel=1e-13)
    assert v @ nodes == pytest.approx(moment, rel=1e-13)


@pytest.mark.parametrize("flex", ["rigid", "z", "yz"])
def test_axes_without_hinges_are_turned_once_and_for_all(flex: str) -> None:
    """Rotations at rest are the same whether hinges or bodies are turned."""
    shape = {**SPACE, "joint": fl.Joint()}
    bends, one_segment = thin_arm(link("gauss", 16, "xyz", **shape)), {"segments": 1} if flex == "rigid" else {}
    other = thin_arm(link("gauss", 16, flex, **shape, **one_segment))
    one, two = (fl.frames(chain, chain.rest) for chain in (bends, other))
    near = 4e-3 if flex == "rigid" else 1e-14  # the rigid link is turned at more places
    assert two.points[-1] == pytest.approx(one.points[-1], abs=near)
    assert two.rotations[-1] == pytest.approx(one.rotations[-1], abs=near)
    assert other.mass == pytest.approx(bends.mass)


def test_runs_start_unloaded_and_gauges_read_what_is_beyond_the_rest() -> None:
    scene = scene_of(link("lobatto2", 8, curvature=QUARTER))
    chain = fl.lump(scene)
    run = fl.simulate(scene)
    assert np.array_equal(run.q, np.tile(chain.rest, (len(run.t), 1)))
    gauge = fl.strength.beam_strain(scene, chain.rest, link="link", fibre=(0.1, 0.0))
    assert np.array_equal(gauge.strain, np.zeros(8))
    moment = fl.solve_static(chain, tip_wrench=[0, 0, 0, 0, 0, 0.3]).q
    gauge = fl.strength.beam_strain(scene, moment, link="link", fibre=(0.1, 0.0))
    assert gauge.curvature[:, 2] == pytest.approx(0.3)
    assert gauge.strain == pytest.approx(-0.03)
    shaped = fl.lump(scene.varied({"link.link.modes": 8}))
    assert fl.solve_static(shaped, tip_wrench=[0.5, 0, 0, 0, 0, 0]).q == pytest.approx(
        fl.solve_static(chain, tip_wrench=[0.5, 0, 0, 0, 0, 0]).q, abs=1e-9
    )


@pytest.mark.parametrize("place", [{"x": 0.5}, {"point": (0.45016, 0.18646, 0.0)}])
def test_sensors_are_on_the_curve_with_axes_that_turn_along_it(place: dict[str, Any]) -> None:
    scene = scene_of(link("lobatto4", 64, curvature=QUARTER))
    chain = fl.lump(scene)
    body, point, axes = placement_of(fl.Sensor(name="a", kind="accelerometer", link="link", **place), scene)
    here = fl.frames(chain, chain.rest)
    R, p = here.rotations[body], here.points[body]
    half, c = 1 / QUARTER, np.sqrt(0.5)
    assert R @ point + p == pytest.approx([c * half, half - c * half, 0], abs=2e-4)
    assert pytest.approx(np.array([[c, -c, 0], [c, c, 0], [0, 0, 1]]), abs=0.02) == R @ axes.T


def test_what_has_no_meaning_is_refused_by_name() -> None:
    with refused(fl.errors.SceneError, "rest-angle-too-large"):
        thin_arm(link("gauss", 2, curvature=4.0))
    with refused(fl.errors.SceneError, "rotation-curved"):
        thin_arm(link("gauss_rotation", 2, "xyz", curvature=1.0))
    with refused(fl.errors.SceneError, "rigidity-table"):
        link("gauss", 2, curvature={"x": (0, 0.5), "z": (1, 1)})
    with refused(fl.errors.SceneError, "one-per-row"):
        link("gauss", 2, twist={"x": (0, 1), "rate": (1,)})
    with refused(fl.errors.SceneError, "needs-another-key"):
        fl.Link(name="a", length=1.0, curvature=1.0)
    table = fl.details.DenavitHartenberg(convention="standard", a=1.0)
    with refused(fl.errors.SceneError, "dh-curved"):
        thin_arm(link("gauss", 2, "xyz", twist=1.0), fl.Link(name="b", dh=table))
