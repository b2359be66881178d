"""Arguments of public functions: wrong types are named in one line, and NumPy numbers are accepted."""

import functools
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.diagnosis.comparison import compare
from flexlink.dynamics.notes import notes
from flexlink.engines import load
from tests.conftest import MODELS, flexible, make_scene
from tests.support.words import refused, reviewed


@functools.cache
def scene() -> fl.Scene:
    upper = flexible("upper", "xyz", 3, mount=fl.Mount(rpy_deg=(-90.0, 0.0, 0.0)))
    return make_scene(fl.Link(name="waist"), upper, run=fl.RunSettings(step=2.5e-5, duration=0.005))


@functools.cache
def chain() -> fl.Chain:
    return fl.lump(scene())


@functools.cache
def run() -> fl.Trajectory:
    return fl.simulate(scene())


class Unprintable:
    def __repr__(self) -> str:
        raise RuntimeError("no words for it")


WRONG = {
    "nothing": None,
    "number": 3.5,
    "text": "waist",
    "bytes": b"waist",
    "class": fl.RunSettings,
    "array": np.array(["a"]),
    "object": Unprintable(),
    "none in a 0-d array": np.array(None),
    "array of rows": np.ones((2, 2, 2)),
}
"""Values that no argument in `CALLS` accepts, except as listed in `FITS`."""

ZERO = np.zeros(10)
CALLS: dict[str, tuple[Callable[..., object], dict[str, object]]] = {
    "inverse_dynamics": (fl.inverse_dynamics, {"chain": chain, "q": ZERO, "qd": ZERO, "qdd": ZERO}),
    "bias_torque": (fl.bias_torque, {"chain": chain, "q": ZERO, "qd": ZERO}),
    "gravity_torque": (fl.gravity_torque, {"chain": chain, "q": ZERO}),
    "elastic_torque": (fl.elastic_torque, {"chain": chain, "q": ZERO}),
    "friction_torque": (fl.friction_torque, {"chain": chain, "qd": ZERO}),
    "mass_matrix": (fl.mass_matrix, {"chain": chain, "q": ZERO, "algorithm": "lower"}),
    "forward_dynamics": (fl.forward_dynamics, {"chain": chain, "q": ZERO, "qd": ZERO, "tau": ZERO, "solver": "lu"}),
    "energy": (fl.energy, {"chain": chain, "q": ZERO, "qd": ZERO}),
    "frames": (fl.frames, {"chain": chain, "q": ZERO}),
    "tip_position": (fl.tip_position, {"chain": chain, "q": ZERO}),
    "modes": (fl.modes, {"chain": chain, "frame": "world"}),
    "natural_frequencies": (fl.natural_frequencies, {"chain": chain, "frame": "world"}),
    "solve_static": (fl.solve_static, {"chain": chain, "frame": "world", "tolerance": 1e-9}),
    "buckling_loads": (fl.strength.buckling_loads, {"chain": chain}),
    "stable_step": (fl.stable_step, {"chain": chain, "method": "RK4"}),
    "lump": (fl.lump, {"scene": scene()}),
    "load_scene": (fl.load_scene, {"path": MODELS[0]}),
    "to_urdf": (fl.to_urdf, {"chain": chain}),
    "to_mjcf": (fl.to_mjcf, {"chain": chain}),
    "to_sdf": (fl.to_sdf, {"chain": chain}),
    "simulate": (fl.simulate, {"scene": scene(), "progress": None, "method": "RK4", "step": 1e-4, "duration": 0.005}),
    "simulate_many": (fl.simulate_many, {"scenes": [scene()], "threads": 1}),
    "compare": (compare, {"scene": scene(), "engines": ["native"], "samples": 1, "seed": 0}),
    "load": (load, {"name": "native", "chain": chain}),
    "notes": (notes, {"scene": scene()}),
    "index": (lambda **k: chain().index(**k), {"link": 1, "segment": 0, "axis": 0}),
    "coordinate": (lambda **k: chain().coordinate(**k), {"k": 0}),
    "joint_name": (lambda **k: chain().joint_name(**k), {"k": 0}),
    "same_layout": (lambda **k: chain().same_layout(**k), {"other": chain}),
    "number": (scene().arm.number, {"link": "waist"}),
    "initial_state": (fl.initial_state, {"scene": scene(), "chain": chain}),
}
FITS = {
    ("load_scene", "path", "text"), ("number", "link", "text"),
    ("index", "link", "text"), ("coordinate", "k", "text"), ("joint_name", "k", "text"),
    ("solve_static", "tolerance", "number"),
    ("simulate", "method", "nothing"), ("simulate", "step", "nothing"), ("simulate", "duration", "nothing"),
    ("simulate", "step", "number"), ("simulate", "step", "none in a 0-d array"), ("simulate", "progress", "nothing"),
    ("simulate", "progress", "class"), ("simulate", "duration", "number"), ("compare", "engines", "nothing"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "argument"), [(name, key) for name, (_, keys) in CALLS.items() for key in keys])
def test_an_argument_of_the_wrong_type_is_refused_in_one_line(call: str, argument: str) -> None:
    function, good = CALLS[call]
    arguments = {key: value() if value is chain else value for key, value in good.items()}
    for kind, wrong in WRONG.items():
        if (call, argument, kind) in FITS:
            continue
        with pytest.raises((fl.errors.ArgumentError, fl.errors.SceneError)) as caught:
            function(**(arguments | {argument: wrong}))
        assert "\n" not in str(caught.value), kind
        assert len(str(caught.value)) < 300, kind


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        (lambda: fl.simulate(None), "scene = None"),
        (lambda: fl.simulate(scene(), progress=5), "progress = 5"),
        (lambda: fl.simulate_many(scene()), "scenes = .*Scene.*"),
        (lambda: fl.simulate_many([scene(), 1]), r"scenes\[1\] = 1"),
        (lambda: fl.simulate_many([scene()], threads="2"), "threads = '2'"),
        (lambda: fl.simulate_many([scene()], threads=0), "threads = 0"),
        (lambda: fl.simulate_many([scene()], threads=True), "threads = True"),
        (lambda: fl.lump(scene().arm), "scene = <Arm.*"),
        (lambda: fl.initial_state(scene(), scene()), "chain = <Scene.*"),
        (lambda: fl.load_scene(5), "path = 5"),
        (lambda: fl.solve_static(chain(), tolerance=0.0), "tolerance = 0.0"),
        (lambda: fl.solve_static(chain(), tolerance=10**400), "tolerance = 1000.*"),
        (lambda: fl.modes(chain(), frame="no"), "frame = 'no'"),
        (lambda: chain().index(3, 0, 0), r"link = 3"),
        (lambda: fl.forward_dynamics([chain()], ZERO, ZERO, ZERO), "q, qd, tau"),
        (lambda: fl.mass_matrix(chain(), ZERO[: chain().n], algorithm="uper"), "algorithm = 'uper'.*'upper'"),
    ],
)
def test_errors_name_the_argument_its_value_and_the_allowed_values(call: Callable[[], object], wanted: str) -> None:
    with pytest.raises(fl.errors.ArgumentError, match=f"^{wanted}") as caught:
        call()
    reviewed(f"arguments: {caught.value.id}", str(caught.value))


BEYOND = 10**400
"""An integer beyond the range of float64."""


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        (lambda: run().settling_time(target=(0, 0, 0), tolerance=1e-3, after=BEYOND), "wrong-type"),
        (lambda: run().settling_time(target=(0, 0, BEYOND), tolerance=1e-3), "wrong-type"),
        (lambda: run().residual_vibration(after=-BEYOND), "wrong-type"),
        (lambda: fl.advise(scene(), BEYOND), "wrong-type"),
        (lambda: ReferenceTrajectory([0.0], [[[BEYOND]]]), "wrong-type"),
        (lambda: ReferenceTrajectory([0.0], [[[0.0]]])(BEYOND), "wrong-type"),
        (lambda: ReferenceTrajectory([0.0], [[[0.0]]])("a"), "wrong-type"),
        (lambda: ReferenceTrajectory([0.0], [[[0.0]]]).shaped([BEYOND], [1.0]), "wrong-type"),
        (lambda: ReferenceTrajectory([0.0], [[[0.0]]]).delayed(BEYOND), "wrong-type"),
    ],
)
def test_an_integer_beyond_float64_is_refused_by_name(call: Callable[[], object], wanted: str) -> None:
    with refused(fl.errors.ArgumentError, wanted):
        call()


def test_scene_descriptions_accept_numpy_numbers() -> None:
    f, i = np.float64, np.int64
    link = fl.Link(
        name=np.str_("a"), length=f(1.25), flex="z", segments=i(5), lumping="paper", material="m", section="s",
        joint=fl.Joint(locked=np.bool_(False), viscous=np.float32(0.5)), mount={"xyz": (f(1), np.array(2.0), i(3))},
    )  # fmt: skip
    plain = fl.Link(
        name="a", length=1.25, flex="z", segments=5, lumping="paper", material="m", section="s",
        joint=fl.Joint(viscous=0.5), mount=fl.Mount(xyz=(1.0, 2.0, 3.0)),
    )  # fmt: skip
    assert link == plain
    assert type(link.length) is float
    assert type(link.segments) is int
    angles = np.radians([30.0, 45.0])
    assert fl.InitialState(joint_deg=tuple(np.degrees(angles))).joint_deg == tuple(np.degrees(angles).tolist())
    assert fl.RunSettings(step=np.array(1e-4), sample=f(0.005)) == fl.RunSettings(step=1e-4, sample=0.005)
    assert fl.Material(young=np.linspace(1.0, 2.0, 3)[1], density=np.longdouble(2)) == fl.Material(young=1.5, density=2)
    table = fl.Drive(kind="table", times=np.arange(2), torques=np.ones((2, 1)))
    assert table == fl.Drive(kind="table", times=(0, 1), torques=((1,), (1,)))


def test_scene_descriptions_accept_numpy_arrays_as_sequences() -> None:
    ones = np.ones(3)
    assert fl.InitialState(joint_deg=np.array([1, 2]), rate_deg=ones[:2]).joint_deg == (1.0, 2.0)
    assert fl.RigidBody(mass=np.float32(1), inertia=ones) == fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    assert fl.Wrench(force=ones, moment=2 * ones) == fl.Wrench(force=(1, 1, 1), moment=(2, 2, 2))
    names = np.array(["a"])
    motion = fl.PrescribedMotion(
        link=names[0], times=ones[:1] - 1, angle_deg=ones[:1], rate_deg=ones[:1], acceleration_deg=ones[:1]
    )
    assert motion == fl.PrescribedMotion(link="a", times=(0,), angle_deg=(1,), rate_deg=(1,), acceleration_deg=(1,))
    assert make_scene(fl.Link(name="a"), gravity=-9.81 * ones).gravity == (-9.81,) * 3
    with refused(fl.errors.SceneError, "wrong-value"):
        fl.Wrench(force=ones[:2])


def test_sizes_and_indices_may_be_any_numpy_integer() -> None:
    assert fl.simulate_many([scene()], threads=np.int64(1))[0].q.shape == fl.simulate(scene()).q.shape
    assert chain().joint_name(np.int64(0)) == chain().joint_name(np.array(0)) == "waist"
    assert chain().index(np.int64(2), np.int32(1), np.int8(3)) == chain().index(2, 1, 3)
    for integer in (np.int8, np.uint16, np.int64):
        assert fl.compare(scene(), engines=np.array(["native"]), samples=integer(2), seed=integer(1)).samples == 2
        locked = np.array([0, 2], dtype=integer)
        np.testing.assert_array_equal(fl.modes(chain(), locked=locked).hertz, fl.modes(chain(), locked=[0, 2]).hertz)
        assert fl.load_scene(MODELS[0]).arm.number(integer(1)) == 1
        assert fl.Link(name="a", segments=integer(1)).segments == 1


def test_unsuitable_numpy_numbers_are_refused_like_python_numbers() -> None:
    for wrong in (np.bool_(True), np.complex128(1), np.datetime64("2020"), np.array([1.0, 2.0]), np.str_("1")):
        with refused(fl.errors.SceneError, "wrong-value"):
            fl.Material(young=wrong, density=1.0)
    with refused(fl.errors.SceneError, "not-finite"):
        fl.Material(young=np.float64("nan"), density=1.0)
    with refused(fl.errors.SceneError, "not-finite"):
        fl.InitialState(joint_deg={1.0, 2.0})
    nested: list = []
    nested.append(nested)
    with refused(fl.errors.SceneError, "nested-too-deeply"):
        fl.InitialState(joint_deg=nested)


BIG = 1e160
"""A rate whose square overflows float64, whose largest number is 1.8e308."""


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        (lambda q: fl.inverse_dynamics(chain(), 0 * q, q, 0 * q), "'waist' .*qd"),
        (lambda q: fl.inverse_dynamics(chain(), 0 * q, 0 * q, q * 1e148), ".*qdd"),
        (lambda q: fl.bias_torque(chain(), 0 * q, q), "'waist' .*qd"),
        (lambda q: fl.energy(chain(), 0 * q, q), "kinetic .*qd"),
        (lambda q: fl.energy(chain(), q, 0 * q), "elastic energy .*q"),
        (lambda q: fl.elastic_torque(chain(), q * 1e148), "'upper.1.x' .*q"),
    ],
)
def test_an_overflow_of_float64_is_an_error_that_names_the_cause(call: Callable, wanted: str) -> None:
    wanted += r"\[\d\]\| = 1e\+\d+$"
    with pytest.raises(fl.errors.ArgumentError, match=wanted):
        call(np.full(chain().n, BIG))


def test_friction_that_overflows_float64_is_an_error_and_saturated_friction_is_not() -> None:
    arm = fl.lump(make_scene(fl.Link(name="a", joint=fl.Joint(viscous=1e200, coulomb=2.0, coulomb_width=1e-300))))
    assert fl.friction_torque(arm, [1e50]) == pytest.approx(1e250)
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.friction_torque(arm, [1e200])
    heavy = fl.lump(make_scene(flexible("a"), flexible("b"), tip=fl.RigidBody(mass=1e308)))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.mass_matrix(heavy, np.zeros(heavy.n))


def test_links_are_given_by_name_or_number_and_joints_by_name_or_index() -> None:
    arm, of = scene().arm, chain()
    for link in ("upper", 2, np.int64(2), np.str_("upper"), np.array(2)):
        assert arm.number(link) == 2
        assert of.index(link, 1, 3) == of.index(2, 1, 3)
    for joint in ("upper.1.z", 4, np.int32(4)):
        assert of.coordinate(joint) == (2, 1, 3)
        assert of.joint_name(joint) == "upper.1.z"
    with refused(fl.errors.ArgumentError, "unknown-link"):
        of.index("uper", 0, 0)
    for wrong in (0, 3, -1, True, 1.0, None):
        with refused(fl.errors.ArgumentError, "unknown-link"):
            arm.number(wrong)  # type: ignore[arg-type]
    with refused(fl.errors.ArgumentError, "unknown-joint"):
        of.coordinate("upper.9.z")


def test_a_motion_refers_to_its_link_by_name_or_number() -> None:
    def moved(link: str | int) -> fl.Trajectory:
        motion = fl.PrescribedMotion(link=link, times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])  # type: ignore[arg-type]
        return fl.simulate(
            make_scene(fl.Link(name="waist"), flexible("upper", segments=2), motion=(motion,)), duration=0.0
        )

    for link, number in (("waist", 1), ("upper", 2)):
        by_name, by_number = moved(link).chain, moved(number).chain
        np.testing.assert_array_equal(by_name.hinges["prescribed"], by_number.hinges["prescribed"])
        assert by_name.hinges["prescribed"][by_name.index(link, 0, 0)] == 1
    two = fl.PrescribedMotion(link=1, times=[0], angle_deg=[0], rate_deg=[0], acceleration_deg=[0])
    with refused(fl.errors.SceneError, "motion-twice"):
        make_scene(fl.Link(name="waist", length=1.0), motion=(two, msgspec.structs.replace(two, link="waist")))


@pytest.mark.parametrize(
    ("call", "kind", "id"),
    [
        (lambda own: fl.lump(in_three(lumping="gaus")), fl.errors.SceneError, "unknown-name"),
        (lambda own: fl.lump(in_three(lumping="gregory")), fl.errors.SceneError, "segments-of-rule"),
        (lambda own: fl.simulate(scene(), method="RK7"), fl.errors.SceneError, "unknown-name"),
        (lambda own: fl.stable_step(chain(), method="RK7"), fl.errors.ArgumentError, "unknown-name"),
        (lambda own: fl.lump(in_three(lumping=own)), fl.errors.DataFileError, "unknown-key"),
        (lambda own: fl.simulate(scene(), method=own), fl.errors.DataFileError, "unknown-key"),
        (lambda own: fl.stable_step(chain(), method=own), fl.errors.DataFileError, "unknown-key"),
    ],
)
def test_a_scene_an_argument_and_a_data_file_have_their_own_error_classes(call, kind, id, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("other = 1\n", encoding="utf-8")
    with refused(kind, id):
        call(str(tmp_path / "own.toml"))


def in_three(lumping: str) -> fl.Scene:
    return make_scene(flexible("a", segments=2 if lumping == "gregory" else 3, lumping=lumping))
