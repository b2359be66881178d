"""Versions of packages, and the hardware, with which a result was computed; names of earlier versions."""

import functools
import importlib
import platform
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

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


OLD_NAMES = {
    "flexlink.ReferenceTrajectory": ("describe.reference_trajectory:ReferenceTrajectory", "the class of Scene.course"),
    "flexlink.load_sweep": ("sweeps.plan:Sweep.load", "flexlink.Sweep.load"),
    "flexlink.load_trajectory": ("results.trajectory:Trajectory.load", "flexlink.Trajectory.load"),
    "flexlink.measures": ("results.trajectory:Trajectory", "methods of a run, such as run.overshoot"),
    "flexlink.rigidified": ("describe.scene:Scene.rigidified", "scene.rigidified()"),
    "flexlink.errors.AdviceError": ("common.errors:ArgumentError", "flexlink.errors.ArgumentError"),
    "flexlink.errors.EvaluationLimitError": (
        "results.stop_reasons:EvaluationLimitError", "flexlink.errors.DivergenceError of the id too-many-evaluations"
    ),
    "flexlink.errors.FlexlinkError": ("common.errors:FlexlinkError", "flexlink.FlexlinkError"),
    "flexlink.errors.InterruptedSweepError": ("common.errors:InterruptedSweepError", "KeyboardInterrupt"),
    "flexlink.fits.Fitted": ("identification.fitted:Fitted", "the class of results of flexlink.fit"),
    "flexlink.fits.Proposals": ("identification.proposals:Proposals", "the class of results of flexlink.fits.propose"),
    "flexlink.fits.load_experiments": ("identification.experiments:Experiments.load", "flexlink.fits.Experiments.load"),
    "flexlink.fits.load_fit": ("identification.problem:FitProblem.load", "flexlink.fits.FitProblem.load"),
}  # fmt: skip
"""Deprecated public names: where each is, and what replaces it."""


def old_name(path: str, *, required: bool = False) -> Any:
    """What a deprecated public name denotes, with a DeprecationWarning that states its successor; None: not one."""
    if path not in OLD_NAMES:
        module, _, name = path.rpartition(".")
        if required:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        return None
    place, new = OLD_NAMES[path]
    module, _, name = place.partition(":")
    warnings.warn(f"{path} is deprecated; it is now {new}", DeprecationWarning, stacklevel=3)
    return functools.reduce(getattr, name.split("."), importlib.import_module(f"flexlink.{module}"))
