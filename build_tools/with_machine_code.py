"""Build backend: setuptools, which also compiles the solver for wheels, like a native extension.

FLEXLINK_COMPILE lists the CPU families of a wheel, for example "x86-64-v3 x86-64-v4"; by default the code is for the
CPU of the build machine. With "no", or if compilation fails, the code is compiled on first use, as it is in an editable
install.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]
ROOT = Path(__file__).parent.parent


def get_requires_for_build_wheel(*arguments: Any, **keywords: Any) -> list[str]:
    """What compiling and bundling take: the packages that flexlink requires."""
    own = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    return [*build_meta.get_requires_for_build_wheel(*arguments, **keywords), *own]


def build_wheel(*arguments: Any, **keywords: Any) -> str:
    """Build a wheel that contains the compiled solver."""
    compile_solver(ROOT / "flexlink" / "machine_code")
    return build_meta.build_wheel(*arguments, **keywords)


def compile_solver(folder: Path) -> None:
    """Run `flexlink compile`; print a warning if it fails, because the code is then compiled on first use."""
    wanted = os.environ.get("FLEXLINK_COMPILE", "")
    if wanted == "no":
        return
    cpus = [part for cpu in wanted.split() for part in ("--cpu", cpu)]
    command = [sys.executable, "-m", "flexlink", "compile", "--out", str(folder), *cpus]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    run = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, check=False)
    if run.returncode:
        print("flexlink: the solver could not be compiled beforehand; it is compiled on first use", file=sys.stderr)
