"""Springs of rotation vectors: their law to 40 digits, its derivatives, all algorithms, large spatial bending."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpmath import mp
from numpy.lib import recfunctions
from scipy import integrate, optimize

import flexlink as fl
from flexlink.cli.main import main
from flexlink.dynamics import rounding
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.engines import load, load_here
from flexlink.engines.base import ForeignFile
from flexlink.errors import ArgumentError, DataFileError
from flexlink.formats import read_urdf, to_urdf
from flexlink.formats.small_mass import with_small_mass
from flexlink.kernels.forces.rotation_tangent import excess_stiffness
from tests.campaigns.random_code import potential
from tests.conftest import ALUMINIUM, ROOT, SQUARE, chain_of, flexible, make_scene
from tests.matrix.case import close, difference
from tests.support.words import refused, reviewed
from validation.physics.hinge_sweep import order

EPS = np.finfo(float).eps
DAMPED = fl.Damping(ratio=0.02, at_hz=10.0)


def arm(rule: str, folder: Path | None = None, **fields: object) -> fl.Scene:
    """A tapered link with this rule, a link with one spring per angle, and a planar link; all springs have dampers."""
    if rule == "cells of 3":
        assert folder is not None
        path = folder / "cells3.toml"
        text = (
            'about = "a"\nsource = "b"\nalternate_axes = true\nsprings = "rotation"\n[cells]\nhinges = 3\ntip = 8.0\n'
        )
        path.write_text(text, encoding="utf-8")
        rule = str(path)
    upper = flexible("upper", "xyz", 7 if "cells" in rule else 5, lumping=rule, damping=DAMPED, section_tip="thin")
    links = upper, flexible("fore", "xyz", 3, lumping="gauss"), flexible("hand", "z", 3, lumping="lobatto2_rotation")
    thin = msgspec.structs.replace(SQUARE, height=0.8 * SQUARE.height, width=0.9 * SQUARE.width)
    whole = fl.Arm(links=links, materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE, "thin": thin})
    usual = {"initial": fl.InitialState(joint_deg=(0.0,) * 3), "run": fl.RunSettings(step=1e-4)}
    return fl.Scene(name="arm", arm=whole, gravity=(1.0, -9.0, 2.0), **{**usual, **fields})


def state(chain: fl.Chain, size: float = 0.4, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=chain.n) * size, rng.normal(size=chain.n), rng.normal(size=chain.n)


# The law.


GJ, EI = 0.7, (1.0, 3.0)
FORCE = np.array([-2.0, 3.0, 2.5])


def beam(rule: str, hinges: int, tip: float = 1.0) -> fl.Arm:
    """A clamped beam of length 1 whose rigidities taper from GJ and EI to the fraction `tip` of them."""
    E = 1e9
    sections = {
        name: fl.Section(shape="general", area=1e-3, i_y=s * EI[0] / E, i_z=s * EI[1] / E, torsion=s * GJ / E)
        for name, s in (("root", 1.0), ("tip", tip))
    }
    link = fl.Link(
        name="beam", length=1.0, flex="xyz", material="m", section="root", section_tip="tip", segments=hinges + 1,
        lumping=rule, joint=fl.Joint(locked=True),
    )  # fmt: skip
    return fl.Arm(links=(link,), materials={"m": fl.Material(young=E, poisson=-0.5, density=1.0)}, sections=sections)


def cantilever(rule: str, hinges: int, tip: float = 1.0) -> fl.Chain:
    return chain_of(beam(rule, hinges, tip))


@pytest.mark.parametrize("rule", ["gauss_rotation", "lobatto2_rotation"])
@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.05, 0.288, 0.3, 1.0, 1.8, 3.6])
def test_torques_are_the_gradient_of_the_potential_to_40_digits(rule: str, size: float) -> None:
    """This includes tapered cells, and rotations of 0.5 rad, the limit of the series, and 3.6 rad, over half a turn."""
    chain, rng = cantilever(rule, 4, tip=0.5), np.random.default_rng(int(size * 10))
    q = rng.choice([-size, size], chain.n) if size == 0.288 else rng.uniform(-size, size, chain.n)
    if size > np.pi:
        q = np.where(chain.hinges["axis"] == 2, size, 0.1 * q)
    found, bound = fl.elastic_torque(chain, q), rounding.of_elastic_torque(chain, q)
    with mp.workdps(40):
        for k in range(chain.n):

            def along(x: mp.mpf, k: int = k) -> mp.mpf:
                return potential(chain, [mp.mpf(float(angle)) if j != k else x for j, angle in enumerate(q)])

            assert abs(mp.diff(along, mp.mpf(float(q[k]))) - found[k]) <= bound[k]
        V = potential(chain, [mp.mpf(float(angle)) for angle in q])
        assert fl.energy(chain, q, 0 * q).elastic == pytest.approx(float(V), rel=100 * EPS)
    assert (bound <= 1e-11 * np.abs(chain.stiffness).max() * size).all(), "no spring is outside a cell or a triple"


def test_torques_and_stiffness_of_larger_cells_are_derivatives_of_their_energy(tmp_path: Path) -> None:
    chain = fl.lump(arm("cells of 3", tmp_path))
    (q, _, _), zero, I = state(chain), np.zeros(chain.n), np.eye(chain.n)
    torques = [difference(lambda h, e=e: fl.energy(chain, q + h * e, zero).elastic) for e in I]
    close(fl.elastic_torque(chain, q), torques, 1e-11)
    K = stiffness_matrix(chain.with_numbers(gravity=np.zeros(3)), q, zero, np.zeros(6))
    assert np.abs(K - K.T).max() <= 20 * EPS * np.abs(K).max()
    close(K, np.array([difference(lambda h, e=e: fl.elastic_torque(chain, q + h * e)) for e in I]).T, 1e-11)


def test_rotation_springs_are_slack_at_their_rest_angles() -> None:
    """Angles and rotations are measured from the rest angles."""
    chain = cantilever("lobatto2_rotation", 4)
    hinges, rest, q = chain.hinges.copy(), state(chain, seed=2)[0], state(chain)[0]
    hinges["rest"] = rest
    moved = chain.with_numbers(name="moved", hinges=hinges)
    assert not fl.elastic_torque(moved, rest).any()
    bound = rounding.of_elastic_torque(chain, q)
    assert (np.abs(fl.elastic_torque(moved, q + rest) - fl.elastic_torque(chain, q)) <= bound).all()


def test_bending_about_one_axis_gives_the_torques_of_springs_of_angles() -> None:
    for pair in ("gauss", "lobatto2"):
        angles, turned = (
            fl.lump(make_scene(flexible("a", "xyz", 5, lumping=f"{pair}{end}"))) for end in ("", "_rotation")
        )
        for axis in range(3):
            q = np.where(angles.hinges["axis"] == axis, np.random.default_rng(axis).uniform(-1, 1, angles.n), 0.0)
            difference = fl.elastic_torque(turned, q) - fl.elastic_torque(angles, q)
            assert (np.abs(difference) <= rounding.of_elastic_torque(turned, q)).all()


def test_equal_rotations_store_equal_energy_for_any_order_of_axes() -> None:
    """A rotation has other angles about Z, Y, X than about X, Y, Z, so springs of angles would differ by a tenth."""
    chain = cantilever("gauss_rotation", 2)
    first, second = (chain.hinges["axis"][part].tolist() for part in (slice(0, 3), slice(3, 6)))
    assert (first, second) == ([0, 1, 2], [2, 1, 0])
    θ = np.array([0.3, -0.5, 0.4])
    R = functools.reduce(np.matmul, (turn(axis, angle) for axis, angle in zip(first, θ, strict=True)))
    reverse = np.arctan2(R[1, 0], R[0, 0]), -np.arcsin(R[2, 0]), np.arctan2(R[2, 1], R[2, 2])
    assert np.abs(np.array(reverse)[::-1] - θ).max() > 0.1
    one, other = (fl.energy(chain, np.array(q), np.zeros(6)).elastic for q in ([*θ, 0, 0, 0], [0, 0, 0, *reverse]))
    assert one == pytest.approx(other, rel=20 * EPS)


def turn(axis: int, angle: float) -> np.ndarray:
    R, j, k = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j] = np.sin(angle)
    R[j, k] = -R[k, j]
    return R


def test_only_triples_of_three_axes_have_rotation_springs() -> None:
    for flex, wanted in (("z", [0] * 6), ("yz", [0] * 6), ("xyz", [0, 2, 1, 2, 1, 0])):
        cells = fl.lump(make_scene(flexible("a", flex, 5, lumping="lobatto2_rotation")))
        assert cells.bodies["springs"].tolist() == wanted
        assert cells.has_rotation_springs == any(wanted)
        plain = fl.lump(make_scene(flexible("a", flex, 5, lumping="lobatto2")))
        np.testing.assert_array_equal(cells.hinges, plain.hinges)
        np.testing.assert_array_equal(cells.couplings, plain.couplings)


# The algorithms.


@pytest.mark.parametrize("size", [1e-6, 0.3, 0.6, 3.0])
def test_the_derivative_is_exact_at_any_rotation_of_a_triple(size: float) -> None:
    """|φ| is on both sides of 0.5 rad, the limit of the series, and beyond half a turn."""
    chain = cantilever("gauss_rotation", 2)
    q = np.array([0.6, -0.7, 0.5, -0.4, 0.8, 0.3]) * size
    _, hinges, values = excess_stiffness(chain.bodies, chain.hinges, chain.couplings, q)
    K = chain.matrix("stiffness")
    for t in range(2):
        K[np.ix_(hinges[t], hinges[t])] += values[t]
    h = 1e-3
    for k in range(chain.n):
        step = np.eye(chain.n)[k] * h
        torques = [fl.elastic_torque(chain, q + s * step) for s in (-2, -1, 1, 2)]
        wanted = (torques[0] - 8 * torques[1] + 8 * torques[2] - torques[3]) / (12 * h)
        assert np.abs(K[:, k] - wanted).max() <= 1e-10 * np.abs(K).max()


def test_a_run_saved_by_an_older_version_has_springs_of_angles(tmp_path: Path) -> None:
    path = fl.simulate(make_scene(flexible("a")), duration=1e-3).save(tmp_path / "run.npz")
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["chain_bodies"] = recfunctions.drop_fields(arrays["chain_bodies"], "springs")
    np.savez(path, **arrays)
    assert not fl.Trajectory.load(path).chain.has_rotation_springs
    arrays["chain_bodies"] = recfunctions.drop_fields(arrays["chain_bodies"], "mass")
    np.savez(path, **arrays)
    with refused(DataFileError, "not-a-result"):
        fl.Trajectory.load(path)


def test_info_marks_springs_of_rotation_vectors(capsys: pytest.CaptureFixture[str]) -> None:
    changes = ("--set", "link.*.lumping=gauss_rotation", "--set", "link.*.segments=3")
    assert main(["info", str(ROOT / "models" / "t3_spatial.toml"), *changes]) == 0
    lines = capsys.readouterr().out.splitlines()
    marked = [line for line in lines if "N m/rad" in line and "rotation" in line]
    assert len(marked) == 12
    reviewed("rotation springs: a line of info", marked[0])


# Large bending in space.


def skew_fall(rule: str, hinges: int) -> np.ndarray:
    """Tip of a clamped beam, EI_y / EI_z = 4, that falls by its length under an oblique weight of 8.5 EI_y / L³."""
    side, weight = 0.03, 6.0
    I = side * (2 * side) ** 3 / 12 / 4
    link = fl.Link(
        name="beam", length=1.0, flex="xyz", material="m", section="s", segments=hinges + 1, lumping=rule,
        joint=fl.Joint(locked=True),
    )  # fmt: skip
    material = fl.Material(young=1 / I, poisson=0.25, density=1 / (2 * side**2), loss_time=1e-3)
    strip = fl.Section(shape="rectangle", height=side, width=2 * side)
    scene = fl.Scene(
        name="fall", arm=fl.Arm(links=(link,), materials={"m": material}, sections={"s": strip}),
        gravity=(0.0, weight, weight), initial=fl.InitialState(joint_deg=(0.0,)),
        run=fl.RunSettings(method="Radau5", tolerance=1e-6, duration=1.5, sample=0.0375),
    )  # fmt: skip
    return fl.simulate(scene).tip


def test_a_skew_fall_converges_with_order_4_and_gauss_has_a_tenth_of_the_error() -> None:
    reference = skew_fall("lobatto2_rotation", 48)
    assert np.linalg.norm(reference - reference[0], axis=1).max() > 1.0

    def errors(rule: str) -> dict[int, float]:
        return {n: float(np.linalg.norm(skew_fall(rule, n) - reference, axis=1).max()) for n in (4, 8, 16, 32)}

    assert order(errors("lobatto2_rotation")) > 3.5
    assert order(errors("lobatto2")) < 2.1
    angles, turned = errors("gauss"), errors("gauss_rotation")
    assert max(turned[n] / angles[n] for n in angles) <= 1 / 8


@functools.cache
def rod() -> Callable[[float], np.ndarray]:
    """r, R and m along an elastic rod of length 1, clamped along x, under a dead force: m' = F × r', κ = B⁻¹ Rᵀ m."""

    def along(_: float, y: np.ndarray, part: float) -> np.ndarray:
        R, m = y[3:12].reshape(3, 3), y[12:]
        κ = R.T @ m / [GJ, *EI]
        turn = np.array([[0, -κ[2], κ[1]], [κ[2], 0, -κ[0]], [-κ[1], κ[0], 0]])
        x, (u, v, w) = R[:, 0], part * FORCE
        return np.concatenate([x, (R @ turn).ravel(), [v * x[2] - w * x[1], w * x[0] - u * x[2], u * x[1] - v * x[0]]])

    def solution(m: np.ndarray, part: float) -> Any:
        start, within = np.concatenate([np.zeros(3), np.eye(3).ravel(), m]), {"rtol": 1e-12, "atol": 1e-13}
        return integrate.solve_ivp(along, (0, 1), start, args=(part,), method="DOP853", dense_output=True, **within).sol

    m = np.zeros(3)
    for part in np.linspace(0.1, 1.0, 10):
        m = optimize.root(lambda m, part=part: solution(m, part)(1.0)[12:], m, tol=1e-12).x
    return solution(m, 1.0)


def skew_scene(rule: str, hinges: int) -> fl.Scene:
    return fl.Scene(name="skew", arm=beam(rule, hinges), initial=fl.InitialState(joint_deg=(0.0,)), gravity=(0, 0, 0))


def test_a_cantilever_under_a_skew_dead_force_converges_to_the_elastic_rod() -> None:
    """Cells converge with order 4, curvatures with order 2; gauss_rotation has at most 1/8 of the error of gauss."""
    bends: dict[int, float] = {}

    def errors(rule: str, *counts: int) -> dict[int, float]:
        found = {}
        for n in counts:
            scene = skew_scene(rule, n)
            chain = fl.lump(scene)
            q = fl.solve_static(chain, tip_wrench=[*FORCE, 0.0, 0.0, 0.0]).q
            found[n] = float(np.linalg.norm(fl.tip_position(chain, q) - rod()(1.0)[:3]))
            strain = fl.strength.beam_strain(scene, q, link="beam", fibre=(0.0, 0.0))
            κ = [(y := rod()(x))[3:12].reshape(3, 3).T @ y[12:] / [GJ, *EI] for x in strain.x]
            bends[n] = float(np.abs(strain.curvature - κ).max())
        return found

    angles, turned = errors("gauss", 4, 8, 16), errors("gauss_rotation", 4, 8, 16)
    assert max(turned[n] / angles[n] for n in angles) <= 1 / 8
    assert order(errors("lobatto2_rotation", 4, 8, 16, 32)) > 3.8
    assert order({n: bends[n] for n in (8, 16, 32)}) > 1.9


# Files and engines.


@pytest.mark.parametrize("springs", ["0:1", "2:1", "1:3", "1:2", "x"])
def test_a_file_with_rotation_springs_of_other_joints_is_refused(springs: str) -> None:
    chain = fl.lump(arm("lobatto2_rotation"))
    text = to_urdf(chain)
    whole = " ".join(f"{b['first']}:{b['springs']}" for b in chain.bodies if b["springs"])
    with refused(DataFileError, "file-content"):
        read_urdf(text.replace(f'rotation_springs="{whole}"', f'rotation_springs="{springs}"'))


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco", "exudyn", "drake"])
@pytest.mark.parametrize("rule", ["gauss_rotation", "lobatto2_rotation"])
def test_engines_apply_flexlink_torques_of_rotation_springs(engine: str, rule: str) -> None:
    pytest.importorskip({"drake": "pydrake"}.get(engine, engine))
    chain = fl.lump(arm(rule))
    other = load(engine, chain)
    for seed in range(3):
        q, qd, tau = state(chain, seed=seed)
        found = other.elastic_torque(q)
        assert (np.abs(found - fl.elastic_torque(chain, q)) <= rounding.of_elastic_torque(chain, q)).all()
        solutions = other.forward_dynamics(q, qd, tau), fl.forward_dynamics(chain, q, qd, tau)
        start = 1e-6 if engine == "exudyn" else 0.0  # relative; Exudyn's q̈ follow from a time step
        M, size = fl.mass_matrix(chain, q), np.abs(solutions[1]).max()
        bound = rounding.of_residual(chain, q, qd, np.maximum(*map(np.abs, solutions)), tau)
        assert np.abs(M @ (solutions[0] - solutions[1])).max() <= bound + start * np.abs(M).max() * size


def test_a_file_with_rotation_springs_is_refused_without_its_scene(tmp_path: Path) -> None:
    scene = arm("gauss_rotation")
    path = tmp_path / "arm.urdf"
    path.write_text(to_urdf(fl.lump(scene)), encoding="utf-8")
    pytest.importorskip("pinocchio")
    with refused(ArgumentError, "rotation-springs-in-file"):
        load_here("pinocchio", ForeignFile(path, "urdf"))


def test_bodies_between_the_hinges_of_a_triple_are_refused() -> None:
    with refused(ArgumentError, "rotation-springs-in-file"):
        with_small_mass(fl.lump(arm("gauss_rotation")), mass=1e-6)
