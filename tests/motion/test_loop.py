"""The closed loop as the processor sees it: poles, growth, margins, and what makes an unstable loop stable."""

import json
import re

import control
import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.motion.loop.instability import instability
from flexlink.motion.loop.loop import Loop
from tests.campaigns.random_loops import WRONG, judged, random_loop
from tests.conftest import flexible, make_scene
from tests.motion.test_drive_delay import crane
from tests.support.words import refused

FREE = (0.0, 0.0, 0.0)
"""No gravity, so that an arm may rest anywhere."""


def arm(*flex: str, **changes: object) -> fl.Scene:
    """A small arm without gravity, with 1 % of damping, its motors with armature."""
    links = [flexible(name, axes, 2) for name, axes in zip("abc", flex, strict=False)]
    scene = make_scene(*links, gravity=FREE)
    damped = {"link.*.joint.armature": 0.05, "link.*.damping": fl.Damping(ratio=0.01, at_hz=10.0)}
    return scene.varied(damped | changes)


def driven(scene: fl.Scene, hertz: float, ratio: float, **sampling: float) -> fl.Scene:
    """The arm under PD control that would have this frequency [Hz] and damping ratio if it were rigid."""
    chain = fl.lump(scene)
    M = np.diag(fl.mass_matrix(chain, np.zeros(chain.n)))[chain.active]
    ω = 2 * np.pi * hertz
    kp, kd = tuple((M * ω**2).tolist()), tuple((2 * ratio * ω * M).tolist())
    drive = fl.Drive(kind="pd", kp=kp, kd=kd, target_deg=(0.0,) * len(kp), **sampling)
    period = 1.0 / sampling.get("rate", 1000.0)
    return scene.varied({"drive": drive, "run": fl.RunSettings(duration=period, sample=period, tolerance=1e-6)})


def small_motion(loop: Loop, kick: np.ndarray, periods: int) -> np.ndarray:
    """Angles of the linear loop after a kick of the rates, (periods + 1, n)."""
    matrix, plant = loop._open.closed(loop.law), loop.plant
    x, size = np.zeros(len(matrix)), len(plant.angles)
    x[size : 2 * size] = kick
    first, queue = loop._open.feedback(loop.law) @ x, (len(matrix) - len(plant.A)) // len(plant.inputs)
    x[len(plant.A) :] = np.repeat(first, queue)  # until the first torque acts, it is that of the first instant
    states = [x]
    for _ in range(periods):
        states.append(matrix @ states[-1])
    return np.array(states)[:, :size] / plant.unit


@pytest.mark.parametrize(
    ("flex", "hertz", "ratio", "rate", "delay"),
    [
        (("z",), 3.0, 0.7, 200.0, 0.0),
        (("z", "yz"), 5.0, 0.5, 400.0, 0.004),
        (("xyz",), 20.0, 1.0, 200.0, 0.0018),
        (("yz", "z"), 10.0, 0.7, 1000.0, 0.0003),
    ],
)
def test_small_motion_of_the_nonlinear_sampled_run_is_that_of_the_loop(flex, hertz, ratio, rate, delay) -> None:
    """Differences of two runs that are kicked in opposite directions, so that even terms cancel."""
    scene, periods = driven(arm(*flex), hertz, ratio, rate=rate, delay=delay), 30
    loop = fl.loop(scene)
    kick = np.cos(np.arange(loop.plant.chain.n))
    expected = small_motion(loop, kick, periods)
    run = fl.RunSettings(duration=periods / rate, sample=1 / rate, tolerance=1e-11)
    size = 1e-4 / np.abs(expected).max()
    runs = [fl.simulate(scene.varied({"run": run}), qd0=sign * size * kick) for sign in (1.0, -1.0)]
    moved = (runs[0].q - runs[1].q) / (2 * size)
    assert np.abs(moved - expected).max() < 1e-5 * np.abs(expected).max()


def with_control(scene: fl.Scene, broken: int) -> tuple[control.StateSpace, control.StateSpace]:
    """The closed loop, and the loop broken at one input, made with python-control from the sampled linear model."""
    rate, delay = scene.drive.rate or 0.0, scene.drive.delay
    chain = fl.lump(scene)
    model = fl.linearize(chain, np.zeros(chain.n), outputs=("joints", "joint_rates")).sampled(rate, delay).control()
    K = np.hstack([np.diag(scene.drive.kp or ()), np.diag(scene.drive.kd or ())])
    others = [k for k in range(len(K)) if k != broken]
    A = model.A - model.B[:, others] @ K[others] @ model.C
    gains = control.ss([], [], [], K, 1 / rate)
    return control.feedback(model, gains), control.ss(A, model.B[:, [broken]], K[[broken]] @ model.C, 0.0, 1 / rate)


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.0031])
@pytest.mark.parametrize("i", [0, 1])
def test_poles_and_responses_are_those_of_python_control(delay: float, i: int) -> None:
    scene = driven(arm("z", "z"), 0.5, 0.6, rate=500.0, delay=delay)
    loop = fl.loop(scene)
    closed, broken = with_control(scene, i)
    found = np.array([pole.z for pole in loop.poles])
    for z in closed.poles():
        assert min(np.abs(found - z).min(), np.abs(found.conj() - z).min()) < 1e-8 or abs(z) < 1e-3
    hertz = np.array([1.0, 7.0, 40.0, 200.0])
    np.testing.assert_allclose(loop.response(hertz, i), broken(np.exp(2j * np.pi * hertz / 500.0)), rtol=1e-8)


def test_margins_are_those_of_python_control() -> None:
    """One rigid link on an elastic gear, since the polynomials of python-control lose their digits with more states."""
    geared = fl.Joint(armature=0.5, gear_stiffness=2e4, gear_damping=5.0)
    body = fl.RigidBody(mass=2.0, inertia=(0.3, 0.3, 0.5))
    link = fl.Link(name="a", length=0.0, flex="rigid", joint=geared, hub=body)
    scene = driven(make_scene(link, gravity=FREE), 8.0, 0.6, rate=500.0, delay=0.002)
    (margins,) = fl.loop(scene).margins
    gain, phase, nearest, _, crossing, _ = control.stability_margins(with_control(scene, 0)[1])
    assert margins.gain[1] == pytest.approx(gain, rel=1e-8)
    assert margins.phase == pytest.approx(phase, rel=1e-8)
    assert margins.bandwidth == pytest.approx(crossing / (2 * np.pi), rel=1e-8)
    assert margins.sensitivity == pytest.approx(1 / nearest, rel=1e-6)


def test_the_disk_margin_is_that_of_python_control() -> None:
    loop = fl.loop(driven(arm("z"), 4.0, 0.6, rate=500.0, delay=0.001))
    (margins,) = loop.margins
    ω = np.linspace(0.9, 1.1, 4001) * 2 * np.pi * margins.bandwidth
    S = 1 / (1 + loop.response(np.geomspace(0.01, 250.0, 20000)))
    assert margins.disk == pytest.approx(2 / np.abs(2 * S - 1).max(), rel=1e-4)
    assert ω.size  # the loop crosses 1
    low, high = margins.gain
    assert low < (2 - margins.disk) / (2 + margins.disk)
    assert high > (2 + margins.disk) / (2 - margins.disk)


@pytest.mark.parametrize("delay", [0.0, 0.0013])
def test_the_delay_margin_is_where_the_nonlinear_run_starts_to_grow(delay: float) -> None:
    loop = fl.loop(driven(arm("z"), 8.0, 0.5, rate=500.0, delay=delay))
    largest = loop.largest("drive.delay")
    assert loop.margins[0].delay == pytest.approx(largest - delay, rel=1e-4)
    for factor, grows in ((0.99, False), (1.01, True)):
        assert grown(loop.scene.varied({"drive.delay": factor * largest})) is grows


def grown(scene: fl.Scene) -> bool:
    """Whether a kick of the joints grows in the second half of a nonlinear run of 1,200 samples."""
    rate = scene.drive.rate or 0.0
    run = fl.RunSettings(duration=1200 / rate, sample=1 / rate, tolerance=1e-8, unstable="allow")
    chain = fl.lump(scene)
    kick = np.zeros(chain.n)
    kick[chain.active] = 1e-4
    size = np.linalg.norm(fl.simulate(scene.varied({"run": run}), qd0=kick).q, axis=1)
    return bool(size[1000:].max() > size[600:800].max())


def test_a_law_in_python_has_the_loop_of_the_same_drive() -> None:
    scene = driven(arm("z", "yz"), 5.0, 0.6, rate=400.0, delay=0.0015)
    kp, kd = np.array(scene.drive.kp), np.array(scene.drive.kd)

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        k = fl.lump(scene).active
        return -kp * np.sin(q[k]) - kd * qd[k]

    loop = fl.loop(scene.varied({"drive": None}), control=law, rate=400.0, delay=0.0015)
    assert loop.growth == pytest.approx(fl.loop(scene).growth, abs=1e-9)
    assert loop.largest("gain") == pytest.approx(fl.loop(scene).largest("gain"), rel=1e-5)


def test_a_law_that_reads_a_delayed_sensor_has_the_loop_of_a_delayed_drive() -> None:
    scene = driven(arm("z"), 2.0, 0.0, rate=400.0, delay=0.0041)
    (kp,) = scene.drive.kp or ()
    late = scene.varied({"drive": None, "sensor": (fl.Sensor(name="encoder", kind="joint", link="a", delay=0.0041),)})

    def law(t: float, q: np.ndarray, qd: np.ndarray, sensors: dict[str, float]) -> list[float]:
        return [-kp * sensors["encoder [rad]"]]

    assert fl.loop(late, control=law, rate=400.0).growth == pytest.approx(fl.loop(scene).growth, abs=1e-8)


def test_a_law_that_reads_the_torque_sees_the_torque_before_its_own() -> None:
    """u_k = −½ u_k-1 − k_d q̇ on a free wheel: λ² + (½ − 1 + k_d T/I) λ − ½ = 0."""
    wheel = fl.Link(name="wheel", length=0.0, flex="rigid", joint=fl.Joint(armature=0.5))
    scene = make_scene(wheel, gravity=FREE, sensor=(fl.Sensor(name="motor", kind="torque", link="wheel"),))
    loop = fl.loop(scene, control=lambda t, q, qd, sensors: [-0.5 * sensors["motor [N m]"] - 2.0 * qd[0]], rate=20.0)
    expected = np.roots([1.0, 0.5 - 1.0 + 2.0 / 20.0 / 0.5, -0.5])
    found = np.array([pole.z for pole in loop.poles])
    for z in expected:
        assert np.abs(found - z).min() < 1e-9


def unstable_scenes() -> list[fl.Scene]:
    """Loops that are unstable by their delay, their rate or their gains."""
    slow, late = driven(arm("z"), 20.0, 0.7, rate=50.0), driven(arm("z", "z"), 1.5, 0.7, rate=500.0, delay=0.02)
    return [slow, late, driven(arm("yz"), 60.0, 1.0, rate=200.0, delay=0.0025), crane(0.001)]


@pytest.mark.parametrize("scene", unstable_scenes(), ids=["rate", "delay", "gain", "crane"])
def test_every_remedy_for_an_unstable_loop_makes_the_run_stable(scene: fl.Scene) -> None:
    loop = fl.loop(scene)
    assert loop.growth > 1.001
    _, advice = instability(loop)
    remedies = advice.removeprefix("stable with ").split(" or with ")
    assert any(remedy.startswith("drive.delay") for remedy in remedies) is (loop.growth_with(delay=0.0) < 1.000001)
    for remedy in remedies:
        mended = scene.varied(applied(scene, remedy))
        assert fl.loop(mended).stable
        if scene.name != "crane":
            assert not grown(mended)


def applied(scene: fl.Scene, remedy: str) -> dict[str, object]:
    """The changes that a remedy names."""
    if remedy.startswith("drive.delay ≤"):
        return {"drive.delay": 1e-3 * float(remedy.split()[2])}
    if remedy.startswith("drive.rate ="):
        return {"drive.rate": float(remedy.split()[2])}
    if remedy.startswith("link."):
        return {"link.*.joint.armature": float(remedy.split()[2])}
    names, _, factor = remedy.partition(" times ")
    return {
        f"drive.{name}": tuple(float(factor) * gain for gain in getattr(scene.drive, name))
        for name in names.split(" and ")
    }


@pytest.mark.slow
def test_a_run_warns_of_an_unstable_loop_and_never_asks_for_more_segments() -> None:
    run = fl.simulate(crane(0.001).varied({"run.duration": 0.4, "run.tolerance": 1e-4, "run.sample": 0.01}))
    unstable = [warning for warning in run.warnings if warning.id == "unstable-loop"]
    assert len(unstable) == 1
    assert "boom" in unstable[0]
    assert not any("segments" in warning for warning in run.warnings)
    assert not any(warning.id == "unstable-loop" for warning in fl.simulate(crane(0.0)).warnings)


def test_poles_are_named_after_what_moves() -> None:
    scene = driven(arm("z"), 2.0, 0.7, rate=1000.0, delay=0.002)
    assert {pole.motion for pole in fl.loop(scene).poles} == {"joint 'a'", "bending of 'a'"}
    off = scene.varied({"drive.kp": (0.0,), "drive.kd": (0.0,)})
    assert "controller" in {pole.motion for pole in fl.loop(off).poles}


def test_a_continuous_law_has_the_poles_of_pd_poles() -> None:
    scene = driven(arm("z", "z"), 3.0, 0.5)
    loop = fl.loop(scene)
    chain = loop.plant.chain
    slow = fl.small_motion.pd_poles(chain, np.zeros(chain.n), kp=scene.drive.kp or (), kd=scene.drive.kd or ())
    found = np.array([pole.s for pole in loop.poles])
    for s in slow:
        assert np.abs(found - s).min() < 1e-7 * abs(s)
    assert loop.stable
    assert loop.margins[0].delay > 0


def test_a_root_locus_follows_any_number_of_the_scene() -> None:
    loop = fl.loop(driven(arm("z"), 5.0, 0.7, rate=200.0))
    along = loop.over("drive.kd.a", [1.0, 10.0])
    assert along[0].scene.drive.kd == (1.0,)
    largest = loop.largest("drive.kd.a")
    assert loop.varied("drive.kd.a", largest).stable
    assert not loop.varied("drive.kd.a", 1.001 * largest).stable
    assert loop.largest("drive.kd") == pytest.approx(largest / (loop.scene.drive.kd or ())[0], rel=1e-5)


def remembering() -> object:
    """A law with an integrator."""
    total = 0.0

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> list[float]:
        nonlocal total
        total += 0.001 * float(q[0]) + 1e-6
        return [-total - q[0]]

    return law


def test_what_has_no_loop_is_refused_by_name() -> None:
    scene = arm("z")
    with refused(fl.errors.ArgumentError, "no-feedback"):
        fl.loop(scene)
    with refused(fl.errors.ArgumentError, "law-with-memory"):
        fl.loop(scene, control=remembering(), rate=100.0)
    with refused(fl.errors.ArgumentError, "law-failed"):
        fl.loop(scene, control=lambda t, q, qd: [1.0, 2.0], rate=100.0)
    with refused(fl.errors.ArgumentError, "law-failed"):
        fl.loop(scene, control=lambda t, q, qd: [1 / 0], rate=100.0)
    with refused(fl.errors.ArgumentError, "both-given"):
        fl.loop(driven(scene, 1.0, 1.0), control=lambda t, q, qd: [0.0], rate=100.0)
    loop = fl.loop(driven(scene, 1.0, 1.0))
    for path in ("drive.delay", "drive.rate"):
        with refused(fl.errors.ArgumentError, "no-effect"):
            loop.largest(path)
    with refused(fl.errors.ArgumentError, "wrong-value"):
        loop.largest("tip.mass")
    with refused(fl.errors.ArgumentError, "unknown-name"):
        loop.response([1.0], "elbow")
    with refused(fl.errors.ArgumentError, "wrong-value"):
        fl.loop(driven(scene, 1.0, 1.0, rate=100.0)).response([60.0])


@pytest.mark.slow
def test_the_command_prints_poles_and_margins_and_returns_1_if_unstable(tmp_path, capsys) -> None:
    sampled = ["loop", "models/ptp_move.toml", "--set", "drive.rate=1000"]
    assert main([*sampled, "--plot", str(tmp_path / "bode.png")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("stable")
    assert "tau upper [N m]" in printed
    found = fl.loop(fl.load_scene("models/ptp_move.toml").varied({"drive.rate": 1000.0}))
    poles = [float(line.split()[0]) for line in printed.splitlines()[2:6]]
    assert poles == pytest.approx([abs(pole.z) for pole in found.poles[:4]], rel=1e-5)
    delays = [1e-3 * float(text) for text in re.findall(r"delay margin (\S+) ms", printed)]
    assert delays == pytest.approx([each.delay for each in found.margins], rel=5e-3)
    assert (tmp_path / "bode.png").stat().st_size > 0
    late = [*sampled, "--set", "drive.delay=0.004", "--json"]
    assert main([*late, "--over", "drive.delay", "--values", "0", "0.004"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["stable"] is False
    assert [row["growth"] > 1 for row in document["over"]] == [False, True]
    assert main([*sampled, "--over", "drive.kd"]) == 2


def test_the_delay_margin_of_an_input_leaves_the_others_on_time() -> None:
    loop = fl.loop(driven(arm("z", "z"), 1.5, 0.6, rate=500.0))
    margins = [each.delay for each in loop.margins]
    assert margins[0] != pytest.approx(margins[1], rel=0.01)
    for late in np.diag(margins):
        assert loop.growth_with(delay=0.99 * late) < 1.0 + 1e-6 < loop.growth_with(delay=1.01 * late)


def test_a_joint_with_prescribed_motion_is_no_input_and_is_held() -> None:
    rest = fl.PrescribedMotion(
        link="a", times=(0.0, 1.0), angle_deg=(0.0, 0.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    scene = driven(arm("z", "z"), 4.0, 0.6, rate=500.0, delay=0.001)
    gains = {"drive.kp": (0.0, scene.drive.kp[1]), "drive.kd": (0.0, scene.drive.kd[1])}
    moved, locked = scene.varied({"motion": (rest,), **gains}), scene.varied({"link.a.joint.locked": True, **gains})
    loop, held = fl.loop(moved), fl.loop(locked)
    assert loop.inputs == held.inputs == ("tau b [N m]",)
    np.testing.assert_allclose([p.z for p in loop.poles], [p.z for p in held.poles], atol=1e-12)


@pytest.mark.parametrize(
    "seed", [1143, pytest.param(1350, marks=pytest.mark.slow), pytest.param(1521, marks=pytest.mark.slow)]
)
def test_growth_and_poles_are_those_of_40_digits(seed: int) -> None:
    """Loops in which an angle without stiffness has rounding errors for a stiffness."""
    error, right = judged(random_loop(seed))
    assert error < WRONG
    assert right
