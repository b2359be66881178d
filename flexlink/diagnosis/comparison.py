"""compare(scene) → Comparison: the same arm in several engines, or in a file of somebody else's, term by term."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from flexlink.chain.arguments import integer, require_each, require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import html_table
from flexlink.describe.data_files import require_path
from flexlink.describe.scene import Scene
from flexlink.diagnosis.diagnosis import Diagnosis, diagnose, diagnose_file
from flexlink.diagnosis.foreign_files import load_file
from flexlink.diagnosis.quantities import Difference, compare_engines
from flexlink.diagnosis.states import mixed_states
from flexlink.engines import load

MOST_SAMPLES = 100_000  # at some milliseconds each
DEFAULT = ("pinocchio", "mujoco")


@dataclasses.dataclass(frozen=True, repr=False)
class Comparison:
    """A `Diagnosis` of every engine on one scene; prints as a table of their rows with what they say below."""

    scene: str
    samples: int
    diagnoses: tuple[Diagnosis, ...]

    def __repr__(self) -> str:
        agree = sum(row.passed for row in self.rows)
        return f"<Comparison {self.scene!r}: {agree} of {len(self.rows)} quantities agree at {self.samples} states>"

    @property
    def rows(self) -> tuple[Difference, ...]:
        """Every quantity of every engine."""
        return tuple(row for diagnosis in self.diagnoses for row in diagnosis.rows)

    @property
    def passed(self) -> bool:
        """Rounding explains every difference, and nothing was read that runs differ by."""
        return all(diagnosis.passed for diagnosis in self.diagnoses)

    @property
    def diagnosis(self) -> str:
        """Of each engine what agrees, what differs, and the likely mistakes."""
        return "\n".join(map(str, self.diagnoses))

    def _repr_html_(self) -> str:
        rows = [(r.engine, r.quantity, r.error, "ok" if r.passed else "FAILED", r.joint) for r in self.rows]
        return html_table(repr(self), ("engine", "quantity", "error / what rounding explains", "", "worst joint"), rows)

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self.samples} states against native; up to 1, rounding explains the difference"]
        lines.append(f"{'engine':<12}{'quantity':<24}{'error / what rounding explains':<32}{'':<8}worst joint")
        for row in self.rows:
            dots = row.quantity.count("\u0308")  # of q̈: a character that takes no room
            verdict, joint = "ok" if row.passed else "FAILED", row.joint if row.error else "–"
            lines.append(f"{row.engine:<12}{row.quantity:<{24 + dots}}{row.error:<32.2g}{verdict:<8}{joint}")
        return "\n".join([*(lines if self.rows else []), self.diagnosis])


def compare(
    scene: Scene,
    *,
    engines: Sequence[str] | None = None,
    file: str | Path | None = None,
    samples: int = 200,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare engines, which load the exported arm or a given file, with the native dynamics at states of every kind.

    Half of the states are drawn at random, a quarter are balanced, a quarter stretched out (`states.mixed_states`).
    Of a file, joints are matched by name, else by their order, and what its engine has read is compared, too: every
    difference with the mistake that explains it. It has no tip wrench, and what its format cannot say is the scene's.

    Parameters
    ----------
    scene
        The scene; its chain and gravity are used, of a file also its drive; its initial state and motions are not.
    engines
        Names that `flexlink.engines.load` knows; by default Pinocchio and MuJoCo, of a file the one for its format.
    file
        MJCF, URDF or SDF of the same arm, written by whomever.
    samples
        Number of states, up to `MOST_SAMPLES`.
    seed
        Of the random numbers (PCG64).
    progress
        Called with the finished fraction, from 0 to 1, now and then.

    Returns
    -------
    Comparison
        For every engine and quantity the largest difference, and what it looks like; prints as a table.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, `samples` out of range, `seed` < 0, an unknown engine, or one that cannot hold this arm.
    DataFileError
        The file cannot be read, or is no arm of hinges.
    MissingDependencyError
        An engine is not installed.
    SingularMassError
        M is positive definite at none of the postures tried.
    """
    require_type("scene", scene, Scene)
    samples, seed = integer("samples", samples, 1, MOST_SAMPLES), integer("seed", seed, 0)
    names = None if engines is None else require_each("engines", engines, str)
    chain = lump(scene.varied({"motion": ()}))  # prescribed joints are free in the exported files
    if file is not None:
        return _compare_file(scene, chain, require_path("file", file), names, samples, seed, progress)
    loaded = [load(name, chain) for name in (DEFAULT if names is None else names)]
    native, states = load("native", chain), mixed_states(chain, samples, seed=seed)
    rows = compare_engines(chain, native, loaded, states, progress=progress)
    diagnoses = (
        diagnose(chain, engine, [row for row in rows if row.engine == engine.name], states) for engine in loaded
    )
    return Comparison(scene.name, samples, tuple(diagnoses))


def _compare_file(
    scene: Scene,
    chain: Chain,
    file: Path,
    engines: Sequence[str] | None,
    samples: int,
    seed: int,
    progress: Callable[[float], None] | None,
) -> Comparison:
    if engines is not None and len(engines) != 1:
        raise ArgumentError(f"engines = {engines}: a file is read by one of them")
    loaded = load_file(file, chain.n, engines[0] if engines else None)
    states = [s._replace(wrench=np.zeros(6)) for s in mixed_states(chain, samples, seed=seed)]
    diagnosis = diagnose_file(chain, loaded, states, progress, scene=scene)
    return Comparison(f"{scene.name} and {file}", samples, (diagnosis,))
