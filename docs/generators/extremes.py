"""The part of the page "Extremes" that the stored study determines: figure, conclusions, table, list of refusals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from docs.generators import messages, study
from docs.generators.extreme_runs import (
    LOOKS,
    NATIVE,
    NOT_FINITE,
    REFUSED,
    RIGHT,
    SINGULAR,
    STEPS,
    WARNED,
    WRONG,
    Digits,
    Run,
    counts,
    digits,
    message_id,
    most_steps,
    runs,
)
from docs.generators.rest import directive, literal, prose, table
from flexlink.common.wording import plural
from flexlink.pages.colours import INK, VERMILION, engine_name
from flexlink.pages.numbers import JOIN, number
from flexlink.pages.style import RC, legend_over, stacked_axes

PICTURE = "extremes.svg"
METHOD_OF_ALL = "RK4"  # method that flexlink and other programs have in common
CELL = "python -m validation.cell"
MOST = 16.0  # decimal digits of float64
REPEATS = (WRONG, REFUSED, NOT_FINITE)
"""Ends of runs whose command the table gives, the first that occurs."""


def page(folder: Path) -> str:
    """Figure, conclusions and table, to be included in `docs/explanation/extremes.md`."""
    found, cells = runs(study.FULL), digits(study.FULL)
    if not found:
        return "The stored study contains no runs at extreme parameters.\n"
    _draw(found, folder / PICTURE)
    caption = (
        "Ends of all runs at extreme parameters, by program and method. RK4, MuJoCo and Pinocchio: same scenes, same "
        "steps."
    )
    return "\n".join(
        [
            directive("figure", f"/reference/generated/{PICTURE}", caption, alt=caption),
            "\n".join(f"- {text}" for text in sentences(found, cells)) + "\n",
            table(*_table(found, cells)),
            directive("dropdown", "Messages of the refused runs of flexlink", _refusals(found)),
        ]
    )


def sentences(found: Sequence[Run], cells: Sequence[Digits]) -> Iterator[str]:
    """Yield what the stored study concludes, most important first."""
    for engine, own in _by_engine(found).items():
        of = counts(own)
        rest = ", ".join(f"{of[end]:,} {_words(end)}" for end in LOOKS if end != WRONG and of[end])
        yield f"**{engine_name(engine)}: {of[WRONG]:,} of {len(own):,} runs {WRONG}**; {rest}."
    regular = [cell for cell in cells if cell.condition <= SINGULAR]
    engines = dict.fromkeys(engine for cell in regular for engine in cell.errors)
    if engines:
        none = (f"{engine_name(e)} {sum(cell.errors.get(e, 0.0) >= 0.1 for cell in regular):,}" for e in engines)
        yield (
            f"Accelerations q̈ of {len(regular):,} extreme arms, against 100-digit arithmetic; arms without a single "
            f"correct digit: {', '.join(none)}."
        )
    yield from (text for _, _, text, _ in _other_cases())
    measured = study.stored()
    yield f"Measured {str(measured['measured'])[:10]} at commit {str(measured['commit'])[:8]}."


def _words(end: str) -> str:
    words = {
        RIGHT: "within their stated error",
        "up to ten times": "within ten times their stated error",
        WARNED: "with a warning",
        REFUSED: "refused or ended by a message",
        NOT_FINITE: "no longer finite",
    }
    return words.get(end, end)


def _table(found: Sequence[Run], cells: Sequence[Digits]) -> tuple[tuple[str, ...], list[tuple[str, ...]], str]:
    """Heads, rows and widths: for every parameter its range, and what every program does."""
    engines = list(_by_engine(found))
    rows = []
    for name in _parameters(found, cells):
        own = [run for run in found if name in run.values]
        alone = [cell for cell in cells if set(cell.values) == {name} and cell.condition <= SINGULAR]
        values = [values[name] for values in _varied(found, cells) if name in values]
        shown = [_ends(engine, own) + _fewest(engine, alone, bool(own)) for engine in engines]
        rows.append(
            (
                *_named(name, values),
                *(text or "–" for text in shown),
                literal(_command(own, alone).removeprefix(f"{CELL} ")),
            )
        )
    rows += [
        (prose(name), tried, prose(text), *["–"] * (len(engines) - 1), literal(command))
        for name, tried, text, command in _other_cases()
    ]
    heads = ("parameter", "tried", *(_head(engine) for engine in engines), f"repeat one: {literal(CELL)}")
    return heads, rows, " ".join(map(str, (18, 16, 20, *[18] * (len(engines) - 1), 20)))


def _head(engine: str) -> str:
    return engine_name(engine) + (", in a loop" if engine == "pinocchio" else "")


def _parameters(found: Sequence[Run], cells: Sequence[Digits]) -> list[str]:
    """Names of all parameters in the order of the study, steps and tolerances last."""
    names = dict.fromkeys(name for values in _varied(found, cells) for name in values)
    return [*(name for name in names if name not in STEPS), *(name for name in STEPS if name in names)]


def _varied(found: Sequence[Run], cells: Sequence[Digits]) -> list[dict[str, float]]:
    return [*(run.values for run in found), *(cell.values for cell in cells)]


def _named(name: str, values: Sequence[float]) -> tuple[str, str]:
    """Name of a parameter without unit, and its smallest and largest value with unit."""
    plain, _, unit = name.removesuffix("]").partition(" [")
    plain, times, _ = plain.partition(", times")
    low, high = (number(value, 1 if float(f"{value:.0e}") == value else 2) for value in (min(values), max(values)))
    ends = low if low == high else f"{low} … {high}"
    return plain[0].upper() + plain[1:], f"{f'×{JOIN}' if times else ''}{ends}{JOIN}{unit}".rstrip(JOIN)


def _ends(engine: str, own: Sequence[Run]) -> str:
    """Number of wrong runs of a program, even if there are none, and of those that it did not complete or doubted."""
    of = counts(run for run in own if run.engine == engine)
    if not of:
        return ""
    bold = "**" if of[WRONG] else ""
    wrong = f"{bold}{of[WRONG]:,}{JOIN}wrong{bold} of{JOIN}{of.total():,}"
    return ", ".join(
        [wrong, *(f"{of[end]:,} {end}".replace(" ", JOIN) for end in (WARNED, REFUSED, NOT_FINITE) if of[end])]
    )


def _fewest(engine: str, alone: Sequence[Digits], after: bool) -> str:
    """Fewest correct digits of q̈ of a program over the values of one parameter."""
    errors = [cell.errors[engine] for cell in alone if engine in cell.errors]
    if not errors:
        return ""
    fewest = max(0, math.floor(-math.log10(max(*errors, 10.0**-MOST))))
    return f"{'; ' if after else ''}q̈:{JOIN}{plural(fewest, 'digit').replace(' ', JOIN)}"


def _command(own: Sequence[Run], alone: Sequence[Digits]) -> str:
    """Command of one run: the first that is wrong in a program, else refused by flexlink, else the last."""
    for end in REPEATS:
        if matching := [run for run in own if run.end == end and (end != REFUSED or run.engine == NATIVE)]:
            return matching[0].recipe
    return (own or alone)[-1].recipe if own or alone else "–"


def _other_cases() -> Iterator[tuple[str, str, str, str]]:
    """Yield name, range, result and command of the cases about many steps and about the largest stable step."""
    drift = [row for row in study.checks() if row["case"].startswith("long_runs") and row["tolerance"]]
    if drift:
        share = max(float(row["value"]) / float(row["tolerance"]) for row in drift)
        text = f"Drift of energy, angular momentum and time in long runs: at most {share:.1%} of what is allowed."
        yield "Number of steps", f"up to {number(most_steps(study.FULL))}", text, "python -m validation 'long_runs*'"
    steps = [row for row in study.checks() if row["case"] == "stable_steps" and row["tolerance"] and row["value"]]
    if steps:
        off = max(float(row["value"]) for row in steps)
        text = f"Largest stable step, observed in runs and predicted: they differ by at most {off:.1%}."
        yield "Largest stable step", f"{len(steps)} scenes and methods", text, "python -m validation stable_steps"


def _refusals(found: Iterable[Run]) -> str:
    """Table of the messages: id, meaning, number of runs, and the command of the first."""
    refused: dict[str, list[Run]] = {}
    for run in found:
        if run.engine == NATIVE and run.end == REFUSED:
            refused.setdefault(message_id(run.message), []).append(run)
    meanings = {each.id: each.means for group in messages.groups().values() for each in group}
    rows = [
        (f":ref:`{name} <message-{name}>`" if name in meanings else "other", prose(meanings.get(name, "–")),
         f"{len(own):,}", literal(own[0].recipe))
        for name, own in sorted(refused.items(), key=lambda pair: -len(pair[1]))
    ]  # fmt: skip
    return table(("message", "meaning", "runs", "repeat the first"), rows, "20 45 10 25")


def _by_engine(found: Iterable[Run]) -> dict[str, list[Run]]:
    groups: dict[str, list[Run]] = {}
    for run in found:
        groups.setdefault(run.engine, []).append(run)
    return groups


def bars(found: Sequence[Run]) -> dict[str, Counter[str]]:
    """Ends of the runs by program and method; flexlink's runs of all methods come first."""
    beside = {(run.case, *run.values.items()) for run in found if run.engine != NATIVE}
    both = [
        run
        for run in found
        if run.engine != NATIVE or (run.method == METHOD_OF_ALL and (run.case, *run.values.items()) in beside)
    ]
    groups: dict[str, list[Run]] = {}
    for run in sorted(both, key=lambda run: run.engine != NATIVE):
        groups.setdefault(f"{engine_name(run.engine)}, {run.method}", []).append(run)
    groups = {f"{engine_name(NATIVE)}, all methods": [run for run in found if run.engine == NATIVE]} | groups
    return {name: counts(own) for name, own in groups.items()}


def _draw(found: Sequence[Run], path: Path) -> None:
    """Draw a bar for each program and method: the shares of its runs by their end."""
    shown = bars(found)
    with mpl.rc_context(RC):
        figure, (axes,) = stacked_axes(1, 1.1 + 0.55 * len(shown))
        for row, (name, of) in enumerate(shown.items()):
            left, total = 0.0, of.total()
            for end, colour in LOOKS.items():
                share = 100.0 * of[end] / total
                axes.barh(row, share, left=left, height=0.4, color=colour)
                left += share
            words = f"{name}: {of[WRONG]:,} of {total:,} wrong"
            axes.text(0.0, row - 0.26, words, va="bottom", color=VERMILION if of[WRONG] else INK)
        _finish(figure, [end for end in LOOKS if any(of[end] for of in shown.values())], len(shown))
        figure.savefig(path, metadata={"Date": None})


def _finish(figure: Figure, ends: Sequence[str], bars: int) -> None:
    (axes,) = figure.axes
    for end in ends:
        axes.barh(0, 0, color=LOOKS[end], label=end)
    axes.set(xlabel="share of the runs [%]", xlim=(0, 100), ylim=(bars - 0.6, -0.75), yticks=[])
    axes.grid(False)
    legend_over(axes, figure=figure)
