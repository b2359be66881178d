"""compare(scene) → Comparison: compare the same arm term by term in several engines, or with a foreign file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.arguments import integer, require_each, require_one_of, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError, FlexlinkError, SceneError
from flexlink.common.notebook import html_lines, html_table
from flexlink.common.types import Array
from flexlink.data.documents import read_regular, require_path
from flexlink.describe.scene import Scene
from flexlink.describe.tie import refuse_ties
from flexlink.diagnosis.diagnosis import Diagnosis, diagnose, diagnose_file
from flexlink.diagnosis.quantities import QUANTITIES, Difference, compare_engines, mixed_states, with_ties
from flexlink.engines import Engine, load, load_here
from flexlink.engines.base import ForeignFile
from flexlink.engines.child_process import FileEngine, IsolatedEngine

MAX_SAMPLES = 100_000  # each takes a few milliseconds


@dataclasses.dataclass(frozen=True, repr=False)
class Comparison:
    """One `Diagnosis` per engine for a scene, and why others cannot load it; printed as a table, then the diagnoses."""

    scene: str
    samples: int
    diagnoses: tuple[Diagnosis, ...]
    refused: tuple[str, ...] = ()

    def __repr__(self) -> str:
        agree = sum(row.passed for row in self.rows)
        return f"<Comparison {self.scene!r}: {agree} of {len(self.rows)} quantities agree at {self.samples} states>"

    @property
    def rows(self) -> tuple[Difference, ...]:
        """Every quantity of every engine."""
        return tuple(row for diagnosis in self.diagnoses for row in diagnosis.rows)

    @property
    def passed(self) -> bool:
        """Whether every difference is within the rounding bound, and no finding changes simulations."""
        return all(diagnosis.passed for diagnosis in self.diagnoses)

    @property
    def diagnosis(self) -> str:
        """Agreement, differences and likely mistakes of each engine."""
        return "\n".join([*map(str, self.diagnoses), *(f"not compared: {reason}" for reason in self.refused)])

    def _repr_html_(self) -> str:
        rows = [(r.engine, r.quantity, r.error, "ok" if r.passed else "FAILED", r.joint) for r in self.rows]
        table = html_table(repr(self), ("engine", "quantity", "error / rounding bound", "", "worst joint"), rows)
        return table + html_lines(self.diagnosis)

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self.samples} states; difference from flexlink / rounding bound (agreement: ≤ 1)"]
        lines.append(f"{'engine':<12}{'quantity':<24}{'difference / bound':<20}{'':<8}worst joint")
        for row in self.rows:
            dots = row.quantity.count("\u0308")  # combining dots, for example in q̈, have no width
            verdict, joint = "ok" if row.passed else "FAILED", row.joint if row.error else "–"
            lines.append(f"{row.engine:<12}{row.quantity:<{24 + dots}}{row.error:<20.2g}{verdict:<8}{joint}")
        return "\n".join([*(lines if self.rows else []), self.diagnosis])


def compare(
    scene: Scene, *, engines: Sequence[str] | None = None, file: str | Path | None = None, samples: int = 200,
    seed: int = 0, progress: Callable[[float], None] | None = None,
) -> Comparison:  # fmt: skip
    """Compare engines, which load the exported arm or a foreign file, with the native dynamics at many states.

    Half of the states are random, a quarter balanced, a quarter stretched out (`mixed_states`). For a file, the
    numbers that its engine has read are compared as well, and the likely mistake is given for every difference. Joints
    are then matched by name, by body or by order; the tip wrench is omitted; the scene supplies missing values.
    With ties the states are closed; q̈, the ties' torques, and each g or spring force λ are compared as well.

    Parameters
    ----------
    scene
        The scene. Its arm and gravity are used, and for a file also its drive; its initial state and motions are not.
    engines
        Names in `flexlink.engines.ENGINES`. Default: Pinocchio and MuJoCo, or the one that can load the arm; for a
        file, the engine for its format.
    file
        MJCF, URDF or SDF file of the same arm, from any program.
    samples
        Number of states, up to `MAX_SAMPLES`.
    seed
        Seed of the random numbers (PCG64).
    progress
        Called with the finished fraction, from 0 to 1.

    Returns
    -------
    Comparison
        Largest difference and likely cause for every engine and quantity; printed as a table.

    Raises
    ------
    ArgumentError, SceneError
        `scene` is not a Scene, `samples` is out of range, `seed` < 0, an engine is unknown, or one of `engines`
        (default: every engine) does not support the arm or its ties.
    DataFileError
        The file cannot be read, or has joint types that flexlink does not support.
    EngineError
        The child process of an engine ended.
    MissingDependencyError
        An engine is not installed.
    SingularMassError
        M is not positive definite at any of the configurations tried.

    Examples
    --------
    >>> found = fl.compare(scene, engines=["mujoco"], samples=20)
    >>> print(found.passed, found.diagnosis)
    True mujoco: all 7 quantities agree
    """
    require_type("scene", scene, Scene)
    samples, seed = integer("samples", samples, 1, MAX_SAMPLES), integer("seed", seed, 0)
    names = None if engines is None else require_each("engines", engines, str)
    scene = scene.varied({"motion": ()})  # all joints are free in the exported files
    chain, tied = lump(open_chain(scene)), scene if scene.ties else None
    if file is not None:
        refuse_ties(scene.ties, "files are compared without ties")
        path = require_path("file", file)
        if names is not None and len(names) != 1:
            raise ArgumentError(f"engines = {names}: one engine reads a file; specify one", id="one-engine-per-file")
        base = np.array(chain.bodies["rotation"][1]) if chain.has_free_base else None
        engine_of_file = load_file(path, chain.n, names[0] if names else None, base=base)
        states = [s._replace(wrench=np.zeros(6)) for s in mixed_states(chain, samples, seed=seed)]
        diagnosis = diagnose_file(chain, engine_of_file, states, progress, scene=scene)
        return Comparison(f"{scene.name} and {path}", samples, (diagnosis,))
    loaded, refused = _loaded(chain, names, tied)
    native, states, terms = load("native", chain), mixed_states(chain, samples, seed=seed), QUANTITIES
    if tied is not None:
        states, terms = with_ties(tied, chain, states)
    rows = compare_engines(chain, native, loaded, states, quantities=terms, progress=progress)
    of_engine = {engine: [row for row in rows if row.engine == engine.name] for engine in loaded}
    diagnoses = tuple(diagnose(chain, engine, own, states) for engine, own in of_engine.items())
    return Comparison(scene.name, samples, diagnoses, refused)


def _loaded(chain: Chain, names: Sequence[str] | None, ties: Scene | None) -> tuple[list[Engine], tuple[str, ...]]:
    """The engines, all of those named, or of the default ones those that can load the chain and why others cannot."""
    loaded, errors = list[Engine](), dict[str, FlexlinkError]()
    for name in ("pinocchio", "mujoco") if names is None else names:
        try:
            soft = [] if ties is None or name != "mujoco" else ties.ties
            refuse_ties(soft, "ties of MuJoCo give way; compare runs by compare_trajectories")
            loaded.append(load(name, chain, ties=ties))
        except (ArgumentError, SceneError) as error:
            if names is not None:
                raise
            errors[name] = error
    if not loaded and errors:
        raise errors["pinocchio"]
    return loaded, tuple(f"{name}: {error}" for name, error in errors.items())


READERS = {"mjcf": ("mujoco",), "urdf": ("pinocchio", "mujoco"), "sdf": ("drake",)}
"""Engines for each format, the default first."""


def load_file(
    path: Path, n: int, engine: str | None = None, *, base: Array | None = None, here: bool = False
) -> tuple[str, FileEngine, tuple[str, ...]]:
    """Load a file with about `n` joints in a child process, since the engine may crash, or in this process (`here`).

    Return its format, its engine, and the errors that the engine printed without stopping. `base` is the rotation of a
    floating base at zero angles; the base in the file must float as well.
    """
    format = _format(path, n)
    name = engine or READERS[format][0]
    require_one_of(f"engine for {format.upper()}", name, dict.fromkeys(READERS[format]))
    file = ForeignFile(path.absolute(), format, base)  # the child process may have another working directory
    try:
        loaded = cast(FileEngine, load_here(name, file)) if here else IsolatedEngine(name, file)
        loaded.read_back().require_sound()
    except ArgumentError as error:
        raise DataFileError(f"{path}: {error}") from error
    return format, loaded, tuple(loaded.stderr_errors) if isinstance(loaded, IsolatedEngine) else ()


def _format(path: Path, n: int) -> str:
    root = safe_xml.parse(read_regular(path, largest=safe_xml.LARGEST, error=DataFileError), str(path))
    roots = {"mujoco": "mjcf", "robot": "urdf", "sdf": "sdf"}
    if root.tag not in roots:
        why = f"{path}: root is <{root.tag}>; expected <mujoco> (MJCF), <robot> (URDF) or <sdf>"
        raise DataFileError(why, id="unknown-root-element")
    if (unfolded := _unfolded(root)) > safe_xml.MOST_ELEMENTS:
        why = f"{path}: {unfolded:.3g} elements, with their counts; at most {safe_xml.MOST_ELEMENTS} are read"
        raise DataFileError(why, id="file-too-large")
    hinges, most = sum(1 for joint in root.iter("joint") if joint.get("type") != "fixed"), max(n, 300)
    if hinges > most:  # for n joints Pinocchio needs 35 n³ bytes
        why = f"{path}: {hinges} joints, but the scene's arm has {n}; at most {most} are allowed"
        raise DataFileError(why, id="too-many-joints")
    return roots[root.tag]


def _unfolded(root: ET.Element) -> float:
    """Number of elements after MuJoCo has repeated those with a `count`."""
    total, left = 0.0, [(root, 1.0)]
    while left:
        element, times = left.pop()
        times *= math.prod(safe_xml.numbers_of(element.get("count", "")) or [1.0])
        total += times
        left += [(below, times) for below in element]
    return total
