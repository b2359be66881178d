"""An arm from `chains/`, with results that are cached for all claims."""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexlink as fl
from flexlink.chain.coordinates import Kind

Array = NDArray[np.float64]
FOLDER = Path(__file__).parent / "chains"
EPS = np.finfo(float).eps
FOURTH = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
"""Weights of the fourth-order central difference."""


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """A scene and its results, computed once for all claims."""

    scene: fl.Scene

    @functools.cached_property
    def chain(self) -> fl.Chain:
        return fl.lump(self.scene)

    @functools.cached_property
    def run(self) -> fl.Trajectory:
        """Run of the unchanged file: fixed steps of RK4."""
        return fl.simulate(self.scene)

    @functools.cached_property
    def half(self) -> fl.Trajectory:
        """Run with half the step."""
        return fl.simulate(self.scene, step=self.scene.run.step / 2)

    @functools.cached_property
    def truth(self) -> fl.Trajectory:
        """Run with an eighth of the step."""
        return fl.simulate(self.scene, step=self.scene.run.step / 8)

    @property
    def mass(self) -> str:
        """Path, for `varied`, of the mass at the end of the last link."""
        return f"link.{self.scene.arm.links[-1].name}.end.mass"

    @property
    def tip(self) -> str | None:
        """Name of the tip with the wrench."""
        return self.scene.wrench.on or None

    @functools.cached_property
    def free(self) -> NDArray[np.intp]:
        """Coordinates without prescribed motion."""
        return np.flatnonzero(self.chain.hinges["prescribed"] == 0)

    def motions(self, joints: NDArray[np.intp]) -> Array:
        """Possible motions of these joints with all others at rest, in columns: one by one, or their shapes."""
        if self.chain.shapes is None:
            return np.eye(self.chain.n)[:, joints]
        Φ = self.chain.shapes.matrix
        return Φ[:, [set(np.flatnonzero(column)) <= set(joints.tolist()) for column in Φ.T]]

    @functools.cached_property
    def passive(self) -> NDArray[np.intp]:
        """Hinges of links, gears and roots, and the coordinates of a floating base."""
        return np.setdiff1d(np.arange(self.chain.n), [*self.chain.active, *self.chain.internal])

    @property
    def held(self) -> list[str]:
        """Names of all joints that can be driven."""
        return [self.chain.joint_name(k) for k in self.chain.active]

    def start(self) -> tuple[Array, Array]:
        return fl.initial_state(self.scene, self.chain)

    def state(self, seed: int = 0) -> tuple[Array, Array, Array, Array]:
        """Angles, rates, torques and a wrench of a random motion; hinges bend by 0.1 rad, slides in links by 1 mm."""
        rng, n = np.random.default_rng(seed), self.chain.n
        bend = np.full(n, 0.1)
        bend[self.chain.active] = 1.0
        bend[[c.kind is Kind.STRAIN for c in self.chain.coordinates]] = 1e-3
        bent, rates = self.moved(bend * rng.normal(size=n)), self.moved(rng.normal(size=n))
        return self.start()[0] + bent, rates, rng.normal(size=n), rng.normal(size=6)

    def moved(self, change: Array) -> Array:
        """The possible motion that is closest to these changes of all joints: a sum of the chain's shapes."""
        if self.chain.shapes is None:
            return change
        Φ = self.chain.shapes.matrix
        return Φ @ np.linalg.lstsq(Φ, change)[0]

    def heavier(self, mass: float) -> fl.Scene:
        """Return the scene with this mass added at the end of its last link."""
        return self.scene.varied({self.mass: self.scene.arm.links[-1].end.mass + mass})

    def damped(self, loss_time: float) -> dict[str, Any]:
        """Changes that make the damping of all springs proportional to their stiffness."""
        arm = self.scene.arm
        found: dict[str, Any] = {f"material.{name}.loss_time": loss_time for name in arm.materials}
        found |= {f"rigidity.{name}.loss_time": loss_time for name in arm.rigidities}
        for link in arm.links:
            found |= {f"link.{link.name}.{key}": None for key in ("damping", "friction", "root_damping", "drag")}
            if link.joint.gear_stiffness:
                found[f"link.{link.name}.joint.gear_damping"] = loss_time * link.joint.gear_stiffness
            if link.root_stiffness:
                found[f"link.{link.name}.root_damping"] = {
                    axis: loss_time * k for axis in "xyz" if (k := getattr(link.root_stiffness, axis))
                }
        return found


@functools.cache
def case(name: str) -> Case:
    return Case(fl.load_scene(FOLDER / f"{name}.toml"))


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def difference(f: Callable[[float], Any], h: float = 1e-3) -> Array:
    """f'(0) by a central difference of fourth order."""
    return np.asarray(sum(w * np.asarray(f(s * h)) for s, w in FOURTH.items()) / h, dtype=float)


def close(found: Any, wanted: Any, relative: float, absolute: float = 0.0) -> None:
    """Check that the largest error is within `relative` times the largest expected number, plus `absolute`."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert found.shape == wanted.shape
    limit = relative * np.abs(wanted).max(initial=0.0) + absolute
    worst = np.abs(found - wanted).max(initial=0.0)
    assert worst <= limit, f"off by {worst:.3g}, {limit:.3g} is allowed, of {np.abs(wanted).max(initial=0.0):.3g}"
