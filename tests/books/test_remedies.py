"""Remedies that messages print are applied as printed, and succeed: the mistake is gone."""

import contextlib
import importlib
import io
import re
import shlex
import tempfile
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
import tests.cli.test_from_files as files
from docs.generators.messages import texts
from flexlink.cli.main import main
from flexlink.common.errors import Diagnostic
from flexlink.describe.plausibility.hints import hints
from flexlink.dynamics.notes import defaults, notes
from tests.conftest import ROOT, flexible, make_scene
from tests.describe import test_hints, test_scene

TABLE = tomllib.loads(Path(__file__).with_name("remedies.toml").read_text("utf-8"))
ELSEWHERE = {id: name for name, ids in TABLE["elsewhere"].items() for id in ids.split()}
NONE = [id for ids in TABLE["none"].values() for id in ids.split()]
SLOT = re.compile("«(.*?)»", re.DOTALL)


def test_each_id_has_a_remedy_that_is_applied_or_a_reason_why_it_has_none() -> None:
    stated = [*{row[0] for row in TABLE["applied"]}, *ELSEWHERE, *NONE]
    assert sorted(stated) == sorted(texts())


def test_the_tests_that_apply_other_remedies_are_there() -> None:
    files = [path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py")]
    assert [
        id for id, name in ELSEWHERE.items() if not any(f"def {name}(" in text and id in text for text in files)
    ] == []


def test_no_message_without_a_remedy_prints_a_value_a_key_or_a_command() -> None:
    literal = re.compile(r"(?:set|use|give|add|write|to|with) [\w.']+ = |\(--\w|did you mean")
    assert {id: text for id in NONE for text in texts()[id] if literal.search(text)} == {}


@pytest.mark.parametrize("row", TABLE["applied"], ids=lambda row: row[0])
def test_a_printed_remedy_removes_its_message(row: list[str]) -> None:
    """Provoke a message; read its remedy from the printed text; put it into the slot «…», and expect no message."""
    id, provoking, pattern, *put = row
    for engine in set(re.findall("'(mujoco|pinocchio)'", provoking)):
        pytest.importorskip(engine)
    first = said(SLOT.sub(r"\1", provoking))
    printed = "\n".join(str(each) for each in first if each.id == id)
    found = re.search(pattern, printed)
    assert found, printed or first
    mended = [put[0].format(*found.groups())] if put else found.groups()
    for text in mended:
        assert text or found[1] in SLOT.search(provoking)[1], f"{found[1]} is not what is taken out"
        left = said(SLOT.sub(lambda _, text=text: text, provoking))
        assert not any(isinstance(each, fl.FlexlinkError) or each.id == id for each in left), (text, left)
    assert mended and SLOT.search(provoking)


def said(expression: str) -> list[Any]:
    """Everything with an id that an expression raises, returns, warns of, or prints as a command, in a new folder."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), warnings.catch_warnings(record=True) as all:
        warnings.simplefilter("always")
        try:
            value = eval(expression, {**WORDS, "folder": Path(folder)})
        except fl.FlexlinkError as error:
            return [error]
    lists = [[each.message.args[0] for each in all], value]
    if isinstance(value, fl.Scene):
        lists += [defaults(value), notes(value), hints(value)]
    else:
        lists += [getattr(value, name, ()) for name in ("warnings", "notes", "hints")]
    return [each for found in lists if isinstance(found, list | tuple) for each in found if hasattr(each, "id")]


def command(line: str, **files: str) -> list[Any]:
    """What a command prints to stderr, by id; a refusal is raised. Files are written first; __ in a name is a dot."""
    for name, text in files.items():
        write(name.replace("__", "."), text)
    with contextlib.redirect_stderr(io.StringIO()) as stderr, contextlib.redirect_stdout(io.StringIO()):
        code = main(shlex.split(line))
    found = [Diagnostic(*parts) for parts in re.findall(r"(.*)  \[([a-z0-9-]+)\]$", stderr.getvalue(), re.MULTILINE)]
    if code == 2:
        raise fl.FlexlinkError(found[-1], id=found[-1].id)
    return found


def write(name: str, text: str) -> str:
    """Write a file into the current folder, and return its name."""
    Path(name).write_text(text, encoding="utf-8")
    return name


def robot(joint: str = "", more: str = "", end: str = "") -> str:
    """A URDF file of three links in a row, with more elements in its first and second joint, and at its end."""
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = f'<link name="a"/><link name="b">{body}</link><link name="c">{body}</link>'
    frame = '<origin xyz="1 0 0"/><axis xyz="0 0 1"/>'
    hinge = f'<joint name="{{}}" type="{{}}"><parent link="{{}}"/><child link="{{}}"/>{frame}{{}}</joint>'
    first = hinge.format("j", "continuous", "a", "b", joint)
    return f'<robot name="r">{links}{first}{hinge.format("k", "continuous", "b", "c", more)}{end}</robot>'


def at_start(scene: fl.Scene) -> tuple[fl.Chain, np.ndarray]:
    """The chain of a scene, and its initial angles."""
    return (chain := fl.lump(scene)), fl.initial_state(scene, chain)[0]


def turned(scene: fl.Scene) -> tuple[Any, ...]:
    """The chain of a scene, and its state at rest whose base is turned by 90° about y, without torques."""
    chain, q = at_start(scene)
    return chain, np.where(np.arange(chain.n) == 4, np.radians(90.0 - scene.initial.base.rpy_deg[1]), q), 0 * q, 0 * q


def late(scene: fl.Scene, **fields: Any) -> fl.Scene:
    """A scene with a sensor at a joint."""
    return scene.varied({"sensor": [fl.Sensor(name="s", kind="joint", link=len(scene.arm.links), **fields)]})


def problem(scene: fl.Scene, path: str = "material.aluminium.young", column: str = "tip x [m]", **keys: Any) -> Any:
    """Identify a number from 20 samples of a column."""
    t, more = np.linspace(0.0, 0.1, 20), {key: keys.pop(key) for key in ("use", "set") if key in keys}
    columns = {keys.pop("time", "t [s]"): tuple(t.tolist()), column: tuple(np.cos(t).tolist())}
    run = fl.fits.FitRun(name="fall", columns=columns, **more)
    return fl.fits.FitProblem(scene=scene, parameter=(fl.fits.FitParameter(path=path, **keys),), run=(run,))


def written(folder: Path, table: str, text: str) -> fl.Scene:
    (folder / "run.csv").write_text(text, encoding="utf-8")
    (folder / "scene.toml").write_text(f"{make_scene(*files.LINKS).to_toml()}\n{table}", encoding="utf-8")
    return fl.load_scene(folder / "scene.toml")


ROD = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), gravity=(9.81, 0.0, 0.0))
SOFT = make_scene(flexible("a", "xyz", 2, joint=fl.Joint(locked=True), lumping="midpoint"), gravity=(0.0, 0.0, -60.0))
WORDS = {
    "soft": SOFT.varied({"material.aluminium": fl.Material(young=2e6, density=1000.0)}),
    "falling": make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0)),
    **{name.rpartition(".")[2]: importlib.import_module(name) for name in TABLE["modules"]},
    "fl": fl, "np": np, "flexible": flexible, "make_scene": make_scene, "command": command, "write": write,
    "robot": robot, "at_start": at_start, "turned": turned, "late": late, "problem": problem, "written": written,
    "files": files, "HUB": files.HUB, "CRANE": test_hints.CRANE, "BAR": fl.Section(shape="circle", diameter=0.1),
    "STEEL": test_hints.STEEL, "model": lambda name: fl.load_scene(ROOT / "models" / f"{name}.toml"),
    "paper": fl.load_scene(ROOT / "models" / "paper_fig5.toml"), "rod": ROD,
    "raised": ROD.varied({"initial.joint_deg": [170.0]}), "law": lambda t, q, qd: 0 * q[:2],
    "level": make_scene(flexible("a", "xyz", 3), flexible("b", "z", 3), gravity=(0.0, 0.0, 0.0)),
    "THIRD": '<link name="d"/><joint name="z" type="continuous"><parent link="a"/><child link="d"/></joint>',
    "SWEPT": "set.'run.duration' = 0.01\ngrid.'tip.mass' = [{}]\nquantity.x.of = 'tip x [m]'\n",
}  # fmt: skip


@pytest.mark.parametrize(("mistake", "path", "unit"), test_hints.PLANTED, ids=lambda x: x if isinstance(x, str) else "")
def test_the_value_that_a_hint_prints_removes_it(mistake: dict[str, Any], path: str, unit: str) -> None:
    scene = test_hints.CRANE.varied(mistake)
    (hint,) = hints(scene)
    printed = re.search(r"in SI (\[.*?\]|[-+.\de]+)|in degrees (\[.*\])|would be ([\d.]+)|rate is ([\d.]+)", hint)
    if printed is None or "\n" in hint:
        pytest.skip("names another key, or only the unit")
    value = tomllib.loads(f"x = {next(filter(None, printed.groups())).replace('e+', 'e')}")["x"]
    mended = scene.varied(of_parts(scene, path, value))
    assert [each for each in hints(mended) if each.startswith(f"{path} = ")] == []


def of_parts(scene: fl.Scene, path: str, value: Any) -> dict[str, Any]:
    """The change of a path whose last part may be a list that the hint prints as one number."""
    if path.startswith("uncertain."):  # its keys are paths
        return {"uncertain": {**scene.uncertain, path.removeprefix("uncertain."): value}}
    (before,) = scene.values_at(path.partition("[")[0])
    if "[" in path or (isinstance(before, list) and not isinstance(value, list)):
        return {path.partition("[")[0]: [item * 1e-3 for item in before] if "[" in path else [value] * len(before)}
    tube = {"section.tube.inner": scene.arm.sections["tube"].inner * 1e-3} if path == "section.tube.outer" else {}
    return {path: value, **tube}


SUGGESTED = [what for what, (*_, id, parts) in test_scene.BAD.items() if "'?" in str(parts) and id != "unknown-link"]


@pytest.mark.parametrize("what", SUGGESTED)
def test_a_suggested_name_makes_the_scene_right(what: str, tmp_path: Path) -> None:
    old, new, *_ = test_scene.BAD[what]
    path = tmp_path / "scene.toml"
    path.write_text(test_scene.PAPER.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(fl.FlexlinkError) as caught:
        fl.load_scene(path)
    suggested = re.search(r"did you mean '(\w+)'\?", str(caught.value))
    (wrong,) = re.findall(r"(?:\.|: )(\w+) = [^:]*: unknown key|= '(\w+)'", str(caught.value))[:1]
    changed = new.replace(wrong[0] or wrong[1], suggested[1])
    path.write_text(test_scene.PAPER.replace(old, changed, 1), encoding="utf-8")
    fl.load_scene(path)


@pytest.mark.parametrize("beyond", [3e-6, 8e-3])
def test_noise_at_a_stop_passes_with_a_warning_of_the_run(beyond: float) -> None:
    cart = fl.Link(name="cart", joint=fl.Joint(kind="prismatic", limits_m=(0.0, 8.0)), hub=files.HUB)
    move = fl.PrescribedMotion(link="cart", times=(0.0,), position_m=(-beyond,), rate_m=(0.0,), acceleration_m=(0.0,))
    run = fl.simulate(make_scene(cart, motion=(move,), initial=fl.InitialState(joint_m=(-beyond,))), duration=0.01)
    (warning,) = run.warnings
    assert warning.id.endswith("past-limits")


def test_every_key_of_a_file_with_two_letters_exchanged_is_put_right_by_the_suggestion(tmp_path: Path) -> None:
    text = (ROOT / "models" / "t3_spatial.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    keys = {key for key in re.findall(r"^(\w{4,})\s*=", text, re.MULTILINE) if key[1] != key[2]}
    assert len(keys) > 15
    for key in keys:
        path.write_text(text.replace(key, key[0] + key[2] + key[1] + key[3:]), encoding="utf-8")
        with pytest.raises(fl.errors.SceneError) as caught:
            fl.load_scene(path)
        suggested = re.search(r"did you mean '(\w+)'", str(caught.value))
        assert suggested[1] == key
