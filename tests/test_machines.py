"""The list of machines does not rot, and its runner tells what fails from what cannot be."""

from __future__ import annotations

import numba
import pytest
from conftest import ROOT
from machines.__main__ import main
from machines.run import FILE, Machine, missing, run_as, select
from numba.core.registry import cpu_target

from flexlink.kernels.tools.machine_code import DiskCache


def test_machines_have_names_of_their_own_and_name_tests_that_exist() -> None:
    assert len({machine.name for machine in FILE.machine}) == len(FILE.machine)
    tests = {*FILE.cpu, *FILE.everywhere, *(file for machine in FILE.machine for file in machine.files)}
    for file, _, name in (test.partition("::") for test in tests):
        assert f"def {name.rpartition('::')[2]}" in (ROOT / file).read_text(encoding="utf-8"), f"{file}: {name}"
    assert any(machine.quick for machine in FILE.machine)


def test_what_this_computer_cannot_be_is_told() -> None:
    assert "no vax" in missing(Machine("vax", "old", needs=frozenset({"vax"})))
    assert "python2.99 is not installed" in missing(Machine("new", "new", python="python2.99"))
    assert missing(Machine("here", "this one")) == ""
    with pytest.raises(LookupError, match="allowed are haswell, "):
        select(["vax"])


@pytest.mark.slow
def test_a_machine_s_failure_is_told(tmp_path, monkeypatch, capsys) -> None:
    file = tmp_path / "test_env.py"
    file.write_text("import os\ndef test_it(): assert os.environ.get('BAD') is None\n", encoding="utf-8")
    good, bad = Machine("good", "-", files=(str(file),)), Machine("bad", "-", env={"BAD": "1"}, files=(str(file),))
    assert (run_as(good, good.files, ()).code, run_as(bad, bad.files, ()).counts) == (0, "1 failed")
    monkeypatch.setattr("machines.__main__.select", lambda _: [good, bad])
    assert main([]) == 1
    out = capsys.readouterr().out
    assert "good          ok" in out
    assert "bad           FAILED" in out


def test_machine_code_on_disk_is_kept_apart_by_cpu() -> None:
    """Or a CPU without AVX would run, or be handed, another one's code."""

    class Codegen:
        def __init__(self, *magic: str) -> None:
            self.magic = magic

        def magic_tuple(self) -> tuple[str, ...]:
            return self.magic

    cache = DiskCache(test_what_this_computer_cannot_be_is_told)
    here = cpu_target.target_context.codegen().magic_tuple()
    others = [here, ("x86_64", "generic", ""), ("x86_64", "generic", "+avx"), ("x86_64", "znver4", "")]
    assert len({cache._file((), Codegen(*magic)) for magic in others}) == len(others)
    assert numba.config.CPU_NAME is None or numba.config.CPU_NAME in here
