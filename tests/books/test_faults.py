"""The planted faults fit the sources, and their runner distinguishes faults that tests detect from others."""

import ast
import re
import tomllib
import weakref
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.faults import plant
from tests.faults.machine import generator, run, swap
from tests.faults.machine.generator import Mutant, drawn, is_python, mutants
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
        tomllib.loads(planted) if fault.file.endswith(".toml") else compile(planted, fault.file, "exec")
    except (SyntaxError, tomllib.TOMLDecodeError) as error:
        return f"no longer Python or TOML: {error}"  # any test would detect it
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


SOURCE = b'''"""Area, in m\xc2\xb2: 2 * 3."""
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    SIZE = 3
LIMIT = 0.5
AREAS = Memo(16)


class Shape:
    def __repr__(self) -> str:
        return str(1 + 2)

    def area(self, a: float, b: float = 2.0) -> float:
        """1 + 1."""
        if a < LIMIT and b > 1:
            raise ValueError(f"a = {a + 1}: less than {LIMIT - 1}")
        return -a * max(b, 3.0)


def total(chain, shapes):
    key = len(shapes), chain.name
    check(chain)
    return AREAS(chain, (shapes, key), lambda: subtract(shapes[0], shapes[-1].T))
'''


def made(source: bytes = SOURCE) -> dict[tuple[str, str], set[str]]:
    """Replacements of each expression, by function and original text."""
    found: dict[tuple[str, str], set[str]] = {}
    for mutant in mutants("flexlink/chain/area.py", source):
        if is_python(mutant, source):
            found.setdefault((mutant.where, mutant.was), set()).add(mutant.becomes)
    return found


def test_the_mutations_equal_the_expected_list() -> None:
    listed = {
        ("", "0.5"): {"5.0"},
        ("", "2.0"): {"20.0"},
        ("Shape.area", "a < LIMIT and b > 1"): {"True", "False", "b > 1", "a < LIMIT"},
        ("Shape.area", "a < LIMIT"): {"a <= LIMIT"},
        ("Shape.area", "b > 1"): {"b >= 1"},
        ("Shape.area", "1"): {"2"},
        ("Shape.area", "-a * max(b, 3.0)"): {
            "2 * (-a * max(b, 3.0))", "(-a) / max(b, 3.0)", "0.0 * (-a * max(b, 3.0))",
        },
        ("Shape.area", "-a"): {"(a)"},
        ("Shape.area", "max"): {"min"},
        ("Shape.area", "3.0"): {"30.0"},
        ("total", "len(shapes), chain.name"): {"(chain.name,)", "(len(shapes),)"},
        ("total", "check(chain)"): {"pass"},
        ("total", "(shapes, key)"): {"(key,)", "(shapes,)"},
        ("total", "subtract(shapes[0], shapes[-1].T)"): {"subtract(shapes[-1].T, shapes[0])"},
        ("total", "AREAS(chain, (shapes, key), lambda: subtract(shapes[0], shapes[-1].T))"): {
            "AREAS((shapes, key), chain, lambda: subtract(shapes[0], shapes[-1].T))",
            "AREAS(chain, lambda: subtract(shapes[0], shapes[-1].T), (shapes, key))",
        },
        ("total", "0"): {"1"},
        ("total", "1"): {"2"},
        ("total", "shapes[-1]"): {"shapes[0]"},
        ("total", "shapes[-1].T"): {"shapes[-1]"},
    }  # fmt: skip
    assert made() == listed


def test_texts_types_and_display_code_are_not_mutated() -> None:
    texts = {was for _, was in made()}
    assert not texts & {"1 + 2", "1 + 1", "16", "3", "a + 1", "LIMIT - 1"}
    looks = b"def draw(axes):\n    axes.plot(t, x, linewidth=2.0, alpha=0.5)\n    return x * 3.0\n"
    assert {was for _, was in made(looks)} == {"x * 3.0", "3.0"}
    drawing = {mutant.kind for mutant in mutants("reports/figures/area.py", SOURCE)}
    assert not drawing & generator.NUMBERS


def test_mutants_do_not_shift_the_lines_of_a_file() -> None:
    for mutant in mutants("flexlink/chain/area.py", SOURCE):
        planted = mutant.planted(SOURCE)
        assert SOURCE[mutant.start : mutant.end].decode() == mutant.was
        assert planted.count(b"\n") == SOURCE.count(b"\n")
        assert planted != SOURCE


@pytest.fixture
def three_files(tmp_path: Path) -> Path:
    for name in ("a", "b", "c"):
        (tmp_path / "flexlink" / "room").mkdir(parents=True, exist_ok=True)
        (tmp_path / "flexlink" / "room" / f"{name}.py").write_bytes(SOURCE)
    return tmp_path


def test_a_seed_selects_the_same_mutants_whatever_else_changes(three_files: Path) -> None:
    def names(seed: int, most: int, *left_out: str) -> list[str]:
        return [mutant.key for mutant in drawn([], seed, most, frozenset(left_out), three_files)]

    first = names(1, 9)
    assert len(first) == len(set(first)) == 9
    assert {key.partition("|")[0][-4:] for key in first[:3]} == {"a.py", "b.py", "c.py"}, "spread over files"
    assert names(1, 6) == first[:6]
    assert names(2, 9) != first
    assert first[0] not in names(1, 9, first[0])
    a = three_files / "flexlink" / "room" / "a.py"
    a.write_bytes(b"import math\n\n" + SOURCE)
    assert names(1, 9) == first
    file = "flexlink/room/b.py"
    assert drawn([file], 1, 99, frozenset(), three_files)[0].file == file
    assert drawn(["flexlink/none"], 1, 99, frozenset(), three_files) == []


def test_code_of_a_running_process_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions, wherever they are imported or referenced, and values of a module are replaced."""
    source = b"SIZE = 2.5\n\n\ndef area(a):\n    return a * SIZE\n\n\ndef made(b):\n    return lambda a: a + b\n"
    (tmp_path / "shapes.py").write_bytes(source)
    monkeypatch.setattr(swap, "ROOT", tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    import shapes  # type: ignore[import-not-found]  # noqa: PLC0415

    area, held = shapes.area, shapes.made(1)
    gone = weakref.proxy(area.__class__(area.__code__, {}))  # refers to a function that no longer exists

    def plant(was: str, becomes: str, where: str) -> None:
        start = source.index(was.encode())
        line = source[:start].count(b"\n") + 1
        swap.swap(Mutant("shapes.py", line, where, "", was, becomes, start, start + len(was), 0))

    with pytest.raises(swap.CannotSwapError):
        plant("def area(a)", "def area(a=1)", "area")
    plant("a * SIZE", "a / SIZE", "area")
    assert area(5.0) == 2.0
    plant("a + b", "a - b", "made")
    assert held(5) == shapes.made(1)(5) == 4
    plant("2.5", "25.0", "")
    assert (shapes.SIZE, area(5.0)) == (25.0, 125.0)  # the original function
    with pytest.raises(ReferenceError):
        isinstance(gone, dict)


def test_every_equivalent_mutant_exists_and_has_a_reason() -> None:
    wanted = run.plan()
    assert 0.0 < wanted.quota < 1.0
    for same in wanted.same:
        file = same.mutant.partition("|")[0]
        keys = {mutant.key for mutant in mutants(file, (generator.ROOT / file).read_bytes())}
        assert same.mutant in keys, same
        assert len(same.reason) > 10


def test_folders_with_results_are_folders_of_the_project() -> None:
    rooms = {str(Path(file).parent) for file in generator.files()}
    for name, room in run.kept().items():
        assert name in rooms
        assert room.judged == room.killed + len(room.survivors)


def test_a_source_file_has_mutants() -> None:
    file = "flexlink/dynamics/sensors/signals.py"
    found = mutants(file, (generator.ROOT / file).read_bytes())
    assert {"arguments", "axis", "comparison", "condition", "count", "statement"} <= {each.kind for each in found}
    ast.parse(found[0].planted((generator.ROOT / file).read_bytes()))
