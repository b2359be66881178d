"""FMUs and C steps, against flexlink's solver and, through FMPy, against SUNDIALS' CVODE."""

import ctypes
import io
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.sensor import column_names
from flexlink.dynamics.free_motion import all_motions
from flexlink.errors import ArgumentError, MissingDependencyError
from flexlink.formats.code.fmu import _base_of, _split
from flexlink.formats.code.model import implicit_of, model_of, name_of
from flexlink.formats.code.sensors import signals_of
from tests.campaigns.random_code import state
from tests.conftest import ROOT, flexible, make_scene
from tests.dynamics.test_strain_modes import with_modes
from tests.formats.test_code import OPEN, computed, needs_a_compiler
from tests.matrix import case
from tests.support.words import refused

TORQUE, FORCE = (20.0, -10.0), (3.0, -2.0, 1.0)
START = fl.InitialState(joint_deg=(10.0, -40.0), rate_deg=(20.0, 30.0))


def arm(modes: int | None = None) -> fl.Scene:
    """Two links that bend and a force on their tip."""
    damped = {"damping": fl.Damping(ratio=0.01, at_hz=20.0), "joint": fl.Joint(armature=0.1)}
    links = flexible("a", "z", 5, **damped), flexible("b b", "yz", 3, **damped)
    scene = make_scene(*links, gravity=(0.0, -9.81, 1.0), initial=START)
    drive, run = fl.Drive(kind="constant", torque=TORQUE), fl.RunSettings(tolerance=1e-10, duration=0.1, sample=0.005)
    changes = {"drive": drive, "wrench": fl.Wrench(force=FORCE), "run": run}
    return (scene if modes is None else with_modes(scene, modes)).varied(changes)


class Opened:
    """An FMU of a scene in FMPy."""

    def __init__(self, scene: fl.Scene, folder: Path, fmi: int = 3) -> None:
        self.fmpy, self.fmi, self.path = pytest.importorskip("fmpy"), fmi, folder / "arm.fmu"
        self.chain = fl.Problem(scene).chain  # open, if the scene has ties
        self.path.write_bytes(fl.to_fmu(self.chain, fl.initial_state(scene, self.chain), fmi=fmi, scene=scene))
        self.description = self.fmpy.read_model_description(self.path)
        self.numbers = {each.name: each.valueReference for each in self.description.modelVariables}
        rates = [each for each in self.description.modelVariables if each.derivative is not None]
        self.rates = [each.valueReference for each in rates]
        self.states = [each.derivative.valueReference for each in rates]
        self.inputs = [each.valueReference for each in self.description.modelVariables if each.causality == "input"]

    def run(self, kind: str, **keys: Any) -> np.ndarray:
        """Positions of the tip, under the loads of `arm`."""
        names, axes = [f"tip.{axis}" for axis in "xyz"], "xyz"
        start = dict(zip(("tau.a", "tau.b_b"), TORQUE, strict=True))
        start |= {f"tip.force.{axis}": value for axis, value in zip(axes, FORCE, strict=True)}
        found = self.fmpy.simulate_fmu(
            self.path, fmi_type=kind, start_values=start, output=names, output_interval=0.005, **keys
        )
        return np.array([found[name] for name in names]).T

    def instance(self) -> Any:
        """An initialized instance for Co-Simulation."""
        folder, name = self.fmpy.extract(self.path), self.description.coSimulation.modelIdentifier
        kind = {2: "fmi2.FMU2Slave", 3: "fmi3.FMU3Slave"}[self.fmi].split(".")
        module = getattr(pytest.importorskip(f"fmpy.{kind[0]}"), kind[1])
        made = module(guid=self.description.guid, unzipDirectory=folder, modelIdentifier=name, instanceName="one")
        made.instantiate()
        if self.fmi == 2:
            made.setupExperiment()
        made.enterInitializationMode()
        made.exitInitializationMode()
        return made


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize(("modes", "fmi"), [(None, 3), (1, 3), (None, 2)])
def test_an_fmu_is_valid_and_moves_as_the_arm_by_its_own_steps_and_those_of_cvode(
    modes: int | None, fmi: int, tmp_path: Path
) -> None:
    validation = pytest.importorskip("fmpy.validation")
    opened, run = Opened(arm(modes), tmp_path, fmi), fl.simulate(arm(modes))
    assert validation.validate_fmu(str(opened.path)) == []
    exact = opened.run("ModelExchange", stop_time=0.1, solver="CVode", relative_tolerance=1e-9)
    assert np.abs(exact - run.tip).max() <= 1e-8
    assert np.abs(opened.run("CoSimulation", stop_time=0.1) - run.tip).max() <= 1e-6


@pytest.mark.slow
@needs_a_compiler
def test_derivatives_states_and_outputs_of_an_instance_are_those_of_the_arm(tmp_path: Path) -> None:
    opened = Opened(arm(), tmp_path)
    one, chain, n = opened.instance(), opened.chain, opened.chain.n
    assert one.getFloat64(opened.states) == np.concatenate(fl.initial_state(arm(), chain)).tolist()
    x, tip, tau = state(chain, 2)[0], [opened.numbers[f"tip.{axis}"] for axis in "xyz"], np.zeros(n)
    one.setFloat64(opened.states, x.tolist())

    def slopes(rows: list[int], by: list[int]) -> np.ndarray:
        return np.array([one.getDirectionalDerivative(rows, [each], [1.0]) for each in by]).T

    exact = fl.forward_dynamics_derivatives(chain, x[:n], x[n:], tau=tau)
    wanted = np.hstack([exact.dq, exact.dqd, exact.dtau[:, chain.active]])
    by = [*opened.states, *opened.inputs[:2]]
    assert np.abs(slopes(opened.rates, by)[n:] - wanted).max() <= 1e-11 * np.abs(wanted).max()
    assert slopes(tip, opened.states[:n]) == pytest.approx(fl.jacobian(chain, x[:n]).linear, abs=1e-12)
    turned = [opened.numbers[f"tip.R{i}{j}"] for i in "123" for j in "123"]
    assert one.getFloat64(turned) == pytest.approx(fl.frames(chain, x[:n]).rotations[-1].ravel(), abs=1e-14)
    assert (slopes(tip, opened.inputs) == 0.0).all()


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("fmi", [2, 3])
def test_a_stored_state_continues_as_before(fmi: int, tmp_path: Path) -> None:
    opened = Opened(arm(), tmp_path, fmi)
    one = opened.instance()
    get = one.getReal if fmi == 2 else one.getFloat64
    step = {"currentCommunicationPoint": 0.0, "communicationStepSize": 0.01}
    one.doStep(**step)
    stored = one.serializeFMUState(one.getFMUState())
    one.doStep(**step)
    after = get(opened.states)
    one.reset()
    one.setFMUState(one.deserializeFMUState(stored))
    one.doStep(**step)
    assert get(opened.states) == after


@pytest.mark.parametrize("name", OPEN)
def test_parameters_and_loads_are_exact_for_every_kind_of_arm(name: str) -> None:
    chain = case.case(name).chain
    model, (x, u), Φ, m = model_of(chain, extra=True), state(chain, 2), all_motions(chain), chain.freedoms
    u[chain.hinges["prescribed"][chain.active] != 0] = 0.0  # as in `forward_dynamics`
    wrench, gravity = np.array([1.0, 2.0, -3.0, 0.1, 0.2, -0.3]), np.array([1.0, -2.0, 3.0])
    hinges, couplings, passive = chain.hinges.copy(), chain.couplings.copy(), np.setdiff1d(range(chain.n), chain.active)
    for field, factor in (("stiffness", 2.0), ("damping", 3.0)):
        hinges[field][passive] *= factor
        couplings[field] *= factor
    other = chain.with_numbers(hinges=hinges, couplings=couplings, gravity=gravity)
    found = computed(model.tape, np.concatenate([x, u, wrench, gravity, [0.0, 2.0, 3.0]]), [*model.rate])
    tau, rest = np.zeros(chain.n), 0.0 if chain.shapes is None else chain.rest
    tau[chain.active] = u
    wanted = fl.forward_dynamics(other, rest + Φ @ x[:m], Φ @ x[m:], tau, tip_wrench=wrench)
    assert np.abs(Φ @ found[m:] - wanted).max() <= 1e-9 * np.abs(wanted).max()


def test_a_payload_is_a_mass_at_the_tip() -> None:
    scene = arm().varied({"tip.mass": 2.0})
    chain, (x, u) = fl.lump(arm()), state(fl.lump(scene), 2)
    model, n, tau = model_of(chain, extra=True), chain.n, np.zeros(chain.n)
    tau[chain.active] = u
    found = computed(model.tape, np.concatenate([x, u, np.zeros(6), chain.gravity, [2.0, 1.0, 1.0]]), [*model.rate])
    assert found[n:] == pytest.approx(fl.forward_dynamics(fl.lump(scene), x[:n], x[n:], tau), rel=1e-10)


def step_of(chain: fl.Chain, folder: Path) -> Any:
    """The function `arm_step` in Python."""
    (folder / "arm.c").write_text(fl.to_c(chain, step=True), encoding="utf-8")
    strict = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *strict, "-shared", "-fPIC", "arm.c", "-o", "arm.so", "-lm"], cwd=folder, check=True)
    step = ctypes.CDLL(str(folder / "arm.so"))[f"{name_of(chain)}_step"]
    step.argtypes = [np.ctypeslib.ndpointer(np.float64)] * 2 + [ctypes.c_double]
    return step


@pytest.mark.slow
@needs_a_compiler
def test_a_step_of_a_millisecond_is_stable_and_accurate_on_a_stiff_arm(tmp_path: Path) -> None:
    run = fl.RunSettings(method="Radau5", tolerance=1e-8, duration=0.1, sample=0.01)
    links = flexible("a", "z", 9, length=0.3), flexible("b", "z", 9, length=0.3)
    drive = fl.Drive(kind="constant", torque=TORQUE)
    scene = make_scene(*links, gravity=(0.0, -9.81, 0.0), initial=START, run=run, drive=drive)
    reference = fl.simulate(scene)
    chain, u = reference.chain, np.array(TORQUE)
    assert fl.stable_step(chain, method="RK4") < 2e-5
    step, x, far = step_of(chain, tmp_path), np.append(reference.q[0], reference.qd[0]), 0.0
    for sample in reference.tip[1:]:
        for _ in range(10):
            step(x, u, 1e-3)
        far = max(far, np.abs(fl.tip_position(chain, x[: chain.n]) - sample).max())
    assert far <= 1e-4


@pytest.mark.slow
@needs_a_compiler
def test_steps_are_of_fourth_order(tmp_path: Path) -> None:
    scene = make_scene(flexible("a", "z", 2), flexible("b", "z", 2), initial=START)
    chain, u, ends = fl.lump(scene), np.array(TORQUE), list[np.ndarray]()
    step = step_of(chain, tmp_path)
    for count in (50, 100, 200, 3200):
        x = np.concatenate(fl.initial_state(scene, chain))
        for _ in range(count):
            step(x, u, 0.2 / count)
        ends.append(x)
    errors = [np.abs(end - ends[-1]).max() for end in ends[:3]]
    assert 3.5 <= np.log2(errors[1] / errors[2]) <= 4.6


def test_the_cost_of_a_step_depends_on_no_number_and_it_allocates_nothing() -> None:
    text = (ROOT / "flexlink/formats/code/step.c").read_text(encoding="utf-8")
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    words = "if", "while", "break", "goto", "return", "malloc"
    assert [word for word in (*words, "?") if word in re.findall(r"\w+|\?", code)] == []
    assert set(re.findall(r"; \w (?:<|>=) ([^;]+);", code)) == {"n", "i", "s", "6", "2 * n", "0"}


def test_a_joint_of_given_motion_has_no_slopes_of_its_acceleration() -> None:
    chain = case.case("motion").chain
    free, M, N, known = implicit_of(model_of(chain))
    held = np.setdiff1d(range(chain.freedoms, 2 * chain.freedoms), free)
    assert len(held) and M.shape == (len(free), len(free)) and len(N) == len(free)
    assert (known[held].astype(float).sum(axis=1) == 1.0).all()


@needs_a_compiler
@pytest.mark.parametrize("fmi", [2, 3])
def test_sources_compile_without_warnings_and_their_token_is_theirs(fmi: int, tmp_path: Path) -> None:
    scene = make_scene(flexible("a", "z", 2))
    chain = fl.lump(scene)
    rest = fl.initial_state(scene, chain)
    archive = fl.to_fmu(chain, rest, fmi=fmi, binary=False)
    assert archive == fl.to_fmu(chain, rest, fmi=fmi, binary=False)
    files = zipfile.ZipFile(io.BytesIO(archive))
    assert not [name for name in files.namelist() if name.startswith("binaries")]
    files.extractall(tmp_path)
    strict = ["cc", "-std=c99", "-O0", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-fsyntax-only"]
    subprocess.run([*strict, "sources/test.c"], cwd=tmp_path, check=True)
    described, code = (files.read(name).decode() for name in ("modelDescription.xml", "sources/test.c"))
    (token,) = set(re.findall(r"\{[0-9a-f-]{36}\}", code))
    assert token in described
    moved = fl.to_fmu(chain, (rest[0] + 0.1, rest[1]), fmi=fmi, binary=False)
    assert token not in zipfile.ZipFile(io.BytesIO(moved)).read("modelDescription.xml").decode()


@pytest.mark.parametrize("fmi", [2, 3])
def test_references_of_the_description_are_to_the_variables_that_are_meant(fmi: int) -> None:
    """FMI 2.0 counts from 1; the rate of an angle depends on its speed alone."""
    chain = fl.lump(scene := make_scene(flexible("a", "z", 2)))
    archive = zipfile.ZipFile(io.BytesIO(fl.to_fmu(chain, fl.initial_state(scene, chain), fmi=fmi, binary=False)))
    root = ET.fromstring(archive.read("modelDescription.xml"))
    listed = root.findall("ModelVariables/*")
    names = {str(k): each.attrib["name"] for k, each in enumerate(listed, 3 - fmi)}
    rates = {each.attrib["name"]: (each if fmi == 3 else each[0]).get("derivative") for each in listed}
    states = {name: names[state] for name, state in rates.items() if state}
    assert len(states) == 2 * chain.n and all(rate == f"der({state})" for rate, state in states.items())
    kind, of = ("Derivatives/Unknown", "index") if fmi == 2 else ("ContinuousStateDerivative", "valueReference")
    found = {names[each.attrib[of]]: each.attrib["dependencies"] for each in root.findall(f"ModelStructure/{kind}")}
    assert [*found] == [*states]
    for q in [*states.values()][: chain.n]:
        assert names[found[f"der({q})"]] == q.replace("q.", "qd.", 1)


def test_names_and_units() -> None:
    assert _split(["q b b.1.z [rad]", "tau a [N m]"]) == [("q.b_b.1.z", "rad"), ("tau.a", "N.m")]
    twins = ["q left panel [rad]", "q left_panel [rad]"]
    assert [f"{name} [{unit}]" for name, unit in _split(twins)] == twins
    assert _base_of("N.m") == {"kg": "1", "m": "2", "s": "-2"}
    assert _base_of("rad/s2") == {"rad": "1", "s": "-2"} and _base_of("1") == {}


def test_what_an_fmu_cannot_be_written_for_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = make_scene(flexible("a", "z", 2))
    chain = fl.lump(scene)
    rest = fl.initial_state(scene, chain)
    with refused(ArgumentError, "out-of-range"):
        fl.to_fmu(chain, rest, fmi=1)
    (tmp_path / "cc").write_text("#!/bin/sh\necho 'no headers' >&2; exit 1\n")
    (tmp_path / "cc").chmod(0o755)
    for found in (None, str(tmp_path / "cc")):
        monkeypatch.setattr(shutil, "which", lambda name, found=found: found)
        with refused(MissingDependencyError, "no-compiler"):
            fl.to_fmu(chain, rest)


def test_the_export_command_writes_fmus(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    make_scene(flexible("a", "z", 2)).varied({"run.duration": 2.5}).save(path)
    words = ["export", str(path), "--out", str(tmp_path), "--fmu", "arm.fmu", "--no-binary", "--fmi", "2"]
    assert main(words) == 0
    assert sorted(one.name for one in tmp_path.iterdir()) == ["arm.fmu", "arm.toml"]  # no files of other formats
    description = zipfile.ZipFile(tmp_path / "arm.fmu").read("modelDescription.xml").decode()
    found = [re.search(rf'{key}="(.*?)"', description)[1] for key in ("fmiVersion", "stopTime")]
    assert found == ["2.0", "2.5"]


SENSORS = (
    fl.Sensor(name="gauge", kind="strain", link="a", x=0.1, fibre=(0.02, 0.0), gain=1e6, unit="µm/m", bias=3.0),
    fl.Sensor(name="encoder", kind="joint", link="b b", resolution=0.1, delay=0.01),
    fl.Sensor(name="drive", kind="current", link="a", torque_constant=2.0, low_pass=10.0),
    fl.Sensor(name="imu", kind="accelerometer", link="b b", point=(0.3, 0.01, 0.02), noise=1.0),
    fl.Sensor(name="gyro", kind="gyroscope", link="a", axis=(0.0, 1.0, 1.0)),
    fl.Sensor(name="seen", kind="position", link="b b", x=0.2),
)


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("modes", [None, 1])
def test_outputs_are_signals_of_sensors_without_their_instruments(modes: int | None, tmp_path: Path) -> None:
    validation = pytest.importorskip("fmpy.validation")
    scene = arm(modes).varied({"sensor": SENSORS})
    plain = tuple(replace(each.ideal, gain=1.0, unit=None, bias=0.0, delay=0.0, low_pass=None) for each in SENSORS)
    run = fl.simulate(scene.varied({"sensor": plain}))
    assert validation.validate_fmu(str(Opened(scene, tmp_path, fmi=2).path)) == []
    opened = Opened(scene, tmp_path)
    assert validation.validate_fmu(str(opened.path)) == []
    names = [each.name for each in opened.description.modelVariables if each.description == "signal of a sensor"]
    assert names == ["gauge", "encoder", "drive", *(f"{kind}.{axis}" for kind in ("imu",) for axis in "xyz"), "gyro",
                     "seen.x", "seen.y", "seen.z"]  # fmt: skip
    one, signals, by = opened.instance(), [opened.numbers[name] for name in names], [*opened.states, *opened.inputs]
    one.setFloat64(opened.inputs[:5], [*TORQUE, *FORCE])
    wanted = np.array([run.columns[name] for name in column_names(plain, scene.arm)])
    size = np.abs(wanted).max(axis=1)
    Φ = all_motions(run.chain)
    for k in (0, 7, 20):
        z, zd = (np.linalg.lstsq(Φ, each[k], rcond=None)[0] for each in (run.q, run.qd))
        one.setFloat64(opened.states, [*z, *zd])
        assert (np.abs(one.getFloat64(signals) - wanted[:, k]) <= 1e-10 * size).all()
    x, step = np.array(one.getFloat64(by)), 1e-5
    for j, each in enumerate(by):
        sides = []
        for side in (step, -step):
            one.setFloat64([each], [x[j] + side])
            sides.append(np.array(one.getFloat64(signals)))
        one.setFloat64([each], [x[j]])
        exact = np.array(one.getDirectionalDerivative(signals, [each], [1.0]))
        assert np.abs((sides[0] - sides[1]) / (2 * step) - exact).max() <= 1e-6 * max(np.abs(exact).max(), 1.0)


def test_a_current_is_the_torque_divided_by_the_torque_constant() -> None:
    plain = fl.Sensor(name="angle", kind="joint", link="b b"), fl.Sensor(name="torque", kind="torque", link="b b")
    current = fl.Sensor(name="current", kind="current", link="b b", torque_constant=4.0)
    scene = arm().varied({"sensor": (*plain, current)})
    model = model_of(fl.lump(scene), extra=True)
    signals, _ = signals_of(model, scene)
    x = np.arange(1.0, len(model.x) + 1)
    found = computed(model.tape, np.concatenate([x, [20.0, -10.0], np.ones(len(model.u) - 2)]), [*signals.values()])
    assert found.tolist() == [x[model.chain.active[1]], -10.0, -2.5]


def test_sensors_that_no_fmu_has_are_refused() -> None:
    scene = arm().varied({"sensor": SENSORS})
    chain = fl.lump(scene)
    state = fl.initial_state(scene, chain)
    cell = scene.varied({"link.a": replace(scene.arm.links[0], flex="xyz", segments=7, lumping="gauss_rotation")})
    still = fl.PrescribedMotion(link="a", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    moved = scene.varied({"drive": fl.Drive(), "motion": (still,), "sensor": SENSORS[1:], "initial": fl.InitialState()})
    with refused(ArgumentError, "chains-differ"):
        fl.to_fmu(chain, state, scene=scene.varied({"link.a.segments": 4}))
    for each, wrong in ((cell, "not-representable"), (moved, "not-representable")):
        with refused(fl.errors.SceneError, wrong):
            fl.to_fmu(fl.lump(each), fl.initial_state(each, fl.lump(each)), scene=each, binary=False)
