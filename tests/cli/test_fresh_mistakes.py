"""Mistakes of new users: options without effect, arguments of other kinds, names of results, units of cylinders."""

import dataclasses
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.chain.arguments import explained
from flexlink.cli.main import main
from flexlink.describe.plausibility.hints import hints
from flexlink.dynamics.notes import notes
from tests.support.words import refused, refused_line, reviewed

SCENE = fl.load_scene("models/paper_fig5.toml")
CYLINDER = {
    "name": "ram", "kind": "cylinder", "link": "upper", "x": 0.5, "to": {"point": (1.0, -0.5, 0.0)}, "length": 0.7,
    "bore": 0.05, "stroke": (0.4, 1.2), "bulk_modulus": 1.2e9,
}  # fmt: skip


def hanging(**oil) -> fl.Scene:
    return SCENE.varied({"tie": ({**CYLINDER, **oil},), "run": fl.RunSettings(duration=0.01)})


@pytest.mark.parametrize(
    "words",
    [
        "export SCENE --slopes", "export SCENE --c arm.c --no-binary", "loop SCENE --kind nyquist",
        "loop SCENE --over drive.kd.upper", "fit SCENE --predict --check", "compare SCENE --duration 1",
    ],
)  # fmt: skip
def test_an_option_without_effect_is_refused(words: str, capsys) -> None:
    given = words.replace("SCENE", "models/paper_fig5.toml").split()
    assert main(given) == 2
    refused_line(capsys.readouterr().err, "no-effect")


@pytest.mark.parametrize("call", [fl.to_c, fl.to_casadi, lambda scene: fl.to_fmu(scene, (0.0, 0.0))])
def test_code_of_a_scene_names_the_chain(call) -> None:
    with refused(fl.errors.ArgumentError, "wrong-type"):
        call(SCENE)


def test_the_state_of_an_fmu_is_q_and_its_rates() -> None:
    chain = fl.lump(SCENE)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        fl.to_fmu(chain, 3)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.to_fmu(chain, np.zeros(chain.n))
    with refused(fl.errors.ArgumentError, "out-of-range"):
        fl.to_fmu(chain, (np.zeros(chain.n),) * 2, duration=-1.0)


@pytest.mark.parametrize("call", [fl.modes, fl.solve_static, fl.to_mjcf, fl.strength.buckling_loads])
def test_ties_are_given_by_the_scene_of_the_chain(call) -> None:
    with refused(fl.errors.ArgumentError, "wrong-type"):
        call(fl.lump(SCENE), ties=True)


def test_ties_of_another_arm_are_refused() -> None:
    other = fl.lump(fl.load_scene("models/two_mass_joint.toml"))
    with refused(fl.errors.ArgumentError, "chains-differ"):
        fl.modes(other, ties=hanging())


def test_numbers_of_cylinders_in_other_units_are_hinted() -> None:
    wrong = hanging(bore=50.0, bulk_modulus=1.2, pressures=(32.0, 5.0))
    found = [hint for hint in hints(wrong) if hint.startswith("tie.ram")]
    assert [hint.partition(" = ")[0].rpartition(".")[2] for hint in found] == ["bore", "bulk_modulus", "pressures"]
    for hint in found:
        reviewed("likely-unit", hint)
    assert not hints(hanging())


def test_lengths_out_of_all_proportion_end_in_an_error() -> None:
    wrong = hanging(stroke=(400.0, 1200.0), length=700.0).varied({"initial.passive": "static"})
    with pytest.raises(fl.FlexlinkError):
        fl.simulate(wrong)


def test_a_wrong_name_of_a_result_names_those_that_there_are() -> None:
    with pytest.raises(KeyError, match=r"tip x \[m\]"):
        fl.simulate(SCENE, duration=0.01).columns["tip x"]


def test_a_wrong_name_of_a_tie_names_those_that_there_are() -> None:
    for result in (fl.solve_static(fl.lump(SCENE), ties=hanging()).tie_forces, fl.simulate(hanging()).pressures):
        with refused(fl.errors.ArgumentError, "unknown-name"):
            result["rm"]


def test_info_refuses_a_run_of_another_arm(tmp_path: Path, capsys) -> None:
    run = fl.simulate(fl.load_scene("models/two_mass_joint.toml"), duration=0.01).save(tmp_path / "run.npz")
    command = "info models/paper_fig5.toml --run"
    assert main([*command.split(), str(run)]) == 2
    refused_line(capsys.readouterr().err.replace(str(run), "run.npz"), "chains-differ")


@pytest.mark.parametrize("changes", [
    {"link.fore.mount.xyz": (1.25, 0.0, 0.0)}, {"initial.rate_deg": (0, 3000, 0)},
], ids=["the length of the link before", "rates in rpm"])  # fmt: skip
def test_numbers_that_repeat_a_length_or_are_too_fast_are_hinted(changes: dict) -> None:
    (hint,) = hints(SCENE.varied(changes))
    reviewed(hint.id, hint)


def test_a_sensor_cannot_replace_a_column_of_the_tip() -> None:
    with refused(fl.errors.SceneError, "sensor-name"):
        fl.Sensor(name="tip x", kind="position", link="fore", axis=(1.0, 0.0, 0.0))


def test_a_scene_in_yaml_is_recognized(tmp_path: Path, capsys) -> None:
    (tmp_path / "crane.toml").write_text("name: crane\n", encoding="utf-8")
    assert main(["info", str(tmp_path / "crane.toml")]) == 2
    refused_line(capsys.readouterr().err.replace(str(tmp_path), ""), "not-toml")


def test_uncertain_paths_need_no_quotes(tmp_path: Path) -> None:
    text = Path("models/paper_fig5.toml").read_text(encoding="utf-8")
    (tmp_path / "scene.toml").write_text(f"{text}\n[uncertain]\nmaterial.aluminium.young = 0.02\n", encoding="utf-8")
    ((path, u),) = fl.load_scene(tmp_path / "scene.toml").uncertain.items()
    assert (path.split("."), u) == (["material", "aluminium", "young"], 0.02)


@pytest.mark.parametrize("call", [
    lambda: fl.simulate(SCENE, 0.2),
    lambda: fl.simulate_many(SCENE, 8),
    lambda: fl.compare(SCENE, SCENE),
    lambda: fl.sweep(SCENE, {"tip.mass": [1.0, 2.0]}),
    lambda: fl.to_urdf(fl.lump(SCENE), "arm.urdf"),
    lambda: fl.fit(SCENE, "data.csv"),
    lambda: fl.advise(SCENE, tips=1e-3),
    lambda: fl.modes(fl.lump(SCENE), n=4),
    lambda: fl.initial_state(fl.lump(SCENE)),
    lambda: fl.Simulator(SCENE).step(0.01, [100.0]),  # type: ignore[arg-type]  a mistake of type as well
    lambda: fl.SimulatorBatch([SCENE]).step(0.01, [100.0]),  # type: ignore[arg-type]
    lambda: fl.to_c(fl.lump(SCENE), "arm.c"),
    lambda: fl.simulate(SCENE, duration=0.01).plot("energy"),  # type: ignore[misc]
    lambda: fl.simulate(SCENE, duration=0.01).animate("film.gif", 12),  # type: ignore[misc]
    lambda: fl.Problem(SCENE).simulate(tip_mass=5.0),  # type: ignore[call-arg]
    lambda: fl.linearize(SCENE),
], ids=["simulate", "many", "compare", "sweep", "urdf", "fit", "advise", "modes", "rest", "step", "batch", "c", "plot",
        "animate", "problem", "scene for chain"])  # fmt: skip
def test_a_call_that_does_not_fit_is_refused_with_what_the_function_takes(call: Callable[[], object]) -> None:
    with refused(fl.errors.ArgumentError, "wrong-arguments"):
        call()


@pytest.mark.parametrize(("call", "id"), [
    (lambda chain: fl.linearize(chain, chain.rest, outputs="tip"), "wrong-type"),
    (lambda chain: fl.linearize(chain, [chain.rest, chain.rest]), "wrong-shape"),
    (lambda chain: fl.jacobian(chain, chain.rest, body="upper"), "not-an-integer"),
    (lambda chain: fl.tip_position(chain, {"upper": 0.3}), "wrong-type"),
    (lambda chain: fl.forward_dynamics(chain, chain.rest, chain.rest, [1.0, 2.0]), "wrong-shape"),
    (lambda _: fl.Simulator(SCENE).step(0.001), "wrong-shape"),
    (lambda _: SCENE.varied({"upper.length": 1.0}), "cannot-set"),
    (lambda _: SCENE.varied({"aluminium.young": 7e10}), "cannot-set"),
    (lambda _: fl.Link(name="a", dh={"a": 0.5}), "missing-key"),
    (lambda _: fl.Material(EX=2e11, DENS=7850.0), "unknown-key"),
])  # fmt: skip
def test_one_name_for_a_list_and_a_run_for_a_state_are_refused_with_what_to_write(call, id: str) -> None:
    with refused(fl.FlexlinkError, id):
        call(fl.lump(SCENE))


def test_columns_of_a_data_frame_are_accepted_as_lists() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"t": [0.0, 1.0], "upper": [1.0, 2.0], "fore": [3.0, 4.0]})
    drive = fl.Drive(kind="table", times=table["t"], torques=table[["upper", "fore"]])
    assert drive == fl.Drive(kind="table", times=(0.0, 1.0), torques=((1.0, 3.0), (2.0, 4.0)))


def test_a_type_error_inside_a_function_is_no_wrong_call() -> None:
    with pytest.raises(TypeError, match="unsupported operand"):
        explained(lambda t: t + "1")(0.0)


def test_public_functions_are_pickled_by_name() -> None:
    assert pickle.loads(pickle.dumps(fl.simulate_many)) is fl.simulate_many


@pytest.mark.parametrize("call", [
    lambda: fl.jacobian(fl.lump(SCENE), fl.lump(SCENE).rest) @ fl.lump(SCENE).rest,
    lambda: fl.compare(fl.simulate(SCENE, duration=0.01)),
], ids=["two matrices", "a run"])  # fmt: skip
def test_a_result_in_place_of_another_object_names_the_field_to_give(call: Callable[[], object]) -> None:
    with refused(fl.errors.ArgumentError, "wrong-type"):
        call()


def test_two_scenes_are_compared_by_an_exported_one(capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["compare", "models/paper_fig5.toml", "models/two_mass_joint.toml"])
    reviewed("two scenes compared", capsys.readouterr().err)


def test_an_inertia_in_the_order_of_urdf_is_hinted() -> None:
    """A body with moments 8, 7 and 4 kg m²: in the wrong order 8, 0.5 and 0.2, with products of 7, 0.1 and 4."""
    light = fl.RigidBody(mass=1.0, inertia=(8e3, 5e2, -2e2, 7e3, 1e2, 4e3))
    with refused(fl.errors.SceneError, "inertia-impossible"):
        fl.lump(SCENE.varied({"tip": light}))
    scene = SCENE.varied({"tip": fl.RigidBody(mass=200.0, inertia=(8.0, 0.5, 0.2, 7.0, 0.1, 4.0))})
    (note,) = (each for each in notes(scene) if each.id == "inertia-of-no-body")
    reviewed(note.id, note)
    mended = scene.varied({"tip.inertia": tuple(json.loads(note[note.rindex("[") :]))})
    assert note.id not in {each.id for each in notes(mended)}


def test_limits_in_radians_that_exclude_the_start_are_given_in_degrees_as_well() -> None:
    with refused(fl.errors.SceneError, "outside-limits"):
        SCENE.varied({"link.fore.joint.limits_deg": (-0.35, 1.05), "initial.joint_deg": (0.0, 0.0, -20.0)})


@pytest.mark.parametrize(("rate", "duration"), [(300.0, 4.0), (700.0, 3.0), (350.0, 2.0)])
def test_the_sample_that_a_sampled_law_suggests_is_accepted(rate: float, duration: float) -> None:
    law = {"kind": "pd", "kp": (0.0, 1.0, 1.0), "kd": (0.0, 1.0, 1.0), "target_deg": (0.0, 0.0, 0.0), "rate": rate}
    run = fl.RunSettings(tolerance=1e-3, duration=duration)
    with pytest.raises(fl.errors.SceneError) as caught:
        SCENE.varied({"drive": law, "run": run})
    sample = float(str(caught.value).partition("give run.sample, such as ")[2])
    assert 0.1 < sample / run.spacing < 10
    SCENE.varied({"drive": law, "run": run, "run.sample": sample})


@pytest.mark.parametrize("times", [1.0, 2 * np.pi])
def test_a_shaper_in_radians_per_second_is_hinted(times: float) -> None:
    chain = fl.lump(SCENE)
    slowest = fl.natural_frequencies(chain, fl.initial_state(SCENE, chain)[0], locked=chain.active)[0] / (2 * np.pi)
    move = fl.Reference(
        profile="trapezoidal", to_deg=(0.0, 10.0, 10.0), max_rate_deg=(30.0,) * 3, max_acceleration_deg=(60.0,) * 3
    )
    shaper = fl.InputShaper(kind="ZV", frequency_hz=(times * slowest,))
    drive = fl.Drive(kind="pd", kp=(0.0, 1e3, 1e3), kd=(0.0, 10.0, 10.0), reference=replace(move, shaper=shaper))
    found = [each for each in notes(SCENE.varied({"drive": drive})) if each.id == "likely-unit"]
    assert len(found) == (times > 1)
    for each in found:
        reviewed(each.id, each)
    rigid = notes(SCENE.varied({"drive": drive, "link.*.flex": "rigid"}))  # nothing bends: no mode to compare with
    assert "likely-unit" not in {each.id for each in rigid}


MISPLACED = {
    "a table of the scene below a link": ("[[link]]", "[[link]]\ndrive = { kind = 'none' }", "unknown-key"),
    "double brackets": ("[section.square]", "[[section]]\nname = 'square'", "wrong-value"),
    "a list in quotes": ("joint_deg = [0.0, -80.0, -10.0]", "joint_deg = '0, -80, -10'", "wrong-value"),
    "a heading in capitals": ("[run]", "[Run]", "unknown-key"),
    "a path with backslashes": ("[run]", '[run]\nmethod = "C:\\users\\rk.toml"', "not-toml"),
    "a matrix of inertia": ("[run]", "[tip]\ninertia = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n[run]", "wrong-value"),
    "a torque on the tip": ("[run]", "[wrench]\ntorque = [0, 0, 1]\n[run]", "unknown-key"),
    "a joint's motion": ("[run]", "[[motion]]\njoint = 'upper'\nangle_deg = 30\n[run]", "unknown-key"),
    "a spring": (
        "[run]",
        "[[tie]]\nname = 'a'\nkind = 'spring'\nfrom = 'fore'\nto = 'world'\nk = 1e4\n[run]",
        "unknown-key",
    ),
    "an IMU": ("[run]", "[[sensor]]\nname = 'a'\nkind = 'imu'\nlink = 'fore'\n[run]", "wrong-value"),
    "an encoder": ("[run]", "[[sensor]]\nname = 'a'\nkind = 'encoder'\nlink = 'fore'\n[run]", "wrong-value"),
    "a load cell": ("[run]", "[[sensor]]\nname = 'a'\nkind = 'load_cell'\nlink = 'fore'\n[run]", "wrong-value"),
}


@pytest.mark.parametrize(("right", "wrong", "id"), MISPLACED.values(), ids=MISPLACED)
def test_a_misplaced_table_or_path_names_its_place_or_form(right: str, wrong: str, id: str, tmp_path: Path) -> None:
    text = Path("models/paper_fig5.toml").read_text(encoding="utf-8")
    assert right in text
    (tmp_path / "scene.toml").write_text(text.replace(right, wrong, 1), encoding="utf-8")
    with refused(fl.errors.SceneError, id):
        fl.load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    "words",
    [
        "modes --lock upper fore SCENE",
        "loop SCENE --over drive.kp.fore --values 1e5,2e5",
        "advise SCENE -o SCENE",
        "report SCENE -o page.html",
        "simulate SCENE -o a.csv -o b.npz",
    ],
)
def test_a_command_that_does_not_fit_names_the_form_that_does(words: str, capsys) -> None:
    try:
        code = main(words.replace("SCENE", "models/paper_fig5.toml").split())
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2
    reviewed("command line: wrong form", capsys.readouterr().err)


@pytest.mark.parametrize("path", ["link[0].length", "link.boom.1.length"])
def test_an_item_of_a_list_and_a_name_with_a_dot_are_written_as_the_message_states(path: str) -> None:
    dotted = SCENE.varied({"link.upper.name": "boom.1"})
    with refused(fl.errors.SceneError, "cannot-set"):
        dotted.varied({path: 1.5})
    mended = dotted.varied({'link."boom.1".length': 1.5, "link.1.length": 0.5})
    assert mended.arm.links[1].length == 1.5


def test_rows_of_a_sweep_are_read_by_name() -> None:
    short = SCENE.varied({"run.duration": 0.0})
    rows = fl.sweep(fl.Sweep(scene=short, grid={"tip.mass": [1.0, 2.0]}, quantity={"z": {"of": "tip z [m]"}}))
    assert rows["tip.mass"] == rows.column("tip.mass") == [1.0, 2.0]
    with refused(fl.errors.ArgumentError, "unknown-name"):
        rows["tip.mas"]


def test_torques_of_many_arms_have_a_row_for_each() -> None:
    arms = fl.SimulatorBatch([SCENE.varied({"run.step": 1e-4})] * 2)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        arms.step([1.0, 2.0])


def test_a_model_sampled_at_a_period_instead_of_a_rate_is_refused() -> None:
    chain = fl.lump(SCENE)
    steady = fl.linearize(chain, fl.solve_static(chain, locked=chain.active).q)
    with refused(fl.errors.ArgumentError, "overflow"), np.errstate(all="ignore"):
        dataclasses.replace(steady, A=steady.A + 1e3 * np.eye(len(steady.A))).sampled(1e-3)


def test_a_property_that_fails_shows_its_own_error() -> None:
    run = fl.simulate(fl.load_scene("models/paper_fig5.toml"), duration=0.0)
    run.scene.arm.materials["aluminium"] = 5
    with pytest.raises(AttributeError, match="int"):
        run.hints  # noqa: B018


def test_a_workbook_in_place_of_a_table_is_named(tmp_path: Path, capsys) -> None:
    (tmp_path / "run.xlsx").write_bytes(b"PK\x03\x04\xff[Content_Types].xml")
    changes = "motion=[{ link = 'upper', file = 'run.xlsx', cutoff = 10.0 }]".replace("run", str(tmp_path / "run"))
    command = "info models/paper_fig5.toml --set"
    assert main([*command.split(), changes]) == 2
    refused_line(capsys.readouterr().err.replace(str(tmp_path), ""), "not-utf8")


def test_a_stored_run_is_no_scene(tmp_path: Path) -> None:
    place = fl.simulate(SCENE, duration=0.0).save(tmp_path / "run.npz")
    with refused(fl.errors.SceneError, "not-utf8", values=False):
        fl.load_scene(place)


def test_the_text_of_a_scene_is_no_path() -> None:
    with refused(fl.errors.ArgumentError, "wrong-type"):
        fl.load_scene('name = "arm"\n[[link]]\nlength = 1.0\n' * 20)


@pytest.mark.parametrize("name", ["links", "link"])
def test_an_attribute_of_a_part_is_named_there_also_by_its_key_in_a_file(name: str) -> None:
    with pytest.raises(AttributeError, match=r"arm\.links$"):
        getattr(SCENE, name)
    assert not hasattr(SCENE, "__array__")


def test_modes_of_locked_joints_end_with_their_own_first_frequency(capsys) -> None:
    command, firsts = ["modes", "models/paper_fig5.toml"], []
    for lock in ([], ["--lock", "upper", "fore"], ["--lock", "upper"]):
        assert main([*command, *lock]) == 0
        firsts.append(capsys.readouterr().out.splitlines()[-1])
    driven, held, one = (float(line.split(" Hz, ")[-2].rpartition(" ")[2]) for line in firsts)
    assert held == pytest.approx(driven, rel=1e-5)  # at rest its weight bends the arm
    assert one > 2 * held  # the forearm swings
    reviewed("cli: first elastic frequency, locked", firsts[2])
