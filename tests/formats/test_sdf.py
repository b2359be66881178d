"""The SDF file agrees with the chain: element by element, and as Drake reads it, in a separate process."""

import dataclasses
import importlib.util
import subprocess
import sys

import pytest

from flexlink import lump, to_sdf
from flexlink.common.safe_xml import parse
from flexlink.engines import load
from tests.conftest import flexible, make_scene, nasty_scene

drake = pytest.mark.skipif(importlib.util.find_spec("pydrake") is None, reason="needs Drake")
COLLIDING = ("a", "a_link", "a_child", "a.1.z", "world", "__it__", "tip", "x::y", "x.y", 'a<b>&"c"', "関節")


COUNT_MOTORS = """
import sys
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(sys.stdin.read(), "sdf")
plant.Finalize()
print(plant.num_actuators())
"""
"""Program for a separate process, which some files abort."""


@drake
@pytest.mark.slow
def test_drake_finds_a_motor_at_every_driven_joint_and_warns_only_of_gravity() -> None:
    chain = lump(nasty_scene())
    command = [sys.executable, "-c", COUNT_MOTORS]
    done = subprocess.run(command, input=to_sdf(chain), capture_output=True, text=True, check=True)
    assert int(done.stdout) == len(chain.active)
    assert all("world" in warning and "gravity" in warning for warning in done.stderr.splitlines())


@drake
@pytest.mark.slow
def test_drake_reads_any_names() -> None:
    chain = dataclasses.replace(lump(make_scene(*(flexible(name, segments=2) for name in COLLIDING))), name="world")
    assert load("drake", chain).n == chain.n


def test_a_rotor_has_a_motor_in_the_file_and_a_spring_without_a_rotor_has_none() -> None:
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


def test_every_link_has_its_mass_even_if_it_is_zero() -> None:
    """SDFormat assumes 1 kg for a link without a mass."""
    chain = lump(nasty_scene())
    masses = [float(link.findtext("inertial/mass", "nan")) for link in parse(to_sdf(chain), "nasty").iter("link")]
    heavy = {body["stop"] - 1: body["mass"] for body in chain.bodies[:-1]}
    assert masses == [heavy.get(k, 0.0) for k in range(chain.n)]
