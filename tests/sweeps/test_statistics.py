"""Statistics of a sweep, gathered where its members run."""

import itertools
import math
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

import flexlink as fl
from flexlink.cli.main import main
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.plan import Plan, Sweep
from flexlink.sweeps.statistics import Statistics, Summary, decode, encode, kept, table
from flexlink.sweeps.worker import Row
from tests.conftest import flexible, make_scene
from tests.support.words import refused

SCENE = make_scene(flexible("arm", segments=3), gravity=(0.0, -9.81, 0.0))
ROUNDING = 1e-12  # of the sums of SciPy and NumPy, of up to 1e5 numbers


def planned(count: int = 4096) -> Sweep:
    keys = {"tip.mass": {"between": [0.0, 1.0]}, "run.duration": {"between": [1.0, 2.0]}}
    return Sweep(
        scene=SCENE, quantity={"a": SweepOutput(of="tip x [m]"), "b": SweepOutput(of="tip y [m]")},
        sample={"keys": keys, "count": count, "method": "sobol"}, statistics=Statistics(quantiles=(0.1, 0.5, 0.99)),
    )  # fmt: skip


def rows_by(law, plan: Plan) -> list[Row]:
    return [Row(k, "done", "", "", law(*plan.values(k).values())) for k in range(plan.members)]


def stated(plan: Plan, total: Summary) -> list[dict[str, object]]:
    columns, rows = table(plan, total)
    return [dict(zip(columns, row, strict=True)) for row in rows]


@pytest.mark.parametrize("offset", [0.0, 1e9])
def test_moments_and_ends_are_those_of_all_rows(offset):
    plan, dice = Plan(planned()), np.random.default_rng(0)
    values = offset + dice.lognormal(size=plan.members)
    (total,) = kept(plan, [Row(k, "done", "", "", (y, -y)) for k, y in enumerate(values.tolist())])
    a, b = stated(plan, total)
    exact = values - offset  # subtraction is exact enough where the offset is 0; else only the spread of values counts
    assert a["members"] == plan.members
    assert a["mean"] == pytest.approx(math.fsum(values) / len(values), rel=1e-15)
    assert a["deviation"] == pytest.approx(exact.std(ddof=1), rel=ROUNDING)
    assert a["skewness"] == pytest.approx(stats.skew(exact), rel=ROUNDING)
    assert a["excess kurtosis"] == pytest.approx(stats.kurtosis(exact), rel=ROUNDING)
    assert (a["least"], a["largest"]) == (values.min(), values.max()) == (-b["largest"], -b["least"])
    assert b["skewness"] == pytest.approx(-a["skewness"], rel=ROUNDING)


def test_a_quantile_is_right_to_a_two_thousandth_of_its_value():
    plan, dice = Plan(planned()), np.random.default_rng(1)
    values = dice.normal(size=plan.members)
    (total,) = kept(plan, [Row(k, "done", "", "", (y, None)) for k, y in enumerate(values.tolist())])
    found, nothing = stated(plan, total)
    for p in (0.1, 0.5, 0.99):
        truth = np.sort(values)[math.ceil(p * len(values)) - 1]
        assert found[f"quantile {p:g}"] == pytest.approx(truth, rel=1 / 2048)
    assert nothing["members"] == 0
    assert nothing["mean"] is None


def test_indices_of_sobol_are_those_of_a_linear_and_of_a_wavy_function():
    def outputs(u: float, v: float) -> tuple[float, float]:
        x, y = (2 * np.pi * (u - 0.5)), (2 * np.pi * (v - 1.5))
        return 3.0 * u + v, math.sin(x) + 7.0 * math.sin(y) ** 2

    plan = Plan(planned())
    (total,) = kept(plan, rows_by(outputs, plan))
    linear, waves = stated(plan, total)
    of_x, of_y = 0.5, 49 / 8  # variances of sin x and 7 sin² y
    for row, (S1, S2) in ((linear, (0.9, 0.1)), (waves, (of_x / (of_x + of_y), of_y / (of_x + of_y)))):
        assert row["S tip.mass"] == pytest.approx(S1, abs=0.02)  # of 4096 points and 32 classes
        assert row["S run.duration"] == pytest.approx(S2, abs=0.02)


def test_the_order_of_members_and_tasks_changes_no_bit():
    plan, dice = Plan(planned(500)), np.random.default_rng(2)
    rows = rows_by(lambda u, v: (math.exp(30 * u), 1e-200 * v), plan)
    (once,) = kept(plan, rows)
    cut = [0, *np.sort(dice.choice(500, 9, replace=False)), 500]
    parts = [kept(plan, rows[a:b])[0] for a, b in itertools.pairwise(cut)]
    total = decode(encode(parts.pop()))
    for k in dice.permutation(len(parts)):
        total.add(decode(encode(parts[k])))
    large, small = stated(plan, total)
    assert [large, small] == stated(plan, once)
    assert small["deviation"] == pytest.approx(1e-200 / 12**0.5, rel=0.02)  # v is between 1 and 2
    assert large["largest"] > 1e12
    assert total.members == [(0, 500)]


@pytest.fixture
def sweep() -> Sweep:
    """Twelve short runs, of which some are refused."""
    return Sweep(
        scene=SCENE, set={"run.duration": 0.02},
        grid={"tip.mass": [0.0, 1.0, -1.0, 2.0], "run.step": [1e-3, 5e-4, 2.5e-4]},
        quantity={"x": SweepOutput(of="tip x [m]"), "speed": SweepOutput(of="tip y [m]", take="max")},
    )  # fmt: skip


def with_statistics(sweep: Sweep) -> Sweep:
    return replace(sweep, statistics=Statistics())


def test_a_sweep_states_what_its_rows_give_by_any_executor_and_in_parts(sweep, tmp_path: Path):
    rows, summed = fl.sweep(sweep), with_statistics(sweep)
    found = fl.sweep(summed, out=tmp_path / "whole.db")
    values = [x for x in rows.column("x") if x is not None]
    assert found.column("output") == ["x", "speed"]
    assert found.column("members") == [9, 9]
    assert found.column("failed") == [3, 3]
    assert found.column("mean")[0] == pytest.approx(np.mean(values), rel=1e-15)
    parts = [tmp_path / f"{k}.db" for k in (1, 2, 3)]
    for k, file in enumerate(parts, 1):
        fl.sweep(summed, out=file, part=f"{k}/3")
    assert fl.sweep(summed, out=tmp_path / "merged.db", merge=parts) == found
    assert fl.sweep(summed, out=tmp_path / "merged.db", merge=parts) == found  # again: nothing is counted twice
    assert fl.sweep(summed, workers=2) == found
    assert found.to_pandas().loc["x", "members"] == 9


class EnoughError(Exception):
    """Ends a sweep."""


def begin(summed: Sweep, out: Path) -> None:
    """Run more than half of the members."""

    def stop(done: float) -> None:
        if 0.5 < done < 1.0:
            raise EnoughError

    with pytest.raises(EnoughError):
        fl.sweep(summed, out=out, progress=stop)


def test_the_command_prints_mean_and_deviation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.to_toml())
    keys = 'scene = "scene.toml"\nset.run.duration = 0.0\ngrid.tip.mass = [1.0, 3.0]\n[statistics]\n'
    (tmp_path / "sweep.toml").write_text(keys + '[quantity]\nm = { of = "tip x [m]" }\n')
    assert main(["sweep", str(tmp_path / "sweep.toml"), "--out", str(tmp_path / "s.db"), "--export", "csv"]) == 0
    assert "m: mean 1.25, deviation 0" in capsys.readouterr().out
    assert (tmp_path / "s.csv").read_text().split(",")[:2] == ["output", "members"]


def test_an_interrupted_sweep_goes_on_where_it_was(sweep: Sweep, tmp_path: Path) -> None:
    summed, begun = with_statistics(sweep), list[float]()
    begin(summed, tmp_path / "some.db")
    assert fl.sweep(summed, out=tmp_path / "some.db", progress=begun.append) == fl.sweep(summed)
    assert begun[0] > 0.5


def test_members_are_not_counted_twice(sweep: Sweep, tmp_path: Path) -> None:
    summed, out, parts = with_statistics(sweep), tmp_path / "some.db", [tmp_path / "1.db"]
    begin(summed, out)
    fl.sweep(summed, out=parts[0], part="1/1")
    with refused(fl.errors.ArgumentError, "cannot-merge"):
        fl.sweep(summed, out=out, merge=parts)
    assert fl.sweep(summed, out=tmp_path / "new.db", merge=parts) == fl.sweep(summed)


def test_a_damaged_summary_is_refused(sweep: Sweep, tmp_path: Path) -> None:
    summed, out = with_statistics(sweep), tmp_path / "some.db"
    fl.sweep(summed, out=out)
    with closing(sqlite3.connect(out)) as db, db:
        db.execute("UPDATE summary SET content = replace(content, '0x1', '0x3')")
    with refused(fl.errors.OutputError, "cannot-write"):
        fl.sweep(summed, out=out)
