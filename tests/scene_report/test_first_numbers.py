"""Numbers at the top of a report (sag, frequencies, holding torques, stress), and which modes are resolved."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.pages.numbers import JOIN
from flexlink.results.pictures.stress import peak_stress
from flexlink.results.resolved_modes import resolved
from flexlink.scene_report import building
from flexlink.scene_report.parts import loads, statics, vibration
from flexlink.scene_report.report import report
from flexlink.scene_report.study import Study
from tests.conftest import ALUMINIUM, SQUARE, flexible, make_scene
from tests.support.words import reviewed

LENGTH, LOAD, G = 1.25, 2.0, 9.81


@pytest.fixture
def cantilever() -> fl.Scene:
    """A horizontal beam with a load at its tip, kept at rest by a stiff drive."""
    beam = flexible("beam", segments=17, lumping="gauss", length=LENGTH)
    drive = fl.Drive(kind="pd", kp=(1e7,), kd=(1e4,), target_deg=(0.0,), gravity="static")
    at_rest = fl.InitialState(joint_deg=(0.0,), passive="static")
    scene = make_scene(beam, gravity=(0.0, -G, 0.0), tip=fl.RigidBody(mass=LOAD), drive=drive, initial=at_rest)
    return scene.varied({"run": {"duration": 0.02, "sample": 0.01, "tolerance": 1e-6}})


def root_moment() -> float:
    """Moment of the beam's weight and the load at the root [N m]."""
    return G * LENGTH * (LOAD + ALUMINIUM.density * SQUARE.properties.area * LENGTH / 2)


def test_the_largest_bending_stress_of_a_cantilever_is_at_its_root(cantilever: fl.Scene) -> None:
    found = peak_stress(fl.simulate(cantilever))
    assert found is not None
    assert SQUARE.height is not None
    expected = root_moment() * SQUARE.height / 2 / SQUARE.properties.i_z
    assert found.pascals == pytest.approx(expected, rel=2e-3), "the sag shortens the lever arm a little"
    assert (found.link, found.along, found.rectangle) == ("beam", 0.0, False)


def test_a_rigid_arm_and_its_report_have_no_bending_stress() -> None:
    rigid = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0)).varied({"run.duration": 0.01})
    assert peak_stress(fl.simulate(rigid)) is None
    assert loads.made(Study(rigid)).facts == ()


def test_sag_frequencies_and_holding_torques_agree_with_formulas_and_modes(cantilever: fl.Scene) -> None:
    study = Study(cantilever)
    sag, held = statics.made(study).facts
    ei = ALUMINIUM.young * SQUARE.properties.i_z
    per_metre = G * ALUMINIUM.density * SQUARE.properties.area
    expected = G * LOAD * LENGTH**3 / (3 * ei) + per_metre * LENGTH**4 / (8 * ei)
    assert float(sag.value.partition(" ")[0]) == pytest.approx(1e3 * expected, rel=5e-3)
    assert float(held.value.partition(" ")[0]) == pytest.approx(root_moment(), rel=5e-3)
    assert "beam" in held.label
    part = vibration.made(study)
    assert part is not None
    (frequencies,) = part.facts
    hertz = [float(value) for value in frequencies.value.removesuffix(" Hz").split("; ")]
    found = fl.modes(study.chain, study.rest.q, locked=study.chain.active.tolist())
    assert hertz == [pytest.approx(f, rel=5e-3) for f in found.hertz[:2]]


@pytest.mark.slow
def test_the_page_begins_with_the_main_numbers_and_their_units(
    cantilever: fl.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = ("statics", "vibration", "loads", "energy")
    monkeypatch.setattr(building, "CHAPTERS", {name: building.CHAPTERS[name] for name in kept})
    page = report(cantilever, tmp_path).page.read_text(encoding="utf-8")
    values = re.findall(r'<p class="value">(.*?)</p>', page)
    assert [value.replace(JOIN, " ").split(" ", 1)[1].rpartition("; ")[2].split(" ")[-1] for value in values] == [
        "mm", "m", "Hz", "MPa",
    ]  # fmt: skip
    assert page.index('class="facts"') < page.index('class="verdicts"')


@pytest.mark.parametrize("rule", ["gauss", "midpoint"])
@pytest.mark.parametrize("segments", [3, 5, 9])
def test_at_most_half_of_the_modes_are_resolved_and_have_converged_frequencies(
    models: Path, rule: str, segments: int
) -> None:
    scene = fl.load_scene(models / "three_links.toml")

    def found(count: int) -> tuple[fl.Modes, fl.Chain]:
        chain = fl.lump(scene.varied({"link.*.segments": count, "link.*.lumping": rule}))
        return fl.modes(chain, locked=chain.active.tolist()), chain

    modes, chain = found(segments)
    truth, _ = found(4 * (segments - 1) + 1)
    fine = np.array(resolved(modes, chain))
    assert 1 <= fine.sum() <= np.count_nonzero(chain.stiffness) / 2
    few = np.flatnonzero(fine[:10])
    assert np.abs(modes.hertz[few] / truth.hertz[few] - 1).max() < 0.05
    assert not fine[-1], "the fastest mode is never resolved"


def test_pendulum_modes_count_as_resolved(models: Path) -> None:
    chain = fl.lump(fl.load_scene(models / "three_links.toml").varied({"link.*.segments": 3}))
    modes = fl.modes(chain, fl.solve_static(chain, locked=chain.active.tolist()).q)
    assert "pendulum" in modes.kinds
    assert all(fine for fine, kind in zip(resolved(modes, chain), modes.kinds, strict=True) if kind != "elastic")


def test_pictures_mark_the_modes_that_the_hinges_do_not_resolve(models: Path) -> None:
    scene = fl.load_scene(models / "three_links.toml").varied({"link.*.segments": 3})
    chain = fl.lump(scene)
    modes = fl.modes(chain, locked=chain.active.tolist())
    fine = resolved(modes, chain)
    figure = modes.plot(chain, count=4)
    for k, axes in enumerate(figure.axes[:4]):
        assert axes.get_title().endswith(" Hz") is fine[k]
        reviewed("first numbers: title of a mode", axes.get_title())
        assert axes.lines[-1].get_linestyle() == ("-" if fine[k] else "--")
    part = vibration.made(Study(scene))
    assert part is not None
    first = rf"(?<![\d.]){1 + fine.index(False)}(?!\.?\d)"
    (text,) = (text for text in part.sentences if re.search(first, text))
    reviewed("first numbers: modes not resolved", text)
