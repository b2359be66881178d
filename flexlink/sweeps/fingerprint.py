"""Fingerprint of a sweep, which identifies everything that its rows depend on: sweep, scene, their files, versions."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from flexlink.common.versions import __version__
from flexlink.common.wording import truncated
from flexlink.data.documents import is_user_file
from flexlink.sweeps.plan import Sweep

Fingerprint = dict[str, Any]


@functools.cache
def version() -> str:
    """Version of flexlink with a hash of its sources, since the sources can change without a new version."""
    folder = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix in {".py", ".toml"}:
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return f"{__version__} (sources {digest.hexdigest()[:12]})"


def fingerprint(sweep: Sweep) -> Fingerprint:
    """Everything that the rows depend on, as JSON, without the descriptions `about`."""
    parts: dict[str, Any] = msgspec.to_builtins(sweep)
    parts.pop("about")
    parts["scene"].pop("about")
    files = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in sorted(set(_own_files(parts)))}
    packages = ("numpy", "scipy", "numba")  # affect the last bit of a number, or the points of a sample
    versions = {"flexlink": version(), **{name: importlib.metadata.version(name) for name in packages}}
    return {**parts, "files": files, "versions": versions}


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Text with the first three differences between two fingerprints; empty if there are none."""
    changes = [f"{path} was {truncated(a)} and is {truncated(b)}" for path, a, b in _different(old, new)]
    more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
    return "; ".join(changes[:3]) + more


def _different(old: Any, new: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            yield from _different(old.get(key), new.get(key), f"{path}.{key}".lstrip("."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _different(a, b, f"{path}[{k}]")
    elif old != new:
        yield path, old, new


def _own_files(value: Any) -> Iterator[str]:
    """Existing files of methods and lumping rules that the sweep refers to."""
    if isinstance(value, Mapping):
        for item in value.values():
            yield from _own_files(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _own_files(item)
    elif is_user_file(value) and Path(value).is_file():
        yield value
