"""Wrong input gives one line with file, key, value and allowed values, exit code 2, and writes nothing."""

import copy
import functools
import io
import operator
import os
import pickle
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.scene import scene_from
from tests.conftest import ROOT, flexible, make_scene
from tests.support.words import refused, reviewed

Edit = Callable[[dict], object]
T3_FILE = ROOT / "models" / "t3_spatial.toml"
T3 = tomllib.loads(T3_FILE.read_text(encoding="utf-8"))
RK4 = tomllib.loads((ROOT / "flexlink" / "describe" / "data" / "methods" / "RK4.toml").read_text(encoding="utf-8"))


def write(path: Path, edit: Edit = lambda _: None) -> str:
    """Write a scene file: the spatial arm with edits."""
    raw = copy.deepcopy(T3)
    edit(raw)
    path.write_text(tomli_w.dumps(raw), encoding="utf-8")
    return str(path)


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The first line of the error message; each further mistake has its own line."""
    assert main(arguments) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(("compiling", "warning"))]
    assert all(line.startswith("  also: ") for line in lines[1:])
    return lines[0]


def massless(raw: dict) -> None:
    raw["link"] = [{"name": link["name"]} for link in raw["link"]]
    del raw["tip"]


def coaxial(raw: dict) -> None:
    raw["link"][:2] = [{"name": "waist"}, {"name": "upper"}]


def static(raw: dict) -> None:
    raw["initial"]["passive"], raw["gravity"] = "static", [1e308] * 3


def joint(**fields: float) -> Edit:
    return lambda raw: raw["link"][1].update(joint=fields)


def drive(**fields: object) -> Edit:
    return lambda raw: raw.update(drive={"kind": "table", **fields})


STEEP = {"times": [0.0, 5e-324, 1.0], "torques": [[0.0] * 3, [1e308] * 3, [0.0] * 3]}
JUMP = {"link": "waist", "times": [0.0, 1e-200], "angle_deg": [30.0, 31.0], "rate_deg": [40.0, 0.0],
        "acceleration_deg": [0.0, 0.0]}  # fmt: skip


@pytest.mark.parametrize(
    ("commands", "edit", "named", "id"),
    [
        ("info simulate modes", massless, "joint 'waist'", "joint-without-inertia"),
        ("info simulate modes", coaxial, "joint 'upper'", "joint-without-inertia"),
        ("info simulate modes", lambda raw: raw["link"][1].update(length=1e300), "", "overflow"),
        ("info simulate modes", lambda raw: raw["link"][1]["mount"].update(xyz=[1e308, 0.0, 0.0]), "", "overflow"),
        ("info simulate modes", lambda raw: raw["tip"].update(mass=1e308), "", "overflow"),
        ("info simulate modes", static, "|gravity[0]| = 1e+308", "overflow"),
        ("simulate", drive(**STEEP), "", "overflow"),
        ("simulate", drive(**STEEP, smooth=True), "", "overflow"),
        ("simulate", lambda raw: raw.update(motion=[JUMP]), "", "overflow"),
        ("modes", joint(viscous=1e308), "overflow float64", "overflow"),
    ],
)
def test_the_refusal_of_an_arm_that_cannot_be_computed_names_file_and_joint(
    commands: str, edit: Edit, named: str, id: str, tmp_path: Path, capsys
) -> None:
    path = write(tmp_path / "scene.toml", edit)
    for command in commands.split():
        line = refusal([command, path], capsys)
        assert line.startswith(f"flexlink: {path}: ")
        assert named in line and line.endswith(f"[{id}]")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("gravity = " + "[" * 5000 + "]" * 5000, "not TOML"),
        ("gravity = [1" + "0" * 5000 + ", 0, 0]", "not TOML"),
        ("a" + ".a" * 5000 + " = 1", "unknown key"),
        ("name = 'a'\nlink = [{name = 'b'}]\ninitial" + ".a" * 5000 + " = 1", "nested"),
        ("name = 'a'\nname = 'b'", "not TOML"),
        ("name = 'a'\nlink = [1]\ninitial = {joint_deg = [0]}", "link.1 = 1"),
    ],
    ids=["arrays", "digits", "unknown", "known", "twice", "no table"],
)
def test_text_that_parsers_cannot_handle_is_refused(text: str, wanted: str, tmp_path: Path, capsys) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    line = refusal(["info", str(path)], capsys)
    assert line.startswith(f"flexlink: {path}: ")
    assert wanted in line
    assert len(line) < 400


ODD = ["a.toml", -1, 0, 1e308, 5e-324, [1e200] * 3, {"a": 1}]
"""Values of every type; each key accepts some of them."""


def places(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The paths of all keys and items in a parsed file."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*path, key)
        yield from places(item, (*path, key))


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("odd", ODD, ids=str)
def test_any_value_of_any_key_is_accepted_or_refused_in_one_line(odd: object) -> None:
    refused = 0
    for *above, last in places(T3):
        raw = copy.deepcopy(T3)
        functools.reduce(operator.getitem, above, raw)[last] = odd
        try:
            scene = scene_from(raw)
            fl.lump(scene)
            assert scene_from(tomllib.loads(scene.to_toml())) == scene
        except (fl.errors.SceneError, fl.errors.DataFileError) as error:
            refused += 1
            assert "\n" not in str(error)
            assert len(str(error)) < 400
    assert refused > 30


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs a device that never ends")
def test_a_device_file_as_scene_is_refused_at_once(capsys) -> None:
    assert refusal(["info", "/dev/zero"], capsys).endswith("[cannot-read]")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_named_pipe_without_a_writer_is_refused_at_once(tmp_path: Path, capsys) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    for command in (["info"], ["import"], ["sweep"], ["fit"], ["compare", str(T3_FILE), "--file"]):
        assert refusal([*command, str(pipe)], capsys).endswith("[cannot-read]")
    path = write(tmp_path / "scene.toml", lambda raw: raw["link"][1].update(lumping="pipe.toml"))
    assert refusal(["info", path], capsys).endswith("[cannot-read]")


@pytest.mark.parametrize(
    "change", ["gravity.x=1e308", "material.aluminium.young=1e308", "material.aluminium.density=1e-300"]
)
def test_no_command_ends_in_a_traceback_beyond_float64(change: str, capsys) -> None:
    scene = [str(ROOT / "models" / "paper_fig5.toml"), "--set", change, "--set", "run.duration=0.01"]
    assert {main([command, *scene]) for command in ("info", "simulate", "modes")} <= {0, 2}


def test_a_file_whose_counts_multiply_is_refused_before_mujoco_unfolds_it(tmp_path: Path, capsys) -> None:
    begin, end, id = '<replicate count="{}">' * 2, "</replicate>" * 2, "[file-too-large]"
    for counts in (("1e4", "1e4"), ("100 100", "40")):
        body = begin.format(*counts) + '<body><joint/><geom size="1"/></body>' + end
        (tmp_path / "bomb.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>", encoding="utf-8")
        command = ["compare", str(T3_FILE), "--file", str(tmp_path / "bomb.xml")]
        assert refusal(command, capsys).endswith(id)


METHOD, RULE = "tableau", "lumping rule"
NAMED: dict[str, Edit] = {
    METHOD: lambda raw: raw["run"].update(method="own.toml"),
    RULE: lambda raw: raw["link"][1].update(lumping="rule.toml"),
}
WHOLE = {METHOD: RK4, RULE: {"about": "wrong", "source": "here"}}


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (METHOD, {"A": [["1/2"], ["1/2"], ["0", "1/2"], ["0", "0", "1"]]}),
        (METHOD, {"A": [], "b": [], "c": []}),
        (METHOD, {"b": ["a", "1/3", "1/3", "1/3"]}),
        (METHOD, {"b": ["1/0", "1/3", "1/3", "1/3"]}),
        (METHOD, {"b": ["1e999999999", "1/3", "1/3", "1/3"]}),
        (METHOD, {"b": ["1e400", "-1e400", "1/2", "1/2"]}),
        (RULE, {"element": {"nodes": [0.5], "weights": [2.0]}}),
        (RULE, {"jacobi": {"tip": 1e5}}),
        (RULE, {}),
        (RULE, {"cells": {"hinges": 7, "tip": 4.0}}),
    ],
)
def test_the_refusal_of_a_wrong_method_or_rule_names_key_and_file(kind: str, fields: dict, tmp_path, capsys) -> None:
    own = tmp_path / ("own.toml" if kind == METHOD else "rule.toml")
    own.write_text(tomli_w.dumps(WHOLE[kind] | fields), encoding="utf-8")

    path = write(tmp_path / "scene.toml", NAMED[kind])
    line = refusal(["info", path], capsys)
    assert line.startswith(f"flexlink: {path}: {'run.method = ' if kind == METHOD else 'link.'}")
    assert line.count(f": {own}: ") == 1
    reviewed(f"bad input: {kind}", line)


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "--plot", "a.foo"],
        ["simulate", "--plot", "a"],
        ["simulate", "--plot", "no/a.png"],
        ["simulate", "--out", "folder.npz"],
        ["simulate", "--duration", "1e9"],
        ["simulate", "--duration", "4e13"],
        ["modes", "--count", "0"],
        ["loop", "--count", "-1"],
        ["modes", "--plot", "a.foo"],
        ["compare", "--seed", "-1"],
    ],
)
def test_impossible_commands_are_refused_before_they_start(arguments: list[str], tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    scene = write(tmp_path / "scene.toml", lambda raw: raw["run"].update(step=0.005))
    reviewed("bad input: options", refusal([arguments[0], scene, *arguments[1:]], capsys))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "scene.toml"]


def test_scenes_whose_exports_would_overwrite_each_other_are_refused(tmp_path: Path, capsys) -> None:
    paths = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        paths.append(write(tmp_path / folder / "arm.toml"))
    assert refusal(["export", *paths, "--out", str(tmp_path)], capsys).endswith("[would-overwrite]")
    assert not list(tmp_path.glob("arm*"))


def test_a_wrong_option_is_answered_in_one_line(capsys) -> None:
    for arguments in (["foo"], ["simulate", "a.toml", "--step", "abc"], ["export", "a.toml", "--format", "sdformat"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.slow
def test_commands_work_on_a_terminal_that_cannot_encode_a_character(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "flexlink", "simulate", write(tmp_path / "a.toml"), "--duration", "0.005"]
    env = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert r"\xd7 real time" in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_no_samples_are_lost_if_the_standard_output_device_is_full(tmp_path: Path) -> None:
    out = tmp_path / "run.npz"
    command = [sys.executable, "-m", "flexlink", "simulate", write(tmp_path / "a.toml"), "--duration", "0.005"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*command, "--out", str(out)], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert np.load(out)["q"].shape == (2, 21)


def test_quotes_in_names_stay_inside_their_csv_column(tmp_path: Path) -> None:
    scene = make_scene(flexible('a "b", c', segments=2))
    path = fl.simulate(scene, duration=0.0).save(tmp_path / "run.csv")
    header = np.loadtxt(io.StringIO(path.read_text(encoding="utf-8")), str, delimiter=",", quotechar='"', max_rows=1)
    assert header[1] == 'q a "b", c [rad]'


def test_python_descriptions_accept_lists_dicts_and_numpy_arrays() -> None:
    link = fl.Link(name="a", joint={"viscous": 1}, mount=fl.Mount(xyz=np.ones(3)))
    assert link == fl.Link(name="a", joint=fl.Joint(viscous=1.0), mount=fl.Mount(xyz=(1.0, 1.0, 1.0)))
    scene = make_scene(link, gravity=np.array([0.0, 0.0, 9.81]), initial=fl.InitialState(joint_deg=[1]))
    assert scene.gravity == (0.0, 0.0, 9.81)
    assert scene.initial.joint_deg == (1.0,)
    with refused(fl.errors.SceneError, "wrong-value"):
        fl.Link(name="a", joint={"viscous": -1})


@pytest.mark.parametrize(
    ("make", "wanted"),
    [
        (fl.RunSettings, {"dt": 1e-3}),
        (lambda **odd: fl.simulate(fl.load_scene(T3_FILE), **odd), {"t_end": 2.0}),
        (fl.Section, {"thickness": 0.01}),
        (fl.Reference, {"to": (1.0,)}),
        (fl.Link, {"length": 1.0}),
    ],
)  # fmt: skip
def test_unknown_and_missing_arguments_in_python_are_explained_as_in_a_file(make: Edit, wanted: dict) -> None:
    with refused(fl.FlexlinkError, "missing-key" if "length" in wanted else "unknown-key"):
        make(**wanted)


def test_a_part_of_a_scene_cannot_be_changed_in_place() -> None:
    scene = fl.load_scene(T3_FILE)
    with refused(fl.errors.ArgumentError, "unchangeable"):
        scene.arm.tip.mass = 3.0


@pytest.mark.parametrize("clone", [lambda c: pickle.loads(pickle.dumps(c)), copy.copy, copy.deepcopy])
def test_copies_of_a_chain_stay_read_only(clone: Callable[[fl.Chain], fl.Chain], models) -> None:
    """Numba treats writable arrays as another type: a worker process would recompile everything."""
    chain = fl.lump(fl.load_scene(models / "t3_spatial.toml"))
    twin = clone(chain)
    bodies, hinges, gravity, rare = twin.as_full().arrays
    assert not any(array.flags.writeable for array in (bodies, hinges, gravity, *rare))
    np.testing.assert_array_equal(fl.mass_matrix(twin, np.ones(twin.n)), fl.mass_matrix(chain, np.ones(chain.n)))


@pytest.mark.parametrize(
    "wrong", [[[0.0], [0.0, 1.0]], np.zeros((2, 11)), np.zeros((2, 10), bool), np.full((2, 10), np.nan)]
)
@pytest.mark.parametrize("place", range(3))
def test_a_wrong_batch_argument_is_named(wrong: object, place: int, models) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    states: list = [np.zeros((2, 10))] * 3
    states[place] = wrong
    with pytest.raises(fl.errors.ArgumentError, match=r"q|qd|tau"):
        fl.forward_dynamics(chain, *states)


def test_methods_that_are_not_strings_are_refused(models) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.mass_matrix(chain, np.zeros(10), algorithm=[])  # type: ignore[arg-type]
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.stable_step(chain, method=5)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("program", ["reports", "validation"])
def test_programs_without_their_packages_report_what_to_install(program: str) -> None:
    code = f"import sys, runpy; sys.modules['jinja2'] = sys.modules['rich'] = None; runpy.run_module('{program}')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install" in done.stderr
    assert len(done.stderr.splitlines()) == 1
