"""Score tests at the solution: physics that the scene lacks, and faults of instruments, that explain the residuals.

    e = J θ + S δ + w        w = noise, whitened by AR models of the columns

e are the residuals (model − measured)/σ, J their Jacobian with respect to all fitted parameters, and each column of S
the effect of one fault: a delay −ẏ, a clock rate error −ẏ t, a late start, a bias 1, a gain y, a drift t, or a cause
of `causes.toml`, y(with it) − y. Faults enter one by one, the most significant first (forward selection), a physical
cause before others if it explains as much, each by a t-test with Bonferroni's level. The AR models are those of the
residuals that remain with all faults, so that a fault does not pass for noise.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array, Mask
from flexlink.data.csv_table import conversion, head_of, units_like
from flexlink.data.documents import read_toml
from flexlink.describe.link import Link
from flexlink.describe.material import BREADTHS
from flexlink.describe.scene import Scene
from flexlink.describe.writing import without_defaults
from flexlink.identification.block import FAR, Colour, colour_of, outlying
from flexlink.identification.coordinates import Coordinate, Timing, coordinate_of, guess_of, timing_of
from flexlink.identification.data import Source
from flexlink.identification.likelihood import Likelihood, likelihood, white
from flexlink.identification.problem import FitParameter
from flexlink.identification.signals import STEP, Signals
from flexlink.identification.solve import Found, Search

LEVEL = 0.001
"""Probability of a false alarm per fit, by Bonferroni's inequality over all faults tried, with known AR models.

With AR models from the same samples it is several times larger: with a level of 0.01, 5 of 60 fits raised an alarm.
"""


AS_MUCH = 0.95
"""Smallest part of what the best explanation explains, with which a physical cause explains as much."""
TRIED = 6  # number of physical causes with which the fit is repeated


class Cause(NamedTuple):
    """One more unknown of the model: of the scene, or of the times of a run."""

    name: str  # in messages; "" for times
    unknown: Coordinate
    sources: Sequence[Source]  # the measurements, with scenes that contain the unknown
    tried: tuple[float, ...]  # values to try
    stated: bool = True  # whether the scene states a value, with which a search begins


class Fault(NamedTuple):
    """A fault of one column, or of the times of a run; or a physical cause."""

    kind: str  # delay, clock, start, bias, gain or drift; cause
    # run, column, unit: the run; its column, and unit of the column; "" for all columns
    run: str
    column: str
    unit: str
    effect: Array  # derivative of all residuals with respect to the size of the fault, shape (samples of all blocks,)
    # size, deviation: estimated size, and its standard deviation
    size: float = 0.0
    deviation: float = 0.0
    cause: Cause | None = None
    score: float = 0.0  # root of the squared residuals that it explains by itself

    @property
    def text(self) -> Diagnostic:
        """What the data suggest, and the key of the run that estimates it."""
        size, wide, unit = self.size, f"{1.96 * self.deviation:.1g}", f" {self.unit}" * (self.unit != "1")
        ms, key = f"{1e3 * abs(size):.2g} ± {1.96e3 * self.deviation:.1g} ms", f"{self.kind} = [{self.column!r}]"
        rate = f"{100 * abs(size):.2g} ± {196 * self.deviation:.1g} % {'fast' if size > 0 else 'slow'}"
        late, later = ("late", "later") if size > 0 else ("early", "earlier")
        better = f"{self.run}{f': {self.column}' * bool(self.column)} is better explained"
        if self.cause is not None:
            found = "" if len(self.effect) else f" = {size:.3g} ± {wide}{unit}"  # a refit has no effect at a solution
            return Diagnostic(f"better explained by {self.cause.name}: fit {self.column}{found}", "likely-cause")
        pairs = itertools.permutations(units_like(self.unit), 2) if abs(size) > 0.1 else ()
        like = [pair for pair in pairs if self.unit in pair and abs((1 + size) / (conversion(*pair) or 1.0) - 1) < 0.01]
        other = "; likely in {1}, not {0}: correct the unit in its name".format(*like[0]) if like else ""
        return {
            "delay": Diagnostic(f"{better} {ms} {late}: {key}", "likely-delay"),
            "start": Diagnostic(f"{better} if the scene starts {ms} {later}: start = 'unknown'", "likely-start"),
            "clock": Diagnostic(f"{better} by a clock that runs {rate}: clock = true", "likely-clock"),
            "bias": Diagnostic(f"{better} with a bias of {size:.2g} ± {wide}{unit}: {key}", "likely-bias"),
            "drift": Diagnostic(f"{better} with a drift of {size:.2g} ± {wide}{unit}/s: {key}", "likely-drift"),
            "gain": Diagnostic(f"{better} with a gain of {1 + size:.3g} ± {wide}: {key}{other}", "likely-gain"),
            "sign": Diagnostic(f"{better} with the opposite sign: reverse it", "likely-sign"),
        }["sign" if self.kind == "gain" and size < -1 else self.kind]


def faults(search: Search, found: Found) -> tuple[list[Fault], list[Fault]]:
    """Faults that the residuals show at a solution, the most significant first, with their sizes; and all tried."""
    most = 3  # largest number of faults that are named
    whole = search.at(found.x, [[white(block) for block in part] for part in found.blocks])
    parts = zip(whole.sources, whole.rows, whole.jacobians, strict=True)
    runs = [pair for source, *of_source in parts if source.is_run for pair in zip(*of_source, strict=True)]
    if not runs:
        return [], []
    e = np.concatenate([np.where(outlying(row.residual), 0.0, row.residual) for row, _ in runs])
    J = np.vstack([slopes for _, slopes in runs])
    tried = _best_sizes([*_physical(search.signals, whole), *_candidates(whole)], e, J)
    S = np.column_stack([one.effect for one in tried])
    e, J, S = _whitened(e, J, S, [len(row.residual) for row, _ in runs])
    chosen = _selected(e, J, S, most, np.array([one.cause is not None for one in tried]))
    X = np.hstack([S[:, chosen], J])
    sizes, covariance = np.linalg.lstsq(X, e, rcond=None)[0], np.linalg.pinv(X.T @ X)
    named = [
        tried[k]._replace(size=-float(sizes[at]), deviation=float(np.sqrt(covariance[at, at])))
        for at, k in enumerate(chosen)
    ]
    return named, tried


def warnings_of_faults(search: Search, found: Found) -> tuple[Diagnostic, ...]:
    """Warnings about what explains the residuals, physical causes first if they explain as much; and about outliers."""
    try:
        (named, tried), far = faults(search, found), outliers(search, found)
        if (named or far) and (fits := best_refits(search, found, named, tried)):
            _, search, found = fits[0]
            named, far = [*(one for one, _, _ in fits), *faults(search, found)[0]], outliers(search, found)
    except FlexlinkError as error:
        return (Diagnostic(f"instruments and clocks not tested: {error}", "faults-untested"),)
    return (*far, *(one.text for one in named))


Refit = tuple[Fault, Search, Found]  # what one more unknown is, and the fit with it


def best_refits(search: Search, found: Found, named: Sequence[Fault], tried: Sequence[Fault]) -> list[Refit]:
    """Fits with the one unknown that explains most, and with others that explain as much, physical ones first.

    None if it is neither significant nor explains the data far better. What is wrong may move the estimates so far that
    tests at the solution do not recognise it.
    """
    better = 0.7  # largest cost with one more unknown, relative to the cost without it
    hardly = 1.1  # largest cost with an unknown that explains as much, relative to the least
    cost = search.cost(found.x, [[white(block) for block in part] for part in found.blocks])
    # scores are rounded: springs in series, as of root and gear, have the same one, and both are tried
    scores = sorted((round(one.score, 1) for one in tried if one.cause is not None), reverse=True)[:TRIED]
    likely = [one.cause for one in tried if one.cause is not None and round(one.score, 1) >= scores[-1]]
    fits = [fit for cause in (*likely, *_timings(search)) for fit in _refitted(search, found, cause)]
    of_columns = max((one.score**2 / 2 for one in tried if one.cause is None and one.column), default=0.0)
    least = min([fit.cost for _, _, fit in fits] + [cost - of_columns])
    fits = [fit for fit in fits if fit[2].cost <= min(least + _resolved(fits), cost - _resolved(fits), hardly * least)]
    shown = {one.column for one in named if one.cause is not None}
    return fits if shown & {fault.column for fault, _, _ in fits} or least < better * cost else []


def _resolved(fits: Sequence[Refit]) -> float:
    """Smallest difference of costs that distinguishes explanations, by χ² of the autocorrelated residuals of the best.

    Residuals are divided by a noise that was estimated without the cause, so their mean square is not 1.
    """
    _, search, found = min(fits, key=lambda fit: fit[2].cost)
    every = [row.residual for row in likelihood(search.signals, found.x, found.blocks).every]
    size = sum(float(e @ e) * colour_of(e).correlation_length for e in every) / sum(map(len, every))
    return float(scipy.special.chdtri(1, LEVEL)) / 2 * size


def _timings(search: Search) -> list[Cause]:
    """Unknown starts and clocks of the runs, unless the problem estimates them."""
    known, sources = {(one.timing, one.run) for one in search.coordinates}, search.signals.sources
    kinds: tuple[Timing, ...] = ("start", "clock")
    every = ((kind, one.name) for one in sources if one.is_run for kind in kinds)
    return [Cause("", timing_of(kind, run), sources, (0.0,)) for kind, run in every if (kind, run) not in known]


def _refitted(search: Search, found: Found, cause: Cause) -> list[Refit]:
    """The fit with one more unknown, from the initial guess, or else from the solution; none if it fails."""
    few, most = 4, 8  # number of evaluations in parts of the runs, and of whole runs, that are enough to compare causes
    unknown, plain = cause.unknown, [[white(block) for block in part] for part in found.blocks]
    longer = Search(Signals(cause.sources, [*search.coordinates, unknown]), search.loss)
    value = unknown.x(unknown.start if cause.stated else cause.tried[0])
    guess, solution = (np.append(x, value) for x in (guess_of(search.coordinates), found.x))
    try:
        x = longer.least(longer.grown(guess, few), plain, rough=True, most=most)
        if longer.cost(x, plain) >= search.cost(found.x, plain):
            x = min(x, longer.least(solution, plain, rough=True, most=most), key=lambda x: longer.cost(x, plain))
        wide = float(np.sqrt(longer.at(x, plain).covariance[-1, -1]))
    except FlexlinkError:  # the scene cannot be simulated with it
        return []
    value = unknown.value(float(x[-1]))
    fault = Fault(
        unknown.timing or "cause", unknown.run, unknown.path, unknown.measured_in, np.empty(0), value,
        unknown.size(value) * wide, cause if cause.name else None,
    )  # fmt: skip
    return [(fault, longer, Found(x, longer.cost(x, plain), plain))]


def mixups(at: Likelihood) -> list[Diagnostic]:
    """Notes on columns that resemble the negative of their prediction, or the prediction of another column."""
    alike, closer = 0.7, 0.5  # smallest correlation that counts as alike; residual of a swap over that without it
    found = []
    for source, part in zip(at.sources, at.rows, strict=True):
        columns = [(row.block, row.y) for row in part if row.block.t is not None]
        for block, values in columns:
            with np.errstate(invalid="ignore", divide="ignore"):  # nan of constant columns
                r = float(np.corrcoef(block.y, values)[0, 1])
            if r < -alike:
                text = f"{source.name}: {block.name} resembles the negative of its prediction (correlation {r:.2f}); "
                found.append(Diagnostic(f"{text}reverse its sign", "likely-sign"))
        for (a, ya), (b, yb) in itertools.combinations(columns, 2):
            if a.unit == b.unit and len(a.y) == len(b.y) and all(
                np.linalg.norm(own.y - other) < closer * np.linalg.norm(own.y - mine)
                for own, mine, other in ((a, ya, yb), (b, yb, ya))
            ):  # fmt: skip
                text = f"{source.name}: {a.name} and {b.name} each resemble the other's prediction; swap them"
                found.append(Diagnostic(text, "likely-swapped"))
    return found


def outliers(search: Search, found: Found) -> list[Diagnostic]:
    """Warnings about columns with samples far off the model, compared with the spread of most samples."""
    warnings, at = [], likelihood(search.signals, found.x, found.blocks)
    for source, part in zip(at.sources, at.rows, strict=True):
        for block, _, residual, *_ in part:
            count = int(np.count_nonzero(outlying(residual))) if block.t is not None else 0
            if count:
                text = f"{source.name}: {count} of {len(block.y)} samples of {block.name} are outliers, more than "
                text += f"{FAR:g} robust standard deviations off the model: loss = 'trimmed' leaves them out"
                warnings.append(Diagnostic(text, "likely-outliers"))
    return warnings


def _physical(signals: Signals, at: Likelihood) -> Iterator[Fault]:
    """Physical causes, each with several sizes."""
    for cause in causes(signals, at.x):
        longer = Signals(cause.sources, [*signals.coordinates, cause.unknown])
        points = [np.append(at.x, cause.unknown.x(value)) for value in cause.tried]
        longer.ahead(points)
        for value, point in zip(cause.tried, points, strict=True):
            try:
                model = longer.model(point)
            except FlexlinkError:  # the scene cannot be simulated with it
                continue
            pairs = zip(at.every, itertools.chain(*model), strict=True)
            effect = [row.gain * (y - row.y) / row.block.σ for row, y in pairs if row.block.t is not None]
            own = cause._replace(tried=(value,))
            yield Fault("cause", "", cause.unknown.path, cause.unknown.measured_in, np.concatenate(effect), cause=own)


def _candidates(at: Likelihood) -> Iterator[Fault]:
    """All faults that the problem does not estimate already, of every run; those of times with several sizes."""
    known = {(one.timing, one.run, head_of(one.column)[0]) for one in at.coordinates if one.timing}
    count, begun = sum(len(row.residual) for row in at.every if row.block.t is not None), 0
    for source, part in zip(at.sources, at.rows, strict=True):
        if not source.is_run:
            continue
        begin, late, rate = source.scene.initial.time, np.zeros((len(LATE), count)), np.zeros((len(FAST), count))
        for row in part:
            block, values = row.block, row.y
            t, here = np.asarray(block.t), slice(begun, begun + len(block.y))
            begun += len(block.y)
            around = here.start, count - here.stop
            late[:, here] = _secants(t, values, [(d, t - d) for d in LATE]) * row.gain / block.σ
            rate[:, here] = _secants(t, values, [(c, begin + (t - begin) / (1 + c)) for c in FAST]) * row.gain / block.σ
            for kind, effect in {"bias": np.ones(len(t)), "gain": row.gain * values, "drift": t - t.mean()}.items():
                if not getattr(block, kind):
                    yield Fault(kind, source.name, block.name, block.unit, np.pad(effect / block.σ, around))
            if ("delay", source.name, head_of(block.name)[0]) not in known:
                for effect in late:
                    yield Fault("delay", source.name, block.name, block.unit, np.pad(effect[here], around))
        for kind, effects in (("start", late if len(part) > 1 else ()), ("clock", rate)):
            for effect in effects if (kind, source.name, "") not in known else ():
                yield Fault(kind, source.name, "", "", effect.copy())


LATE = (1e-5, 0.005, -0.005, 0.01, -0.01, 0.02, -0.02)  # delays of a column or a run whose effect is tried [s]
FAST = (1e-5, 0.01, -0.01, 0.03, -0.03)  # rate errors of a clock whose effect is tried


def _secants(t: Array, values: Array, moved: Sequence[tuple[float, Array]]) -> Array:
    """Effects (y(t') − y(t)) / size of faults of times with these sizes and times t', shape (sizes, samples)."""
    y = scipy.interpolate.CubicSpline(t, values)
    return np.array([(y(np.clip(times, t[0], t[-1])) - values) / size for size, times in moved])


def _best_sizes(tried: Sequence[Fault], e: Array, J: Array) -> list[Fault]:
    """Faults with one size each: the size whose effect explains the residuals best."""
    basis = np.linalg.qr(J)[0]
    best: dict[tuple[str, str, str], Fault] = {}
    for one in tried:
        own = one.effect - basis @ (basis.T @ one.effect)
        score = abs(float(own @ e)) / (float(np.linalg.norm(own)) or 1.0)
        key = one.kind, one.run, one.column
        if key not in best or score > best[key].score:
            best[key] = one._replace(score=score)
    return list(best.values())


def _whitened(e: Array, J: Array, S: Array, lengths: Sequence[int]) -> tuple[Array, Array, Array]:
    """Residuals, Jacobian and effects of faults, whitened by AR models of the residuals that all of them leave.

    With few samples, all effects together would fit the noise; only their largest principal components are removed.
    """
    rounds, share = 2, 15  # the first models are those of residuals that were not whitened; samples per component
    size, cuts = np.linalg.norm(S, axis=0), np.cumsum(lengths)[:-1]
    main = np.linalg.svd(S / np.where(size > 0, size, 1.0), full_matrices=False)[0][:, : len(e) // share]
    X, last = np.column_stack([J, main, S]), J.shape[1] + main.shape[1]
    white_e, white_X = e, X
    for _ in range(rounds):
        left = e - X[:, :last] @ np.linalg.lstsq(white_X[:, :last], white_e, rcond=None)[0]
        colours = [_scaled(colour_of(part)) for part in np.split(left, cuts)]
        white_e = np.concatenate([by(part[:, None])[:, 0] for by, part in zip(colours, np.split(e, cuts), strict=True)])
        white_X = np.vstack([by(part) for by, part in zip(colours, np.split(X, cuts), strict=True)])
    return white_e, white_X[:, : J.shape[1]], white_X[:, last:]


def _scaled(colour: Colour) -> Callable[[Array], Array]:
    """Function that whitens columns and divides them by the standard deviation of the innovations."""
    size = float(np.sqrt(np.mean(colour.innovations**2))) or 1.0
    return lambda X: colour.whitened(X) / size


def _selected(e: Array, J: Array, S: Array, most: int, physical: Mask) -> list[int]:
    """Numbers of the significant faults, by forward selection, physical ones first if they explain as much."""
    basis, chosen = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))[0], list[int]()
    size = np.linalg.norm(S, axis=0)
    limit = scipy.special.stdtrit(max(len(e) - J.shape[1] - S.shape[1], 1), 1 - LEVEL / (2 * S.shape[1]))
    for _ in range(most):
        left = S - basis @ (basis.T @ S)
        length = np.linalg.norm(left, axis=0)
        own = length > 1e-6 * size  # an effect that the parameters explain cannot be tested
        score = np.where(own, np.abs(left.T @ (e - basis @ (basis.T @ e))) / np.where(own, length, 1.0), 0.0)
        alike = physical & (score**2 >= AS_MUCH * score.max() ** 2)
        best = int((alike if alike.any() else score).argmax())
        if score[best] < limit:
            break
        chosen.append(best)
        basis = np.column_stack([basis, left[:, best] / length[best]])
    return chosen


# Physical causes of what a model leaves unexplained: each is one more unknown of the scene, a row of `causes.toml`.


def causes(signals: Signals, x: Array) -> Iterator[Cause]:
    """Physical causes that apply to the scenes at a point and that the problem neither estimates nor sets per run."""
    scenes, seen = [signals.scene(k, at) for at in (x, x + STEP) for k in range(len(signals.sources))], set[str]()
    for row, link in itertools.product(_rows(), scenes[0].arm.links):
        if {"joint": not link.joint.locked, "beam": link.flex != "rigid", "arm": True}[row["of"]]:
            try:
                one = _cause(row, link, scenes, signals.sources)
            except FlexlinkError:  # the path does not exist on this arm
                continue
            if one is not None and one.unknown.path not in seen:
                seen.add(one.unknown.path)
                yield one


def _cause(row: dict[str, Any], link: Link, scenes: Sequence[Scene], sources: Sequence[Source]) -> Cause | None:
    """A cause on a link; None if the link lacks what it changes, or if the scenes differ in its value."""
    arm, added, taper = scenes[0].arm, dict[str, Any](), f"{link.section}_tip"
    section = arm.sections.get(link.section or "")
    on = {"link": arm.path(arm.number(link.name)), "material": link.material}
    if "{taper}" in row["path"]:
        if section is None or section.shape not in BREADTHS or link.section_tip is not None:
            return None
        added = {f"section.{taper}": without_defaults(section), f"{on['link']}.section_tip": taper}
        on["taper"] = f"{taper}.{BREADTHS[section.shape][1]}"
    path, lengthens = row["path"].format(**on), row["path"].endswith(".length")

    def prepared(scene: Scene) -> Scene:
        at_end = [one for one in scene.sensor if one.x == link.length and arm.number(one.link) == arm.number(link.name)]
        moved = {f'sensor."{one.name}".x': None for one in at_end if lengthens}  # sensors at the end remain there
        return scene.varied(added | moved) if added or moved else scene

    whole = [prepared(scene) for scene in scenes]
    now, *others = {scene.values_at(path)[0] for scene in whole}
    tried = tuple(by * now for by in row.get("factors", (0.8, 1.25))) if now else tuple(row.get("tried", ()))
    if others or not tried:
        return None
    unknown = coordinate_of(whole[0], FitParameter(path=path, start=now or tried[0], scale="log"))
    own = [dataclasses.replace(one, scene=prepared(one.scene)) for one in sources]
    return Cause(row["name"].format(link=link.name, material=link.material), unknown, own, tried, bool(now))


@functools.cache
def _rows() -> list[dict[str, Any]]:
    return list(read_toml(Path(__file__).parent / "causes.toml")["cause"])
