"""Compiled code cached on disk is never stale and never causes a traceback."""

import ast
import contextlib
import hashlib
import os
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest

from flexlink.kernels.tools import code_files, compiler, machine_code
from flexlink.kernels.tools.lanes import LANES, empty_lanes
from flexlink.kernels.tools.rare import rarely
from tests.conftest import ROOT, compiled
from tests.support.words import refused, reviewed

pytestmark = compiled


def fresh() -> Callable[[float], float]:
    """A kernel that is not compiled yet, as in a new process."""

    def twice(x: float) -> float:
        return 2.0 * x

    return compiler.kernel(twice)


def compilations(call: Callable[[], float]) -> int:
    """The number of compilations while `call` runs; the result of `call` is checked."""
    starts: list[None] = []
    with compiler.watched(lambda: starts.append(None), lambda: None):
        assert call() == 6.0
    return len(starts)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setattr(code_files, "FOLDER", tmp_path / "flexlink" / "0123456789abcdef")
    monkeypatch.setattr(machine_code.DiskCache, "warned", False)
    return code_files.FOLDER


def test_cached_code_on_disk_is_not_compiled_again(folder: Path) -> None:
    assert compilations(lambda: fresh()(3.0)) == 1
    assert compilations(lambda: fresh()(3.0)) == 0
    assert compilations(lambda: fresh()(3)) == 1  # another signature


@pytest.mark.parametrize("cpu", ["host", "x86-64-v4", "x86-64-v3", "x86-64"])
def test_precompiled_code_of_the_package_is_used_if_the_cache_is_empty(folder: Path, monkeypatch, cpu: str) -> None:
    """Packaged code is used for the exact CPU and for each processor family it belongs to."""
    host = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    monkeypatch.setattr(code_files, "SHIPPED", folder.parent / "shipped")
    of = [(host[0], name, "") for name in code_files.FAMILIES]
    for module in (code_files, machine_code):
        monkeypatch.setattr(module, "families", lambda _: of)
    kernel = fresh()
    assert compilations(lambda: kernel(3.0)) == 1
    (file,) = folder.glob("*.bin")
    built_for = host if cpu == "host" else (host[0], cpu, "")
    file.rename(file.with_stem(machine_code._key(kernel.py_func, (numba.float64,), built_for)))
    code_files.SHIPPED.mkdir()
    code_files.pack(folder, code_files.SHIPPED / code_files.ARCHIVE, built_for)
    shutil.rmtree(folder)
    code_files.shipped.cache_clear()
    assert compilations(lambda: fresh()(3.0)) == 0
    assert len([*folder.glob("*.bin")]) == 1  # stored in the cache for later processes
    assert compilations(lambda: fresh()(3.0)) == 0
    code_files.shipped.cache_clear()


def test_precompiled_code_is_used_if_the_cache_folder_is_not_writable(folder: Path, monkeypatch) -> None:
    kernel = fresh()
    assert compilations(lambda: kernel(3.0)) == 1
    monkeypatch.setattr(code_files, "SHIPPED", folder.parent / "shipped")
    code_files.SHIPPED.mkdir()
    code_files.pack(folder, code_files.SHIPPED / code_files.ARCHIVE, machine_code.here())
    monkeypatch.setattr(code_files, "FOLDER", folder.parent / "shipped" / "file" / "0123456789abcdef")
    (folder.parent / "shipped" / "file").touch()
    code_files.shipped.cache_clear()
    assert compilations(lambda: fresh()(3.0)) == 0
    code_files.shipped.cache_clear()


ONCE = """
import sys, time
from pathlib import Path
from flexlink.kernels.tools import code_files, compiler, machine_code

code_files.FOLDER = Path(sys.argv[1])
own = machine_code.DiskCache._save
def slow(*arguments):
    print("compiled")
    time.sleep(0.5)
    own(*arguments)
machine_code.DiskCache._save = slow

@compiler.kernel
def twice(x):
    return 2.0 * x

assert twice(3.0) == 6.0
"""


@pytest.mark.slow
def test_processes_that_need_the_same_function_compile_it_once(tmp_path: Path) -> None:
    script = tmp_path / "once.py"
    script.write_text(ONCE)
    command = [sys.executable, str(script), str(tmp_path / "code")]
    both = [subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert sorted(process.communicate()[0] for process in both) == ["", "compiled\n"]
    assert not [process.returncode for process in both if process.returncode]
    assert not [*(tmp_path / "code").glob("*.lock")]


def copying(kernel: Callable[[float], float]) -> Callable[[float], float]:
    """A kernel that inlines another."""

    def of_another(x: float) -> float:
        return kernel(x)

    return compiler.kernel(of_another)


@pytest.mark.parametrize("damage", ["missing", "damaged", "of another process"])
def test_inlining_a_function_without_bitcode_compiles_it_again(folder: Path, damage: str) -> None:
    """Packaged code has no bitcode."""
    fresh()(3.0)
    (file,) = folder.glob("*.bc")
    if damage == "missing":
        file.unlink()
    elif damage == "of another process":  # compiled at the same time under another name
        theirs = file.read_bytes()
        for own in folder.glob("*.b*"):
            own.unlink()
        fresh()(3.0)
        assert file.read_bytes() != theirs
        file.write_bytes(theirs)
    else:
        file.write_bytes(b"garbage")
    kernel = fresh()
    assert compilations(lambda: kernel(3.0)) == 0
    caller = copying(kernel)
    assert caller(3.0) == 6.0
    (code,) = caller.inspect_llvm().values()
    assert "fmul" in code  # inlined, so the caller's file depends on no other


def test_bitcode_is_read_if_other_code_inlines_it(folder: Path, monkeypatch) -> None:
    fresh()(3.0)
    kernel = fresh()
    assert compilations(lambda: kernel(3.0)) == 0
    monkeypatch.setattr(machine_code.DiskCache, "_module_of_sources", None)  # must not be called
    assert copying(kernel)(3.0) == 6.0


def test_a_cpu_belongs_to_the_families_whose_instructions_it_has() -> None:
    triple = "x86_64-unknown-linux-gnu"
    old, new = (f"+{name}" for name in ("sse2", "avx2"))
    third = ",".join(f"+{name}" for name in code_files.FAMILIES["x86-64-v3"].split())
    fourth = ",".join(f"+{name}" for name in code_files.FAMILIES["x86-64-v4"].split())
    of = [[name for _, name, _ in code_files.families((triple, "any", each))] for each in (old, new, third, fourth)]
    assert of == [["x86-64"], ["x86-64"], ["x86-64-v3", "x86-64"], ["x86-64-v4", "x86-64-v3", "x86-64"]]
    other = ("aarch64-unknown-linux-gnu", "any", "+neon")
    assert code_files.families(other) == []


def test_a_recursion_called_from_python_raises_an_error_and_does_not_crash(folder: Path) -> None:
    @compiler.recursion
    def twice(x: float) -> float:
        return 2.0 * x

    @compiler.kernel
    def calling(x: float) -> float:
        return twice(x)

    assert calling(3.0) == 6.0
    for x in (3.0, 3.0, 3):  # with a compiled signature and with a new one
        with refused(TypeError, "compiler: recursion called from Python"):
            twice(x)


@compiler.subroutine
def _doubled(x: float) -> float:
    return 2.0 * x


def calling() -> Callable[[float], float]:
    """A kernel that calls a subroutine, as a new process would see it."""

    def doubled_plus(x: float) -> float:
        return _doubled(x)

    return compiler.kernel(doubled_plus)


def test_a_subroutine_is_not_inlined_into_its_callers(folder: Path) -> None:
    caller = calling()
    assert caller(3.0) == 6.0
    (code,) = caller.inspect_llvm().values()
    declaration = re.compile(r'declare i32 @"?flexlink\.[^(]*_doubled')
    assert declaration.search(code)
    assert "fmul" not in code


@compiler.recursion
def _halved(x: float) -> float:
    return 0.5 * x


@compiler.inlined
def _of_half(x: float) -> float:
    return _halved(x)


@pytest.mark.parametrize(("called", "always"), [(_of_half, True), (_halved, False)])
def test_a_function_first_compiled_within_an_inlined_one_is_not_inlined_always(
    folder: Path, called: Callable[[float], float], always: bool
) -> None:
    def doubled(x: float) -> float:
        return 2.0 * _of_half(x)

    assert compiler.kernel(doubled)(3.0) == 3.0
    (code,) = called.inspect_llvm().values()  # type: ignore[attr-defined]
    assert ("alwaysinline" in code) is always


def test_a_caller_is_loaded_after_its_subroutines(folder: Path, monkeypatch) -> None:
    def as_in_a_new_process() -> int:
        monkeypatch.setattr(machine_code, "_SHARED", {})
        monkeypatch.setitem(globals(), "_doubled", compiler.subroutine(_doubled.py_func))
        return compilations(lambda: calling()(3.0))

    assert as_in_a_new_process() == 1  # with the subroutine
    assert as_in_a_new_process() == 0
    for file in folder.glob("*._doubled-*"):
        file.unlink()
    assert as_in_a_new_process() == 1  # the subroutine alone
    assert as_in_a_new_process() == 0


PAPER = ROOT / "models" / "paper_fig5.toml"
COUNTING = """
import flexlink as fl
from numba.core import event

class Counter(event.Listener):
    count = 0

    def on_start(self, event):
        self.count += 1

    def on_end(self, event):
        pass

counter = Counter()
event.register("numba:compile", counter)
fl.simulate(fl.load_scene("models/paper_fig5.toml"))
print(counter.count)
"""


def compiled_by_a_first_run(folder: Path) -> int:
    """Number of functions that a first run compiles; counted once per source version, in 16 s, and then stored."""
    digest, own = hashlib.sha256(COUNTING.encode()), code_files.FOLDER
    for source in (PAPER, *sorted((ROOT / "flexlink").rglob("*.py"))):
        digest.update(source.read_bytes())
    kept = own / f"first_run-{digest.hexdigest()[:16]}.txt"
    if kept.is_file():
        return int(kept.read_text("utf-8"))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    command = [sys.executable, "-c", COUNTING]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    with contextlib.suppress(OSError):  # the user has no home folder
        kept.write_text(done.stdout, "utf-8")
    return int(done.stdout)


@pytest.mark.slow
@pytest.mark.first
def test_a_first_run_compiles_few_functions(tmp_path: Path) -> None:
    """One planar run with one control law suffices, as the loops are the same for every control law."""
    assert 100 < compiled_by_a_first_run(tmp_path) <= 192


NUMBERS = {
    "floats": np.array([6.0, 1.0, 3.0, 1.0]),
    "a part of them": np.array([6.0, 1.0, 3.0, 1.0])[::2],
    "integers": np.array([6, 3]),
    "short floats": np.array([6, 3], np.float32),
    "a tuple of floats": (6.0, 3.0),
    "a tuple of integers": (6, 3),
}


def test_different_argument_types_use_different_code(folder: Path) -> None:
    @compiler.kernel
    def ratio(x, y):
        return x[0] / y[1]

    floats, *others = NUMBERS.values()
    pairs = [(floats, floats), *((floats, other) for other in others), *((other, floats) for other in others)]
    expected = [float(x[0] / y[1]) for x, y in pairs]
    for _ in range(2):  # on first lookup and from memory
        assert [machine_code.direct(ratio, *pair)(*pair) for pair in pairs] == pytest.approx(expected)
    assert len({id(machine_code.direct(ratio, *pair)) for pair in pairs}) == len(pairs)


def test_records_with_different_fields_use_different_code(folder: Path) -> None:
    @compiler.kernel
    def difference(rows):
        return rows[0].a - rows[0].b

    for order in ("ab", "ba", "ab"):
        rows = np.zeros(1, [(name, float) for name in order])
        rows["a"], rows["b"] = 5.0, 2.0
        assert machine_code.direct(difference, rows)(rows) == 3.0


def test_different_kernels_use_different_code(folder: Path) -> None:
    @compiler.kernel
    def less(x):
        return x - 1.0

    @compiler.kernel
    def more(x):
        return x + 1.0

    assert [machine_code.direct(f, 3.0)(3.0) for f in (less, more, less)] == [2.0, 4.0, 2.0]


def test_code_that_was_loaded_is_not_looked_up_again() -> None:
    class Kernel:
        looked_up = 0
        typeof_pyval = staticmethod(type)

        def compile(self, types: tuple[type, ...]) -> tuple[type, ...]:
            self.looked_up += 1
            return types

    kernel = Kernel()
    found = [machine_code.direct(kernel, *arguments) for arguments in ((3.0, 1), (7.0, 2), (1, 7.0), (2, 3.0))]
    assert found == [(float, int), (float, int), (int, float), (int, float)]
    assert kernel.looked_up == 2


DAMAGE = {
    "empty": lambda content: b"",
    "garbage": lambda content: b"garbage" * 100,
    "truncated": lambda content: content[: len(content) // 2],
    "one byte short": lambda content: content[:-1],
    "one bit turned": lambda content: content[:2000] + bytes([content[2000] ^ 1]) + content[2001:],
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_damaged_cached_code_is_recompiled_and_replaced(damage: Callable[[bytes], bytes], folder: Path) -> None:
    fresh()(3.0)
    (file,) = folder.glob("*.bin")
    file.write_bytes(damage(file.read_bytes()))
    assert compilations(lambda: fresh()(3.0)) == 1
    assert compilations(lambda: fresh()(3.0)) == 0


def test_unreadable_cached_code_is_recompiled(folder: Path) -> None:
    fresh()(3.0)
    (file,) = folder.glob("*.bin")
    file.unlink()
    file.mkdir()
    with pytest.warns(RuntimeWarning) as caught:
        assert compilations(lambda: fresh()(3.0)) == 1
    reviewed("compiler: code cannot be cached", str(caught[0].message).replace(file.name, "code.bin"))


def test_a_read_only_cache_folder_gives_one_warning_and_no_files_near_the_sources(
    folder: Path, tmp_path: Path, monkeypatch
) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setattr(code_files, "FOLDER", tmp_path / "file" / "0123456789abcdef")
    beside = set(Path(__file__).parent.rglob("*.nb?"))
    with pytest.warns(RuntimeWarning) as caught:
        assert compilations(lambda: fresh()(3.0)) == 1
        assert compilations(lambda: fresh()(3.0)) == 1
    (warning,) = caught
    variable = "NUMBA_CACHE_DIR"
    assert variable in str(warning.message)
    reviewed("compiler: code cannot be cached", str(warning.message))
    assert set(Path(__file__).parent.rglob("*.nb?")) == beside


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_an_edit_in_any_kernel_file_changes_the_cache_folder(variable: str, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv(variable, str(tmp_path / "cache"))
    shutil.copytree(code_files.HERE, tmp_path / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(code_files, "HERE", tmp_path / "kernels")
    before = code_files.cache_folder()
    sources = sorted((tmp_path / "kernels").rglob("*.py"))
    assert tmp_path / "kernels" / "layout.py" in sources
    for source in sources:
        source.write_text("# edited", encoding="utf-8")
        before, edited = code_files.cache_folder(), before
        assert edited != before, source
    assert code_files.cache_folder().parent == before.parent == tmp_path / "cache" / "flexlink"


def test_a_different_numba_version_uses_a_different_cache_folder(monkeypatch) -> None:
    before = code_files.cache_folder()
    monkeypatch.setattr(machine_code.numba, "__version__", "0.0.0")
    assert code_files.cache_folder() != before


def test_kernels_work_for_a_user_without_a_home_folder(folder: Path, monkeypatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for variable in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(machine_code.Path, "home", homeless)
    monkeypatch.setattr(code_files, "FOLDER", code_files.cache_folder())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert compilations(lambda: fresh()(3.0)) == 1


def test_a_new_cache_folder_removes_only_the_least_recently_used_ones(folder: Path) -> None:
    root = folder.parent
    for age in range(code_files.KEPT + 3):
        old = root / f"{age:016x}"
        old.mkdir(parents=True)
        (old / "code.bin").write_bytes(b"")
        os.utime(old, (1e9 - age, 1e9 - age))
    (root / "mine").mkdir()
    (root / "notes.txt").write_text("mine", encoding="utf-8")
    fresh()(3.0)
    left = {path.name for path in root.iterdir()}
    assert left == {f"{age:016x}" for age in range(code_files.KEPT)} | {folder.name, "mine", "notes.txt"}


def test_undocumented_numba_features_are_used_in_three_files_only() -> None:
    """Numba documents its top level, its types, the extension API and, in the core, events and structures."""
    documented = {"numba", "numba.types", "numba.extending", "numba.core.event", "numba.core.cgutils"}
    private = re.compile(r"\b_nrt\b|\b_cache\b|\._re(?:duce|build)\b")
    for source in sorted(code_files.HERE.parent.rglob("*.py")):
        text = source.read_text(encoding="utf-8")
        if source.name not in {"machine_code.py", "absent.py", "parts.py"}:
            assert imported(text) <= documented, source.name
            assert not private.search(text), source.name


def imported(text: str) -> set[str]:
    """Numba modules that a source file imports or imports from."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = node.module in {"numba", "numba.core"}
            found |= {f"{node.module}.{name.name}" if inside else node.module for name in node.names}
    return {name for name in found if name.partition(".")[0] == "numba"}


def test_unlikely_branches_are_marked_in_the_compiled_code() -> None:
    def first_above(numbers: np.ndarray, limit: float) -> int:
        for k in range(len(numbers)):
            if rarely(numbers[k] > limit):
                return k
        return -1

    found = numba.njit(first_above)
    assert [found(np.arange(9.0), limit) for limit in (-1.0, 3.5, 8.0)] == [0, 4, -1]
    (code,) = found.inspect_llvm().values()
    weights = '!"branch_weights", !"expected"'
    assert weights in code


@pytest.mark.parametrize("shape", [(3,), (5, 2), (0, 4), (2, 3, 7)])
def test_lane_arrays_are_aligned_to_cache_lines(shape: tuple[int, ...]) -> None:
    arrays = [empty_lanes(shape) for _ in range(9)]  # not every array of Numba starts at the beginning of a cache line
    assert {each.ctypes.data % 64 for each in arrays} == {0}
    assert {each.shape for each in arrays} == {(*shape, LANES)}
