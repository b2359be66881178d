"""`flexlink compile` compiles in advance what every kind of scene and every public function needs."""

import inspect
import re
import tarfile
from pathlib import Path

import pytest

import flexlink as fl
from flexlink.cli import compile as command
from flexlink.cli import rehearsal
from flexlink.cli.compile import _put
from flexlink.cli.main import main
from flexlink.kernels.tools.code_files import ARCHIVE, FAMILIES, folder_for
from flexlink.kernels.tools.machine_code import PARTS, families_here, here

NOT_KERNELS = {
    "check_fit", "compare", "compare_trajectories", "fit", "import_urdf", "initial_state", "invert",
    "linearize_many", "load_scene", "loop", "lump", "report", "sweep", "to_c", "to_casadi", "to_fmu",
    "to_mjcf", "to_sdf",
    "to_urdf",
}  # fmt: skip
"""Functions that run only kernels which are precompiled for other functions."""


def test_the_precompiled_scenes_cover_all_kinds_of_chain() -> None:
    chains = [fl.lump(rehearsal.scene_of(name)) for name in rehearsal.KINDS]
    assert len({(chain.is_planar, chain.arrays.rare is None) for chain in chains}) == 4
    assert any(chain.has_free_base for chain in chains)
    assert any(chain.has_rotation_springs for chain in chains)
    assert any(chain.slides.any() for chain in chains)


def test_every_public_numerical_function_is_precompiled() -> None:
    text = inspect.getsource(rehearsal)
    public = {name for name in fl.__all__ if inspect.isfunction(getattr(fl, name))}
    assert {name for name in public - NOT_KERNELS if not re.search(rf"\b{name}\b", text)} == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", rehearsal.KINDS)
def test_the_precompilation_runs_to_its_end(name: str, capsys) -> None:
    """A refused call compiles nothing, so each arm may refuse only the calls that it cannot support."""
    rehearsal.main([name])
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == len([*rehearsal.calls(rehearsal.scene_of(name))])
    of_free_base = "sampled law", "loop", "loop of a cascade", "gradient by RK4", "gradient by Gauss4"
    refused = {line.split(": ")[1] for line in printed if "refused" in line}
    assert refused == {"cells": {"modes in motion"}, "free": {"modes in motion", *of_free_base}}.get(name, set())


@pytest.mark.parametrize("arguments", [["--cpu", "x86-64"], ["--cpu", "z80", "--out", "nowhere"]])
def test_an_unsupported_processor_family_is_refused(arguments: list[str], capsys) -> None:
    assert main(["compile", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--cpu = {arguments[1]}" in line and line.endswith("[unknown-processor]")


def test_a_complete_compilation_is_not_repeated_but_a_failed_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str | None] = []

    def compile_for(cpu: str | None, *_: object) -> None:
        calls.append(cpu)
        if len(calls) == 1:
            raise fl.errors.FlexlinkError("compiling plane failed: no message", id="compile-failed")

    monkeypatch.setattr(command, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(command, "_compile", compile_for)
    assert [main(["compile"]) for _ in range(3)] == [2, 0, 0]
    assert calls == [None, None]


def test_a_package_contains_only_called_code_of_the_current_sources_for_each_cpu(tmp_path: Path) -> None:
    code, out = tmp_path / "fedcba9876543210", tmp_path / "out"
    for file in ("called.bin", "called.bc", f"{PARTS}/copied.bin", f"{PARTS}/copied.bc"):
        (code / file).parent.mkdir(parents=True, exist_ok=True)
        (code / file).write_bytes(b"code")
    (out / "0123456789abcdef").mkdir(parents=True)
    other = ("", "other", "")
    for cpu in (other, here(), here()):
        _put(code, out, cpu)
    assert [path.name for path in out.iterdir()] == ["fedcba9876543210"]
    (archive,) = (out / code.name).iterdir()
    assert archive.name == ARCHIVE
    with tarfile.open(archive) as packed:
        assert sorted(packed.getnames()) == sorted(f"{folder_for(cpu)}/called.bin" for cpu in (other, here()))


def test_the_processor_families_of_this_machine_are_the_last_of_the_list() -> None:
    """The list is empty on processors other than x86-64."""
    assert families_here() in [[*FAMILIES][first:] for first in range(len(FAMILIES) + 1)]
