"""Adaptive steps must end at the merged breakpoints of a torque table, between which the table is nearly cubic."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion.inputs.drives import drive_arrays
from flexlink.motion.inputs.tstops import merged_breakpoints
from tests.conftest import flexible, make_scene

TIMES = np.linspace(0.0, 1.0, 241)
ARM = make_scene(flexible("a"))


def table(torques: np.ndarray, smooth: bool = True, times: np.ndarray = TIMES):
    drive = fl.Drive(kind="table", smooth=smooth, times=tuple(times), torques=tuple((x,) for x in torques))
    scene = ARM.varied({"drive": drive})
    return drive_arrays(scene, fl.lump(scene)).feedforward


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("part", [1e-2, 1e-4])
def test_between_merged_breakpoints_a_cubic_fits_the_table_within_the_tolerance(smooth: bool, part: float) -> None:
    """The least-squares cubic has no larger residual at the knots than the cubic that was checked.

    A smooth table keeps few breakpoints; the corners of a piecewise linear table deviate by 2e-4 of its range.
    """
    torques = 3.0 * np.sin(2 * np.pi * TIMES) ** 3
    kept = merged_breakpoints(table(torques, smooth), part)
    assert kept[[0, -1]].tolist() == [0.0, 1.0]
    assert len(kept) < 241 / 4 or (not smooth and part < 2e-4)
    for a, b in itertools.pairwise(kept):
        inside = (a <= TIMES) & (b >= TIMES)
        if inside.sum() > 4:
            x = TIMES[inside] - a
            off = np.polyval(np.polyfit(x, torques[inside], 3), x) - torques[inside]
            assert np.sqrt(np.mean(off**2)) <= part * 3.0


def test_a_smaller_tolerance_keeps_more_breakpoints() -> None:
    drive = table(np.sin(7.0 * TIMES))
    assert (
        len(merged_breakpoints(drive, 1e-2))
        < len(merged_breakpoints(drive, 1e-4))
        < len(merged_breakpoints(drive, 1e-6))
    )
    assert len(merged_breakpoints(drive, 0.0)) == 121  # pairs of pieces are always merged


def test_an_isolated_torque_pulse_keeps_its_breakpoints() -> None:
    torques = np.zeros(241)
    torques[100] = 5.0
    kept = merged_breakpoints(table(torques, smooth=False), 1e-3)
    assert set(TIMES[[99, 100, 101]]) <= set(kept)
    assert len(kept) < 20


def test_a_constant_drive_has_one_breakpoint() -> None:
    scene = ARM.varied({"drive": fl.Drive(kind="constant", torque=(2.0,))})
    assert merged_breakpoints(drive_arrays(scene, fl.lump(scene)).feedforward, 1e-3).tolist() == [0.0]
    assert merged_breakpoints(drive_arrays(ARM, fl.lump(ARM)).feedforward, 1e-3).tolist() == [0.0]


def test_a_linear_torque_table_keeps_few_breakpoints() -> None:
    assert merged_breakpoints(table(2.0 * TIMES, smooth=False), 1e-9)[[0, -1]].tolist() == [0.0, 1.0]
    assert (
        len(merged_breakpoints(table(2.0 * TIMES, smooth=False), 1e-9)) <= 8
    )  # 240 pieces merged in powers of two: 128 + 64 + 32 + 16


def test_breakpoints_at_jumps_of_piecewise_constant_torques_are_kept() -> None:
    drive = table(np.repeat([0.0, 4.0, 1.0], [80, 80, 81]), smooth=False)
    jumps = TIMES[[0, 80, 160]]
    kept = merged_breakpoints(drive._replace(coefficients=drive.coefficients[:, :1]), 1e-3)
    assert set(jumps) <= set(kept)
    assert len(kept) < 40
