"""Build backend: setuptools, with the solver compiled before anything is installed, as a native extension would be.

An editable install leaves the code in the user's cache, a wheel carries it. FLEXLINK_COMPILE says for which CPUs a
wheel is built, such as "x86-64-v3 x86-64-v4", by default the one that it is built on; "no": nothing is compiled, and
the code is made on first use. So it is where compiling fails.
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
    """As setuptools does, and the code into the user's cache."""
    compile_solver()
    return build_meta.build_editable(*arguments, **keywords)


def build_wheel(*arguments: Any, **keywords: Any) -> str:
    """As setuptools does, with the code."""
    compile_solver("--out", str(ROOT / "flexlink" / "machine_code"))
    return build_meta.build_wheel(*arguments, **keywords)


def compile_solver(*options: str) -> None:
    """Call the command that does; what goes wrong is told, and the code made on first use."""
    wanted = os.environ.get("FLEXLINK_COMPILE", "")
    if wanted == "no":
        return
    cpus = [part for cpu in wanted.split() for part in ("--cpu", cpu)] if options else []
    command = [sys.executable, "-m", "flexlink", "compile", *options, *cpus]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    run = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, check=False)
    if run.returncode:
        print("flexlink: the solver could not be compiled beforehand; it will be on first use", file=sys.stderr)
