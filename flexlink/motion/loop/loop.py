"""loop(scene): the closed loop of an arm and its controller about a state, as the processor sees it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, require_callable, require_one_of, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import drawing_module
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list, truncated
from flexlink.describe.scene import Scene
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.inputs.record import Drive
from flexlink.motion.inputs.drives import resampled
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.loop.law import LinearLaw, OpenLoop, growth_of, law_in_python, law_of_drive, open_loop
from flexlink.motion.loop.plant import Plant, plant_of
from flexlink.motion.loop.response import Margins, Response, classical_margins
from flexlink.motion.sampled_control import Law, takes_sensors


class Pole(NamedTuple):
    """A pole of the closed loop."""

    z: complex  # factor per sampling period; for a continuous law, the eigenvalue s [1/s]
    s: complex  # eigenvalue [1/s], ln(z)/T; frequencies above half the rate appear below it
    motion: str  # what moves: "bending of 'boom'", "joint 'boom'", or "controller"

    @property
    def hertz(self) -> float:
        """Frequency [Hz]; 0 if the motion does not oscillate."""
        return abs(self.s.imag) / (2 * np.pi)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Loop:
    """Small motion of an arm under its controller about a state."""

    scene: Scene
    rate: float  # of sampling [Hz], 0 for a continuous law, and delay of the torques [s]
    delay: float
    plant: Plant  # the linear arm, held at rest
    law: LinearLaw
    drive: Drive  # of the scene
    control: Law | None = None  # law in Python that replaces it
    about: tuple[Array | None, float | None] = (None, None)  # angles (n,) [rad] and time [s]; None: at the start

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs at which the loop can be broken, such as "tau upper [N m]"."""
        return self.plant.inputs

    @functools.cached_property
    def poles(self) -> tuple[Pole, ...]:
        """Poles, fastest growing first; one of each conjugate pair."""
        λ, shapes = np.linalg.eig(self._open.closed(self.law))
        order = np.argsort(-(np.abs(λ) if self.rate else λ.real), kind="stable")
        order = order[λ[order].imag >= 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.log(λ.astype(complex)) * self.rate if self.rate else λ.astype(complex)
        s = np.where(np.isfinite(s), s, -np.inf)
        moving = [self.plant.shape(shapes[:, k]) * (abs(λ[k]) > 1e-9 or not self.rate) for k in order]
        names = motions(self.plant.chain, self.plant.q, moving, s[order])
        return tuple(Pole(complex(λ[k]), complex(s[k]), name) for k, name in zip(order, names, strict=True))

    @functools.cached_property
    def growth(self) -> float:
        """Growth factor of small motion per sampling period, |z|max; per second for a continuous law."""
        return growth_of(self._open.closed(self.law), self._open.period)

    @property
    def stable(self) -> bool:
        """Whether small motion does not grow, up to rounding."""
        return self.growth <= STABLE

    @functools.cached_property
    def margins(self) -> tuple[Margins, ...]:
        """Margins of the loop broken at each input, the others closed; nan if the loop is unstable."""
        if not self.stable:
            nan = float("nan")
            return tuple(Margins(name, (nan, nan), *[nan] * 5) for name in self.inputs)
        found = [classical_margins(Response(self._open, self.law, i), name) for i, name in enumerate(self.inputs)]
        return tuple(each._replace(delay=self._delay_margin(i, each.delay)) for i, each in enumerate(found))

    def response(self, hertz: ArrayLike, input: int | str = 0) -> Complex:
        """Frequency response L of the loop broken at an input, shape (k,); the closed loop is stable about 1 + L ≠ 0.

        `hertz`: frequencies, (k,) [Hz], up to half the sampling rate; `input`: its number or name. Others are refused.
        """
        f = np.atleast_1d(np.asarray(hertz, np.float64))
        top = self.rate / 2 if self.rate else np.inf
        if f.ndim != 1 or not (np.isfinite(f).all() and (f >= 0).all() and (f <= top).all()):
            raise ArgumentError(f"hertz = {truncated(hertz)}: expected frequencies in 0 … {top:g} Hz", id="wrong-value")
        return Response(self._open, self.law, self._number(input))(2 * np.pi * f)

    def largest(self, path: str = "drive.delay") -> float:
        """Largest value of a number of the scene with which the loop is stable, at the first boundary from its value.

        Parameters
        ----------
        path
            "drive.delay" [s], "drive.rate" [Hz] (the smallest stable rate), "gain", a factor of all torques of the law,
            or any number of the scene, such as "drive.kd" or "tip.mass"; lists are scaled together, by the result.

        Returns
        -------
        float
            The value, right to 1e-6 of it; inf if the loop remains stable, 0 if no value is stable.

        Raises
        ------
        ArgumentError, SceneError
            The scene has no such number, or the number is zero.

        Examples
        --------
        >>> drive = fl.Drive(
        ...     kind="pd", kp=(2e4, 1e4), kd=(600.0, 250.0), gravity="static", target_deg=(40.0, -60.0), rate=1000.0
        ... )
        >>> loop = fl.loop(scene.varied({"drive": drive}))
        >>> print(loop.stable, f"{1e3 * loop.largest('drive.delay'):.2f} ms")
        True 0.00 ms
        """
        if path in {"drive.delay", "drive.rate"} and not self.rate:
            raise ArgumentError(f"path = {path!r}: the law is not sampled; specify drive.rate", id="no-effect")
        if path == "drive.delay":
            start = self.delay if self.delay and self.stable else 0.01 / self.rate
            if self.growth_with(delay=0.0) > STABLE or self.growth_with(delay=start) > STABLE:
                return 0.0
            return boundary(lambda value: self.growth_with(delay=value), start, up=True, factor=1.15, most=70)
        if path == "drive.rate":
            # each sampling period of delay adds states; a loop so late is not looked at
            most = 100 / self.delay if self.delay else np.inf
            changed = lambda rate: self.growth_with(rate=rate) if rate < most else np.inf  # noqa: E731
            return boundary(changed, self.rate, up=not self.stable)
        if path == "gain":
            return boundary(lambda gain: self.growth_with(gain=gain), 1.0, up=self.stable)
        changes, start = number_at(self.scene, path)
        return boundary(lambda x: self.with_scene(self.scene.varied(changes(x))).growth, start, up=self.stable)

    def over(self, path: str, values: Sequence[float]) -> list[Loop]:
        """Loops of the scene with other values of a number, for a root locus; errors as in `Scene.varied`."""
        return [self.varied(path, value) for value in values]

    def varied(self, path: str, value: object) -> Loop:
        """The loop of the scene with another value, with the same law in Python; errors as in `Scene.varied`."""
        return self.with_scene(self.scene.varied({path: value}))

    def with_scene(self, scene: Scene) -> Loop:
        """The loop of another scene with the same law in Python; errors as in `loop`."""
        q, t = self.about
        return loop(scene, control=self.control, rate=self.rate or None, delay=self.delay, q=q, t=t)

    def plot(self, kind: str = "bode", input: int | str = 0, *, ax: Any = None) -> Any:
        """Draw the loop broken at an input, "bode" or "nyquist", or its "poles"; return a matplotlib Figure.

        It is that of `ax`, axes to draw in, two for "bode", else one, or a new one.
        """
        require_one_of("kind", kind, dict.fromkeys(("bode", "nyquist", "poles")))
        drawing = drawing_module("results.plotting")
        if kind == "poles":
            return drawing.plot_poles(
                [[pole.z for pole in self.poles]], sampled=bool(self.rate), title=repr(self), ax=ax
            )
        L = Response(self._open, self.law, self._number(input))
        ω = L.grid()
        return getattr(drawing, f"plot_{kind}")(ω / (2 * np.pi), L(ω), title=self.inputs[self._number(input)], ax=ax)

    def __repr__(self) -> str:
        how = f"{self.rate:g} Hz, {1e3 * self.delay:g} ms" if self.rate else "continuous"
        verdict = "stable" if self.stable else "unstable"
        growth = f"growth {self.growth:.6g} {'a sample' if self.rate else 'a second'}"
        return f"<Loop {self.plant.chain.name!r}: {how}, {verdict}, {growth}, {short_list(self.inputs)}>"

    @functools.cached_property
    def _open(self) -> OpenLoop:
        return open_loop(self.plant, self.rate, self.delay)

    @functools.cached_property
    def growth_without(self) -> float:
        """Growth factor without the controller, per sampling period or per second."""
        size = len(self.plant.A)
        return growth_of(self._open.A[:size, :size], self._open.period)

    def growth_with(self, *, rate: float | None = None, delay: ArrayLike | None = None, gain: float = 1.0) -> float:
        """Growth factor with another rate [Hz], delay [s] (one or per input), or torques times a gain."""
        law = self.law
        if rate is not None and len(law.F):
            law = law_of_drive(resampled(self.drive, self.scene, self.plant.chain, rate), self.plant)
        rate, delay = self.rate if rate is None else rate, self.delay if delay is None else delay
        open_, law = open_loop(self.plant, rate, delay), law._replace(H=gain * law.H, K=gain * law.K)
        return growth_of(open_.closed(law), open_.period)

    def _delay_margin(self, i: int, estimate: float) -> float:
        """Largest additional delay of input i [s], with its exact effect within a sampling period."""
        # after many periods, that effect is small, and the loop has many states
        if not self.rate or not estimate * self.rate < 50:
            return estimate
        unit = np.eye(len(self.inputs))[i]
        return boundary(lambda x: self.growth_with(delay=self.delay + x * unit), estimate / 20, up=True, factor=1.1)

    def _number(self, name: int | str) -> int:
        """Number of an input, given by its number, its name, or the name of its joint."""
        numbers = {name: k for k, name in enumerate(self.inputs)}
        if isinstance(name, str):
            return require_one_of("input", name, {each.split(" ")[1]: k for each, k in numbers.items()} | numbers)
        if 0 <= name < len(self.inputs):
            return int(name)
        raise ArgumentError(f"input = {name!r}: allowed are 0 … {len(self.inputs) - 1}", id="wrong-value")


def loop(
    scene: Scene, *, control: Law | None = None, rate: float | None = None, delay: float = 0.0,
    q: ArrayLike | None = None, t: float | None = None,
) -> Loop:  # fmt: skip
    """The closed loop of an arm and its controller, linearized about a state in which the arm is held at rest.

    The controller is the drive of the scene, or a law in Python by its slopes. A sampled controller sees the state at
    t_k = k / rate, and its torques act from t_k + delay until t_k+1 + delay. All of it is exact for small motion,
    except for low-pass filters and notches of sensors, which filter the continuous signal. Torque limits are left out.

    Parameters
    ----------
    scene
        Arm, drive and initial state.
    control, rate, delay
        Law tau(t, q, qd) or tau(t, q, qd, sensors) in place of the scene's drive, its sampling rate [Hz] (None: it is
        continuous), and the delay of its torques [s]. A law with a memory is refused.
    q, t
        Angles (n,) [rad] and time [s] about which the loop is linearized; default: the start of the scene.

    Returns
    -------
    Loop
        `poles`, `growth`, `stable`, `margins`, `response`, `largest`, `over` and `plot`.

    Raises
    ------
    ArgumentError
        The scene has no controller, or the law cannot be linearized.
    SceneError, ConvergenceError, SingularMassError
        As in `simulate` and `linearize`.

    Examples
    --------
    >>> drive = fl.Drive(
    ...     kind="pd", kp=(2e4, 1e4), kd=(60.0, 25.0), gravity="static", target_deg=(40.0, -60.0), rate=1000.0
    ... )
    >>> controlled = scene.varied({"drive": drive})
    >>> found = fl.loop(controlled)
    >>> print(found.stable, found.margins[0].input)
    True tau upper [N m]
    """
    require_type("scene", scene, Scene)
    require_callable("control", control)
    if control is not None and scene.drive.kind != "none":
        remedy = "specify only one: scene.varied({'drive': None}) removes the drive"
        raise ArgumentError(f"control: the scene also has a drive, {scene.drive.kind!r}; {remedy}", id="both-given")
    if control is None and not scene.drive.controls:
        why = f"drive kind {scene.drive.kind!r} has no feedback, so there is no loop"
        raise ArgumentError(f"scene: {why}; use a drive such as 'pd', or specify control", id="no-feedback")
    problem = problem_of(scene)
    q = None if q is None else vector("q", q, problem.chain.n)
    return loop_of(problem, (q, t), control, rate, delay)


def loop_of(
    problem: InitialValueProblem, about: tuple[Array | None, float | None] = (None, None), control: Law | None = None,
    rate: float | None = None, delay: float = 0.0,
) -> Loop:  # fmt: skip
    """The loop of a problem about angles q (n,) and a time t [s]; None: at its start."""
    periods = delay * rate if control is not None and rate else problem.inputs.drive.delay * problem.inputs.drive.rate
    most = 300  # eigenvalues of 300 states take 0.1 s
    if periods > most:
        why = f"delay: {periods:.6g} sampling periods; at most {most}, each of which adds a state; give it in s"
        raise ArgumentError(why, id="loop-too-late")
    q, t = problem.q if about[0] is None else about[0], problem.start if about[1] is None else float(about[1])
    plant = plant_of(problem, q, t, sensors=control is not None and takes_sensors(control))
    drive = problem.inputs.drive
    if control is None:
        return Loop(problem.scene, drive.rate, drive.delay, plant, law_of_drive(drive, plant), drive, None, about)
    hertz = 0.0 if rate is None else positive("rate", rate)
    late = positive("delay", delay) if delay else 0.0
    if late and not hertz:
        raise ArgumentError(f"delay = {delay!r}: needs rate, the sampling rate of the law [Hz]", id="no-effect")
    return Loop(problem.scene, hertz, late, plant, law_in_python(control, plant), drive, control, about)


# Names of the motions that belong to poles: the link that bends, or the joint that turns.
#
# A motion with shape φ is a vibration of a link if the springs between its segments hold most of its energy, φ* K φ > ½
# |s|² φ* M φ; it is named after the link whose springs hold most, and after their axes. Otherwise it is named after the
# driven joint with the largest M_kk |φ_k|².


CONTROLLER = "controller"  # name of motions in which the arm rests: torques on their way, and states of the law


def motions(chain: Chain, q: Array, shapes: Sequence[Complex], s: Complex) -> list[str]:
    """Name of every motion with shape (n,) and eigenvalue s [1/s], such as "bending of 'boom'" or "joint 'boom'"."""
    M, k = mass_matrix(chain, q), np.where(chain.held, 0.0, chain.stiffness)
    return [_motion(chain, M, k, φ, abs(each)) for φ, each in zip(shapes, s, strict=True)]


def _motion(chain: Chain, M: Array, k: Array, φ: Complex, size: float) -> str:
    weight = np.sqrt(np.diag(M)) * np.abs(φ)
    if not np.isfinite(weight).all() or not weight.any():
        return CONTROLLER
    springs, kinetic = k * np.abs(φ) ** 2, size**2 * float(np.real(φ.conj() @ M @ φ))
    if springs.sum() > 0.5 * kinetic and springs.any():
        return _of_springs(chain, springs)
    driven = chain.active if len(chain.active) else np.arange(chain.n)
    return f"joint {chain.joint_name(int(driven[np.argmax(weight[driven])]))!r}"


def _of_springs(chain: Chain, springs: Array) -> str:
    energy: dict[tuple[int, str], float] = {}
    for k in np.flatnonzero(springs).tolist():
        at = chain.coordinates[k]
        energy[at.link, at.spring] = energy.get((at.link, at.spring), 0.0) + float(springs[k])
    (link, kind), _ = max(energy.items(), key=lambda each: each[1])
    return f"{kind} of {chain.link_names[link - 1]!r}"


STABLE = 1.0 + 1e-6
"""Growth factor up to which a loop counts as stable; rigid motion, with poles at 1, is computed to about 1e-8."""


def boundary(growth: Callable[[float], float], start: float, *, up: bool, factor: float = 1.3, most: int = 60) -> float:
    """The value at which growth(value) crosses `STABLE` on the way from `start`, which `factor` changes step by step.

    From a stable start it is the last stable value, upwards or downwards; from an unstable one the first stable one.
    Without a crossing within `most` steps, it is inf or 0 from a stable start, and nan from an unstable one.
    """
    stable, value = growth(start) <= STABLE, start
    for _ in range(most):
        value, before = value * factor if up else value / factor, value
        if (growth(value) <= STABLE) is not stable:
            return _between(growth, before, value) if stable else _between(growth, value, before)
    return float("nan") if not stable else float("inf") if up else 0.0


def _between(growth: Callable[[float], float], stable: float, unstable: float) -> float:
    """A stable value within 1e-6 of the boundary between a stable and an unstable value."""
    while abs(unstable - stable) > 1e-6 * abs(stable):
        middle = (stable + unstable) / 2
        stable, unstable = (middle, unstable) if growth(middle) <= STABLE else (stable, middle)
    return stable


def number_at(scene: Scene, path: str) -> tuple[Callable[[float], dict[str, Any]], float]:
    """Changes of a scene that set the number at a path, and its value; a list is scaled, so that its value is 1."""
    values = scene.values_at(path)
    now = np.asarray(values[0], dtype=object)
    kinds = {type(each) for each in now.ravel().tolist()}
    if any(each != values[0] for each in values) or not kinds <= {int, float} or not now.any():
        given = truncated(values[0] if len(values) == 1 else values)
        text = f"path = {path!r}: is {given} in the scene; expected a number other than 0"
        raise ArgumentError(text, id="wrong-value")
    if now.ndim:
        return lambda factor: {path: tuple((factor * now).tolist())}, 1.0
    return lambda value: {path: value}, float(now[()])
