"""Versions of packages, and the hardware, with which a result was computed; names of earlier versions."""

import functools
import importlib
import platform
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

__version__ = "1.1.0"


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


@functools.cache
def old_names() -> dict[str, tuple[str, str]]:
    """Deprecated public names in `old_names.toml`: where each is, and what replaces it."""
    import tomllib  # noqa: PLC0415  takes longer than the rest of `import flexlink`

    return tomllib.loads(Path(__file__).with_name("old_names.toml").read_text("utf-8"))


def old_name(path: str, *, required: bool = False) -> Any:
    """What a deprecated public name denotes, with a DeprecationWarning that states its successor; None: not one."""
    if path not in old_names():
        module, _, name = path.rpartition(".")
        if required:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        return None
    place, new = old_names()[path]
    module, _, name = place.partition(":")
    warnings.warn(f"{path} is deprecated; it is now {new}", DeprecationWarning, stacklevel=3)
    return functools.reduce(getattr, name.split("."), importlib.import_module(f"flexlink.{module}"))
