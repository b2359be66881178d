"""Tables of the study's page and results for foreign files, recomputed from numbers in this file."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from flexlink.engines.base import refuse_sampled_inputs
from flexlink.errors import ArgumentError
from reports.findings import physics_published
from tests.support.words import refused


def test_differences_from_published_values_are_relative() -> None:
    theirs = np.array([2.0, 4.0, 5.0, 8.0, 10.0, 20.0])
    ours = theirs * (1 + np.array([0.001, -0.002, 0.0, 0.004, -0.05, 0.03]))
    columns = {"what": np.array(list("abcdef")), "published": theirs, "ours": ours}
    series = SimpleNamespace(columns=columns)
    results = SimpleNamespace(showing=lambda name: [("beam", series)], cases={"beam": [SimpleNamespace(title="Beam")]})
    (table,) = physics_published.find(cast("Any", results))
    shown = [str(line[3]).replace("−", "-") for line in table.lines]
    numbers = [float(text.removeprefix("at most ").split()[0].rstrip("%")) for text in shown]
    assert numbers == pytest.approx([0.1, -0.2, 0.0, 0.4, 5.0], abs=0.051)
    assert shown[-1].startswith("at most ")
    assert [line[0] for line in table.lines] == ["Beam: a", "Beam: b", "Beam: c", "Beam: d", "Beam: 2 more"]


def test_engines_with_their_own_stepping_support_only_smooth_pd_references() -> None:
    """The other laws need torques between samples, which such an engine cannot receive."""

    def scene(kind: str, jumps: list[float]) -> Any:
        drive = SimpleNamespace(hold=False, rate=None, kind=kind)
        return SimpleNamespace(drive=drive, wrench=SimpleNamespace(hold=False), initial=SimpleNamespace(time=0.0),
                               course=SimpleNamespace(jumps=np.array(jumps)))  # fmt: skip

    refuse_sampled_inputs("exudyn", scene("pd", []))
    for kind, jumps in (("computed_torque", []), ("pd", [0.5])):
        with refused(ArgumentError, "engine-does-not-support"):
            refuse_sampled_inputs("exudyn", scene(kind, jumps))


def test_a_mujoco_servo_control_is_divided_by_its_gear_ratio() -> None:
    """A servo, kp (u − r q) r, moves its joint to q = u / r, so `gear` is 1/r; for a motor it is the gear ratio r."""
    mujoco = pytest.importorskip("mujoco")
    from flexlink.engines import mujoco_actuators  # noqa: PLC0415

    body = '<body><joint name="{0}"/><geom type="box" size=".1 .1 .1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{body.format('a')}{body.format('b')}</worldbody><actuator>"
        '<position joint="a" kp="30" gear="4"/><motor joint="b" gear="7"/></actuator></mujoco>'
    )
    fields = mujoco_actuators.at_joints(model)
    np.testing.assert_allclose(fields["gear"], [1 / 4, 7.0], rtol=1e-12)
    np.testing.assert_allclose(fields["servo_stiffness"], [16 * 30.0, 0.0], rtol=1e-12)
