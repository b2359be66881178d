"""The chain has the degrees of freedom, the coordinate order and the properties stated in the paper."""

import dataclasses
import itertools

import numpy as np
import pytest

import flexlink as fl
from flexlink import (
    Arm,
    Chain,
    Joint,
    Link,
    Material,
    Mount,
    PrescribedMotion,
    RigidBody,
    RunSettings,
    Section,
    energy,
    initial_state,
    load_scene,
    lump,
    mass_matrix,
    simulate,
    to_mjcf,
    to_urdf,
)
from flexlink.chain import lumping
from flexlink.chain.lumping import lump_many
from flexlink.common.memo import Memo
from flexlink.describe.link import AXES
from flexlink.describe.material import SHAPES, SectionProperties, rectangle
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.errors import ArgumentError, SceneError
from tests.conftest import ALUMINIUM, ROOT, SQUARE, chain_of, flexible, make_scene, nasty_scene
from tests.support.words import refused, reviewed


@pytest.mark.parametrize(("n", "nseg", "flex"), list(itertools.product([2, 3, 5], [2, 5, 8], ["z", "yz", "xyz"])))
def test_degrees_of_freedom_follow_equation_1_of_the_paper(n: int, nseg: int, flex: str) -> None:
    tip = len(AXES[flex])
    scene = make_scene(Link(name="waist"), *[flexible(f"link{i}", flex, nseg) for i in range(n - 1)])
    assert lump(scene).n == n * (tip * (nseg - 1) + 1) - tip * (nseg - 1)


def test_figure_5_has_ten_degrees_of_freedom_in_the_papers_order(models) -> None:
    scene = load_scene(models / "paper_fig5.toml")
    chain = lump(scene)
    q0, qd0 = initial_state(scene, chain)
    assert chain.n == 10
    np.testing.assert_array_equal(np.degrees(q0).round(12), [-80, 0, 0, 0, 0, -10, 0, 0, 0, 0])
    assert not qd0.any()
    assert chain.active.tolist() == [0, 5]
    # EI/l with l the segment length
    np.testing.assert_allclose(chain.stiffness[1], 70e9 * 0.04**4 / 12 / 0.25, rtol=1e-15)
    assert chain.stiffness[0] == 0


@pytest.mark.parametrize("names", [("a", "a.1.z"), ("a.1.z", "a"), ("a", "a.1.z", "a.1.z_2"), ("a.1", "a", "a.1.1.z")])
def test_joint_names_are_unique_and_every_column_is_kept(names: tuple[str, ...]) -> None:
    scene = make_scene(*(flexible(name, segments=2) for name in names), run=RunSettings(step=1e-4, duration=0.0))
    chain = lump(scene)
    given = [chain.joint_name(k) for k in range(chain.n)]
    assert len(set(given)) == chain.n
    assert [given[k] for k in chain.active] == list(names)
    run = simulate(scene)
    assert (
        len(run.columns) == 1 + 2 * chain.n + len(names) + 3 + 5
    )  # columns: t, q, q̇, drives, tip, energies with work and imbalance
    for text in (to_urdf(chain), to_mjcf(chain)):
        assert all(text.count(f'<joint name="{name}" type=') == 1 for name in given)


def test_a_chain_prints_as_one_short_line(chain: Chain) -> None:
    text = repr(chain)
    reviewed("repr: chain", text)
    assert text.startswith(f"<Chain {chain.name!r}: {chain.n} joints, {len(chain.active)} ")
    assert "\n" not in text
    assert len(text) < 100


def test_an_unknown_coordinate_is_refused(chain: Chain) -> None:
    with refused(ArgumentError, "unknown-hinge"):
        chain.index(1, 99, 3)
    with refused(ArgumentError, "unknown-joint"):
        chain.coordinate(chain.n)


def test_a_chain_is_read_only(chain: Chain) -> None:
    with refused(ValueError, "test-chain"):
        chain.stiffness[0] = 1.0


def test_by_default_the_tip_is_the_last_body_of_the_last_link(chain: Chain) -> None:
    bare = dataclasses.replace(chain, tips={})
    assert bare.tips == {chain.link_names[-1]: len(chain.bodies) - 1}
    assert dataclasses.replace(bare, link_names=(), tips={}).tips == {}


def test_mass_of_the_chain_is_the_mass_of_the_arm() -> None:
    scene = nasty_scene()
    lengths = [link.length for link in scene.arm.links]
    expected = sum(lengths) * ALUMINIUM.density * SQUARE.properties.area + scene.arm.tip.mass
    assert lump(scene).bodies["mass"].sum() == pytest.approx(expected, rel=1e-14, abs=0)


def test_hinge_stiffness_is_rigidity_over_segment_length() -> None:
    section = Section(shape="rectangle", height=0.03, width=0.02)
    scene = make_scene(flexible("a", "xyz", 4))
    scene.arm.sections["square"] = section
    chain, p = lump(scene), section.properties
    shear = 70e9 / (2 * 1.33)
    expected = np.array([shear * p.torsion, 70e9 * p.i_y, 70e9 * p.i_z]) / (1.25 / 4)
    np.testing.assert_allclose(chain.stiffness[1:4], expected, rtol=1e-14)
    assert p.i_z == pytest.approx(0.02 * 0.03**3 / 12, rel=1e-14, abs=0)  # height along y resists bending about z


def test_springs_whose_stiffness_underflows_are_refused() -> None:
    soft, thin = make_scene(flexible("a")), make_scene(flexible("a", "xyz"))
    soft.arm.materials["aluminium"] = Material(young=1e-320, density=1.0)
    thin.arm.materials["aluminium"] = Material(young=1.0, density=1.0)
    thin.arm.sections["square"] = Section(shape="general", area=1.0, i_y=1.0, i_z=1.0, torsion=5e-324)
    for scene in (soft, thin):
        with refused(SceneError, "underflow"):
            lump(scene)


def test_a_locked_joint_rotates_its_link_like_a_mount() -> None:
    """The axes of the hub are the columns of R = Rz Ry Rx, and the link lies along the first column."""
    roll, pitch, yaw = np.radians([30.0, 40.0, 50.0])
    Rx = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    Ry = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    Rz = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    R = np.array(Rz) @ Ry @ Rx
    inertia = (0.1, 0.2, 0.3)
    locked = Link(
        name="b", length=0.7, joint=Joint(locked=True), hub=RigidBody(inertia=inertia),
        mount=Mount(rpy_deg=(30.0, 40.0, 50.0), xyz=(0.1, 0.2, 0.3)),
    )  # fmt: skip
    chain = lump(make_scene(Link(name="a", length=0.5), locked))
    np.testing.assert_allclose(chain.bodies[0]["inertia"], R @ np.diag(inertia) @ R.T, atol=1e-15)
    np.testing.assert_allclose(chain.bodies[-1]["translation"], [0.6, 0.2, 0.3] + 0.7 * R[:, 0], rtol=1e-14)
    np.testing.assert_allclose(chain.bodies[-1]["rotation"], R, atol=1e-15)


def test_hinge_stiffness_is_inversely_proportional_to_the_quadrature_weight() -> None:
    """The weights of this rule are not symmetric from base to tip."""
    _, weights = lumping_rule("clamped").hinges(6)
    assert not np.allclose(weights, weights[::-1])
    locked = Joint(locked=True)
    chain = lump(make_scene(flexible("a", segments=7, lumping="clamped", joint=locked)))
    np.testing.assert_allclose(chain.stiffness, 70e9 * SQUARE.properties.i_z / (1.25 * weights), rtol=1e-14)


def test_a_payload_is_added_to_the_last_segment() -> None:
    bare, loaded = lump(make_scene(flexible("a"))), lump(make_scene(flexible("a"), tip=RigidBody(mass=2.0)))
    m, h = bare.bodies[-2]["mass"], 0.25
    assert loaded.bodies[-2]["mass"] == pytest.approx(m + 2.0)
    assert loaded.bodies[-2]["center"][0] == pytest.approx((m * h / 2 + 2.0 * h) / (m + 2.0))
    moved = m * 2.0 / (m + 2.0) * (h / 2) ** 2
    assert loaded.bodies[-2]["inertia"][2, 2] == pytest.approx(bare.bodies[-2]["inertia"][2, 2] + moved)
    assert loaded.bodies[-1]["mass"] == 0  # the tip frame itself is massless


def test_kelvin_voigt_damping_is_loss_time_times_stiffness(models) -> None:
    chain = lump(load_scene(models / "t3_spatial.toml"))
    passive = np.setdiff1d(np.arange(chain.n), chain.active)
    np.testing.assert_allclose(chain.damping[passive], 1e-4 * chain.stiffness[passive], rtol=1e-15)
    np.testing.assert_array_equal(chain.damping[chain.active], [2.0, 1.0, 0.5])


def test_a_hub_turns_with_its_joint_unless_the_joint_is_locked() -> None:
    hub = RigidBody(mass=3.0, inertia=(0.1, 0.2, 0.3))
    bare, loaded = make_scene(flexible("a"), flexible("b")), make_scene(flexible("a"), flexible("b", hub=hub))
    i = lump(bare).bodies["first"].tolist().index(5)  # the body outboard of the second active joint
    assert lump(loaded).bodies["mass"][i] == pytest.approx(lump(bare).bodies["mass"][i] + 3.0)
    lock = Joint(locked=True)
    bare, loaded = (
        make_scene(flexible("a"), flexible("b", joint=lock)),
        make_scene(flexible("a"), flexible("b", joint=lock, hub=hub)),
    )
    gain = lump(loaded).bodies["mass"] - lump(bare).bodies["mass"]
    np.testing.assert_allclose(gain[gain != 0], [3.0])


def test_a_hinge_at_an_unsprung_joint_or_an_elastic_gear_needs_inertia_in_between(tmp_path) -> None:
    rule = tmp_path / "nodal.toml"
    rule.write_text('about = "a"\nsource = "b"\n[grid]\nfirst = 0.0\nlast = 0.5\n', encoding="utf-8")
    gears = Joint(gear_stiffness=300.0, armature=0.02), Joint(gear_stiffness=300.0, locked=True)
    for joint in (Joint(), *gears):
        with refused(SceneError, "hinge-without-inertia"):
            lump(make_scene(flexible("a", lumping=str(rule), joint=joint)))
    hub = RigidBody(inertia=(0, 0, 0.1))
    for fields in ({"joint": Joint(armature=0.1)}, {"joint": Joint(locked=True)}, {"hub": hub},
                   *({"joint": gear, "hub": hub} for gear in gears)):  # fmt: skip
        chain = lump(make_scene(flexible("a", lumping=str(rule), **fields)))
        assert np.linalg.eigvalsh(mass_matrix(chain, np.zeros(chain.n))).min() > 0


def test_section_properties_of_a_prism_are_computed_once(monkeypatch) -> None:
    """Computing them for each segment separately took 10 s for 100,001 segments."""
    calls = []

    def counted(height: float, width: float) -> SectionProperties:
        calls.append(height)
        return rectangle(height, width)

    monkeypatch.setitem(SHAPES, "rectangle", (counted, ("height", "width")))
    assert lump(make_scene(flexible("a", "xyz", 101, lumping="gauss"))).n == 301
    assert len(calls) < 10


def test_a_segment_of_a_prism_has_the_exact_mass_and_inertia() -> None:
    """m = ρ A l;  I_xx = ρ l (I_y + I_z), I_yy = ρ l I_y + m l²/12, I_zz = ρ l I_z + m l²/12 for length l."""
    section = Section(shape="rectangle", height=0.03, width=0.02)
    arm = Arm(links=(flexible("a", "xyz", 5),), materials={"aluminium": ALUMINIUM}, sections={"square": section})
    body = chain_of(arm, (0, 0, 0)).bodies[2]
    line, l, p = ALUMINIUM.density * 0.25, 0.25, section.properties
    slender = line * p.area * l**2 / 12
    wanted = line * np.array([p.i_y + p.i_z, p.i_y, p.i_z]) + [0, slender, slender]
    assert body["mass"] == pytest.approx(line * p.area, rel=1e-14, abs=0)
    assert body["center"].tolist() == pytest.approx([l / 2, 0, 0], rel=1e-14, abs=0)
    np.testing.assert_allclose(body["inertia"], np.diag(wanted), rtol=1e-13, atol=0)


def test_chains_share_a_layout_only_if_axes_and_prescribed_joints_match(tmp_path) -> None:
    rule = 'about = "a"\nsource = "b"\nalternate_axes = {}\n[grid]\nfirst = 0.5\nlast = 0.5\n'
    files = {order: tmp_path / f"{order}.toml" for order in ("true", "false")}
    for order, file in files.items():
        file.write_text(rule.format(order), encoding="utf-8")
    swing = PrescribedMotion(link="a", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    tilted = flexible("b", mount=Mount(rpy_deg=(40, 0, 0)))
    pairs = {
        "axes": [make_scene(flexible("a", "xyz", lumping=str(file))) for file in files.values()],
        "prescribed joints": [make_scene(flexible("a"), motion=motion) for motion in ((), (swing,))],
        "planes": [make_scene(flexible("a"), other) for other in (flexible("b"), tilted)],
        "number of axes": [make_scene(flexible("a", flex)) for flex in ("z", "yz")],
    }
    for what, scenes in pairs.items():
        one, other = (lump(scene) for scene in scenes)
        assert not one.same_layout(other), what
        assert one.same_layout(one), what
    long, short = (lump(make_scene(flexible("a", length=length))) for length in (2.0, 1.0))
    assert long.same_layout(short)


def test_the_planarity_check_accumulates_successive_mount_rotations() -> None:
    skew, tilted = Mount(rpy_deg=(-75.0, 20.0, 30.0)), Mount(rpy_deg=(0.0, 40.0, 0.0))
    turns = {"in": (0.0, 0.0, 25.0), "over": (180.0, 0.0, 25.0), "out": (-75.0, 20.0, 30.0)}
    for plane, rpy_deg in turns.items():
        second = flexible("b", mount=Mount(rpy_deg=rpy_deg))
        assert lump(make_scene(flexible("a", mount=skew), second)).is_planar == (plane != "out")
    # the first and the third axis are parallel, the one between is not
    there_and_back = flexible("a"), flexible("b", mount=tilted), flexible("c", mount=Mount(rpy_deg=(0.0, -40.0, 0.0)))
    assert not lump(make_scene(*there_and_back)).is_planar


def test_inertia_tensors_are_exactly_symmetric() -> None:
    """R I Rᵀ is symmetric only up to rounding, but files store six numbers."""
    heavy = RigidBody(mass=1.0, center=(0.1, 0.2, 0.3), inertia=(0.3, 0.25, 0.2, 0.03, 0.02, 0.01))
    links = [
        flexible(f"link {k}", mount=Mount(rpy_deg=(10.0 * k, 20.0, 30.0)), joint=Joint(locked=k > 0), end=heavy)
        for k in range(8)
    ]
    for inertia in lump(make_scene(*links)).bodies["inertia"]:
        assert inertia.tolist() == inertia.T.tolist()


def test_mass_and_centre_of_mass_agree_with_the_gravity_potential(rng) -> None:
    """The gravity potential is −m g·p, with the mass m and the position p of the centre of mass."""
    chain = lump(nasty_scene())
    q = rng.uniform(-1, 1, chain.n)
    assert chain.mass == chain.bodies["mass"].sum()
    wanted = -chain.mass * chain.gravity @ chain.com(q)
    assert energy(chain, q, 0 * q).gravity == pytest.approx(wanted, rel=1e-13)
    with refused(ArgumentError, "wrong-shape"):
        chain.com([0.0])
    empty = dataclasses.replace(chain, bodies=_massless(chain))
    with refused(ArgumentError, "no-mass"):
        empty.com(q)


def _massless(chain: Chain) -> np.ndarray:
    bodies = chain.bodies.copy()
    bodies["mass"] = 0.0
    return bodies


def test_variants_lumped_together_equal_variants_lumped_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shared data are computed once, and variants do not affect each other."""
    scene = nasty_scene()
    found = ("is_planar", "axes", "active", "joint_names", "coordinates", "link_names", "_layout", "_sequential")
    for name in found:
        getattr(lump(scene), name)
    for changes in (
        {"tip.mass": 2.0},
        {"tip.mass": 0.0, "tip.inertia": (0.0, 0.0, 0.0)},
        {"tip.center": (0.1, 0.2, 0.0), "gravity": (0.0, 0.0, 0.0)},
        {"material.aluminium.young": 1e9},
        {"material.aluminium.density": 1e3},
        {"material.aluminium.loss_time": 1e-4},
        {"section.square.height": 0.03},
        {"link.fore.damping": {"ratio": 0.1, "at_hz": 3.0}},
        {"link.upper.length": 2.0, "name": "longer"},
        {"initial.joint_deg.hand": -40.0},
        {"initial.joint_deg.upper": -40.0},
        {"link.2.joint.armature": 0.0},
    ):
        variant = scene.varied(changes)
        near = lump(variant)
        with monkeypatch.context() as patch:
            patch.setattr(lumping, "FRAMES", Memo(1))
            patch.setattr(lumping, "CHAINS", Memo(1))
            alone = lump(variant)
        assert near is not alone and near.name == alone.name
        for array in ("bodies", "hinges", "gravity"):
            assert getattr(near, array).tobytes() == getattr(alone, array).tobytes()
            assert not getattr(near, array).flags.writeable
        for name in found:
            assert np.all(getattr(near, name) == getattr(alone, name))


def test_scenes_lumped_together_or_alone_give_the_same_chains() -> None:
    """Chains are bitwise equal, or both scenes are refused with the same message."""
    scene = load_scene(ROOT / "models" / "t3_spatial.toml")
    (name, *_) = scene.arm.materials
    tips = [
        {"mass": 0.0}, {"mass": 2.0},
        {"mass": 1.0, "center": [0.1, 0.2, 0.0], "inertia": [0.3, 0.3, 0.3, 0.1, 0.0, 0.0]},
        {"mass": 1e200, "center": [1e100, 0.0, 0.0]}, {"inertia": [0.1, 0.0, 0.0]},
    ]  # fmt: skip
    stiff = [{"young": 7e10}, {"young": 1e11, "loss_time": 1e-5}, {"young": 1e-320}]
    scenes = [
        scene.varied({"tip": tip, f"material.{name}": {"density": density, "poisson": 0.3, **words}})
        for density in (2700.0, 7850.0) for words in stiff for tip in tips
    ]  # fmt: skip
    for one, found in zip(scenes, lump_many(scenes), strict=True):
        try:
            chain = lump(one)
        except fl.FlexlinkError as error:
            assert (type(found), str(found)) == (type(error), str(error))
            continue
        assert isinstance(found, Chain)
        assert found.bodies.tobytes() == chain.bodies.tobytes()
        assert found.hinges.tobytes() == chain.hinges.tobytes()
        assert (found.mass, found.reach, found.coordinates) == (chain.mass, chain.reach, chain.coordinates)


def test_the_position_of_a_locked_slide_is_in_metres() -> None:
    slide = fl.Link(name="slide", length=1.0, joint=fl.Joint(kind="prismatic", axis=(1, 0, 0), locked=True))
    arm = make_scene(slide, fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0))
    chain = fl.lump(arm.varied({"initial.joint_m": (0.3, 0.0)}))
    np.testing.assert_allclose(fl.tip_position(chain, np.zeros(chain.n)), [2.3, 0.0, 0.0], atol=1e-15)
