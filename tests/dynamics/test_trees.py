"""Modes, equilibria and work of branched arms with sliding joints, on fixed and free bases."""

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.arm import Base
from flexlink.dynamics.tangent import stiffness_matrix
from tests.conftest import chain_of, flexible
from tests.support.beams import THIN, branching, thin_link

ROOTS = {
    0.0: [2.36502037243135, 5.49780391900084, 8.63937982869974],
    0.5: [2.13617562651333, 4.98196587137059, 8.0509039739791],
    5.0: [1.92626530993769, 4.73606411573393, 7.87946858968337],
}
"""Roots x of sin x cosh x + cos x sinh x + μ x (1 + cos x cosh x) = 0, by the ratio μ of carriage to beam mass."""


def thin_tree(*links: fl.Link, base: Base | None = None) -> fl.Chain:
    """A tree of thin beams with EI = ρA = L = 1, on a fixed or floating base."""
    arm = fl.Arm(
        links=links,
        materials={"unit": fl.Material(young=1 / THIN, poisson=-0.5, density=1.0)},
        sections={"thin": fl.Section(shape="general", area=1.0, i_y=THIN, i_z=THIN, torsion=THIN)},
        base=base or Base(),
    )
    return chain_of(arm)


@pytest.mark.parametrize("μ", ROOTS)
def test_a_beam_on_a_carriage_has_the_frequencies_of_its_closed_form(μ: float) -> None:
    def errors(hinges: int) -> Array:
        carriage = {
            "joint": fl.Joint(kind="prismatic", axis=(0.0, 1.0, 0.0)),
            "hub": fl.RigidBody(mass=μ),
            "up": (0.0, 0.0, 1.0),
        }
        found = fl.modes(thin_tree(replace(thin_link("gauss", hinges), **carriage)))
        assert found.kinds[:4] == ("rigid", "elastic", "elastic", "elastic")
        return np.abs(np.sqrt(found.frequencies[1:4]) / ROOTS[μ] - 1)

    few, many = errors(16), errors(32)
    assert few[0] < 1e-6
    assert (many < 6e-6).all()
    assert (np.log2(few / many) > 3.8).all()


def test_a_satellite_has_six_rigid_modes_and_modes_of_a_beam_on_a_carriage() -> None:
    still = fl.Joint(locked=True)
    left = replace(thin_link("gauss", 32, "left"), joint=still)
    right = replace(thin_link("gauss", 32, "right"), joint=still, on="base", mount=fl.Mount(rpy_deg=(0.0, 0.0, 180.0)))
    hub = Base(kind="free", mass=1.0, inertia=(1.0, 1.0, 1.0))  # half of the base mass for each panel
    found = fl.modes(thin_tree(left, right, base=hub))
    assert found.kinds[:8] == ("rigid",) * 6 + ("elastic",) * 2
    assert not found.eigenvalues[:6].any()
    for root in ROOTS[0.5]:
        assert np.abs(np.sqrt(found.frequencies) / root - 1).min() < 6e-6


@pytest.mark.parametrize("base", [Base(), Base(kind="free", mass=2.0, inertia=(1.0, 1.0, 1.0))])
def test_the_slowest_modes_of_long_branches_equal_the_first_of_all_modes(base: Base) -> None:
    slider = fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), armature=1.0)
    left = replace(thin_link("gauss", 60, "left", flex="yz"), joint=slider)
    right = replace(
        thin_link("gauss", 20, "right"), joint=fl.Joint(), on="base", mount=fl.Mount(rpy_deg=(0.0, 0.0, 180.0))
    )
    chain = thin_tree(left, right, base=base)
    few, all_ = fl.modes(chain, count=12), fl.modes(chain)
    rigid = 2 + 6 * chain.has_free_base
    assert few.kinds == all_.kinds[:12] == ("rigid",) * rigid + ("elastic",) * (12 - rigid)
    assert few.frequencies == pytest.approx(all_.frequencies[:12], rel=1e-10)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_the_equilibrium_of_an_arm_on_an_elastic_slide_scales_with_size(size: float) -> None:
    spring = fl.Joint(kind="prismatic", axis=(0.0, 1.0, 0.0), armature=1.0, gear_stiffness=100.0 / size)
    arm = fl.Arm(
        links=(
            fl.Link(name="carriage", joint=spring, hub=fl.RigidBody(mass=1.0)),
            flexible("boom", length=size, material="soft", section="bar", joint=fl.Joint(locked=True)),
        ),
        materials={"soft": fl.Material(young=2e9 / size**2, density=1000.0 / size**3)},
        sections={"bar": fl.Section(shape="rectangle", height=0.01 * size, width=0.01 * size)},
    )
    chain = chain_of(arm, (0.0, -9.81, 0.0))
    rest = fl.solve_static(chain, locked=chain.active)
    assert rest.stable
    assert rest.q[1] / size == pytest.approx(-1.1 * 9.81 / 100.0, rel=1e-11)
    clamped = chain_of(replace(arm, links=arm.links[1:]), (0.0, -9.81, 0.0))
    assert rest.q[2:] == pytest.approx(fl.solve_static(clamped).q, rel=1e-9)
    assert len(rest.path) < 10
    K = stiffness_matrix(chain, rest.q, 0 * rest.q, np.zeros(6))
    assert np.abs(K - K.T).max() < 1e-14 * np.abs(K).max()


@pytest.mark.parametrize("on", ["right", "hand"])
@pytest.mark.parametrize("frame", ["world", "tip", "constant"])
def test_the_energy_gain_equals_the_work_of_a_wrench_on_any_tip(frame: str, on: str) -> None:
    """The power is f·v + m·ω of the loaded tip."""
    forces, moments = ((1.0, 2.0, 3.0), (30.0, -50.0, 10.0)), ((1.0, 0.2, 0.3), (3.0, -5.0, 1.0))
    wrench = fl.Wrench(force=forces[1], moment=moments[1], on=on)
    if frame != "constant":
        wrench = fl.Wrench(times=(0.0, 0.02), forces=forces, moments=moments, frame=frame, on=on)
    fine = fl.RunSettings(step=2e-5, sample=0.02, duration=0.02)
    run = fl.simulate(branching(wrench=wrench, run=fine))
    assert np.abs(run.imbalance).max() < 1e-6 * np.abs(run.work).max()
