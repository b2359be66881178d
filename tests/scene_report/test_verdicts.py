"""Verdicts of a report on accuracy, cost, measurements and other programs, from known runs and differences."""

import importlib
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.advice.model_runner import Outcome, Stepping
from flexlink.diagnosis.trajectories import MEANINGFUL_TOLERANCE, RunDifference
from flexlink.pages.page import Part
from flexlink.results.convergence import Limit
from flexlink.scene_report.fitting import Fit, Tried, numbers_of
from flexlink.scene_report.parts import accuracy, measurements
from flexlink.scene_report.refinement import Choice
from flexlink.scene_report.study import Study
from tests.conftest import ROOT, make_scene
from tests.scene_report.test_parts import PARTS, G, bar_of, check_sentence, made, numbers, table, three
from tests.support.words import reviewed

Array = np.ndarray
MISTAKE = "gravity has the wrong sign"
MOVE = fl.load_scene(ROOT / "models" / "ptp_move.toml").varied({"run.duration": 0.6, "run.step": 1e-3})


def choice(label: str, error: float, seconds: float, why: str = "") -> Choice:
    outcome = Outcome(np.zeros((3, 3)), seconds, None, Stepping("RK4"), why)
    return Choice(label, 5, "RK4", outcome, error, seconds)


def test_of_a_locked_joint_only_its_gear_may_explain_a_difference() -> None:
    joint = fl.Joint(locked=True, gear_stiffness=8e3, viscous=0.1, armature=0.2)
    scene = make_scene(fl.Link(name="a", length=1.0, joint=joint), tip=fl.RigidBody(mass=1.0))
    assert [one.path.rpartition(".")[2] for one in numbers_of(scene)] == ["mass", "gear_stiffness"]


CHOICES = [
    choice("this scene", 2e-3, 0.1), choice("cheap and good", 3e-3, 0.02), choice("cheap and bad", 9e-3, 0.01),
    choice("cheap, did not end", 1e-5, 0.01, "fell"), choice("dear and good", 1e-3, 0.5),
    choice("dear and better", 1e-4, 0.8), choice("dear and alike", 1.9e-3, 0.2),
]  # fmt: skip


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Part]:
    """Make the chapter of a scene that lasts 1 s and whose tip travels 1 m, with given errors."""

    def of(error: float = 2e-3, steps: float = 1e-4, hinges: int | None = 1, **more: Any) -> Part:
        scene = SimpleNamespace(run=SimpleNamespace(controlled=more.get("controlled", False), duration=1.0), ties=())
        study = SimpleNamespace(travel=1.0, moves=True, scene=scene)
        run = SimpleNamespace(
            tip=np.zeros((3, 3)), t=np.arange(3.0) / 2, warnings=more.get("warnings", ()), stated=more.get("stated"),
        )  # fmt: skip
        about = SimpleNamespace(
            study=study, scene=scene, run=run, model=(hinges,), gives_state=False, of_steps=steps, cuts={},
            limit=Limit(np.zeros((3, 3)), np.array([0.0, 1e-4, 2.5e-4]), 2.02), is_accurate=more.get("known", True),
            of_hinges=error, converged=Limit(np.zeros((3, 3)), np.array([more.get("resolved", 1e-6)])),
            error=lambda _: error, accurate_until=lambda part: 25 * part, choices=lambda: CHOICES,
        )  # fmt: skip
        monkeypatch.setattr(f"{PARTS}.accuracy.Refinement", lambda _: about)
        monkeypatch.setattr(f"{PARTS}.accuracy._in_time", lambda _: None)
        return made("accuracy", study)

    return of


class TestAccuracy:
    def test_errors_are_shown_with_uncertainty_order_and_share_of_the_travel(self, judged: Any) -> None:
        part = judged()
        check_sentence(part, "report verdicts: error of the hinges", [2.0, 0.2, 2.0, 0.25], rel=1e-12)
        steps = "report verdicts: error of the steps"
        check_sentence(part, steps, [0.1], "0.1 mm", rel=1e-12)
        check_sentence(judged(steps=5e-5), steps, [50.0], "50 µm", rel=1e-12)
        check_sentence(judged(resolved=2e-4), steps, [0.2], "below 0.2 mm", rel=1e-12)
        check_sentence(judged(stated="0.4 mm"), steps, [0.1, 0.4], "0.1 mm", rel=1e-12)
        assert numbers(part.verdicts[0].text) == [2.0, 0.1, 0.2]  # hinges and steps [mm], share of the travel [%]
        assert [(v.about, v.state, numbers(v.word)) for v in part.verdicts][1] == ("Cost", "info", [0.1])
        assert numbers(part.verdicts[1].text) == [10.0]  # 1 s of motion takes 0.1 s
        check_sentence(part, "report verdicts: cost and alternatives", [0.1, 10.0], rel=1e-12)

    def test_the_best_cheaper_and_the_cheapest_better_choice_are_named(self, judged: Any) -> None:
        part = judged()
        values = ("cheap and good", "20 ms", "3 mm", "dear and good", "0.5 s", "1 mm")
        text = check_sentence(part, "report verdicts: cost and alternatives", [20.0, 3.0, 0.5, 1.0], *values, rel=1e-12)
        assert [text.index(each) for each in values] == sorted(text.index(each) for each in values)
        assert [one.label for one in CHOICES if one.label in text] == [values[0], values[3]]
        lines = table(part, "choices")
        assert [lines[h][1] for h in ("tip error [m]", "CPU time [s]", "× real time")] == [3e-3, 0.02, 50.0]
        assert lines["remark"][3] == "fell"

    @pytest.mark.parametrize(
        ("about", "state"),
        [
            ({"error": 3e-3}, "pass"),
            ({"error": 3e-2}, "doubt"),  # the limit is 1 % of 1 m
            ({"error": 3e-3, "warnings": ("unstable step",)}, "doubt"),
            ({"error": np.nan}, "doubt"),
            ({"error": 3e-2, "steps": 3e-3, "hinges": None}, "pass"),  # rigid links: only steps have an error
            ({"error": 3e-3, "steps": 3e-2, "hinges": None}, "doubt"),
        ],
    )
    def test_a_model_passes_with_an_error_below_one_percent_and_no_warnings(self, judged, about, state) -> None:
        assert judged(**about).verdicts[0].state == state

    def test_prices_are_drawn_from_two_choices_of_known_error_and_time_on(self) -> None:
        unknown = choice("unknown", np.nan, 0.1), choice("exact", 0.0, 0.1), choice("free", 1e-3, 0.0)
        assert accuracy._prices([CHOICES[0], *unknown]) is None
        drawn = accuracy._prices([CHOICES[0], *unknown, CHOICES[4]])
        assert drawn is not None
        rows = [line.split(",")[1:] for line in drawn.csv.splitlines()[1:]]
        assert rows == [["0.1", "0.002"], ["0.5", "0.001"]]

    def test_a_report_names_the_duration_up_to_which_the_error_is_known(self, judged: Any) -> None:
        part = judged(error=np.nan, known=False)
        check_sentence(part, "report verdicts: error of the hinges", [0.25, 0.25, 1.0], "0.25 mm", "0.25 s", rel=1e-12)
        of_steps = judged(steps=np.nan).sentences[1]
        assert "unknown" in of_steps and not numbers(of_steps)
        reviewed("report verdicts: error of the steps", of_steps)


@pytest.mark.parametrize(
    ("path", "was", "now", "spread", "shown"),
    [
        ("tip.mass", 2.0, 2.5, 0.1, [25, 5, "%"]), ("tip.mass", 4.0, 3.0, 0.2, [-25, 5, "%"]),
        ("initial.joint_deg.1", 4.0, 3.0, 0.2, [-1, 0.2, "°"]), ("initial.joint_m.1", 0.0, 0.5, 0.1, [0.5, 0.1, "m"]),
    ],
)  # fmt: skip
def test_a_fitted_change_and_its_spread_are_in_percent_but_those_of_a_start_are_not(
    path: str, was: float, now: float, spread: float, shown: list[object]
) -> None:
    text = measurements._change(Fit(Tried(path, "", was), now, spread, 1.0, {}, None))  # type: ignore[arg-type]
    assert [*numbers(text.replace("+", "").replace("°", " °")), text[-1]] == shown


@pytest.mark.slow
@pytest.mark.parametrize("payload", [0.4, 0.6])
def test_differences_are_root_mean_squares_and_the_payload_explains_them(payload: float, tmp_path: Any) -> None:
    """Measurements of a falling bar have another payload than 0.5 kg, and one sample after the run's end."""
    scene = fl.Scene(
        name="bar", arm=bar_of(0.01, 0.01, 0.5, {"length": 1.0, "flex": "z", "segments": 3}), gravity=(0.0, -G, 0.0),
        initial=fl.InitialState(joint_deg=(0.0,)), drive=fl.Drive(kind="constant", torque=(3.0,)),
        run=fl.RunSettings(duration=0.3, sample=0.01, step=1e-3),
    )  # fmt: skip
    true = fl.simulate(scene.varied({"tip.mass": payload}))
    seen = {f"tip {axis} [m]": true.tip[:, k] for k, axis in enumerate("xy")}
    rows = np.column_stack([true.t, *seen.values()])
    head = ",".join(["t [s]", *seen])
    np.savetxt(tmp_path / "film.csv", np.vstack([rows, [1.0, 0.0, 0.0]]), delimiter=",", header=head, comments="")
    study = Study(scene, tmp_path / "film.csv")
    part, run = made("measurements", study), study.run
    check_sentence(part, "report verdicts: samples of a file", [2, 31, 0, 0.3, 1], "film.csv", rel=1e-12)

    def off(tip: Array) -> dict[str, Array]:
        return {name: tip[:, k] - y for k, (name, y) in enumerate(seen.items())}

    rms = {name: float(np.sqrt(np.mean(e**2))) for name, e in off(run.tip).items()}
    worst = max(rms, key=lambda name: rms[name] / seen[name].std())
    difference = [1e3 * rms[worst], 100 * rms[worst] / np.ptp(seen[worst])]
    check_sentence(part, "report verdicts: RMS difference", difference, worst[:-4], compare=payload > 0.5)
    assert numbers(part.verdicts[0].word) == three(1e3 * rms[worst])
    lines, largest = table(part, "measured"), [np.abs(e) for e in off(run.tip).values()]
    assert lines["RMS difference"] == pytest.approx(list(rms.values()), rel=1e-6)
    assert lines["largest difference"] == pytest.approx([e.max() for e in largest], rel=1e-6)
    assert lines["at [s]"] == [run.t[e.argmax()] for e in largest]
    fitted = lines["RMS after fitting"]
    assert max(fitted) < 1e-4 * max(rms.values())
    found = table(part, "numbers")
    assert [found[h][0] for h in ("path", "parameter")] == ["tip.mass", "payload"]
    masses = [found[head][0] for head in ("in the scene", "fitted", "factor")]
    assert masses == pytest.approx([0.5, payload, payload / 0.5], rel=1e-5)
    (text,) = [text for text in part.sentences if "payload" in text and len(numbers(text)) == 6]
    percent, _, value, _, before, _ = numbers(text)
    assert [percent, value, before] == three(200 * (payload - 0.5), payload, 0.5)
    without_exponents = re.sub(r"\s×\s10[⁻⁰-⁹¹²³]+", "", text)
    reviewed("report verdicts: best explanation", without_exponents, values=False)
    left = []
    for path, value in zip(found["path"], found["fitted"], strict=True):  # each parameter is fitted separately
        again = off(fl.simulate(scene.varied({path: value})).tip)
        left.append(
            np.sqrt(sum(float(e @ e) for e in again.values()) / sum(float(e @ e) for e in off(run.tip).values()))
        )
    assert found["remaining difference"] == pytest.approx(left, rel=1e-3, abs=1e-4)
    assert left == sorted(left)


def row(q: float, explained: float = 1e-9, diverged: str = "") -> RunDifference:
    return RunDifference("mujoco", q, 2 * q, 3 * q, 0.25, "upper", explained, diverged)


class TestOthers:
    def part(self, monkeypatch: pytest.MonkeyPatch, terms: float, run: RunDifference) -> Part:
        rows = [SimpleNamespace(quantity="M", error=terms, passed=terms <= 1)]
        one = SimpleNamespace(engine="mujoco", rows=rows, passed=terms <= 1, notes=())
        runs = SimpleNamespace(rows=[run], steps="steps of RK4", refused=("drake: free base",))
        compared = {name: SimpleNamespace(diagnoses=[one] if name == "mujoco" else []) for name in fl.engines.ENGINES}
        monkeypatch.setattr(f"{PARTS}.agreement.compare", lambda _, engines, samples: compared[engines[0]])
        monkeypatch.setattr(f"{PARTS}.agreement.compare_trajectories", lambda _, duration: runs)
        return made("agreement", Study(MOVE))

    @pytest.mark.parametrize(
        ("terms", "run", "state"),
        [
            (0.3, row(1e-10), "pass"),
            (3.0, row(1e-10), "fail"),
            (0.3, row(1e-8), "fail"),
            (0.3, row(0.0, diverged="fell"), "fail"),
        ],
    )
    def test_an_engine_agrees_if_its_terms_and_its_run_agree(self, monkeypatch, terms, run, state) -> None:
        part = self.part(monkeypatch, terms, run)
        (verdict,) = part.verdicts
        assert (verdict.state, "MuJoCo" in verdict.text) == (state, True)
        assert list(table(part, "terms").values())[1:] == [[terms], ["agrees" if terms <= 1 else "DIFFERS"]]
        differences = [cells[0] for cells in table(part, "runs").values()]
        assert differences[1:5] == [run.q, run.qd, run.tip, run.explained]
        assert differences[-1] == ("agrees" if run.passed else "DIFFERS")
        assert ("MuJoCo: fell." in part.sentences) == bool(run.diverged)
        (text,) = (text for text in part.sentences if "drake: free base" in text)
        reviewed("report verdicts: engines not compared", text)

    def test_a_motion_that_amplifies_rounding_gives_a_warning(self, monkeypatch: pytest.MonkeyPatch) -> None:
        texts = []
        for times in (1 / 3, 3.0):
            part = self.part(monkeypatch, 0.1, row(0.0, times * MEANINGFUL_TOLERANCE))
            texts.append(part.sentences)
        (warning,) = set(texts[1]) - set(texts[0])
        assert not set(texts[0]) - set(texts[1])
        reviewed("report verdicts: motion that amplifies rounding", warning)

    def test_eight_thousand_evaluations_limit_the_part_of_a_run_that_is_compared(self) -> None:
        """With four evaluations per step of 1 ms, 2 s of motion are compared, or less if the run is shorter."""
        affordable = importlib.import_module(f"{PARTS}.agreement")._affordable
        assert affordable(Study(MOVE.varied({"run.duration": 8.0}))) == pytest.approx(2.0)
        assert affordable(Study(MOVE)) == 0.6

    @pytest.mark.parametrize("passed", [True, False])
    def test_a_compared_file_agrees_or_its_first_relevant_mistake_is_named(self, monkeypatch, passed: bool) -> None:
        class Finding(str):
            __slots__ = ("counts",)

        findings = [Finding(text) for text in ("a hint", MISTAKE, "mass")]
        for one in findings:
            one.counts = one != "a hint"
        rows = [SimpleNamespace(quantity="T_G", error=7.0, joint="fore", passed=passed)]
        found = SimpleNamespace(engine="mujoco", rows=rows, findings=findings, passed=passed)
        monkeypatch.setattr(f"{PARTS}.theirs.compare", lambda *_, **__: SimpleNamespace(diagnoses=[found]))
        part = made("theirs", Study(MOVE, ROOT / "their.xml"))
        assert part.verdicts[0].state == ("pass" if passed else "fail")
        assert (part.verdicts[0].text == f"their.xml: {MISTAKE}") == (not passed)
        assert [cells[0] for cells in table(part, "theirs").values()][1:] == [
            7.0,
            "fore",
            "agrees" if passed else "DIFFERS",
        ]
