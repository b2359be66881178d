"""Domain of validity: reference solution of a thick beam, and results of the case for thick and compressed links."""

import math

import numpy as np
import pytest

from validation.kinds import validity
from validation.oracles.thick_beam import Beam, frequencies

SLENDER = Beam(1.0, 1.0, 0.0, 1e30, 1.0)


def test_a_shear_rigid_beam_has_the_euler_bernoulli_roots():
    roots = [1.875104068711961, 4.694091132974175, 7.854757438237613]
    assert np.allclose(np.sqrt(frequencies(SLENDER, 3)), roots, rtol=1e-10)


def test_a_short_beam_has_the_frequency_of_a_shear_beam():
    stiff = Beam(1e6, 1.0, 0.0, 1.0, 1.0)  # w'' = −ω² w / k_s G A: the first mode is a quarter wave
    assert np.allclose(frequencies(stiff, 1), math.pi / 2, rtol=1e-4)


def test_the_frequency_vanishes_at_eulers_buckling_load():
    critical = math.pi**2 / 4
    low, lower = (frequencies(SLENDER._replace(push=part * critical), 1)[0] for part in (0.98, 0.999))
    assert lower**2 / low**2 == pytest.approx(0.001 / 0.02, rel=0.01)


def test_a_crossing_is_interpolated_and_nan_if_there_is_none():
    assert validity._crossing(np.array([0.0, 1.0, 2.0]), [0.0, 0.2, 0.6], 0.4) == pytest.approx(1.5)
    assert math.isnan(validity._crossing(np.array([0.0, 1.0]), [0.0, 0.2], 0.4))
