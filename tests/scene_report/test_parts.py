"""Numbers and verdicts of report chapters agree with independent results: closed forms, loops, SciPy."""

import importlib
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import root

import flexlink as fl
from flexlink.dynamics.vibration.modal import Modes
from flexlink.pages.numbers import JOIN
from flexlink.pages.page import Part
from flexlink.results.convergence import resolved
from flexlink.scene_report import building
from flexlink.scene_report.arm_picture import of_arm
from flexlink.scene_report.parts import loads, measurements, statics, vibration
from flexlink.scene_report.parts.loads import peak_stress
from flexlink.scene_report.refinement import Refinement
from flexlink.scene_report.report import report
from flexlink.scene_report.study import Study
from tests.conftest import ROOT, flexible, make_scene
from tests.support.words import reviewed

Array = np.ndarray
PARTS = "flexlink.scene_report.parts"
THREE_DIGITS = 5.01e-3
"""Relative rounding error of a number with three digits."""

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def made(name: str, study: Any) -> Part:
    """Build a chapter."""
    found: Part = importlib.import_module(f"{PARTS}.{name}").made(study)
    return found


def numbers(text: str) -> list[float]:
    """Numbers in a text of a page."""
    found = re.findall(r"(?<![\w.])−?\d+(?:\.\d+)?(?:\s×\s10[⁻⁰-⁹¹²³]+)?(?!\w)", text.replace("frame 0", ""))
    return [float(re.sub(r"\s×\s10", "e", one).translate(SUPERSCRIPTS).replace("−", "-")) for one in found]


def three(*values: float) -> Any:
    """Tolerance for values printed with three digits: half a unit in the last digit of 1.00 is 0.5 %."""
    return pytest.approx(list(values), rel=THREE_DIGITS)


def check_sentence(
    part: Part, key: str, values: Sequence[float], *parts: str, rel: float = THREE_DIGITS, compare: bool = True
) -> str:
    """Return the only sentence of a chapter with these numbers in this order and these parts, after comparing its text.

    With `compare=False`, its other numbers are not compared with the reviewed text.
    """
    count = len(values)

    def fits(text: str) -> bool:
        shown = numbers(text)
        near = [pytest.approx(list(values), rel=rel) == shown[k : k + count] for k in range(len(shown) - count + 1)]
        return any(near) and all(each in text for each in parts)

    fitting = [text for text in part.sentences if fits(text)]
    assert len(fitting) == 1, (values, parts, part.sentences)
    reviewed(key, fitting[0], values=compare)
    return fitting[0]


def table(part: Part, name: str) -> dict[str, list[Any]]:
    """Columns of a table by their heads."""
    (one,) = [one for one in part.tables if one.name == name]
    return dict(zip(one.heads, map(list, zip(*one.lines, strict=True)), strict=True))


def picture(part: Part, name: str) -> dict[str, Array]:
    """Columns of the CSV file of a picture."""
    (one,) = [one for one in part.pictures if one.name == name]
    heads, *lines = one.csv.splitlines()
    return dict(zip(heads.split(","), np.array([line.split(",") for line in lines], float).T, strict=True))


def with_run(study: Study, run: Any) -> Study:
    """The same scene with another run."""
    other = Study(study.scene)
    other.__dict__["attempt"] = run
    return other


L, HEIGHT, WIDTH, E, RHO, LOAD, ASIDE, G = 0.8, 0.02, 0.03, 2.1e11, 7850.0, 2.0, 0.1, 9.81
EI, WEIGHT = E * WIDTH * HEIGHT**3 / 12, RHO * WIDTH * HEIGHT * G  # bending stiffness about z [N m²]; weight [N/m]
MOMENT, SHEAR = G * LOAD * L + WEIGHT * L**2 / 2, G * LOAD + WEIGHT * L  # moment and shear force at the root


def bar_of(height: float, width: float, mass: float, link: dict[str, Any]) -> fl.Arm:
    return fl.Arm(
        links=(fl.Link(name="bar", material="steel", section="bar", **link),),
        materials={"steel": fl.Material(young=E, density=RHO, loss_time=1e-4)}, tip=fl.RigidBody(mass=mass),
        sections={"bar": fl.Section(shape="rectangle", height=height, width=width)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def held() -> Study:
    """A bar along −x, held by its drive, with a load off its axis: the torque is negative, and the bar twists."""
    arm = bar_of(HEIGHT, WIDTH, LOAD, {"length": L, "flex": "yz", "segments": 9, "lumping": "lobatto4"})
    drive = fl.Drive(kind="pd", kp=(4e4,), kd=(4e2,), target_deg=(180.0,), gravity="static")
    still = fl.InitialState(joint_deg=(180.0,), passive="static")
    run = fl.RunSettings(duration=0.05, sample=0.01, tolerance=1e-6)
    scene = fl.Scene(name="held", gravity=(0.0, -G, 0.0), arm=arm, initial=still, drive=drive, run=run)
    return Study(scene.varied({"tip.center": (0.0, 0.0, ASIDE)}))


class TestHeld:
    """Sag, stress and loads of a cantilever; errors due to eight hinges and small-angle theory are below 1e-4."""

    def test_sag_and_holding_torque_equal_those_of_a_beam(self, held: Study) -> None:
        part, sag = made("statics", held), 1e3 * (G * LOAD * L**3 / (3 * EI) + WEIGHT * L**4 / (8 * EI))
        (text,) = [text for text in part.sentences if len(numbers(text)) == 4]
        reviewed("report numbers: static tip deflection", text)
        size, x, y, z = numbers(text)
        assert [size, y, *numbers(part.facts[0].value)] == three(sag, -sag, sag)
        assert max(abs(x), abs(z)) < 2e-3 * sag
        assert re.findall(r"\w*stable\b", " ".join(part.sentences)) == ["stable"]
        largest = 0.08 * held.chain.size / (1e-3 * sag)  # the drawn deflection is at most a twelfth of the reach
        scale = max(times for times in (1, 2, 5, 10, 20, 50, 100, 200, 500) if times <= largest)
        assert numbers(part.pictures[0].caption) == [scale]
        reviewed("report numbers: caption of the sag", part.pictures[0].caption)
        assert table(part, "holding")["torque [N m]"] == pytest.approx([-MOMENT], rel=1e-4)
        assert numbers(part.facts[1].value) == three(MOMENT)

    @pytest.mark.slow
    def test_root_loads_equal_those_of_a_beam_and_the_largest_torque_is_positive(self, held: Study) -> None:
        part = made("loads", held)
        texts = (text for text in part.sentences if numbers(text)[:1] == three(MOMENT))
        drive, bending = sorted(texts, key=lambda text: len(numbers(text)))
        assert (numbers(drive), len(numbers(bending))) == (three(MOMENT), 2)
        reviewed("report numbers: largest bending moment", bending, values=False)  # at rest all samples are equal
        reviewed("report numbers: largest drive torque", drive)
        heads = ("shear [N]", "torque [N m]", "bending [N m]", "drive [N m]")
        root_loads = [table(part, "loads")[head][0] for head in heads]
        assert root_loads == pytest.approx([SHEAR, G * LOAD * ASIDE, MOMENT, MOMENT], rel=1e-4)
        assert numbers(part.facts[0].value) == three(1e-6 * MOMENT * HEIGHT / 2 / (EI / E))  # M c / I
        found = peak_stress(held.run)
        assert found is not None and (found.link, found.along, found.rectangle) == ("bar", 0.0, False)

    @pytest.mark.parametrize(
        ("times", "scale"), [(0.9, []), (1.9, []), (2.0, [2]), (4.9, [2]), (9.9, [5]), (19.0, [10]), (49.0, [20])]
    )
    def test_the_drawn_deflection_is_magnified_by_the_round_number_below(
        self, held: Study, times: float, scale: list[int]
    ) -> None:
        """The largest magnification, a twelfth of the arm's size over the sag, is rounded down to 1, 2, 5, 10, …"""
        assert numbers(statics._picture(held, 0.08 * held.chain.size / times).caption) == scale

    def test_the_model_chapter_shows_the_counts_and_the_mass_of_the_arm(self, held: Study) -> None:
        part, chain = made("model", held), held.chain
        check_sentence(part, "report numbers: size of the model", [1, L, LOAD + WEIGHT * L / G, 17, 1, 16])
        check_sentence(part, "report numbers: gravity", [0, -G, 0], "m/s²")
        links, joints, springs = (table(part, name) for name in ("links", "joints", "springs"))
        assert [links[h] for h in ("length [m]", "hinges", "damping time [s]")] == [[L], [8], [1e-4]]
        assert [links[h] for h in ("bends about", "rule", "material", "section")] == [
            ["yz"],
            ["lobatto4"],
            ["steel"],
            ["bar"],
        ]
        assert [joints[h] for h in ("start [deg]", "limits [deg]")] == [[180.0], ["none"]]
        hinges = [chain.joint_names.index(name) for name in springs["spring"]]
        assert sorted(hinges) == list(range(1, 17))
        assert springs["damping [N m s/rad]"] == pytest.approx(1e-4 * np.array(springs["stiffness [N m/rad]"]))
        assert springs["start [deg]"] == pytest.approx(np.degrees(held.start[0][hinges]), rel=1e-12)
        assert [names.count("bar.") for names in springs["coupled with"]] == [3] * 16  # the 3 other hinges of its cell

    def test_only_one_mode_per_two_hinges_and_axis_is_resolved(self, held: Study) -> None:
        part = made("vibration", held)
        check_sentence(part, "report numbers: modes not resolved", [9])
        modes = table(part, "modes")
        elastic = [fine for fine, kind in zip(*(modes[h] for h in ("resolved by the hinges", "kind")), strict=True)
                   if kind == "elastic"]  # fmt: skip
        assert elastic == ["yes"] * 8 + ["no"] * (len(elastic) - 8)

    def test_an_arm_at_rest_does_not_settle_and_loses_no_energy(self, held: Study) -> None:
        part = made("settling", held)
        (text,) = part.sentences
        reviewed("report numbers: settling at rest", text)
        assert not part.tables
        assert made("energy", held).verdicts[0].state == "pass"
        lost = with_run(held, replace(held.run, work=held.run.work + 1e-3 * held.run.t))
        assert made("energy", lost).verdicts[0].state == "doubt"


GOAL, PUSH = (-25.0, 30.0, -60.0), np.array([-150.0, -90.0, -60.0])


@pytest.fixture(scope="module")
def move() -> Study:
    """An arm of three joints in space that follows a reference and then rings."""
    course = fl.Reference(profile="quintic", to_deg=GOAL, duration=0.25)
    change = {
        "run.duration": 0.6, "run.step": 1e-3, "link.upper.segments": 2, "link.fore.segments": 2,
        "link.*.lumping": "midpoint", "drive.gravity": "none", "drive.reference": course,
        "wrench": fl.Wrench(force=tuple(PUSH.tolist())), "material.aluminium.loss_time": 2e-3,
    }  # fmt: skip
    return Study(fl.load_scene(ROOT / "models" / "ptp_move.toml").varied(change))


def straight(study: Study, q: Array) -> Array:
    """Position of the tip with all springs at 0."""
    return fl.tip_position(study.chain, np.where(study.chain.stiffness > 0, 0.0, q))


def of_loads(study: Study, q: Array) -> Array:
    """Torques that balance gravity and the tip force."""
    tip, steps = (lambda at: fl.tip_position(study.chain, at)), 1e-4 * np.eye(study.chain.n)
    J = np.array([(tip(q + h) - tip(q - h)) / 2e-4 for h in steps])
    return np.asarray(fl.gravity_torque(study.chain, q) - J @ PUSH)


def bent(study: Study, q: Array) -> Array:
    """Angles at which the springs balance gravity and the tip force, with locked driven joints."""
    free, found = study.chain.stiffness > 0, q.copy()

    def left(angles: Array) -> Array:
        found[free] = angles
        return (of_loads(study, found) + study.chain.stiffness * found)[free]

    found[free] = root(left, np.zeros(int(free.sum())), tol=1e-12).x
    return found


def target_of(study: Study) -> Array:
    """Static position of the tip at the end of the reference, with bent links."""
    goal = np.zeros(study.chain.n)
    goal[study.chain.active] = np.radians(GOAL)
    return fl.tip_position(study.chain, bent(study, goal))


def test_an_arm_without_loads_has_no_sag_no_holding_torque_and_no_direction_down(held: Study) -> None:
    floating = Study(held.scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    part = made("statics", floating)
    assert (part.facts, part.pictures) == ((), ())
    assert table(part, "holding")["torque [N m]"] == [0.0]
    reviewed("report numbers: nothing bends the links", part.sentences[0])
    captions = [made("model", study).pictures[0].caption for study in (held, floating)]
    assert len(captions[0]) > len(captions[1])
    reviewed("report numbers: caption without gravity", captions[1])


@pytest.mark.parametrize(("torques", "largest"), [((2.0, -7.0, 5.0), [1, 2]), ((-7.0, 1e-15, 0.0), [0])])
def test_the_largest_holding_torques_are_the_largest_in_size(move: Study, torques: Array, largest: list[int]) -> None:
    tau = np.zeros(move.chain.n)
    tau[move.held] = torques
    (fact,) = statics._held(move, tau)
    assert numbers(fact.value) == [abs(torques[k]) for k in largest]
    names = [move.chain.joint_name(k) for k in move.held]
    assert re.findall("|".join(names), fact.label) == [names[k] for k in largest]


@pytest.mark.parametrize(("name", "known"), [("m.csv", True), ("M.CSV", True), ("arm.urdf", False), ("csv", False)])
def test_a_csv_file_contains_measurements_and_any_other_file_an_arm(held: Study, name: str, known: bool) -> None:
    assert Study(held.scene, against=Path(name)).measurements is known


def test_a_picture_of_an_arm_on_a_free_base_begins_at_the_base() -> None:
    chain = fl.lump(fl.load_scene(ROOT / "models" / "satellite.toml"))
    q = np.arange(1.0, chain.n + 1)
    places = of_arm(chain, fl.frames(chain, q).points)
    assert places[0] == pytest.approx(q[:3])


class TestMove:
    def test_travel_and_deflection_are_the_largest_distances_with_their_time(self, move: Study) -> None:
        part, run = made("motion", move), move.run
        off = [float(np.linalg.norm(tip - straight(move, q))) for tip, q in zip(run.tip, run.q, strict=True)]
        far = [float(np.linalg.norm(tip - run.tip[0])) for tip in run.tip]
        text = check_sentence(part, "report numbers: simulated time", [0.6])
        assert numbers(text)[-1:] == three(max(far))
        most = [1e3 * max(off), run.t[int(np.argmax(off))]]
        check_sentence(part, "report numbers: tip deflection", most)
        columns, k = picture(part, "motion"), move.chain.joint_names.index("fore")
        assert columns["tip deflection [m]"] == pytest.approx(off, rel=1e-9, abs=1e-15)
        assert columns["fore [deg]"] == pytest.approx(run.q[:, k] * 180 / np.pi, rel=1e-12)
        postures = picture(part, "postures")
        times, tips = (postures[head][postures["body"] == move.chain.tips["fore"]] for head in ("time [s]", "x [m]"))
        assert tips == pytest.approx(np.interp(times, run.t, run.tip[:, 0]), abs=1e-9)
        assert times[[0, -1]].tolist() == [0.0, 0.6]
        heads, *rows = part.files["run.csv"].splitlines()
        rows_of_run = np.array([run.columns[head] for head in heads.split(",")]).T
        np.testing.assert_array_equal(np.array([row.split(",") for row in rows], float), rows_of_run)

    def test_a_failed_run_does_not_pass_and_warnings_are_shown(self, move: Study) -> None:
        failed = Study(move.scene.varied({"run.step": 0.05, "run.sample": 0.05}))  # above the largest stable step
        part = made("motion", failed)
        assert [(v.about, v.state) for v in part.verdicts] == [("Run", "fail")]
        assert str(failed.attempt) in part.sentences[0]
        warned = made("motion", with_run(move, replace(move.run, warnings=("mind the step",))))
        (text,) = (text for text in warned.sentences if "mind the step" in text)
        reviewed("report numbers: warning of a run", text)

    def test_the_simulated_time_of_a_run_that_begins_later_is_its_length(self, move: Study) -> None:
        later = replace(move.run, t=move.run.t + 2.0)
        assert numbers(made("motion", with_run(move, later)).sentences[0])[0] == 0.6

    @pytest.mark.slow
    def test_the_largest_loads_are_found_sample_by_sample(self, move: Study) -> None:
        part, run, chain = made("loads", move), move.run, move.chain
        F, M = run.loads.force, run.loads.moment
        best = max((float(np.hypot(*M[row, body, 1:])), -row, body)
                   for row in range(len(run.t)) for body in range(len(chain.bodies) - 1))  # fmt: skip
        joint = chain.joint_name(int(chain.bodies["first"][best[2]]))
        check_sentence(part, "report numbers: largest bending moment", [best[0], run.t[-best[1]]], joint)
        torque = {chain.joint_name(k): max(abs(x) for x in run.tau[:, k]) for k in chain.active.tolist()}
        most = max(torque, key=torque.__getitem__)
        check_sentence(part, "report numbers: largest drive torque", [torque[most]], most)
        cuts = [chain.body(k) for k, name in enumerate(chain.joint_names) if name.startswith(("upper", "fore"))]
        bending = np.hypot(*np.moveaxis(M[:, cuts, 1:], 2, 0)).max(axis=1)
        stress = bending * 0.045 / 2 / (np.pi / 64 * (0.045**4 - 0.037**4))  # bending stress of a tube
        assert numbers(part.facts[0].value) == three(1e-6 * stress.max())
        assert f"at {run.t[stress.argmax()]:g} s" in part.facts[0].label
        lines, columns = table(part, "loads"), picture(part, "loads")
        for place, name in enumerate(lines.pop("location")):
            k = chain.joint_names.index(name)
            f, m = F[:, chain.body(k)].T, M[:, chain.body(k)].T
            expected = [max(0.0, *f[0]), max(0.0, *-f[0]), max(np.hypot(f[1], f[2])), max(*m[0], *-m[0]),
                        max(np.hypot(m[1], m[2]))]  # fmt: skip
            *found, drive = (column[place] for column in lines.values())
            assert found == pytest.approx(expected, rel=1e-12)
            assert drive == torque.get(name)
            if name in torque:
                own = [chain.body(j) for j, other in enumerate(chain.joint_names) if other.split(".")[0] == name]
                largest = np.linalg.norm(M[:, own, 1:], axis=2).max(axis=1)
                assert columns[f"bending {name} [N m]"] == pytest.approx(largest, rel=1e-12)
                np.testing.assert_array_equal(columns[f"drive {name} [N m]"], run.tau[:, k])

    def test_the_target_is_the_static_position_and_ringing_starts_after_the_reference(self, move: Study) -> None:
        part, run, target = made("settling", move), move.run, target_of(move)
        off = np.linalg.norm(run.tip - target, axis=1)
        late = run.tip[run.t >= 0.25]
        middle = (late.max(axis=0) + late.min(axis=0)) / 2
        left = max(np.linalg.norm(tip - middle) for tip in late)
        check_sentence(part, "report numbers: residual vibration", [1e3 * left, 0.25, 1e3 * off[-1]])
        way = target - run.tip[0]
        beyond = max(0.0, *((run.tip - target) @ way / np.linalg.norm(way)))
        check_sentence(part, "report numbers: overshoot", [1e3 * beyond])
        distance = picture(part, "settling")["distance to target [m]"]
        assert distance == pytest.approx(off, rel=1e-6, abs=1e-9)

    def test_without_a_reference_the_target_of_a_drive_applies_from_the_start(self, move: Study) -> None:
        drive = fl.Drive(kind="pd", kp=(4e4,) * 3, kd=(4e2,) * 3, target_deg=GOAL)
        study = Study(move.scene.varied({"drive": drive, "run.duration": 0.1}))
        tip = study.run.tip
        off = np.linalg.norm(tip[-1] - target_of(move))
        left = np.linalg.norm(tip - (tip.max(axis=0) + tip.min(axis=0)) / 2, axis=1).max()
        check_sentence(made("settling", study), "report numbers: residual vibration", [1e3 * left, 0.0, 1e3 * off])

    def test_after_the_settling_time_the_tip_stays_close_to_its_target(self, move: Study) -> None:
        """The distance 0.5 m e^(−20 t) is a fraction p of the travel at t = −ln p / 20; samples are 0.01 s apart."""
        t = 0.25 + 0.01 * np.arange(100)
        tip = target_of(move) + np.exp(-20 * (t - 0.25))[:, None] * [0.3, 0.0, 0.4]
        lines = table(made("settling", with_run(move, replace(move.run, t=t, tip=tip))), "settling")
        parts, travel = np.array([1e-2, 1e-3, 1e-4]), 0.5 * (1 - np.exp(-20 * 0.99))
        shares = lines["part of the travel [%]"]
        assert shares == (100 * parts).tolist()
        assert lines["tolerance [m]"] == pytest.approx(parts * travel, rel=1e-9)
        steps = np.ceil(-np.log(parts * travel / 0.5) / 20 / 0.01)
        assert lines["settling time [s]"] == pytest.approx(0.01 * steps, abs=1e-9)

    def test_a_run_that_ends_before_its_reference_has_no_settling_time(self, move: Study) -> None:
        part = made("settling", Study(move.scene.varied({"run.duration": 0.2})))
        check_sentence(part, "report numbers: run shorter than its reference", [0.25, 0.2], "run.duration")
        assert not part.tables

    def test_the_energy_balance_follows_from_states_and_work(self, move: Study) -> None:
        part, run, chain = made("energy", move), move.run, move.chain
        kinetic = np.array([qd @ fl.mass_matrix(chain, q) @ qd / 2 for q, qd in zip(run.q, run.qd, strict=True)])
        elastic = (chain.stiffness * run.q**2).sum(axis=1) / 2
        columns = picture(part, "energy")
        T, V, U, W = (x - x[0] for x in (columns[f"{name} [J]"] for name in ("kinetic", "gravity", "elastic", "work")))
        assert pytest.approx(kinetic - kinetic[0], rel=1e-9, abs=1e-9) == T
        assert pytest.approx(elastic - elastic[0], rel=1e-9, abs=1e-9) == U
        off, size = np.abs(T + V + U - W), (T + abs(V) + abs(U) + abs(W)).max()
        assert numbers(part.sentences[0]) == three(off.max(), run.t[off.argmax()], 100 * off.max() / size, size)

    @pytest.mark.parametrize(("share", "state"), [(0.3e-3, "pass"), (3e-3, "doubt")])
    def test_unexplained_energy_does_not_pass(self, move: Study, share: float, state: str) -> None:
        """The limit is 0.001 of the energy exchanged; the planted errors at 0.4 s are 0.3 and 3 times the limit."""
        run = move.run
        planted = share * float(run.exchanged[-1]) * np.exp(-(((run.t - 0.4) / 0.01) ** 2))
        part = made("energy", with_run(move, replace(run, work=run.work + planted)))
        assert part.verdicts[0].state == state
        assert numbers(part.sentences[0])[:3] == pytest.approx([planted.max(), 0.4, 100 * share], rel=0.01)


class TestRest:
    """The moving arm at rest in its initial configuration: stiffness by differences, eigenvalues of dense matrices."""

    @pytest.fixture(scope="class")
    @classmethod
    def rest(cls, move: Study) -> tuple[Array, Array, Array]:
        """Angles at rest, stiffness matrix of the springs, and stiffness matrix of the loads."""
        q, free = bent(move, move.start[0]), move.chain.stiffness > 0
        slopes = np.array([(of_loads(move, q + h) - of_loads(move, q - h)) / 2e-4 for h in 1e-4 * np.eye(len(q))])
        return q, np.diag(move.chain.stiffness[free]), slopes[np.ix_(free, free)]

    def test_sag_torques_and_buckling_are_computed_for_the_bent_arm(self, move: Study, rest: tuple[Array, ...]) -> None:
        part, (q, K, S) = made("statics", move), rest
        sag = 1e3 * (fl.tip_position(move.chain, q) - straight(move, q))
        deflection = [float(np.linalg.norm(sag)), *sag]
        check_sentence(part, "report numbers: static tip deflection", deflection)
        tau, lines = of_loads(move, q)[move.chain.active], table(part, "holding")
        assert lines["torque [N m]"] == pytest.approx(tau.tolist(), rel=1e-6, abs=1e-6)
        assert lines["angle [deg]"] == pytest.approx([0.0, 45.0, -60.0], abs=1e-9)
        assert numbers(part.facts[1].value) == three(*sorted(np.abs(tau))[:0:-1])
        largest = [lines["joint"][k] for k in np.argsort(-np.abs(tau))[:2]]
        assert re.findall("|".join(lines["joint"]), part.facts[1].label) == largest
        reviewed("report numbers: label of the holding torques", part.facts[1].label)
        factors = 1 / eigh(-(S + S.T) / 2, K, eigvals_only=True)
        check_sentence(part, "report numbers: buckling load", [min(f for f in factors if f > 0)])

    def test_rigid_links_need_holding_torques_and_have_no_sag(self, move: Study) -> None:
        study = Study(move.scene.rigidified().varied({"wrench": move.scene.wrench}))
        part, tau = made("statics", study), of_loads(study, study.start[0])
        assert table(part, "holding")["torque [N m]"] == pytest.approx(tau.tolist(), rel=1e-6)
        assert numbers(part.facts[0].value) == three(*sorted(np.abs(tau))[:0:-1])

    def test_modes_equal_those_of_dense_matrices(self, move: Study, rest: tuple[Array, ...]) -> None:
        part, (q, K, S), free = made("vibration", move), rest, move.chain.stiffness > 0
        M, D = fl.mass_matrix(move.chain, q)[np.ix_(free, free)], np.diag(move.chain.damping[free])
        A = np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, K + S), -np.linalg.solve(M, D)]])
        λ = np.array(sorted((one for one in np.linalg.eigvals(A) if one.imag > 0), key=abs))
        lines, hertz, ratios = table(part, "modes"), np.abs(λ) / 2 / np.pi, -λ.real / np.abs(λ)
        assert lines["frequency [Hz]"] == pytest.approx(hertz, rel=1e-3)
        assert lines["damping ratio"] == pytest.approx(ratios, rel=2e-3)
        check_sentence(part, "report numbers: first elastic frequency", [hertz[0], ratios[0]], rel=1e-2)
        assert numbers(part.facts[0].value) == pytest.approx(hertz[:2], rel=1e-2)
        shapes = np.zeros((2, move.chain.n))
        shapes[:, free] = 1e-4 * eigh(K + (S + S.T) / 2, M)[1].T[:2]
        moved = [np.abs(fl.tip_position(move.chain, q + h) - fl.tip_position(move.chain, q - h)) for h in shapes]
        axes = lines["tip moves most along"]
        assert axes[:2] == ["xyz"[int(way.argmax())] for way in moved]


class TestGantry:
    """A sliding bridge and trolley and a hinged boom: forces in N, torques in N m."""

    @pytest.fixture(scope="class")
    @classmethod
    def gantry(cls) -> Study:
        drive = fl.Drive(
            kind="pd", kp=(4e4, 1e4, 50.0), kd=(8e3, 2e3, 1.0), target_m=(1.0, -1.2, 0.0), target_deg=(0.0, 0.0, 0.0)
        )  # fmt: skip
        leaning = {"link.boom.joint.locked": False, "link.boom.segments": 3, "initial.joint_deg": (0.0, 0.0, 5.0)}
        scene = fl.load_scene(ROOT / "models" / "gantry.toml")
        return Study(scene.varied({"run.duration": 0.2, "drive": drive, **leaning}))

    def test_forces_and_torques_of_drives_are_separate(self, gantry: Study) -> None:
        part, largest = made("loads", gantry), np.abs(gantry.run.tau).max(axis=0)
        strongest = ("bridge", "trolley")[int(largest[:2].argmax())]
        text = check_sentence(part, "report numbers: largest drive force", [max(largest[:2])], " N ", strongest)
        assert " N m" not in text
        check_sentence(part, "report numbers: largest drive torque", [largest[2]], " N m ", "boom")
        columns = picture(made("motion", gantry), "motion")
        np.testing.assert_array_equal(columns["bridge [m]"], gantry.run.q[:, 0])

    def test_positions_limits_and_held_forces_have_their_unit(self, gantry: Study) -> None:
        lines = table(made("model", gantry), "sliding")
        assert [lines[head] for head in ("start [m]", "viscous friction [N s/m]")] == [[0.5, -1.0], [200.0, 80.0]]
        assert [numbers(limits) for limits in lines["limits [m]"]] == [[0.0, 8.0], [-2.0, 2.0]]
        assert table(made("model", gantry), "joints")["joint"] == ["boom"]
        part = made("statics", gantry)
        assert list(table(part, "forces").values())[1:] == [[0.5, -1.0], [0.0, 0.0]]
        lever, weight = 4.0 * np.sin(np.radians(5.0)), 7850 * (0.10 * 0.06 - 0.092 * 0.052) * 4.0
        (torque,) = table(part, "holding")["torque [N m]"]
        assert abs(torque) == pytest.approx(G * lever * (60 + weight / 2), rel=0.02)


@pytest.mark.slow
def test_the_report_of_an_arm_on_a_cylinder_has_all_chapters_its_force_and_its_frequency(tmp_path: Path) -> None:
    """The cylinder is vertical under the level arm, so its force has no part in the stiffness k a² about the joint."""
    mass, length, a, k = 30.0, 2.0, 0.5, 4e5  # kg, m, m, N/m
    force, at = mass * G * length / a, {"point": [a, -1.0, 0.0]}
    oil = {
        "name": "oil",
        "kind": "distance",
        "link": "arm",
        "x": a,
        "to": at,
        "length": 1.0 + force / k,
        "stiffness": k,
    }
    scene = make_scene(fl.Link(name="arm", length=length), tip=fl.RigidBody(mass=mass), gravity=(0.0, -G, 0.0)).varied(
        {"tie": [oil], "initial.passive": "static", "run": {"duration": 0.1, "sample": 0.01, "tolerance": 1e-6}}
    )
    study = Study(scene)
    shown = picture(made("loads", study), "ties")["oil [N]"]
    np.testing.assert_allclose(shown, -force, rtol=1e-9)
    (hertz,) = table(made("vibration", study), "modes")["frequency [Hz]"]
    assert hertz == pytest.approx(np.sqrt(k / mass) * a / length / (2 * np.pi), rel=1e-9)
    assert report(scene, tmp_path).failures == ()


def test_a_rigid_arm_and_its_report_have_no_bending_stress() -> None:
    rigid = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0)).varied({"run.duration": 0.01})
    assert peak_stress(fl.simulate(rigid)) is None
    assert loads.made(Study(rigid)).facts == ()


@pytest.mark.slow
def test_the_page_begins_with_the_main_numbers_and_their_units(held: Study, tmp_path, monkeypatch) -> None:
    kept = ("statics", "vibration", "loads", "energy")
    monkeypatch.setattr(building, "CHAPTERS", {name: building.CHAPTERS[name] for name in kept})
    page = report(held.scene, tmp_path).page.read_text(encoding="utf-8")
    values = re.findall(r'<p class="value">(.*?)</p>', page)
    assert [value.replace(JOIN, " ").split(" ", 1)[1].rpartition("; ")[2].split(" ")[-1] for value in values] == [
        "mm", "m", "Hz", "MPa",
    ]  # fmt: skip
    assert page.index('class="facts"') < page.index('class="verdicts"')


@pytest.mark.parametrize("rule", ["gauss", "midpoint"])
@pytest.mark.parametrize("segments", [3, 5, 9])
def test_at_most_half_of_the_modes_are_resolved_and_have_converged_frequencies(models, rule, segments) -> None:
    scene = fl.load_scene(models / "three_links.toml")

    def found(count: int) -> tuple[Modes, fl.Chain]:
        chain = fl.lump(scene.varied({"link.*.segments": count, "link.*.lumping": rule}))
        return fl.modes(chain, locked=chain.active.tolist()), chain

    modes, chain = found(segments)
    truth, _ = found(4 * (segments - 1) + 1)
    fine = np.array(resolved(modes, chain))
    assert 1 <= fine.sum() <= np.count_nonzero(chain.stiffness) / 2
    few = np.flatnonzero(fine[:10])
    assert np.abs(modes.hertz[few] / truth.hertz[few] - 1).max() < 0.05
    assert not fine[-1], "the fastest mode is never resolved"


def test_the_mode_of_a_gear_does_not_depend_on_the_number_of_segments(models: Path) -> None:
    chain = fl.lump(fl.load_scene(models / "two_mass_joint.toml"))
    modes = fl.modes(chain)
    assert (modes.kinds, resolved(modes, chain)) == (("rigid", "elastic"), (True, True))
    spatial = fl.lump(fl.load_scene(models / "t3_spatial.toml").varied({"link.*.segments": 3}))  # without gears
    modes = fl.modes(spatial, locked=spatial.active.tolist())
    assert not any(resolved(modes, spatial)[np.count_nonzero(spatial.stiffness) // 2 :])


def test_pendulum_modes_count_as_resolved(models: Path) -> None:
    chain = fl.lump(fl.load_scene(models / "three_links.toml").varied({"link.*.segments": 3}))
    modes = fl.modes(chain, fl.solve_static(chain, locked=chain.active.tolist()).q)
    assert "pendulum" in modes.kinds
    assert all(fine for fine, kind in zip(resolved(modes, chain), modes.kinds, strict=True) if kind != "elastic")


def test_pictures_mark_the_modes_that_the_hinges_do_not_resolve(models: Path) -> None:
    scene = fl.load_scene(models / "three_links.toml").varied({"link.*.segments": 3})
    chain = fl.lump(scene)
    modes = fl.modes(chain, locked=chain.active.tolist())
    fine = resolved(modes, chain)
    figure = modes.plot(chain, count=4)
    for k, axes in enumerate(figure.axes[:4]):
        assert axes.get_title().endswith(" Hz") is fine[k]
        reviewed("first numbers: title of a mode", axes.get_title())
        assert axes.lines[-1].get_linestyle() == ("-" if fine[k] else "--")
    part = vibration.made(Study(scene))
    assert part is not None
    first = rf"(?<![\d.]){1 + fine.index(False)}(?!\.?\d)"
    (text,) = (text for text in part.sentences if re.search(first, text))
    reviewed("first numbers: modes not resolved", text)


def test_the_time_of_peak_stress_does_not_depend_on_the_block_size_of_samples(monkeypatch: Any) -> None:
    scene = make_scene(flexible("beam", lumping="gauss"), gravity=(0.0, -9.81, 0.0), tip=fl.RigidBody(mass=2.0))
    run = fl.simulate(scene.varied({"run": {"step": 1e-4, "duration": 0.02, "sample": 1e-3}}))
    whole = peak_stress(run)
    assert whole is not None and whole.time > 0.005
    monkeypatch.setattr(loads, "AT_ONCE", 4)
    assert peak_stress(run) == whole


class TestUncertainty:
    def test_intervals_are_those_of_a_beam(self, held: Study) -> None:
        """f ~ √E: the interval is that of E alone if the clamp is rigid; sag ~ 1 / E; torques hold the weight alone."""
        inputs = {"material.steel.young": 0.04, "link.bar.root_stiffness": 0.0}
        study = Study(held.scene.varied({"tip.center": None, "uncertain": inputs}))
        part = made("uncertainty", study)
        lines = table(part, "intervals")
        of = {name: {head: column[k] for head, column in lines.items()} for k, name in enumerate(lines["prediction"])}
        first = of["mode 1 [Hz]"]
        found = [first[head] / first["this scene"] for head in ("median", "low", "high")]
        assert found == pytest.approx(np.exp(np.array([0.0, -1.96, 1.96]) * 0.02), rel=2e-3)
        assert first["± [%]"] == pytest.approx(100 * 1.96 * 0.02, rel=0.03)
        bends, holds = (of[name] for name in ("largest deflection [m]", "largest drive bar [N m]"))
        widths = [(row["high"] - row["low"]) / row["median"] for row in (bends, holds)]
        assert widths == pytest.approx([2 * 1.96 * 0.04, 0.0], rel=0.03, abs=0.01)
        assert numbers(first["due to"]) == [100.0]
        assert next(numbers(fact.value) for fact in part.facts) == three(first["low"], first["high"])

    def test_only_scenes_with_uncertain_inputs_and_requests_get_the_chapter(self, move: Study) -> None:
        assert importlib.import_module(f"{PARTS}.uncertainty").made(move) is None
        asked = made("uncertainty", Study(move.scene, uncertain=True))
        assert {each.split()[0] for each in table(asked, "intervals")["due to"]} <= {
            f"link.{link.name}.root_stiffness" for link in move.scene.arm.links
        }

    def test_what_has_no_intervals_is_stated(self) -> None:
        rigid = make_scene(fl.Link(name="a", length=1.0, hub=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))))
        part = made("uncertainty", Study(rigid, uncertain=True))
        assert not part.tables
        reviewed("report: no uncertain input", " ".join(part.sentences))


def test_a_run_is_accurate_until_its_two_finest_discretisations_differ() -> None:
    """The coarsest differs at once, the two finest from 2 s on."""
    tips = [np.array([[x, 0.0, 0.0] for x in row]) for row in ([9, 9, 9, 9], [0, 0, 0, 0.5], [0, 0, 0.2, 0.5])]
    cuts = {k: SimpleNamespace(tip=tip) for k, tip in enumerate(tips)}
    of: Any = SimpleNamespace(run=SimpleNamespace(t=np.arange(4.0)), cuts=cuts, study=SimpleNamespace(travel=1.0))
    assert [Refinement.accurate_until(of, part) for part in (0.1, 0.3)] == [2.0, 3.0]


@pytest.mark.parametrize(("remaining", "rivals"), [(0.5, 0), (0.15, 1)])
def test_a_cause_is_uncertain_only_if_another_parameter_leaves_less_than_twice_the_difference(
    remaining: float, rivals: int
) -> None:
    number = {"what": "stiffness", "value": 2.0, "sign": "", "is_angle": False}
    fits: Any = [
        SimpleNamespace(number=SimpleNamespace(**number | {"what": what}), value=2.2, spread=0.1, remaining=left)
        for what, left in (("stiffness", 0.1), ("length", remaining))
    ]
    sentences = measurements._about_fits(fits, fits[0])
    assert sum("stiffness" in each for each in sentences) == 1
    assert sum(measurements._change(fits[1]) in each for each in sentences) == 1 + rivals  # both changes are +10 %
