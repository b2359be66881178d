"""LinearModel: matrices of a linear model with the names of its signals, its poles, and its conversions."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import integer, positive, real_array
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, imported
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural, truncated
from flexlink.dynamics.filters import LinearFilter, linear_filter
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.vibration.derived_models import balanced_part, delay_in, discrete, slow_part

FILTER = "filter "  # prefix in the names of filter states


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class LinearModel(SavedResult):
    """δẋ = A δx + B δu, δy = C δx + D δu about a state, at which ẋ = `rate` and y = `y`.

    With `dt` > 0 it is a discrete-time model, x_k+1 = A x_k + B u_k. For the design of controllers use a `reduced`
    model: SciPy and python-control lose all digits on models of many stiff states. `scipy()` and `control()` convert.
    """

    A: Array  # (2n + f, 2n + f), f states of the sensors' filters; in SI units and radians
    B: Array  # (2n + f, m)
    C: Array  # (p, 2n + f)
    D: Array  # (p, m)
    x: Array  # state (q, q̇, z), inputs and outputs about which the model is linearized, (2n + f,), (m,), (p,)
    u: Array
    y: Array
    rate: Array  # ẋ = (q̇, q̈, ż) at x, (2n + f,); zero at an equilibrium
    states: tuple[str, ...]  # names with units: "q upper [rad]", "tau upper [N m]", "tip x [m]"
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    delays: Array  # of each output relative to C δx + D δu [s], (p,); zero except for sensors with a delay
    dt: float = 0.0  # sampling period [s]; 0: continuous time

    @property
    def eigenvalues(self) -> Complex:
        """λ of A [1/s], (2n + f,), slowest first: of the arm from the `graded` matrix, of the filters separately."""
        if self.dt:
            z = scipy.linalg.eigvals(self.A)
            return np.asarray(z[np.argsort(-np.abs(z), kind="stable")])
        n2 = len([name for name in self.states if not name.startswith(FILTER)])
        own = self.A[:n2, :n2]
        angles = sum(name.startswith("q ") for name in self.states)  # internal coordinates have only a rate
        λ = np.diag(scipy.linalg.schur(graded(own) if 2 * angles == n2 else own, output="complex")[0])
        if n2 < len(self.A):
            λ = np.concatenate([λ, scipy.linalg.eigvals(self.A[n2:, n2:])])
        return np.asarray(λ[np.argsort(np.abs(λ), kind="stable")])

    def frequency_response(self, hertz: ArrayLike) -> Complex:
        """H(f) = (C (iω − A)⁻¹ B + D) e^{−iω delays}, ω = 2πf: response of every output to every input.

        In discrete time e^{iω dt} takes the place of iω.

        Parameters
        ----------
        hertz
            Frequencies f, shape (k,) [Hz].

        Returns
        -------
        ndarray
            Amplitude and phase of the outputs for inputs e^{iωt} of unit amplitude, shape (k, p, m).

        Raises
        ------
        ArgumentError
            A frequency is negative or not finite, or a pole of the undamped model.

        Examples
        --------
        >>> rest = fl.solve_static(chain, q, locked=chain.active)
        >>> model = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("joint_rates",))
        >>> H = model.frequency_response([2.0, 5.0, 10.0])
        >>> print(H.shape)
        (3, 2, 2)
        """
        f = real_array("hertz", hertz, (-1,))
        if f.ndim != 1 or not (np.isfinite(f).all() and (f >= 0).all()):
            why = f"hertz = {truncated(hertz)}: expected finite frequencies >= 0, shape (k,)"
            raise ArgumentError(why, id="wrong-value")
        one, found = np.eye(len(self.A)), np.empty((len(f), *self.D.shape), complex)
        for k, s in enumerate(np.exp(2j * np.pi * f * self.dt) if self.dt else 2j * np.pi * f):
            left = s * one - self.A
            size = np.abs(left).max(axis=1, keepdims=True)  # equal rows: a stiff joint does not hide slow motions
            try:
                found[k] = self.C @ np.linalg.solve(left / size, self.B / size) + self.D
            except np.linalg.LinAlgError:
                why = f"hertz = {f[k]:g}: the response is infinite, since the model has a pole there"
                raise ArgumentError(why, id="infinite-response") from None
        return np.asarray(found * np.exp(-2j * np.pi * f[:, None] * self.delays)[:, :, None])

    def sampled(self, rate: float, delay: float = 0.0) -> "LinearModel":
        """Exact discrete-time model of the arm as a controller sees it that samples at a rate and holds its outputs.

        Parameters
        ----------
        rate
            Sampling rate [Hz].
        delay
            Time from a sampling instant until the inputs computed from it act [s], any, also parts of a period.

        Returns
        -------
        LinearModel
            x_k+1 = A x_k + B u_k, y_k = C x_k + D u_k with `dt` = 1 / rate. Inputs on their way and delayed outputs
            are states; `delays` are zero, since the model contains them.

        Raises
        ------
        ArgumentError
            The model is sampled already, the rate is not positive, or the delay negative.

        Examples
        --------
        >>> rest = fl.solve_static(chain, q, locked=chain.active)
        >>> model = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("joints", "joint_rates"))
        >>> print(model.sampled(1000.0, delay=0.0015))
        <LinearModel: 16 states, 2 inputs, 4 outputs, every 0.001 s>
        """
        self._require_continuous()
        period, late = 1.0 / positive("rate", rate), positive("delay", delay) if delay else 0.0
        (A, B, C, D), queues = discrete((self.A, self.B, self.C, self.D), period, late, self.delays)
        if not np.isfinite(np.hstack([A, B])).all():
            why = f"one sample every {period:g} s, in which the model grows beyond float64; rates are in Hz"
            raise ArgumentError(f"rate = {rate!r}: {why}", id="overflow")
        ago, names = delay_in(period, late).samples, zip(self.outputs, queues, strict=True)
        states = [f"{name}, {k} ago" for name in self.inputs for k in range(1, ago + 1)]
        states += [f"{name}, {k} ago" for name, count in names for k in range(1, count + 1)]
        x = np.concatenate([self.x, np.repeat(self.u, ago), np.repeat(self.y, queues)])
        return dataclasses.replace(
            self, A=A, B=B, C=C, D=D, x=x, rate=np.zeros(len(x)), states=(*self.states, *states),
            delays=np.zeros(len(self.y)), dt=period,
        )  # fmt: skip

    def reduced(self, states: int | None = None, *, hertz: float | None = None) -> "LinearModel":
        """Model of the slowest states, with the static response of all others: modal truncation.

        Far below the frequency of the first state that is left out, the response is that of the full model: the eight
        slowest states of the paper's arm of 84 are right to 1e-4 up to 8 Hz. Compare `frequency_response` of both
        models over the range that matters.

        Parameters
        ----------
        states
            Number of states, two per mode of vibration; one more where a complex pair would be parted.
        hertz
            Instead of `states`: all with |λ| ≤ 2π hertz.

        Returns
        -------
        LinearModel
            States "slow 1" …, coordinates of the slow motion, zero at the operating point; the same inputs and outputs.

        Raises
        ------
        ArgumentError
            The model is sampled already, both arguments or none are given, or the number is not in 1 … 2n + f.

        Examples
        --------
        >>> rest = fl.solve_static(chain, q, locked=chain.active)
        >>> model = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("joints",))
        >>> small = model.reduced(8)
        >>> H, h = (m.frequency_response([1.0, 2.0]) for m in (model, small))
        >>> print(small, abs(H - h).max() < 1e-3 * abs(H).max())
        <LinearModel: 8 states, 2 inputs, 2 outputs> True
        """
        self._require_continuous()
        if (states is None) == (hertz is None):
            why = f"states = {states!r}, hertz = {hertz!r}: specify one of them, such as states = 8"
            raise ArgumentError(why, id="both-given")
        if hertz is not None:
            states = int((np.abs(self.eigenvalues) <= 2 * np.pi * positive("hertz", hertz)).sum())
        A, V, W, static = slow_part(self.A, self.B, self.C, integer("states", states, 1, len(self.A)))
        names = tuple(f"slow {k}" for k in range(1, len(A) + 1))
        return dataclasses.replace(
            self, A=A, B=W.T @ self.B, C=self.C @ V, D=self.D + self.C @ static,
            x=np.zeros(len(A)), rate=W.T @ self.rate, states=names,
        )  # fmt: skip

    def balanced(self, states: int) -> "tuple[LinearModel, float]":
        """Model of the states that matter most from inputs to outputs, and the largest error of its response.

        Balanced singular perturbation, with the static gain kept. It leaves out states that inputs hardly excite or
        outputs hardly show, however slow they are. A model with many more states is `reduced` to four times `states`
        first, since Gramians of stiff models have no digits.

        Parameters
        ----------
        states
            Number of states.

        Returns
        -------
        model
            States "balanced 1" …, zero at the operating point; the same inputs and outputs.
        bound
            Bound of the error of every frequency response, relative to the model that is balanced, 2 Σ σ_k in SI units.

        Raises
        ------
        ArgumentError
            The model is sampled already, is not asymptotically stable, or has fewer states.

        Examples
        --------
        >>> damped = scene.varied({"link.*.damping": fl.Damping(ratio=0.02, at_hz=5.0), "link.*.joint.viscous": 20.0})
        >>> chain = fl.lump(damped)
        >>> rest = fl.solve_static(chain, q, locked=chain.active)
        >>> gauge = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("tip_rate",))
        >>> small, bound = gauge.balanced(6)
        >>> print(small)
        <LinearModel: 6 states, 2 inputs, 3 outputs>
        """
        self._require_continuous()
        states = integer("states", states, 1, len(self.A))
        start = self.reduced(4 * states) if len(self.A) > 4 * states else self
        slowest = float(np.linalg.eigvals(start.A).real.max())
        if slowest >= -1e-9 * float(np.abs(start.A).max()):
            why = f"the model has an eigenvalue with real part {slowest:.3g} 1/s, so it is not stable"
            remedy = "give links damping and joints friction, or use reduced"
            raise ArgumentError(f"balanced: {why}; {remedy}", id="not-stable")
        (A, B, C, D), reduce, bound = balanced_part(start.A, start.B, start.C, start.D, states)
        names = tuple(f"balanced {k}" for k in range(1, states + 1))
        rate = reduce @ start.rate
        return dataclasses.replace(self, A=A, B=B, C=C, D=D, x=np.zeros(states), rate=rate, states=names), bound

    def control(self) -> Any:
        """The model as a `StateSpace` of python-control, with the names of states, inputs and outputs.

        In names, "_" replaces ".", which python-control does not allow. Its attribute `operating_point` is a dict of x,
        u and y, about which the model is linearized.

        Raises
        ------
        MissingDependencyError
            python-control is not installed.
        ArgumentError
            An output has a delay, which only the `sampled` model contains.
        """
        self._require_no_delay()
        ss = imported("control", "control() needs python-control;", "control").ss
        lists = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        names = {kind: [name.replace(".", "_") for name in each] for kind, each in lists.items()}
        system = ss(self.A, self.B, self.C, self.D, self.dt, **names)
        system.operating_point = {"x": self.x, "u": self.u, "y": self.y}
        return system

    def scipy(self) -> Any:
        """The model as a `scipy.signal.StateSpace`.

        Raises
        ------
        ArgumentError
            An output has a delay, which only the `sampled` model contains.
        """
        self._require_no_delay()
        from scipy.signal import StateSpace  # noqa: PLC0415

        return StateSpace(self.A, self.B, self.C, self.D, **({"dt": self.dt} if self.dt else {}))

    def _require_continuous(self) -> None:
        if self.dt:
            why = f"model: sampled every {self.dt:g} s; expected a continuous-time model, as from linearize"
            raise ArgumentError(why, id="wrong-type")

    def _require_no_delay(self) -> None:
        if self.delays.any():
            late = f"output {self.outputs[int(np.argmax(self.delays))]!r} is {self.delays.max():g} s late"
            raise ArgumentError(f"delays: {late}; use model.sampled(rate), which contains delays", id="delayed-output")

    def __repr__(self) -> str:
        late = f", delayed by up to {self.delays.max():g} s" if self.delays.any() else ""
        late += f", every {self.dt:g} s" if self.dt else ""
        parts = ((self.x, "state"), (self.u, "input"), (self.y, "output"))
        return f"<LinearModel: {', '.join(plural(len(names), noun) for names, noun in parts)}{late}>"


def graded(A: Array) -> Array:
    """Return a similar matrix whose rows decrease in size, for which eigenvalue solvers find slow λ accurately.

    The λ of stiff arms range from 0.01 to 1e5 1/s, and rounding may change each by 2n eps ‖A‖. If the rows decrease in
    size, the slow λ change only by 2n eps times the last rows. Joints are sorted by ω² = |∂q̈_k/∂q_k|, with each angle
    next to its rate. Angles are multiplied by ω, so each diagonal block of A is | 0 ω | −ω 0 |.
    """
    n = len(A) // 2
    ω = rates(np.diag(A[n:, :n]))
    scale, fast = np.concatenate([ω, np.ones(n)]), np.argsort(-ω, kind="stable")
    order = np.column_stack([fast, n + fast]).ravel()
    return np.asarray((A * scale[:, None] / scale)[np.ix_(order, order)])


def rates(slopes: Array) -> Array:
    """ω = √|∂q̈_k/∂q_k| of every angle [1/s], at least 1, as a unit of the angle.

    If nothing holds an angle, ω is rounding, such as 1e-16, and its column of ∂q̈/∂q is up to eps ω_max². Divided by 1,
    the column remains less than ω_max for every ω_max < 1/eps.
    """
    return np.maximum(np.sqrt(np.abs(slopes)), 1.0)


class Output(NamedTuple):
    """Outputs y = gain · s + bias of signals s, with their derivatives; filters and a delay may follow."""

    names: tuple[str, ...]
    signal: Array  # (p,) s
    q: Array  # (p, n) ∂s/∂q
    qd: Array  # (p, n) ∂s/∂q̇
    qdd: Array | None = None  # (p, n) ∂s/∂q̈; None: zero
    tau: Array | None = None  # (p, n) ∂s/∂T_EX; None: zero
    gain: float = 1.0
    bias: float = 0.0
    filter: LinearFilter = linear_filter(())
    delay: float = 0.0  # [s]

    @property
    def values(self) -> Array:
        """Outputs y (p,) for constant signals."""
        return self.gain * self.filter.gain * self.signal + self.bias


class OutputSource(Protocol):
    """An object that provides outputs, such as the sensors of a scene."""

    def outputs(self, chain: Chain, q: Array, qd: Array, qdd: Array, tau: Array) -> Sequence[Output]:
        """Return its outputs at a state (n,)."""


def joints_as(chain: Chain, joints: Sequence[int] | NDArray[np.intp], pattern: str) -> tuple[str, ...]:
    """Names of joints with their units, by a pattern such as "q {} [{}]"."""
    return tuple(pattern.format(chain.joint_name(int(k)), chain.joint_units[k]) for k in joints)


def _tip(chain: Chain, q: Array, qd: Array) -> Output:
    J = jacobian(chain, q).linear
    return Output(tuple(f"tip {axis} [m]" for axis in "xyz"), tip_position(chain, q), J, np.zeros_like(J))


def _tip_rate(chain: Chain, q: Array, qd: Array) -> Output:
    """v = Σ q̇_k J_k with ∂v/∂q_j = e_j × Σ_{k ≥ j} q̇_k J_k + Σ_{k < j} q̇_k e_k × J_j."""
    tip = jacobian(chain, q)
    J, e = tip.linear, tip.angular
    turning, moving = e * qd, J * qd
    before = np.cumsum(turning, axis=1) - turning
    slope = np.cross(e, np.cumsum(moving[:, ::-1], axis=1)[:, ::-1], axis=0) + np.cross(before, J, axis=0)
    return Output(tuple(f"tip rate {axis} [m/s]" for axis in "xyz"), J @ qd, slope, J)


def _joints(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return Output(joints_as(chain, chain.active, "q {} [{}]"), q[chain.active], pick, np.zeros_like(pick))


def _joint_rates(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return Output(joints_as(chain, chain.active, "qd {} [{}/s]"), qd[chain.active], np.zeros_like(pick), pick)


def _state(chain: Chain, q: Array, qd: Array) -> Output:
    every, unit = range(chain.n), np.eye(2 * chain.n)
    names = joints_as(chain, every, "q {} [{}]") + joints_as(chain, every, "qd {} [{}/s]")
    return Output(names, np.concatenate([q, qd]), unit[:, : chain.n], unit[:, chain.n :])


OUTPUTS: dict[str, Callable[[Chain, Array, Array], Output]] = {
    "tip": _tip, "tip_rate": _tip_rate, "joints": _joints, "joint_rates": _joint_rates, "state": _state,
}  # fmt: skip
