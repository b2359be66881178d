"""The tip follows its move: torques against a continuous beam, and moves, delays and refusals of `invert`."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

import flexlink as fl
from flexlink.cli.invert import _torques
from flexlink.cli.main import main
from flexlink.motion.inversion import Inversion
from tests.support.words import refused, reviewed
from validation.oracles import hub_beam

PULSE = Path(__file__).parents[2] / "validation" / "scenes" / "torque_pulse.toml"
BEAM = hub_beam.Beam(length=1.0, EI=5.0, rho_a=0.6, tip_mass=0.3, hub=0.05)


def pulse_arm(move: fl.Reference, **changes: Any) -> fl.Scene:
    """The study's flexible link with hub inertia and payload, under joint PD along a move."""
    drive = fl.Drive(kind="pd", kp=(100.0,), kd=(8.0,), reference=move)
    return fl.load_scene(PULSE).varied({"drive": drive, **changes})


def turn(duration: float = 1.2) -> fl.Reference:
    return fl.Reference(profile="quintic", to_deg=(60.0,), duration=duration)


def two_links(**changes: Any) -> fl.Scene:
    """The paper's arm with motors, under joint PD, raised in a second."""
    motors = {f"link.{name}.joint.armature": 3.0 for name in ("upper", "fore")}
    move = fl.Reference(profile="quintic", to_deg=(0.0, -30.0, -60.0), duration=1.0)
    drive = fl.Drive(kind="pd", kp=(0.0, 4e3, 4e3), kd=(0.0, 100.0, 100.0), reference=move)
    scene = fl.load_scene(PULSE.parents[2] / "models" / "paper_fig5.toml").varied(
        {**motors, "drive": drive, "run.duration": 1.5}
    )
    return scene.varied(changes)


def torque_per_displacement(beam: hub_beam.Beam, ω: np.ndarray) -> np.ndarray:
    """1/G(iω) of the hub's torque for the tip's displacement, from the four functions of a continuous beam."""
    found = np.empty(len(ω))
    for k, β in enumerate((beam.rho_a * ω**2 / beam.EI) ** 0.25):
        ends = np.array([0.0, beam.length])
        one = hub_beam.Modes(beam.length, np.full(4, β), np.empty(4), np.eye(4))
        d0, d1, d2, d3 = (one.at(ends, order) for order in range(4))
        shear = beam.EI * d3[:, 1] + beam.tip_mass * ω[k] ** 2 * d0[:, 1]
        c = np.linalg.solve(np.array([d0[:, 0], d2[:, 1], shear, d0[:, 1]]), [0.0, 0.0, 0.0, 1.0])
        found[k] = -(ω[k] ** 2) * beam.hub * d1[:, 0] @ c - beam.EI * d2[:, 0] @ c
    return found


def test_the_torque_of_a_small_smooth_move_is_the_inverse_response_of_a_continuous_beam() -> None:
    duration, width, degrees = 2.0, 0.15, 0.5
    t = np.linspace(0, duration, 401)
    x = (t - duration / 2) / width
    bell = np.exp(-x * x / 2) / np.sqrt(2 * np.pi)
    rows = [tuple((degrees * value,) for value in part) for part in (ndtr(x), bell / width, -x * bell / width**2)]
    rows[1] = (*rows[1][:-1], (0.0,))
    move = fl.Reference(
        profile="smooth", times=tuple(t), angle_deg=rows[0], rate_deg=rows[1], acceleration_deg=rows[2]
    )  # fmt: skip
    found = fl.invert(pulse_arm(move, **{"link.*.segments": 9, "link.*.lumping": "gauss", "run.duration": 2.5}))
    h, n = found.times[1] - found.times[0], 4096
    torque, first = np.zeros(n), (n - len(found.times)) // 2
    torque[first : first + len(found.times)] = found.torques[:, 0]
    x = (h * (np.arange(n) - first) + found.times[0] - found.starts - duration / 2) / width
    acceleration = np.radians(degrees) * -x * np.exp(-x * x / 2) / np.sqrt(2 * np.pi) / width**2
    ω, A = 2 * np.pi * np.fft.rfftfreq(n, h), np.fft.rfft(acceleration)
    U, heard = np.zeros(len(ω), complex), np.abs(A) > 1e-12 * np.abs(A).max()
    heard[0] = False
    U[heard] = -A[heard] / ω[heard] ** 2 * torque_per_displacement(BEAM, ω[heard])
    assert np.abs(np.fft.rfft(torque) - U).max() < 1e-4 * np.abs(U).max()
    exact = np.fft.irfft(U, n)
    assert np.abs(torque - exact).max() < 1e-4 * np.abs(exact).max()
    assert found.error < 1e-6 * np.radians(degrees)
    assert abs(found.torques[0, 0]) < 1e-6 < found.starts_before


def test_the_torques_move_the_tip_of_a_large_continuous_beam_without_feedback() -> None:
    """The beam is that of `hub_beam`, whose terms of third order in the deflection, 0.2 of its length, are left out."""
    found = fl.invert(pulse_arm(turn(), **{"run.duration": 2.0}))
    step = 1e-3
    jumps = step * np.arange(np.ceil(found.times[-1] / step))
    torques = np.interp(jumps + step / 2, found.times, found.torques[:, 0])
    t = np.append(jumps, jumps[-1] + step)[::10]
    drive = hub_beam.Drive(jumps=tuple(jumps), torques=tuple(torques))
    x, y = hub_beam.simulate(BEAM, drive, t, count=8, finer=10).tip().T
    path = np.column_stack([np.interp(t, found.times, column) for column in found.path.T])
    off = np.arctan2(y, x) - np.arctan2(path[:, 1], path[:, 0])
    assert np.abs(off).max() < 1e-3  # m at 1 m from the hub
    assert found.error < 1e-5
    assert found.residual < 1e-6
    assert found.distance < 2e-3  # the bent link is shorter
    beside = found.shaped()
    assert beside.lag > 0.1
    assert beside.settles > found.settles


def test_beside_the_inversion_the_joints_move_to_the_end_even_if_the_run_is_shorter() -> None:
    beside = fl.invert(two_links(**{"run.duration": 0.1})).shaped("ZV")
    assert beside.run.t[-1] == 1.0 and np.isfinite(beside.lag)


@pytest.fixture(scope="module")
def raised() -> Inversion:
    return fl.invert(two_links())


def test_the_tip_of_two_links_with_gravity_follows_the_arm_at_rest(raised: Inversion) -> None:
    chain, middle = raised.run.chain, 0.5 * (raised.starts + raised.ends)
    start = chain.rest.copy()
    start[chain.active] = np.radians([-55.0, -35.0])  # half-way between both ends
    rest = fl.solve_static(chain, start, locked=chain.active)
    nearest = int(np.argmin(np.abs(raised.times - middle)))
    assert raised.path[nearest] == pytest.approx(fl.tip_position(chain, rest.q), abs=1e-9)
    assert raised.met
    assert raised.error < 1e-6


def test_the_driven_scene_is_the_same_after_saving(raised: Inversion, tmp_path: Path) -> None:
    again = fl.load_scene(raised.scene.save(tmp_path / "moved.toml"))
    assert again == raised.scene
    assert np.array_equal(fl.simulate(again).q, raised.run.q)


def test_without_feedforward_the_tip_misses_the_path(raised: Inversion) -> None:
    alone = raised.scene.varied({"drive.times": None, "drive.torques": None, "drive.smooth": False})
    run = fl.simulate(alone.varied({"drive.gravity": "static"}))
    assert np.linalg.norm(run.tip - raised.run.tip, axis=1).max() > 5e-3


@pytest.mark.parametrize("delay", [0.0, 0.0033])
def test_sampled_drives_with_delay_follow_as_well(delay: float) -> None:
    """The torques hold for 2 ms and are late, also by parts of a sample."""
    run = fl.RunSettings(tolerance=1e-5, duration=1.5, sample=0.01)
    found = fl.invert(two_links(**{"drive.rate": 500.0, "drive.delay": delay, "run": run}))
    assert found.error < 1e-5


def test_the_tip_moves_along_a_straight_line() -> None:
    scene = two_links()
    chain = fl.lump(scene)
    begin = fl.tip_position(chain, fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active).q)
    goal = begin + np.array([0.6, 0.0, -0.4])
    found = fl.invert(scene, goal, duration=1.0)
    way = (goal - begin) / np.linalg.norm(goal - begin)
    off = found.run.tip - begin - np.outer((found.run.tip - begin) @ way, way)
    assert np.abs(off).max() < 1e-6
    assert found.run.tip[-1] == pytest.approx(goal, abs=1e-6)
    assert np.ptp(found.joints, axis=0).min() > 0.1
    assert found.shaped().lag > 0.01


GOAL = ("1", "-0.2", "0.5")
RIGID = (("segments", 1), ("flex", "rigid"))
REFUSED: dict[str, tuple[str, dict[str, object]]] = {
    "no-drive": ("inversion-not-possible", {"drive": fl.Drive()}),
    "prescribed": (
        "inversion-not-possible",
        {
            "drive.kp.fore": 0.0,
            "drive.kd.fore": 0.0,
            "motion": [
                {"link": "fore", "times": [0.0], "angle_deg": [-10.0], "rate_deg": [0.0], "acceleration_deg": [0.0]}
            ],
        },
    ),
    "wrench": ("inversion-not-possible", {"wrench": fl.Wrench(force=(0.0, 0.0, 1.0), frame="tip")}),
    "moving": ("inversion-not-possible", {"initial.rate_deg": (0.0, 1.0, 0.0)}),
    "rigid": (
        "inversion-not-possible",
        {f"link.{name}.{key}": value for name in ("upper", "fore") for key, value in RIGID},
    ),
    "no-move": ("no-travel", {"drive.reference.to_deg": (0.0, -80.0, -10.0)}),
    "no-reference": ("missing-key", {"drive.reference": None, "drive.target_deg": (0.0, -80.0, -10.0)}),
    "jump": ("reference-not-smooth", {"drive.reference.profile": "trapezoidal"}),
    "stretched": ("tip-not-controlled", {"drive.reference.to_deg": (0.0, -60.0, 20.0)}),
    "effort": ("move-beyond-effort", {"drive.effort": (1.0, 105.0, 90.0)}),
    "effort-to-hold": ("move-beyond-effort", {"drive.effort": (1.0, 60.0, 90.0)}),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_inverted_is_refused(case: str) -> None:
    id, changes = REFUSED[case]
    with refused(fl.errors.SceneError, id):
        fl.invert(two_links(**changes))


def test_the_duration_that_a_refusal_names_is_within_the_torque_limit() -> None:
    effort = (1.0, 105.0, 90.0)
    with pytest.raises(fl.errors.SceneError) as caught:
        fl.invert(two_links(**{"drive.effort": effort}))
    longer = float(str(caught.value).split("move of ")[1].split(" s")[0])
    found = fl.invert(two_links(**{"drive.effort": effort, "drive.reference.duration": longer, "run.duration": 4.0}))
    assert found.met
    assert (np.abs(found.run.tau[:, found.run.chain.active]) <= effort[1:]).all()


def test_a_free_base_is_refused() -> None:
    with refused(fl.errors.SceneError, "inversion-not-possible"):
        fl.invert(fl.load_scene("models/satellite.toml"))


def test_arguments_are_checked() -> None:
    scene = two_links()
    cases: dict[str, dict[str, Any]] = {
        "missing-key": {"to": (1.0, 0.0, 1.0)},
        "needs-another-argument": {"duration": 1.0},
        "tip-out-of-reach": {"to": (5.0, 0.0, 0.0), "duration": 1.0},
    }
    for id, arguments in cases.items():
        with refused(fl.errors.ArgumentError, id):
            fl.invert(scene, **arguments)


def test_zeros_on_the_imaginary_axis_are_refused_with_a_duration_that_works() -> None:
    """A tip with rotary inertia can swing about a point at rest."""
    heavy = {"tip.inertia": (0.005,) * 3, "run.duration": 3.0}
    with refused(fl.errors.SceneError, "zeros-on-axis") as caught:
        fl.invert(pulse_arm(turn(), **heavy))
    longer = float(str(caught.value).split("a move of ")[1].split(" s")[0])
    assert fl.invert(pulse_arm(turn(longer), **heavy)).error < 1e-4


def test_a_move_without_a_bounded_motion_is_refused() -> None:
    with refused(fl.errors.ConvergenceError, "inversion-diverged"):
        fl.invert(pulse_arm(turn(0.15)))


def test_a_missed_path_is_reported() -> None:
    for scene in two_links(), two_links(**{"drive.rate": 1000.0}):
        found = fl.invert(scene, tolerance=1e-12)
        assert not found.met
        ids = ["tip-off-path", "beam-off-path"]
        assert [warning.id for warning in found.warnings] == ids
        for warning in found.warnings:
            reviewed(warning.id, str(warning), values=False)


def small_turn(beam: hub_beam.Beam, h: float, turns: tuple[float, float], lumping: tuple[str, int]) -> fl.Scene:
    """A steel beam of thickness h on a hub under PD, turned by degrees in seconds, divided by a rule."""
    inertia, (degrees, seconds) = beam.hub + beam.rho_a * beam.length**3 / 3 + beam.tip_mass * beam.length**2, turns
    kp = inertia * (2.0 / seconds) ** 2
    move = fl.Reference(profile="quintic", to_deg=(degrees,), duration=seconds)
    drive = fl.Drive(kind="pd", kp=(kp,), kd=(1.4 * np.sqrt(kp * inertia),), reference=move)
    link = fl.Link(
        name="link", length=beam.length, flex="z", material="steel", section="thin", lumping=lumping[0],
        segments=lumping[1], joint=fl.Joint(armature=beam.hub),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"steel": fl.Material(young=210e9, density=7850.0)},
        sections={"thin": fl.Section(shape="rectangle", width=0.04, height=h)}, tip=fl.RigidBody(mass=beam.tip_mass),
    )  # fmt: skip
    run = fl.RunSettings(duration=2 * seconds, tolerance=1e-8)
    return fl.Scene(name="turn", arm=arm, gravity=(0, 0, 0), drive=drive, run=run)


def error_of_beam(found: Inversion, beam: hub_beam.Beam) -> tuple[float, float]:
    """Largest error of a continuous beam's tip under the drive of an inversion, and its largest deflection [m]."""
    drive, steps = found.scene.drive, 4000
    assert isinstance(drive.reference, fl.Reference)
    assert drive.reference.angle_deg is not None
    t = np.linspace(0.0, found.run.t[-1], steps + 1)
    middle = (t[:-1] + t[1:]) / 2
    known = np.clip(middle, drive.times[0], drive.times[-1])
    joint = CubicSpline(drive.reference.times, np.radians(np.array(drive.reference.angle_deg)[:, 0]))
    kp, kd = drive.kp[0], drive.kd[0]
    torques = np.interp(known, drive.times, np.array(drive.torques)[:, 0])
    torques += kp * joint(known) + kd * np.where(middle == known, joint(known, 1), 0.0)
    law = hub_beam.Drive(kp=kp, kd=kd, jumps=tuple(t[:-1]), torques=tuple(torques))
    motion = hub_beam.simulate(beam, law, t[::10], count=8, finer=10)
    (x, y), way = motion.tip().T, CubicSpline(found.times, found.path)
    to = way(np.clip(t[::10], found.times[0], found.times[-1]))
    off = beam.length * np.abs(np.arctan2(y, x) - np.arctan2(to[:, 1], to[:, 0])).max()
    return float(off), float(np.abs(motion.q @ motion.modes.at(beam.length, 0)[:, 0]).max())


@pytest.mark.slow
def test_the_error_in_a_continuous_beam_is_stated_for_coarse_arms() -> None:
    """`hub_beam` leaves out terms of third order in the deflection w: up to w³/L² of the tip's position."""
    rng, stated = np.random.default_rng(5), []
    for lumping in (("midpoint", 2), ("gauss", 3), ("midpoint", 4), ("lobatto2", 5), ("gauss", 5)):
        L, h = rng.uniform(0.6, 1.2), rng.uniform(0.002, 0.005)
        EI, rho_a = 210e9 * 0.04 * h**3 / 12, 7850 * 0.04 * h
        beam = hub_beam.Beam(
            L, EI, rho_a, tip_mass=rng.uniform(0.1, 1) * rho_a * L, hub=rng.uniform(0.1, 1) * rho_a * L**3
        )
        period = 2 * np.pi * L**2 / 1.875**2 * np.sqrt(rho_a / EI)  # of the beam, clamped, without its payload
        scene = small_turn(beam, h, (rng.uniform(0.3, 1), rng.uniform(1, 2) * period), lumping)
        found = fl.invert(scene)
        exact, w = error_of_beam(found, beam)
        left_out = w**3 / L**2
        assert left_out < 0.1 * exact
        assert 0.75 * (exact - left_out) < found.beam_error < 1.15 * (exact + left_out)
        stated.append(found.error / exact)
    assert max(stated) < 0.01  # the run with the same segments does not show it


def test_a_fast_move_of_three_segments_is_reported_and_has_no_fixed_step() -> None:
    beam = hub_beam.Beam(0.97, 210e9 * 0.04 * 0.0027**3 / 12, 7850 * 0.04 * 0.0027, tip_mass=0.34, hub=0.118)
    scene = small_turn(beam, 0.0027, (30.0, 0.3), ("gauss", 3))
    found = fl.invert(scene.varied({"run.tolerance": None, "run.method": "RK4", "run.step": 1e-4}))
    assert found.met
    exact, w = error_of_beam(found, beam)
    assert 0.75 * (exact - w**3) < found.beam_error < 1.15 * (exact + w**3)
    (warning,) = found.warnings
    reviewed(warning.id, str(warning), values=False)
    finer = scene.varied({"link.link.segments": 9})
    assert fl.invert(finer).beam_error < found.beam_error / 20


def test_the_error_of_a_beam_is_not_known_if_its_run_fails(raised: Inversion) -> None:
    few = raised.scene.varied({"run.method": "auto", "run.tolerance": 1e-6, "run.max_evaluations": 10.0})
    unknown = replace(raised, scene=few)
    assert unknown.beam_error == np.inf
    (warning,) = unknown.warnings
    reviewed(warning.id, str(warning), values=False)


def test_the_command_writes_a_scene_and_prints_the_gain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "moved.toml"
    command = ["invert", "models/ptp_move.toml", "--set", "run.duration=2"]
    assert main([*command, "--out", str(out)]) == 0
    reviewed("invert", (shown := capsys.readouterr().out).rpartition("\n")[0].rpartition("\n")[0], values=False)
    assert re.findall(r"within (\S+) mm", shown) == ["1", "1"]  # by default
    assert fl.load_scene(out).drive.torques is not None
    assert main([*command, "--tip", *GOAL, "--duration", "1", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["tip_error_m"] < 1e-4 < said["shaped"]["lag_m"]
    assert len(said["largest_torques"]) == 3


def test_the_largest_torque_may_be_negative() -> None:
    chain = fl.lump(fl.load_scene("models/ptp_move.toml"))
    torques = np.array([[1.0, -2.0, 0.5], [-3.0, 1.0, 0.0]])
    found: Any = SimpleNamespace(run=SimpleNamespace(chain=chain), torques=torques)
    assert [x for *_, x in _torques(found)] == [3.0, 2.0, 0.5]


FOLLOWING = {"drive.reference.follows": "tip", "drive.reference.start": 0.1, "initial.passive": "static"}


def test_a_reference_that_the_tip_follows_is_inverted_when_a_run_is_prepared(tmp_path: Path) -> None:
    scene = two_links(**FOLLOWING)
    found = fl.invert(two_links(**{"drive.reference.start": 0.1}))
    scene = fl.load_scene(scene.varied({"run.duration": found.run.t[-1]}).save(tmp_path / "following.toml"))
    run = fl.simulate(scene)
    assert run.tip == pytest.approx(found.run.tip, abs=1e-9)
    half = fl.simulate(scene, duration=0.5)
    rest = fl.simulate(scene, after=half, duration=float(run.t[-1]) - 0.5)
    assert rest.tip[-1] == pytest.approx(run.tip[-1], abs=1e-9)
    again = fl.invert(scene)
    assert again.error < 1e-6
    assert again.scene.document()["drive"]["reference"]["follows"] == "joints"


@pytest.mark.parametrize(
    ("id", "changes"),
    [
        ("move-too-early", {"drive.reference.start": 0.0}),
        ("springs-start-slack", {"initial.passive": "zero"}),
        ("start-differs-from-motion", {"drive.reference.from_deg": (0.0, -79.0, -10.0)}),
        ("both-given", {"drive.gravity": "static"}),
        ("both-given", {"drive.times": (0.0,), "drive.torques": ((0.0, 1.0, 1.0),)}),
        ("both-given", {"drive.reference.shaper": fl.InputShaper(kind="ZV", frequency_hz=(2.0,))}),
        ("needs-pd", {"drive.kind": "computed_torque"}),
        ("wrench-out-of-reach", {"link.fore.joint.limits_deg": (-60.001, 0.0)}),
    ],
)
def test_references_that_the_tip_cannot_follow_are_refused(id: str, changes: dict[str, Any]) -> None:
    with refused(fl.errors.SceneError, id):
        fl.Problem(
            two_links(**FOLLOWING, **{key: value for key, value in changes.items() if key not in FOLLOWING}).varied(
                changes
            )
        )


def test_a_pd_drive_adds_its_table_of_torques() -> None:
    rows: dict[str, Any] = {"times": (0.0, 1.0), "torques": ((0.0, 2.0, 0.0), (0.0, 4.0, 1.0))}
    drive = fl.Drive(kind="pd", kp=(0.0, 4e3, 4e3), kd=(0.0, 40.0, 40.0), target_deg=(0.0, -80.0, -10.0), **rows)
    run = fl.simulate(two_links(drive=drive, **{"run.duration": 0.5}))
    k = run.chain.active
    law = 4e3 * (np.radians([-80.0, -10.0]) - run.q[:, k]) - 40.0 * run.qd[:, k]
    table = np.column_stack([2.0 + 2.0 * run.t, run.t])
    assert run.tau[:, k] == pytest.approx(law + table, abs=1e-9)


@pytest.mark.parametrize(
    ("id", "changes"),
    [
        ("missing-key", {"times": (0.0,)}),
        ("missing-key", {"torques": ((1.0,),)}),
        ("both-given", {"times": (0.0,), "torques": ((1.0,),), "gravity": "static"}),
        ("both-given", {"times": (0.0,), "torques": ((1.0,),), "file": "torques.csv"}),
        ("key-of-another-kind", {"times": (0.0,), "torques": ((1.0,),), "hold": True}),
    ],
)
def test_tables_of_pd_drives_are_checked(id: str, changes: dict[str, Any]) -> None:
    with refused(fl.errors.SceneError, id):
        fl.Drive(kind="pd", kp=(1.0,), kd=(1.0,), target_deg=(0.0,), **changes)
