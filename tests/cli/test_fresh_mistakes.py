"""Mistakes of new users: options without effect, arguments of other kinds, names of results, units of cylinders."""

from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.plausibility.hints import hints
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
