"""Notes on features that a file format cannot store, the option --strict, and effects of small added masses."""

import re

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.formats import FORMATS
from flexlink.formats.features import PRESENT, texts, unsupported
from flexlink.formats.small_mass import added_inertia, with_small_mass
from tests.conftest import ROOT, flexible, make_scene, nasty_scene
from tests.support.words import refused, refused_line, reviewed

PAPER = str(ROOT / "models" / "paper_fig5.toml")
BARE = make_scene(
    fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)), gravity=(0.0, 0.0, 0.0)
)
COLUMNS = ("times", "angle_deg", "rate_deg", "acceleration_deg")
EXAMPLES = {
    "gravity": BARE.varied({"gravity": (0.0, 0.0, 9.81)}),
    "springs": make_scene(flexible("a"), gravity=(0.0, 0.0, 0.0)),
    "springs between hinges": make_scene(flexible("a", segments=3, lumping="lobatto2"), gravity=(0.0, 0.0, 0.0)),
    "springs of rotation vectors": make_scene(
        flexible("a", "xyz", 3, lumping="gauss_rotation"), gravity=(0.0, 0.0, 0.0)
    ),
    "rotor inertia": BARE.varied({"link.rod.joint.armature": 0.1}),
    "dry friction": BARE.varied({"link.rod.joint.coulomb": 0.1}),
    "elastic gear": BARE.varied({"link.rod.joint.gear_stiffness": 10.0, "link.rod.joint.armature": 0.1}),
    "prescribed motion": BARE.varied(
        {"motion": (fl.PrescribedMotion(link="rod", **dict.fromkeys(COLUMNS, (0.0, 1.0))),)}
    ),
    "drive torques": BARE.varied({"drive": fl.Drive(kind="constant", torque=(1.0,))}),
    "tip wrench": BARE.varied({"wrench": fl.Wrench(force=(1.0, 0.0, 0.0))}),
    "initial state": BARE.varied({"initial.joint_deg.rod": 10.0}),
}


def test_formats_store_an_arm_without_these_features_completely() -> None:
    assert all(unsupported(BARE, fl.lump(BARE), format=format) == {} for format in FORMATS)


@pytest.mark.parametrize("feature", EXAMPLES)
def test_only_the_features_of_an_arm_are_noted(feature: str) -> None:
    scene = EXAMPLES[feature]
    for format in FORMATS:
        missing = unsupported(scene, fl.lump(scene), format=format)
        springs = {name: {"springs"} for name in ("springs between hinges", "springs of rotation vectors")}
        implied = {"elastic gear": {"springs", "rotor inertia"}, **springs}.get(feature, set())
        assert set(missing) == {name for name in {feature, *implied} if format in texts()[name]}


def test_the_angle_of_a_locked_joint_is_part_of_the_arm() -> None:
    links = fl.Link(name="base", joint=fl.Joint(locked=True)), fl.Link(name="rod", length=1.0)
    scene = make_scene(*links, gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(30.0, 0.0)))
    assert unsupported(scene, fl.lump(scene), format="sdf") == {}


@pytest.mark.parametrize("key", ["q", "qd"])
def test_a_complete_state_overrides_initial_angles(key: str) -> None:
    elsewhere = BARE.varied({"initial.joint_deg.rod": 10.0, "initial.q": (0.0,)})
    for scene, noted in ((BARE.varied({f"initial.{key}": (0.1,)}), {"initial state"}), (elsewhere, set())):
        assert set(unsupported(scene, fl.lump(scene), format="urdf")) == noted


def test_an_unknown_format_is_refused() -> None:
    with refused(fl.errors.ArgumentError, "unknown-name"):
        unsupported(BARE, fl.lump(BARE), format="dae")


def test_the_table_of_features_names_known_formats_only() -> None:
    assert all(set(instead) <= set(FORMATS) for instead in texts().values())
    assert [*PRESENT] == [*texts()]


def test_an_export_prints_the_features_that_a_format_cannot_store(tmp_path, capsys) -> None:
    assert main(["export", PAPER, "--format", "urdf", "--out", str(tmp_path)]) == 0
    (note,) = capsys.readouterr().err.splitlines()
    text = note.removesuffix("  [format-cannot-store]")
    assert text != note
    assert text.startswith(f"note: {(tmp_path / 'paper_fig5').with_suffix('.urdf')}: ")
    assert [part for part in ("URDF", "gravity", "springs", "initial state") if part not in text] == []
    reviewed("format-cannot-store", text)


def test_a_strict_export_with_unsupported_features_writes_nothing_and_exits_with_2(tmp_path, capsys) -> None:
    assert main(["export", PAPER, "--strict", "--out", str(tmp_path)]) == 2
    printed = capsys.readouterr().err
    assert len(printed.splitlines()) == 1
    text = refused_line(printed, "not-representable")
    parts = (PAPER, "--strict", "urdf", "gravity, springs, initial state")
    assert [part for part in parts if part not in text] == []
    assert list(tmp_path.iterdir()) == []
    assert main(["export", PAPER, "--strict", "--format", "mjcf", "--out", str(tmp_path)]) == 0


def test_links_without_mass_get_the_given_mass(rng: np.random.Generator) -> None:
    chain = fl.lump(nasty_scene())
    filled = with_small_mass(chain, mass=1e-3)
    assert filled.n == chain.n
    assert len(filled.bodies) == chain.n + 1
    hinged = filled.bodies[:-1]
    heavy = np.isin(np.arange(chain.n), chain.bodies["stop"][chain.bodies["mass"] > 0] - 1)
    assert set(hinged["mass"][~heavy]) == {1e-3}
    assert hinged["mass"][heavy].tolist() == chain.bodies["mass"][chain.bodies["mass"] > 0].tolist()
    q = rng.uniform(-1, 1, chain.n)
    assert fl.tip_position(filled, q) == pytest.approx(fl.tip_position(chain, q), abs=1e-14)


def test_added_inertia_is_the_change_of_the_mass_matrix_and_bounds_frequencies(rng) -> None:
    chain = fl.lump(nasty_scene())
    q, mass = rng.uniform(-1, 1, chain.n), 1e-3
    δ, filled = added_inertia(chain, q, mass=mass), with_small_mass(chain, mass=mass)
    change = np.linalg.solve(fl.mass_matrix(chain, q), fl.mass_matrix(filled, q) - fl.mass_matrix(chain, q))
    assert max(np.linalg.eigvals(change).real) == pytest.approx(δ, rel=1e-8)
    still = fl.Scene.varied(nasty_scene(), {"gravity": (0.0, 0.0, 0.0)})
    chain, held = fl.lump(still), fl.lump(still).active.tolist()
    before, after = (fl.natural_frequencies(one, q, locked=held) for one in (chain, with_small_mass(chain, mass=mass)))
    assert np.all(after <= before * (1 + 1e-12))
    assert np.all(after >= before / np.sqrt(1 + δ) * (1 - 1e-12))
    assert np.any(after < before * (1 - 1e-6))


def test_added_inertia_is_infinite_for_a_joint_without_inertia() -> None:
    chain = fl.lump(make_scene(flexible("upper"), fl.Link(name="wrist")))
    assert added_inertia(chain, np.zeros(chain.n), mass=1e-9) == np.inf


def test_a_body_with_inertia_alone_gets_no_small_mass() -> None:
    rotor, rod = (fl.RigidBody(inertia=(0.1, 0.2, 0.3)), fl.RigidBody(mass=1.0, center=(0.5, 0.0, 0.0)))
    chain = fl.lump(make_scene(fl.Link(name="rotor", hub=rotor), fl.Link(name="rod", hub=rod)))
    M = fl.mass_matrix(chain, [0.0, 0.0])
    assert M[0, 0] == pytest.approx(0.3 + 0.25)
    assert (fl.mass_matrix(with_small_mass(chain, mass=1e-3), [0.0, 0.0]) == M).all()


def test_files_with_small_masses_read_back_and_are_read_by_mujoco(capsys, tmp_path) -> None:
    pytest.importorskip("mujoco")
    chain = with_small_mass(fl.lump(make_scene(flexible("upper"), fl.Link(name="wrist"))), mass=1e-6)
    for format in FORMATS.values():
        if format.read is None:
            continue
        back = format.read(format.write(chain))
        assert back.bodies["mass"].tolist() == chain.bodies["mass"].tolist()
    fl.to_mjcf(chain)


def test_the_command_line_prints_the_effect_of_a_small_mass(tmp_path, capsys) -> None:
    scene = str(ROOT / "models" / "t3_spatial.toml")
    assert main(["export", scene, "--format", "sdf", "--small-mass", "1e-3", "--out", str(tmp_path)]) == 0
    note = capsys.readouterr().err.splitlines()[0]
    assert note.startswith("note: ") and " 0.001 kg" in note
    inertia, frequency = (float(x.replace("−", "-")) for x in re.findall(r"[+−]\d\S*\d", note))
    assert frequency == pytest.approx(1 / np.sqrt(1 + inertia) - 1, rel=0.05)
    reviewed("features: effect of a small mass", note)
    assert main(["export", scene, "--small-mass", "-1", "--out", str(tmp_path)]) == 2
    text = refused_line(capsys.readouterr().err, "out-of-range")
    assert "--small-mass = -1.0: " in text
