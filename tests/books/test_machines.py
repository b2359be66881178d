"""The list of machines fits the tests, and its runner distinguishes failures from impossible machines."""

from types import SimpleNamespace

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target

from flexlink.kernels.tools.machine_code import DiskCache
from tests.conftest import LONG, ROOT
from tests.machines import noise
from tests.machines.__main__ import main
from tests.machines.run import FILE, Machine, flags, is_already, missing, run_as, select
from tests.support.words import refused, reviewed


def test_machines_have_unique_names_and_list_tests_that_exist() -> None:
    assert len({machine.name for machine in FILE.machine}) == len(FILE.machine)
    tests = {*FILE.everywhere, *(file for machine in FILE.machine for file in (*machine.files, *machine.without))}
    for file, _, name in (test.partition("[")[0].partition("::") for test in tests | LONG):
        assert f"def {name.rpartition('::')[2]}" in (ROOT / file).read_text(encoding="utf-8"), f"{file}: {name}"
    assert all((ROOT / file).is_file() for file in FILE.without_arithmetic)
    assert any(machine.quick for machine in FILE.machine)


def test_machines_that_this_computer_cannot_emulate_are_reported() -> None:
    machines = {
        "vax": Machine("vax", "old", needs=frozenset({"vax"})),
        "python2.99": Machine("new", "new", python="python2.99"),
    }
    for name, machine in machines.items():
        assert name in missing(machine)
        reviewed("machines: missing", missing(machine))
    assert missing(Machine("here", "this one")) == ""
    assert not is_already(Machine("here", "this one"))
    assert not is_already(Machine("new", "new", needs=frozenset({"vax"}), best=True))
    assert is_already(Machine("here", "this one", needs=flags(), best=True))
    with refused(LookupError, "test-machines"):
        select(["vax"])


@pytest.mark.slow
def test_failing_tests_on_a_machine_are_reported(tmp_path, monkeypatch, capsys) -> None:
    file = tmp_path / "test_env.py"
    file.write_text("import os\ndef test_it(): assert os.environ.get('BAD') is None\n", encoding="utf-8")
    good, bad = Machine("good", "-", files=(str(file),)), Machine("bad", "-", env={"BAD": "1"}, files=(str(file),))
    assert (run_as(good, good.files, ()).code, run_as(bad, bad.files, ()).counts) == (0, "1 failed")
    monkeypatch.setattr("tests.machines.__main__.select", lambda _: [good, bad])
    assert main([]) == 1
    out = capsys.readouterr().out
    assert "good          ok" in out
    assert "bad           FAILED" in out


@pytest.mark.slow
def test_quick_runs_few_fast_tests_and_removes_only_the_asserts_of_flexlink(tmp_path) -> None:
    file = tmp_path / "test_it.py"
    file.write_text(
        "import subprocess, sys, pytest, flexlink\n"
        "@pytest.mark.parametrize('k', range(5))\n"
        "def test_last(k): assert k == 4\n"
        "@pytest.mark.slow\n"
        "def test_slow(): assert False\n"
        "def test_docstrings(): assert flexlink.simulate.__doc__ is None and pytest.__doc__\n"
        "def test_children(): assert not subprocess.run([sys.executable, '-c', 'assert False']).returncode\n",
        encoding="utf-8",
    )
    optimised = Machine("-", "-", plugin="tests.machines.optimised", files=(str(file),))
    outcome = run_as(optimised, optimised.files, ("-c", str(ROOT / "pyproject.toml")), quick=True)
    assert outcome.counts == "3 passed", outcome.failed


@pytest.mark.slow
def test_quick_leaves_out_tests_without_arithmetic() -> None:
    here = Machine("here", "this one")
    (file, *_), options = FILE.without_arithmetic, ("--collect-only",)
    assert run_as(here, (file,), options, quick=True).code == pytest.ExitCode.NO_TESTS_COLLECTED
    assert run_as(here, (file,), options).code == pytest.ExitCode.OK


class TestNoise:
    """Simulated rounding of linear algebra on another CPU: equally accurate, and repeatable for the same input."""

    def test_exact_numbers_do_not_change(self, rng: np.random.Generator) -> None:
        exact = np.array([0.0, 1.0, -2.5, 1024.0, np.inf])
        np.testing.assert_array_equal(noise.moved(exact, noise.OUT, rng), exact)
        np.testing.assert_array_equal(noise.as_elsewhere(np.linalg.solve)(np.eye(3), exact[:3]), exact[:3])
        assert noise.as_elsewhere(np.linalg.norm)([3.0, 4.0]) == 5.0

    def test_noise_on_rounded_numbers_is_at_most_two_eps_and_repeatable(self, rng: np.random.Generator) -> None:
        A, b = rng.normal(size=(2, 30, 30)), rng.normal(size=(2, 30, 1))
        solve = noise.as_elsewhere(np.linalg.solve)
        np.testing.assert_array_equal(solve(A, b), solve(A.copy(), b.copy()))
        assert (solve(A, b) != np.linalg.solve(A, b)).mean() > 0.9
        x = noise.moved(A, noise.OUT, rng)
        assert (x != A).mean() > 0.5
        assert (np.abs(x - A) <= 2 * noise.EPS * np.abs(A) * 1.5).all()  # 1.5: the product is rounded

    def test_perturbed_decompositions_still_reproduce_the_matrix(self, rng: np.random.Generator) -> None:
        A = rng.normal(size=(6, 6))
        U, s, V = noise.as_elsewhere(np.linalg.svd)(A)
        near = {"rtol": 0, "atol": 100 * noise.EPS * s[0]}
        np.testing.assert_allclose(U * s @ V, A, **near)
        λ, X = noise.as_elsewhere(np.linalg.eig)(A)
        np.testing.assert_allclose(A @ X, X * λ, **near)
        np.testing.assert_array_equal(np.sort_complex(λ[λ.imag > 0]), np.sort_complex(λ[λ.imag < 0].conj()))
        w, Q = noise.as_elsewhere(np.linalg.eigh)(A + A.T)
        np.testing.assert_allclose(Q * w @ Q.T, A + A.T, **near)
        assert (np.diff(w) >= 0).all()
        assert (np.diff(s) <= 0).all()

    def test_signs_of_eigenvectors_and_order_of_eigenvalues_are_random(self, rng: np.random.Generator) -> None:
        eigh, eigvals = noise.as_elsewhere(np.linalg.eigh), noise.as_elsewhere(np.linalg.eigvals)
        several = [A + A.T for A in rng.normal(size=(20, 4, 4))]
        turned = [np.sign((eigh(A)[1] * np.linalg.eigh(A)[1]).sum(axis=0)) for A in several]
        assert {-1.0, 1.0} == set(np.ravel(turned))
        assert any(np.abs(eigvals(A) - np.linalg.eigvals(A)).max() > 0.1 for A in several)

    @pytest.mark.slow
    def test_a_test_that_depends_on_the_last_bit_fails(self, tmp_path) -> None:
        file = tmp_path / "test_it.py"
        file.write_text(
            "from numpy.linalg import norm\n"
            "def test_bits(): assert norm([0.1, 0.2, 0.3]) == 0.37416573867739417\n"
            "def test_near(): assert abs(norm([0.1, 0.2, 0.3]) - 0.37416573867739417) < 1e-15\n",
            encoding="utf-8",
        )
        noisy = Machine("-", "-", plugin="tests.machines.noise", files=(str(file),))
        assert run_as(noisy, noisy.files, ()).counts == "1 failed, 1 passed"


def test_machine_code_is_cached_separately_for_each_cpu() -> None:
    """Otherwise a CPU without AVX could load machine code that was compiled for one with AVX."""

    cache = DiskCache(SimpleNamespace(py_func=test_machines_that_this_computer_cannot_emulate_are_reported))
    here = cpu_target.target_context.codegen().magic_tuple()
    others = [here, ("x86_64", "generic", ""), ("x86_64", "generic", "+avx"), ("x86_64", "znver4", "")]
    assert len({cache._file((), cpu) for cpu in others}) == len(others)
    assert numba.config.CPU_NAME is None or numba.config.CPU_NAME in here
