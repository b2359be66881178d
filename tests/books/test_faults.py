"""The planted faults fit the sources, and their runner distinguishes faults that tests detect from others."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.faults import plant
from tests.faults.plant import BROKEN, KILLED, STALE, SURVIVED, Answer, Fault
from tests.support.words import refused, reviewed

FAULTS = plant.load()
TEST = "test_area.py"


def rot(fault: Fault) -> str:
    """Why a fault of the list cannot be planted or checked; empty if it can."""
    if (found := fault.occurrences(ROOT)) != 1:
        return f"{fault.find!r} is found {found} times in {fault.file}, not once"
    planted = (ROOT / fault.file).read_text(encoding="utf-8").replace(fault.find, fault.replace)
    try:
        compile(planted, fault.file, "exec")
    except SyntaxError as error:
        return f"no longer Python: {error}"  # any test would detect it
    for test in fault.tests:
        file, _, function = test.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).is_file() else ""
        if f"def {function.rpartition('::')[2].partition('[')[0]}" not in text:
            return f"{test}: no such test"
    return "" if fault.find != fault.replace else "nothing is replaced"


def test_every_fault_fits_the_sources_and_names_existing_tests() -> None:
    assert {fault.name: reason for fault in FAULTS if (reason := rot(fault))} == {}


def test_names_of_faults_differ() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A project of one function, whose test does not check the sign."""
    files = {
        "area.py": "def area(a, b):\n    return a * b  # m²\n",
        TEST: "from area import area\n\n\ndef test_size():\n    assert abs(area(2, 3)) == 6\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def planted(find: str, replace: str) -> Fault:
    return Fault("area/fault", "area.py", find, replace, (TEST,), "")


@pytest.mark.slow
def test_each_fault_is_killed_survives_or_is_stale_and_leaves_the_sources_unchanged(tree: Path) -> None:
    before = {path.name: path.read_bytes() for path in tree.iterdir()}
    with plant.copied(tree) as copy:
        assert copy.run((TEST,), copy.sound).code == 0
        verdicts = [copy.judge(planted(*texts)) for texts in (("a * b", "a + b"), ("a * b", "-a * b"), ("a / b", ""))]
        twice = copy.judge(planted("a", "b"))
        assert (copy.root / "area.py").read_bytes() == before["area.py"]
    assert [verdict.outcome for verdict in verdicts] == [KILLED, SURVIVED, STALE]
    assert verdicts[0].detail == f"{TEST}::test_size"
    assert re.findall(r"\b\d+\b|area\.py", verdicts[2].detail) == ["0", "area.py"]
    reviewed("faults: stale", verdicts[2].detail)
    assert twice.outcome == STALE
    assert {path.name: path.read_bytes() for path in tree.iterdir()} == before
    assert not copy.root.exists()


@pytest.mark.slow
def test_a_kernel_fault_counts_as_killed_if_a_test_fails_only_with_it(tree: Path) -> None:
    def judged(find: str, replace: str) -> plant.Verdict | None:
        return copy.judge_as_python(planted(find, replace))

    with plant.copied(tree) as copy:
        found = judged("a * b", "a + b")
        assert found is not None and found.outcome == KILLED
        assert judged("a * b", "-a * b") is None, "no test fails"
        assert judged("a * b", "a * b / 0") is None, "Python's own error"
        (copy.root / "area.py").write_text("def area(a, b):\n    return a - b\n", encoding="utf-8")
        copy._right.clear()
        assert judged("a - b", "a + b") is None, "the test fails without it"


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [
        (Answer(0, "3 passed"), SURVIVED),
        (Answer(1, "FAILED tests/test_a.py::test_b - assert 1 == 2"), KILLED),
        (Answer(-11, ""), KILLED),  # a segmentation fault
        (Answer(None, ""), KILLED),  # timeout
        (Answer(2, "! flexlink.results.stop_reasons.InterruptedRunError: interrupted at t = 0 s !"), KILLED),  # Ctrl-C
        (Answer(2, "ERROR tests/test_a.py\n!!! Interrupted: 1 error during collection !!!"), BROKEN),
        (Answer(1, "FAILED tests/test_a.py::test_b - numba.core.errors.TypingError: cannot"), BROKEN),
        (Answer(2, "ERROR tests/test_a.py - NameError: name 'x' is not defined"), BROKEN),
        (Answer(4, "ERROR: not found: tests/test_a.py"), BROKEN),
        (Answer(5, "no tests ran in 0.01s"), BROKEN),
    ],
)  # fmt: skip
def test_a_fault_is_killed_only_by_a_failing_test(answer: Answer, outcome: str) -> None:
    assert plant.verdict(answer)[0] == outcome


def test_faults_are_chosen_by_name_source_or_glob() -> None:
    faults = [Fault(name, "", "", "", (), "") for name in ("rne/a", "rne/b", "mass/a")]

    def chosen(*patterns: str) -> list[str]:
        return [fault.name for fault in plant.select(faults, patterns)]

    assert chosen() == ["rne/a", "rne/b", "mass/a"]
    assert chosen("rne") == ["rne/a", "rne/b"]
    assert chosen("*/a", "rne/b") == ["rne/a", "rne/b", "mass/a"]
    with refused(LookupError, "test-faults"):
        chosen("mas")
