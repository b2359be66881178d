"""Other engines compute from exported files the same as flexlink; engines that are not installed are skipped."""

import dataclasses
import importlib.util
import itertools
import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import flexlink as fl
from flexlink.describe.run_settings import steps_explicitly
from flexlink.details import BaseState
from flexlink.diagnosis.quantities import QUANTITIES, mixed_states
from flexlink.dynamics import rounding
from flexlink.engines import ENGINES, load, load_here, mujoco_reader
from flexlink.engines.actuators import not_compared, with_drive
from flexlink.engines.read_back import ReadBack, of_chain, to_chain
from flexlink.errors import ArgumentError, DivergenceError, MissingDependencyError
from flexlink_witnesses import refuse_sampled_inputs
from tests.chain.test_cells import arm as cells
from tests.conftest import MODELS, ROOT, flexible, make_scene, nasty_scene
from tests.formats.test_coupled_files import odd
from tests.formats.test_export import STRANGE_NAMES
from tests.formats.test_reading import odd_chain
from tests.support.beams import satellite
from tests.support.words import refused
from validation.random_arms import random_tree

STATES = 20


PACKAGE = {"drake": "pydrake"}
"""Import name of an engine if it differs from the engine's name."""
METHOD = {"drake": "RK3"}
"""Method for an engine without RK4."""


def engine(name: str, *more: object) -> object:
    """Test parameters for an engine; skipped if it is not installed, and slow if it starts a process."""
    missing = importlib.util.find_spec(PACKAGE.get(name, name)) is None
    marks = [pytest.mark.skipif(missing, reason=f"not run: {name} is not installed")]
    return pytest.param(name, *more, marks=[*marks, pytest.mark.slow] if ENGINES[name].isolated else marks)


every = pytest.mark.parametrize("name", [engine(name) for name in ENGINES if name != "native"])


def shortened(scene: fl.Scene, duration: float, **run: object) -> fl.Scene:
    """The scene with a short duration."""
    return scene.varied({"run.duration": duration} | {f"run.{name}": value for name, value in run.items()})


def driven(**drive: object) -> fl.Scene:
    return make_scene(flexible("arm"), drive=fl.Drive(**drive))


def of_a_tolerance(path: Path) -> dict[str, object]:
    """Step settings for a scene that specifies none; otherwise no settings."""
    return {} if steps_explicitly(fl.load_scene(path).run) else {"method": "RK4", "step": 5e-5, "sample": 0.01}


def of(name: str, scene: fl.Scene) -> fl.Scene:
    """The scene with a method that the engine supports."""
    return scene.varied({"run.method": METHOD.get(name, scene.run.method)})


def rounding_bound(scene: fl.Scene) -> float:
    """Bound for differences of q [rad]: t²/2 times the rounding error of q̈, estimated at every tenth sample."""
    chain = fl.lump(scene)
    t, q, qd = load("native", chain).integrate(scene)
    qdd = np.gradient(qd, t, axis=0)
    tau = np.einsum("tij,tj->ti", fl.mass_matrix(chain, q), qdd)  # an upper limit
    rows = range(0, len(t), 10)
    explained = max(
        rounding.of_acceleration(chain, q[k], qd[k], qdd[k], tau[k], tip_wrench=scene.tip_wrench) for k in rows
    )
    return t[-1] ** 2 / 2 * explained


def gimbals() -> fl.Chain:
    """Massless bodies with offsets and rotations before a flexible link."""
    massless = [
        fl.Link(
            name=f"gimbal {k}", length=0.1 * k, mount=fl.Mount(xyz=(0.1, -0.2, 0.3), rpy_deg=(30.0 * k, 40.0, -50.0))
        )
        for k in range(3)
    ]
    return fl.lump(make_scene(*massless, flexible("arm", "xyz", mount=fl.Mount(rpy_deg=(0.0, 60.0, 10.0)))))


CHAINS: dict[str, Callable[[], fl.Chain]] = {
    **{path.stem: partial(lambda path: fl.lump(fl.load_scene(path)), path) for path in MODELS}, "gimbals": gimbals,
    "every number set": lambda: odd_chain(np.random.default_rng(1)),
    "odd names": lambda: fl.lump(make_scene(*(flexible(name, "yz", 2) for name in STRANGE_NAMES))),
    "cells": lambda: odd(fl.lump(cells("xyz", "lobatto2", 5))), "satellite": lambda: fl.lump(satellite()),
    **{f"tree {seed}": partial(lambda seed: fl.lump(random_tree(seed)), seed) for seed in range(4)},
}  # fmt: skip
"""Chains of all kinds, for comparisons of all terms and numbers with an engine that reads their file."""


@every
@pytest.mark.parametrize("which", CHAINS)
def test_every_term_agrees_with_the_engine_within_rounding(name: str, which: str) -> None:
    chain = CHAINS[which]()
    native, other = load("native", chain), load(name, chain)
    for state, (quantity, term) in itertools.product(mixed_states(chain, STATES), QUANTITIES.items()):
        expected, got = (term.evaluate(engine, state) for engine in (native, other))
        assert term.error(chain, state, got, expected).max() <= 1, quantity
        if quantity == "M":
            assert_array_equal(got, got.T)


EXACT = ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature", "gravity")
"""Numbers that an engine stores as the file states them."""


@every
@pytest.mark.parametrize("which", CHAINS)
def test_the_arm_read_by_an_engine_equals_ours(name: str, which: str) -> None:
    chain = CHAINS[which]()
    ours, theirs = of_chain(chain), load(name, chain).read_back()
    assert theirs.names == ours.names
    same = partial(assert_allclose, rtol=1e-13, atol=1e-13) if ENGINES[name].isolated else assert_array_equal
    for field in ("parents", "slides", *(field for field in EXACT if field not in theirs.unspecified)):
        sprung = field == "rest" and name == "drake"  # which has no rest angle without a spring
        where = ours.stiffness > 0 if sprung else slice(None)
        same(getattr(theirs, field)[where], getattr(ours, field)[where], err_msg=field)
    turns = [k for k in range(chain.n) if not ours.slides[: k + 1].all()]  # bodies that only slide may differ
    assert theirs.inertias[turns] == pytest.approx(ours.inertias[turns], rel=1e-13, abs=1e-13)
    for field in ("axes", "points", "masses", "centers", "tip"):
        assert getattr(theirs, field) == pytest.approx(getattr(ours, field), rel=1e-13, abs=1e-13), field


NOT_FOLLOWED = {(name, case) for name in ("drake", "exudyn") for case in ("computed_torque", "late")}
"""Sampled and held drives, which the integrators of these engines cannot follow: the run is refused by name."""
SHORT = {
    **{path.stem: shortened(fl.load_scene(path), 0.03, **of_a_tolerance(path)) for path in MODELS},
    "nasty": shortened(nasty_scene(), 0.02, step=2e-5, sample=1e-3),
    "wrench": shortened(make_scene(flexible("arm", "xyz"), wrench=fl.Wrench((5, -3, 2), (1, 2, -3))), 0.02, step=2e-5),
    "table": shortened(
        driven(kind="table", times=(0.0, 0.05, 0.1), torques=((0,), (9,), (-9,))), 0.1
    ),
    "late": shortened(
        driven(kind="table", times=(0.0, 0.05, 0.1), torques=((0,), (9,), (-9,)), hold=True), 0.05
    ).varied({"initial.time": 0.03}),
    "pd": shortened(driven(kind="pd", kp=(50,), kd=(5,), target_deg=(30,)), 0.1),
    "coulomb": shortened(
        make_scene(
            flexible("arm", joint=fl.Joint(coulomb=3.0, viscous=0.1)),
            initial=fl.InitialState(joint_deg=(0.0,), rate_deg=(9.0,)),
        ),
        0.1,
    ),
    "cells": cells("xyz", "lobatto2", 3, run=fl.RunSettings(step=5e-6, sample=1e-4, duration=2e-3)).varied(
        {"initial.rate_deg": (100.0, 300.0)}
    ),
    "satellite": satellite().varied({"run.duration": 0.01}),
    "satellite on the ground": satellite().varied(
        {"run.duration": 0.01, "base": fl.Base(), "initial.base": BaseState()}
    ),
}  # fmt: skip


@every
@pytest.mark.parametrize("case", SHORT)
def test_short_trajectories_differ_by_rounding_only(name: str, case: str) -> None:
    scene = of(name, SHORT[case])
    chain = fl.lump(scene)
    other = load(name, chain)
    if (name, case) in NOT_FOLLOWED:
        with refused(ArgumentError, "engine-does-not-support") as caught:
            other.integrate(scene)
        assert all(engine in str(caught.value) for engine in ("native", "pinocchio", "mujoco"))
        return
    t, q, _ = load("native", chain).integrate(scene)
    t2, q2, _ = other.integrate(scene)
    bound = rounding_bound(scene)
    assert bound < 1e-6 < np.abs(q - q[0]).max()  # the arm moves by much more than the bound
    assert_array_equal(t2, t)
    assert_allclose(q2, q, rtol=0, atol=bound)


@pytest.mark.parametrize(
    ("name", "method", "step"),
    [
        engine("pinocchio", "RK2", 5e-6),
        engine("pinocchio", "RK10", 1e-4),
        engine("exudyn", "RK2", 5e-6),
        engine("drake", "DOPRI5", 5e-5),
    ],
)
def test_other_methods_give_the_same_motion(name: str, method: str, step: float) -> None:
    scene = shortened(fl.load_scene(ROOT / "models" / "paper_fig5.toml"), 0.02, method=method, step=step)
    (_, q, _), (_, other, _) = (load(each, fl.lump(scene)).integrate(scene) for each in ("native", name))
    assert_allclose(other, q, rtol=0, atol=rounding_bound(scene))


@pytest.mark.parametrize(
    ("name", "methods"),
    [engine("mujoco", ("RK4",)), engine("exudyn", ("RK2", "RK4")), engine("drake", ("RK3", "DOPRI5"))],
)
def test_the_refusal_of_a_method_lists_the_methods_of_the_engine(name: str, methods: tuple[str, ...]) -> None:
    scene = shortened(make_scene(flexible("arm")), 0.01, method="RK10")
    with refused(ArgumentError, "engine-method") as caught:
        load(name, fl.lump(scene)).integrate(scene)
    assert re.findall(r"'(RK\d|DOPRI\d)'", str(caught.value)) == [*methods]


@every
def test_a_step_above_the_largest_stable_one_is_refused(name: str) -> None:
    scene = of(name, shortened(fl.load_scene(ROOT / "models" / "paper_fig5.toml"), 0.5, step=1e-3, sample=1e-3))
    chain, method = fl.lump(scene), scene.run.method
    fl.stable_step(chain, fl.initial_state(scene, chain)[0], method=method)
    with refused(fl.FlexlinkError, "unstable-step"):
        load(name, chain).integrate(scene)


STEPS = 40


def torn(late: float, samples: int = STEPS) -> fl.Scene:
    """An arm whose drive makes the run diverge within the last `late` of 40 steps."""
    h = 1e-4
    end = STEPS * h
    scene = driven(kind="table", times=(0.0, end - late * h, end), torques=((0.0,), (0.0,), (1e303,)))
    return shortened(scene, end, step=h, sample=end / samples)


@every
def test_a_run_that_diverges_is_an_error_that_keeps_its_samples_and_writes_no_file(name, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    scene = of(name, torn(late=20))
    with refused(DivergenceError, "diverged") as caught:
        load(name, fl.lump(scene)).integrate(scene)
    kept = caught.value.trajectory
    assert 20 <= len(kept.t) < 40 and np.isfinite(kept.q).all() and np.isfinite(kept.qd).all()
    assert list(tmp_path.iterdir()) == []


@every
@pytest.mark.parametrize("samples", [1, STEPS])
def test_a_state_that_diverges_in_the_last_step_is_not_a_sample(name: str, samples: int) -> None:
    scene = of(name, torn(late=1, samples=samples))
    with refused(DivergenceError, "diverged") as caught:
        load(name, fl.lump(scene)).integrate(scene)
    kept = caught.value.trajectory
    assert len(kept.t) == samples and np.isfinite(kept.q).all() and np.isfinite(kept.qd).all()


def moved(*links: fl.Link) -> fl.Scene:
    """An arm whose first joint follows a prescribed motion from 0° to 60° in 0.1 s, and then rests."""
    motion = fl.PrescribedMotion(
        link="upper", times=(0.0, 0.1), angle_deg=(0.0, 60.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    return shortened(make_scene(*links, motion=(motion,), wrench=fl.Wrench((5, -3, 2), (1, 2, -3))), 0.15, step=5e-5)


ELBOW = fl.Mount(rpy_deg=(40.0, 0.0, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize(("flex", "method"), [("z", "RK4"), ("xyz", "RK10")])
def test_pinocchio_moves_a_prescribed_joint_like_flexlink(flex: str, method: str) -> None:
    scene = moved(flexible("upper", flex, 3, mount=ELBOW), flexible("fore", "z", 3, joint=fl.Joint(viscous=0.5)))
    scene = shortened(scene, 0.15, method=method, step=1e-4)
    (t, q, qd), (_, q2, qd2) = (load(name, fl.lump(scene)).integrate(scene) for name in ("native", "pinocchio"))
    assert np.degrees(q2[t >= 0.1, 0]) == pytest.approx(60.0, abs=1e-12)
    assert_array_equal(q2[:, 0], q[:, 0])
    assert_array_equal(qd2[:, 0], qd[:, 0])
    assert_allclose(q2, q, rtol=0, atol=rounding_bound(scene))
    assert np.abs(q[:, 1:]).max() > 0.01


def test_pinocchio_shows_the_angle_and_the_rate_of_a_prescribed_joint_at_every_sample() -> None:
    """From rest to rest, the angle is 60° (10 s³ − 15 s⁴ + 6 s⁵) with s = t / 0.1 s."""
    scene = moved(fl.Link(name="upper", length=1.0), flexible("fore"))
    scene = shortened(scene, 0.15, step=5e-4, sample=0.01)
    t, q, qd = load("pinocchio", fl.lump(scene)).integrate(scene)
    s = np.minimum(t / 0.1, 1.0)
    assert_allclose(q[:, 0], np.pi / 3 * (10 * s**3 - 15 * s**4 + 6 * s**5), rtol=0, atol=1e-12)
    assert_allclose(qd[:, 0], np.pi / 3 * 30 * (s * (1 - s)) ** 2 / 0.1, rtol=0, atol=1e-10)


def test_pinocchio_keeps_a_prescribed_joint_at_a_constant_rate() -> None:
    chain = fl.lump(moved(flexible("upper", "xyz", 3, mount=ELBOW), flexible("fore")))
    native, other = load("native", chain), load("pinocchio", chain)
    for q, qd, tau, wrench, _ in mixed_states(chain, 5):
        solutions = (
            other.forward_dynamics(q, qd, tau, tip_wrench=wrench),
            native.forward_dynamics(q, qd, tau, tip_wrench=wrench),
        )
        assert solutions[0][0] == solutions[1][0] == 0
        error = rounding.acceleration_error(chain, q, qd, tau, solutions=solutions, tip_wrench=wrench)
        assert error[1:].max() <= 1


@pytest.mark.parametrize(
    ("name", "title"), [engine("mujoco", "MuJoCo"), engine("exudyn", "Exudyn"), engine("drake", "Drake")]
)
def test_engines_without_prescribed_joints_refuse_scenes_with_them(name: str, title: str) -> None:
    scene = moved(flexible("upper"))
    with refused(ArgumentError, "engine-does-not-support"):
        load(name, fl.lump(scene))
    free = fl.lump(scene.varied({"motion": ()}))
    with refused(ArgumentError, "engine-does-not-support"):
        load(name, free).integrate(scene)


def test_a_run_in_mujoco_restores_the_callbacks_of_the_user() -> None:
    def mine(model: object, data: object) -> None:
        """A callback of the user."""

    scene = SHORT["coulomb"]
    torn_apart = torn(late=20)
    engine = load("mujoco", fl.lump(scene))
    mujoco.set_mjcb_passive(mine)
    try:
        engine.integrate(scene)
        assert mujoco.get_mjcb_passive() is mine
        with pytest.raises(DivergenceError):
            engine.integrate(torn_apart)
        assert mujoco.get_mjcb_passive() is mine
        assert mujoco.get_mjcb_control() is None
    finally:
        mujoco.set_mjcb_passive(None)


@every
def test_evaluations_between_two_runs_do_not_affect_an_engine(name: str) -> None:
    scene = of(name, SHORT["wrench"])
    engine = load(name, fl.lump(scene))
    zero = np.zeros(engine.n)
    before, first = engine.forward_dynamics(zero, zero, zero), engine.integrate(scene)
    assert_array_equal(engine.forward_dynamics(zero, zero, zero), before)
    for one, two in zip(first, engine.integrate(scene), strict=True):
        assert_array_equal(one, two)


def test_an_unknown_engine_is_refused_with_a_list_of_known_engines() -> None:
    with refused(ArgumentError, "unknown-name"):
        load("bullet", fl.lump(make_scene(flexible("arm"))))


@pytest.mark.parametrize("name", [name for name, adapter in ENGINES.items() if adapter.extra])
def test_the_error_of_a_missing_engine_names_what_to_install(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    package = PACKAGE.get(name, name)
    for module in [known for known in sys.modules if known.startswith(f"{package}.")]:  # from earlier tests
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, ENGINES[name].module, raising=False)
    with refused(MissingDependencyError, "package-missing"):
        load_here(name, fl.lump(make_scene(flexible("arm"))))


@pytest.mark.parametrize("settings", [{"run.method": "Gauss4"}, {"run.tolerance": 1e-4}])
def test_engines_accept_only_fixed_steps_of_explicit_methods(settings: dict[str, object]) -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"run.duration": 0.01} | settings)
    for name in ("pinocchio", "mujoco"):
        with refused(ArgumentError, "engine-method"):
            load(name, fl.lump(scene)).integrate(scene)


def test_pinocchio_refuses_a_chain_whose_data_would_fill_the_memory() -> None:
    chain = fl.lump(make_scene(flexible("boom", "z", 700)))
    with refused(ArgumentError, "too-many-joints"):
        load("pinocchio", chain)


def test_engines_with_their_own_stepping_support_only_smooth_pd_references() -> None:
    """The other laws need torques between samples, which such an engine cannot receive."""

    def scene(kind: str, jumps: list[float]) -> Any:
        drive = SimpleNamespace(hold=False, rate=None, kind=kind)
        return SimpleNamespace(drive=drive, wrench=SimpleNamespace(hold=False), initial=SimpleNamespace(time=0.0),
                               course=SimpleNamespace(jumps=np.array(jumps)))  # fmt: skip

    refuse_sampled_inputs("exudyn", scene("pd", []))
    for kind, jumps in (("computed_torque", []), ("pd", [0.5])):
        with refused(ArgumentError, "engine-does-not-support"):
            refuse_sampled_inputs("exudyn", scene(kind, jumps))


def test_a_mujoco_servo_control_is_divided_by_its_gear_ratio() -> None:
    """A servo, kp (u − r q) r − kv r² q̇, moves its joint to q = u / r, so `gear` is 1/r; for a motor it is the ratio r.

    The range of controls u limits the torque of a motor, r u, and not that of a servo. A general actuator exerts
    r (5 u + 7 − 11 r q − 13 r q̇), so that q = 5 u / (11 r).
    """
    body = '<body><joint name="{0}"/><geom type="box" size=".1 .1 .1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{''.join(map(body.format, 'abc'))}</worldbody><actuator>"
        '<position joint="a" kp="30" kv="3" gear="4" ctrlrange="-0.1 0.1" forcerange="-5 6"/>'
        '<motor joint="b" gear="-7" ctrlrange="0 3"/>'
        '<general joint="c" gear="2" gainprm="5" biastype="affine" biasprm="7 -11 -13"/></actuator></mujoco>'
    )
    fields = mujoco_reader.at_joints(model)
    np.testing.assert_allclose(fields["gear"], [1 / 4, -7.0, 5 / 22], rtol=1e-12)
    np.testing.assert_allclose(fields["effort"], [[-20.0, 24.0], [-21.0, 0.0], [-np.inf, np.inf]], rtol=1e-12)
    np.testing.assert_allclose(fields["servo_stiffness"], [16 * 30.0, 0.0, 4 * 11.0], rtol=1e-12)
    np.testing.assert_allclose(fields["servo_damping"], [16 * 3.0, 0.0, 4 * 13.0], rtol=1e-12)
    np.testing.assert_allclose(fields["constant_torque"], [0.0, 0.0, 2 * 7.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("drive", "least", "most"),
    [
        ({"kind": "constant", "torque": (3.0,)}, 0.0, 3.0),
        ({"kind": "constant", "torque": (-3.0,)}, -3.0, 0.0),
        ({"kind": "table", "times": (0.0, 1.0), "torques": ((2.0,), (4.0,))}, 0.0, 4.0),
        ({"kind": "table", "times": (0.0, 1.0), "torques": ((-2.0,), (4.0,))}, -2.0, 4.0),
        ({"kind": "table", "times": (0.0, 1.0), "torques": ((2.0,), (4.0,)), "smooth": True}, -np.inf, np.inf),
        ({"kind": "pd", "kp": (50.0,), "kd": (5.0,), "target_deg": (30.0,)}, -np.inf, np.inf),
    ],
)
def test_the_range_of_commanded_torques_includes_zero(drive: dict[str, Any], least: float, most: float) -> None:
    """A limit that excludes 0 changes the torque of a motor without a command; springs have no range."""
    scene = driven(**drive)
    chain = fl.lump(scene)
    expected = np.zeros((chain.n, 2))
    expected[chain.active] = least, most
    assert_array_equal(with_drive(of_chain(chain), scene, chain).drive_range, expected)


def three(order: list[int], bodies: list[int] | None = None) -> tuple[ReadBack, ReadBack]:
    """Records of three rigid links a, b and c, and of the same with its joints in another order."""
    bodies_of = {name: fl.RigidBody(mass=1.0, inertia=(size,) * 3) for size, name in enumerate("abc", 1)}
    links = (fl.Link(name=name, hub=body) for name, body in bodies_of.items())
    ours = with_drive(read := of_chain(chain := fl.lump(make_scene(*links))), None, chain)
    return ours, read.in_order(np.array(order), None if bodies is None else np.array(bodies))


@pytest.mark.parametrize("bodies", [None, [2, 0, 1]])
def test_single_bodies_follow_what_they_are_merged_to_into_another_order(bodies: list[int] | None) -> None:
    """Each joint moves a single body, and the order is not its own inverse."""
    _, moved = three([1, 2, 0], bodies)
    assert_array_equal(moved.inertias[moved.parts.owner], moved.parts.inertias)
    assert (moved.names, moved.parents.tolist()) == (("b", "c", "a"), [2, 0, -1])


def test_actuators_that_are_not_compared_are_listed_with_the_numbers_of_their_joint() -> None:
    ours, read = three([1, 2, 0])
    read = dataclasses.replace(read, gear=np.array([20.0, 30.0, 10.0]), effort=np.outer([2.0, 3.0, 1.0], [-1, 1]))
    found = re.findall(r"'(\w)' \((?:gear |±)(\d+)", not_compared(ours, read, np.array([2, 0, 1])))
    assert found == [("a", "10"), ("b", "20"), ("c", "30"), ("a", "1"), ("b", "2"), ("c", "3")]


def test_joints_of_mujoco_with_a_limit_at_either_end_count_as_limited() -> None:
    body, ends = '<body><joint range="{0}"/><geom size="1"/></body>', ("-1 1", "-1e9 1", "-1 1e9", "-1e9 1e9", "0 0")
    bodies = "".join(map(body.format, ends))
    text = f'<mujoco><compiler angle="radian"/><worldbody>{bodies}</worldbody></mujoco>'
    assert mujoco_reader.read(mujoco.MjModel.from_xml_string(text)).settings["limits"] == "3 joints"


@pytest.mark.parametrize("which", CHAINS)
def test_a_record_is_converted_back_to_its_chain(which: str) -> None:
    chain = CHAINS[which]()
    again = to_chain(of_chain(chain), chain)
    for field in ("stiffness", "damping"):
        assert (again.matrix(field) == chain.matrix(field)).all()
    for q, qd, _, wrench, _ in mixed_states(chain, 4):
        M, bias = fl.mass_matrix(chain, q), fl.bias_torque(chain, q, qd, tip_wrench=wrench)
        assert fl.mass_matrix(again, q) == pytest.approx(M, abs=1e-13 * np.abs(M).max())
        found = fl.bias_torque(again, q, qd, tip_wrench=wrench)
        assert found == pytest.approx(bias, abs=1e-11 * np.abs(bias).max())
    # a record has axes of joints only
    assert_array_equal(again.described["link"], np.tile(np.eye(3), (len(again.bodies), 1, 1)))
