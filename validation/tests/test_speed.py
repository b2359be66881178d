"""Benchmarks: compared programs agree before they are timed, and the timer measures correctly."""

import datetime
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import flexlink as fl
from flexlink.common.errors import FlexlinkError
from flexlink.dynamics.rounding import acceleration_error
from reports.figures.speed import speed_cost
from reports.findings.errors import speed_times
from reports.results import Results
from tests.support.words import refused
from validation.case import CASES, Case, load_case
from validation.measuring import judged
from validation.memory import STATUS, peak_megabytes
from validation.speed import compiled_loops, evaluations, pinocchio_models, races, steps
from validation.speed.families import Family, of_steps, timed_states
from validation.speed.races import Race, exponent, race, series
from validation.store import Environment, Finished, Planned, Store

ROOT = Path(__file__).parents[2]
CASE = Case(name="c", kind="k", title="t", about="a", quantity={}, scenes=("paper_fig5",))
FLEX = {"T1": "z", "T2": "yz", "T3": "xyz"}


def family(kind: str, *segments: int, **limits: int) -> Family:
    return Family(segments=segments, change={"link.*.flex": FLEX[kind]}, **limits)


@pytest.fixture(params=FLEX)
def chain(request: pytest.FixtureRequest) -> fl.Chain:
    return fl.lump(family(request.param, 3).scene(CASE, 3))


@pytest.mark.parametrize("kind", FLEX)
def test_the_step_extrapolated_to_longer_chains_is_stable(kind: str) -> None:
    some = family(kind, 5, 30)
    scene = some.released(CASE, 30)
    assert scene.run.step <= fl.stable_step(fl.lump(scene), np.linspace(0.1, 0.4, fl.lump(scene).n), method="RK4")


def test_every_pinocchio_model_has_our_accelerations(chain: fl.Chain) -> None:
    q, qd, tau, _ = (part[0] for part in timed_states(chain))
    ours = fl.forward_dynamics(chain, q, qd, tau)
    net = tau - fl.elastic_torque(chain, q) - fl.friction_torque(chain, qd)
    models = pinocchio_models.build_all(chain)
    for model, sign in models.values():
        theirs = pin.aba(model, model.createData(), q * sign, qd * sign, net * sign) * sign
        assert acceleration_error(chain, q, qd, tau, solutions=(theirs, ours)).max() <= 1
    sizes = {model.njoints for model, _ in models.values()}
    assert len(sizes) == len(models), "each kind of Pinocchio model groups hinges differently"


def test_compiled_loops_give_the_results_of_the_public_functions(chain: fl.Chain) -> None:
    states = timed_states(chain)
    q, qd, tau, qdd = states
    last = 5 % len(q)  # state of the last of 6 calls
    jobs = evaluations.native(chain, states)
    expected = {
        evaluations.FORWARD: fl.forward_dynamics(chain, q[last], qd[last], tau[last]),
        evaluations.RNE: fl.inverse_dynamics(chain, q[last], qd[last], qdd[last]),
        evaluations.MASS: fl.mass_matrix(chain, q[last]),
        evaluations.BIAS: fl.bias_torque(chain, q[last], qd[last]),
    }
    assert jobs.keys() == expected.keys() == evaluations.public(chain, states).keys()
    for job, value in expected.items():
        np.testing.assert_array_equal(jobs[job](6), value)
    assert compiled_loops.mass_loop(chain.arrays, q, 1).shape == (chain.n, chain.n)


def test_all_compared_programs_raise_an_error_when_a_run_diverges() -> None:
    scene = family("T1", 5).released(CASE, 5)
    wild = of_steps(scene, 1, 30 * scene.run.step)
    contestants = (steps.native(wild), steps.by_mujoco(wild), steps.by_pinocchio(wild), steps.native_batch([wild] * 8))
    for contestant in contestants:
        with np.errstate(all="ignore"), refused(FlexlinkError, "test-speed"):
            contestant(5000)


def test_the_timer_measures_a_call_also_on_a_busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulated clock advances only with the work; in every second measurement another process doubles the time."""
    now, lengths = [0.0], {}

    def takes(seconds: float):
        turns = itertools.count()

        def work(calls: int) -> None:
            now[0] += calls * seconds * (1.0 if next(turns) % 2 else 2.0)
            lengths[seconds] = calls

        return work

    monkeypatch.setattr(races.time, "process_time", lambda: now[0])
    laps = race({"one": takes(1e-3), "three": takes(3e-3)}, turns=5, turn=0.006)
    assert laps == {"one": pytest.approx(1e-3), "three": pytest.approx(3e-3)}
    assert lengths[1e-3] >= 2 * lengths[3e-3]


def test_the_exponent_is_fitted_to_long_chains_only() -> None:
    seconds = {n: 1e-9 * n**1.5 + (1.0 if n < 100 else 0.0) for n in (10, 100, 400, 3000)}
    job = "forward dynamics"
    times = [Race("T1", job, n, {"native": each}) for n, each in seconds.items()]
    [row] = exponent(times, "native")
    assert row.quantity == f"T1 {job}: exponent"
    assert row.varied == {"chain": "T1", "job": job, "n": 100, "to n": 3000}
    assert row.value == pytest.approx(1.5)


def test_the_report_plots_cost_against_n_and_lists_the_times(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.prepare(["speed_calls"])
    case = load_case(CASES / "speed_calls.toml")
    job = "T1", "forward dynamics"
    times = [Race(*job, n, {"native": 1e-8 * n}) for n in (10, 100, 1000)] + [Race(*job, 10, {"mujoco": 1e-6})]
    store.add_series("speed_calls", series(times, "cost", "Time of one forward dynamics", "engine", part=job[1]))
    for row in exponent(times, "native"):
        store.append(judged(case, row, 0.0, "key"))
    store.note_environment(Environment())
    store.note_plan({"speed_calls": Planned("key", case.kind, case.title)})
    store.finish("speed_calls", Finished("key", datetime.datetime.now(datetime.UTC), "", None))
    results = Results.read(tmp_path)
    [picture] = speed_cost(results)
    assert [axes.get_title(loc="left") for axes in picture.figure.axes] == ["T1: flexlink ∝ n^1"]
    [finding] = speed_times(results)
    assert finding.heads == ("chain", "n", "native [µs]", "mujoco [µs]")
    assert finding.lines[0] == ("T1", 10.0, pytest.approx(0.1), pytest.approx(1.0))
    assert finding.lines[1][-1] is None


REHEARSED = """
import numba, sys
from msgspec.structs import replace
from validation.case import load_cases
from validation.measuring import kind_of
from validation.runner import _rehearse
[case] = load_cases("speed_calls")
kind, settings = kind_of(case)
_rehearse(case)
ready = lambda: {(name, f.py_func.__qualname__, s) for name, module in list(sys.modules.items())
                 for f in vars(module).values() if isinstance(f, numba.core.dispatcher.Dispatcher) for s in f.overloads}
before = ready()
longer = {n: replace(f, segments=f.segments[1:2]) for n, f in settings.chain.items()}
longer = replace(kind.rehearsed(settings), turns=2, chain=longer)
for _ in kind.run(case, longer):
    pass
print(len(before), sorted(ready() - before))
"""


@pytest.mark.slow
def test_nothing_is_compiled_after_a_warm_up() -> None:
    done = subprocess.run([sys.executable, "-c", REHEARSED], capture_output=True, text=True, cwd=ROOT, check=True)
    count, _, left = done.stdout.partition(" ")
    assert int(count) > 5
    assert left.strip() == "[]"


SCRIPT = "from validation.memory import peak_megabytes; print(peak_megabytes())"


@pytest.mark.skipif(not STATUS.exists(), reason="only Linux has this number")
def test_the_memory_of_a_starting_process_is_not_that_of_the_started_one() -> None:
    held = np.ones(25_000_000)  # 200 MB
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, check=True)
    assert 1.0 < float(done.stdout) < 100.0 < peak_megabytes()
    assert held.size


HELD = """
import numpy as np
from validation.memory import peak_megabytes
before = peak_megabytes()
np.ones(int(before * 125_000) + 12_500_000)  # the peak so far, and 100 MB
print(peak_megabytes() - before)
"""


def test_peak_memory_contains_what_was_held_for_a_moment() -> None:
    """In a new process: this one may hold a gigabyte."""
    done = subprocess.run([sys.executable, "-c", HELD], cwd=ROOT, capture_output=True, text=True, check=True)
    assert float(done.stdout) > 90.0
