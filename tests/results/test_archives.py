"""Damaged archives of runs are refused with one line that names the mistake, before anything is computed."""

import io
import json
import os
import random
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

import flexlink as fl
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.result import read_archive, write_archive
from flexlink.dynamics.vibration.linear_model import LinearModel
from flexlink.dynamics.vibration.modal import Modes
from flexlink.errors import ArgumentError, DataFileError
from tests.conftest import ROOT, flexible, make_scene, nasty_scene
from tests.support.words import refused

Arrays = dict[str, Any]
TREE = flexible("a", segments=3), flexible("b", segments=5, lumping="lobatto4"), flexible("c", on="a")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    """The arrays of an archived run of a tree with coupled springs."""
    scene = make_scene(*TREE, gravity=(0.0, -9.81, 0.0))
    run = fl.simulate(scene, method="Radau5", step=1e-3, duration=3e-3, sample=1e-3)
    with np.load(run.save(tmp_path_factory.mktemp("whole") / "run.npz")) as archive:
        return dict(archive)


def put(name: str, value: object, field: str = "", row: int = 0) -> Callable[[Arrays], object]:
    """An edit that replaces one number of an array."""

    def change(arrays: Arrays) -> None:
        array = arrays[name] = arrays[name].copy()
        (array[field] if field else array)[row] = value

    return change


WRONG: dict[str, tuple[Callable[[Arrays], object], str]] = {
    "fewer samples": (lambda a: a.update(q=a["q"][:3]), r"q has shape \(3, \d+\); expected \(4, \d+\)"),
    "more joints": (lambda a: a.update(tau=np.zeros((4, 99))), r"tau has shape \(4, 99\)"),
    "no samples": (lambda a: a.update(t=np.array(1.0)), r"t has shape \(\); expected \(0,\)"),
    "nan": (put("qd", np.nan), "qd has numbers that are not finite"),
    "inf": (put("tip", np.inf), "tip has numbers that are not finite"),
    "texts": (lambda a: a.update(t=np.array(["0", "1", "2", "3"])), "t is of type <U1; expected float64"),
    "whole numbers": (lambda a: a.update(work=np.zeros(4, int)), "work is of type int64"),
    "time": (lambda a: a.update(t=a["t"][::-1].copy()), "t does not increase"),
    "missing": (lambda a: a.pop("kinetic"), "kinetic is missing"),
    "steps": (lambda a: a.update(steps=json.dumps(["RK4", "many", 1])), r"Expected `int`"),
    "gravity": (lambda a: a.update(chain_gravity=np.zeros(4)), "gravity is not three finite numbers"),
    "mass": (put("chain_bodies", np.nan, "mass"), "bodies have a mass that is not finite"),
    "hinges elsewhere": (put("chain_bodies", 10**9, "stop", -1), "bodies do not belong together"),
    "parent elsewhere": (put("chain_bodies", 10**9, "parent", -1), "bodies do not belong together"),
    "parent below": (put("chain_bodies", -1, "parent"), "bodies do not belong together"),
    "slot elsewhere": (put("chain_bodies", 10**6, "slot", -1), "bodies do not belong together"),
    "axis": (put("chain_hinges", 17, "axis"), "bodies do not belong together"),
    "coupling elsewhere": (put("chain_couplings", 10**9, "outer"), "couplings do not belong together"),
    "coordinates": (lambda a: a.update(chain_coordinates=a["chain_coordinates"][1:]), "coordinates are not those"),
    "axes": (put("chain_described", np.nan, "section"), "axes have a section that is not finite"),
    "axes of fewer bodies": (lambda a: a.update(chain_described=a["chain_described"][1:]), "bodies do not belong"),
    "no such axis": (lambda a: a.update(chain_coordinates=a["chain_coordinates"] + [0, 0, 40]), "coordinates do not"),
    "no axis at all": (lambda a: a.update(chain_coordinates=a["chain_coordinates"] + 0.5), "coordinates do not"),
    "tip elsewhere": (lambda a: a.update(chain_tips=np.array([[0, 10**9]])), "bodies do not belong together"),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_damaged_archive_is_refused_in_one_line(mistake: str, whole: Arrays, tmp_path: Path) -> None:
    change, _message = WRONG[mistake]
    arrays = dict(whole)
    np.savez(tmp_path / "good.npz", **arrays)
    assert fl.Trajectory.load(tmp_path / "good.npz").t.shape == (4,)
    change(arrays)
    np.savez(tmp_path / "run.npz", **arrays)
    with refused(DataFileError, "not-a-result") as error:
        fl.Trajectory.load(tmp_path / "run.npz")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("count", [10**11, 10**15, 10**30])
def test_an_archive_header_with_too_large_a_shape_is_refused(count: int, whole: Arrays, tmp_path: Path) -> None:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (count,)})
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        archive.writestr("t.npy", head.getvalue() + bytes(80))
    with refused(DataFileError, "not-a-result"):
        fl.Trajectory.load(tmp_path / "run.npz")


def damaged(content: bytes, seed: int) -> bytes:
    """Bytes changed, removed, inserted or set to zero, anywhere or in a record of the archive's own."""
    pick, data = random.Random(seed), bytearray(content)
    records = [k for k in range(len(data) - 46) if data[k : k + 2] == b"PK"]
    at = pick.choice(records) + pick.randrange(46) if seed % 2 else pick.randrange(len(data))
    with_bytes = [bytes([data[at] ^ 1 << pick.randrange(8)]), b"", bytes(16), pick.randbytes(3)]
    data[at : at + pick.choice((1, 1, 16))] = pick.choice(with_bytes)
    return bytes(data)


def test_no_damage_of_bytes_gives_wrong_numbers_or_another_error(whole: Arrays, tmp_path: Path) -> None:
    """Damaged compressed data, an unknown compression and an encryption flag are all met by these seeds."""
    path = tmp_path / "run.npz"
    np.savez_compressed(path, **whole)
    content, good, right = path.read_bytes(), fl.Trajectory.load(path), 0
    for seed in range(300):
        path.write_bytes(damaged(content, seed))
        try:
            run = fl.Trajectory.load(path)
        except DataFileError as error:
            right += error.id == "not-a-result"
        else:
            right += all(np.array_equal(getattr(run, name), getattr(good, name)) for name in ("t", "q", "tip"))
    assert right == 300


def test_a_checksum_is_compared_even_if_the_header_declares_fewer_numbers(tmp_path: Path) -> None:
    file = io.BytesIO()
    np.save(file, np.arange(12.0))
    with zipfile.ZipFile(tmp_path / "few.npz", "w") as archive:
        archive.writestr("t.npy", file.getvalue().replace(b"(12,)", b"(1,) "))
    with refused(DataFileError, "not-a-result"):
        fl.Trajectory.load(tmp_path / "few.npz")


def test_a_text_that_is_no_text_is_refused(whole: Arrays, tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", **whole | {"scene": np.frombuffer(b"\xff\xff\xff\x7f", "<U1").reshape(())})
    with pytest.raises(DataFileError) as caught:  # Python's words vary
        fl.Trajectory.load(tmp_path / "run.npz")
    assert caught.value.id == "not-a-result"


def test_an_archive_that_is_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    with refused(DataFileError, "cannot-read"):
        fl.Trajectory.load(tmp_path / "pipe.npz")


def test_an_archive_that_unfolds_a_thousandfold_is_refused_before(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "abc":
            archive.writestr(f"{name}.npy", bytes(80_000_000))
    with refused(DataFileError, "file-too-large"):
        fl.Trajectory.load(tmp_path / "bomb.npz")


@pytest.mark.slow
def test_a_result_of_equal_numbers_is_no_bomb(tmp_path: Path) -> None:
    still = np.zeros((26_000_000, 1))
    write_archive(tmp_path / "still.npz", {"q": still})
    assert np.array_equal(read_archive(tmp_path / "still.npz")["q"], still)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["satellite", "dual_arm", "gantry"])
def test_archives_of_free_bases_trees_and_sliding_joints_load(model: str, tmp_path: Path) -> None:
    scene = fl.load_scene(ROOT / "models" / f"{model}.toml")
    run = fl.simulate(scene, duration=2 * scene.run.spacing)
    assert np.array_equal(fl.Trajectory.load(run.save(tmp_path / "run.npz")).q, run.q)
    with np.load(tmp_path / "run.npz") as archive:  # version 1.0 stored no axes of links and sections
        np.savez(tmp_path / "older.npz", **{name: archive[name] for name in archive if name != "chain_described"})
    assert np.array_equal(fl.Trajectory.load(tmp_path / "older.npz").loads.moment, run.loads.moment)


@pytest.fixture(scope="module")
def run() -> fl.Trajectory:
    scene = nasty_scene().varied({"wrench": fl.Wrench(force=(1.0, 2.0, 3.0), frame="tip")})
    return fl.simulate(scene, step=1e-5, sample=1e-4, duration=1e-3, unstable="allow")


def test_a_run_without_scene_work_and_steps_can_be_loaded(run: fl.Trajectory, tmp_path: Path) -> None:
    bare = fl.Trajectory(run.chain, run.t, run.q, run.qd, run.tau, run.tip, run.energy)
    again = fl.Trajectory.load(str(bare.save(tmp_path / "run.npz")))
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


@pytest.mark.parametrize("load", [fl.Trajectory.load, Modes.load, LinearModel.load, Equilibrium.load])
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


SCENE = make_scene(flexible("arm", segments=3), run=fl.RunSettings(step=1e-4, duration=0.0))
OLDER_BODIES = {"parent", "begins", "slot", "fork", "loaded"}


def test_a_trajectory_built_without_a_wrench_has_an_empty_wrench_array() -> None:
    run = fl.simulate(SCENE)
    bare = fl.Trajectory(run.chain, run.t, run.q, run.qd, run.tau, run.tip, run.energy)
    assert bare.tip_wrench.shape == (0, 6)


def test_archives_older_than_branched_arms_apply_the_wrench_to_the_last_body(tmp_path: Path) -> None:
    arm = make_scene(flexible("a", segments=3), flexible("b", segments=3), wrench=fl.Wrench(force=(0.0, 1.0, 0.0)))
    run = fl.simulate(arm, step=1e-5, sample=1e-5, duration=3e-5)
    arrays = dict(np.load(run.save(tmp_path / "run.npz")))
    bodies = arrays["chain_bodies"]
    names = [name for name in bodies.dtype.names if name not in OLDER_BODIES]
    arrays["chain_bodies"] = np.array(bodies[names].tolist(), [(name, bodies.dtype[name]) for name in names])
    np.savez(tmp_path / "older.npz", **{name: each for name, each in arrays.items() if name != "chain_tips"})
    again = fl.Trajectory.load(tmp_path / "older.npz").chain
    np.testing.assert_array_equal(again.bodies, run.chain.bodies)
    q, qd = run.q[-1], run.qd[-1]
    wrench = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    one, other = (fl.bias_torque(chain, q, qd, tip_wrench=wrench) for chain in (run.chain, again))
    np.testing.assert_array_equal(other, one)


def test_a_file_for_matlab_has_the_matrices_and_the_named_columns(tmp_path: Path) -> None:
    run = fl.simulate(make_scene(*TREE), method="Radau5", step=1e-3, duration=3e-3, sample=1e-3)
    found = loadmat(run.save(tmp_path / "run.mat"))
    for name in ("q", "qd", "tau", "tip"):
        assert np.array_equal(found[name], getattr(run, name))
    assert [str(name[0]) for name in found["names"][0]] == list(run.columns)
    assert np.array_equal(found["columns"], np.column_stack([*run.columns.values()]))


def test_an_hdf5_file_has_the_dataset_with_its_units(tmp_path: Path) -> None:
    xarray, h5py = pytest.importorskip("xarray"), pytest.importorskip("h5py")
    run = fl.simulate(make_scene(*TREE), method="Radau5", step=1e-3, duration=3e-3, sample=1e-3)
    with xarray.open_dataset(run.save(tmp_path / "run.nc"), engine="h5netcdf") as found:
        assert found.equals(run.to_xarray())
    with h5py.File(tmp_path / "run.nc") as found:
        assert np.array_equal(found["q"], run.q)
        assert found["q"].attrs["units"] == "rad"
