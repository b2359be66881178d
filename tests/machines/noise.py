"""Rounding of another CPU: perturb inputs and outputs of NumPy's and SciPy's linear algebra in the last digits.

A plugin of pytest (`-p tests.machines.noise`). LAPACK's results are exact for slightly perturbed matrices, and the
perturbation depends on the CPU. Inputs change by half an ulp at most, like one more rounding, and outputs by 2 eps.
Signs of eigenvectors and singular vectors, and the order of unordered eigenvalues, are random.
Equal inputs give equal outputs; another NOISE_SEED gives other noise. Numbers with few bits, such as 0 and 1, are exact
on every CPU and stay unchanged.
"""

import functools
import os
import zlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg

EPS = np.finfo(float).eps
IN, OUT = EPS / 2, 2 * EPS
"""Largest relative changes; above half an ulp at the inputs, zero singular values would exceed `rcond`."""
EXACT = (1 << 20) - 1
"""Trailing bits that are 0 in exact numbers (and in one of a million rounded numbers)."""
SEED = int(os.environ.get("NOISE_SEED", "1"))

SYMMETRIC = {"eigh", "eigvalsh", "cholesky", "cho_factor"}
RISING, FALLING = {"eigh", "eigvalsh", "eigsh"}, {"svd", "svdvals"}
ANY_ORDER = {"eig", "eigs", "eigvals", "roots"}
NAMES = {
    "numpy": "roots polyfit",
    "numpy.linalg": "cholesky cond det eig eigh eigvals eigvalsh inv lstsq norm pinv qr slogdet solve svd svdvals",
    "scipy.linalg": "cho_factor cho_solve cholesky det eig eigh eigvals eigvalsh expm inv lstsq lu_factor lu_solve "
    "norm null_space orth pinv qr schur solve solve_banded solve_continuous_are solve_continuous_lyapunov "
    "solve_discrete_are solve_discrete_lyapunov solve_triangular solveh_banded svd svdvals",
    "scipy.sparse.linalg": "eigs eigsh",
}


def moved(x: Any, by: float, ξ: np.random.Generator, *, symmetric: bool = False) -> Any:
    """Add noise to numbers; return anything else unchanged."""
    if isinstance(x, (tuple, list)):
        several = [moved(one, by, ξ, symmetric=symmetric) for one in x]
        return type(x)(*several) if hasattr(x, "_fields") else type(x)(several)
    if not isinstance(x, (np.ndarray, np.inexact, float)) or np.asarray(x).dtype not in (np.float64, np.complex128):
        return x
    whole = np.array(x, order="C")
    parts = whole.view(np.float64) if whole.ndim else whole.reshape(1).view(np.float64)
    factor = 1.0 + by * ξ.uniform(-1.0, 1.0, parts.shape)
    if symmetric and parts.ndim == 2 and parts.shape == whole.shape and (whole == whole.T).all():
        factor = np.tril(factor) + np.tril(factor, -1).T
    rounded = (np.ascontiguousarray(parts).view(np.int64) & EXACT) != 0
    found = np.where(rounded, parts * factor, parts).view(whole.dtype).reshape(whole.shape)
    return found if isinstance(x, np.ndarray) else type(x)(found)


def as_elsewhere(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap the function to behave as on another CPU."""
    name = function.__name__
    own = zlib.crc32(name.encode(), SEED)

    @functools.wraps(function)
    def noisy(*given: Any, **keywords: Any) -> Any:
        key = own
        for one in (*given, *keywords.values()):
            key = zlib.crc32(one.tobytes(), key) if isinstance(one, np.ndarray) else key
        if name == "norm":  # by far the most frequent, a sum of squares: perturb only its result
            found = np.asarray(function(*given, **keywords), dtype=np.float64)
            rounded = (found.view(np.int64) & EXACT) != 0
            return np.where(rounded, found * (1 + OUT * (key / 2**31 - 1)), found)[()]
        ξ = np.random.Generator(np.random.PCG64(key))
        given = tuple(moved(one, IN, ξ, symmetric=name in SYMMETRIC) for one in given)
        return _drawn(name, moved(function(*given, **keywords), OUT, ξ), ξ)

    return noisy


def _drawn(name: str, found: Any, ξ: np.random.Generator) -> Any:
    """Randomize what LAPACK does not define: signs of vectors, and the order of unordered eigenvalues."""
    several = list(found) if isinstance(found, tuple) else [found]
    if name in ANY_ORDER and several[0].ndim == 1:
        pairs, order = _shuffled(several[0], ξ)
        for one in several:
            one[..., [k + 1 for k in pairs]] = one[..., pairs].conj()  # conjugate pairs stay bit-equal, as in LAPACK
        several = [one[..., order] for one in several]
    at = int(name == "svd" and len(several) == 3)
    if name in RISING:
        several[at] = np.maximum.accumulate(several[at], axis=-1)
    if name in FALLING:
        several[at] = np.minimum.accumulate(several[at], axis=-1)
    if name in {"eigh", "eigsh"} and len(several) == 2:
        several[1] = several[1] * ξ.choice([-1.0, 1.0], several[1].shape[-1])
    if at:
        signs = ξ.choice([-1.0, 1.0], several[1].shape[-1])
        several[0][..., :, : len(signs)] *= signs
        several[2][..., : len(signs), :] *= signs[:, None]
    if not isinstance(found, tuple):
        return several[0]
    return type(found)(*several) if hasattr(found, "_fields") else tuple(several)


def _shuffled(values: Any, ξ: np.random.Generator) -> tuple[list[int], list[int]]:
    """First indices of conjugate pairs, and a random order that keeps pairs together."""
    ahead = zip(values, np.append(values[1:], np.nan), strict=True)
    pairs = [k for k, (λ, other) in enumerate(ahead) if np.imag(λ) > 0 and abs(other - np.conj(λ)) <= 8 * EPS * abs(λ)]
    groups = [[k, k + 1] if k in pairs else [k] for k in range(len(values)) if k - 1 not in pairs]
    return pairs, [k for g in ξ.permutation(len(groups)) for k in groups[g]]


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Install the noise before other modules import the functions by name."""
    modules: dict[str, ModuleType] = {
        "numpy": np, "numpy.linalg": np.linalg, "scipy.linalg": scipy.linalg, "scipy.sparse.linalg": scipy.sparse.linalg
    }  # fmt: skip
    for place, names in NAMES.items():
        for name in names.split():
            setattr(modules[place], name, as_elsewhere(getattr(modules[place], name)))
