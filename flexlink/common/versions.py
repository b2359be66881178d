"""Versions of packages, and the hardware, with which a result was computed."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from pathlib import Path

__version__ = "1.0.0"


def versions(packages: Iterable[str]) -> dict[str, str]:
    """Installed versions of packages; "" for a missing one."""
    import importlib.metadata  # noqa: PLC0415  takes as long as the rest of `import flexlink`

    versions = {}
    for name in packages:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = ""
    return versions


def processor() -> str:
    """Return the processor's name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def system() -> str:
    """Operating system and machine type."""
    return f"{platform.system()} {platform.machine()}"
