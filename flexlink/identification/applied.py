"""Apply experiments to a scene: sensors on its links, and changed values for another motion; columns of its files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import scipy

from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.data.csv_table import in_si, read_csv
from flexlink.describe.link import Link
from flexlink.describe.material import BREADTHS
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor
from flexlink.dynamics.sensors.signals import check_placements
from flexlink.identification.experiments import ColumnExperiment, MotionExperiment
from flexlink.identification.problem import FitRun, files_of


def sensors_on(experiment: ColumnExperiment, scene: Scene, others: list[Sensor]) -> list[Sensor]:
    """The sensor of an experiment on every link and at every place that takes it; they are appended to `others`."""
    found = []
    for link in scene.arm.links:
        fibres = _fibres(scene, link) if experiment.sensor.get("kind") == "strain" else [{}]
        for place in experiment.places or (None,):
            at = {} if place is None else {"x": rounded(place * link.beam.length)}
            for fibre in fibres:
                label = f"{experiment.name} on {link.name}" + "".join(f" at {x:.4g} m" for x in at.values())
                label += "".join(f", {'z' if z else 'y'} side" for _, z in fibre.values())
                try:
                    sensor = Sensor(
                        name=re.sub(r"[\[\]\n\r\t]", " ", label), link=link.name,
                        **{**experiment.sensor, **at, **fibre},
                    )  # fmt: skip
                    check_placements(scene.varied({"sensor": (*scene.sensor, *others, sensor)}))
                except FlexlinkError:
                    continue
                found.append(sensor)
                others.append(sensor)
    return found


def _fibres(scene: Scene, link: Link) -> list[dict[str, tuple[float, float]]]:
    """Positions (y, z) of gauges at the outermost fibres of a link's section; empty if these are not known."""
    section = scene.arm.sections.get(link.section or "")
    if section is None or section.shape not in BREADTHS or link.flex == "rigid":
        return []
    along_z, along_y = (float(getattr(section, key)) for key in BREADTHS[section.shape])
    both = [{"fibre": (rounded(along_y / 2), 0.0)}]
    return [*both, {"fibre": (0.0, rounded(along_z / 2))}] if "y" in link.flex else both


def changes_of(experiment: MotionExperiment, scene: Scene, link: str) -> dict[str, Any]:
    """Values by path that turn a run into another motion."""
    quoted = link if re.fullmatch(r"[A-Za-z0-9_-]+", link) else f'"{link}"'

    def at(path: str) -> str:
        return path.replace("{link}", quoted)

    changes = {at(path): _scaled(scene, at(path), factor) for path, factor in experiment.scale.items()}
    for path, number in experiment.add.items():
        changes[at(path)] = rounded(float(scene.values_at(at(path))[0] or 0.0) + number)
    changes |= {at(path): value for path, value in experiment.set.items()}
    if any(experiment.tilt_deg):
        if not any(scene.gravity):
            raise ArgumentError("the scene has no gravity", id="no-effect")
        base = scipy.spatial.transform.Rotation.from_rotvec(experiment.tilt_deg, degrees=True)
        changes["gravity"] = tuple(rounded(float(part)) for part in base.inv().apply(scene.gravity))
    return changes


def _scaled(scene: Scene, path: str, factor: Any) -> Any:
    """The number or the list of numbers at a path, times a factor."""
    value = scene.values_at(path)[0]
    if value is None or isinstance(value, str):
        raise ArgumentError(f"{path} is not set", id="no-effect")
    return [rounded(item * factor) for item in value] if isinstance(value, list | tuple) else rounded(value * factor)


def rounded(value: float) -> float:
    """A value with five digits, for the problem file."""
    return float(f"{float(value):.5g}")


def heads_of(run: FitRun) -> dict[str, str]:
    """Column heads in the file of a run, by the names of columns in SI units."""
    heads = [head for file in files_of(run) for head in read_csv(Path(file)).heads]
    return {found[0]: head for head in heads if (found := in_si(head)) is not None}
