"""Patterns in the differences between a file and a correct one are recognised and reported; no engine is needed."""

import dataclasses
import functools
from typing import Any, cast

import numpy as np
import pytest

import flexlink as fl
from flexlink.diagnosis import patterns
from flexlink.diagnosis.diagnosis import _missing
from flexlink.diagnosis.differences import Match, _differing, differences
from flexlink.diagnosis.patterns import Discrepancy
from flexlink.engines.read_back import ReadBack, of_chain
from tests.conftest import flexible, make_scene

ARM = make_scene(flexible("a", "yz", 3), flexible("b", "z", 3), gravity=(0.0, -9.81, 0.0))


@functools.cache
def record() -> ReadBack:
    """Our record, built within tests instead of at collection because it compiles kernels."""
    return of_chain(fl.lump(ARM))


def seen(ours: list[float], theirs: list[float]) -> Discrepancy:
    nowhere = cast("Any", None)
    return Discrepancy(np.array(ours), np.array(theirs), np.arange(len(ours)), nowhere, nowhere)


def fields(theirs: ReadBack) -> list[str]:
    """First words of the reported differences."""
    return [finding.what.partition(" of ")[0] for finding in differences(record(), theirs, "mjcf")[1]]


@pytest.mark.parametrize(("apart", "same"), [(1e-12, True), (1e-7, False), (1e-3, False)])
def test_patterns_of_differences_match_up_to_rounding_only(apart: float, same: bool) -> None:
    ours = [1.0, 3.0, 2.0]
    twice = [2.0, 6.0 * (1 + apart), 4.0]
    assert patterns.scaled_by(2.0)(seen(ours, twice)) == same
    assert patterns.proportional(seen(ours, twice)) == same
    assert patterns.permuted(seen(ours, [3.0, 1.0 + apart, 2.0])) == same


def test_patterns_of_differences_match_their_names() -> None:
    nothing = [0.0, 0.0]
    assert patterns.all_zero(seen([1.0, 2.0], nothing))
    assert not patterns.all_zero(seen([1.0, 2.0], [0.0, 1.0]))
    assert patterns.none_expected(seen(nothing, [0.0, 1.0]))
    assert not patterns.none_expected(seen([0.0, 1.0], [0.0, 1.0]))
    assert patterns.all_larger(seen([1.0, 2.0], [1.1, 2.1]))
    assert not patterns.all_larger(seen([1.0, 2.0], [1.1, 1.9]))
    assert not patterns.all_larger(seen([1.0, 2.0], [1.0 + 1e-15, 2.0]))
    assert patterns.fewer_digits(seen([1.23456, 0.98765], [1.23, 0.988]))
    assert not patterns.fewer_digits(seen([1.23456, 0.98765], [1.23, 0.98]))


def test_the_default_inertia_of_drake_is_a_ball_of_water() -> None:
    """A ball of 0.1 m radius has 4π/3 · 1000 · 0.001 = 4.18879 kg and 2/5 m r² = 0.01675516 kg m²."""
    masses = record().masses.copy()
    masses[0] = 4.1887902047863905
    them = dataclasses.replace(record(), masses=masses)
    where = np.array([0])
    for moment, is_ball in ((0.016755160819145562, True), (0.02792526803190927, False)):  # 2/3 m r²: a hollow ball
        theirs = moment * np.eye(3)[None]
        assert patterns.water_sphere(Discrepancy(record().inertias[where], theirs, where, record(), them)) == is_ball


def test_a_record_does_not_differ_from_itself() -> None:
    assert fields(record()) == []


def test_a_centre_of_mass_is_compared_to_ten_digits() -> None:
    """Rounding errors of successive frame rotations are smaller, 1e-11 of the arm's length."""
    centers = record().centers.copy()
    centers[record().masses.argmax()] += [0.0, 1e-7, 0.0]
    (difference,) = fields(dataclasses.replace(record(), centers=centers))
    assert "centre" in difference


def test_a_rest_angle_without_a_spring_is_not_a_difference() -> None:
    stiffness, rest = record().stiffness.copy(), record().rest.copy()
    bent = int(np.flatnonzero(stiffness)[0])
    rest[bent] = 0.1
    assert len(fields(dataclasses.replace(record(), rest=rest))) == 1
    stiffness[bent] = 0.0
    (difference,) = fields(dataclasses.replace(record(), rest=rest, stiffness=stiffness))
    assert "stiffness" in difference


FRICTION = make_scene(*(flexible(name, segments=2, joint=fl.Joint(coulomb=0.5)) for name in "ab"))


def test_the_friction_width_is_not_compared_without_friction() -> None:
    ours = of_chain(fl.lump(FRICTION))
    theirs = dataclasses.replace(ours, coulomb=0 * ours.coulomb, coulomb_width=2 * ours.coulomb_width)
    assert set(_differing(ours, theirs)) == {"coulomb"}


def test_missing_data_are_taken_from_the_joint_of_the_same_name() -> None:
    ours = of_chain(fl.lump(FRICTION))
    ours = dataclasses.replace(ours, armature=np.arange(1.0, ours.n + 1))
    order = np.roll(np.arange(ours.n), 1)  # a cyclic permutation differs from its inverse
    theirs = dataclasses.replace(ours, unspecified=frozenset({"armature"}))
    filled = _missing(ours, theirs, Match(order, None, ours, True, []))
    assert filled["armature"][order].tolist() == ours.armature.tolist()
