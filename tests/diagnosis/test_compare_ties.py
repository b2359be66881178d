"""Ties in comparisons: other engines agree at closed states and in runs, and small mistakes are found by their tie."""

from collections.abc import Callable
from pathlib import Path

import pytest

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.cli.main import main
from flexlink.diagnosis.quantities import mixed_states, with_ties
from flexlink.engines import load, pinocchio
from tests.campaigns.ties_in_mujoco import tied
from tests.motion.test_cylinders import boom
from tests.motion.test_ties import BENDS, HELD, arm, fourbar, pin, rod, touching
from tests.support.words import line, refused, refused_line, reviewed

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*ties closed at the start:RuntimeWarning")]
BOTH, CHAINS = ("pinocchio", "mujoco"), Path(__file__).parents[1] / "matrix" / "chains"
TIES = ("q̈ with ties", "torques of ties", "g, ġ, λ of ties")
AXIS = {"point": [0.9, 0.0, 0.1], "axis": [1.0, 0.5, 0.2]}
FREE = {"base": {"kind": "free", "mass": 2.0, "inertia": [0.05, 0.08, 0.1]}, "initial.base.spin_deg": [9, -75, 150]}
SPRING = rod(length=0.5, to={"point": [1.1, 0.0, -0.5]}, stiffness=1e5, damping=10.0)
MOVES = rod(link="l2", times=[0, 0.1, 0.3], lengths=[0.9, 0.95, 0.85])


def spatial(kind: str, to: dict, **more: object) -> fl.Scene:
    """Three links that bend in space, whose joints turn about different axes, with a tie of this kind on the last."""
    axes, bends = ([0, 1, 0], [0, 0.6, 0.8], [1, 0, 0]), {"flex": "xyz", "segments": 3}
    links = ({"length": 0.4, "joint": {"axis": axis, "armature": 0.01}, **bends} for axis in axes)
    return arm(*links, ties=[{"name": "tie", "kind": kind, "link": "l3", "to": to, **more}], start=[-20.0, 50.0, 30.0])


def stopped() -> fl.Scene:
    """A four-bar linkage with stops on all joints."""
    limits = {f"link.l{k}.joint.limits_deg": [-120.0, 65.0] for k in (1, 2, 3)}
    return fourbar().varied({**limits, "limits": {"stiffness": 50.0, "dissipation": 0.3}})


def twice() -> fl.Scene:
    """A four-bar linkage on two bearings at one point."""
    return fourbar().varied({"tie": [pin("l3", 1.1, 0.0, 0.0), pin("l3", 1.1, 0.0, 0.0) | {"name": "other"}]})


def floating() -> fl.Scene:
    """A loop on a free base."""
    return fourbar(**BENDS).varied({**FREE, "tie.pin.to.link": "l1", "tie.pin.to.point": [0.1, 0.0, 0.1]})


PLAY, ROPE = {"play": 0.1, "dissipation": 0.2}, {"only": "pull", "dissipation": 0.2}
SCENES: dict[str, Callable[[], fl.Scene]] = {
    "point": lambda: fourbar(**BENDS),
    "two bearings": twice,
    "point in space": lambda: spatial("point", {"link": "l1", "x": 0.1}),
    "bushing": lambda: spatial("point", {"point": [0.5, 0.1, 0.1]}, stiffness=50.0, damping=2.0),
    "springs on links": touching,
    "wall": lambda: spatial("point", AXIS, stiffness=1e3, only="push", dissipation=0.5),
    "hinge": lambda: spatial("hinge", {"point": [0.6, 0.2, 0.1]}, axis=[0.0, 1.0, 0.0]),
    "hinge on a link": lambda: spatial("hinge", {"link": "l1", "x": 0.1, "axis": [0.1, 1.0, 0.2]}, axis=[0, 1, 0]),
    "weld": lambda: spatial("weld", {"point": [0.6, 0.2, 0], "rpy_deg": [30, 20, 9]}),
    "slider": lambda: spatial("slider", AXIS),
    "slider on a link": lambda: spatial("slider", {"link": "l1", "axis": [1, 1, 0]}),
    "rod": lambda: spatial("distance", {"link": "l1", "x": 0.1}, length=0.5),
    "moving rod": lambda: fourbar(**BENDS).varied({"tie": [MOVES]}),
    "rope": lambda: spatial("distance", {"point": [1.1, 0.0, 0.0]}, length=0.5, stiffness=1e3, **ROPE),
    "play": lambda: spatial("distance", {"point": [1.1, 0.0, 0.0]}, length=0.5, stiffness=1e3, **PLAY),
    "cylinder": lambda: boom((3e6, 2e6)),
    "gears": lambda: spatial("joint", {"link": "l1"}, ratio=-0.5),
    "gears with play": lambda: spatial("joint", {"link": "l1"}, ratio=2.0, stiffness=9.0, **PLAY),
    "stops": stopped,
    "free base": floating,
    "free base in frame 0": lambda: spatial("point", {"point": [0.9, 0.1, 0.1]}).varied(FREE),
}


@pytest.mark.parametrize("name", SCENES)
def test_pinocchio_agrees_at_closed_states_of_arms_with_each_kind_of_tie(name: str) -> None:
    scene = SCENES[name]()
    found = fl.compare(scene, engines=["pinocchio"], samples=24)
    assert found.passed, str(found)
    rows = {row.quantity: row for row in found.rows}
    assert rows[TIES[2]].joint in {f"tie {tie.name}" for tie in scene.ties}
    assert all(1e-6 < rows[quantity].error < 0.2 for quantity in TIES[:2])


@pytest.mark.parametrize("seed", [0, 7, 11, 15, 45, 54, 56, 74, 145, 294], ids=lambda seed: f"seed {seed}")
def test_pinocchio_agrees_at_closed_states_of_random_arms(seed: int) -> None:
    """Also mechanisms that cannot move, and some whose states are close to singular ones."""
    found = fl.compare(tied(seed), engines=["pinocchio"], samples=16)
    assert found.passed, str(found)


def test_states_are_closed_and_nearly_all_move() -> None:
    scene = SCENES["moving rod"]()
    chain = fl.lump(open_chain(scene))
    states, _ = with_ties(scene, chain, mixed_states(chain, 40))
    assert len({state.q.tobytes() for state in states}) > 30
    assert {state.t for state in states} > {0.3}


def by_row(field: str, row: int, change: float) -> Callable:
    """`tie_rows` with a mistake in one number of a row."""

    def wrong(scene: fl.Scene, chain: fl.Chain) -> object:
        rows, lengths = right(scene, chain)
        part = rows[field]
        part[(row, *[0] * (part.ndim - 1))] += change
        return rows, lengths

    right = pinocchio.tie_rows
    return wrong


@pytest.mark.parametrize(
    ("name", "field", "row", "change", "tie"),
    [
        ("point", "point_a", 0, 1e-6, "pin"), ("point in space", "point_a", 1, 1e-6, "tie"),
        ("hinge", "point_a", 3, 1e-7, "tie"), ("weld", "point_b", 6, 1e-7, "tie"),  # 1e-6 rad of axes of 0.1 m
        ("slider", "along", 0, 1e-6, "tie"), ("wall", "along", 0, 1e-6, "tie"),
        ("moving rod", "point_b", 0, 1e-6, "pin"), ("rope", "length", 0, 1e-6, "tie"),
        ("rope", "stiffness", 0, 1e-3, "tie"), ("bushing", "damping", 1, 1e-6, "tie"),
        ("play", "dissipation", 0, 1e-6, "tie"), ("cylinder", "bulk", 0, 1e3, "lift"),
        ("cylinder", "areas", 0, 1e-9, "lift"), ("cylinder", "pressures", 0, 1.0, "lift"),
        ("gears", "ratio", 0, 1e-6, "tie"), ("stops", "high", 4, 1e-6, "stop of l2"),
        ("free base in frame 0", "point_a", 2, 1e-6, "tie"),
    ],
)  # fmt: skip
def test_a_small_mistake_in_a_row_is_found_by_its_tie(
    name: str, field: str, row: int, change: float, tie: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pinocchio, "tie_rows", by_row(field, row, change))
    found = fl.compare(SCENES[name](), engines=["pinocchio"], samples=24)
    failed = {row.quantity: row for row in found.rows if not row.passed}
    assert failed.keys() <= set(TIES)
    assert failed[TIES[2]].joint == f"tie {tie}"
    assert TIES[0] in failed or name == "weld"  # of which an axis hardly moves the links


SHORT = {"run.duration": 0.05, "run.sample": 0.01, "run.tolerance": 1e-4}


def crane() -> fl.Scene:
    """Oil, a gear with a spring, stops and a prescribed motion; without sensors, which engines do not need."""
    return fl.load_scene(CHAINS / "crane.toml").varied({"sensor": None})


RUNS: dict[str, tuple[Callable[[], fl.Scene], tuple[str, ...]]] = {
    "linkage": (lambda: fourbar().varied(SHORT), BOTH),
    "bending linkage with a drive": (lambda: fourbar(**BENDS).varied({**SHORT, "drive": HELD}), BOTH),
    "stiff spring": (lambda: fourbar().varied({**SHORT, "tie": [SPRING]}), BOTH),
    "moving rod": (lambda: SCENES["moving rod"]().varied(SHORT), ("pinocchio",)),
    "slider": (lambda: SCENES["slider"]().varied({**SHORT, "run.duration": 0.01}), ("pinocchio",)),
    "rope, wall and bushing": (lambda: touching().varied({**SHORT, "tie.wall.to.point": [0, 0, 0.05]}), ("pinocchio",)),
    "crane": (crane, ("pinocchio",)),
    "free base": (lambda: fourbar().varied({**FREE, **SHORT}), BOTH),
}


@pytest.mark.parametrize("name", RUNS)
def test_runs_of_engines_agree_up_to_what_half_the_step_changes(name: str) -> None:
    """Also where ties begin to press, at which the steps of engines do not end."""
    scene, engines = RUNS[name][0](), RUNS[name][1]
    found = fl.compare_trajectories(scene)
    assert found.passed, str(found)
    assert tuple(row.engine for row in found.rows) == engines
    reviewed("trajectories: steps with ties", found.steps, values=False)
    assert all(row.explained < 1e-4 for row in found.rows)
    assert {reason.partition(":")[0] for reason in found.refused} == {"exudyn", "drake", *BOTH} - {*engines}


@pytest.mark.parametrize("seed", [11, 20, 26, 30, 36], ids=lambda seed: f"seed {seed}")
def test_runs_of_random_arms_agree(seed: int) -> None:
    found = fl.compare_trajectories(tied(seed).varied({"run.duration": 0.01, "run.sample": 0.002}))
    assert found.passed, str(found)
    assert [row.engine for row in found.rows] == list(BOTH)


@pytest.mark.parametrize("engine", BOTH)
def test_a_mistake_that_half_the_step_does_not_explain_is_found(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = fourbar().varied({**SHORT, "run.step": 1e-4, "run.method": "RK4", "run.tolerance": None})
    wrong = by_row("point_a", 0, 1e-4)
    monkeypatch.setattr(pinocchio, "tie_rows", wrong)
    monkeypatch.setattr("flexlink.formats.tied.tie_rows", wrong)
    found = fl.compare_trajectories(scene, engines=[engine])
    assert not found.passed
    assert found.rows[0].q < 1e-3


def test_runs_with_large_steps_end_with_a_warning() -> None:
    run = {"run": {"step": 0.1, "sample": 0.1, "duration": 0.4, "method": "RK4"}, "initial.rate_deg": [300.0, 0.0, 0.0]}
    found = fl.compare_trajectories(fourbar().varied(run), engines=["pinocchio"])
    reviewed("trajectories: motion amplifies errors", line(str(found), "warning: "))


@pytest.mark.parametrize(
    ("name", "change", "id"),
    [
        ("slider", {}, "engine-cannot-load"), ("wall", {"tie.tie.dissipation": 0.0}, "engine-cannot-load"),
        ("cylinder", {"tie.lift.times": None, "tie.lift.lengths": None, "tie.lift.length": 0.7}, "engine-cannot-load"),
        ("moving rod", {}, "ties-not-supported"), ("rope", {}, "ties-not-supported"),
    ],
)  # fmt: skip
def test_what_mujoco_does_not_have_is_refused_by_name(name: str, change: dict, id: str) -> None:
    scene = SCENES[name]().varied(change)
    with refused(fl.FlexlinkError, id):
        fl.compare_trajectories(scene, engines=["mujoco"], duration=0.002 if scene.run.sample < 0.01 else 0.05)


def test_a_comparison_reports_why_mujoco_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(fourbar().save(tmp_path / "bars.toml"))
    assert main(["compare", path, "--samples", "8"]) == 0
    shown = capsys.readouterr().out
    reviewed("compare: refused with ties", line(shown, "not compared: "))
    assert all(quantity in shown for quantity in TIES)
    assert main(["compare", path, "--engines", "mujoco"]) == 2
    refused_line(capsys.readouterr().err, "ties-not-supported")
    assert main(["compare", path, "--trajectory", "--duration", "0.05"]) == 0
    assert capsys.readouterr().out.count(" ok ") == 2


def test_engines_without_ties_and_files_refuse_them() -> None:
    scene = fourbar().varied({"run.step": 1e-3, "run.method": "RK4", "run.tolerance": None})
    chain = fl.lump(open_chain(scene))
    for call in (
        lambda: load("exudyn", chain, ties=scene), lambda: load("drake", chain, ties=scene),
        lambda: load("pinocchio", chain).integrate(scene), lambda: load("mujoco", chain).integrate(scene),
        lambda: fl.compare(scene, file="arm.xml"),
    ):  # fmt: skip
        with refused(fl.errors.SceneError, "ties-not-supported"):
            call()


def test_flexlink_agrees_with_itself() -> None:
    scene = fourbar().varied(SHORT)
    assert {row.error for row in fl.compare(scene, engines=["native"], samples=4).rows} == {0.0}
    assert fl.compare_trajectories(scene, engines=["native"]).rows[0].q == 0.0
