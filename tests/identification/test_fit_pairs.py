"""Pairs and triples of parameters that the data cannot distinguish are refused and named before the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import ROOT

THREE = fl.load_scene(ROOT / "models" / "three_links.toml").varied({"run.duration": 1.0, "run.sample": 0.005})
WEIGHTLESS = THREE.varied({"gravity": (0.0, 0.0, 0.0)})
BARE = WEIGHTLESS.varied({"tip.mass": 0.0})
DAMPED = THREE.varied({f"link.{name}.damping": {"ratio": 0.01, "at_hz": 3.0} for name in ("upper", "fore")})
PUSHED = WEIGHTLESS.varied({  # only links have mass, and only the drive acts
    "tip.mass": 0.0, "link.*.joint.armature": 0.0, "material.aluminium.loss_time": 0.0, "initial.passive": "zero",
    "initial.rate_deg": [0.0, 0.0, 0.0], "drive": fl.Drive(kind="constant", torque=(0.0, 50.0, 0.0)),
})  # fmt: skip
RUBBING = THREE.varied({"link.waist.joint.viscous": 1.0})
STRIP = fl.Scene(
    name="strip",
    gravity=(0.0, 0.0, 0.0),
    arm=fl.Arm(
        materials={"steel": fl.Material(young=2.1e11, density=7850.0, loss_time=1e-4)},
        sections={"strip": fl.Section(shape="rectangle", height=0.001, width=0.03)},
        links=(
            fl.Link(
                name="l", length=0.4, flex="z", segments=5, material="steel", section="strip",
                joint=fl.Joint(locked=True), root_stiffness={"z": 20.0}, root_damping={"z": 0.01},
            ),
        ),
        tip=fl.RigidBody(mass=0.05, inertia=(1e-4, 1e-4, 1e-4)),
    ),
)  # fmt: skip
E, RHO, η = (f"material.aluminium.{name}" for name in ("young", "density", "loss_time"))
ROOT_SPRING, LENGTH, YOUNG = "link.l.root_stiffness.z", "link.l.length", "material.steel.young"
RATIOS = "link.upper.damping.ratio", "link.fore.damping.ratio"


def tapped(scene: fl.Scene, count: int, ratios: bool = False) -> dict[str, Any]:
    """The lowest frequencies of the arm with locked joints, and their damping ratios."""
    chain = fl.lump(scene)
    rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active.tolist())
    found = fl.modes(chain, rest.q, locked=chain.active.tolist())
    first = np.flatnonzero(np.array(found.kinds) == "elastic")[:count]
    damping_ratios = tuple(found.damping_ratios[first].tolist()) if ratios else ()
    hertz = tuple(found.hertz[first].tolist())
    return {"modes": (fl.fits.FitModes(hertz=hertz, deviation=(0.02,), ratios=damping_ratios, ratio_deviation=1e-4),)}


def sagged(_: fl.Scene) -> dict[str, Any]:
    """The tip deflection of the strip under 0.1 N."""
    return {
        "static": (fl.fits.FitStatic(axis="y", value=-1e-3, deviation=1e-5, set={"wrench.force": (0.0, -0.1, 0.0)}),)
    }


def filmed(scene: fl.Scene) -> dict[str, Any]:
    """The tip path of a run, measured to 1 mm."""
    run, names = fl.simulate(scene), ("tip x [m]", "tip z [m]")
    columns = {"t [s]": run.t} | {name: run.columns[name] for name in names}
    return {"run": (fl.fits.FitRun(name="filmed", columns=columns, noise=dict.fromkeys(names, 1e-3)),)}


PAIRS = [
    ("frequencies know E / ρ only, however many", BARE, (E, RHO), partial(tapped, count=3)),
    ("one frequency, density and payload", WEIGHTLESS, (RHO, "tip.mass"), partial(tapped, count=1)),
    ("two dampings, one ringing", DAMPED, RATIOS, partial(tapped, count=1, ratios=True)),
    ("frequencies know no damping", THREE, (E, η), partial(tapped, count=3)),
    ("three numbers, two frequencies", STRIP, (ROOT_SPRING, LENGTH, YOUNG), partial(tapped, count=2)),
    ("root spring and stiffness, one sag", STRIP, (ROOT_SPRING, YOUNG), sagged),
    ("torque, mass and stiffness together", PUSHED, (E, RHO, "drive.torque.upper"), filmed),
    ("friction of a joint that does not move", RUBBING, ("tip.mass", "link.waist.joint.viscous"), filmed),
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "paths", "data"), [pair[1:] for pair in PAIRS], ids=[pair[0] for pair in PAIRS])
def test_indistinguishable_parameters_are_refused_and_named(
    scene: fl.Scene, paths: Sequence[str], data: Callable[[fl.Scene], dict[str, Any]]
) -> None:
    check = fl.fits.check_fit(
        fl.fits.FitProblem(scene=scene, parameter=tuple(fl.fits.FitParameter(path=p) for p in paths), **data(scene))
    )
    (lost,) = check.lost
    assert set(lost.names) <= set(paths)
    single = {η, "link.waist.joint.viscous"} & set(paths)
    assert set(lost.names) == single if single else len(lost.names) > 1
