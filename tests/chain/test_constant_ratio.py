"""Damping law "constant": every mode has the requested damping ratio, in modal analysis, runs and engines."""

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.errors import SceneError
from tests.conftest import flexible, make_scene
from tests.support.words import refused

ALIKE = fl.Damping(ratio=0.02, law="constant")
LOAD = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
HELD = fl.Joint(locked=True)


@pytest.mark.parametrize("rule", ["gauss", "lobatto2", "lobatto4", "gauss_rotation", "lobatto2_rotation", "hencky"])
@pytest.mark.parametrize("flex", ["z", "xyz"])
def test_every_mode_has_the_requested_ratio_in_the_initial_configuration(rule: str, flex: str) -> None:
    links = [flexible(name, flex, 5, lumping=rule, damping=ALIKE, hub=LOAD) for name in "ab"]
    start = fl.InitialState(joint_deg=(10.0, 80.0))
    scene = make_scene(*links, tip=LOAD, gravity=(0.0, 0.0, 0.0), initial=start)
    chain = fl.lump(scene)
    q, _ = fl.initial_state(scene, chain)
    np.testing.assert_allclose(fl.modes(chain, q, locked=chain.active).damping_ratios, 0.02, rtol=1e-8)
    elsewhere = fl.modes(chain, 0 * q, locked=chain.active).damping_ratios
    assert np.abs(elsewhere / 0.02 - 1).max() > 0.1
    straight = fl.lump(scene.varied({"initial.joint_deg": [0.0, 0.0]}))
    np.testing.assert_allclose(fl.modes(straight, 0 * q, locked=chain.active).damping_ratios, 0.02, rtol=1e-8)


def test_vibration_in_the_second_mode_decays_at_its_damping_ratio() -> None:
    """After 5 periods of a run, the amplitude of the second mode has decayed by the factor exp(−ζ ω t)."""
    scene = make_scene(flexible("a", "z", 9, lumping="gauss", damping=ALIKE, joint=HELD), gravity=(0.0, 0.0, 0.0))
    chain = fl.lump(scene)
    undamped = fl.modes(fl.lump(scene.varied({"link.a.damping": None})))
    shape, ω = undamped.shapes[1].real * 1e-3, undamped.frequencies[1]
    end = 5 * 2 * np.pi / (ω * np.sqrt(1 - 0.02**2))
    start = fl.InitialState(joint_deg=(0.0,), q=tuple(shape))
    run = fl.simulate(scene.varied({"initial": start}), tolerance=1e-10, duration=end, sample=end)
    M = fl.mass_matrix(chain, np.zeros(chain.n))
    left = shape @ M @ run.q[-1] / (shape @ M @ shape)
    assert left == pytest.approx(np.exp(-0.02 * ω * end), rel=1e-4)


def test_a_root_spring_is_damped_with_its_beam_in_addition_to_its_own_damper() -> None:
    root = {"root_stiffness": fl.details.RootStiffness(z=2e3), "joint": HELD}
    soft = make_scene(flexible("a", lumping="gauss", damping=ALIKE, **root), tip=LOAD, gravity=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(fl.modes(fl.lump(soft)).damping_ratios, 0.02, rtol=1e-9)
    more = fl.lump(soft.varied({"link.a.root_damping": fl.details.RootDamping(z=3.0)})).matrix("damping")
    more[0, 0] -= 3.0
    np.testing.assert_allclose(more, fl.lump(soft).matrix("damping"), rtol=1e-12)


def test_links_may_have_different_damping_ratios_or_none() -> None:
    firm, soft = (fl.Damping(ratio=ratio, law="constant") for ratio in (0.01, 0.05))
    links = flexible("a", damping=firm, joint=HELD), flexible("b", damping=soft, joint=HELD)
    found = fl.modes(fl.lump(make_scene(*links, gravity=(0.0, 0.0, 0.0)))).damping_ratios
    assert ((found > 0.009) & (found < 0.051)).all()
    D = fl.lump(make_scene(links[0], flexible("b", joint=HELD))).matrix("damping")
    assert (np.linalg.eigvalsh(D)[-4:] > 0).all()
    assert not D[4:, 4:].any()


def test_the_modes_command_reports_the_requested_damping_ratio(tmp_path, capsys) -> None:
    scene = make_scene(flexible("a", damping=ALIKE, joint=HELD), gravity=(0.0, 0.0, 0.0))
    assert main(["modes", str(scene.save(tmp_path / "a.toml")), "--count", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[2:5] for line in lines[1:3]] == [["0.02", "elastic", "0.02"]] * 2


def test_unsupported_uses_of_constant_ratio_damping_are_refused() -> None:
    with refused(SceneError, "missing-key"):
        fl.Damping(ratio=0.01)
    with refused(SceneError, "no-effect"):
        fl.Damping(ratio=0.01, at_hz=5.0, law="constant")
    slide = fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0))
    between = flexible("a", damping=ALIKE), fl.Link(name="s", joint=slide, hub=LOAD), flexible("b", damping=ALIKE)
    with refused(SceneError, "inertia-between-hinges"):
        make_scene(*between)
    branch = flexible("a", damping=ALIKE), flexible("b"), flexible("c", damping=ALIKE, on="a")
    with refused(SceneError, "inertia-between-hinges"):
        make_scene(*branch)
    beside = flexible("z"), flexible("a", damping=ALIKE, on="base"), fl.Link(name="s", joint=slide, hub=LOAD)
    assert len(fl.lump(make_scene(*beside)).couplings) == 6, "only the damped link has couplings"
    with refused(SceneError, "too-many-joints"):
        fl.lump(make_scene(flexible("a", "z", 403, damping=ALIKE)))


def test_dampers_between_hinges_are_sorted_with_coupled_cells() -> None:
    """The first link has coupled cells, the second a damper at every hinge; kernels process both in one loop."""
    alike = fl.Damping(ratio=0.02, law="constant")
    links = flexible("a", "z", 5, lumping="lobatto2"), flexible("b", "z", 5, damping=alike)
    chain = fl.lump(make_scene(*links))
    pairs = [(int(row[0]), int(row[1])) for row in chain.couplings.tolist()]
    assert pairs == sorted(pairs)
    assert {chain.coordinates[i].link for i, _ in pairs} == {1, 2}
