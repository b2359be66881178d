"""Claims about files, engines that read them, and units."""

import io
import re
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.describe.scene import scene_from
from flexlink.describe.sensor import column_names
from flexlink.formats import FORMATS
from flexlink.identification.coordinates import unit_of
from tests.matrix.case import Case, close

ENGINES = ("mujoco", "pinocchio")
LENGTH, MASS, TIME = 4.0, 16.0, 0.25
"""Factors of units: even powers of two, so that square roots are rounded equally in both units."""
SIZES = {
    "m": LENGTH, "kg": MASS, "s": TIME, "Hz": 1 / TIME, "N": MASS * LENGTH / TIME**2, "Pa": MASS / LENGTH / TIME**2,
    "rad": 1.0, "deg": 1.0, "K": 1.0, "1": 1.0,
}  # fmt: skip
POWERS = {"²": 2, "³": 3}


def toml(case: Case) -> None:
    """A written scene reads back equal, also when its data are in separate files."""
    with tempfile.TemporaryDirectory() as folder:
        path = case.scene.save(Path(folder) / "again.toml")
        assert fl.load_scene(path) == case.scene
        assert fl.load_scene(path).to_toml() == case.scene.to_toml()


def formats(case: Case) -> None:
    """URDF and SDF contain the complete chain: mass matrices, gravity and springs are equal to the bit."""
    q, qd, _, _ = case.state()
    for format in FORMATS.values():
        if format.read is None:
            continue
        read = format.read(format.write(case.chain))
        assert (read.joint_names, list(read.tips)) == (case.chain.joint_names, list(case.chain.tips))
        for field in ("stop", "loaded"):
            np.testing.assert_array_equal(read.bodies[field], case.chain.bodies[field])
        bare = case.chain.without_forces()
        for term in (fl.mass_matrix, fl.gravity_torque, fl.elastic_torque):
            np.testing.assert_array_equal(term(read, q), term(bare, q))
        np.testing.assert_array_equal(fl.friction_torque(read, qd), fl.friction_torque(bare, qd))


def fmus(case: Case) -> None:
    """An FMU of a scene has an output for each axis of its sensors."""
    seen = fl.Sensor(name="seen", kind="position", link=case.scene.arm.links[-1].name)
    scene = case.scene.varied({"sensor": (*case.scene.sensor, seen)})
    archive = zipfile.ZipFile(io.BytesIO(fl.to_fmu(case.chain, case.start(), scene=scene, binary=False)))
    known = re.findall(r'name="([^"]*)"[^>]*description="signal', archive.read("modelDescription.xml").decode())
    own = [name.rpartition(" [")[0].replace(" ", ".") for name in column_names(scene.sensor, scene.arm)]
    assert known == own


def engines(case: Case) -> None:
    """Other engines that read an export reproduce M, bias, accelerations, energy and positions up to rounding."""
    found = fl.compare(case.scene, engines=_able(case), samples=3)
    assert found.passed, str(found)


def engine_runs(case: Case) -> None:
    """A run in another engine with the same steps gives the same motion."""
    found = fl.compare_trajectories(case.scene, engines=_able(case), duration=0.008)
    assert found.passed, str(found)


def _able(case: Case) -> tuple[str, ...]:
    """Engines, for an arm with ties only Pinocchio: those of MuJoCo give way, and their lengths do not move."""
    return ENGINES[1:] if case.scene.ties else ENGINES


def units(case: Case) -> None:
    """A scene converted to other units of length, mass and time has the same motion in these units."""
    chain = case.run.chain
    scene = case.scene.varied({"sensor": None, **({"air_density": 1.225} if len(chain.drag) else {})})
    run, other = fl.simulate(scene), fl.simulate(scene_from(_scaled(scene, scene.document(), [])))
    lengths = np.where(chain.slides, LENGTH, 1.0)
    torques = SIZES["N"] * np.where(chain.slides, 1.0, LENGTH)
    close(other.t, run.t * TIME, 1e-12)
    close(other.q, run.q * lengths, 1e-9)
    close(other.qd, run.qd * lengths / TIME, 1e-9)
    close(other.tau, run.tau * torques, 1e-9)
    close(other.tip, run.tip * LENGTH, 1e-9)
    close(other.energy.parts, run.energy.parts * SIZES["N"] * LENGTH, 1e-9)


def _scaled(scene: fl.Scene, node: Any, path: list[str]) -> Any:
    """Convert the numbers of a document to the new units, which are read from the field descriptions."""
    if isinstance(node, dict):
        return {key: _scaled(scene, value, [*path, key]) for key, value in node.items()}
    if isinstance(node, list | tuple) and node and isinstance(node[0], dict):
        names = [
            each.get("name", each.get("link", "")) if path[-1] != "filter" else str(k + 1)
            for k, each in enumerate(node)
        ]
        return [_scaled(scene, each, [*path, name]) for each, name in zip(node, names, strict=True)]
    if isinstance(node, bool | str) or node is None or path[-1] == "segments" or "modes" in path:
        return node
    return (np.array(node) * _size(scene, path)).tolist()


def _size(scene: fl.Scene, path: list[str]) -> Any:
    slides = np.array(scene.arm.slides)
    turning = np.where(slides, 1.0, LENGTH) * SIZES["N"]  # N for a sliding joint, N m for a turning one
    rows = {"torque": turning, "torques": turning, "effort": turning, "kp": turning * np.where(slides, 1 / LENGTH, 1.0)}
    rows["kd"], rows["ki"] = rows["kp"] * TIME, rows["kp"]
    if path[0] == "drive" and path[-1] in rows:
        others = {"computed_torque": {"kp": TIME**-2, "kd": 1 / TIME}, "cascade": {"kp": 1 / TIME}}
        return others.get(scene.drive.kind, {}).get(path[-1], rows[path[-1]])
    if path[-1] in {"stiffness", "mass"} and path[0] == "rigidity":
        parts = ("N", "N m", "N m²") if path[-1] == "stiffness" else ("kg/m", "kg", "kg m")
        corner, beside, below = map(size, parts)
        return np.block(
            [[np.full((3, 3), corner), np.full((3, 3), beside)], [np.full((3, 3), beside), np.full((3, 3), below)]]
        )
    if path[:2] in (["initial", "q"], ["initial", "qd"]):
        return TIME ** -(path[1] == "qd")  # for chains without sliding joints
    return size(unit_of(scene, ".".join(path)))


def size(unit: str) -> float:
    """Size of one unit in the new units.

    >>> print(size("N m s/rad"), size("kg/m³"), size(""))
    16384.0 0.25 1.0
    """
    over, _, under = unit.partition("/")
    return _product(over) / _product(under)


def _product(units: str) -> float:
    found = 1.0
    for name, power in re.findall(r"([A-Za-z1]+)([²³]?)", units):
        found *= SIZES[name] ** POWERS.get(power, 1)
    return found
