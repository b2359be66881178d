"""The SDF file says what the chain says: element by element, and as Drake reads it, in a process of its own."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS, flexible, make_scene, nasty_scene, random_state

from flexlink import Chain, bias_torque, elastic_torque, load_scene, lump, mass_matrix, to_sdf
from flexlink.common.safe_xml import parse
from flexlink.dynamics import rounding

HERE = Path(__file__).parent
drake = pytest.mark.skipif(importlib.util.find_spec("pydrake") is None, reason="needs Drake")
COLLIDING = ("a", "a_link", "a_child", "a.1.z", "world", "__it__", "tip", "x::y", "x.y", 'a<b>&"c"', "関節")


def in_drake(chains: list[Chain], rng: np.random.Generator) -> list[tuple[dict, np.ndarray, np.ndarray]]:
    """What Drake reads of every chain, at a random state, and the state."""
    states = [random_state(chain, rng) for chain in chains]
    requests = [
        {"text": to_sdf(chain), "gravity": list(chain.gravity), "q": list(q), "qd": list(qd)}
        for chain, (q, qd) in zip(chains, states, strict=True)
    ]
    command = [sys.executable, str(HERE / "drake_reading.py")]
    done = subprocess.run(command, input=json.dumps(requests), capture_output=True, text=True, check=True)
    return [(answer, *state) for answer, state in zip(json.loads(done.stdout), states, strict=True)]


@drake
@pytest.mark.slow
def test_drake_reads_every_mass_spring_and_damper(rng: np.random.Generator) -> None:
    chains = [lump(load_scene(path)) for path in MODELS] + [lump(nasty_scene())]
    for chain, (read, q, qd) in zip(chains, in_drake(chains, rng), strict=True):
        M, bias = mass_matrix(chain, q), bias_torque(chain, q, qd)
        assert np.abs(np.array(read["M"]) - M).max() <= rounding.of_mass_matrix(chain, q)
        assert np.abs(np.array(read["bias"]) - bias).max() <= rounding.of_bias_torque(chain, q, qd)
        assert read["elastic"] == elastic_torque(chain, q).tolist()
        assert read["damping"] == chain.damping.tolist()
        assert read["joints"] == list(chain.joint_names)
        assert read["order"] == list(range(chain.n))
        assert read["motors"] == len(chain.active)
        assert all("world: gravity" in warning for warning in read["warnings"])


@drake
@pytest.mark.slow
def test_drake_takes_any_names(rng: np.random.Generator) -> None:
    chain = dataclasses.replace(lump(make_scene(*(flexible(name, segments=2) for name in COLLIDING))), name="world")
    ((read, _, _),) = in_drake([chain], rng)
    assert read["order"] == list(range(chain.n))


def test_a_rotor_has_a_motor_in_the_file_and_a_spring_without_one_has_none() -> None:
    """Drake drops the rotor of a joint whose effort is 0."""
    chain = lump(nasty_scene())
    hinges = chain.hinges.copy()
    hinges["armature"][2] = 0.3
    rotors = dataclasses.replace(chain, hinges=hinges)
    for k, joint in enumerate(parse(to_sdf(rotors), "nasty").iter("joint")):
        rotor = joint.findtext("{http://drake.mit.edu}rotor_inertia", "0.0")
        assert float(rotor) == rotors.hinges["armature"][k]
        driven = joint.findtext("axis/limit/effort") != "0"
        assert driven == (k in rotors.active or float(rotor) != 0)


def test_every_link_says_its_mass_and_those_of_no_mass_say_zero() -> None:
    """SDFormat gives 1 kg to a link that says nothing."""
    chain = lump(nasty_scene())
    masses = [float(link.findtext("inertial/mass", "nan")) for link in parse(to_sdf(chain), "nasty").iter("link")]
    heavy = {body["stop"] - 1: body["mass"] for body in chain.bodies[:-1]}
    assert masses == [heavy.get(k, 0.0) for k in range(chain.n)]


def test_gravity_stands_in_the_world_and_no_joint_has_two_axes() -> None:
    chain = lump(nasty_scene())
    root = parse(to_sdf(chain), "nasty")
    assert [float(word) for word in root.findtext("world/gravity", "").split()] == chain.gravity.tolist()
    assert {joint.get("type") for joint in root.iter("joint")} == {"revolute"}
