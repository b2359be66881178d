"""Runge-Kutta methods as data: a family with stages or exact coefficient strings, plus order and source."""

import functools
import math
import re
from fractions import Fraction
from itertools import chain
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.polynomials import dot, float64
from flexlink.common.types import Array, Complex
from flexlink.common.wording import truncated
from flexlink.describe import data_files
from flexlink.describe.schemes import coefficients
from flexlink.describe.spec import Spec

CLOSE = Fraction(1, 10**15)  # tolerance for sums of coefficients, which may be rounded decimals

MOST_STAGES = 9
"""Largest number of stages of implicit methods; eigenvectors of A become too parallel (Gauss 9: condition 3e4)."""


class Modes(NamedTuple):
    """Eigendecomposition A = T_real diag(real) Tinv_real + 2 Re(T_complex diag(complex) Tinv_complex), A A and b A."""

    real: Array  # (r,) real eigenvalues of A
    complex: Complex  # (p,) one of each complex pair, Im > 0
    T_real: Array  # (s, r)
    T_complex: Complex  # (s, p)
    Tinv_real: Array  # (r, s)
    Tinv_complex: Complex  # (p, s)
    A2: Array  # (s, s) A A
    bA: Array  # noqa: N815  (s,) b A


class Method(Spec, frozen=True, dict=True):  # the dict is for cached properties
    """A Runge-Kutta method: `family` and `stages`, or the Butcher tableau A, b, c.

    Coefficients are decimal strings or fractions such as "1/6". A is strictly lower triangular (explicit: rows of 0, 1,
    2, … numbers) or square (implicit). For an explicit method, `error` has rows of weights for the stages, and
    optionally for q̈ at the end of the step, whose sums estimate the step's error; with two rows, the second scales the
    first, as in DOP853. `dense` has rows d of weights that interpolate samples inside a step, for the stages, for q̈ at
    the end of the step, and for the extra stages `dense_stages`. At a fraction x of a step h from y to y + Δ, with
    derivatives f and f₁ at its ends and sums over the stages, the solution is

        y + x (Δ + (1 − x) (h f − Δ + x (2 Δ − h f − h f₁ + (1 − x) h (Σ d_1i K_i + x (Σ d_2i K_i + (1 − x) (…))))))
    """

    about: str
    """One-sentence description of the method."""
    source: str
    """Publication."""
    order: Annotated[int, msgspec.Meta(ge=1)]
    """Order p of the method: errors are proportional to the p-th power of the step."""
    family: Literal["Radau IIA", "Gauss"] | None = None
    """Implicit family with computed coefficients, instead of a tableau."""
    stages: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Number of stages of a family."""
    c: tuple[str, ...] | None = None
    """Nodes of the tableau, as decimals or fractions in quotes."""
    b: tuple[str, ...] | None = None
    """Weights of the tableau."""
    A: tuple[tuple[str, ...], ...] | None = None
    """Coefficients of the tableau: rows of 0, 1, 2, … numbers (explicit), or a square (implicit)."""
    error_rows: tuple[tuple[str, ...], ...] = msgspec.field(default=(), name="error")
    """For an explicit method: one or two rows of weights whose sums estimate the error of a step."""
    dense_rows: tuple[tuple[str, ...], ...] = msgspec.field(default=(), name="dense")
    """For an explicit method: rows of weights that interpolate samples inside a step. Default: steps end at samples."""
    dense_stages: tuple[tuple[str, ...], ...] = ()
    """Rows of A for extra stages used only by `dense`; they follow the step's stages and the derivative at its end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.family is None:
            self._check_tableau()
        else:
            self._check_family(self.family)
        self._check_error()
        self._check_dense()
        if not self.explicit:
            self.modes  # noqa: B018  raises if there are none

    @functools.cached_property
    def explicit(self) -> bool:
        """Whether every stage depends only on earlier stages."""
        return not any(any(row[i:]) for i, row in enumerate(self.exact[0]))

    @functools.cached_property
    def controlled(self) -> bool:
        """Whether the method estimates the error of its steps.

        An explicit method needs rows `error`; an implicit one must end on its last stage and A must have one real
        eigenvalue, as in Radau IIA with 3, 5, … stages.
        """
        if self.explicit:
            return bool(self.error_rows)
        A, b, c = self.exact
        return A[-1] == b and len(set(c)) == len(c) and len(self.modes.real) == 1

    @functools.cached_property
    def exact(self) -> coefficients.Tableau:
        """A (square), b and c as fractions, exact if given as strings, or accurate to 2^−255 for a family."""
        if self.family is not None:
            return coefficients.tableau(self.family, self.stages)
        rows = [[Fraction(x) for x in row] for row in self.A or ()]
        b, c = [Fraction(x) for x in self.b or ()], [Fraction(x) for x in self.c or ()]
        return [row + [Fraction(0)] * (len(c) - len(row)) for row in rows], b, c

    @functools.cached_property
    def arrays(self) -> tuple[Array, Array, Array]:
        """A (s, s), b (s,), c (s,), each rounded once to float64."""
        A, b, c = self.exact
        return float64(A), float64(b), float64(c)

    @functools.cached_property
    def error(self) -> Array:
        """Error weights of an explicit method for its stages and for q̈ at the end of the step, shape (rows, s + 1)."""
        return _padded(self.error_rows, self.stages + 1)

    @property
    def more_stages(self) -> int:
        """Number of extra evaluations for samples inside a step of an explicit method."""
        return len(self.dense_stages)

    @functools.cached_property
    def dense(self) -> tuple[Array, Array, Array] | None:
        """A (e, s + 1 + e) and c (e,) of e extra stages, and coefficients of β_i / x and α_i / x²; None if not given.

        Rates at a fraction x of a step are q̇ + h Σ β_i(x) q̈_i, with stages i = 1 … s + 1 + e (`embedded` of the
        kernels); the coefficients (2, s + 1 + e, powers) have the lowest power first.
        """
        if not self.dense_rows:
            return None
        A = _padded(self.dense_stages, self.stages + 1 + self.more_stages)
        c = float64([sum(map(Fraction, row), Fraction(0)) for row in self.dense_stages])
        own, b, _ = self.exact
        rows = [[Fraction(x) for x in row] for row in self.dense_rows]
        return A, c, coefficients.polynomials(b, [dot(b, column) for column in zip(*own, strict=True)], rows)

    @functools.cached_property
    def modes(self) -> Modes:
        """Eigenvalues and eigenvectors of A of an implicit method."""
        if self.explicit:
            text = f"{self.about}: explicit; only implicit methods use the eigenvectors of A"
            raise ArgumentError(text, id="method-not-supported")
        exact, b, _ = self.exact
        λ, T = np.linalg.eig(float64(exact))
        if not np.linalg.cond(T) < 1e7:  # Newton corrections are multiplied by T, and 9 digits must remain
            text = "A: too few eigenvectors, for example because of repeated diagonal elements; use another method"
            raise SceneError(text, id="method-coefficients")
        wrong = λ[(λ.real < 0) | ((λ.real == 0) & (λ.imag != 0))]
        if wrong.size:
            first = wrong[0] if wrong[0].imag else wrong[0].real  # NumPy 2.5 returns real values as complex
            text = f"A: eigenvalue {first:.3g}: its real part must be positive, or some steps are singular"
            raise SceneError(text, id="method-coefficients")
        Tinv = np.linalg.inv(T)
        real, pair = λ.imag == 0, λ.imag > 0
        columns = list(zip(*exact, strict=True))
        return Modes(
            real=λ[real].real.copy(), complex=λ[pair].astype(complex),
            T_real=np.ascontiguousarray(T[:, real].real), T_complex=np.ascontiguousarray(T[:, pair].astype(complex)),
            Tinv_real=np.ascontiguousarray(Tinv[real].real),
            Tinv_complex=np.ascontiguousarray(Tinv[pair].astype(complex)),
            A2=float64([[dot(row, column) for column in columns] for row in exact]),
            bA=float64([dot(b, column) for column in columns]),
        )  # fmt: skip

    @functools.cached_property
    def embedded(self) -> tuple[float, Array]:
        """γ and d, shape (stages,), the weights in the error estimate of an implicit method.

        At 0, the polynomial through values f_i at the nodes is Σ_i ℓ_i(0) f_i, hence d_i = −γ ℓ_i(0).
        """
        if self.explicit or not self.controlled:
            text = f"{self.about}: has no implicit error estimate; Radau IIA with 3, 5, … stages has one"
            raise ArgumentError(text, id="method-without-error")
        γ = float(self.modes.real[0])
        return γ, -γ * float64(coefficients.weights_at(self.exact[2], Fraction(0)))

    def _check_family(self, family: str) -> None:
        for name in ("A", "b", "c"):
            if getattr(self, name) is not None:
                raise SceneError(f"family, {name}: both are given; give either family, or A, b and c", id="both-given")
        if not 1 <= self.stages <= MOST_STAGES:
            raise self._refused("stages", f"must be 1 … {MOST_STAGES} for family {family!r}", "method-stages")
        order = coefficients.ORDER[family](self.stages)
        if self.order != order:
            raise self._refused("order", f"{family} with {self.stages} stages has order {order}", "method-order")

    def _check_tableau(self) -> None:
        if self.A is None or self.b is None or self.c is None:
            raise SceneError("family, A, b, c: give either family, or all of A, b and c", id="both-given")
        stages = len(self.c)
        if self.stages not in {0, stages}:
            raise self._refused("stages", f"c has {stages}", "method-stages")
        if len(self.b) != stages or [len(row) for row in self.A] not in (list(range(stages)), [stages] * stages):
            rows = f"0, 1, …, {stages - 1} (explicit) or {stages} each (implicit)"
            text = f"{stages} stages need {stages} numbers in b, and in the rows of A {rows}"
            raise SceneError(f"A, b, c: {text}", id="method-coefficients")
        for x in chain(self.b, self.c, *self.A):
            _check_number("A, b, c", x)
        msgspec.structs.force_setattr(self, "stages", stages)
        if stages > MOST_STAGES and not self.explicit:
            why = f"A, b, c: {stages} stages; an implicit method takes at most {MOST_STAGES}"
            raise SceneError(why, id="method-stages")
        A, b, c = self.exact
        if abs(sum(b, Fraction(0)) - 1) > CLOSE:
            raise self._refused("b", "must sum to 1", "method-coefficients")
        for i, row in enumerate(A):
            if abs(sum(row, Fraction(0)) - c[i]) > CLOSE:
                text = f"A[{i}] = {truncated(self.A[i])}: must sum to c[{i}] = {truncated(self.c[i])}"
                raise SceneError(text, id="method-coefficients")
        A_, b_, c_ = self.arrays
        chained = np.ones(stages)  # A^(k−1) 1
        for k in range(1, self.order + 1):  # necessary for y' = f(t) and y' = λ y, so that a false order is noticed
            if max(abs(k * b_ @ c_ ** (k - 1) - 1.0), abs(math.factorial(k) * b_ @ chained - 1.0)) > 1e-9:
                raise self._refused("order", f"these coefficients have at most order {k - 1}", "method-order")
            chained = A_ @ chained

    def _check_error(self) -> None:
        if self.error_rows and not self.explicit:
            why = "error: only explicit methods take error weights; leave error out"
            raise SceneError(why, id="method-error-weights")
        for i, row in enumerate(self.error_rows):
            if len(row) not in {self.stages, self.stages + 1}:
                text = f"expected {self.stages}, one per stage, or one more for q̈ at the end of the step"
                raise SceneError(f"error[{i}] has {len(row)} weights: {text}", id="method-error-weights")
            _check_differences(f"error[{i}]", row)

    def _check_dense(self) -> None:
        if self.dense_rows and not self.explicit:
            text = "dense: only explicit methods take these weights; leave dense out"
            raise SceneError(text, id="method-dense-output")
        if self.dense_stages and not self.dense_rows:
            raise SceneError("dense_stages: has no effect without dense; also give dense", id="method-dense-output")
        before = self.stages + 1  # including the derivative at the end of the step
        for i, row in enumerate(self.dense_stages):
            if len(row) != before + i:
                text = f"dense_stages[{i}] has {len(row)} numbers: expected {before + i}, one per earlier stage"
                raise SceneError(text, id="method-dense-output")
            for x in row:
                _check_number(f"dense_stages[{i}]", x)
        for i, row in enumerate(self.dense_rows):
            if len(row) != before + self.more_stages:
                each = "one per stage, one for q̈ at the end of the step, and one per row of dense_stages"
                text = f"dense[{i}] has {len(row)} weights: expected {before + self.more_stages}, {each}"
                raise SceneError(text, id="method-dense-output")
            _check_differences(f"dense[{i}]", row)


def method(name: str) -> Method:
    """Load a built-in method ("RK4", "Radau5", …), or the user's TOML file."""
    return data_files.load("methods", "method", name, Method)


def _padded(rows: tuple[tuple[str, ...], ...], columns: int) -> Array:
    """Rows of numbers in a table, with zeros behind them."""
    return float64([[*map(Fraction, row), *[Fraction(0)] * (columns - len(row))] for row in rows]).reshape(-1, columns)


def _check_differences(name: str, row: tuple[str, ...]) -> None:
    """Check that weights sum to 0, so that they give 0 for equal derivatives."""
    for x in row:
        _check_number(name, x)
    if abs(sum(map(Fraction, row), Fraction(0))) > CLOSE:
        raise SceneError(f"{name} = {truncated(row)}: must sum to 0", id="method-coefficients")


def _check_number(where: str, x: str) -> None:
    # limit the exponent: a Fraction of "1e999999999" would exhaust the memory
    if not re.fullmatch(r"[+-]?\d+(/0*[1-9]\d*|(\.\d*)?([eE][+-]?\d{1,2})?)", x):
        text = f"{where}: {truncated(x)}: expected a decimal such as '1e-12', or a fraction such as '1/6'"
        raise SceneError(text, id="method-coefficients")
