"""Public functions that no other claim compares work on every arm without NaN, or refuse it with a FlexlinkError."""

import contextlib
import functools
import inspect
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import flexlink as fl
from flexlink.chain.lumping import open_chain
from tests.matrix.case import Case

Call = Callable[[Case, Path], Any]


def _turning(function: Callable[..., Any]) -> Call:
    """Call the function with the first joint at a steady rate, all other joints held, without gravity."""

    def call(case: Case, _: Path) -> Any:
        chain = fl.lump(case.scene.varied({"gravity": (0.0, 0.0, 0.0)}))
        return function(chain, dict.fromkeys(case.held[:1], 0.5), case.start()[0], locked=case.held[1:])

    return call


def _report(case: Case, folder: Path) -> None:
    """Check that no section of the report ended in an unexpected exception."""
    chapters = fl.report(case.scene, folder / "report").chapters
    assert not [chapter.failure for chapter in chapters if re.match(r"[A-Z]\w*: ", chapter.failure or "")]


def _sweep(case: Case, folder: Path) -> Any:
    rows = {"x": {"of": "tip x [m]"}, "kinetic": {"of": "kinetic [J]"}}
    return fl.sweep(fl.Sweep(scene=case.scene, grid={case.mass: [0.1, 0.2]}, quantity=rows)).column("x")


def _problem(case: Case) -> fl.fits.FitProblem:
    """Problem of identifying a mass from a run of a scene in which this mass is 0.2 kg larger."""
    scene = case.heavier(0.1)
    run = fl.simulate(case.heavier(0.2))
    columns = {name: tuple(column) for name, column in run.columns.items() if name[:2] in ("t ", "q ", "qd")}
    sought = fl.fits.FitParameter(path=case.mass, between=(0.01, 2.0))
    return fl.fits.FitProblem(scene=scene, parameter=(sought,), run=(fl.fits.FitRun(name="run", columns=columns),))


def _stored_fit(case: Case, folder: Path) -> Any:
    case.scene.save(folder / "arm.toml")
    case.run.save(folder / "run.csv")
    (folder / "fit.toml").write_text(
        f'scene = "arm.toml"\n[[parameter]]\npath = "{case.mass}"\n[[run]]\nname = "one"\nfile = "run.csv"\n', "utf-8"
    )
    return fl.fits.FitProblem.load(folder / "fit.toml")


def _stored_sweep(case: Case, folder: Path) -> Any:
    case.scene.save(folder / "arm.toml")
    (folder / "sweep.toml").write_text(
        f'scene = "arm.toml"\n[grid]\n"{case.mass}" = [0.1, 0.2]\n[quantity.x]\nof = "tip x [m]"\n', "utf-8"
    )
    return fl.Sweep.load(folder / "sweep.toml")


def _imported(case: Case, folder: Path) -> Any:
    """Import the exported arm as a third-party robot, without flexlink's additional elements."""
    root = ElementTree.fromstring(fl.to_urdf(case.chain))
    for parent in list(root.iter()):
        for own in parent.findall("flexlink"):
            parent.remove(own)
    (folder / "arm.urdf").write_bytes(ElementTree.tostring(root))
    return fl.import_urdf(folder / "arm.urdf").scene


def _of_state(function: Callable[..., Any], count: int, **options: Any) -> Call:
    """Wrap a function whose arguments are a chain and the first `count` parts of a state."""
    return lambda case, _: function(case.chain, *case.state()[:count], **options)


def _servo(case: Case, rate: float = 0.0) -> fl.Scene:
    """The scene with a PD drive that moves every joint by 2° or 10 mm from equilibrium."""
    scene, initial = case.scene, case.scene.initial
    prescribed = {each.link for each in scene.motion}
    kinds = ["" if link.joint.locked or link.name in prescribed else link.joint.kind for link in scene.arm.links]
    driven = [float(kind in {"revolute", "prismatic"}) for kind in kinds]
    starts = {"revolute": initial.joint_deg, "prismatic": initial.joint_m or ()}
    to = {
        kind: tuple(x + by * (k == kind) for x, k in zip(starts[kind] or [0.0] * len(kinds), kinds, strict=True))
        for kind, by in {"revolute": 2.0, "prismatic": 0.01}.items()
    }
    move = fl.Reference(profile="quintic", to_deg=to["revolute"], to_m=to["prismatic"], duration=0.3)
    kp, kd = (tuple(gain * one for one in driven) for gain in (20.0, 1.0))
    gravity, passive = ("none", "zero") if case.scene.arm.base.free else ("static", "static")
    drive = fl.Drive(kind="pd", kp=kp, kd=kd, reference=move, gravity=gravity, rate=rate or None)
    start = fl.InitialState(joint_deg=initial.joint_deg, joint_m=initial.joint_m, base=initial.base, passive=passive)
    return scene.varied({"drive": drive, "initial": start})


def _margins(case: Case, _: Path) -> Any:
    loop = fl.loop(_servo(case, rate=1000.0))
    return loop.growth, [pole.z for pole in loop.poles], [each.sensitivity for each in loop.margins if loop.stable]


PUSHED = {"tip_wrench": (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)}
TABLE: dict[str, Call] = {
    "advise": lambda c, _: fl.advise(c.scene, 0.01, budget=0.01),
    "beam_strain": lambda c, _: fl.strength.beam_strain(
        c.scene, c.run.q[0], link=c.scene.arm.links[-1].name, fibre=(5e-3, 0)
    ),
    "buckling_loads": lambda c, _: fl.strength.buckling_loads(c.chain, c.start()[0], locked=c.held, **PUSHED),
    "check_fit": lambda c, _: fl.fits.check_fit(_problem(c)),
    "compare": lambda c, _: fl.compare(c.scene, engines=["native"], samples=2),
    "compare_trajectories": lambda c, _: fl.compare_trajectories(c.scene, engines=["native"], duration=0.008),
    "equilibrium_in_motion": _turning(fl.small_motion.equilibrium_in_motion),
    "fit": lambda c, _: fl.fit(_problem(c)),
    "import_urdf": _imported,
    "invert": lambda c, _: fl.invert(_servo(c)).torques,
    "linearize_many": lambda c, _: [each.A for each in fl.linearize_many(c.chain, np.array([c.state()[0]] * 2))],
    "Sweep.load": _stored_sweep,
    "FitProblem.load": _stored_fit,
    "loop": _margins,
    "modes": _of_state(fl.modes, 2, **PUSHED),
    "modes_in_motion": _turning(fl.small_motion.modes_in_motion),
    "natural_frequencies": _of_state(fl.natural_frequencies, 1),
    "overshoot": lambda c, _: c.run.overshoot(target=c.run.tip[-1] + 0.1),
    "pd_poles": lambda c, _: fl.small_motion.pd_poles(
        c.chain, c.start()[0], kp=[50.0] * len(c.held), kd=[2.0] * len(c.held)
    ),
    "report": _report,
    "residual_vibration": lambda c, _: c.run.residual_vibration(after=0.5 * (c.run.t[0] + c.run.t[-1])),
    "Scene.rigidified": lambda c, _: fl.lump(c.scene.rigidified()),
    "settling_time": lambda c, _: c.run.settling_time(target=c.run.tip[-1], tolerance=1.0),
    "solve_static": lambda c, _: fl.solve_static(c.chain, c.start()[0]),
    "stable_step": _of_state(fl.stable_step, 2, **PUSHED),
    "sweep": _sweep,
    "to_mjcf": lambda c, _: fl.to_mjcf(fl.lump(open_chain(c.scene)), ties=c.scene),
    "to_c": lambda c, _: fl.to_c(c.chain, slopes=False),
    "to_casadi": lambda c, _: fl.to_casadi(c.chain),
    "to_fmu": lambda c, _: fl.to_fmu(c.chain, c.start(), binary=False),
    "to_sdf": lambda c, _: fl.to_sdf(c.chain),
    "to_urdf": lambda c, _: fl.to_urdf(c.chain),
}
ONLY = {
    "public:advise": ("bent_start", "cart", "cells_plane", "drag", "free", "gear", "rotation", "tied", "tree"),
    "public:fit": ("cart", "cells_space", "drag", "free", "motion", "root", "sampled", "tied", "tree_slide", "wheel"),
    "public:report": ("cart", "sensors", "tied", "tree_cells"),
}
"""Slow functions, and the only chains on which they are tested."""
WRITING = {"FitProblem.load", "Sweep.load", "import_urdf", "report"}
"""Functions that need a folder; to remove one takes longer than most claims."""
SLOW = {"public:fit", "public:report"}
SLOW_CHAINS = {"engine_runs": "free*", "statics": "free*", "public:solve_static": "free*"}
MAY_BE_NAN = {"natural_frequencies", "advise.converged_tip", "advise.error"}
"""Expected results: unstable equilibria, and arms for which no rule was accurate enough."""


def supports(name: str, case: Case) -> None:
    """Check that the function returns without NaN."""
    with tempfile.TemporaryDirectory() if name in WRITING else contextlib.nullcontext("") as folder:
        _finite(name, TABLE[name](case, Path(folder)))


def _finite(name: str, found: Any) -> None:
    if name in MAY_BE_NAN:
        return
    if isinstance(found, np.ndarray | float | complex):
        assert np.asarray(found).dtype.kind not in "fc" or not np.isnan(found).any(), f"{name} gives NaN"
    elif isinstance(found, tuple | list):
        for part in found:
            _finite(name, part)
    elif hasattr(found, "__dict__"):
        for field, part in vars(found).items():
            _finite(f"{name}.{field}", part)


CLAIMS = {f"public:{name}": functools.partial(supports, name) for name in TABLE}


def uncalled() -> set[str]:
    """Public functions that no claim calls."""
    claims = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("*.py"))
    public = {name for name in fl.__all__ if inspect.isfunction(getattr(fl, name))}
    return {name for name in public if not re.search(rf"\bfl\.{name}\b", claims)}
