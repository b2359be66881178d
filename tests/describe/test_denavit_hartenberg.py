"""Denavit-Hartenberg tables agree with the matrices in textbooks, and mounts may be given in radians."""

import math

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import ALUMINIUM, SQUARE, make_scene
from tests.support.words import refused

EPS = np.finfo(float).eps
HUB = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
UR5 = [  # a, α, d: the manufacturer's table, standard convention
    (0.0, 90.0, 0.089159), (-0.425, 0.0, 0.0), (-0.39225, 0.0, 0.0), (0.0, 90.0, 0.10915), (0.0, -90.0, 0.09465),
    (0.0, 0.0, 0.0823),
]  # fmt: skip
PUMA = [  # a_{i−1}, α_{i−1}, d: Craig, figure 3.21, modified
    (0.0, 0.0, 0.0), (0.0, -90.0, 0.0), (0.4318, 0.0, 0.1244), (-0.0203, -90.0, 0.4318), (0.0, 90.0, 0.0),
    (0.0, -90.0, 0.0),
]  # fmt: skip


def siciliano(a: float, α: float, d: float, θ: float) -> np.ndarray:
    """Siciliano's matrix A_i^{i−1} (2.52), from the frame before the joint rotates to the frame at the link's end."""
    c, s, ca, sa = math.cos(θ), math.sin(θ), math.cos(α), math.sin(α)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def craig(a: float, α: float, d: float, θ: float) -> np.ndarray:
    """Craig's matrix {}^{i−1}T_i (3.6), with a_{i−1} and α_{i−1}."""
    c, s, ca, sa = math.cos(θ), math.sin(θ), math.cos(α), math.sin(α)
    return np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]])


BOOKS = {"standard": siciliano, "modified": craig}


def links_of(table: list[tuple[float, float, float]], convention: str, offsets, **fields) -> list[fl.Link]:
    return [
        fl.Link(
            name=f"l{k}", hub=HUB, **fields,
            dh=fl.details.DenavitHartenberg(convention=convention, a=a, alpha_deg=α, d=d, theta_deg=offset),
        )
        for k, ((a, α, d), offset) in enumerate(zip(table, offsets, strict=True))
    ]  # fmt: skip


def tip_of(chain: fl.Chain, q: np.ndarray) -> np.ndarray:
    placed = fl.frames(chain, q)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = placed.rotations[-1], placed.points[-1]
    return T


def random_rows(seed: int) -> list[tuple[float, ...]]:
    return np.random.default_rng(seed).uniform((-0.5, -180, -0.5), (0.5, 180, 0.5), (3, 3)).tolist()


TABLES = [(UR5, "standard"), (PUMA, "modified"), *((random_rows(seed), name) for seed in range(20) for name in BOOKS)]


def test_a_dh_table_gives_the_product_of_the_textbook_matrices(rng) -> None:
    for table, convention in TABLES:
        (q, offsets), wanted = rng.uniform(-np.pi, np.pi, (2, len(table))), np.eye(4)
        for (a, α, d), angle, offset in zip(table, q, np.degrees(offsets), strict=True):
            wanted = wanted @ BOOKS[convention](a, math.radians(α), d, angle + math.radians(offset))
        got = tip_of(fl.lump(make_scene(*links_of(table, convention, np.degrees(offsets)))), q)
        np.testing.assert_allclose(got, wanted, rtol=0, atol=20 * EPS)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_beams_do_not_change_the_kinematics_of_a_dh_table(convention, rng) -> None:
    """The joint axes of an undeformed arm with beams are at the positions of the table."""
    beam = {"material": "aluminium", "section": "square", "flex": "yz", "segments": 3}
    table = UR5 if convention == "standard" else PUMA
    bare = fl.lump(make_scene(*links_of(table, convention, np.zeros(6))))
    for place in ({"length": 0.3}, {"line": ((0.1, 0.0, 0.0), (0.2, 0.3, -0.1))}):
        links = links_of(table, convention, np.zeros(6), **beam, **place)
        last = {"standard": {}, "modified": {"line": ((0, 0, 0), (0, 0, 1))}}[convention]
        bent = fl.lump(make_scene(*links[:-1], fl.Link(name="last", hub=HUB, dh=links[-1].dh, **last)))
        q = rng.uniform(-1, 1, 6)
        full = np.zeros(bent.n)
        full[bent.active] = q
        got = tip_of(bent, full)
        if convention == "modified":  # the tip is at the end of the last line, 1 m along its z
            got[:3, 3] -= got[:3, 2]
        np.testing.assert_allclose(got, tip_of(bare, q), rtol=0, atol=40 * EPS)


def test_the_tip_is_at_the_last_standard_frame_or_at_the_end_of_the_last_modified_beam() -> None:
    beam = {"material": "aluminium", "section": "square", "length": 0.3}
    for convention, wanted in (("standard", (0.4, 0.0, 0.5)), ("modified", (0.7, -0.5, 0.0))):
        row = fl.details.DenavitHartenberg(convention=convention, a=0.4, alpha_deg=90, d=0.5)
        chain = fl.lump(make_scene(fl.Link(name="a", dh=row, **beam)))
        np.testing.assert_allclose(fl.tip_position(chain, np.zeros(1)), wanted, rtol=0, atol=8 * EPS)


def test_in_a_standard_dh_row_the_beam_runs_from_the_joint_to_the_link_end() -> None:
    row = fl.details.DenavitHartenberg(convention="standard", a=-0.3, d=0.4, alpha_deg=90)
    link = fl.Link(name="a", dh=row, material="aluminium", section="square")
    assert link.stop == (-0.3, 0.0, 0.4)
    assert link.beam.length == 0.5
    mass = ALUMINIUM.density * SQUARE.properties.area * 0.5
    body = fl.lump(make_scene(link)).bodies[0]
    assert body["mass"] == pytest.approx(mass, rel=1e-14)
    assert body["center"].tolist() == pytest.approx([-0.15, 0.0, 0.2], abs=EPS)


def test_a_mount_in_radians_equals_the_same_mount_in_degrees(rng) -> None:
    angles = tuple(rng.uniform(-3, 3, 3))
    one, other = (
        tip_of(fl.lump(make_scene(fl.Link(name="a", length=1.0, hub=HUB, mount=mount))), np.zeros(1))
        for mount in (fl.Mount(rpy=angles), fl.Mount(rpy_deg=tuple(map(math.degrees, angles))))
    )
    np.testing.assert_allclose(one, other, rtol=0, atol=8 * EPS)


@pytest.mark.parametrize(
    ("build", "wanted"),
    [
        (lambda: fl.Mount(rpy=(1, 0, 0), rpy_deg=(1, 0, 0)), "both-given"),
        (lambda: fl.details.DenavitHartenberg(convention="craig"),
         "wrong-value"),
        (lambda: fl.Link(name="a", joint=fl.Joint(axis=(0, 1, 0)),
                         dh=fl.details.DenavitHartenberg(convention="modified")),
         "dh-axis"),
        (lambda: make_scene(*(fl.Link(name=name, dh=fl.details.DenavitHartenberg(convention=name)) for name in BOOKS)),
         "dh-conventions-differ"),
    ],
)  # fmt: skip
def test_contradictory_or_unknown_dh_parameters_are_refused(build, wanted) -> None:
    with refused(fl.errors.SceneError, wanted):
        build()


def test_masses_and_centres_of_a_published_table_are_entered_as_printed() -> None:
    """The Puma 560 (Corke & Armstrong-Hélouvry 1994): `end` is in frame i; gravity torques of their toolbox at qn."""
    table = [  # a, α, d, then m and r in frame i
        (0.0, 90.0, 0.0, 0.0, (0.0, 0.0, 0.0)), (0.4318, 0.0, 0.0, 17.4, (-0.3638, 0.006, 0.2275)),
        (0.0203, -90.0, 0.15005, 4.8, (-0.0203, -0.0141, 0.070)), (0.0, 90.0, 0.4318, 0.82, (0.0, 0.019, 0.0)),
        (0.0, -90.0, 0.0, 0.34, (0.0, 0.0, 0.0)), (0.0, 0.0, 0.0, 0.09, (0.0, 0.0, 0.032)),
    ]  # fmt: skip
    links = [
        fl.Link(
            name=f"l{k}", end=fl.RigidBody(mass=m, center=r), hub=fl.RigidBody(inertia=(0.0, 0.0, 0.01)),
            dh=fl.details.DenavitHartenberg(convention="standard", a=a, alpha_deg=α, d=d),
        )
        for k, (a, α, d, m, r) in enumerate(table)
    ]  # fmt: skip
    chain = fl.lump(make_scene(*links, gravity=(0.0, 0.0, -9.81)))
    q = np.radians([0, 45, 180, 0, 45, 0])
    assert fl.bias_torque(chain, q, 0 * q) == pytest.approx([0, 31.6399, 6.0351, 0, 0.0283, 0], abs=5e-5)
