"""Memoized results: computed once per object and key, from any thread, and never taken from another object."""

import copy
import threading
from collections.abc import Callable

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.memo import Memo, keep_last
from flexlink.motion.inputs.feedforward import holding_torque
from flexlink.motion.inputs.references import reference_arrays
from tests.conftest import flexible, make_scene

HELD = fl.PrescribedMotion(link="a", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))


class Unhashable:
    """An object that equals all objects of its class and has no hash."""

    __hash__ = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unhashable)


def test_a_result_is_computed_once_per_object_and_key() -> None:
    memo, calls, one = Memo(4), [], Unhashable()
    for key in ("a", "a", "b", "a"):
        assert memo(one, key, lambda key=key: calls.append(key) or len(calls)) == {"a": 1, "b": 2}[key]
    assert calls == ["a", "b"]


def test_a_key_of_contents_depends_on_all_arguments() -> None:
    """Arguments of another value, type, shape or position give another key; a copy of an array gives the same key."""
    one, calls, zeros, ones = Unhashable(), [], np.zeros(2), np.ones(2)
    given = [
        (zeros, ones), (zeros, ones + 1.0), (ones, zeros), (zeros, np.ones((2, 1))), (zeros, np.ones(2, np.int64)),
        ((zeros, ones),), ((zeros,), (ones,)), (zeros, 1), (zeros, 1.0), (zeros, "1"),
    ]  # fmt: skip

    @keep_last(64)
    def find(*given: object) -> int:
        calls.append(given)
        return len(calls)

    for _ in range(2):
        assert [find(one, *copy.deepcopy(each)) for each in given] == list(range(1, len(given) + 1))
    assert keep_last(64)(lambda *_: 0)(one, zeros, ones) == 0  # another function has other results


def test_holding_torques_of_references_with_equal_times_are_stored_separately() -> None:
    """In a sweep of `to_deg`, references have equal knots and differ only in their polynomial coefficients."""
    arm = make_scene(flexible("a", segments=3), gravity=(0.0, -9.81, 0.0))
    gains = {"kind": "pd", "kp": (50.0,), "kd": (5.0,), "gravity": "static"}
    drives = [
        fl.Drive(**gains, reference=fl.Reference(profile="quintic", to_deg=(end,), duration=0.5))
        for end in (10.0, 60.0)
    ]
    chain = fl.lump(arm)
    references = [reference_arrays(arm.varied({"drive": drive}), chain) for drive in drives]
    assert references[0].knots.tolist() == references[1].knots.tolist()
    for angle, reference in zip((10.0, 60.0), references, strict=True):
        there = fl.solve_static(chain, np.radians([angle, 0.0, 0.0]), locked=[0]).q
        held = holding_torque(chain, reference).coefficients[-1, 0, 0]
        assert held == pytest.approx(fl.gravity_torque(chain, there)[0], rel=1e-6)


def test_equal_objects_have_separate_results() -> None:
    memo, one, other = Memo(4), Unhashable(), Unhashable()
    assert one == other
    assert memo(one, 0, object) is not memo(other, 0, object)


def test_an_object_at_a_reused_address_has_a_separate_result() -> None:
    """Objects are identified by address, which a later object may reuse: a stored result keeps its object alive."""
    memo = Memo(8)
    assert [memo(np.array([k]), "", lambda k=k: k) for k in range(100)] == list(range(100))


def test_the_most_recently_used_results_are_kept() -> None:
    memo, objects = Memo(2), [Unhashable() for _ in range(3)]
    first = [memo(each, 0, object) for each in objects[:2]]
    assert memo(objects[0], 0, object) is first[0]  # now the result of the second object is the oldest
    memo(objects[2], 0, object)
    assert memo(objects[0], 0, object) is first[0]
    assert memo(objects[1], 0, object) is not first[1]


def test_threads_share_results() -> None:
    memo, objects, wrong = Memo(3), [Unhashable() for _ in range(5)], []

    def query() -> None:
        for k in range(2000):
            number = k % 5
            if memo(objects[number], "", lambda number=number: number) != number:
                wrong.append(number)

    threads = [threading.Thread(target=query) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def arm(**locked: bool) -> fl.Scene:
    return make_scene(
        flexible("a", flex="rigid", segments=1, lumping="gauss", joint=fl.Joint(**locked)), flexible("b", segments=2)
    )


def test_runs_of_one_arm_share_a_chain() -> None:
    scene = arm()
    others = {"run.duration": 0.5}, {"initial.joint_deg.a": 20.0}, {"link.b.length": 2.0}
    same = [fl.lump(scene.varied(change)) is fl.lump(scene) for change in others]
    assert same == [True, True, False]


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        ({"name": "another"}, lambda chain: chain.name),
        ({"gravity": (0.0, 0.0, 0.0)}, lambda chain: chain.gravity.tolist()),
        ({"motion": (HELD,)}, lambda chain: chain.hinges["prescribed"].tolist()),
        ({"initial.joint_deg.a": 20.0}, lambda chain: chain.bodies["rotation"].tolist()),
    ],
    ids=["name", "gravity", "motion", "angle of a locked joint"],
)
def test_a_run_of_the_same_arm_with_a_different_chain_does_not_share_it(change: dict, differs: Callable) -> None:
    scene = arm(locked=True) if "initial.joint_deg.a" in change else arm()
    assert differs(fl.lump(scene.varied(change))) != differs(fl.lump(scene))


def test_a_run_with_the_wrench_on_another_tip_has_a_separate_chain() -> None:
    scene = make_scene(flexible("a", segments=2), flexible("b", segments=2, on="base"))
    chains = [fl.lump(scene.varied({"wrench.on": tip})) for tip in ("a", "b")]
    assert [chain.loaded for chain in chains] == list(chains[0].tips.values())
