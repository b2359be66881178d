"""`propose` ranks further measurements; following its first proposal makes confounded parameters identifiable."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import SceneError
from flexlink.describe.writing import without_defaults
from flexlink.fits import Experiments, FitParameter, FitProblem, FitRun, Proposals, propose
from flexlink.identification.candidates import sensors_on
from flexlink.identification.experiments import ColumnExperiment, PriorExperiment
from tests.conftest import ROOT
from tests.support.experiments_made import followed, recorded, sagged, tapped, together
from tests.support.fits import CLAMPED, problem, write_csv
from tests.support.words import refused, reviewed

BARE = CLAMPED.varied({"tip.mass": 0.0, "link.l.root_stiffness": None})
ROD = fl.Scene(
    name="rod",
    gravity=(0.0, 0.0, 0.0),
    arm=fl.Arm(links=(fl.Link(name="l", length=0.5, joint=fl.Joint(armature=0.1, viscous=0.05)),),
               tip=fl.RigidBody(mass=0.8)),
    drive=fl.Drive(kind="constant", torque=(0.5,)),
    run=fl.RunSettings(duration=1.0, sample=0.01, relative_tolerance=1e-9),
)  # fmt: skip
SERVO = ROD.varied({"drive": fl.Drive(kind="pd", kp=(20.0,), kd=(1.0,), target_deg=(40.0,))})
E, RHO, H, B = "material.steel.young", "material.steel.density", "section.strip.height", "section.strip.width"
M, ARMATURE, ROOT_SPRING, KD = "tip.mass", "link.l.joint.armature", "link.l.root_stiffness.z", "drive.kd.l"
VISCOUS, Q = "link.l.joint.viscous", {"q l [rad]": 1e-4}
SET_UPS = {
    "E / ρ": (BARE, (E, RHO), tapped(2)), "E b": (CLAMPED, (E, B), sagged(0.1)),
    "E-ρ-h, which needs two": (BARE, (E, RHO, H), tapped(2)), "payload / armature": (ROD, (M, ARMATURE), recorded(Q)),
    "kd / viscous": (SERVO, (KD, VISCOUS), recorded(Q)), "root spring / E": (CLAMPED, (ROOT_SPRING, E), sagged(0.1)),
    "payload / E": (CLAMPED, (M, E), tapped(1)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SET_UPS)
def test_following_the_first_proposal_makes_confounded_parameters_identifiable(name: str, rng) -> None:
    scene, paths, poor = SET_UPS[name]
    truth = scene.varied({p: scene.values_at(p)[0] * (1.03 if k % 2 else 0.98) for k, p in enumerate(paths)})
    start = problem(scene, paths, **poor(truth, rng))
    found = propose(start)
    assert not found.check.passed and not fl.fits.check_fit(start).passed
    assert found.first is not None and found.first.lost == 0
    assert (len(found.first.candidates) > 1) == ("two" in name)
    after = followed(start, found.first.additions, truth, rng)
    assert fl.fits.check_fit(after).passed
    fit = fl.fit(after, grid="ignore")
    for path in paths:
        true = truth.values_at(path)[0]
        assert abs(fit[path].value - true) < 4 * fit[path].deviation + 1e-9 * true


@pytest.fixture(scope="module")
def found() -> Proposals:
    """Proposals for E and ρ of a bare strip from two frequencies, known to 0.2 %."""
    return propose(problem(BARE, (E, RHO), **tapped(2)(BARE, np.random.default_rng(0))))


@pytest.mark.slow
def test_predicted_intervals_follow_beam_theory(found: Proposals) -> None:
    """A static deflection δ = F L³ / (3 E I) gives σ_E / E = σ_δ / δ; the frequencies then give ρ from E / ρ."""
    (one,) = [one for one in found.ranked if one.candidates[0].experiment == "weight on the tip"]
    (sag,) = one.additions
    force = sag.set["wrench.force"][1]
    δ = force * 0.4**3 / (3 * 2.1e11 * 0.03 * 0.001**3 / 12)
    assert sag.value == pytest.approx(δ, rel=0.03)  # four segments
    young, density = (change.after for change in one.changes)
    assert young == pytest.approx(sag.deviation / δ, rel=0.05)
    assert density == pytest.approx(np.hypot(young, 2 * 2e-3 / np.sqrt(2)), rel=0.05)
    assert all(np.isinf(change.before) for change in one.changes)


@pytest.mark.slow
def test_a_prior_gives_the_interval_that_it_states(found: Proposals) -> None:
    (one,) = [one for one in found.ranked if one.candidates[0].experiment == "weigh and measure a sample"]
    assert one.changes[1].after == pytest.approx(0.01, rel=1e-3)
    assert one.additions[0].prior == pytest.approx((7850.0, 78.5))


@pytest.mark.slow
def test_the_better_experiment_ranks_first_and_separates_the_pair(found: Proposals) -> None:
    worst = [max(change.after for change in one.changes) for one in found.ranked]
    assert worst == sorted(worst)
    ((direction, best),) = found.separating
    assert set(direction.names) == {E, RHO}
    assert best is not None and not next(one for one in found.ranked if one.candidates[0] == best).lost


@pytest.mark.slow
def test_the_printed_table_is_part_of_a_problem_file(found: Proposals, tmp_path: Path) -> None:
    for one in found.ranked:
        (addition,) = one.additions
        table = tomllib.loads(one.toml)
        ((key, (only,)),) = table.items()
        assert only.get("path", addition.path if key == "parameter" else "") == getattr(addition, "path", "")
    BARE.save(tmp_path / "strip.toml")
    text = 'scene = "strip.toml"\n' + "".join(f'[[parameter]]\npath = "{path}"\n' for path in (E, RHO))
    best = next(one for one in found.ranked if one.candidates[0].experiment == "weight on the tip")
    (tmp_path / "problem.toml").write_text(f"{text}{best.toml}", encoding="utf-8")
    (read,), (meant,) = fl.fits.FitProblem.load(tmp_path / "problem.toml").static, best.additions
    assert without_defaults(read) == without_defaults(meant)


@pytest.mark.slow
def test_at_the_solution_of_a_fit_the_present_intervals_are_those_of_the_fit(rng: np.random.Generator) -> None:
    fit = fl.fit(problem(CLAMPED, (E, M), **together(tapped(2), sagged(0.1))(CLAMPED, rng)))
    found = propose(fit)
    assert found.of_fit and dict(found.values)[E] == pytest.approx(fit[E].value, rel=1e-12)
    for change, one in zip(found.ranked[0].changes, fit.numbers, strict=True):
        assert change.before * change.size == pytest.approx(np.sqrt(one.deviation**2 - one.u_num**2), rel=1e-6)
        assert change.after <= change.before


@pytest.mark.slow
def test_an_unknown_of_a_run_is_unknown_in_its_repeat() -> None:
    """The initial angle of the repeat is another unknown, and the bias of a column as well."""
    run = FitRun(
        name="swing", columns=recorded(Q)(ROD, np.random.default_rng(0))["run"][0].columns, noise=Q,
        bias=("q l [rad]",), parameter=(FitParameter(path="initial.joint_deg.l"),), set={"gravity": (0.0, -9.8, 0.0)},
    )  # fmt: skip
    found = propose(problem(ROD, (M,), run))
    motion = next(one for one in found.ranked if one.candidates[0].experiment == "recorded twice as long")
    (again,) = motion.additions
    assert again.parameter[0].path == "initial.joint_deg.l" and again.bias == ("q l [rad]",)
    assert len(again.columns["t [s]"]) == 2 * len(run.columns["t [s]"]) - 1


@pytest.mark.slow
def test_unknown_times_drifts_and_starts_of_a_run_are_unknown_in_its_repeats(rng: np.random.Generator) -> None:
    (swing,) = recorded(Q)(SERVO, rng)["run"]
    head = ("q l [rad]",)
    run = replace(swing, delay=head, drift=head, bias=head, clock=True)
    start = problem(SERVO, (M,), run)
    found = propose(start)
    assert [name for name, _ in found.values] == [M]
    assert [change.name for change in found.ranked[0].changes] == [M]
    motion = next(one for one in found.ranked if one.candidates[0].experiment == "recorded twice as long")
    (again,) = motion.additions
    assert isinstance(again, FitRun)
    assert again.delay == again.drift == again.bias == head and again.clock
    extended = replace(start, run=(*start.run, again))
    expected = dict(zip((check := fl.fits.check_fit(extended)).names, check.expected, strict=True))[M]
    assert motion.changes[0].after == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_a_column_that_the_file_already_contains_is_offered_without_a_new_record(tmp_path: Path) -> None:
    run = fl.simulate(SERVO)
    tau = {"tau l [N mm]": 1e3 * run.columns["tau l [N m]"]}
    write_csv(tmp_path / "a.csv", {"t [s]": run.t, "q l [rad]": run.columns["q l [rad]"]} | tau)
    swing = FitRun(name="swing", file=str(tmp_path / "a.csv"), compare=tuple(Q), noise=Q)
    first = propose(problem(SERVO, (KD, VISCOUS), swing)).first
    assert first is not None and "already recorded" in first.title and first.lost == 0
    SERVO.save(tmp_path / "servo.toml")
    text = f'scene = "servo.toml"\n[[parameter]]\npath = "{KD}"\n[[parameter]]\npath = "{VISCOUS}"\n'
    text += '[[run]]\nname = "swing"\nfile = "a.csv"\ncompare = ["q l [rad]"]\nnoise = {"q l [rad]" = 1e-4}\n'
    (tmp_path / "problem.toml").write_text(text + first.toml, encoding="utf-8")
    assert fl.fits.check_fit(fl.fits.FitProblem.load(tmp_path / "problem.toml")).passed


def test_names_of_sensors_have_blanks_in_place_of_brackets_and_line_breaks() -> None:
    scene = ROD.varied({"link.l.name": "a[1]\tb"})
    imu = ColumnExperiment(name="imu [new]", reason="cheap", sensor={"kind": "gyroscope"}, places=(0.0, 0.5), noise=0.1)
    names = [sensor.name for sensor in sensors_on(imu, scene, [])]
    assert len({*names}) == 2 and not {*"".join(names)} & {*"[]\t"}


def test_what_cannot_be_done_is_left_out_with_its_reason(rng: np.random.Generator) -> None:
    found = propose(FitProblem(
        scene=ROD, parameter=(FitParameter(path=M), FitParameter(path="link.l.end.mass", start=0.1)),
        **recorded(Q)(ROD, rng),
    ))  # fmt: skip
    reasons = {one.partition(":")[0]: str(one) for one in found.skipped}
    assert "is sought" in reasons["with a known mass at the tip"]
    assert "no gravity" in reasons["base tilted by 10° about x"]
    assert "not set" in reasons["reference at half speed"]
    assert found.first is not None and found.first.candidates[0].experiment == "weigh"
    for name in ("with a known mass at the tip", "base tilted by 10° about x", "reference at half speed"):
        reviewed("experiment-left-out", reasons[name])


@pytest.mark.slow
def test_the_command_prints_the_ranking_and_reads_instruments(tmp_path, capsys) -> None:
    more = tmp_path / "instruments.toml"
    more.write_text(
        "[[prior]]\nname = 'pull a sample'\nreason = 'testing machine'\npaths = '.*young'\nshare = 1e-5\n",
        encoding="utf-8",
    )
    tap = str(ROOT / "models" / "fits" / "tapped.toml")
    short = ["--set", "run.duration=0.1", "--propose", "--experiments", str(more)]
    assert main(["fit", tap, "--check", *short, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "linear estimate at the initial guess" in printed and "pull a sample" in printed
    assert "What to measure next" in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert main(["fit", tap, *short, "--json", "--out", str(tmp_path / "fit")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["proposals"]["at"] == "solution" and document["proposals"]["ranked"]
    assert "What to measure next" in (tmp_path / "fit" / "index.html").read_text(encoding="utf-8")


def test_experiments_are_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built_in = ROOT / "flexlink" / "identification" / "experiments.toml"
    assert len(Experiments.load(built_in).column) > 5
    assert main(["fit", str(ROOT / "models/fits/tapped.toml"), "--experiments", "mine.toml"]) == 2
    reviewed("no-effect", capsys.readouterr().err.strip())
    with refused(SceneError, "wrong-value"):
        PriorExperiment(name="a", reason="b", paths="(", share=0.1)
    with refused(SceneError, "both-given"):
        PriorExperiment(name="a", reason="b", paths="c")
    with refused(SceneError, "both-given"):
        Experiments(column=({"name": "a", "reason": "b", "noise": 1.0},))
    path = tmp_path / "mine.toml"
    path.write_text("[[sensor]]\nname = 'a'\n", encoding="utf-8")
    with refused(SceneError, "unknown-key"):
        fl.fits.Experiments.load(path)
