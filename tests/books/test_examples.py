"""Every script in `examples/` runs in its folder or the checkout's root, is short, and gives the described results."""

import ast
import runpy
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import flexlink as fl
from tests.conftest import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
Figures = Callable[[str], dict[str, Any]]


@pytest.fixture
def figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Figures]:
    """Results of a script by variable name; the script runs in a temporary folder where it may write."""
    plt.switch_backend("Agg")
    (tmp_path / "models").symlink_to(ROOT / "models")
    folder = tmp_path / "examples"
    folder.mkdir()
    for data in (ROOT / "examples").glob("*.urdf"):
        (folder / data.name).symlink_to(data)
    monkeypatch.chdir(folder)

    def run(name: str) -> dict[str, Any]:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
        for panel in (panel for number in plt.get_fignums() for panel in plt.figure(number).axes):
            assert "[" in panel.get_ylabel() + panel.get_xlabel(), "axis labels have units"
            assert len(panel.lines) < 2 or panel.get_legend() is not None
        return found

    yield run
    plt.close("all")


def code_of(path: Path) -> list[str]:
    """Lines of a script without blank lines, comments and the docstring at the top."""
    text = path.read_text(encoding="utf-8")
    body = text.splitlines()[ast.parse(text).body[0].end_lineno :]
    return [line for line in body if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_has_a_title_and_is_tested(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    title, line, empty, *_ = ast.get_docstring(ast.parse(text)).splitlines()
    assert line == "=" * len(title)
    assert not empty
    assert len(code_of(path)) <= 70
    assert f'figures("{path.stem}")' in Path(__file__).read_text(encoding="utf-8")


def test_the_gallery_names_every_example_once() -> None:
    text = (ROOT / "examples" / "GALLERY_HEADER.rst").read_text(encoding="utf-8")
    assert [path.stem for path in EXAMPLES if text.count(f"gallery_{path.stem}.py>") != 1] == []


def test_a_script_runs_from_the_checkouts_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    plt.switch_backend("Agg")
    for name in ("two_mass_joint", "robot_from_urdf"):
        runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
    plt.close("all")


@pytest.mark.slow
def test_the_arm_of_figure_5_swings_by_ten_degrees_and_bends_by_a_thousandth_degree(figures: Figures) -> None:
    found = figures("paper_figure5")
    run, chain = found["run"], found["chain"]
    swings, bends = (np.degrees(np.abs(run.q[:, own] - run.q[0, own]).max()) for own in (chain.active, chain.bending))
    assert swings > 10
    assert 1e-3 < bends < 3e-3
    assert found["lost"] < 1e-6


@pytest.mark.slow
def test_the_crane_example_reaches_its_target_and_writes_a_film(figures: Figures) -> None:
    found = figures("crane")
    run, chain = found["run"], found["chain"]
    np.testing.assert_allclose(np.degrees(run.q[-1, chain.active]), (60.0, -55.0), atol=0.5)
    assert not run.warnings
    fine = fl.lump(found["scene"].varied({"link.*.segments": 13}))
    bent, _ = fl.initial_state(found["scene"].varied({"link.*.segments": 13}), fine)
    assert found["swing"] == pytest.approx(fl.modes(fine, bent, locked=["boom", "jib"]).hertz[0], rel=2e-3)
    assert fl.tip_position(fine, bent)[1] == pytest.approx(fl.tip_position(chain, found["bent"])[1], abs=2e-3)
    with Image.open("crane.gif") as film:
        assert film.n_frames >= 36, "six seconds, twice as fast, at 12 frames a second"


@pytest.mark.slow
def test_the_cylinders_bear_the_crane_and_lower_its_frequency_nearly_by_dunkerleys_rule(figures: Figures) -> None:
    """The rule is exact for one mass; those of the links change the mode by a percent, and oil the posture."""
    found = figures("crane_cylinders")
    run, (own, cylinders, _) = found["run"], map(np.array, found["first"].values())
    np.testing.assert_allclose(own, found["dunkerley"], rtol=0.02)
    assert np.all(1.7 * own < cylinders)
    at = complex(*found["lift"].point[:2]) * np.exp(1j * run.q[0, 0])  # x + i y of the rod's end on the boom
    rod = at - complex(*found["lift"].to.point[:2])
    force = run.chain.com(run.q[0])[0] * run.chain.weight / (np.conj(at) * rod / abs(rod)).imag
    assert -run.tie_forces["lift"][0] == pytest.approx(force, rel=5e-3), "but for bending between joint and cylinder"


@pytest.mark.slow
@pytest.mark.first
def test_the_palletizers_hand_tilts_with_the_strain_of_its_rods_and_not_with_its_beams(figures: Figures) -> None:
    tilt = {name: float(values[0]) for name, values in figures("palletizer")["tilt"].items()}
    moment, arms = 60.0 * 9.81 * 0.1, 0.25 * np.array([np.sin(np.radians(120.0)), np.cos(np.radians(10.0))])  # N m, m
    assert tilt["elastic rods"] - tilt["rigid rods"] == pytest.approx(-np.sum(moment / arms**2 / 2e7), rel=2e-3)
    assert abs(tilt["rigid rods"]) < 1e-3 * abs(tilt["wrist motor"])


@pytest.mark.slow
def test_a_gear_with_play_oscillates_as_its_describing_function_predicts(figures: Figures) -> None:
    found = figures("gear_with_play")
    np.testing.assert_allclose(found["measured"], found["predicted"], rtol=0.05)  # without higher harmonics


@pytest.mark.slow
def test_a_rigid_jib_hits_its_stop_as_in_closed_form_and_one_that_bends_more_softly(figures: Figures) -> None:
    """Samples miss the peak of sin ωt by up to (ω h)²/8; an error of the tip, divided by the length, deepens it."""
    found = figures("slewing_stop")
    k, closed, scene = found["stiffness"], found["closed"], found["scene"]
    bends, rigid = map(np.array, found["peak"].values())
    missed, deeper = k / found["inertia"] * 5e-3**2 / 8, k * scene.run.tolerance / found["LENGTH"] / closed
    assert np.all(rigid > (1 - missed - deeper) * closed) and np.all(rigid < (1 + deeper) * closed)
    assert np.all(np.diff(bends) > 0) and np.all(bends < closed) and bends[-1] < 1.2 * bends[-2]


def test_an_imported_robot_bends_only_in_the_chosen_links(figures: Figures) -> None:
    found = figures("robot_from_urdf")
    scene, off = found["moved"], found["off"]
    assert [link.name for link in scene.arm.links if link.flex != "rigid"] == ["upper_arm", "forearm"]
    upper = scene.varied({"link.forearm.flex": "rigid", "link.forearm.segments": 1, "gravity": (0.0, 0.0, 0.0)})
    chain = fl.lump(upper.varied({"initial.passive": "zero"}))
    clamped = fl.modes(chain, fl.initial_state(upper, chain)[0], locked=chain.active)
    assert clamped.hertz[0] == pytest.approx(8.0, rel=1e-2), "8 Hz was measured; the link has five segments"
    assert not found["run"].warnings
    assert off[-1] == pytest.approx(off[0], rel=1e-2), "the turntable is vertical: the arm sags as before the move"
    assert off.max() > 1.2 * off[0]


@pytest.mark.slow
def test_input_shaping_leaves_a_twentieth_of_the_vibration(figures: Figures) -> None:
    found = figures("ptp_move")
    left, settled = found["left"], found["settled"]
    assert left["unshaped"] > 5e-3, "the unshaped move vibrates"
    assert left["ZVD"] < left["ZV"] < 0.05 * left["unshaped"]
    assert settled["ZV"] < settled["ZVD"] < 2.0 < settled["unshaped"] < np.inf
    assert not any(run.warnings for run in found["runs"].values())
    own = found["move"].shaper
    np.testing.assert_allclose(own.frequency_hz, np.abs(found["slow"]) / (2 * np.pi), rtol=1e-4)
    np.testing.assert_allclose(own.damping, -found["slow"].real / np.abs(found["slow"]), rtol=2e-3)


@pytest.mark.slow
def test_computed_torque_on_a_rigid_arm_is_exact_except_for_sampling_errors(figures: Figures) -> None:
    """A sampled torque lags by half a sample: ë + kd ė + kp e = jerk/(2 rate), with jerk ≤ 60 |goal − start|/s³."""
    found = figures("computed_torque")
    (rigid, _), (bending, away) = found["found"]["rigid"], found["found"]["bending"]
    scene, (goal, _, _) = found["bending"], found["reference"](1.0)
    start = np.radians(scene.initial.joint_deg)
    late = 60.0 * np.abs(goal - start).max() / (2 * scene.drive.rate * scene.drive.kp[0])
    assert 0.1 * late < rigid < late
    assert bending > 10 * rigid
    there = scene.varied({"initial.joint_deg": tuple(np.degrees(goal)), "drive": fl.Drive()})
    chain = fl.lump(there)
    bent = fl.tip_position(chain, fl.initial_state(there, chain)[0])
    sag = np.linalg.norm(bent - fl.tip_position(found["model"], goal))
    assert sag / 2 < away[-1] < 2 * sag, "the rigid model ignores the sag"


@pytest.mark.slow
def test_the_controlled_nonlinear_arm_has_the_poles_of_the_linear_model(figures: Figures) -> None:
    """The integration error |λh|⁴/120 of RK4 is largest for the fastest pole, and far below the required 1 %."""
    found = figures("lqr")
    designed, poles, step = found["designed"], found["poles"], found["scene"].run.step
    fastest = np.abs(designed).max() * step
    assert designed.real.max() < 0, "stable"
    for one, other in ((designed, poles), (poles, designed)):
        assert np.all(np.abs(one[:, None] - other).min(axis=1) < np.minimum(0.01, fastest**4 / 60) * np.abs(one))
    assert found["away"][-1] < 1e-3 * found["away"][0], "also from far away"
    assert not found["far"].warnings


def test_an_elastic_gear_oscillates_at_its_closed_form_frequency(figures: Figures) -> None:
    """The error of RK10, (ωh)¹¹ per step, is below the accumulated rounding of the rates, ε twist ω per step."""
    found = figures("two_mass_joint")
    assert found["free"] == pytest.approx(found["omega"], rel=1e-12)
    assert found["held"] == pytest.approx(np.sqrt(found["k"] / found["inertia"]), rel=1e-12)
    t, rates = found["run"].t, found["twist"] * found["omega"]
    assert found["error"] < len(t) * np.finfo(float).eps * rates * t[-1]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Box observation space")  # joints may turn without limits
def test_the_gymnasium_environment_example_works(figures: Figures) -> None:
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    found = figures("gym_environment")
    env = found["ArmEnv"]()
    checker.check_env(env, skip_render_check=True)
    assert len(found["rewards"]) == 300
    assert found["rewards"][-1] > 0.05 * found["rewards"][0], "the arm reaches its target except for its sag"
    chain = env.arm.chain
    most = np.abs(fl.gravity_torque(chain, np.zeros(chain.n))[chain.active]).max(initial=0.0)
    assert 2.0 * most < found["EFFORT"].max(), "twice the gravity torque of the stretched arm"
    first, _ = env.reset(seed=7)
    assert np.linalg.norm(first[-6:-3] - first[-3:]) > 0.1
    rewards, ended = [], False
    while not ended:
        _, q, qd = env.arm.state
        hold = fl.gravity_torque(chain, q)[chain.active] - 50.0 * qd[chain.active]
        _, reward, lost, ended, _ = env.step(hold / found["EFFORT"])
        rewards.append(reward)
        assert not lost
    assert len(rewards) == round(found["EPISODE"] / found["PERIOD"])
    assert rewards[-1] == pytest.approx(rewards[0], abs=0.02), "gravity is compensated, and nothing else moves the arm"


@pytest.mark.slow
def test_the_batch_of_gymnasium_environments_restarts_its_arms(figures: Figures) -> None:
    pytest.importorskip("gymnasium")
    found = figures("gym_vector_environment")
    env, rewards = found["env"], np.array(found["rewards"])
    assert rewards.shape == (300, 64)
    assert (rewards[-1] > 0.1 * rewards[0]).all(), "every arm reaches its target except for its sag"
    assert env.over.all()
    seen, reward, lost, late, _ = env.step(env.action_space.sample())
    assert not reward.any() and not lost.any() and not late.any() and env.observation_space.contains(seen)
    single = fl.Simulator(found["SCENE"].varied({"tip.mass": 2.0}))
    np.testing.assert_allclose(seen[0, : single.chain.n], single.step(np.zeros(3), duration=found["PERIOD"]).q)
    action = np.zeros((64, 3))
    before = env.arms.state.q
    action[5] = np.nan
    with pytest.raises(fl.errors.ArgumentError):
        env.step(action)
    np.testing.assert_array_equal(env.arms.state.q, before)


@pytest.mark.slow
def test_state_feedback_with_an_observer_works_nearly_as_well_as_with_the_true_state(figures: Figures) -> None:
    found = figures("lqr_observer")
    A, B, C, K, L = (found[name] for name in ("A", "B", "C", "K", "L"))
    for loop in (A - B @ K, A - A @ L @ C):  # poles of the regulator and of the estimation error: separation principle
        assert np.abs(np.linalg.eigvals(loop)).max() < 1
    off = {name: np.linalg.norm(run.tip - found["goal"], axis=1) for name, run in found["runs"].items()}
    assert off["Kalman filter"][0] > 0.3
    assert off["Kalman filter"][-1] < 1e-3
    assert not any(run.warnings for run in found["runs"].values())


@pytest.mark.slow
def test_the_beam_of_the_spin_up_example_has_the_published_tip_lag(figures: Figures) -> None:
    found = figures("spin_up")
    errors = [abs(-lag.min() / 0.5712309680 - 1) for lag in found["lags"].values()]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 5e-3
    assert all(abs(lag[-100:]).max() < 0.01 for lag in found["lags"].values()), "the beam is straight again"


def test_a_strip_buckles_at_the_euler_load_and_follows_the_elastica(figures: Figures) -> None:
    """Tip angles for each load are given by Timoshenko and Gere, Theory of Elastic Stability, table 2-4."""
    found = figures("buckling")
    errors = np.array(list(found["factors"].values())) / found["euler"] - 1
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.05)
    assert abs(errors[-1]) < 1e-3
    angles = [abs(np.degrees(rest.q.sum())) for rest in found["shapes"].values()]
    np.testing.assert_allclose(angles, [0, 20, 40, 60, 80], atol=1.0)
    assert all(rest.stable for rest in found["shapes"].values())


@pytest.mark.slow
def test_rows_of_a_sweep_equal_single_runs(figures: Figures) -> None:
    found = figures("payload_sweep")
    table, bend = found["table"], found["bend"]
    assert len(table) == 30
    assert not found["rows"].failed
    assert (bend.diff().dropna() > 0).all(axis=None), "more payload increases the bending"
    assert (bend.loc[2.0:].diff(axis=1).iloc[:, 1:] < 0).all(axis=None), "a thicker wall reduces it"
    member = table.iloc[7]
    keys = {key: float(member[key]) for key in ("tip.mass", "section.tube.inner")}
    alone = fl.simulate(found["scene"].varied(keys | {"run.outputs": ("torques",)}))
    assert np.abs(alone.columns["tau arm [N m]"]).max() == member["torque [N m]"]


@pytest.mark.slow
def test_the_advice_example_meets_its_tolerance(figures: Figures) -> None:
    found = figures("advice")
    assert found["found"].met
    assert found["off"].max() <= found["found"].error <= 1e-3
    assert found["small"].chain.n < 20


@pytest.mark.slow
def test_the_report_example_writes_one_page_that_passes(figures: Figures) -> None:
    pytest.importorskip("pinocchio")
    found = figures("report_on_an_arm")
    written, run = found["written"], found["run"]
    assert written.passed
    assert not written.failures
    assert written.page.stat().st_size > 1e5
    arm = run.chain.com(run.q[0])[0] * run.chain.weight
    assert -found["root"][0] == pytest.approx(arm, rel=1e-6), "at rest the root bears the weight"


@pytest.mark.slow
def test_the_fit_example_recovers_the_true_parameters(figures: Figures) -> None:
    found = figures("fit_to_measurement")
    truth = np.array(list(found["truth"].values())) / found["units"]
    fit, spread = found["fit"], found["spread"]
    assert np.all(np.abs(fit.x - truth) < 4 * spread), "within four standard deviations"
    assert np.all(spread < 0.03 * truth)
    assert np.all(np.abs(found["start"] - truth) > 10 * spread), "the initial guess is far from the truth"
    assert fit.njev <= 10
    slopes = found["jacobian"](truth)
    for k, small in enumerate(1e-4 * truth):
        ends = [found["residual"](truth + sign * small * np.eye(3)[k]) for sign in (1, -1)]
        np.testing.assert_allclose(slopes[:, k], (ends[0] - ends[1]) / (2 * small), atol=1e-4 * abs(slopes[:, k]).max())


@pytest.mark.slow
def test_the_compare_example_finds_both_mistakes_in_a_foreign_file(figures: Figures) -> None:
    pytest.importorskip("mujoco")
    found = figures("foreign_mjcf")["found"]
    assert not found.passed
    (diagnosis,) = found.diagnoses
    assert [finding.id for finding in diagnosis.findings] == ["gravity-differs", "stiffness-differs"]
    assert diagnosis.explained
    assert {row.quantity for row in found.rows if row.passed} == {"M", "T_FR"}


@pytest.mark.slow
def test_every_notebook_cell_shows_a_result(figures: Figures) -> None:
    assert figures("notebook")["run"].t[-1] == 1.0
    names: dict[str, Any] = {}
    for cell in (ROOT / "examples" / "notebook.py").read_text(encoding="utf-8").split("# %%"):
        *lines, last = ast.parse(cell).body
        exec(compile(ast.Module(lines, []), "cell", "exec"), names)
        assert isinstance(last, ast.Expr)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        assert any(hasattr(value, name) for name in ("_repr_html_", "_repr_png_")), cell
