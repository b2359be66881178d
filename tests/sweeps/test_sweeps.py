"""Sweeps: each member runs once and has the numbers of a single run, in any executor and after any interruption."""

import contextlib
import csv
import functools
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tracemalloc
from collections import Counter, deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import qmc

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import InterruptedSweepError
from flexlink.common.interruption import Stop
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.batch import outcomes
from flexlink.sweeps import plan as plans
from flexlink.sweeps import ranges, worker
from flexlink.sweeps.measures import REDUCTIONS, SweepOutput, measured
from flexlink.sweeps.plan import Plan
from flexlink.sweeps.ranges import RandomDesign, Range, Spread
from flexlink.sweeps.run import MAX_WORKER_DEATHS, Execution
from flexlink.sweeps.store import Store
from flexlink.sweeps.table import SweepRows
from flexlink.sweeps.worker import Row
from tests.conftest import ROOT, compiled, flexible, make_scene
from tests.support import deadly
from tests.support.words import line, refused, refused_line, reviewed

WANTED = {"x": SweepOutput(of="tip x [m]"), "bend": SweepOutput(of="deflection [m]", take="max")}


@pytest.fixture(scope="module")
def paper() -> fl.Scene:
    run = fl.RunSettings(step=1e-4, duration=0.002, sample=0.001)
    return fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"run": run})


def masses(scene: fl.Scene, *kilograms: float, **fields: object) -> fl.Sweep:
    return fl.Sweep(scene=scene, quantity=WANTED, grid={"tip.mass": list(kilograms)}, **fields)


def test_every_member_has_the_numbers_of_a_single_run(paper: fl.Scene) -> None:
    grid = {"run.step": [1e-4, 5e-5], "tip.mass": [0.0, 1.0, 2.0]}
    rows = fl.sweep(fl.Sweep(scene=paper, quantity=WANTED, grid=grid))
    assert rows.columns == ("number", "status", "reason", "warnings", "run.step", "tip.mass", "x", "bend")
    assert [row[4:6] for row in rows.rows] == [(h, m) for h in grid["run.step"] for m in grid["tip.mass"]]
    for number, status, reason, _, step, mass, x, bend in rows.rows:
        run = fl.simulate(paper.varied({"run.step": step, "tip.mass": mass}))
        straight = np.where(np.isin(range(run.chain.n), run.chain.active), run.q, 0.0)
        away = np.linalg.norm(run.tip - fl.tip_position(run.chain, straight), axis=1)
        assert (status, reason) == ("done", ""), number
        assert (x, bend) == (run.tip[-1, 0], away.max()), "bit-equal"


def test_keys_that_prevent_vectorized_runs_vary_slowest(paper: fl.Scene) -> None:
    sweep = fl.Sweep(scene=paper, quantity=WANTED, grid={"tip.mass": [0.0, 1.0], "link.*.segments": [3, 5]})
    plan = Plan(sweep)
    assert [tuple(plan.values(k).values()) for k in range(4)] == [(0.0, 3), (1.0, 3), (0.0, 5), (1.0, 5)]


@compiled
@pytest.mark.parametrize(
    ("fixed", "grid"),
    [
        ({"run.duration": 0.1, "gravity": [0.0, 0.0, 5.0]}, {"tip.mass": [0.0, 1.0]}),
        ({"run.tolerance": 1e-4}, {"run.duration": [0.1, 0.2], "link.*.segments": [3, 5]}),
        ({"run.step": 1e-4, "tip.mass": 2.0}, {"tip.center": [[0.0, 0.0, 0.1]], "engine": ["native", "mujoco"]}),
        ({"link.2.name": "boom"}, {"initial.joint_deg.boom": [-70.0, -60.0]}),
        ({"link.upper.lumping": "midpoint"}, {"link.*.lumping": ["gauss", "legendre"]}),  # of all other links
        ({"initial.joint_deg.upper": 50.0}, {"link.upper.joint.limits_deg": [[0.0, 60.0]]}),  # valid only together
    ],
)
def test_a_member_is_the_scene_with_fixed_and_varied_values(paper: fl.Scene, fixed: dict, grid: dict) -> None:
    scene = paper.varied({"link.upper.joint.limits_deg": [-90.0, 0.0]})
    plan = Plan(fl.Sweep(scene=scene, quantity=WANTED, set=fixed, grid=grid))
    for number in range(plan.members):
        changes = {**fixed, **plan.values(number)}
        engine = changes.pop("engine", "native")
        assert plan.member(number) == (scene.varied(changes), engine)


def test_a_members_numbers_do_not_depend_on_other_members(paper: fl.Scene, rng: np.random.Generator) -> None:
    insisting = paper.varied({"run.unstable": "allow"})
    scenes = [
        insisting.varied({"tip.mass": m, "link.*.joint.coulomb": float(m > 1)}) for m in rng.uniform(0, 2, 11).tolist()
    ]
    scenes[4] = insisting.varied({"initial.rate_deg": [0.0, 1e120, 0.0]})  # diverges, so its block is run one by one
    every, shuffled = outcomes(scenes, Stop()), outcomes(scenes[::-1], Stop())[::-1]
    for scene, one, other in zip(scenes, every, shuffled, strict=True):
        (alone,) = outcomes([scene], Stop())
        if isinstance(one, fl.Trajectory) and isinstance(other, fl.Trajectory) and isinstance(alone, fl.Trajectory):
            np.testing.assert_array_equal(one.q, other.q)
            np.testing.assert_array_equal(one.q, alone.q)
        else:
            assert type(one) is type(other) is type(alone) is fl.errors.DivergenceError
            assert scene is scenes[4]


MANY: dict[str, Any] = {
    "of arm and start": {
        "tip.mass": [0.0, 1.0, -1.0, 1e308], "material.aluminium.young": [6e10, 7e10],
        "initial.joint_deg.upper": [-70.0, 10.0], "tip.center": [[0.0, 0.0, 0.0], [0.1, 0.2, 0.0]],
    },
    "of damping and friction": {
        "link.fore.damping.ratio": [0.001, 0.02], "link.*.joint.coulomb": [0.0, 0.5], "tip.mass": [0.0, 1.0],
        "link.upper.length": [1.0, 1.1],
    },
    "of run and segments": {
        "link.*.segments": [3, 5], "run.method": ["RK4", "RK10"], "run.step": [1e-4, 3e-4, 5e-4, 1e-2],
        "tip.mass": [0.0, 1.0],
    },
    "insisted": {"run.unstable": ["allow"], "run.step": [3e-4, 5e-4], "run.duration": [0.03], "tip.mass": [0.0, 1.0]},
    "of a drive": {"drive.kp.fore": [0.0, 100.0], "tip.mass": [0.0, 1.0], "drive.effort.fore": [1.0, 100.0]},
    "with a tolerance": {"run.tolerance": [1e-4], "tip.mass": [0.0, 1.0], "run.method": ["RK4", "Radau5"]},
}  # fmt: skip


@pytest.mark.parametrize("grid", MANY.values(), ids=MANY)
def test_members_with_many_varied_keys_equal_single_runs(paper: fl.Scene, grid: dict) -> None:
    """The numbers agree to the bit; errors have the same text."""
    wanted = {
        f"{of} {take}": SweepOutput(of=of, take=cast("Any", take), after=5e-4)
        for of in ("tip x [m]", "q fore [rad]", "deflection [m]", "imbalance [J]", "kinetic [J]", "work [J]")
        for take in ("final", "largest", "mean", "rms", "range", "time of max")
    } | {"steps": SweepOutput(of="steps"), "over": SweepOutput(of="overshoot [m]", target="final")}
    drive = fl.Drive(kind="pd", kp=(0.0, 10.0, 20.0), kd=(0.0, 1.0, 0.5), target_deg=(0.0, -80.0, -10.0),
                     effort=(1.0, 50.0, 50.0))  # fmt: skip
    damped = paper.varied({"link.fore.damping": fl.Damping(ratio=0.01, at_hz=3.0)})
    scene = damped.varied({"drive": drive}) if "drive.kp.fore" in grid else damped
    plan = Plan(fl.Sweep(scene=scene, quantity=wanted, set={"run.duration": 0.006, "run.sample": 1e-3}, grid=grid))
    rows, _ = worker.rows_of(msgspec.json.encode(plan.sweep), plans.version(), range(plan.members))
    for row in rows:
        try:
            run = fl.simulate(scene.varied({**plan.sweep.set, **plan.values(row.number)}))
            assert (row.values, row.reason) == measured(wanted, run)
            assert row.warnings == "\n".join(run.warnings)
        except fl.FlexlinkError as error:
            assert row.reason == f"{type(error).__name__}: {error}"


def test_a_refused_or_diverged_member_has_a_row_with_the_reason(paper: fl.Scene) -> None:
    quick = {"unstable": "allow", "duration": 0.5, "sample": 0.001}
    runs = [{"step": 1e-4}, {"step": 1e-3}, {"step": 1e-3, **quick}, {"step": -1.0}, {"step": 1e-4, "method": "RK5"}]
    rows = fl.sweep(fl.Sweep(scene=paper, quantity=WANTED, grid={"run": [{"duration": 0.01, **r} for r in runs]}))
    assert rows.column("status") == ["done", *["failed"] * 4]
    assert [reason.split(":")[0] for reason in rows.failed.values()] == [
        "UnstableStepError", "DivergenceError", "SceneError", "SceneError",
    ]  # fmt: skip
    assert rows.column("x")[1:] == [None] * 4
    assert "run.step = -1.0" in rows.failed[3]


def test_a_missing_quantity_fails_the_member_but_keeps_the_other_quantities(paper: fl.Scene) -> None:
    wanted = {**WANTED, "last": SweepOutput(of="q upper.4.z [rad]")}
    rows = fl.sweep(fl.Sweep(scene=paper, quantity=wanted, grid={"link.*.segments": [3, 5]}))
    assert rows.column("status") == ["failed", "done"]
    assert rows.column("x")[0] is not None
    assert "'q upper.4.z [rad]'" in rows.failed[0]
    reviewed("sweeps: missing quantity", rows.failed[0])


def test_sweep_reductions_give_the_named_values() -> None:
    t, x = np.array([0.0, 1.0, 2.0]), np.array([1.0, -3.0, 2.0])
    found = {name: float(reduce(t, x)) for name, reduce in REDUCTIONS.items()}
    expected = {
        "final": 2.0, "first": 1.0, "min": -3.0, "max": 2.0, "largest": 3.0, "range": 5.0, "mean": 0.0,
        "rms": pytest.approx(np.sqrt(14 / 3)), "time of min": 1.0, "time of max": 2.0,
    }  # fmt: skip
    assert found == expected
    for name in REDUCTIONS:
        SweepOutput(of="tip x [m]", take=name)  # each name is accepted


def test_settling_is_measured_against_the_equilibrium() -> None:
    rod = flexible("a", segments=3, length=1.0, lumping="gauss", joint=fl.Joint(locked=True),
                   damping=fl.Damping(ratio=0.9, at_hz=30.0))  # fmt: skip
    run = fl.RunSettings(step=1e-5, sample=1e-4, duration=0.02)
    held = make_scene(rod, gravity=(0.0, 9.81, 0.0), run=run)
    run, chain = fl.simulate(held), fl.lump(held)
    goal = fl.tip_position(chain, fl.solve_static(chain).q)
    tolerance = float(np.linalg.norm(run.tip - goal, axis=1)[len(run.t) // 2])
    wanted = {
        "settled": SweepOutput(of="settling time [s]", tolerance=tolerance),
        "over": SweepOutput(of="overshoot [m]", target=tuple(goal)),
        "left": SweepOutput(of="residual vibration [m]", after=0.01),
        "steps": SweepOutput(of="steps"),
    }
    rows = fl.sweep(fl.Sweep(scene=held, quantity=wanted, grid={"gravity": [held.gravity]}))
    assert rows.rows[0][5:] == pytest.approx(
        (
            run.settling_time(target=goal, tolerance=tolerance), run.overshoot(target=goal),
            run.residual_vibration(after=0.01), 2000,
        ), rel=1e-9,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("range_", "values"),
    [
        ({"between": [0, 1], "count": 3}, [0.0, 0.5, 1.0]),
        ({"between": [1, 100], "count": 3, "spacing": "log"}, [1.0, 10.0, 100.0]),
        ({"between": [0, 0.3], "step": 0.1}, [0.0, 0.1, 0.2, 0.3]),
        ({"between": [3, 9], "step": 2, "whole": True}, [3, 5, 7, 9]),
        ({"between": [2, 2], "count": 1}, [2.0]),
    ],
)
def test_ranges_include_both_ends(range_: dict, values: list) -> None:
    found = list(Range(**range_))
    assert found == pytest.approx(values, rel=1e-15)
    assert list(map(type, found)) == list(map(type, values))


def points(method: str, count: int, seed: int) -> np.ndarray:
    return np.array([ranges.point(method, 3, count, seed, k) for k in range(count)])


@pytest.mark.parametrize("method", ["latin", "random", "sobol", "halton"])
def test_samples_fill_the_unit_cube_and_repeat_with_their_seed(method: str) -> None:
    drawn = points(method, 100, 7)
    assert drawn.shape == (100, 3)
    assert ((drawn >= 0) & (drawn < 1)).all()
    for kept in (ranges._block, ranges._latin, ranges._halton, ranges._directions):
        kept.cache_clear()
    np.testing.assert_array_equal(points(method, 100, 7), drawn)
    assert (points(method, 100, 8) != drawn).any()
    counts = np.array([np.histogram(column, 10, (0, 1))[0] for column in drawn.T])
    assert (counts == 10).all() or method != "latin", "one point per hundredth"
    assert np.abs(counts - 10).max() <= 15  # 5 standard deviations of binomial(100, 1/10)


@pytest.mark.parametrize("method", ["latin", "random", "sobol", "halton"])
def test_a_single_sample_point_equals_the_same_point_of_the_complete_sequence(method: str) -> None:
    count, rng = 4096, np.random.default_rng(3)
    if method == "random":
        whole = rng.random((count, 3))
    else:
        engine = {"latin": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}[method](3, rng=rng)
        whole = engine.random(count)
    for k in (4095, 0, 1024, 1023, 2, 3000, 1, 2047):
        assert ranges.point(method, 3, count, 3, k) == whole[k].tolist()


@pytest.mark.parametrize("method", ["random", "sobol", "halton"])
def test_any_member_of_a_hundred_million_is_computed_without_the_others(paper: fl.Scene, method: str) -> None:
    spread = {"tip.mass": {"between": [0.0, 2.0]}, "material.aluminium.young": {"mean": 7e10, "deviation": 1e9}}
    drawn = fl.Sweep(scene=paper, quantity=WANTED, sample={"count": 10**7, "method": method, "keys": spread},
                     grid={"run.duration": {"between": [0.001, 0.01], "count": 10}})  # fmt: skip
    tracemalloc.start()
    plan = Plan(drawn)
    values = [tuple(plan.values(k).values()) for k in (plan.members - 1, 0, plan.members // 2)]
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert plan.members == 10**8
    assert len(set(values)) == 3
    assert most < 2**24


def test_missing_rows_are_found_among_many(paper: fl.Scene) -> None:
    plan = Plan(
        masses(
            paper,
            *np.linspace(0, 1, 11).tolist(),
            sample=RandomDesign(count=20_000, keys={"tip.center": [[0.0, 0.0, 0.0]]}, method="random"),
        )
    )
    with Store(None, plan, {}) as store:
        there = [0, 1, 65_535, 65_536, 70_000, 219_999]
        store.add([Row(number, "done", "", "", (0.0, 0.0)) for number in there])
        found = list(store.missing())
    assert found == sorted({*range(220_000)} - {*there})


def test_spreads_map_the_unit_interval_to_values() -> None:
    assert Spread(between=(2, 6)).value(0.25) == 3.0
    assert [Spread(between=(1, 10_000), spacing="log").value(u) for u in (0.0, 0.25)] == pytest.approx([1, 10])
    assert [Spread(between=(1, 3), whole=True).value(u) for u in (0.0, 0.5, 0.999)] == [1, 2, 3]
    assert Spread(mean=5, deviation=2).value(0.5) == 5.0
    assert Spread(mean=5, deviation=2).value(0.8413447460685429) == pytest.approx(7)
    assert np.isfinite(Spread(mean=5, deviation=2).value(0.0))


def test_keys_varied_together_are_one_axis(paper: fl.Scene) -> None:
    sweep = masses(paper, 0.0, 1.0, together={"run.method": ["RK4", "RK10"], "run.step": [1e-4, 2e-4]})
    assert [tuple(Plan(sweep).values(k).values()) for k in range(4)] == [
        (0.0, "RK4", 1e-4), (1.0, "RK4", 1e-4), (0.0, "RK10", 2e-4), (1.0, "RK10", 2e-4),
    ]  # fmt: skip


def test_the_engine_is_a_key_like_others(paper: fl.Scene) -> None:
    pytest.importorskip("mujoco")
    rows = fl.sweep(fl.Sweep(scene=paper, quantity={"x": WANTED["x"]}, grid={"engine": ["native", "mujoco"]}))
    native, mujoco = rows.column("x")
    assert native != mujoco
    assert mujoco == pytest.approx(native, abs=1e-9)


FILE = """
scene = "scene.toml"
set.run.step = 5e-5
[grid]
"tip.mass" = [0, 1]
link.upper.length = { between = [1, 2], count = 2 }
[sample]
count = 2
keys = { material.aluminium.young = { between = [60e9, 70e9] } }
[quantity]
x = { of = "tip x [m]" }
"""


def test_a_sweep_file_equals_its_python_object(tmp_path: Path, paper: fl.Scene) -> None:
    """Quoted keys and nested tables are equivalent."""
    (tmp_path / "scene.toml").write_text(paper.to_toml(), encoding="utf-8")
    (tmp_path / "sweep.toml").write_text(FILE, encoding="utf-8")
    expected = fl.Sweep(
        scene=fl.load_scene(tmp_path / "scene.toml"),
        set={"run.step": 5e-5},
        grid={"tip.mass": [0, 1], "link.upper.length": {"between": [1, 2], "count": 2}},
        sample=RandomDesign(count=2, keys={"material.aluminium.young": {"between": [60e9, 70e9]}}),
        quantity={"x": WANTED["x"]},
    )
    assert fl.Sweep.load(tmp_path / "sweep.toml") == expected


REFUSED = [
    ({"grid": {"tip.mas": [1.0]}}, "cannot-set", "tip.mas = 1.0"),
    ({"grid": {"tip.mass": []}}, "empty", "grid.tip.mass = []"),
    ({"grid": {"tip.mass": 1.0}}, "range-of-values", "grid.tip.mass = 1.0"),
    ({"grid": {"tip.mass": {"between": [2, 1], "count": 2}}}, "range-order", "between = [2.0, 1.0]"),
    ({"grid": {"tip.mass": {"between": [0, 1]}}}, "range-of-values", "count, step"),
    ({"grid": {"tip.mass": {"between": [0, 1], "step": 1e-10}}}, "range-of-values", "step = 1e-10"),
    ({"grid": {"tip.mass": {"between": [0, 1], "count": 10**12}}}, "wrong-value", "count = 1000000000000"),
    ({"grid": {"tip.mass": {"between": [0, 1], "count": 2, "spacing": "log"}}}, "range-of-values", "'log'"),
    ({"grid": {"tip.mass": {"between": [0, 1], "cuont": 2}}}, "unknown-key", "'count'"),
    ({"grid": {k: {"between": [0, 1], "count": 10_000} for k in ("tip.mass", "link.1.length", "link.2.length")}},
     "too-many-members", "1000000000000 "),
    ({"together": {"tip.mass": [1.0], "run.step": [1e-4, 2e-4]}}, "range-of-values", "{'tip.mass': 1, 'run.step': 2}"),
    ({"grid": {"tip.mass": [1.0]}, "together": {"tip.mass": [1.0]}}, "varied-twice", "tip.mass: "),
    ({"grid": {"tip.mass": [1.0]}, "quantity": {}}, "empty", "quantity: "),
    ({"quantity": {"X": WANTED["x"], "x": WANTED["x"]}}, "column-twice", "X: "),
    ({"quantity": {"number": WANTED["x"]}}, "column-twice", "number: "),
    ({"quantity": {"x": {"of": "tip X [m]"}}}, "unknown-quantity", "'tip x [m]'"),
    ({"quantity": {"x": {"of": "tip x [m]", "take": "maximum"}}}, "wrong-value", "take = 'maximum'"),
    ({"quantity": {"x": {"of": "steps", "take": "max"}}}, "key-of-another-kind", "take = 'max'"),
    ({"quantity": {"x": {"of": "settling time [s]"}}}, "missing-key", "tolerance: "),
    ({"sample": {"count": 10**12, "keys": {"tip.mass": {"between": [0, 1]}}}}, "wrong-value", "count = 1000000000000"),
    ({"sample": {"count": 1_000_001, "keys": {"tip.mass": [1.0]}}}, "range-of-values", "'sobol'"),
    ({"sample": {"count": 2, "keys": {}}}, "empty", "sample.keys: "),
    ({"sample": {"count": 2, "keys": {"tip.mass": {"between": [0, 1], "mean": 1}}}}, "range-of-values", "between"),
    ({"sample": {"count": 2, "keys": {"tip.mass": {"mean": 7e10, "deviation": 0.05}}}}, "range-of-values", "n = 0.05"),
    ({"sample": {"count": 2, "method": "lattice", "keys": {}}}, "wrong-value", "method = 'lattice'"),
]  # fmt: skip


OWN = {"run.method": "methods/RK4", "link.upper.lumping": "lumping/paper", "drive.reference.shaper.kind": "shapers/ZV"}


@pytest.mark.parametrize(("key", "file"), OWN.items())
def test_a_custom_file_is_found_next_to_the_sweep(key: str, file: str, tmp_path: Path, monkeypatch) -> None:
    for source, name in ("models/ptp_move.toml", "scene.toml"), (f"flexlink/describe/data/{file}.toml", "own.toml"):
        (tmp_path / name).write_bytes((ROOT / source).read_bytes())
    named = Path(file).name
    text = f'scene = "scene.toml"\nquantity.x.of = "tip x [m]"\n[grid]\n"{key}" = ["{named}", "own.toml"]\n'
    (tmp_path / "sweep.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir("/")
    assert fl.Sweep.load(tmp_path / "sweep.toml").grid == {key: [named, str(tmp_path / "own.toml")]}


@pytest.mark.parametrize(("fields", "id", "part"), REFUSED)
def test_an_invalid_sweep_is_refused_before_the_first_run(fields: dict, id: str, part: str, paper: fl.Scene) -> None:
    with refused(fl.errors.SceneError, id) as caught:
        fl.sweep(fl.Sweep(**{"scene": paper, "quantity": WANTED, **fields}))
    assert part in str(caught.value)


def test_an_unknown_key_is_reported_with_the_allowed_ones(tmp_path: Path, capsys) -> None:
    (tmp_path / "sweep.toml").write_text('scene = "a.toml"\ngird = 1\n', encoding="utf-8")
    assert main(["sweep", str(tmp_path / "sweep.toml")]) == 2
    text = refused_line(capsys.readouterr().err, "unknown-key")
    assert "gird = 1: " in text
    for key in ("scene", "quantity", "about", "set", "grid"):
        assert key in text


def lines(path: Path) -> list[tuple]:
    with sqlite3.connect(path) as db:
        return db.execute("SELECT * FROM rows ORDER BY number").fetchall()


def test_rows_do_not_depend_on_the_executor_or_an_interruption(tmp_path: Path, paper: fl.Scene, monkeypatch) -> None:
    sweep = masses(paper, *np.linspace(0, 1, 21).tolist())
    whole = fl.sweep(sweep)
    with ThreadPoolExecutor(2) as threads:
        assert fl.sweep(sweep, executor=threads) == whole
    out = tmp_path / "sweep.db"
    seen: list[float] = []

    def stopped(part: float) -> None:
        seen.append(part)
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fl.sweep(sweep, out=out, progress=stopped)
    assert 0 < len(lines(out)) < 21
    kept = lines(out)
    ran = []
    real = worker.rows_of
    monkeypatch.setattr("flexlink.sweeps.run.rows_of", lambda *question: (ran.extend(question[2]), real(*question))[1])
    again = fl.sweep(sweep, out=out, progress=seen.append)
    assert again == whole
    assert sorted(ran) == [row[0] for row in again.rows[len(kept) :]], "no member runs twice"
    assert seen[0] == 0
    assert seen[-1] == 1
    assert fl.sweep(sweep, out=out) == whole


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"grid": {"tip.mass": [0.0, 2.0]}}, ("grid.tip.mass[1] ", " 1.0 ", " 2.0")),
        ({"set": {"run.duration": 0.001}}, ("set.run.duration ", " None ", " 0.001")),
        ({"quantity": {"x": WANTED["x"], "y": SweepOutput(of="tip y [m]")}}, ("quantity.bend ",)),
    ],
)
def test_a_changed_sweep_is_refused_and_not_mixed_in(tmp_path, paper, change, parts) -> None:
    sweep, out = masses(paper, 0.0, 1.0), tmp_path / "sweep.db"
    fl.sweep(sweep, out=out)
    kept = lines(out)
    with refused(fl.errors.ArgumentError, "rows-of-another-sweep") as caught:
        fl.sweep(replace(sweep, **change), out=out)
    assert all(part in str(caught.value) for part in parts)
    assert lines(out) == kept
    assert len(fl.sweep(replace(sweep, **change), out=out, fresh=True).rows) == 2


def test_a_changed_scene_version_or_file_is_refused(tmp_path: Path, paper: fl.Scene, monkeypatch) -> None:
    sweep, out = masses(paper, 0.0), tmp_path / "sweep.db"
    for module in ("plan", "run", "worker"):  # the message must not change with each release
        monkeypatch.setattr(f"flexlink.sweeps.{module}.version", lambda: "0.1.0")
    fl.sweep(sweep, out=out)
    with refused(fl.errors.ArgumentError, "rows-of-another-sweep"):
        fl.sweep(replace(sweep, scene=paper.varied({"gravity": [0.0, 0.0, 1.0]})), out=out)
    fl.sweep(replace(sweep, about="another text"), out=out)
    monkeypatch.setattr(plans, "version", lambda: "0.2.0")
    with refused(fl.errors.ArgumentError, "rows-of-another-sweep"):
        fl.sweep(sweep, out=out)
    monkeypatch.undo()
    own = tmp_path / "own.toml"
    own.write_text((ROOT / "flexlink/describe/data/methods/RK4.toml").read_text(encoding="utf-8"), encoding="utf-8")
    fl.sweep(replace(sweep, set={"run.method": str(own)}), out=out, fresh=True)
    own.write_text(own.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with refused(fl.errors.ArgumentError, "rows-of-another-sweep"):
        fl.sweep(replace(sweep, set={"run.method": str(own)}), out=out)


def test_files_other_than_sweep_databases_stay_unchanged(tmp_path: Path, paper: fl.Scene) -> None:
    text, other, folder = tmp_path / "notes.txt", tmp_path / "other.db", tmp_path / "folder"
    text.write_text("not a database, but valuable data" * 30, encoding="utf-8")
    with sqlite3.connect(other) as db:
        db.execute("CREATE TABLE rows (number)")
    folder.mkdir()
    before = text.read_bytes(), other.read_bytes()
    for path in (text, other):
        for fresh in (False, True):
            with refused(fl.errors.OutputError, "cannot-write"):
                fl.sweep(masses(paper, 0.0), out=path, fresh=fresh)
    for path in (folder, tmp_path / "missing" / "sweep.db"):
        with refused(fl.errors.OutputError, "cannot-write"):
            fl.sweep(masses(paper, 0.0), out=path)
    assert (text.read_bytes(), other.read_bytes()) == before


@pytest.mark.parametrize(
    "edit",
    [
        "DROP TABLE rows", "DELETE FROM about", "UPDATE about SET value = 'x'", "UPDATE about SET value = '[[[' || 1",
        "UPDATE rows SET x = x + 1e-9 WHERE number = 3", "UPDATE rows SET number = -1 WHERE number = 2",
        "ALTER TABLE rows RENAME COLUMN x TO depth", "DELETE FROM checks WHERE number = 1",
        "UPDATE rows SET number = 5 WHERE number = 2; DROP TABLE checks",  # the sweep has no member 5
    ],
)  # fmt: skip
def test_a_changed_database_is_refused_as_damaged(edit: str, tmp_path: Path, paper: fl.Scene) -> None:
    out, sweep = tmp_path / "sweep.db", replace(masses(paper, *map(float, range(5))), set={"run.duration": 0.0})
    first = fl.sweep(sweep, out=out).rows
    assert fl.sweep(sweep, out=out).rows == first
    with contextlib.closing(sqlite3.connect(out)) as db, db:
        db.executescript(edit)
    damaged = out.read_bytes()
    with pytest.raises(fl.errors.OutputError) as caught:
        fl.sweep(sweep, out=out)
    assert "is damaged" in str(caught.value) and out.read_bytes() == damaged
    assert fl.sweep(sweep, out=out, fresh=True).rows == first


def test_no_damaged_byte_of_a_database_changes_a_row(tmp_path: Path, paper: fl.Scene) -> None:
    out, sweep = tmp_path / "sweep.db", replace(masses(paper, *map(float, range(5))), set={"run.duration": 0.0})
    first, pick, right = fl.sweep(sweep, out=out).rows, random.Random(7), 0
    content = out.read_bytes()
    used = [place for place, byte in enumerate(content) if byte]
    for _ in range(60):
        data = bytearray(content)
        data[pick.choice(used)] = pick.randrange(256)
        out.write_bytes(data)
        try:
            right += fl.sweep(sweep, out=out).rows == first
        except (fl.errors.OutputError, fl.errors.ArgumentError):
            right += 1
    assert right == 60


def test_a_sweep_whose_database_is_removed_does_not_report_success(tmp_path: Path, paper: fl.Scene) -> None:
    out = tmp_path / "sweep.db"
    with refused(fl.errors.OutputError, "cannot-write"):
        fl.sweep(masses(paper, 0.0, 1.0), out=out, progress=lambda _: out.unlink(missing_ok=True))


def test_a_second_writer_is_refused(tmp_path: Path, paper: fl.Scene, monkeypatch) -> None:
    out, sweep = tmp_path / "sweep.db", masses(paper, 0.0, 1.0)
    monkeypatch.setattr("flexlink.sweeps.store.LOCK_TIMEOUT", 0.05)
    rows_read = []

    def meanwhile(_: float) -> None:
        for fresh in (False, True):
            with refused(fl.errors.OutputError, "cannot-write"):
                fl.sweep(sweep, out=out, fresh=fresh)
            rows_read.append(len(lines(out)))  # reading is allowed

    assert len(fl.sweep(sweep, out=out, progress=meanwhile).rows) == 2
    assert rows_read[0] == 0


def test_the_second_of_two_sweeps_that_create_one_file_is_refused(tmp_path: Path, paper, monkeypatch) -> None:
    out, sweep = tmp_path / "sweep.db", masses(paper, 0.0)
    monkeypatch.setattr("flexlink.sweeps.store.LOCK_TIMEOUT", 0.05)
    errors = []

    class Beaten(sqlite3.Connection):
        """Start another sweep between two accesses to the file."""

        def execute(self, statement: str, *values: object) -> sqlite3.Cursor:
            if "sqlite_master" in statement and not errors:
                errors.append("")
                with refused(fl.errors.OutputError, "cannot-write") as caught:
                    fl.sweep(sweep, out=out)
                errors.append(str(caught.value))
            return super().execute(statement, *values)

    monkeypatch.setattr(sqlite3, "connect", functools.partial(sqlite3.connect, factory=Beaten))
    assert len(fl.sweep(sweep, out=out).rows) == 1
    assert out.name in errors[1]


FILLS_THE_DISK = """
import resource, sys
from flexlink.cli.main import main
from flexlink.sweeps import run
run.TASK_SECONDS = 1e-9  # eight members and one commit per task
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
sys.exit(main(["sweep", sys.argv[1], "--out", sys.argv[2]]))
"""


def sweep_file(tmp_path: Path, paper: fl.Scene, count: int, **run: float) -> Path:
    (tmp_path / "scene.toml").write_text(paper.varied({f"run.{k}": v for k, v in run.items()}).to_toml(), "utf-8")
    path = tmp_path / "sweep.toml"
    path.write_text(
        f'scene = "scene.toml"\n[grid]\ntip.mass = {{ between = [0, 1], count = {count} }}\n'
        '[quantity]\nx = { of = "tip x [m]" }\n', "utf-8",
    )  # fmt: skip
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no limit on file sizes")
def test_a_full_disk_preserves_stored_rows(tmp_path: Path, paper: fl.Scene) -> None:
    path, out = sweep_file(tmp_path, paper, 200), tmp_path / "sweep.db"
    call = [sys.executable, "-c", FILLS_THE_DISK, str(path), str(out)]
    ended = subprocess.run(call, capture_output=True, text=True, check=False, cwd=tmp_path, env=own_environment())
    assert ended.returncode == 2
    assert out.name in refused_line(ended.stderr, "cannot-write")
    assert 0 < len(lines(out)) < 200
    assert len(fl.sweep(path, out=out).rows) == 200


def own_environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}


@pytest.mark.slow
def test_a_member_that_kills_its_process_fails_alone(paper: fl.Scene) -> None:
    sweep = masses(paper, *np.linspace(0, 1, 21).tolist())
    rows, whole = fl.sweep(sweep, executor=deadly.pool), fl.sweep(sweep)
    assert rows.failed.keys() == {deadly.MEMBER, deadly.MEMBER + 2}
    assert str(MAX_WORKER_DEATHS) in rows.failed[deadly.MEMBER]
    assert rows.failed[deadly.MEMBER + 2].startswith("ZeroDivisionError: ")
    for reason in rows.failed.values():
        reviewed("sweeps: failed member", reason)
    good = [k for k in range(21) if k not in rows.failed]
    assert [rows.rows[k] for k in good] == [whole.rows[k] for k in good]
    with deadly.pool() as given, refused(fl.errors.EngineError, "cluster-gone"):
        fl.sweep(sweep, executor=given)


@pytest.mark.slow
def test_two_workers_give_the_same_rows_as_one(tmp_path: Path, paper: fl.Scene) -> None:
    sweep = masses(paper, *np.linspace(0, 1, 101).tolist())
    assert fl.sweep(sweep, workers=2) == fl.sweep(sweep)


def test_rows_of_two_versions_are_not_mixed(paper: fl.Scene, monkeypatch) -> None:
    monkeypatch.setattr("flexlink.sweeps.run.version", lambda: "0.1.0")
    monkeypatch.setattr(worker, "version", lambda: "0.0.9")
    with refused(fl.errors.EngineError, "versions-differ"):
        fl.sweep(masses(paper, 0.0))


@pytest.mark.parametrize(
    ("arguments", "id"),
    [
        ({"workers": 0}, "out-of-range"),
        ({"workers": 3_000_000_000}, "out-of-range"),
        ({"workers": 10**400}, "out-of-range"),
        ({"executor": 3}, "wrong-type"),
        ({"fresh": "no"}, "wrong-type"),
        ({"out": 3}, "wrong-type"),
    ],
)
def test_invalid_arguments_are_refused(arguments: dict, id: str, paper: fl.Scene) -> None:
    with refused(fl.errors.ArgumentError, id):
        fl.sweep(masses(paper, 0.0), **arguments)


def test_rows_are_exported_exactly(tmp_path: Path, paper: fl.Scene, capsys) -> None:
    path = sweep_file(tmp_path, paper, 3)
    out = tmp_path / "rows.db"
    assert main(["sweep", str(path), "--out", str(out), "--export", "csv"]) == 0
    reviewed("sweeps: end", line(capsys.readouterr().out, "3 members"), values=False)
    with (tmp_path / "rows.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    kept = lines(out)
    assert header == ["number", "status", "reason", "warnings", "tip.mass", "x"]
    assert [(float(row[4]), float(row[5])) for row in rows] == [row[4:] for row in kept]
    frame = fl.sweep(path, out=out).to_pandas()
    assert frame["x"].tolist() == [row[5] for row in kept]
    assert frame.index.name == "number"


def test_parquet_reads_back_or_names_the_missing_package(tmp_path: Path, paper: fl.Scene, capsys, monkeypatch) -> None:
    path, out = sweep_file(tmp_path, paper, 2), tmp_path / "rows.db"
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "pyarrow", None)
        assert main(["sweep", str(path), "--out", str(out), "--export", "parquet"]) == 2
        assert "pyarrow" in refused_line(capsys.readouterr().err, "package-missing")
        assert not out.exists(), "refused before any member runs"
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    assert main(["sweep", str(path), "--out", str(out), "--export", "parquet"]) == 0
    assert pandas.read_parquet(tmp_path / "rows.parquet")["x"].tolist() == [row[5] for row in lines(out)]


def test_a_table_shows_its_size_and_columns() -> None:
    table = SweepRows(("number", "x"), ((0, 1.0),))
    assert all(part in repr(table) for part in ("SweepRows", "1 row ", "number, x"))
    reviewed("repr", repr(table))
    assert InterruptedSweepError("stopped", 15).signal == 15


@pytest.mark.parametrize("take", ["first", "time of max"])
def test_the_sample_at_the_start_of_the_window_is_included(take: str) -> None:
    t = np.array([0.0, 1.0, 2.0])
    run = SimpleNamespace(t=t, columns={"tip x [m]": np.array([9.0, 5.0, 1.0])})
    found = SweepOutput(of="tip x [m]", take=cast("Any", take), after=1.0).measure(cast("Any", run))
    expected = {"first": 5.0, "time of max": 1.0}
    assert found == expected[take]


def test_the_error_of_a_member_is_the_largest_and_not_that_at_the_end() -> None:
    run = SimpleNamespace(error=np.array([1e-4, 3e-4, 2e-4]))
    assert SweepOutput(of="error [m]").measure(cast("Any", run)) == 3e-4


def test_the_rest_position_is_the_equilibrium_under_the_last_load() -> None:
    """Tip deflection F L³ / (3 E I) of a clamped beam of 1.25 m under a force that grows to 1 N."""
    clamped = make_scene(flexible("a", segments=5, lumping="gauss", joint=fl.Joint(locked=True)))
    growing = fl.Wrench(times=(0.0, 1e-3), forces=((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    run = fl.simulate(clamped.varied({"wrench": growing, "run": fl.RunSettings(duration=1e-3, sample=1e-3, step=1e-5)}))
    rest = SweepOutput(of="overshoot [m]", target="rest").place(run)
    EI = 70e9 * 0.04**4 / 12
    assert rest[1] == pytest.approx(1.25**3 / (3 * EI), rel=1e-2)


def execution(**state: object) -> Execution:
    made = object.__new__(Execution)
    for name, value in {"plan": None, "running": {}, "suspects": deque(), "deaths": Counter(), **state}.items():
        setattr(made, name, value)
    return made


def test_tasks_of_vectorized_members_fill_all_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexlink.sweeps.run.goes_side_by_side", lambda plan, number: True)
    missing = iter(range(100))
    sizes = [len(execution(size=size)._next(missing)) for size in (1, LANES, 2 * LANES + 3)]
    assert sizes == [LANES, LANES, 2 * LANES]
    assert next(missing) == 4 * LANES, "no member is skipped"


def test_a_member_fails_after_ending_three_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexlink.sweeps.run.failed_row", lambda plan, number, reason: (number, reason))
    monkeypatch.setattr("flexlink.sweeps.run.kept", lambda plan, rows: rows)
    deadly = execution(pool=SimpleNamespace(replace=lambda: True))
    answers = [deadly._after_death([7]) for _ in range(MAX_WORKER_DEATHS)]
    assert answers[:2] == [[], []]
    ((number, reason),) = answers[2]
    assert number == 7 and str(MAX_WORKER_DEATHS) in reason
    assert list(deadly.suspects) == [[7], [7]], "two retries"


SCENE = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))
SWEEP = fl.Sweep(scene=SCENE, quantity={"x": SweepOutput(of="tip x [m]")}, grid={"tip.mass": [0.0, 1.0, 2.0]})


@pytest.mark.parametrize("suffix", [".py", ".toml"])
def test_stored_rows_depend_on_sources_and_on_files_of_methods_and_rules(suffix: str, monkeypatch) -> None:
    """One additional byte in any of these files changes the version."""
    before, read = plans.version.__wrapped__(), Path.read_bytes
    changed = next(path for path in sorted(Path(fl.__file__).parent.rglob(f"*{suffix}")))
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + (b"#" if path == changed else b""))
    assert plans.version.__wrapped__() != before


def test_stored_rows_depend_on_the_versions_of_all_packages() -> None:
    assert set(plans.fingerprint(SWEEP)["versions"]) == {"flexlink", "numpy", "scipy", "numba"}


def row(number: int, reason: str = "") -> Row:
    return Row(number, "done" if not reason else "failed", reason, "", (1.0,))


def test_a_fresh_start_removes_the_rows_of_a_killed_process(tmp_path: Path) -> None:
    """The killed process left rows in the write-ahead log, which SQLite would read into the new database."""
    plan, out, left = Plan(SWEEP), tmp_path / "sweep.db", tmp_path / "left.db"
    with Store(out, plan, {"of": "this"}) as store:
        store.add([row(0), row(1)])
        for end in ("", "-wal"):
            shutil.copy(f"{out}{end}", f"{left}{end}")
    with Store(left, plan, {"of": "this"}, fresh=True) as store:
        assert store.count() == 0
        assert list(store.missing()) == [0, 1, 2]
    shutil.copy(out, left)
    with Store(left, plan, {"of": "this"}) as store:
        assert store.count() == 2


def test_a_damaged_page_of_the_database_is_found(tmp_path: Path) -> None:
    """The damaged page contains the end of a long text, which is read only by a full query of the table."""
    plan, out = Plan(SWEEP), tmp_path / "sweep.db"
    with Store(out, plan, {"of": "this"}) as store:
        store.add([row(0, "x" * 20_000)])
    data = bytearray(out.read_bytes())
    page = next(k for k in range(0, len(data), 4096) if data[k + 4 : k + 4096] == b"x" * 4092)
    data[page : page + 4] = b"\xff" * 4  # the number of the next page
    out.write_bytes(data)
    with sqlite3.connect(out) as db:
        numbers = db.execute("SELECT number FROM rows").fetchall()
    assert numbers == [(0,)]
    with refused(fl.errors.OutputError, "cannot-write"):
        Store(out, plan, {"of": "this"})


def test_the_rest_position_uses_the_final_angles_of_driven_joints() -> None:
    """A beam whose driven joint stays at 30° sags a little; with a free joint, it would hang down."""
    beam = flexible("a", segments=5, lumping="gauss")
    scene = make_scene(beam, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(30.0,)))
    run = fl.simulate(scene, step=1e-5, duration=2e-5, sample=1e-5)
    rest = SweepOutput(of="overshoot [m]", target="rest").place(run)
    assert np.degrees(np.arctan2(rest[1], rest[0])) == pytest.approx(30.0, abs=0.1)
    straight = np.zeros(run.chain.n)
    straight[0] = run.q[-1, 0]
    sag = fl.tip_position(run.chain, straight) - rest
    weight, EI = 2700.0 * 0.04**2 * 9.81 * np.cos(np.radians(30.0)), 70e9 * 0.04**4 / 12
    assert np.linalg.norm(sag) == pytest.approx(weight * 1.25**4 / (8 * EI), rel=0.05)
