"""The noise of samples is found whatever smooth motion it is added to."""

import numpy as np
import pytest

from flexlink.data.smoothing import noise_of

T = np.linspace(0.0, 1.0, 20_000)


@pytest.mark.parametrize("motion", [0.0 * T, 3.0 - 50.0 * T + 80.0 * T**2, 40.0 * np.sin(5.0 * T)])
def test_noise_is_found_whatever_smooth_motion_it_is_added_to(motion: np.ndarray) -> None:
    noise = 0.3 * np.random.default_rng(0).standard_normal(len(T))
    assert noise_of(motion + noise) == pytest.approx(0.3, rel=0.03)


def test_parabolas_and_records_of_three_samples_have_no_noise() -> None:
    assert noise_of(np.arange(9.0) ** 2) == 0
    assert noise_of(np.array([1.0, 5.0, 2.0])) == 0
