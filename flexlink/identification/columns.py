"""Residuals of every measured column: before and after the fit, with a free linear model, and beside its noise."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.steady import modes_at_rest, rest_of
from flexlink.identification.block import Block, colour_of, noise_in, outlying, whiteness
from flexlink.identification.coordinates import guess_of, run_coordinates
from flexlink.identification.data import Source, at_times
from flexlink.identification.fitted import FittedColumn
from flexlink.identification.likelihood import Likelihood, Row, likelihood, row_of, white
from flexlink.identification.problem import FitProblem, FitRun
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found, Search
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate


def columns_of(
    problem: FitProblem, signals: Signals, best: Found, start: Array, kept: Sequence[Source],
    report: Callable[[str], None],
) -> tuple[FittedColumn, ...]:  # fmt: skip
    """All columns: first the fitted ones, then the columns of the sources `kept` to check the fit."""
    before = likelihood(signals, start, [[white(block) for block in part] for part in best.blocks])
    after = likelihood(signals, best.x, best.blocks)
    found, gains = _beside(before, after), _gains(after.every)
    noises = {row.block.name: _noise(row.block) for row in after.every}
    values = {one.path: one.value(float(x)) for one, x in zip(signals.coordinates, best.x, strict=True) if not one.run}
    fitted = [(one, signals.scene(k, best.x)) for k, one in enumerate(signals.sources) if one.is_run]
    checks: list[tuple[Source, Scene]] = []
    for source in kept:
        source.blocks = tuple(_known(block, gains, noises) for block in source.blocks)
        columns, scene = _kept(problem, source, values, gains)
        found += columns
        checks += [(source, scene)] if source.is_run else []
        report(f"checked against {source.name}")
    linear = linear_models(fitted, checks)
    return tuple(dataclasses.replace(one, linear=linear.get((one.source, one.name))) for one in found)


def _kept(
    problem: FitProblem, source: Source, values: dict[str, float], gains: dict[str, float]
) -> tuple[list[FittedColumn], Scene]:
    """Columns and scene of a source that was not fitted, after estimating only the parameters specific to this run."""
    this_run = next((run for run in problem.run if run.name == source.name), None)
    coordinates = run_coordinates(problem, this_run) if this_run is not None else []
    signals, x = Signals([source], coordinates), guess_of(coordinates)
    before = likelihood(signals, _best(signals, problem, x), [source.blocks])
    source.scene = source.scene.varied(values)
    signals = Signals([source], coordinates)
    x = _best(signals, problem, x)
    rows = [row_of(b, gains.get(b.name, 1.0) * y) for b, y in zip(source.blocks, signals.model(x)[0], strict=True)]
    columns = _beside(before, before._replace(rows=[rows]))
    columns = [dataclasses.replace(one, gain=gains.get(one.name, one.gain)) for one in columns]
    return columns, signals.scene(0, x)


def _best(signals: Signals, problem: FitProblem, x: Array) -> Array:
    return Search(signals, problem.loss).from_start(x).x if len(x) else x


def _beside(before: Likelihood, after: Likelihood) -> list[FittedColumn]:
    found = []
    for source, old, new in zip(after.sources, before.rows, after.rows, strict=True):
        for was, now in zip(old, new, strict=True):
            block, residual = now.block, now.shown - now.block.y
            found.append(FittedColumn(
                source=source.name, name=block.name, use=source.use, t=block.t, measured=block.y, before=was.shown,
                after=now.shown, linear=None, gain=now.gain, bias=now.bias, noise=_noise(block),
                stated=block.stated, times_noise=float(np.sqrt(np.mean((residual / white(block).σ) ** 2))),
                whiteness=whiteness(residual) if block.t is not None else float("nan"),
            ))  # fmt: skip
    return found


def _noise(block: Block) -> float:
    """Root mean square of the standard deviation of a block's noise."""
    return float(np.sqrt(np.mean(white(block).σ ** 2)))


def _gains(rows: Sequence[Row]) -> dict[str, float]:
    """Estimated gain of each column, averaged over the runs that contain the column."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row.block.gain:
            found.setdefault(row.block.name, []).append(row.gain)
    return {name: float(np.mean(several)) for name, several in found.items()}


def _known(block: Block, gains: dict[str, float], noises: dict[str, float]) -> Block:
    """A check block that uses the estimated gain of its column and, if its noise is not stated, the estimated noise."""
    σ = block.σ if block.stated or block.name not in noises else np.full(len(block.y), noises[block.name])
    return dataclasses.replace(block, gain=block.gain and block.name not in gains, σ=σ)


# Fit a free linear model of the same order, which shows whether the scene's parameters or its structure are wrong.
#
#     y_c(t) = Σ_j Re(a_cj e^{λ_j t}) + Σ_u Σ_j Re(b_cju ∫ e^{λ_j (t − s)} u(s) ds) + d_c
#
# The eigenvalues λ_j are estimated, starting from those modes of the fitted scene at rest that the records resolve. The
# inputs u are the accelerations of held joints. The residues b of each column and input are common to all runs; a
# and d are different in each run. All parameters except λ are linear and take their optimal values.


Shapes = dict[tuple[int, bytes], tuple[Array, Array]]
"""Cached basis functions of a run and of its inputs; the keys identify the inputs and the times of a block."""


def linear_models(
    fitted: Sequence[tuple[Source, Scene]], checks: Sequence[tuple[Source, Scene]]
) -> dict[tuple[str, str], Array]:
    """Predictions for all columns of the fitted runs, and of the runs kept to check the fit, by run and column.

    There are none if a linear model does not apply: joints swing freely or follow a controller, or the records resolve
    no mode.
    """
    runs = [*fitted, *checks]
    chains = [lump(open_chain(scene)) for _, scene in runs]
    if not fitted or not all(chain.held[chain.active].all() for chain in chains):
        return {}
    try:
        λ = _modes(fitted[0][1], min(source.rate for source, _ in fitted))
        inputs = [_accelerations(scene) for _, scene in runs]
    except FlexlinkError:
        return {}
    if not len(λ):
        return {}
    columns = sorted({block.name for source, _ in fitted for block in source.blocks})
    start = np.concatenate([np.log(np.abs(λ)), -λ.real / np.abs(λ)])

    def residual(p: Array) -> Array:
        """Residuals with optimal weights, by QR; an SVD takes ten times as long."""
        found, shapes = list[Array](), Shapes()
        for name in columns:
            Φ, target, _ = _stacked(name, _poles(p), fitted, inputs, shapes)
            Q = np.linalg.qr(Φ)[0]
            found.append(Q @ (Q.T @ target) - target)
        return np.concatenate(found)

    far = np.concatenate([np.full(len(λ), 0.7), np.full(len(λ), 0.3)])
    λ = _poles(scipy.optimize.least_squares(residual, start, bounds=(start - far, start + far), max_nfev=40).x)
    shared = dict[str, Array]()
    for name in columns:
        Φ, target, forced = _stacked(name, λ, fitted, inputs, {})
        shared[name] = np.asarray(np.linalg.lstsq(Φ, target, rcond=None)[0][:forced])
    return {
        (source.name, block.name): _given(block.name, λ, source, driven, shared)
        for (source, _), driven in zip(runs, inputs, strict=True)
        for block in source.blocks
    }


def _modes(scene: Scene, rate: float) -> Array:
    """Slowest oscillatory eigenvalues at rest, one of each conjugate pair."""
    shown = 0.35  # highest natural frequency that a record resolves, relative to its sampling rate
    most = 6  # largest number of modes in the linear model
    chain = lump(scene)
    λ = modes_at_rest(chain, rest_of(chain, initial_state(scene, chain)[0])).eigenvalues
    return np.asarray([one for one in λ if 0 < abs(one.imag) < 2 * np.pi * shown * rate][:most])


def _poles(p: Array) -> Array:
    size, ratio = np.exp(p[: len(p) // 2]), np.clip(p[len(p) // 2 :], -0.99, 0.99)
    return np.asarray(size * (-ratio + 1j * np.sqrt(1 - ratio**2)))


def _accelerations(scene: Scene) -> tuple[Array, Array]:
    """Times of a run, shape (samples,), and accelerations of its held joints, shape (samples, joints)."""
    run = simulate(scene)
    rates = run.qd[:, run.chain.held]
    return run.t, np.asarray(scipy.interpolate.CubicSpline(run.t, rates)(run.t, 1)).reshape(rates.shape)


def _shapes(λ: Array, times: Array, driven: tuple[Array, Array]) -> tuple[Array, Array]:
    """Basis functions of the free motion and of the response to inputs, at the times of a block."""
    t, u = driven
    free = np.exp(np.outer(times - t[0], λ))
    free_motion = np.hstack([free.real, free.imag, np.ones((len(times), 1))])
    forced = []
    h = float(t[1] - t[0])
    for one in λ:
        E = np.exp(one * h)
        last = (E - 1 - one * h) / (one**2 * h)  # inputs are linear between samples
        first = (E - 1) / one - last
        for column in u.T:
            z = scipy.signal.lfilter([last, first], [1.0, -E], column.astype(complex))
            forced += [z.real, z.imag]
    return free_motion, at_times(t, np.array(forced).T if forced else np.empty((len(t), 0)), times)


def _stacked(
    name: str, λ: Array, fitted: Sequence[tuple[Source, Scene]], inputs: Sequence[tuple[Array, Array]],
    shapes: Shapes,
) -> tuple[Array, Array, int]:  # fmt: skip
    """Basis functions and measurements of a column of all runs, over the noise; and how many are of inputs."""
    measured = [
        (block, driven)
        for (source, _), driven in zip(fitted, inputs, strict=False)
        for block in source.blocks
        if block.name == name
    ]
    free, forced = list[Array](), list[Array]()
    for block, driven in measured:
        t = np.asarray(block.t)
        key = id(driven), t.tobytes()
        if key not in shapes:
            shapes[key] = _shapes(λ, t, driven)
        free.append(shapes[key][0])
        forced.append(shapes[key][1])
    σ = np.concatenate([block.σ for block, _ in measured])
    Φ = np.hstack([np.vstack(forced), scipy.linalg.block_diag(*free)]) / σ[:, None]
    return Φ, np.concatenate([block.y for block, _ in measured]) / σ, forced[0].shape[1]


def _given(name: str, λ: Array, source: Source, driven: tuple[Array, Array], shared: dict[str, Array]) -> Array:
    """Prediction of one column of a run, with the optimal initial condition and offset."""
    block = next(block for block in source.blocks if block.name == name)
    if name not in shared:
        return np.full(len(block.y), np.nan)
    free_motion, forced = _shapes(λ, np.asarray(block.t), driven)
    by_inputs = forced @ shared[name]
    return np.asarray(by_inputs + free_motion @ np.linalg.lstsq(free_motion, block.y - by_inputs, rcond=None)[0])


# Noise of each column from other sources than the model's residual, and whether the residual is no more than noise.
#
#     F = mean r² / σ²        r the residual, n / Σ ρ² independent samples; σ the noise, from as many as its source has
#
# The noise is the first of these: as stated; the difference of two runs of one scene, over √2; the rest before the
# model moves; the upper part of the spectrum, if it is white there. White noise is as strong at low frequencies, where
# models err, so F is also computed for the lower parts of the residual's spectrum. Each is compared with Fisher's
# distribution.


LEVEL = 0.001
"""Probability that noise alone of one fit is called unexplained, by Bonferroni's inequality over columns and parts."""
LINES = 2 / 1.5  # independent values per line of a spectrum: two, over the equivalent bandwidth of a Hann window


class Floor(NamedTuple):
    """Noise of a column: standard deviation, number of independent samples behind it, and where it comes from."""

    σ: float
    freedom: float
    words: str
    white: bool = False


def floor_of(block: Block, y: Array, repeats: Sequence[Block]) -> Floor | None:
    """Noise of a run's column with the prediction y, (n,); None if nothing but the residual shows it."""
    known = 50  # independent samples that a stated number is worth: it is known to 10 %
    moves, enough = 1e-3, 30  # motion that ends the rest, relative to its range; fewest samples of a rest
    if block.stated:
        return Floor(float(np.sqrt(np.mean(block.σ**2))), known, "as stated")
    for other in repeats:
        if other.name == block.name and np.array_equal(np.asarray(other.t), np.asarray(block.t)):
            return _of_samples((other.y - block.y) / np.sqrt(2), "from a repeated run")
    still = int(np.argmax(np.abs(y - y[0]) > moves * np.ptp(y)))
    if still >= enough:
        return _of_samples(block.y[:still], "from the rest before the move")
    σ, n = noise_in(block, fewest=15), 0.6 * len(block.y) / 2  # n: lines above 0.4 of the Nyquist frequency
    return None if σ is None else Floor(σ, LINES * n, "from high frequencies", white=True)


def _of_samples(e: Array, words: str) -> Floor | None:
    e = e - e.mean()
    return Floor(float(e.std()), len(e) / colour_of(e).correlation_length, words) if e.any() else None


def excess(residual: Array, floor: Floor) -> Iterator[tuple[float, float]]:
    """Ratio of the mean square of a residual, (n,), to the noise, and the samples behind it: of all, then of parts."""
    yield float(np.mean(residual**2)) / floor.σ**2, len(residual) / colour_of(residual).correlation_length
    window = np.hanning(len(residual))
    power = np.abs(np.fft.rfft(window * residual)) ** 2 / float(window @ window)
    parts = (int(part * len(power)) for part in (0.4, 0.16, 0.064) if floor.white)
    yield from ((float(power[:n].mean()) / floor.σ**2, LINES * n) for n in parts if n >= 4)


def with_floors(
    columns: Sequence[FittedColumn], at: Likelihood, runs: Sequence[FitRun], checks: Sequence[Source]
) -> tuple[FittedColumn, ...]:
    """The columns, with the noise of the fitted ones, and whether their residuals are no more than that."""
    rounding = 1e-5  # smallest noise, relative to the range
    found, of_run = {(one.source, one.name): one for one in columns}, {run.name: run for run in runs}
    level = LEVEL / max(sum(row.block.t is not None for row in at.every), 1)
    for source, row in ((source, row) for source, part in zip(at.sources, at.rows, strict=True) for row in part):
        if source.name not in of_run:  # single measurements
            continue
        own, key = of_run[source.name], (source.name, row.block.name)
        again = [one for one in (*at.sources, *checks) if one is not source and one.name in of_run]
        again = [one for one in again if of_run[one.name].set == own.set and not own.parameter]
        residual = (row.shown - row.block.y) * row.block.used
        residual = np.where(outlying(residual), 0.0, residual)  # other warnings name outliers
        floor = floor_of(row.block, row.y, [block for one in again for block in one.blocks])
        if np.sqrt(np.mean(residual**2)) <= rounding * np.ptp(row.block.y):
            found[key] = dataclasses.replace(found[key], within=True)
        elif floor is not None:
            tests = [*excess(residual, floor)]
            within = all(scipy.special.fdtri(n, floor.freedom, 1 - level / len(tests)) >= F for F, n in tests)
            found[key] = dataclasses.replace(found[key], floor=floor.σ, floor_from=floor.words, within=within)
    return tuple(found.values())


def warnings_of_floors(columns: Sequence[FittedColumn], named: Sequence[Diagnostic]) -> Iterator[Diagnostic]:
    """Warnings about columns that the model does not explain, and about those whose noise nothing shows."""
    beyond, lacks = "parameters may be off by more than their intervals", "the model does not explain"
    above = [one for one in columns if one.within is False]
    for one in above:
        text = f"{lacks} {one.source}, {one.name}: {one.unexplained:.2g} % of the signal is left, "
        times = one.off(one.after) / (one.floor or 1.0)
        yield Diagnostic(f"{text}{times:.2g} times its noise ({one.floor_from}); {beyond}", "not-explained")
    if named and not above:
        yield Diagnostic(f"{lacks} the data, which are {named[0]}; {beyond}", "not-explained")
    fitted = [one for one in columns if one.use == "fit" and one.t is not None]
    unknown = " and ".join(f"{one.source}, {one.name}" for one in fitted if one.within is None)
    if unknown and not above and not named:
        text = f"noise of {unknown} is not known, so only known causes and faults were looked for in the residuals"
        yield Diagnostic(f"{text}; state noise, or fit a repeated run as well", "noise-not-known")
