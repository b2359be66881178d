"""Build backend: setuptools, which also compiles the solver beforehand, like a native extension.

An editable install stores the code in the user's cache; a wheel contains it. FLEXLINK_COMPILE lists the CPU families of
a wheel, for example "x86-64-v3 x86-64-v4"; by default the code is for the CPU of the build machine. With "no", or if
compilation fails, nothing is compiled beforehand and the code is compiled on first use.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
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


def build_editable(*arguments: Any, **keywords: Any) -> str:
    """Build an editable install; compile the solver into the user's cache."""
    compile_solver()
    return build_meta.build_editable(*arguments, **keywords)


def build_wheel(*arguments: Any, **keywords: Any) -> str:
    """Build a wheel that contains the compiled solver."""
    compile_solver("--out", str(ROOT / "flexlink" / "machine_code"))
    return build_meta.build_wheel(*arguments, **keywords)


def compile_solver(*options: str) -> None:
    """Run `flexlink compile`; print a warning if it fails, because the code is then compiled on first use."""
    wanted = os.environ.get("FLEXLINK_COMPILE", "")
    if wanted == "no":
        return
    cpus = [part for cpu in wanted.split() for part in ("--cpu", cpu)] if options else []
    command = [sys.executable, "-m", "flexlink", "compile", *options, *cpus]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    run = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, check=False)
    if run.returncode:
        print("flexlink: the solver could not be compiled beforehand; it is compiled on first use", file=sys.stderr)
