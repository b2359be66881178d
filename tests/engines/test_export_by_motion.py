"""Export of features that other tests do not cover: full inertias, massless wheels, steps near the limit."""

from __future__ import annotations

import dataclasses
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.engines import load
from tests.conftest import flexible, make_scene, nasty_scene


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_engines_read_products_of_inertia_in_the_right_order(engine: str, rng: np.random.Generator) -> None:
    pytest.importorskip(engine)
    chain = fl.lump(nasty_scene())
    bodies = chain.bodies.copy()
    B = rng.normal(size=(len(bodies), 3, 3))
    S = 0.1 * B @ B.transpose(0, 2, 1)  # ∫ x xᵀ dm; moments derived from it meet the triangle inequality
    full = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S
    heavy = bodies["mass"] > 0
    bodies["inertia"][heavy] = full[heavy]
    chain = dataclasses.replace(chain, bodies=bodies)
    q, qd = rng.uniform(-1, 1, (2, chain.n))
    other, M = load(engine, chain), fl.mass_matrix(chain, q)
    assert other.mass_matrix(q) == pytest.approx(M, rel=0, abs=1e-12 * np.abs(M).max())
    wanted = fl.bias_torque(chain, q, qd)
    assert other.bias_torque(q, qd) == pytest.approx(wanted, rel=0, abs=1e-12 * np.abs(wanted).max())


def test_pinocchio_reads_a_wheel_without_mass() -> None:
    pytest.importorskip("pinocchio")
    links = fl.Link(name="a", length=0.5, hub=fl.RigidBody(inertia=(0.1, 0.2, 0.3))), fl.Link(name="b", length=0.5)
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))))
    q = np.array([0.3, 0.7])
    M = fl.mass_matrix(chain, q)
    assert load("pinocchio", chain).mass_matrix(q) == pytest.approx(M, rel=0, abs=rounding.of_mass_matrix(chain, q))


def test_the_time_step_of_an_mjcf_file_is_at_most_half_the_largest_stable_one() -> None:
    for segments in (3, 5, 9):
        chain = fl.lump(make_scene(flexible("a", segments=segments), flexible("b", "xyz", segments)))
        option = ET.fromstring(fl.to_mjcf(chain)).find("option")
        assert option is not None
        limit = fl.stable_step(chain, np.linspace(0.1, 0.4, chain.n), method="RK4")
        assert 0.2 * limit < float(option.get("timestep", "nan")) <= 0.5 * limit


def test_mujoco_does_not_reset_a_diverged_run(tmp_path, monkeypatch) -> None:
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log file to the working folder
    chain = fl.lump(make_scene(flexible("a")))
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))
    data = mujoco.MjData(model)
    data.qvel[:] = 1e9  # after a step the speed exceeds 1e10, the limit at which MuJoCo resets a run
    for _ in range(5):
        mujoco.mj_step(model, data)
    assert data.time == pytest.approx(5 * model.opt.timestep)  # no reset, which would set the time to 0
