"""Shortcuts in the first run of a scene give the results of the full computation."""

import itertools
from pathlib import Path

import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink.chain import builder, size
from flexlink.chain.coordinates import Kind
from flexlink.data.documents import is_finite
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.dynamics.vibration import stability
from flexlink.dynamics.vibration.stability_function import stable_reach
from flexlink.motion import method_steps
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.inputs.problem import problem_of
from tests.conftest import flexible, make_scene

CHAINS = sorted((Path(__file__).parents[1] / "matrix" / "chains").glob("*.toml"))
ARMS = [path for path in CHAINS if not fl.load_scene(path).tie]
EVERY_ARM = pytest.mark.parametrize("arm", ARMS, ids=lambda path: path.stem)


@EVERY_ARM
def test_joints_without_a_lever_arm_equal_those_found_from_a_posture(arm: Path, monkeypatch) -> None:
    scene = fl.load_scene(arm)
    quick = fl.lump(scene)._without_lever
    monkeypatch.setattr(size, "_offset_of_next", lambda *_: 0.0)
    chain = fl.lump(scene.varied({"name": "anew"}))
    assert list(quick) == list(chain._without_lever)


@EVERY_ARM
def test_an_arm_is_planar_if_all_its_axes_are_parallel(arm: Path) -> None:
    chain = fl.lump(fl.load_scene(arm))
    parallel = chain.is_serial_revolute and chain.all_axes_parallel_to(chain.axes[0])
    assert chain.is_planar == parallel


@EVERY_ARM
def test_skipping_products_with_identities_gives_bit_equal_frames(arm: Path, monkeypatch) -> None:
    scene = fl.load_scene(arm)
    chain = fl.lump(scene)
    monkeypatch.setattr(builder, "_is_one", lambda _: False)
    links = tuple(msgspec.structs.replace(link) for link in scene.arm.links)  # copies without cached frames
    again = fl.lump(msgspec.structs.replace(scene, arm=msgspec.structs.replace(scene.arm, links=links)))
    for name in ("bodies", "hinges", "couplings"):
        assert getattr(chain, name).tobytes() == getattr(again, name).tobytes()


@EVERY_ARM
def test_no_eigenvalue_exceeds_the_bound(arm: Path, rng: np.random.Generator) -> None:
    problem = problem_of(fl.load_scene(arm))
    chain = problem.chain
    bend = np.where(
        [c.kind is Kind.STRAIN for c in chain.coordinates], 1e-3, 0.1
    )  # m in slides of beams, rad in hinges
    for q, qd in ((problem.q, problem.qd), (problem.q + bend * rng.normal(size=chain.n), rng.normal(size=chain.n))):
        acting = acting_at(problem.inputs, chain, 0.0, q, qd)
        (bound,) = stability.eigenvalue_bounds([(chain, q, qd)], [acting])
        assert bound >= (1 - 1e-9) * np.abs(stability.eigenvalues(chain, q, qd, **acting)).max()


def test_the_bound_covers_the_pendulum_modes_of_a_hanging_arm() -> None:
    """The links are rigid, so gravity alone makes them oscillate."""
    chain = fl.lump(
        make_scene(
            *(fl.Link(name=name, length=1.0, end=fl.RigidBody(mass=1.0)) for name in "ab"), gravity=(9.81, 0.0, 0.0)
        )
    )
    zero = np.zeros(2)
    acting = {"tip_wrench": np.zeros(6), "frame": "world", "gains": stability.Gains(zero, zero)}
    fastest = np.abs(stability.eigenvalues(chain, zero)).max()
    assert fastest > np.sqrt(9.81)
    assert stability.eigenvalue_bounds([(chain, zero, zero)], [acting])[0] >= fastest


def test_a_wheel_on_one_of_two_arms_has_no_lever_arm() -> None:
    arm = fl.Link(name="arm", length=1.0, hub=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1)))
    wheel = fl.Link(name="wheel", hub=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.2)))
    other = fl.Link(name="other", on="arm", mount=fl.Mount(xyz=(0.0, 1.0, 0.0)), length=1.0, hub=arm.hub)
    chain = fl.lump(make_scene(arm, wheel, other))
    assert list(chain._without_lever) == [1]


@pytest.mark.parametrize("damping", [0.0, 0.5, 50.0])
@pytest.mark.parametrize("young", [2e9, 70e9])
def test_the_stable_step_does_not_matter_if_samples_limit_the_step(damping: float, young: float, monkeypatch) -> None:
    """DOP853 runs that skip computing the longest stable step are bit-equal to runs that compute it."""
    material = fl.Material(young=young, density=2700.0, loss_time=1e-5)
    scene = make_scene(flexible("a", segments=3, joint=fl.Joint(viscous=damping)), gravity=(0.0, -9.81, 0.0)).varied(
        {"material.aluminium": material, "run": fl.RunSettings(method="DOP853", tolerance=1e-5, duration=0.2)}
    )
    looked: list[bool] = []
    matters = method_steps._matters

    def counted(*given: object) -> bool:
        looked.append(matters(*given))  # type: ignore[arg-type]
        return looked[-1]

    monkeypatch.setattr(method_steps, "_matters", counted)
    quick = fl.simulate(scene.varied({"name": "quick"}))
    assert looked
    monkeypatch.setattr(method_steps, "_matters", lambda *_: True)
    slow = fl.simulate(scene.varied({"name": "slow"}))
    assert quick.q.tobytes() == slow.q.tobytes()
    assert quick.steps == slow.steps


@pytest.mark.parametrize("name", ["RK4", "RK10", "DOPRI5", "DOP853"])
def test_the_stable_step_is_the_smallest_over_single_eigenvalues(name: str, rng: np.random.Generator) -> None:
    for count in (1, 3, 8):
        λ = -rng.exponential(3.0, count) + 10j * rng.normal(size=count)
        λ = np.concatenate([λ, λ.conj()])
        directions = λ.real / np.abs(λ) + 1j * np.abs(λ.imag) / np.abs(λ)
        each = stable_reach(method(name), directions) / np.abs(λ)
        assert stability.stable_step_of(λ, name) == pytest.approx(each.min(), rel=1e-12)


def test_a_batch_of_attitudes_equals_single_conversions(rng: np.random.Generator) -> None:
    base = FloatingBase(fl.lump(fl.load_scene(Path(__file__).parents[2] / "models" / "satellite.toml")))
    q, qd = rng.uniform(-1, 1, size=(2, 7, base.chain.n))
    found = base.from_the_start(q, qd)
    each = [base.relative_to_start(*state) for state in zip(q, qd, strict=True)]
    for one, many in zip(zip(*each, strict=True), found, strict=False):
        assert np.array(one).tobytes() == many.tobytes()
    np.testing.assert_allclose(found[0], q, atol=1e-14)
    np.testing.assert_allclose(found[1], qd, rtol=1e-12)


@pytest.mark.parametrize("degree", [1, 3, 5, 6])
def test_extremes_of_a_reference_are_found_inside_pieces_and_at_their_ends(degree: int, rng) -> None:
    for _ in range(50):
        knots = np.cumsum(rng.uniform(0.5, 1.5, 4))
        c = rng.normal(size=(4, degree + 1, 2)) * (rng.random((4, degree + 1, 2)) < 0.7)
        c[[0, -1], 1:] = 0.0
        course = ReferenceTrajectory(knots, c)
        pieces = [np.linspace(a, np.nextafter(b, a), 2000) for a, b in itertools.pairwise(knots)]
        seen = course(np.concatenate([*pieces, knots[-1:] + 1.0]))[0]
        low, high = course.extremes()
        near = 1e-4 * np.abs(seen).max()
        assert (np.abs(low - seen.min(axis=0)) < near).all()
        assert (np.abs(high - seen.max(axis=0)) < near).all()


def test_a_document_is_finite_only_if_all_its_numbers_are() -> None:
    assert is_finite({"a": [1.0, {"b": 2}], "name": "nan"})
    for number in (np.nan, np.inf, -np.inf):
        assert not is_finite({"a": [1.0, {"b": number}]})
    assert not is_finite({"name": "null"}), "a text that may hide a null is checked number by number"
    assert not is_finite({"a": {1.0 + 2.0j}})
