"""A few random scenes with any keys are simulated correctly; errors are found (`tests.campaigns.fresh_scenes`)."""

import dataclasses

import numpy as np
import pytest

from tests.campaigns import fresh_scene_checks, fresh_scenes


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> None:
    for module in (fresh_scene_checks, fresh_scenes):
        monkeypatch.setattr(module, "FOLDER", tmp_path)


@pytest.mark.parametrize("seed", [3, 11, 24])
def test_a_random_scene_with_any_keys_is_simulated_correctly(seed) -> None:
    found = fresh_scenes.judged(seed)["found"]
    assert not [text for kind, text in found if kind in {"silent", "error", "doubt", "traceback"}]


def test_an_inaccurate_final_state_is_detected() -> None:
    one = fresh_scene_checks.Judged(3)
    one.judge()
    one.result = dataclasses.replace(one.result, q=one.result.q + 0.05 * np.ones(one.chain.n))
    one.found.clear()
    one.against_truth()
    assert [kind for kind, _ in one.found] == ["silent"]
