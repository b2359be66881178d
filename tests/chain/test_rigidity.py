"""Stepped and tapered beams with tables of rigidity and mass agree with closed forms; invalid tables are refused."""

import functools
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import flexlink as fl
from flexlink.chain.lumping import lump_many
from flexlink.cli.main import main
from flexlink.errors import SceneError
from tests.conftest import make_scene
from tests.support.words import refused, refused_line

STEP = 0.37  # position [m] at which a beam of 1 m becomes ten times as soft
STEPPED = fl.Rigidity(x=(0.0, STEP, STEP, 1.0), ei_z=(50.0, 50.0, 5.0, 5.0), rho_a=(2.0, 2.0, 0.6, 0.6))
EVERY_RULE = (
    "gauss", "gauss_matched", "gauss_rotation", "legendre", "gregory", "lobatto2", "lobatto2_rotation", "lobatto4",
    "midpoint", "open", "paper", "hencky", "clamped",
)  # fmt: skip


def beam(table: fl.Rigidity, rule: str = "gauss", hinges: int = 16, **fields: object) -> fl.Scene:
    """A clamped beam with this table, without gravity."""
    usual = {"flex": "z", "length": table.x[-1], "joint": fl.Joint(locked=True)}
    link = fl.Link(name="spar", lumping=rule, segments=hinges + 1, rigidity="spar", **{**usual, **fields})
    return fl.Scene(name="spar", arm=fl.Arm(links=(link,), rigidities={"spar": table}), gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("rule", EVERY_RULE)
def test_a_rigidity_table_with_the_values_of_one_section_equals_that_section(rule: str) -> None:
    material, section = (
        fl.Material(young=70e9, density=2700.0, poisson=0.3),
        fl.Section(shape="tube", outer=0.05, inner=0.04),
    )
    area, i_y, i_z, torsion = section.properties
    table = fl.Rigidity(
        x=(0.0, 0.3, 1.5), rho_a=(2700 * area,) * 3, ei_y=(70e9 * i_y,) * 3, ei_z=(70e9 * i_z,) * 3,
        gj=(material.shear * torsion,) * 3, rho_i_y=(2700 * i_y,) * 3, rho_i_z=(2700 * i_z,) * 3,
    )  # fmt: skip
    links = fl.Link(
        name="spar", length=1.5, flex="xyz", segments=9, lumping=rule, material="m", section="s",
        joint=fl.Joint(locked=True),
    )  # fmt: skip
    plain = fl.Arm(links=(links,), materials={"m": material}, sections={"s": section})
    ours = fl.lump(beam(table, rule, 8, flex="xyz"))
    theirs = fl.lump(fl.Scene(name="spar", arm=plain, gravity=(0.0, 0.0, 0.0)))
    for field in ("stiffness", "damping", "armature"):
        np.testing.assert_allclose(ours.hinges[field], theirs.hinges[field], rtol=1e-11, atol=1e-18)
    np.testing.assert_allclose(ours.couplings["stiffness"], theirs.couplings["stiffness"], rtol=1e-11)
    for field in ("mass", "center", "inertia", "translation"):
        np.testing.assert_allclose(ours.bodies[field], theirs.bodies[field], rtol=1e-11, atol=1e-15)


@functools.cache
def stepped_frequencies(pieces: tuple[tuple[float, float, float], ...], most: float) -> np.ndarray:
    """ω up to `most` of a clamped beam of uniform pieces (length, EI, ρA): y = (v, v', M, V), y' = A y."""

    def condition(ω: float) -> float:
        T = np.eye(4)
        for length, EI, rho_a in pieces:
            A = np.zeros((4, 4))
            A[0, 1] = A[2, 3] = 1.0
            A[1, 2], A[3, 0] = 1 / EI, rho_a * ω**2
            T = expm(A * length) @ T
        return float(np.linalg.det(T[2:, 2:]))

    grid = np.linspace(0.1, most, 60)
    return np.array(
        [brentq(condition, a, b, xtol=1e-12) for a, b in itertools.pairwise(grid) if condition(a) * condition(b) < 0]
    )


@pytest.mark.parametrize(
    ("rule", "limit"),
    [("gauss", 4e-4), ("legendre", 1e-4), ("lobatto2", 2e-3), ("lobatto4", 5e-4), ("midpoint", 2e-3), ("hencky", 4e-3)],
)
def test_a_stepped_beam_has_the_frequencies_of_its_transfer_matrices(rule: str, limit: float) -> None:
    exact = stepped_frequencies(((STEP, 50.0, 2.0), (1 - STEP, 5.0, 0.6)), 120.0)
    found = fl.natural_frequencies(fl.lump(beam(STEPPED, rule, 24)))[: len(exact)]
    assert len(exact) == 2
    np.testing.assert_allclose(found, exact, rtol=limit)


def test_the_sag_of_a_stepped_beam_is_exact_if_the_rule_integrates_its_moment() -> None:
    """δ = ∫ F (L − x)²/EI dx is exact for a linear moment, for any variation of EI within an element or a cell."""
    force = 1e-7
    sag = force * ((1 - (1 - STEP) ** 3) / (3 * 50.0) + (1 - STEP) ** 3 / (3 * 5.0))
    for rule, limit in (
        ("lobatto2", 1e-12),
        ("lobatto4", 1e-12),
        ("legendre", 1e-12),
        ("gauss", 2e-4),
        ("midpoint", 1e-3),
    ):
        chain = fl.lump(beam(STEPPED, rule))
        q = fl.solve_static(chain, tip_wrench=[0, force, 0, 0, 0, 0]).q
        assert fl.tip_position(chain, q)[1] == pytest.approx(sag, rel=limit), rule


def test_springs_of_every_table_are_positive_and_sum_to_its_compliance(rng: np.random.Generator) -> None:
    """Σ 1/k = ∫ dx/EI for tables with jumps by factors of up to a thousand at any place."""
    for rule, _ in itertools.product(("gauss", "midpoint", "legendre"), range(10)):
        inner = np.sort(rng.uniform(0.0, 1.0, 3)).repeat(2)
        EI = 10 ** rng.uniform(-1.5, 1.5, 8)
        x = np.concatenate([[0.0], inner, [1.0]])
        table = fl.Rigidity(x=x, ei_z=EI, rho_a=10 ** rng.uniform(-1, 1, 8))
        k = fl.lump(beam(table, rule, 8)).stiffness
        assert (k > 0).all()
        linear = zip(x, x[1:], EI, EI[1:], strict=False)
        whole = sum((b - a) * np.log(d / c) / (d - c) for a, b, c, d in linear if b > a)
        assert (1 / k).sum() == pytest.approx(whole, rel=1e-10)


@pytest.mark.parametrize("rule", ["gauss", "midpoint", "lobatto2", "lobatto4"])
def test_mass_centre_and_inertia_follow_from_the_table(rule: str) -> None:
    """The inertia about the root is ∫ ρA x² dx + ∫ ρI dx, for columns that are piecewise linear with jumps."""
    table = fl.Rigidity(x=(0.0, 0.4, 0.4, 1.0), ei_z=(9.0, 8.0, 7.0, 6.0), rho_a=(1.0, 2.0, 1.0, 0.5),
                        rho_i_z=(1e-3, 2e-3, 2e-3, 2e-3))  # fmt: skip
    chain = fl.lump(beam(table, rule, 16, joint=fl.Joint()))
    p = np.polynomial.Polynomial
    parts = [(p([1.0, 2.5]), 0.0, 0.4), (p([1 + 0.4 / 1.2, -0.5 / 0.6]), 0.4, 1.0)]

    def moment(power: int) -> float:
        integrals = [((part * p([0, 1]) ** power).integ(), a, b) for part, a, b in parts]
        return float(sum(P(b) - P(a) for P, a, b in integrals))

    assert chain.mass == pytest.approx(moment(0), rel=1e-13)
    limit = 1e-3 if "lobatto" in rule else 1e-12  # cells have their masses at Lobatto points
    assert chain.com(np.zeros(chain.n))[0] == pytest.approx(moment(1) / moment(0), rel=limit)
    about = fl.mass_matrix(chain, np.zeros(chain.n))[0, 0]
    assert about == pytest.approx(moment(2) + 0.4 * 1.5e-3 + 0.6 * 2e-3, rel=limit)


def test_a_linear_table_vibrates_like_a_tapered_link_and_converges_with_order_4() -> None:
    wide = fl.Section(shape="general", area=2.0, i_y=5e-6, i_z=5e-6, torsion=1e-5)
    slim = fl.Section(shape="general", area=0.5, i_y=1e-6, i_z=1e-6, torsion=2e-6)
    link = fl.Link(
        name="spar", length=1.0, flex="z", segments=49, lumping="lobatto4", material="m", section="wide",
        section_tip="slim", joint=fl.Joint(locked=True),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"m": fl.Material(young=1e7, density=1.0)}, sections={"wide": wide, "slim": slim}
    )
    exact = fl.natural_frequencies(fl.lump(fl.Scene(name="taper", arm=arm, gravity=(0.0, 0.0, 0.0))))[:2]
    table = fl.Rigidity(x=(0.0, 1.0), ei_z=(50.0, 10.0), rho_a=(2.0, 0.5), rho_i_z=(5e-6, 1e-6))
    errors = [np.abs(fl.natural_frequencies(fl.lump(beam(table, "gauss", n)))[:2] / exact - 1).max() for n in (6, 12)]
    assert errors[1] < errors[0] / 10
    assert errors[1] < 1e-4


@pytest.mark.parametrize("rule", ["gauss", "gregory", "lobatto2", "lobatto4"])
def test_a_gauge_on_a_stepped_beam_reads_the_moment_over_the_rigidity_of_its_section(rule: str) -> None:
    force, scene = 1e-6, beam(STEPPED, rule, 12)
    chain = fl.lump(scene)
    q = fl.solve_static(chain, tip_wrench=[0, force, 0, 0, 0, 0]).q
    gauge = fl.strength.beam_strain(scene, q, link="spar", fibre=(0.01, 0.0))
    wanted = -0.01 * force * (1 - gauge.x) / np.where(gauge.x < STEP, 50.0, 5.0)
    np.testing.assert_allclose(gauge.strain, wanted, rtol=1e-9)


@pytest.mark.parametrize("rule", ["gauss", "midpoint", "lobatto4", "gregory"])
def test_a_gauge_between_hinges_reads_the_moment_over_the_local_rigidity(rule: str) -> None:
    """On both sides of a step, and on a taper with a kink: M of a tip force is linear, so interpolation is exact."""
    tapered = fl.Rigidity(x=(0.0, 0.5, 1.0), ei_z=(50.0, 40.0, 5.0), rho_a=(1.0, 1.0, 1.0))
    for table in (STEPPED, tapered):
        places = [0.02, 0.3, STEP - 0.005, STEP + 0.005, 0.52, 0.97]
        gauges = [fl.Sensor(name=f"{x}", kind="strain", link="spar", x=x, fibre=(0.01, 0.0)) for x in places]
        scene = beam(table, rule).varied({"sensor": gauges, "wrench.force": (0.0, 1e-6, 0.0), "run.duration": 0.0})
        run = fl.simulate(scene.varied({"initial.passive": "static"}))
        for x in places:
            EI = np.interp(x, table.x, table.ei_z)
            assert run.columns[f"{x} [1]"][0] == pytest.approx(-0.01 * 1e-6 * (1 - x) / EI, rel=1e-6)


def test_a_gauge_at_a_jump_of_rigidity_is_refused_without_a_side() -> None:
    def gauge(x: float) -> dict[str, object]:
        return {"sensor": [fl.Sensor(name="g", kind="strain", link="spar", x=x, fibre=(0.01, 0.0))]}

    with refused(SceneError, "gauge-on-jump"):
        beam(STEPPED).varied(gauge(STEP))
    beam(STEPPED).varied(gauge(0.371))
    heavier = fl.Rigidity(x=STEPPED.x, ei_z=(50.0, 50.0, 50.0, 5.0), rho_a=STEPPED.rho_a)
    beam(heavier).varied(gauge(STEP))  # ρA jumps there, and EI does not
    even = {"x": STEPPED.x, "ei_y": (50.0,) * 4, "ei_z": (50.0,) * 4, "rho_a": STEPPED.rho_a}
    skew = fl.Rigidity(**even, k_yz=(1.0, 1.0, 2.0, 2.0))
    with refused(SceneError, "gauge-on-jump"):
        beam(skew, flex="yz").varied(gauge(STEP))
    beam(skew).varied(gauge(STEP))  # a link that bends about z alone ignores it


def test_the_factor_of_a_table_can_be_varied() -> None:
    scene = beam(STEPPED)
    paths = "rigidity.spar.stiffness_factor", "rigidity.spar.mass_factor"
    plain, stiff, heavy = (fl.lump(each) for each in (scene, *(scene.varied({path: 4.0}) for path in paths)))
    ω = fl.natural_frequencies(plain)
    np.testing.assert_allclose(fl.natural_frequencies(stiff), 2 * ω, rtol=1e-12)
    np.testing.assert_allclose(fl.natural_frequencies(heavy), ω / 2, rtol=1e-12)
    many = lump_many(
        [scene, scene.varied({paths[0]: 4.0}), scene.varied({"link.spar.damping": fl.Damping(ratio=0.1, at_hz=1.0)})]
    )
    np.testing.assert_array_equal(many[1].hinges, stiff.hinges)
    loaded = scene.varied(
        {"wrench.force": (0.0, 1e-3, 0.0), "run": fl.RunSettings(duration=0.1, step=2e-4, sample=0.1)}
    )
    slope = fl.sensitivities(loaded, [paths[0]]).tip[-1, 1, 0]
    runs = [fl.simulate(loaded.varied({paths[0]: 1 + d})).tip[-1, 1] for d in (-1e-3, 1e-3)]
    assert slope == pytest.approx((runs[1] - runs[0]) / 2e-3, rel=1e-4)


def test_damping_of_a_table_follows_its_loss_time_or_the_damping_of_the_link() -> None:
    lossy = fl.Rigidity(x=STEPPED.x, ei_z=STEPPED.ei_z, rho_a=STEPPED.rho_a, loss_time=1e-3)
    found = fl.modes(fl.lump(beam(lossy)), count=2)
    np.testing.assert_allclose(found.damping_ratios, 1e-3 * found.frequencies / 2, rtol=1e-9)
    specified = fl.modes(fl.lump(beam(lossy, damping=fl.Damping(ratio=0.02, at_hz=found.hertz[0]))), count=1)
    assert specified.damping_ratios[0] == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize(
    ("fields", "id"),
    [
        ({"x": (0.1, 1.0)}, "rigidity-table"),
        ({"x": (0.0,), "rho_a": (1.0,)}, "rigidity-table"),
        ({"x": (0.0, 0.5, 0.4, 1.0), "rho_a": (1.0,) * 4}, "rigidity-table"),
        ({"x": (0.0, 0.5, 0.5, 0.5, 1.0), "rho_a": (1.0,) * 5}, "rigidity-table"),
        ({"x": (0.0, 0.0, 1.0), "rho_a": (1.0,) * 3}, "rigidity-table"),
        ({"x": (0.0, 1.0, 1.0), "rho_a": (1.0,) * 3}, "rigidity-table"),
        ({"ei_z": (1.0,)}, "one-per-row"),
        ({"ei_z": (1.0, 0.0)}, "wrong-value"),
        ({"rho_a": (1.0, -1.0)}, "wrong-value"),
    ],
)
def test_an_impossible_table_is_refused(fields: dict[str, object], id: str) -> None:
    with refused(SceneError, id):
        fl.Rigidity(**{"x": (0.0, 1.0), "rho_a": (1.0, 1.0), **fields})


def test_a_table_that_does_not_fit_its_link_is_refused() -> None:
    for fields, id, parts in (
        ({"flex": "yz"}, "rigidity-table", ("link.spar.rigidity = 'spar'", "ei_y", "flex = 'yz'")),
        ({"flex": "xyz"}, "rigidity-table", ("gj", "flex = 'xyz'", "rho_i_y", "rho_i_z")),
        ({"length": 1.1}, "rigidity-table", ("1.0 m", "1.1 m")),
        ({"material": "m", "section": "s"}, "both-given", ("rigidity = 'spar'", "material = 'm'")),
    ):
        with refused(SceneError, id) as caught:
            beam(STEPPED, **fields)
        assert all(part in str(caught.value) for part in parts)
    with refused(SceneError, "unknown-name"):
        make_scene(fl.Link(name="a", length=1.0, rigidity="spar"))


CSV = "x [mm],EI_z [N m²],rhoA [kg/m]\n0,50,2\n370,50,2\n370,5,0.6\n1000,5,0.6\n"
SCENE = """name = "spar"
[rigidity.spar]
file = "spar.csv"
[[link]]
name = "spar"
joint = { locked = true }
length = 1.0
flex = "z"
segments = 17
rigidity = "spar"
"""


def test_a_table_is_read_from_a_csv_file_next_to_the_scene(tmp_path) -> None:
    (tmp_path / "spar.csv").write_text(CSV, encoding="utf-8")
    (tmp_path / "spar.toml").write_text(SCENE, encoding="utf-8")
    scene = fl.load_scene(tmp_path / "spar.toml")
    (tmp_path / "spar.csv").unlink()  # the table was read when the scene was loaded
    assert scene.arm.rigidities["spar"].x == pytest.approx(STEPPED.x, abs=1e-15)
    np.testing.assert_allclose(fl.lump(scene).stiffness, fl.lump(beam(STEPPED)).stiffness, rtol=1e-12)
    stiffer = scene.varied({"rigidity.spar.stiffness_factor": 2.0})
    assert stiffer.arm.rigidities["spar"].ei_z == STEPPED.ei_z


@pytest.mark.parametrize(
    ("text", "id", "parts"),
    [
        (CSV.replace("x [mm]", "x"), "unit-missing", ("column 'x'",)),
        (CSV.replace("[N m²]", "[N m]"), "unit-unknown", ("column 'EI_z [N m]'", "N m²")),
        (CSV.replace("EI_z", "EI"), "unknown-column", ("column 'EI [N m²]'", " x [m], EI_y [N m²]")),
        (CSV.replace(",rhoA [kg/m]", ",rhoI_z [kg m]"), "no-such-column", ("column 'rhoA [kg/m]'",)),
        (CSV.replace("370,5,", "360,5,"), "rigidity-table", ("x[2] = 0.36", "x[1] = 0.37")),
        (CSV.replace("1000", "990"), "rigidity-table", ("x = 0.99 m", " 1.0 m")),
        (CSV.replace("x [mm]", "x [m]"), "rigidity-table", ("x = 1000.0 m", " 1.0 m")),
        (CSV.replace("50,2\n370", "-50,2\n370"), "out-of-range", ("line 2", "ei_z")),
        (CSV.replace("5,0.6", "5,a", 1), "csv-cell", ("line 4, rhoA [kg/m]", "'a'")),
        (CSV.replace("50,2\n370", "50\n370"), "csv-cell", ("line 2: 2 ", " 3")),
        ("", "file-empty", ()),
    ],
)
def test_a_mistake_in_a_csv_file_exits_with_2(text: str, id: str, parts: tuple[str, ...], tmp_path, capsys) -> None:
    (tmp_path / "spar.csv").write_text(text, encoding="utf-8")
    (tmp_path / "spar.toml").write_text(SCENE, encoding="utf-8")
    assert main(["info", str(tmp_path / "spar.toml")]) == 2
    found = refused_line(capsys.readouterr().err, id)
    assert "\n" not in found
    assert all(part in found for part in parts)


def test_a_table_of_rigidities_accepts_millimetres_and_grams(tmp_path: Path) -> None:
    (tmp_path / "spar.csv").write_text("x [mm],EI_z [N mm²],rhoA [g/m]\n0,5e7,2000\n800,4e7,600\n", encoding="utf-8")
    table = fl.Rigidity(file=str(tmp_path / "spar.csv"))
    np.testing.assert_allclose((table.x, table.ei_z, table.rho_a), ((0.0, 0.8), (50.0, 40.0), (2.0, 0.6)), rtol=1e-14)


@pytest.mark.parametrize("row", ["0,50,2\n1,0,2", "0,50,2\n1,50,0"])
def test_a_table_without_rigidity_or_mass_is_refused(row: str, tmp_path: Path) -> None:
    (tmp_path / "spar.csv").write_text(f"x [m],EI_z [N m²],rhoA [kg/m]\n{row}\n", encoding="utf-8")
    with refused(fl.errors.DataFileError, "out-of-range"):
        fl.Rigidity(file=str(tmp_path / "spar.csv"))
