"""The repr of an object fits into one or two lines, however many numbers the object contains."""

import dataclasses
import re

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.schemes.methods import method
from flexlink.diagnosis.quantities import random_states
from flexlink.dynamics.conserved import Energy
from flexlink.results.samples import Steps
from tests.conftest import ALUMINIUM, MODELS, SQUARE, flexible, make_scene, nasty_scene
from tests.support.words import reviewed

NAMES = [f"link{k}" for k in range(30)]
LONG = make_scene(*[flexible(name, segments=9) for name in NAMES])
TABLE = fl.Drive(kind="table", times=np.arange(1000.0), torques=np.ones((1000, 1)))


def shown() -> dict[str, object]:
    scene = nasty_scene()
    chain = fl.lump(scene)
    q, qd = fl.initial_state(scene, chain)
    run = fl.simulate(fl.load_scene(MODELS[0]), duration=0.5)
    comparison = fl.compare(scene, engines=["native"], samples=2)
    kinds = (scene, chain, scene.arm, run, run.energy, fl.energy(chain, q, qd), fl.modes(chain, q), comparison)
    states = np.tile(q, (50, 1))
    return {
        **{f"{type(one).__name__} {k}": one for k, one in enumerate(kinds)},
        "Equilibrium": fl.solve_static(chain, q, locked=chain.active),
        "long scene": LONG, "long arm": LONG.arm, "long chain": fl.lump(LONG), "table": TABLE,
        "Difference": comparison.rows[0], "State": random_states(chain, 1)[0],
        "Frames": fl.frames(chain, q),
        "many Frames": fl.frames(chain, states), "many Energy": fl.energy(chain, states, qd),
        "no Energy": fl.energy(chain, states[:0], qd), "method": method("RK10"), "rule": lumping_rule("gauss"),
        **{type(one).__name__: one for one in (ALUMINIUM, SQUARE, scene.arm.links[1], scene.initial, scene.run)},
    }  # fmt: skip


def test_a_count_of_one_is_in_the_singular() -> None:
    run = fl.simulate(make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0)), duration=0.01)
    one = dataclasses.replace(run, t=run.t[:1], warnings=run.warnings[:1])
    assert "1 sample, " in repr(one)
    assert "1 joint" in repr(one)
    assert "joints" not in repr(one)


def test_an_object_is_shown_in_few_words_with_its_kind() -> None:
    for name, value in shown().items():
        text = repr(value)
        assert type(value).__name__ in text, name
        assert "\n" not in text, name
        assert "array(" not in text, name
        assert len(text) < (1300 if name == "method" else 330), (name, text)


def test_the_repr_of_a_record_shows_non_default_fields_and_evaluates_to_it() -> None:
    for record in (
        ALUMINIUM,
        SQUARE,
        *nasty_scene().arm.links,
        nasty_scene().run,
        fl.RigidBody(),
        fl.RunSettings(step=1e-3),
    ):
        assert eval(repr(record), vars(fl)) == record
    settings = "RunSettings(method='RK4', step=0.001)"
    table = "Drive(kind='table', times=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, ...), torques=((1.0,), "
    assert repr(fl.RunSettings(step=1e-3)) == settings
    assert repr(TABLE).startswith(table)


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (LONG.arm, f"<Arm: {', '.join(f'{k!r} (z)' for k in NAMES[:5])}, …, 'link28' (z), 'link29' (z)>"),
        (Energy(1.0, -2.5, 0.0), "<Energy: kinetic 1 J, gravity -2.5 J, elastic 0 J>"),
        (Energy(*np.array([[0.0, 1.0], [2.0, 2.0], [3.0, 1.0]])),
         "<Energy: kinetic 0 … 1 J, gravity 2 … 2 J, elastic 1 … 3 J>"),
    ],
)  # fmt: skip
def test_the_repr_shows_the_relevant_numbers(value: object, wanted: str) -> None:
    assert repr(value) == wanted


def test_rejected_steps_are_printed_even_if_all_were_solved() -> None:
    text = str(Steps("RK4", 10, 48, rejected=2))
    assert [int(number) for number in re.findall(r"\b\d+", text)] == [10, 2, 0, 48]
    reviewed("slips: steps", text)
