"""Random scenes that together use every key of a scene file; most are ordinary, some are extreme."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.types import Array

Table = dict[str, Any]
FOLDER = Path(os.environ.get("FRESH_SCENES", Path(tempfile.gettempdir()) / "fresh_scenes"))
"""Folder for scenes and their findings."""
AXES = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [0.2, 0.9, 0.1], [0.0, 0.6, 0.8])
MATERIALS = {"steel": (2.1e11, 7850.0), "alu": (7e10, 2700.0), "carbon": (1.2e11, 1600.0), "nylon": (2.5e9, 1150.0)}
HINGES = {
    "gauss": 2, "gauss_matched": 2, "gauss_rotation": 2, "legendre": 1, "lobatto2": 2, "lobatto2_rotation": 2,
    "lobatto4": 4, "midpoint": 1, "paper": 1, "open": 4, "gregory": 6, "hencky": 2, "clamped": 6, "own_rule.toml": 2,
}  # fmt: skip
GRAVITIES = ([0.0, 0.0, 9.81], [0.0, 0.0, -9.81], [0.0, -9.81, 0.0], [0.0, 0.0, 0.0], [1.0, -2.0, -9.5])
EXTREMES = (
    "tiny", "huge", "stiff", "light", "fast", "fine", "coarse", "long", "soft", "dry", "gains", "far", "instant",
    "late", "fine mesh", "weightless",
)  # fmt: skip


class Made(NamedTuple):
    """Table of a scene, its additional files, and the kind of extreme ("" if ordinary)."""

    table: Table
    files: dict[str, str]
    extreme: str

    def write(self, folder: Path) -> Path:
        """Write all files to a folder; return the path of the scene file."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in {**self.files, "scene.toml": toml(self.table)}.items():
            (folder / name).write_text(text, encoding="utf-8")
        return folder / "scene.toml"


def toml(table: Table) -> str:
    """Write a table as TOML, one value per line."""
    return "".join(f"{json.dumps(key)} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool | np.bool_):
        return str(bool(value)).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(int(value) if isinstance(value, int | np.integer) else float(value))


def csv(**columns: ArrayLike) -> str:
    """Write a table of columns; keywords are the column names."""
    rows = np.column_stack([np.asarray(column, float) for column in columns.values()])
    return "\n".join([",".join(columns), *(",".join(map(repr, row.tolist())) for row in rows)]) + "\n"


class Maker:
    """Maker of one scene from a seed."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([20261123, seed])
        self.seed, self.files = seed, dict[str, str]()
        self.extreme = str(self.rng.choice(EXTREMES)) if self.rng.random() < 0.15 else ""
        self.free = self.chance(0.2)
        self.size = {"tiny": 1e-3, "huge": 40.0}.get(self.extreme, 1.0)
        self.gravity = GRAVITIES[self.rng.integers(len(GRAVITIES))]
        self.materials, self.sections, self.rigidities = dict[str, Table](), dict[str, Table](), dict[str, Table]()
        self.links: list[Table] = []
        self.mass: list[float] = []
        self.drop = 0.02 * int(self.rng.integers(4, 20))  # s, duration

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < probability)

    def uniform(self, low: float, high: float, size: int | None = None) -> Any:
        """Uniform random number, rounded like a number that a user writes."""
        found = np.array([float(f"{x:.4g}") for x in self.rng.uniform(low, high, size or 1)])
        return found.tolist() if size else float(found[0])

    def spread(self, low: float, high: float) -> float:
        """Log-uniform random number."""
        return float(f"{np.exp(self.rng.uniform(np.log(low), np.log(high))):.4g}")

    def pick(self, *choices: Any) -> Any:
        """Random choice."""
        return choices[int(self.rng.integers(len(choices)))]

    def body(self, mass: float, length: float) -> Table:
        """Random, physically possible rigid body."""
        r2 = (0.3 * length) ** 2
        if self.chance(0.4):
            return {
                "mass": mass,
                "inertia": [mass * r2 * f for f in (0.9, 1.0, 0.8)],
                "center": [0.0, 0.02 * length, 0.0],
            }
        if self.chance(0.3):
            return {"mass": mass, "inertia": [mass * r2 * f for f in (0.9, 1.0, 0.8, 0.05, -0.04, 0.1)]}
        return {"mass": mass}

    def section(self, thick: float) -> tuple[Table, float, float]:
        """Random section, with its approximate area and smallest second moment of area."""
        shape = self.pick("rectangle", "circle", "tube", "box", "general")
        if shape == "rectangle":
            return {"shape": shape, "height": thick, "width": 2 * thick}, 2 * thick**2, thick**4 / 6
        if shape == "circle":
            return {"shape": shape, "diameter": thick}, 0.785 * thick**2, 0.049 * thick**4
        if shape == "tube":
            return {"shape": shape, "outer": thick, "inner": 0.8 * thick}, 0.28 * thick**2, 0.029 * thick**4
        if shape == "box":
            box = {"shape": shape, "height": thick, "width": 1.2 * thick, "wall": 0.1 * thick}
            return box, 0.4 * thick**2, 0.05 * thick**4
        i = 0.08 * thick**4
        section = {"shape": shape, "area": thick**2, "i_y": i, "i_z": 1.3 * i, "torsion": 1.2 * i}
        return section, thick**2, i

    def beam(self, link: Table, length: float, *, flexible: bool) -> tuple[float, float]:
        """Give a link a beam; return its approximate mass and EI."""
        name = str(self.rng.choice(list(MATERIALS)))
        young, density = MATERIALS[name]
        thick = float(f"{length * self.spread(0.01, 0.04):.3g}")
        thick *= 0.25 if self.extreme == "soft" else 1.0
        section, area, i = self.section(thick)
        young *= {"stiff": 1e4, "soft": 0.05}.get(self.extreme, 1.0)
        density *= 1e-3 if self.extreme == "light" else 1.0
        mass, ei = density * area * length, young * i
        if flexible and self.chance(0.12):
            self.table_of(link, length, mass / length, ei)
        else:
            link |= {"material": name, "section": f"s{len(self.links)}"}
            self.materials[name] = {"young": young, "density": density, "poisson": self.uniform(0.2, 0.4)}
            if self.chance(0.6):
                self.materials[name]["loss_time"] = self.spread(1e-5, 2e-3)
            self.sections[link["section"]] = section
            if self.chance(0.2):
                link["section_tip"] = f"t{len(self.links)}"
                factors = {"area": 0.5, "i_y": 0.25, "i_z": 0.25, "torsion": 0.25}
                self.sections[link["section_tip"]] = {
                    k: v if k == "shape" else v * factors.get(k, 0.7) for k, v in section.items()
                }
        if flexible:
            self.bend(link, thick)
        if flexible and self.chance(0.15):
            pair = {"coulomb": mass * length * self.spread(1e-3, 1e-2)}
            link["friction"] = pair | ({"coulomb_width": self.pick(0.02, 0.05)} if self.chance(0.6) else {})
        if self.chance(0.15):
            link["drag"] = {"coefficient": self.uniform(0.8, 2.0)}
            if section["shape"] == "general" or "rigidity" in link or self.chance(0.4):
                link["drag"]["breadth"] = [3 * thick, 2 * thick]
        return mass, ei

    def table_of(self, link: Table, length: float, rho_a: float, ei: float) -> None:
        """Table of rigidities instead of material and section."""
        x, shape = np.array([0.0, 0.4, 0.4, 1.0]) * length, np.array([1.0, 0.9, 0.7, 0.5])
        inertia = rho_a * (0.02 * length) ** 2 * shape
        rows = {"x": x, "ei_y": ei * shape, "ei_z": 1.3 * ei * shape, "gj": 0.8 * ei * shape, "rho_a": rho_a * shape,
                "rho_i_y": inertia, "rho_i_z": inertia}  # fmt: skip
        link["rigidity"] = f"r{len(self.links)}"
        table: Table = rows
        if self.chance(0.4):
            heads = (
                "x [m]",
                "EI_y [N m²]",
                "EI_z [N m²]",
                "GJ [N m²]",
                "rhoA [kg/m]",
                "rhoI_y [kg m]",
                "rhoI_z [kg m]",
            )
            self.files[f"{link['rigidity']}.csv"] = csv(**dict(zip(heads, rows.values(), strict=True)))
            table = {"file": f"{link['rigidity']}.csv"}
        for key, value in {"loss_time": 3e-4, "stiffness_factor": 0.9, "mass_factor": 1.1}.items():
            if self.chance(0.5):
                table[key] = value
        self.rigidities[link["rigidity"]] = table

    def bend(self, link: Table, thick: float) -> None:
        """Define the bending of a link."""
        rules = [r for r in HINGES if r not in {"hencky", "clamped"} or link["joint"].get("armature") or "hub" in link]
        rule = "gauss" if self.chance(0.3) else str(self.rng.choice(rules))
        unit = HINGES[rule]
        count = unit * int(self.rng.integers(1, 3)) if unit < 4 else unit
        count = 30 if self.extreme == "fine mesh" and rule == "gauss" else count
        root = rule in {"hencky", "clamped"}
        link |= {"flex": "xyz" if "rotation" in rule else self.pick("z", "z", "yz", "xyz"), "segments": count + 1}
        if rule != "gauss" or self.chance(0.3):
            link["lumping"] = rule
        if rule == "own_rule.toml":
            self.files[rule] = 'about = "own"\nsource = "own"\nalternate_axes = true\n' + (
                "[element]\nnodes = [0.21132486540518712, 0.7886751345948129]\nweights = [0.5, 0.5]\n"
            )
        if self.chance(0.2):
            link["up"] = self.pick([0.0, 0.0, 1.0], [0.1, 1.0, 0.3])
        if self.chance(0.3):
            ratio = {"ratio": self.spread(2e-3, 5e-2)}
            law = {"law": "constant"} if self.chance(0.35) else {"at_hz": self.spread(3, 50)}
            link["damping"] = ratio | law
        elif self.chance(0.1):
            link["damping"] = {"ratio": 0.01, "at_hz": 12.0, "law": "proportional"}
        if not root and ("hub" in link or link["joint"].get("armature")) and self.chance(0.25):
            self.soft_root(link, thick)

    def soft_root(self, link: Table, thick: float) -> None:
        """Add springs at the root of the beam; a spring about the beam axis needs inertia about that axis."""
        young = 5e10 * thick**4
        axes = [axis for axis in "yzx"[: 3 if "end" in link else 2] if self.chance(0.6)] or ["z"]
        link["root_stiffness"] = {axis: young * self.spread(1, 10) for axis in axes}
        if self.chance(0.6):
            link["root_damping"] = {axis: k * 1e-3 for axis, k in link["root_stiffness"].items()}

    def link(self, k: int, dh: str) -> None:
        """Append one link."""
        r, name = self.size, f"l{k}" if k else self.pick("waist", "lower arm", "a.b", "stück")
        slides, length = self.chance(0.25), self.uniform(0.3, 1.2) * r
        joint: Table = {"kind": "prismatic"} if slides else ({"kind": "revolute"} if self.chance(0.3) else {})
        if not dh and self.chance(0.7):
            joint["axis"] = (
                [[1.0, 0.0, 0.0], *AXES][int(self.rng.integers(len(AXES) + 1))] if slides else self.pick(*AXES)
            )
        link: Table = {"name": name, "joint": joint}
        self.links.append(link)
        around = self.spread(0.3, 2.0) * (1.0 if slides else length**2) * r**3
        if self.chance(0.45):
            joint["armature"] = around
        beamless = self.chance(0.2)
        if beamless or self.chance(0.2):
            link["hub"] = {"mass": self.uniform(0.5, 3.0) * r**3, "inertia": [x * r**5 for x in (0.02, 0.025, 0.03)]}
            link["hub"] |= {"center": [0.01 * r, 0.0, -0.02 * r]} if self.chance(0.3) else {}
        if self.chance(0.35):
            link["end"] = {"mass": 0.2 * r**3, "inertia": [x * r**5 for x in (3e-3, 2.5e-3, 3e-3)]}
            link["end"] |= {"center": [0.01 * r, 0.03 * r, 0.0]} if self.chance(0.3) else {}
        mass, flexible = 0.0, self.chance(0.65)
        if dh:
            link["dh"] = {"convention": dh, "a": length, "alpha_deg": self.pick(0.0, 90.0, -90.0, 20.0)}
            link["dh"] |= {"d": 0.05 * r, "theta_deg": self.pick(0.0, 30.0)} if self.chance(0.7) else {}
        if not beamless:
            if self.chance(0.15) and not dh:
                link["line"] = [[0.02 * r, 0.0, 0.0], [0.02 * r, 0.6 * length, 0.8 * length]]
            elif dh != "standard" or self.chance(0.5):
                link["length"] = length
            if link.get("dh", {}).get("d") and dh == "standard":
                link["length"] = length
            mass, _ = self.beam(link, length, flexible=flexible)
        self.mass.append(mass + sum(link.get(p, {}).get("mass", 0.0) for p in ("hub", "end")))
        self.moves(joint, length)
        if not dh and self.chance(0.4):
            link["mount"] = {"xyz": [x * r for x in self.uniform(-0.1, 0.2, 3)]}
            turn = {"rpy_deg": self.pick([90.0, 0.0, 0.0], [0.0, -90.0, 0.0], [10.0, 20.0, -30.0])}
            link["mount"] |= turn if self.chance(0.6) else {"rpy": self.uniform(-1, 1, 3)}
        if k and self.chance(0.15) and not dh:
            link["on"] = self.pick("base", *(each["name"] for each in self.links[:-1]))

    def moves(self, joint: Table, length: float) -> None:
        """Friction, limits and gear of a joint."""
        slides, scale = joint.get("kind") == "prismatic", self.size**4
        if self.chance(0.12):
            joint["locked"] = True
        if self.chance(0.4):
            joint["viscous"] = self.spread(0.02, 2.0) * scale * (10 if slides else 1)
        if self.chance(0.25):
            joint["coulomb"] = self.spread(0.02, 1.0) * scale
            if self.chance(0.6) or self.extreme == "dry":
                joint["coulomb_width"] = 1e-6 if self.extreme == "dry" else self.pick(0.01, 0.03, 0.1)
        rooted = "root_stiffness" in self.links[-1] or self.links[-1].get("lumping") in {"hencky", "clamped"}
        needs_rotor = rooted and "hub" not in self.links[-1]
        if "armature" in joint and not needs_rotor and self.chance(0.4):
            joint["gear_stiffness"] = joint["armature"] * (2 * np.pi * self.uniform(4, 20)) ** 2
            if self.chance(0.6):
                joint["gear_damping"] = joint["gear_stiffness"] * self.spread(1e-4, 3e-3)
        if self.chance(0.3):
            joint["limits_m" if slides else "limits_deg"] = [-3.0 * length, 3.0 * length] if slides else [-270, 300.0]

    def make(self) -> Made:
        """Make the complete scene."""
        count, dh = (
            int(self.rng.choice([1, 2, 2, 3, 3, 4])),
            self.pick("standard", "modified") if self.chance(0.12) else "",
        )
        for k in range(count):
            self.link(k, dh)
        if all(link["joint"].get("locked") for link in self.links):
            del self.links[0]["joint"]["locked"]
        self.laws_that_fit()
        table: Table = {"name": f"fresh {self.seed}", "gravity": self.gravity, "link": self.links}
        table |= {k: v for k, v in (("material", self.materials), ("section", self.sections)) if v}
        if self.rigidities:
            table["rigidity"] = self.rigidities
        if self.chance(0.2):
            table["about"] = 'Made by chance: ° ä "quoted" \\ back'
        if self.chance(0.6):
            mass = 1e3 * (sum(self.mass) + 0.1) if self.extreme == "light" else self.uniform(0.1, 1.5) * self.size**3
            table["tip"] = self.body(mass, 0.2 * self.size)
            self.mass[-1] += mass
        last = self.links[-1]
        if self.extreme == "weightless":
            self.mass[-1] += 1e-9
        elif not self.mass[-1] or not ({"hub", "material", "rigidity"} & last.keys()):
            last["hub"] = {"mass": 0.3 * self.size**3, "inertia": [1e-2 * self.size**5] * 3}
        if self.free:
            table["base"] = {"kind": "free", **self.body(20.0 * self.size**3, self.size)}
            table["base"].setdefault("inertia", [2.0 * self.size**5] * 3)
        elif self.chance(0.1):
            table["base"] = {"kind": "fixed"}
        if any("drag" in link for link in self.links) and self.chance(0.5):
            table["air_density"] = self.uniform(0.5, 3.0)
        from tests.campaigns.fresh_scene_actions import act  # noqa: PLC0415  which builds on this

        act(self, table)
        return Made(table, self.files, self.extreme)

    def laws_that_fit(self) -> None:
        """Replace constant damping ratios in arms with branches or sliding joints, which do not support them."""
        plain = not any("on" in link or link["joint"].get("kind") == "prismatic" for link in self.links)
        for link in self.links:
            if link.get("damping", {}).get("law") == "constant" and not plain:
                link["damping"] = {"ratio": link["damping"]["ratio"], "at_hz": 10.0}

    @property
    def inertia(self) -> Array:
        """Approximate inertia moved by each joint [kg m²]; for a sliding joint, the mass [kg]."""
        lengths = [link.get("length") or link.get("dh", {}).get("a") or 0.3 * self.size for link in self.links]
        found = []
        for k, link in enumerate(self.links):
            beyond = [m * np.sum(lengths[k : j + 1]) ** 2 / 2 for j, m in enumerate(self.mass) if j >= k]
            own = sum(self.mass[k:]) if link["joint"].get("kind") == "prismatic" else sum(beyond)
            found.append(own + link["joint"].get("armature", 0.0))
        return np.array(found)


def make(seed: int) -> Made:
    """Scene of a seed."""
    return Maker(seed).make()
