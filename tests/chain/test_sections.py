"""Beam sections with stiffness and mass 6 × 6: rods by shooting, Ritz frequencies, published beams, blade files."""

import re
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Legendre, legendre
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.cli.main import main
from flexlink.data.blade_file import read_blade, read_centre_line
from flexlink.describe.rest_shape import RestCurvature, RestTwist
from flexlink.describe.scene import scene_from
from tests.support.words import refused, refused_line

Array = np.ndarray
STIFF = np.array([
    [40.0, 13.0, -14.0, 2.0, -3.4, -0.5], [13.0, 25.0, -8.0, 1.8, -2.6, 0.4], [-14.0, -8.0, 34.0, -0.6, 1.3, 2.3],
    [2.0, 1.8, -0.6, 0.6, 0.13, 0.24], [-3.4, -2.6, 1.3, 0.13, 1.3, 0.18], [-0.5, 0.4, 2.3, 0.24, 0.18, 0.9],
])  # fmt: skip
BLADE = 1e6 * np.array([
    [2389.0, 1.524, 6.734, -33.82, -26.27, -473.6], [1.524, 433.4, -3.741, -0.2935, 15.27, 0.3835],
    [6.734, -3.741, 27.43, -0.4592, -0.6869, -4.742], [-33.82, -0.2935, -0.4592, 21.67, -0.6279, 1.43],
    [-26.27, 15.27, -0.6869, -0.6279, 19.7, 12.09], [-473.6, 0.3835, -4.742, 1.43, 12.09, 440.6],
])  # fmt: skip
"""Blade of GXBeam's example "Time-Domain Simulation of a Wind Turbine Blade", 60 m; its mass follows in `of_blade`."""
FORCE = np.array([0.25, 0.5, 1.0])
ALL = {"shear": True, "stretch": True}


def mass(m: float, y: float, z: float, inertia: tuple[float, float, float], product: float = 0.0) -> Array:
    """M of a section with its centre of mass at (y, z); inertias and I_yz are about the axis."""
    across = m * np.array([[0.0, z, -y], [-z, 0.0, 0.0], [y, 0.0, 0.0]])
    own = np.diag(inertia)
    own[1, 2] = own[2, 1] = product
    return np.block([[m * np.eye(3), across], [across.T, own]])


CENTRED = mass(1.0, 0.0, 0.0, (0.03, 0.01, 0.02))
ASIDE = mass(1.0, 0.06, -0.04, (0.04, 0.015, 0.025), 0.004)


def of_blade() -> Array:
    return mass(258.053, 71.6871 / 258.053, 7.07839 / 258.053, (48.59, 2.172, 46.418))


def scene(K: Any = STIFF, M: Any = CENTRED, hinges: int = 8, length: float = 1.0, **fields: Any) -> fl.Scene:
    table = fl.Rigidity(x=(0.0, length or 1.0), stiffness=K, mass=M, relative=not length)
    link = fl.Link(
        name="blade", length=length, segments=hinges + 1, rigidity="t",
        **{"flex": "xyz", "joint": fl.Joint(locked=True), **ALL, **fields},
    )  # fmt: skip
    return fl.Scene(name="blade", arm=fl.Arm(links=(link,), rigidities={"t": table}), gravity=(0.0, 0.0, 0.0))


def moved(given: fl.Scene, force: Any = FORCE) -> Array:
    """Position of the tip under a dead force."""
    chain = fl.lump(given)
    return fl.tip_position(chain, fl.solve_static(chain, tip_wrench=[*force, 0, 0, 0]).q)


def cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rod(C: Array, force: Array = FORCE, bent: Any = (0.0, 0.0, 0.0), length: float = 1.0) -> Array:
    """Tip of a Cosserat rod of compliance C (6, 6), with twist and curvature at rest, by shooting."""

    def end(m0: Array, F: Array) -> Array:
        def slope(_: float, y: Array) -> Array:
            R = y[:9].reshape(3, 3)
            strains = C @ np.concatenate([R.T @ F, R.T @ y[12:]])
            along = R @ (np.array([1.0, 0.0, 0.0]) + strains[:3])
            return np.concatenate([(R @ cross(np.array(bent) + strains[3:])).ravel(), along, np.cross(F, along)])

        start = np.concatenate([np.eye(3).ravel(), np.zeros(3), m0])
        return solve_ivp(slope, (0.0, length), start, method="DOP853", rtol=1e-11, atol=1e-13).y[9:, -1]

    m0, scale = np.zeros(3), np.linalg.norm(force) * length
    for F in (0.5 * force, force):
        m0 = root(lambda m: end(m, F)[3:] / scale, m0, tol=1e-12).x  # noqa: B023
    return end(m0, force)[:3]


def without(K: Array, strains: tuple[int, ...]) -> Array:
    """Compliance if the forces of some strains do no work."""
    C = np.linalg.inv(K)
    C[strains, :] = C[:, strains] = 0.0
    return C


@pytest.mark.slow
@pytest.mark.parametrize("bent", [(0.0, 0.0, 0.0), (1.0, 0.7, 1.2)])
def test_a_section_with_all_couplings_bends_in_space_as_the_rod(bent: tuple[float, float, float]) -> None:
    """Order 2; with even powers of the spacing only, so that two runs without their common error are within 1e-6."""
    truth = rod(np.linalg.inv(STIFF), bent=bent)
    coarse, fine = (moved(scene(hinges=n, curvature=bent[1:], twist=bent[0])) for n in (48, 96))
    assert np.linalg.norm(fine - truth) < 5e-5
    assert np.log2(np.linalg.norm(coarse - truth) / np.linalg.norm(fine - truth)) == pytest.approx(2, abs=0.05)
    assert np.linalg.norm((4 * fine - coarse) / 3 - truth) < 3e-7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fields", "free", "limit"),
    [
        ({"shear": False, "stretch": False, "lumping": "lobatto2_rotation"}, (0, 1, 2), 1e-6),
        ({"shear": False, "stretch": False}, (0, 1, 2), 1e-4),
        ({"shear": False}, (1, 2), 1e-4),
        ({"stretch": False}, (0,), 1e-4),
    ],
)
def test_forces_of_strains_that_a_link_lacks_do_no_work(
    fields: dict[str, Any], free: tuple[int, ...], limit: float
) -> None:
    """Without shear and stretch, rules with cells keep their order 4."""
    truth, found = rod(without(STIFF, free)), moved(scene(hinges=32, **fields))
    assert np.linalg.norm(found - moved(scene(hinges=32))) > 0.01
    assert np.linalg.norm(found - truth) < limit


def test_curvatures_about_axes_in_which_a_link_does_not_bend_are_zero() -> None:
    small = 1e-4 * FORCE
    K = STIFF[np.ix_([0, 1, 5], [0, 1, 5])]  # stretch, shear along y, bending about z; shear along z is free
    C = np.linalg.inv(STIFF[np.ix_([0, 1, 2, 5], [0, 1, 2, 5])])[np.ix_([0, 1, 3], [0, 1, 3])]
    assert np.abs(C - np.linalg.inv(K)).max() > 1e-3
    x, y = small[:2]
    N, Q, M = np.array([x, y, 0.0]), np.array([0.0, 0.0, y]), lambda s: 1 - s
    straight = sum(w * (C @ (N + Q * M(s))) for s, w in ((0.5 - 1 / np.sqrt(12), 0.5), (0.5 + 1 / np.sqrt(12), 0.5)))
    chain = fl.lump(scene(flex="z"))
    assert set(chain.joint_names) == {f"blade.{k}.{name}" for k in range(1, 9) for name in ("z", "stretch", "shear.y")}
    q = fl.solve_static(chain, tip_wrench=[*small, 0, 0, 0]).q
    sums = [q[[k for k, name in enumerate(chain.joint_names) if name.endswith(end)]].sum() for end in ("stretch", "z")]
    np.testing.assert_allclose(sums, straight[[0, 2]], rtol=1e-3)


def test_a_bar_with_coupled_stretch_and_twist_is_exact() -> None:
    K = np.diag([40.0, 25.0, 34.0, 0.6, 1.3, 0.9])
    K[0, 3] = K[3, 0] = 2.0
    chain = fl.lump(scene(K, hinges=4))
    q = fl.solve_static(chain, tip_wrench=[3.0, 0, 0, 0, 0, 0]).q
    twist = q[[k for k, name in enumerate(chain.joint_names) if name.endswith(".x")]].sum()
    longer, turned = np.linalg.solve(K[np.ix_([0, 3], [0, 3])], [3.0, 0.0])
    assert twist == pytest.approx(turned, rel=1e-12)
    np.testing.assert_allclose(fl.tip_position(chain, q), [1 + longer, 0, 0], atol=1e-12)


def ritz(K: Array, M: Array, strains: Any = range(6), length: float = 1.0, count: int = 12) -> Array:
    """Frequencies of a straight clamped beam whose strains are sums of Legendre polynomials, others zero."""
    x, w = legendre.leggauss(40)
    s, ds = (x + 1) / 2, w / 2 * length
    P = [Legendre.basis(k, domain=[0, 1]) for k in range(count)]
    level, once, twice = (
        np.array([one(s) for one in P]), length * np.array([one.integ(lbnd=0)(s) for one in P]),
        length**2 * np.array([one.integ(2, lbnd=0)(s) for one in P]),
    )  # fmt: skip
    e, motion = np.zeros((2, 6, len(strains) * count, len(s)))
    for k, own in enumerate(strains):
        part = slice(k * count, (k + 1) * count)
        e[own, part], motion[own, part] = level, once
        if own in {4, 5}:  # sections turned about y move along −z, about z along y
            motion[{4: 2, 5: 1}[own], part] = {4: -twice, 5: twice}[own]
    both = [np.tensordot(part * ds, np.tensordot(A, part, 1), ((0, 2), (0, 2))) for part, A in ((e, K), (motion, M))]
    return np.sqrt(eigh(*both, eigvals_only=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "M", "order"),
    [("gauss_matched", CENTRED, 4), ("gauss", CENTRED, 2), ("gauss", ASIDE, 2), ("gauss_matched", ASIDE, 2)],
)
def test_frequencies_with_all_couplings_are_those_of_ritz(rule: str, M: Array, order: int) -> None:
    """Mass off the axis limits every rule to order 2."""
    truth = ritz(STIFF, M)[:5]
    found = [fl.natural_frequencies(fl.lump(scene(STIFF, M, n, lumping=rule)))[:5] for n in (12, 24)]
    errors = [np.abs(one / truth - 1).max() for one in found]
    assert errors[1] < 4e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("rule", "M", "limit"), [("lobatto4", CENTRED, 2e-6), ("gauss", ASIDE, 6e-4)])
def test_frequencies_of_condensed_sections_are_those_of_ritz(rule: str, M: Array, limit: float) -> None:
    K = np.zeros((6, 6))
    K[3:, 3:] = np.linalg.inv(np.linalg.inv(STIFF)[3:, 3:])
    chain = fl.lump(scene(STIFF, M, 32, lumping=rule, shear=False, stretch=False))
    np.testing.assert_allclose(fl.natural_frequencies(chain)[:5], ritz(K, M, (3, 4, 5))[:5], rtol=limit)


@pytest.mark.slow
def test_the_blade_of_gxbeam_has_the_frequencies_of_ritz_and_keeps_its_energy() -> None:
    given = scene(BLADE, of_blade(), 8, 60.0)
    truth = ritz(BLADE, of_blade(), length=60.0)[:4]
    np.testing.assert_allclose(fl.natural_frequencies(fl.lump(given))[:4], truth, rtol=6e-3)
    bent = given.varied({"initial.passive": "static", "wrench": {"force": (0.0, 0.0, 1e4)}})
    released = bent.varied({"initial.q": tuple(fl.simulate(bent, duration=0.0).q[0]), "initial.passive": "zero"})
    run = fl.simulate(released.varied({"wrench": fl.Wrench()}), duration=1.0, method="Radau5", relative_tolerance=1e-6)
    assert np.ptp(run.energy.total) < 1e-8 * np.ptp(run.energy.elastic)


def test_the_composite_beam_of_beamdyn() -> None:
    """10 in long, with 150 lbf along z: Wang et al. 2017, Wind Energy 20:1439, doi 10.1002/we.2101.

    The values are those of BeamDyn and Kynema with 18 nodes (Kynema's documentation, "Static bending of a straight
    composite beam"); K is that of a box beam by Yu et al. 2002, in lbf and in.
    """
    K = np.diag([1368.17e3, 88.56e3, 38.78e3, 16.96e3, 59.12e3, 141.47e3])
    K[3, 4] = K[4, 3] = 17.61e3
    K[3, 5] = K[5, 3] = -0.351e3
    K[4, 5] = K[5, 4] = -0.37e3
    coarse, fine = (moved(scene(K, CENTRED, n, 10.0), [0.0, 0.0, 150.0]) - [10.0, 0.0, 0.0] for n in (24, 48))
    published = np.array([-0.0902726627566, -0.0647488486259, 1.2297364829237])
    assert np.abs(fine - published).max() < 2e-4
    np.testing.assert_allclose((4 * fine - coarse) / 3, published, atol=3e-7)


@pytest.mark.parametrize("rule", ["gauss", "legendre"])
def test_gauges_read_stretch_and_curvature_of_coupled_sections(rule: str) -> None:
    """All strains of the rod under a small tip force, at its gauges and hinges; stretch also where it is condensed."""
    F = 1e-6 * FORCE

    def strains(s: float, C: Array) -> Array:
        return C @ [*F, 0.0, -F[2] * (1 - s), F[1] * (1 - s)]

    for fields, C in ((ALL, np.linalg.inv(STIFF)), ({"shear": False, "stretch": False}, np.linalg.inv(STIFF))):
        if fields is not ALL:
            C[:, :3] = 0.0  # these forces do no work, and moments strain the axis
        gauge = fl.Sensor(name="g", kind="strain", link="blade", x=0.4, fibre=(0.1, 0.2))
        given = scene(lumping=rule, **fields).varied({"sensor": [gauge], "run.duration": 0.0})
        q = fl.solve_static(fl.lump(given), tip_wrench=[*F, 0, 0, 0]).q
        found = fl.strength.beam_strain(given, q, link="blade", fibre=(0.1, 0.2))
        exact = np.array([strains(s, C) for s in found.x])
        np.testing.assert_allclose(found.curvature, exact[:, 3:], atol=1e-5 * np.abs(exact).max())
        of_fibre = exact[:, 0] + 0.2 * exact[:, 4] - 0.1 * exact[:, 5]
        np.testing.assert_allclose(found.strain, of_fibre, atol=1e-5 * np.abs(exact).max())
        run = fl.simulate(given.varied({"wrench.force": tuple(F), "initial.passive": "static"}))
        here = strains(0.4, C)
        assert run.columns["g [1]"][0] == pytest.approx(here[0] + 0.2 * here[4] - 0.1 * here[5], rel=1e-5)


def test_bodies_carry_the_mass_of_tapering_sections() -> None:
    M = np.array([ASIDE, 2 * CENTRED, 2 * CENTRED, 0.5 * ASIDE])
    table = fl.Rigidity(x=(0.0, 0.3, 0.3, 1.0), stiffness=STIFF, mass=M, mass_factor=3.0)
    chain = fl.lump(scene(joint=fl.Joint()).varied({"rigidity.t": table}))
    v = np.array([0.3, -0.2, 0.5, 0.7, 0.4, -0.6])
    x, w = legendre.leggauss(8)
    energy = 0.0
    for start, end, a, b in ((0.0, 0.3, 0, 1), (0.3, 1.0, 2, 3)):
        for s, ds in zip((x + 1) / 2, w / 2 * (end - start), strict=True):
            here = np.concatenate([v[:3] + np.cross(v[3:], [start + s * (end - start), 0, 0]), v[3:]])
            energy += 1.5 * ds * here @ (M[a] + s * (M[b] - M[a])) @ here
    place, found = np.zeros(3), 0.0
    for body in chain.bodies:
        place = place + body["translation"]
        speed = v[:3] + np.cross(v[3:], place + body["center"])
        found += (body["mass"] * speed @ speed + v[3:] @ body["inertia"] @ v[3:]) / 2
    assert found == pytest.approx(energy, rel=1e-12)


def blade_file(K: Array, M: Array, mu: str = "1.0E-03 " * 6, damped: int = 1) -> str:
    """A blade file of BeamDyn with two stations."""
    head = ["---- BEAMDYN V1.00.* INDIVIDUAL BLADE INPUT FILE ----", "Test", "---- Blade Parameters ----"]
    head += ["2   station_total - Number of blade input stations (-)", f"{damped}   damp_type - Damping type"]
    head += ["---- Stiffness-Proportional Damping ----", "mu1 mu2 mu3 mu4 mu5 mu6", "(-) (-) (-) (-) (-) (-)", mu]
    head += ["---- Distributed Properties ----"]
    rows = ["\n".join(" ".join(f"{one:.9E}".replace("E", "D") for one in row) for row in A) + "\n" for A in (K, M)]
    return "\n".join([*head, "  0.000000", *rows, "  1.0", *rows])


def primary_file(keys: Array, *members: int) -> str:
    """A primary input file of BeamDyn with key points x, y, z and initial twist [°], (k, 4)."""
    head = ["---- BEAMDYN with OpenFAST INPUT FILE ----", "Test", "---- GEOMETRY PARAMETER ----"]
    head += [f"{len(members)}   member_total - Members (-)", f"{len(keys)}   kp_total - Key points (-)"]
    head += [f"  {k}  {number}  - Member number; key points in it" for k, number in enumerate(members, 1)]
    head += ["kp_xr kp_yr kp_zr initial_twist", "(m) (m) (m) (deg)"]
    rows = [" ".join(f"{one:.9E}" for one in row) for row in keys]
    return "\n".join([*head, *rows, "---- MATERIAL PARAMETER ----", '"a blade.dat"    BldFile - Properties (quoted)'])


@pytest.mark.slow
def test_a_blade_from_key_points_has_the_axis_and_section_axes_of_beamdyn(tmp_path: Path) -> None:
    """Prebent, swept and twisted, in two members.

    The truth is the curve from which the key points are, and section axes by `BD_ComputeIniNodalCrv` of OpenFAST: e1
    has no part along y, and turns by minus the initial twist about the tangent e3.
    """
    z = np.linspace(0.0, 10.0, 41)
    keys = np.column_stack([-0.01 * z**2, 0.2 * (1 - np.cos(0.3 * z)), z, 13.0 - 0.2 * z**2])
    (tmp_path / "axis.dat").write_text(primary_file(keys, 21, 21), encoding="utf-8")

    def axes(z: float) -> Array:
        e3 = np.array([-0.02 * z, 0.06 * np.sin(0.3 * z), 1.0])
        e3 /= np.linalg.norm(e3)
        e1 = np.array([e3[2], 0.0, -e3[0]]) / np.hypot(e3[0], e3[2])
        turn = Rotation.from_rotvec(-np.radians(13.0 - 0.2 * z**2) * e3).as_matrix()
        return (turn @ np.array([e1, np.cross(e3, e1), e3]).T)[[2, 0, 1]][:, [2, 0, 1]]

    errors, file = [], {"file": str(tmp_path / "axis.dat")}
    for hinges in (32, 64):
        given = scene(hinges=hinges, length=0.0, curvature=file, twist=file)
        chain, link = fl.lump(given), given.arm.links[0]
        np.testing.assert_allclose(link.beam.frame, axes(0.0), atol=1e-12)
        turned = fl.frames(chain, chain.rest).rotations[-1].T @ axes(10.0) @ axes(0.0).T
        off = fl.tip_position(chain, chain.rest) - keys[-1, [2, 0, 1]]
        errors.append([np.linalg.norm(off), Rotation.from_matrix(turned).magnitude()])
    speed = quad(lambda z: np.sqrt(1 + (0.02 * z) ** 2 + (0.06 * np.sin(0.3 * z)) ** 2), 0.0, 10.0)
    assert link.length == pytest.approx(speed[0], rel=1e-9)
    assert max(errors[1]) < 2e-5
    assert errors[0][0] / errors[1][0] == pytest.approx(4, rel=0.01)
    assert scene_from(given.document()) == given


@pytest.mark.slow
def test_the_twisted_beam_of_beamdyn_from_its_blade_file(tmp_path: Path) -> None:
    """10 m, 90° of initial twist, −4 MN along y at the tip: "bd_static_twisted_with_k1" of OpenFAST's regression tests.

    BeamDyn's result there is within 1e-4 of the length of the rod by shooting; ours is within 1e-6. Its twist is
    positive about −z.
    """
    K = np.diag([8.2604167e9, 8.2604167e9, 25e9, 0.520833e9, 0.130208333e9, 0.141872656e9])
    M = np.diag([678.935] * 3 + [973.04, 972.86, 1945.9])
    M[0, 5] = M[5, 0] = -0.1154189
    M[2, 3] = M[3, 2] = 0.1154189
    (tmp_path / "a blade.dat").write_text(blade_file(K, M), encoding="utf-8")
    keys, file = np.outer(np.arange(11.0), [0, 0, 1, 9]), str(tmp_path / "primary.dat")
    (tmp_path / "primary.dat").write_text(primary_file(keys, 11), encoding="utf-8")
    table, twist = fl.Rigidity(file=file), RestTwist(file=file)
    assert table == fl.Rigidity(file=str(tmp_path / "a blade.dat"))
    np.testing.assert_allclose(twist.rate, -np.pi / 20, rtol=1e-12)
    assert (table.x, table.relative, table.loss_time) == ((0.0, 1.0), True, 1e-3)
    coarse, fine = (
        moved(scene(K, CENTRED, n, 10.0, twist=twist).varied({"rigidity.t": table}), [0.0, 0.0, -4e6]) for n in (32, 64)
    )
    found = (4 * fine - coarse) / 3 - [10.0, 0.0, 0.0]
    np.testing.assert_allclose(found, [-1.14114462, 1.71810805, -3.59245231], atol=1e-3)
    own = np.diag(K)[[2, 0, 1, 5, 3, 4]]
    truth = rod(np.diag(1 / own), np.array([0.0, 0.0, -4e6]), (-np.pi / 20, 0.0, 0.0), 10.0)
    np.testing.assert_allclose(found, truth - [10.0, 0.0, 0.0], atol=1e-5)
    written = scene_from(scene(K, CENTRED, 4, 10.0).varied({"rigidity.t": table}).document())
    assert written.arm.rigidities["t"] == table


@pytest.mark.parametrize(
    ("change", "id", "part"),
    [
        (lambda text: text.replace("1.0E-03 ", "2.0E-03 ", 1), "unequal-loss-times", "give loss_time"),
        (lambda text: text.replace("2   station_total", "3   station_total"), "blade-file", "2 stations"),
        (lambda text: text.replace("1   damp_type", "2   damp_type"), "blade-file", "damp_type = 2"),
        (lambda text: text.replace("2.500000000D+01", "x"), "blade-file", "line 12"),
    ],
)
def test_a_blade_file_that_cannot_be_read_is_refused(
    tmp_path: Path, change: Callable[[str], str], id: str, part: str
) -> None:
    file = tmp_path / "blade.dat"
    file.write_text(change(blade_file(25 * np.eye(6), CENTRED)), encoding="utf-8")
    with refused(fl.errors.DataFileError, id) as caught:
        fl.Rigidity(file=str(file))
    assert part in str(caught.value)
    if id == "unequal-loss-times":
        assert fl.Rigidity(file=str(file), loss_time=3e-3).loss_time == 3e-3


@pytest.mark.parametrize("letter", ["d", "E", "e"])
def test_numbers_of_a_blade_file_may_have_any_letter_for_the_exponent(tmp_path: Path, letter: str) -> None:
    file = tmp_path / "blade.dat"
    text = blade_file(25 * np.eye(6), CENTRED, mu=f"1.0{letter}-03, " * 6)
    file.write_text(re.sub(r"(?<=\d)D(?=[+-])", letter, text), encoding="utf-8")
    x, K, M, loss = read_blade(file) or pytest.fail()
    assert (x.tolist(), loss) == ([0, 1], [1e-3] * 6)
    np.testing.assert_array_equal([K, M], [[25 * np.eye(6)] * 2, [CENTRED] * 2])


KEYS = np.column_stack([0.1 * np.arange(4.0) ** 2, np.zeros(4), np.arange(4.0), 5 * np.arange(4.0)])


def test_key_points_become_x_along_the_blade_y_z_and_a_twist_in_radians_of_opposite_sign(tmp_path: Path) -> None:
    file = tmp_path / "primary.dat"
    file.write_text(primary_file(np.array([[1.0, 2.0, 3.0, 30.0], [4.0, 5.0, 6.0, -90.0]]), 2), encoding="utf-8")
    expected = [[3.0, 1.0, 2.0, -np.pi / 6], [6.0, 4.0, 5.0, np.pi / 2]]
    np.testing.assert_allclose(read_centre_line(file, twisted=True), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (("4   kp_total", "5   kp_total"), "kp_total = 5; its members have 4"),
        (("1   member_total", "1"), "the end: expected 1 number"),
        (("1.500000000E+01", "x"), "line 12: '9.000000000E-01"),
        (("(m) (m) (m) (deg)\n", ""), "line 12: '---- MATERIAL"),
        (("  1  4  ", "  1  "), "line 6: '1 - Member number"),
        (("kp_total", "kp"), "no kp_total; expected a primary input file of BeamDyn"),
    ],
)
def test_a_primary_file_that_cannot_be_read_is_refused(tmp_path: Path, change: tuple[str, str], part: str) -> None:
    file = tmp_path / "primary.dat"
    file.write_text(primary_file(KEYS, 4).replace(*change), encoding="utf-8")
    with refused(fl.errors.DataFileError, "blade-file") as caught:
        RestTwist(file=str(file))
    assert part in str(caught.value)


def test_other_mistakes_with_a_primary_file_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, blade = tmp_path / "primary.dat", tmp_path / "a blade.dat"
    file.write_text(primary_file(KEYS, 4), encoding="utf-8")
    scene(length=0.0, curvature={"points": KEYS[:, [2, 0, 1]]}).save(tmp_path / "scene.toml")
    code = main(["info", str(tmp_path / "scene.toml"), "--set", f"link.blade.twist={{file='{blade}'}}"])
    assert code == 2
    refused_line(capsys.readouterr().err, "cannot-read")
    with refused(fl.errors.SceneError, "both-given"):
        RestTwist(file=str(file), root=0.1)
    blade.write_text("nothing", encoding="utf-8")
    with refused(fl.errors.DataFileError, "blade-file"):
        fl.Rigidity(file=str(file))
    file.write_text(primary_file(KEYS[:3], 3), encoding="utf-8")
    with refused(fl.errors.SceneError, "centre-line"):
        RestCurvature(file=str(file))


def changed(matrix: Array, row: int, column: int, value: float) -> Array:
    other = matrix.copy()
    other[row, column] = value
    return other


@pytest.mark.parametrize(
    ("fields", "id", "part"),
    [
        ({"stiffness": STIFF[:5]}, "one-per-row", "6 × 6"),
        ({"stiffness": [[*row] for row in STIFF[:5].tolist()] + [[1.0]]}, "one-per-row", "6 × 6"),
        ({"stiffness": changed(STIFF, 0, 4, 1.0)}, "section-matrix", "stiffness[0][0][4] = 1.0"),
        ({"stiffness": changed(changed(STIFF, 0, 0, 1.0), 1, 1, 1.0)}, "section-not-stiff", "stiffness[0]"),
        ({"mass": changed(ASIDE, 1, 1, 2.0)}, "section-matrix", "mass[0][1][1] = 2.0"),
        ({"mass": mass(1.0, 0.5, 0.0, (0.02, 0.01, 0.01))}, "section-not-stiff", "mass[0]"),
        ({"ei_z": (1.0, 1.0)}, "both-given", "ei_z"),
        ({"rho_a": (1.0, 1.0)}, "both-given", "rho_a"),
        ({"relative": True}, "rigidity-table", "expected 1"),
    ],
)
def test_an_impossible_section_is_refused(fields: dict[str, Any], id: str, part: str) -> None:
    with refused(fl.errors.SceneError, id) as caught:
        fl.Rigidity(**{"x": (0.0, 2.0), "stiffness": STIFF, "mass": CENTRED, **fields})
    assert part in str(caught.value)


@pytest.mark.parametrize(("m", "y"), [(4.0, 0.5), (0.25, 2.0)])
def test_the_inertia_about_the_centre_of_mass_is_smaller_by_mass_times_distance_squared(m: float, y: float) -> None:
    for left in (0.24, -0.24):
        fields: dict[str, Any] = {"mass": mass(m, y, 0.0, (2.0, 1.0, m * y**2 + left))}
        with nullcontext() if left > 0 else refused(fl.errors.SceneError, "section-not-stiff"):
            fl.Rigidity(**{"x": (0.0, 2.0), "stiffness": STIFF, **fields})


@pytest.mark.parametrize(
    ("M", "fields", "id"),
    [
        (ASIDE, {"lumping": "lobatto2", "shear": False, "stretch": False}, "cells-off-axis"),
        (CENTRED, {"lumping": "lobatto2"}, "cells-without-strains"),
        (CENTRED, {"lumping": "gauss_rotation"}, "rotation-with-strains"),
        (CENTRED, {"shear": 0.85}, "shear-of-a-table"),
    ],
)
def test_a_link_that_cannot_have_such_sections_is_refused(M: Array, fields: dict[str, Any], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        fl.lump(scene(STIFF, M, **fields))


def test_a_gauge_on_a_jump_of_a_relative_table_is_refused() -> None:
    table = fl.Rigidity(x=(0, 0.5, 0.5, 1), stiffness=[STIFF, STIFF, 2 * STIFF, STIFF], mass=CENTRED, relative=True)
    gauge = fl.Sensor(name="g", kind="strain", link="blade", x=2.0, fibre=(0.1, 0.2))
    blade = scene(length=4.0).varied({"rigidity.t": table})
    with refused(fl.errors.SceneError, "gauge-on-jump") as caught:
        blade.varied({"sensor": [gauge]})
    assert "x = 1.996 or 2.004" in str(caught.value)


COLUMNS = {"gj": 0.6, "ei_y": 1.3, "ei_z": 0.9, "ea": 40.0, "kga_y": 25.0, "kga_z": 34.0}


def of_columns(factors: Any = (1.0, 0.5), **changed: Any) -> fl.Rigidity:
    names = {**COLUMNS, **changed}
    columns = {name: tuple(k * f for f in factors) for name, k in names.items() if k}
    more = dict.fromkeys(("rho_a", "rho_i_y", "rho_i_z"), (1.0, 1.0))
    return fl.Rigidity(x=(0.0, 1.0), **columns, **more)


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
@pytest.mark.parametrize("strains", [ALL, {"shear": True}, {"stretch": True}, {}])
def test_columns_of_axial_and_shear_rigidity_are_those_of_a_matrix(flex: str, strains: dict[str, bool]) -> None:
    K = np.array(
        [k * np.diag([COLUMNS[name] for name in ("ea", "kga_y", "kga_z", "gj", "ei_y", "ei_z")]) for k in (1.0, 0.5)]
    )
    own = of_columns(k_yz=0.2)
    K[:, 4, 5] = K[:, 5, 4] = own.k_yz
    matrix = fl.Rigidity(x=own.x, stiffness=K, rho_a=own.rho_a, rho_i_y=own.rho_i_y, rho_i_z=own.rho_i_z)
    gauge = fl.Sensor(name="g", kind="strain", link="blade", x=0.4, fibre=(0.1, 0.2))
    found = []
    for table in (own, matrix):
        given = scene(flex=flex, shear=False, stretch=False).varied(
            {f"link.blade.{key}": True for key in strains} | {"rigidity.t": table}
        )
        given = given.varied(
            {"sensor": [gauge], "run.duration": 0.0, "wrench.force": (0.3, 0.2, 0.1), "initial.passive": "static"}
        )
        run = fl.simulate(given)
        found.append([*fl.natural_frequencies(fl.lump(given)), *run.tip[0], run.columns["g [1]"][0]])
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-12)


def test_a_bar_and_a_timoshenko_beam_of_columns_have_closed_forms() -> None:
    given = scene(flex="z", shear=True, stretch=True, hinges=16).varied(
        {"rigidity.t": of_columns((1.0, 1.0), gj=None, ei_y=None, kga_z=None)}
    )
    F = 1e-4
    assert moved(given, [F, 0.0, 0.0])[0] == pytest.approx(1 + F / 40.0, rel=1e-14)
    bent = F / (3 * 0.9) + F / 25.0
    assert moved(given, [0.0, F, 0.0])[1] == pytest.approx(bent, rel=1e-8)


def test_columns_of_axial_and_shear_rigidity_come_from_csv_files(tmp_path: Path) -> None:
    text = "x [m],EI_z [N m²],EA [kN],kGA_y [N],kGA_z [N],rhoA [kg/m]\n0,9,2,3,4,1\n1,9,2,3,4,1\n"
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    table = fl.Rigidity(file=str(tmp_path / "t.csv"))
    assert (table.ea, table.kga_y, table.kga_z) == ((2e3, 2e3), (3.0, 3.0), (4.0, 4.0))
    for absent in ("ea", "kga_z"):
        with refused(fl.errors.SceneError, "strains-need-a-section"):
            scene().varied({"rigidity.t": of_columns(**{absent: None})})
    with refused(fl.errors.SceneError, "both-given"):
        fl.Rigidity(x=(0.0, 1.0), stiffness=STIFF, mass=CENTRED, ea=(1.0, 1.0))
