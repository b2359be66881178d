"""Numbers, sentences and verdicts of a report's chapters, each found again by another way: closed forms, loops, SciPy."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from conftest import ROOT
from scipy.linalg import eigh
from scipy.optimize import root

import flexlink as fl
from flexlink.advice.model_runner import Outcome, Stepping
from flexlink.describe.schemes.methods import method
from flexlink.diagnosis.trajectories import MEANINGFUL_TOLERANCE, RunDifference
from flexlink.pages.part import Part
from flexlink.pages.tables import Table
from flexlink.results.convergence import Limit
from flexlink.results.measured import Measured
from flexlink.scene_report.parts import (
    accuracy, agreement, energy, loads, measurements, model, motion, settling, statics, theirs, vibration,
)  # fmt: skip
from flexlink.scene_report.refinement import Choice
from flexlink.scene_report.study import Study

DIGITS = {"rel": 5.01e-3}  # half of the last of three digits, 1.00 ± 0.005
SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def numbers(text: str) -> list[float]:
    """Numbers in a text, as pages write them."""
    found = re.findall(r"(?<![\w.])−?\d+(?:\.\d+)?(?:\s×\s10[⁻⁰-⁹¹²³]+)?(?!\w)", text)
    return [float(re.sub(r"\s×\s10", "e", one).translate(SUPERSCRIPTS).replace("−", "-")) for one in found]


def said(part: Part | None, begin: str) -> str:
    """The sentence, or the piece of one, from these words to a full stop before a space."""
    assert part is not None
    (found,) = [s[s.index(begin) + len(begin) :] for s in part.sentences if begin in s]
    return re.split(r"\.(?=\s|$)", found)[0]


def table(part: Part | None, name: str) -> list[dict[str, Any]]:
    assert part is not None
    (one,) = [one for one in part.tables if one.name == name]
    return [dict(zip(one.heads, line, strict=True)) for line in one.lines]


def picture(part: Part | None, name: str) -> dict[str, np.ndarray]:
    """Columns of the file beside a picture."""
    assert part is not None
    (one,) = [one for one in part.pictures if one.name == name]
    heads, *lines = one.csv.splitlines()
    return dict(zip(heads.split(","), np.array([line.split(",") for line in lines], float).T, strict=True))


# an arm that is held: closed forms of a beam

L, HEIGHT, WIDTH, E, RHO, LOAD, ASIDE, G = 0.8, 0.02, 0.03, 2.1e11, 7850.0, 2.0, 0.1, 9.81
EI, WEIGHT = E * WIDTH * HEIGHT**3 / 12, RHO * WIDTH * HEIGHT * G  # about z; N/m


@pytest.fixture(scope="module")
def held() -> Study:
    """A bar that points along −x, held by its drive, with a load beside its end: negative torque, and twist."""
    bar = fl.Link(name="bar", length=L, flex="yz", segments=9, lumping="lobatto4", material="steel", section="bar")
    arm = fl.Arm(
        links=(bar,), materials={"steel": fl.Material(young=E, density=RHO, loss_time=1e-4)},
        sections={"bar": fl.Section(shape="rectangle", height=HEIGHT, width=WIDTH)},
        tip=fl.RigidBody(mass=LOAD, center=(0.0, 0.0, ASIDE)),
    )  # fmt: skip
    drive = fl.Drive(kind="pd", kp=(4e4,), kd=(4e2,), target_deg=(180.0,), gravity="static")
    still = fl.InitialState(joint_deg=(180.0,), passive="static")
    run = fl.RunSettings(duration=0.05, sample=0.01, tolerance=1e-6)
    return Study(fl.Scene(name="held", gravity=(0.0, -G, 0.0), arm=arm, initial=still, drive=drive, run=run))


MOMENT, SHEAR = G * LOAD * L + WEIGHT * L**2 / 2, G * LOAD + WEIGHT * L  # at the root


class TestHeld:
    """Sag, stress and loads of a cantilever; 1e-3 is left to eight hinges, and to the slope of the bent bar."""

    def test_the_sag_is_that_of_a_beam_in_mm_along_its_axes(self, held: Study) -> None:
        part = statics.made(held)
        sag = 1e3 * (G * LOAD * L**3 / (3 * EI) + WEIGHT * L**4 / (8 * EI))
        size, x, y, z = numbers(said(part, "Static tip deflection: ").replace("frame 0", ""))
        assert (size, y) == pytest.approx((sag, -sag), **DIGITS)
        assert max(abs(x), abs(z)) < 2e-3 * sag
        assert numbers(part.facts[0].value) == pytest.approx([sag], **DIGITS)
        assert said(part, "The posture is ") == "stable"

    def test_the_torque_that_holds_it_is_its_weight_times_its_lever_with_its_sign(self, held: Study) -> None:
        part = statics.made(held)
        (line,) = table(part, "holding")
        assert line == {
            "joint": "bar",
            "angle [deg]": pytest.approx(180.0),
            "torque [N m]": pytest.approx(-MOMENT, rel=1e-4),
        }
        assert numbers(part.facts[1].value) == pytest.approx([MOMENT], **DIGITS)

    def test_loads_at_the_root_are_those_of_its_weight_and_the_largest_torque_has_no_sign(self, held: Study) -> None:
        part = loads.made(held)
        assert numbers(said(part, "Largest bending moment: "))[0] == pytest.approx(MOMENT, **DIGITS)
        assert numbers(said(part, "Largest drive torque: ")) == pytest.approx([MOMENT], **DIGITS)
        line = table(part, "loads")[0]
        expected = {
            "shear [N]": SHEAR,
            "torque [N m]": G * LOAD * ASIDE,
            "bending [N m]": MOMENT,
            "drive [N m]": MOMENT,
        }
        for head, value in expected.items():
            assert line[head] == pytest.approx(value, rel=1e-4)
        assert line["tension [N]"] == pytest.approx(0.0, abs=1e-6 * SHEAR)
        assert numbers(part.facts[0].value) == pytest.approx(
            [1e-6 * MOMENT * HEIGHT / 2 / (EI / E)], **DIGITS
        )  # M c / I

    def test_what_was_modelled_is_counted_and_weighed(self, held: Study) -> None:
        part = model.made(held)
        size = numbers(next(s for s in part.sentences if s.startswith("1 link")))
        assert size == pytest.approx([1, L, LOAD + WEIGHT * L / G, 17, 1, 16], **DIGITS)
        assert numbers(said(part, "Gravity: ").replace("frame 0", "").replace("s²", "")) == [0, -G, 0]
        (link,), (joint,) = table(part, "links"), table(part, "joints")
        assert (link["length [m]"], link["hinges"], link["damping time [s]"]) == (L, 8, 1e-4)
        assert (joint["start [deg]"], joint["limits [deg]"]) == (180.0, "none")
        springs = table(part, "springs")
        assert len(springs) == 16
        q = dict(zip(map(held.chain.joint_name, range(held.chain.n)), held.start[0], strict=True))
        for line in springs:
            assert line["damping [N m s/rad]"] == pytest.approx(1e-4 * line["stiffness [N m/rad]"], rel=1e-12)
            assert line["start [deg]"] == pytest.approx(np.degrees(q[line["spring"]]), rel=1e-12, abs=1e-12)
            assert line["coupled with"].count("bar.") == 3  # of a cell of four


# an arm that moves: loops over the samples


GOAL, PUSH = (-25.0, 30.0, -60.0), (5.0, -3.0, 2.0)


@pytest.fixture(scope="module")
def move() -> Study:
    """Three joints that are led by springs about them, in space, and ring afterwards."""
    course = fl.Reference(profile="quintic", to_deg=GOAL, duration=0.25)
    change = {
        "run.duration": 0.6, "run.step": 1e-3, "link.upper.segments": 2, "link.fore.segments": 2,
        "link.*.lumping": "midpoint", "drive.gravity": "none", "drive.reference": course,
        "link.upper.joint.viscous": 3.0, "link.upper.joint.limits_deg": (-90.0, 100.0),
        "wrench": fl.Wrench(force=PUSH), "material.aluminium.loss_time": 2e-3,
    }  # fmt: skip
    return Study(fl.load_scene(ROOT / "models" / "ptp_move.toml").varied(change))


def straight(study: Study, q: np.ndarray) -> np.ndarray:
    """Where the tip is with all springs at 0."""
    return fl.tip_position(study.chain, np.where(study.chain.stiffness > 0, 0.0, q))


def rest_by_scipy(study: Study, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Angles at which springs bear gravity and a force at the tip, the driven joints held."""
    chain, free = study.chain, study.chain.stiffness > 0

    def left(angles: np.ndarray) -> np.ndarray:
        at = q.copy()
        at[free] = angles
        J = np.array(
            [(fl.tip_position(chain, at + h) - fl.tip_position(chain, at - h)) / 2e-6 for h in 1e-6 * np.eye(chain.n)]
        )
        return (fl.gravity_torque(chain, at) + chain.stiffness * at - J @ force)[free]

    found = q.copy()
    found[free] = root(left, np.zeros(int(free.sum())), tol=1e-12).x
    return found


def target_of(study: Study) -> np.ndarray:
    """Where the tip of the arm that moves comes to rest, bent, at the end of its reference."""
    goal = np.zeros(study.chain.n)
    goal[study.chain.active] = np.radians(GOAL)
    return fl.tip_position(study.chain, rest_by_scipy(study, goal, np.array(PUSH)))


class TestMove:
    def test_travel_and_deflection_are_the_largest_distances_with_their_time(self, move: Study) -> None:
        part, run = motion.made(move), move.run
        bent = [float(np.linalg.norm(tip - straight(move, q))) for tip, q in zip(run.tip, run.q, strict=True)]
        far = [float(np.linalg.norm(tip - run.tip[0])) for tip in run.tip]
        assert numbers(said(part, "Simulated time: "))[0] == run.t[-1] - run.t[0]
        assert numbers(said(part, "The tip moves up to ")) == pytest.approx([max(far)], **DIGITS)
        most, when = numbers(said(part, "Tip deflection: "))
        assert (most, when) == pytest.approx((1e3 * max(bent), run.t[int(np.argmax(bent))]), **DIGITS)
        columns = picture(part, "motion")
        assert columns["tip deflection [m]"] == pytest.approx(bent, rel=1e-9, abs=1e-15)
        assert columns["fore [deg]"] == pytest.approx(
            run.q[:, move.chain.joint_names.index("fore")] * 180 / np.pi, rel=1e-12
        )
        heads, *rows = part.files["run.csv"].splitlines()
        assert (
            np.array([row.split(",") for row in rows], float).tolist()
            == np.array([run.columns[h] for h in heads.split(",")]).T.tolist()
        )

    def test_a_run_that_failed_is_no_pass(self, move: Study) -> None:
        failed = Study(move.scene.varied({"run.step": 0.05, "run.sample": 0.05}))  # beyond the largest stable one
        part = motion.made(failed)
        assert [(v.about, v.state) for v in part.verdicts] == [("Run", "fail")]
        assert str(failed.attempt) in part.sentences[0]
        warned = Study(move.scene)
        warned.__dict__["attempt"] = replace(move.run, warnings=("mind the step",))
        assert "Warning: mind the step." in motion.made(warned).sentences

    def test_the_largest_loads_are_found_sample_by_sample(self, move: Study) -> None:
        part, run, chain = loads.made(move), move.run, move.chain
        best = max(
            (float(np.hypot(*run.loads.moment[row, body, 1:])), -row, body)
            for row in range(len(run.t)) for body in range(len(chain.bodies) - 1)
        )  # fmt: skip
        words = said(part, "Largest bending moment: ")
        joint = chain.joint_name(int(chain.bodies["first"][best[2]]))
        assert numbers(words) == pytest.approx([best[0], run.t[-best[1]]], **DIGITS)
        assert f"at {joint}," in words
        torque = {chain.joint_name(k): max(abs(x) for x in run.tau[:, k]) for k in chain.active.tolist()}
        most = max(torque, key=torque.__getitem__)
        assert abs(run.tau[:, chain.active].min()) != run.tau[:, chain.active].max()
        assert numbers(said(part, "Largest drive torque: ")) == pytest.approx([torque[most]], **DIGITS)
        assert said(part, "Largest drive torque: ").endswith(f"at {most}")
        columns = picture(part, "loads")
        for line in table(part, "loads"):
            k = next(k for k in range(chain.n) if chain.joint_name(k) == line["location"])
            F, M = run.loads.force[:, chain.body(k)], run.loads.moment[:, chain.body(k)]
            assert line["tension [N]"] == max(0.0, *F[:, 0])
            assert line["compression [N]"] == max(0.0, *-F[:, 0])
            assert line["shear [N]"] == pytest.approx(max(np.hypot(F[:, 1], F[:, 2])), rel=1e-12)
            assert line["torque [N m]"] == max(*M[:, 0], *-M[:, 0])
            assert line["bending [N m]"] == pytest.approx(max(np.hypot(M[:, 1], M[:, 2])), rel=1e-12)
            assert line["drive [N m]"] == torque.get(line["location"])
            if line["location"] in torque:
                assert columns[f"bending {line['location']} [N m]"] == pytest.approx(
                    np.hypot(M[:, 1], M[:, 2]), rel=1e-12
                )
                assert columns[f"drive {line['location']} [N m]"].tolist() == run.tau[:, k].tolist()

    def test_the_target_is_where_the_arm_rests_bent_and_settling_is_counted_from_the_reference(
        self, move: Study
    ) -> None:
        part, run, chain = settling.made(move), move.run, move.chain
        target = target_of(move)
        off = np.linalg.norm(run.tip - target, axis=1)
        told = numbers(said(part, "At the end of the run the tip is "))
        assert told == pytest.approx([1e3 * off[-1]], **DIGITS)
        late = run.tip[run.t >= 0.25]
        middle = (late.max(axis=0) + late.min(axis=0)) / 2
        left = max(np.linalg.norm(tip - middle) for tip in late)
        assert numbers(said(part, "Residual vibration: ")) == pytest.approx([1e3 * left, 0.25], **DIGITS)
        way = target - run.tip[0]
        beyond = max(0.0, *((run.tip - target) @ way / np.linalg.norm(way)))
        assert numbers(said(part, "Overshoot: ")) == pytest.approx([1e3 * beyond], **DIGITS)
        assert picture(part, "settling")["distance to target [m]"] == pytest.approx(off, rel=1e-6, abs=1e-9)

    def test_settling_times_are_those_after_which_the_tip_stays_close(self, move: Study) -> None:
        """Of a run whose tip comes nearer as e^(−20 t): to a part p of its travel at −ln p / 20, in samples of 0.01 s."""
        t = 0.25 + 0.01 * np.arange(100)
        way = np.exp(-20 * (t - 0.25))[:, None] * [0.3, 0.0, 0.4]
        calm = Study(move.scene)
        calm.__dict__["attempt"] = replace(move.run, t=t, tip=target_of(move) + way)
        lines = table(settling.made(calm), "settling")
        travel = 0.5 * (1 - np.exp(-20 * 0.99))
        for line, part in zip(lines, (1e-2, 1e-3, 1e-4), strict=True):
            assert line["part of the travel"] == part
            assert line["tolerance [m]"] == pytest.approx(part * travel, rel=1e-9)
            steps = np.ceil(-np.log(part * travel / 0.5) / 20 / 0.01)
            assert line["settling time [s]"] == pytest.approx(0.01 * steps, abs=1e-9)

    def test_a_run_that_ends_before_its_reference_is_not_judged(self, move: Study) -> None:
        part = settling.made(Study(move.scene.varied({"run.duration": 0.2})))
        assert numbers(said(part, "The reference ends at ")) == [0.25, 0.2]
        assert not part.tables
        assert settling.made(Study(move.scene.varied({"drive": fl.Drive(), "run.duration": 0.0}))) is None


class TestRest:
    """The arm that moves, at rest where it starts: potential and inertia by differences, eigenvalues dense."""

    @pytest.fixture(scope="class")
    @classmethod
    def rest(cls, move: Study) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, stiffness of springs and of loads."""
        q, free = rest_by_scipy(move, move.start[0], np.array(PUSH)), move.chain.stiffness > 0

        def of_loads(at: np.ndarray) -> np.ndarray:
            h = 1e-4 * np.eye(move.chain.n)
            J = np.array(
                [(fl.tip_position(move.chain, at + d) - fl.tip_position(move.chain, at - d)) / 2e-4 for d in h]
            )
            return fl.gravity_torque(move.chain, at) - J @ np.array(PUSH)

        slopes = np.array([(of_loads(q + d) - of_loads(q - d)) / 2e-4 for d in 1e-4 * np.eye(move.chain.n)])
        return q, np.diag(move.chain.stiffness[free]), slopes[np.ix_(free, free)]

    def test_the_sag_and_the_torques_are_those_of_the_bent_arm(self, move: Study, rest: tuple[np.ndarray, ...]) -> None:
        part, (q, _, _) = statics.made(move), rest
        sag = 1e3 * (fl.tip_position(move.chain, q) - straight(move, q))
        told = numbers(said(part, "Static tip deflection: ").replace("frame 0", ""))
        assert told == pytest.approx([float(np.linalg.norm(sag)), *sag], **DIGITS)
        h = 1e-6 * np.eye(move.chain.n)
        J = np.array([(fl.tip_position(move.chain, q + d) - fl.tip_position(move.chain, q - d)) / 2e-6 for d in h])
        tau = (fl.gravity_torque(move.chain, q) - J @ np.array(PUSH))[move.chain.active]
        lines = table(part, "holding")
        assert [line["torque [N m]"] for line in lines] == pytest.approx(tau.tolist(), rel=1e-6, abs=1e-6)
        assert [line["angle [deg]"] for line in lines] == pytest.approx([0.0, 45.0, -60.0], abs=1e-9)
        two = sorted(np.abs(tau))[:0:-1]
        assert numbers(part.facts[1].value) == pytest.approx(two, **DIGITS)
        assert part.facts[1].label == "Largest holding torques: upper, fore"

    def test_the_buckling_load_is_the_least_at_which_springs_and_loads_cancel(
        self, move: Study, rest: tuple[np.ndarray, ...]
    ) -> None:
        _, K, S = rest
        factors = 1 / eigh(-(S + S.T) / 2, K, eigvals_only=True)
        told = numbers(said(statics.made(move), "Buckling load: "))
        assert told == pytest.approx([min(f for f in factors if f > 0)], **DIGITS)

    def test_frequencies_and_ratios_are_those_of_dense_matrices(
        self, move: Study, rest: tuple[np.ndarray, ...]
    ) -> None:
        part, (q, K, S), free = vibration.made(move), rest, move.chain.stiffness > 0
        M, D = fl.mass_matrix(move.chain, q)[np.ix_(free, free)], np.diag(move.chain.damping[free])
        A = np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, K + S), -np.linalg.solve(M, D)]])
        λ = sorted((one for one in np.linalg.eigvals(A) if one.imag > 0), key=abs)
        lines = table(part, "modes")
        assert [line["frequency [Hz]"] for line in lines] == pytest.approx(
            [abs(one) / 2 / np.pi for one in λ], rel=1e-3
        )
        assert [line["damping ratio"] for line in lines] == pytest.approx([-one.real / abs(one) for one in λ], rel=2e-3)
        first, ratio = numbers(said(part, "First elastic frequency: "))
        assert (first, ratio) == pytest.approx((lines[0]["frequency [Hz]"], lines[0]["damping ratio"]), **DIGITS)
        assert numbers(part.facts[0].value) == pytest.approx([line["frequency [Hz]"] for line in lines[:2]], **DIGITS)
        w, V = eigh((K + S + (K + S).T) / 2, M)
        for k, line in enumerate(lines[:2]):
            way = np.zeros(move.chain.n)
            way[free] = 1e-6 * V[:, k] / np.abs(V[:, k]).max()
            moved = fl.tip_position(move.chain, q + way) - fl.tip_position(move.chain, q - way)
            assert line["tip moves most along"] == "xyz"[int(np.argmax(np.abs(moved)))]
        assert w[0] == pytest.approx(abs(λ[0]) ** 2, rel=1e-3)

    def test_a_clamped_bar_has_modes_that_its_hinges_resolve_and_others_that_they_do_not(self, held: Study) -> None:
        """Of eight hinges about each of two axes, four half-waves each: modes beyond the eighth are the cut's."""
        part = vibration.made(held)
        assert numbers(said(part, "Modes from "))[0] == 9
        elastic = [line["resolved by the hinges"] for line in table(part, "modes") if line["kind"] == "elastic"]
        assert elastic == ["yes"] * 8 + ["no"] * (len(elastic) - 8)


class TestEnergy:
    def test_the_balance_is_that_of_the_state_and_the_work(self, move: Study) -> None:
        part, run, chain = energy.made(move), move.run, move.chain
        kinetic = np.array([qd @ fl.mass_matrix(chain, q) @ qd / 2 for q, qd in zip(run.q, run.qd, strict=True)])
        elastic = (chain.stiffness * run.q**2).sum(axis=1) / 2
        columns = picture(part, "energy")
        assert columns["kinetic [J]"] == pytest.approx(kinetic - kinetic[0], rel=1e-9, abs=1e-9)
        assert columns["elastic [J]"] == pytest.approx(elastic - elastic[0], rel=1e-9, abs=1e-9)
        change = columns["kinetic [J]"] + columns["gravity [J]"] + columns["elastic [J]"]
        off, size = (
            np.abs(change - columns["work [J]"]),
            sum(abs(columns[f"{n} [J]"]) for n in ("kinetic", "gravity", "elastic", "work")),
        )
        told = numbers(part.sentences[0].replace("E(0)", ""))
        assert told == pytest.approx([off.max(), run.t[off.argmax()], off.max() / size.max(), size.max()], **DIGITS)
        assert part.verdicts[0].state == "pass"

    @pytest.mark.parametrize(("share", "state"), [(0.3e-3, "pass"), (3e-3, "doubt")])
    def test_energy_that_is_made_out_of_nothing_is_no_pass(self, move: Study, share: float, state: str) -> None:
        """The limit is a thousandth of what was exchanged; planted is a third of it, and three times it, at 0.4 s."""
        wrong, run = Study(move.scene), move.run
        planted = share * float(run.exchanged[-1]) * np.exp(-(((run.t - 0.4) / 0.01) ** 2))
        wrong.__dict__["attempt"] = replace(run, work=run.work + planted)
        part = energy.made(wrong)
        assert part.verdicts[0].state == state
        lost, when, told, _ = numbers(part.sentences[0])
        assert (lost, when, told) == pytest.approx((planted.max(), 0.4, share), rel=0.01)


# accuracy and cost, from runs that are known


class About:
    """Runs about a scene of a second, whose tip travels a metre."""

    def __init__(self, error: float = 2e-3, of_steps: float = 1e-4, **said: Any) -> None:
        self.study, self.runner, self.strict = SimpleNamespace(travel=1.0, moves=True), None, None
        settings = SimpleNamespace(controlled=False, duration=1.0)
        self.study.scene = self.scene = SimpleNamespace(run=settings)
        self.run = SimpleNamespace(tip=np.zeros((3, 3)), t=np.arange(3.0) / 2, warnings=said.get("warnings", ()))
        self.model, self.says_state, self.of_steps, self._error = said.get("model", (1,)), False, of_steps, error
        self.limit = Limit(np.zeros((3, 3)), np.array([0.0, 1e-4, 3e-4]), order=2.02)
        self.is_known, self.cuts = said.get("known", True), {}

    def error(self, _: object) -> float:
        return self._error

    def known_until(self, part: float) -> float:
        assert part == 0.01
        return 0.25

    def choices(self) -> list[Choice]:
        def choice(label: str, error: float, seconds: float, why: str = "") -> Choice:
            return Choice(
                label, 5, "RK4", Outcome(np.zeros((3, 3)), seconds, None, Stepping("RK4"), why), error, seconds
            )

        return [
            choice("this scene", 2e-3, 0.1), choice("cheap and good", 3e-3, 0.02), choice("cheap and bad", 9e-3, 0.01),
            choice("cheap, did not end", 1e-5, 0.01, "fell"), choice("dear and good", 1e-3, 0.5),
            choice("dear and better", 1e-4, 0.8), choice("dear and alike", 1.9e-3, 0.2),
        ]  # fmt: skip


@pytest.fixture
def page_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    def made(about: About) -> Part:
        monkeypatch.setattr(accuracy, "Refinement", lambda _: about)
        part = accuracy.made(cast("Any", about.study))
        assert part is not None
        return part

    return made


class TestAccuracy:
    def test_the_error_is_told_with_its_share_of_the_travel_its_order_and_how_well_it_is_known(
        self, page_of: Any
    ) -> None:
        part = page_of(About())
        assert numbers(said(part, "Tip error from the number of hinges: ")) == [2.0, 0.002, 2.0, 0.3] or numbers(
            said(part, "Tip error from the number of hinges: ")
        ) == [2.0, 0.002, 2, 300.0]
        assert numbers(said(part, "Tip error from the time steps: ")) == [0.1]
        assert [(v.about, v.state, numbers(v.word)) for v in part.verdicts] == [
            ("Model error", "pass", [2.0]),
            ("Cost", "info", [0.1]),
        ]
        assert numbers(part.verdicts[1].text) == [10.0]  # a second in 0.1 s

    def test_the_best_of_the_cheaper_and_the_cheapest_of_the_better_choices_are_named(self, page_of: Any) -> None:
        part = page_of(About())
        assert said(part, "Best cheaper choice: ") == "cheap and good (20 ms, tip error 3 mm)"
        assert said(part, "Cheapest more accurate choice: ") == "dear and good (0.5 s, tip error 1 mm)"
        lines = table(part, "choices")
        assert [(line["tip error [m]"], line["CPU time [s]"], line["× real time"]) for line in lines[:2]] == [
            (2e-3, 0.1, 10.0),
            (3e-3, 0.02, 50.0),
        ]
        assert lines[3]["remark"] == "fell"

    @pytest.mark.parametrize(
        ("about", "state"),
        [
            (About(error=0.003), "pass"),
            (About(error=0.03), "doubt"),  # of a metre: a hundredth is allowed
            (About(error=0.003, warnings=("unstable step",)), "doubt"),
            (About(error=np.nan), "doubt"),
            (About(error=0.03, of_steps=0.003, model=(None,)), "pass"),  # rigid: only steps are off
            (About(error=0.003, of_steps=0.03, model=(None,)), "doubt"),
        ],
    )
    def test_a_model_passes_whose_error_is_below_a_hundredth_of_the_travel_and_whose_run_was_not_warned(
        self, page_of: Any, about: About, state: str
    ) -> None:
        assert page_of(about).verdicts[0].state == state

    def test_an_error_that_is_not_known_is_not_told_but_until_when_it_would_be(self, page_of: Any) -> None:
        part = page_of(About(error=np.nan, known=False))
        assert numbers(said(part, "Up to ")) == [0.25, 1]
        assert "0.3 mm" in part.sentences[0] or "300 µm" in part.sentences[0]
        assert "unknown" in said(page_of(About(of_steps=np.nan)), "Tip error from the time steps")


# what was measured


@pytest.fixture(scope="module")
def weighed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Measured, dict[str, np.ndarray]]:
    """A bar that falls, filmed with another payload."""
    bar = fl.Link(name="bar", length=1.0, flex="z", segments=3, material="steel", section="bar")
    arm = fl.Arm(
        links=(bar,), materials={"steel": fl.Material(young=E, density=RHO)},
        sections={"bar": fl.Section(shape="rectangle", height=0.01, width=0.01)}, tip=fl.RigidBody(mass=0.5),
    )  # fmt: skip
    scene = fl.Scene(
        name="bar", arm=arm, gravity=(0.0, -G, 0.0), initial=fl.InitialState(joint_deg=(0.0,)),
        drive=fl.Drive(kind="constant", torque=(3.0,)), run=fl.RunSettings(duration=0.3, sample=0.01, step=1e-3),
    )  # fmt: skip
    true = fl.simulate(scene.varied({"tip.mass": 0.6})).columns
    seen = {name: true[name] for name in ("t [s]", "tip x [m]", "tip y [m]")}
    path = tmp_path_factory.mktemp("film") / "film.csv"
    rows = np.column_stack([*seen.values()])
    rows = np.vstack([rows, rows[-1] + [1.0, 0.0, 0.0]])  # a sample after the run
    np.savetxt(path, rows, delimiter=",", header=",".join(seen), comments="", fmt="%.17g")
    return Study(scene, path), Measured(seen["t [s]"], {}), {k: np.asarray(v) for k, v in seen.items()}


class TestMeasurements:
    def test_differences_are_root_mean_squares_and_the_payload_explains_them(self, weighed: tuple[Any, ...]) -> None:
        study, _, seen = weighed
        part, run = measurements.made(study), study.run
        assert numbers(said(part, "film.csv: "))[:2] == [2, 31]
        assert "; 1 outside the run are ignored" in part.sentences[0]
        off = {f"tip {a} [m]": run.tip[:, k] - seen[f"tip {a} [m]"] for k, a in enumerate("xy")}
        rms = {name: float(np.sqrt(np.mean(e**2))) for name, e in off.items()}
        worst = max(rms, key=lambda name: rms[name] / seen[name].std())
        share = 100 * rms[worst] / np.ptp(seen[worst])
        assert numbers(said(part, "RMS difference: ").replace("tip", "")) == pytest.approx(
            [1e3 * rms[worst], share], **DIGITS
        )
        assert numbers(part.verdicts[0].word) == pytest.approx([1e3 * rms[worst]], **DIGITS)
        for line in table(part, "measured"):
            e = np.abs(off[line["column"]])
            assert line["RMS difference"] == pytest.approx(rms[line["column"]], rel=1e-6)
            assert (line["largest difference"], line["at [s]"]) == pytest.approx((e.max(), run.t[e.argmax()]), rel=1e-6)
            assert line["RMS after fitting"] < 1e-4 * line["RMS difference"]
        best, *others = table(part, "numbers")
        assert best["path"] == "tip.mass"
        assert (best["in the scene"], best["fitted"], best["factor"]) == pytest.approx((0.5, 0.6, 1.2), rel=1e-5)
        percent, _, value, _, before, _ = numbers(said(part, "Best explanation: "))
        assert (percent, value, before) == pytest.approx((20.0, 0.6, 0.5), **DIGITS)
        assert said(part, "Best explanation: ").startswith("payload +")
        for line in others[:2]:  # fitted anew, alone
            again = fl.simulate(study.scene.varied({line["path"]: line["fitted"]})).tip
            size = max(seen[name].std() for name in off)
            now, then = (sum(float(((tip[:, k] - seen[f"tip {a} [m]"]) ** 2).sum()) for k, a in enumerate("xy")) / size**2
                         for tip in (again, run.tip))  # fmt: skip
            assert line["remaining difference"] == pytest.approx(np.sqrt(now / then), rel=1e-3)
        assert [line["remaining difference"] for line in [best, *others]] == sorted(
            line["remaining difference"] for line in [best, *others]
        )


# other engines


def row(q: float, explained: float = 1e-9, diverged: str = "") -> RunDifference:
    return RunDifference("mujoco", q, 2 * q, 3 * q, 0.25, "upper", explained, diverged)


class TestAgreement:
    def part(self, monkeypatch: pytest.MonkeyPatch, study: Study, terms: float, run: RunDifference) -> Part:
        rows = [SimpleNamespace(quantity="M", error=terms, passed=terms <= 1)]
        one = SimpleNamespace(engine="mujoco", rows=rows, passed=terms <= 1)

        def compare(scene: fl.Scene, engines: list[str], samples: int) -> Any:
            return SimpleNamespace(diagnoses=[one] if engines == ["mujoco"] else [])

        def runs(scene: fl.Scene, duration: float) -> Any:
            return SimpleNamespace(rows=[run], steps=f"{duration:g} s", refused=("drake: free base",))

        monkeypatch.setattr(agreement, "compare", compare)
        monkeypatch.setattr(agreement, "compare_trajectories", runs)
        return agreement.made(study)

    @pytest.mark.parametrize(
        ("terms", "run", "state"),
        [
            (0.3, row(1e-10), "pass"),
            (3.0, row(1e-10), "fail"),
            (0.3, row(1e-8), "fail"),
            (0.3, row(0.0, diverged="fell"), "fail"),
        ],
    )
    def test_an_engine_agrees_whose_terms_and_run_do(
        self, move: Study, monkeypatch: pytest.MonkeyPatch, terms: float, run: RunDifference, state: str
    ) -> None:
        part = self.part(monkeypatch, move, terms, run)
        (verdict,) = part.verdicts
        assert verdict.state == state
        assert ("MuJoCo" in verdict.text) == (state == "fail" or "Same terms" in verdict.text)
        assert table(part, "terms")[0]["M"] == terms
        assert table(part, "terms")[0]["verdict"] == ("agrees" if terms <= 1 else "DIFFERS")
        line = table(part, "runs")[0]
        assert list(line.values())[1:5] == [run.q, run.qd, run.tip, run.explained]
        assert line["verdict"] == ("agrees" if run.passed else "DIFFERS")
        assert ("MuJoCo: fell." in part.sentences) == bool(run.diverged)
        assert "Not compared: drake: free base." in part.sentences

    def test_a_motion_that_amplifies_rounding_proves_little(self, move: Study, monkeypatch: pytest.MonkeyPatch) -> None:
        for explained in (MEANINGFUL_TOLERANCE / 3, 3 * MEANINGFUL_TOLERANCE):
            said_so = any(
                "proves little" in s for s in self.part(monkeypatch, move, 0.1, row(0.0, explained)).sentences
            )
            assert said_so == (explained > MEANINGFUL_TOLERANCE)

    def test_as_much_of_a_run_is_compared_as_eight_thousand_evaluations_are(self, move: Study) -> None:
        """Four a step of 1 ms: two seconds, in samples of 5 ms; less where the run is shorter."""
        assert method("RK4").stages == 4
        assert agreement._affordable(Study(move.scene.varied({"run.duration": 8.0}))) == pytest.approx(2.0)
        assert agreement._affordable(move) == 0.6


@pytest.mark.parametrize("passed", [True, False])
def test_another_file_agrees_or_its_first_mistake_that_counts_is_told(
    move: Study, monkeypatch: pytest.MonkeyPatch, passed: bool
) -> None:
    class Found(str):
        counts = True

    mistakes = [Found("a hint"), Found("gravity has the wrong sign"), Found("mass")]
    mistakes[0].counts = False  # type: ignore[misc]
    rows = [SimpleNamespace(quantity="T_G", error=7.0, joint="fore", passed=passed)]

    class Diagnosis(SimpleNamespace):
        def __str__(self) -> str:
            return "differs\n  gravity"

    found = Diagnosis(engine="mujoco", rows=rows, findings=mistakes, passed=passed)
    monkeypatch.setattr(theirs, "compare", lambda *_, **__: SimpleNamespace(diagnoses=[found]))
    part = theirs.made(Study(move.scene, ROOT / "their.xml"))
    assert part is not None
    assert part.verdicts[0].state == ("pass" if passed else "fail")
    assert ("their.xml: gravity has the wrong sign" == part.verdicts[0].text) != passed
    assert table(part, "theirs")[0]["verdict"] == ("agrees" if passed else "DIFFERS")


class TestGantry:
    """A bridge and a trolley that slide, one without a drive's force: forces and torques each in their unit."""

    @pytest.fixture(scope="class")
    @classmethod
    def gantry(cls) -> Study:
        scene = fl.load_scene(ROOT / "models" / "gantry.toml")
        drive = fl.Drive(
            kind="pd", kp=(4e4, 1e4, 50.0), kd=(8e3, 2e3, 1.0), target_m=(1.0, -1.2, 0.0), target_deg=(0.0, 0.0, 0.0)
        )  # fmt: skip
        leaning = {"link.boom.joint.locked": False, "link.boom.segments": 3, "initial.joint_deg": (0.0, 0.0, 5.0)}
        return Study(scene.varied({"run.duration": 0.2, "drive": drive, **leaning}))

    def test_forces_and_torques_are_told_apart(self, gantry: Study) -> None:
        part, run = loads.made(gantry), gantry.run
        force, torque = np.abs(run.tau[:, :2]).max(axis=0), np.abs(run.tau[:, 2]).max()
        assert numbers(said(part, "Largest drive force: ")) == pytest.approx([force.max()], **DIGITS)
        assert said(part, "Largest drive force: ").endswith(f"N at {('bridge', 'trolley')[int(force.argmax())]}")
        assert numbers(said(part, "Largest drive torque: ")) == pytest.approx([torque], **DIGITS)

    def test_positions_and_limits_have_their_unit(self, gantry: Study) -> None:
        part = model.made(gantry)
        lines = table(part, "sliding")
        assert [line["start [m]"] for line in lines] == [0.5, -1.0]
        assert [line["viscous friction [N s/m]"] for line in lines] == [200.0, 80.0]
        assert [numbers(line["limits [m]"]) for line in lines] == [[0.0, 8.0], [-2.0, 2.0]]
        assert [line["joint"] for line in table(part, "joints")] == ["boom"]
        columns = picture(motion.made(gantry), "motion")
        assert columns["bridge [m]"].tolist() == gantry.run.q[:, 0].tolist()

    def test_held_forces_are_none_and_the_torque_is_that_of_the_leaning_boom(self, gantry: Study) -> None:
        forces, (torque,) = table(statics.made(gantry), "forces"), table(statics.made(gantry), "holding")
        assert [line["force [N]"] for line in forces] == [0.0, 0.0]
        assert [line["position [m]"] for line in forces] == [0.5, -1.0]
        weight = 7850 * (0.10 * 0.06 - 0.092 * 0.052) * 4.0
        assert abs(torque["torque [N m]"]) == pytest.approx(
            G * np.sin(np.radians(5.0)) * 4.0 * (60 + weight / 2), rel=0.02
        )


def test_tables_are_of_numbers() -> None:
    assert Table("name", "Title", ("a", "b"), (("x", 1.5), ("y", None))).csv == "a,b\nx,1.5\ny,\n"
