"""Arms and robots of example-robot-data, an optional package of URDF files: a table, and the installed folder."""

import dataclasses
import functools
import importlib.metadata
from pathlib import Path

import msgspec

from flexlink.common.errors import ArgumentError, MissingDependencyError, how_to_install
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode
from flexlink.robots.flexible import FlexibleLink
from flexlink.robots.importing import ImportResult, import_urdf

PACKAGE = "example-robot-data"


class KnownArm(Spec, frozen=True):
    """An arm or robot: its file under the package's robots folder, and the arguments of `import_urdf`."""

    file: str
    """Path of the URDF file, relative to the package's robots folder."""
    base: str | None = None
    """Link at which the arm starts. Default: the root of the robot."""
    tip: str | tuple[str, ...] | None = None
    """Link or links at which the arm ends. Default: all ends of the robot."""
    posture: dict[str, float] = msgspec.field(default_factory=dict)
    """Joint positions by name [rad; m for sliding joints]."""
    locked: dict[str, float] = msgspec.field(default_factory=dict)
    """Positions of locked joints on the path, by name [rad; m for sliding joints]."""
    flexible: dict[str, FlexibleLink] = msgspec.field(default_factory=dict)
    """Flexible links, by name."""

    @property
    def path(self) -> Path:
        """Path of the installed file."""
        path = folder() / self.file
        if not path.exists():
            why = f"{PACKAGE} {importlib.metadata.version(PACKAGE)} has no robots/{self.file}"
            raise MissingDependencyError(why, id="package-missing")
        return path


@functools.cache
def folder() -> Path:
    """Return the folder in which example-robot-data installs its robots, under the package's prefix."""
    try:
        package = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        why = f"{PACKAGE} is not installed: {how_to_install('robots')}"
        raise MissingDependencyError(why, id="package-missing") from None
    for file in package.files or []:
        before, inside, _ = file.as_posix().partition(f"/{PACKAGE}/robots/")
        if inside:
            return Path(str(package.locate_file(before + inside)))
    raise MissingDependencyError(f"{PACKAGE} {package.version} has no robots folder", id="package-missing")


def known_arms() -> dict[str, KnownArm]:
    """Return all arms of the table by name; an arm with flexible links also has a rigid entry."""
    table = read_toml(Path(__file__).parent / "data" / "arms.toml")
    flexible: dict[str, dict[str, FlexibleLink]] = decode(table.pop("flexible"), dict[str, dict[str, FlexibleLink]])
    rigid: dict[str, KnownArm] = decode(table, dict[str, KnownArm])
    arms: dict[str, KnownArm] = {}
    for name, arm in rigid.items():
        arms[name] = arm
        if name in flexible:
            arms[f"{name}_flexible"] = msgspec.structs.replace(arm, flexible=flexible[name])
    return arms


def known_arm(name: str) -> KnownArm:
    """Return the arm with this name."""
    arms = known_arms()
    if name not in arms:
        known = f"{short_list(list(arms))}{did_you_mean(name, arms)}"
        raise ArgumentError(f"robot = {truncated(name)}: no such file; known arms are {known}", id="unknown-robot")
    return arms[name]


def import_known(name: str) -> ImportResult:
    """Import an arm of the table with `import_urdf`; its scene has the name of the arm."""
    arm = known_arm(name)
    imported = import_urdf(
        arm.path, base=arm.base, tip=arm.tip, posture=arm.posture, locked=arm.locked, flexible=arm.flexible
    )
    return dataclasses.replace(imported, scene=msgspec.structs.replace(imported.scene, name=name))
