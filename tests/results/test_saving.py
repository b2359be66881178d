"""Saved objects are loaded bit-equal, with all their properties."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.linear_model import LinearModel
from flexlink.dynamics.vibration.modal import Modes
from flexlink.errors import ArgumentError, DataFileError
from tests.conftest import nasty_scene
from tests.support.words import refused


@pytest.fixture(scope="module")
def run() -> fl.Trajectory:
    scene = nasty_scene().varied({"wrench": fl.Wrench(force=(1.0, 2.0, 3.0), frame="tip")})
    return fl.simulate(scene, step=1e-5, sample=1e-4, duration=1e-3, unstable="allow")


def assert_equal(one: fl.Trajectory, other: fl.Trajectory) -> None:
    for name in ("t", "q", "qd", "tau", "tip", "tip_wrench", "work", "qdd", "imbalance", "exchanged"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), strict=True)
    for whole, again in ((one.energy, other.energy), (one.loads, other.loads)):
        for name in vars(whole):
            np.testing.assert_array_equal(getattr(whole, name), getattr(again, name), strict=True)
    for name in ("warnings", "steps", "scene"):
        assert getattr(one, name) == getattr(other, name)
    for field in dataclasses.fields(one.chain):
        assert np.array_equal(getattr(one.chain, field.name), getattr(other.chain, field.name)), field.name


def test_a_saved_run_is_loaded_unchanged(run: fl.Trajectory, tmp_path: Path) -> None:
    again = fl.load_trajectory(run.save(tmp_path / "run.npz"))
    assert_equal(run, again)
    assert again.chain.bodies.dtype is run.chain.bodies.dtype
    assert repr(again) == repr(run)
    assert not again.q.flags.writeable
    assert list(again.columns) == list(run.columns)
    t, q, qd = again.state(-1)
    assert fl.simulate(again.scene, q0=q, qd0=qd, t0=t, duration=2e-4).t[0] == run.t[-1]
    assert_equal(again, fl.load_trajectory(again.save(tmp_path / "again.npz")))


def test_a_run_without_scene_work_and_steps_can_be_loaded(run: fl.Trajectory, tmp_path: Path) -> None:
    bare = fl.Trajectory(run.chain, run.t, run.q, run.qd, run.tau, run.tip, run.energy)
    again = fl.load_trajectory(str(bare.save(tmp_path / "run.npz")))
    assert (again.work, again.steps, again.scene, again.warnings) == (None, None, None, ())
    np.testing.assert_array_equal(again.q, run.q)


def test_a_saved_scene_loads_equal_and_a_missing_folder_is_refused(tmp_path: Path) -> None:
    scene = nasty_scene()
    assert fl.load_scene(scene.save(tmp_path / "scene.toml")) == scene
    with refused(fl.errors.OutputError, "cannot-write"):
        scene.save(tmp_path / "no" / "scene.toml")


def test_modes_linear_models_and_equilibria_are_saved_and_loaded(run: fl.Trajectory, tmp_path: Path) -> None:
    chain, path = run.chain, tmp_path / "result.npz"
    rest = fl.solve_static(chain, locked=chain.active)
    for whole in (fl.modes(chain, rest.q, locked=chain.active), rest, fl.linearize(chain, rest.q)):
        again = type(whole).load(whole.save(path))
        assert repr(again) == repr(whole)
        for name, value in vars(whole).items():
            assert type(getattr(again, name)) is type(value)
            np.testing.assert_array_equal(getattr(again, name), value)


@pytest.mark.parametrize("load", [fl.load_trajectory, Modes.load, LinearModel.load, Equilibrium.load])
def test_files_with_other_contents_are_refused_in_one_line(load, run: fl.Trajectory, tmp_path: Path) -> None:
    strange, text, one, old = (tmp_path / f"{name}.npz" for name in ("strange", "text", "one", "old"))
    np.savez(strange, a=np.zeros(3))
    text.write_text("no archive", encoding="utf-8")
    with one.open("wb") as file:
        np.save(file, np.zeros(3))
    np.savez(old, **{**dict(np.load(run.save(tmp_path / "run.npz"))), "chain_bodies": np.zeros(3)})
    for path in (strange, text, one, old, tmp_path / "none.npz", tmp_path):
        named = tmp_path if path is tmp_path else path
        with pytest.raises((DataFileError, ArgumentError)) as caught:
            load(named)
        assert str(named) in str(caught.value)
        assert "\n" not in str(caught.value)
    with refused(ArgumentError, "unknown-format"):
        load("run.csv")
    with refused(ArgumentError, "wrong-type"):
        load(5)
