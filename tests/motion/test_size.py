"""The size of a chain is never 0: carts, wheels and motors run correctly with default settings and every method."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.types import Array
from flexlink.diagnosis.trajectories import in_fixed_steps
from tests.campaigns.random_motors import outcomes
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import refused

ROOT = Path(__file__).parents[2]
STILL = {"gravity": (0.0, 0.0, 0.0)}


def cart(mass: float = 2.0, **joint: Any) -> fl.Link:
    """A mass on a slide."""
    return fl.Link(
        name="cart", joint=fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), **joint), hub=fl.RigidBody(mass=mass)
    )


def wheel(inertia: float = 0.1, mass: float = 5.0, **joint: Any) -> fl.Link:
    """A hub that turns about its own axis."""
    hub = fl.RigidBody(mass=mass, inertia=(inertia / 2, inertia / 2, inertia))
    return fl.Link(name="wheel", joint=fl.Joint(**joint), hub=hub)


@pytest.mark.parametrize(
    ("link", "size"),
    [
        (wheel(0.45, 5.0), 0.3), (wheel(0.0, 5.0, armature=0.2), 0.2), (cart(), 1.0), (wheel(0.3, 0.0), 1.0),
        (cart(limits_m=(-2.0, 3.0)), 3.0), (fl.Link(name="arm", length=0.7, hub=fl.RigidBody(mass=1.0)), 0.7),
    ],
    ids=["radius of gyration", "by its rotor", "a mass alone", "no mass", "travel", "reach"],
)  # fmt: skip
def test_the_size_is_the_reach_or_else_a_radius_of_gyration_or_one_metre(link: fl.Link, size: float) -> None:
    chain = fl.lump(make_scene(link, **STILL))
    assert chain.size == pytest.approx(size, rel=1e-14)
    assert chain.reach in (0.0, chain.size)


@pytest.mark.parametrize(
    ("links", "levers"),
    [
        ((wheel(),), False), ((cart(),), True), ((cart(), wheel()), False),
        ((fl.Link(name="arm", length=0.7, hub=fl.RigidBody(mass=1.0)),), True),
        ((fl.Link(name="shaft", length=0.7, joint=fl.Joint(axis=(1.0, 0.0, 0.0)), hub=fl.RigidBody(mass=1.0)),), False),
        ((fl.Link(name="bob", hub=fl.RigidBody(mass=1.0, center=(0.5, 0.0, 0.0))),), False),
        ((wheel(), fl.Link(name="arm", length=1.0, hub=fl.RigidBody(mass=1.0))), True),
        ((flexible("a", segments=3),), True),
    ],
    ids=["wheel", "cart", "wheel on a cart", "arm", "shaft", "bob", "arm on a wheel", "bending"],
)  # fmt: skip
def test_a_chain_has_lever_arms_if_rotation_moves_a_point(links: tuple[fl.Link, ...], levers: bool) -> None:
    chain = fl.lump(make_scene(*links, **STILL))
    assert chain.has_levers is levers
    assert list(chain.turning_radii) == ([] if levers else [0.0 if slides else chain.size for slides in chain.slides])


def test_a_last_wrist_is_weighted_by_its_radius_of_gyration_about_its_axis() -> None:
    """An error of the wrist angle moves no point of the arm, and its rotor moves no mass."""
    hub = fl.RigidBody(mass=4.0, center=(0.3, 0.0, 0.7), inertia=(0.1, 0.1, 0.2))
    wrist = fl.Link(name="wrist", joint=fl.Joint(armature=5.0), hub=hub)
    chain = fl.lump(make_scene(fl.Link(name="arm", length=1.0, hub=fl.RigidBody(mass=1.0)), wrist, **STILL))
    assert chain.has_levers
    assert chain.turning_radii == pytest.approx([0.0, np.sqrt(0.2 / 4.0 + 0.3**2)], rel=1e-14)


def test_a_motor_on_an_elastic_gear_is_weighted_by_its_share_of_the_momentum() -> None:
    """The rotor turns against the gear spring without moving a point; the rod of 3 kg and 1 m has J = 1 kg m²."""
    hub = fl.RigidBody(mass=3.0, center=(0.5, 0.0, 0.0), inertia=(0.0, 0.25, 0.25))
    joint = fl.Joint(armature=0.25, gear_stiffness=100.0)
    chain = fl.lump(make_scene(fl.Link(name="arm", length=1.0, joint=joint, hub=hub), **STILL))
    assert chain.turning_radii == pytest.approx([np.sqrt(1 / 3) * 0.2, 0.0], rel=1e-14)
    stiff = fl.lump(make_scene(fl.Link(name="arm", length=1.0, joint=fl.Joint(armature=0.25), hub=hub), **STILL))
    assert len(stiff.turning_radii) == 0


@compiled
def test_newtons_residual_for_a_rotor_on_an_elastic_gear_is_within_the_tolerance() -> None:
    """The motor saturates, so rate errors persist; with a norm of positions only, the error was 10.8 tolerances."""
    found = [one for one in outcomes(130, (3.24e-7,)) if one.method == "Radau9"]
    assert [one.word for one in found] == ["right"] and found[0].error < 1.0


@compiled
@pytest.mark.parametrize("method", ["auto", "DOP853", "Radau5", "Radau9"])
def test_a_last_link_without_moving_points_is_within_the_tolerance(method: str) -> None:
    """The last link accelerates the previous one; with a norm of positions only, Radau5 erred by 66 tolerances."""
    scene = fl.load_scene(ROOT / "models" / "robots" / "double_pendulum.toml")
    scene = replace(scene, initial=replace(scene.initial, joint_deg=(70.0, 40.0)))
    scene = replace(scene, run=fl.RunSettings(method=method, tolerance=1e-5, duration=2.0, sample=0.1))
    chain, run = fl.lump(scene), fl.simulate(scene)

    def rates(t: float, y: Array) -> Array:
        return np.concatenate([y[2:], fl.forward_dynamics(chain, y[:2], y[2:], np.zeros(2))])

    start = np.concatenate([run.q[0], run.qd[0]])
    truth = solve_ivp(rates, (0.0, 2.0), start, "DOP853", run.t, rtol=1e-11, atol=1e-12)
    assert np.abs(run.q - truth.y[:2].T).max() * chain.turning_radii[1] < 1e-5


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("links", [(cart(),), (wheel(),), (cart(), wheel())], ids=["cart", "wheel", "both"])
def test_commands_accept_scenes_of_zero_reach(links: tuple[fl.Link, ...], tmp_path: Path, capsys: Any) -> None:
    scene = make_scene(*links, **STILL, drive=fl.Drive(kind="constant", torque=(0.3,) * len(links)))
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    path = str(tmp_path / "scene.toml")
    assert main(["info", path]) == 0
    assert " 0 mm" not in capsys.readouterr().out
    assert main(["simulate", path, "--out", str(tmp_path / "run.csv")]) == 0
    assert main(["modes", path]) == 0
    assert main(["show", path, "-o", str(tmp_path / "run.html")]) == 0


def test_engines_are_compared_with_one_step_per_sample_if_no_step_is_unstable() -> None:
    scene = make_scene(cart(), run=fl.RunSettings(tolerance=1e-3, duration=1.0, sample=0.05), **STILL)
    fixed, words = in_fixed_steps(scene, fl.lump(scene))
    assert fixed.run.fixed_step == 0.05
    assert "RK4" in words and "0.05 s" in words


@compiled
@pytest.mark.slow
@pytest.mark.parametrize(
    ("limits", "is_refused"), [({}, False), ({"limits_m": (-1.0, 1.0)}, True)], ids=["free", "limited"]
)
def test_a_recorded_position_is_too_far_only_beyond_joint_limits(limits: dict[str, Any], is_refused: bool) -> None:
    t = np.linspace(0.0, 1.0, 21)
    columns = {"t [s]": tuple(t.tolist()), "tip x [m]": tuple((500.0 * t).tolist())}
    drive = fl.Drive(kind="constant", torque=(1.0,))
    scene = make_scene(cart(**limits), run=fl.RunSettings(duration=1.0, sample=0.05), drive=drive, **STILL)
    problem = fl.fits.FitProblem(
        scene=scene, run=(fl.fits.FitRun(name="push", columns=columns),),
        parameter=(fl.fits.FitParameter(path="link.cart.hub.mass", between=(1.0, 3.0)),),
    )  # fmt: skip
    if is_refused:
        with refused(fl.FlexlinkError, "likely-unit"):
            fl.fits.check_fit(problem)
    else:
        assert fl.fits.check_fit(problem) is not None
