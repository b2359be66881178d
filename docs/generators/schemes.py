"""Pages of methods, rules and shapers, from their data files, each with a figure."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from docs.generators.rest import directive, heading, literal, prose, table
from flexlink.common.errors import ArgumentError
from flexlink.describe import data_files
from flexlink.describe.schemes.lumping_rules import LumpingRule, lumping_rule
from flexlink.describe.schemes.methods import Method, method
from flexlink.describe.shaping import ShaperRule
from flexlink.dynamics.vibration.stability_function import stability_function, stable_reach
from flexlink.pages.colours import BLUE, VERMILION

STYLE: dict[str, Any] = {"svg.hashsalt": "flexlink", "svg.fonttype": "path", "figure.facecolor": "white"}


def methods_page(folder: Path) -> str:
    """Return the page of integrators: order, stages, stability and source."""
    known = {name: method(name) for name in data_files.names("methods")}
    heads = ("method", "order", "stages", "kind", "stable on the real axis to", "on the imaginary axis to")
    parts = [
        heading("Integrators"),
        "Runge-Kutta methods, selected by ``run.method`` or ``--method``; ``auto``, the default with a tolerance,\n"
        "takes the cheapest. A step h is stable for an eigenvalue λ if ``hλ`` lies in the shaded region.\n"
        "Keys of a custom method file: :doc:`data_files`.\n",
        table(heads, [(literal(name), *_facts(each)) for name, each in known.items()]),
    ]
    for name, each in known.items():
        _draw_region(each, folder / f"region_{name}.svg")
        caption = f"Stability region of {name}: no vibration grows if hλ lies in the shaded area"
        parts += [_section(name, each), _figure(f"region_{name}.svg", caption)]
    return "\n".join(parts)


def _facts(each: Method) -> tuple[str, ...]:
    real, imaginary = (_reach(each, direction) for direction in (-1.0 + 0j, 1j))
    return str(each.order), str(each.stages), "explicit" if each.explicit else "implicit", real, imaginary


def _reach(each: Method, direction: complex) -> str:
    (reach,) = stable_reach(each, np.array([direction]))
    return "any" if math.isinf(reach) else f"{reach:.4g}"


def _draw_region(each: Method, path: Path) -> None:
    size = 12.0 if not each.explicit else max(3.0, 1.15 * float(stable_reach(each, np.array([-1.0 + 0j]))[0]))
    x, y = np.meshgrid(np.linspace(-size, size / 3, 240), np.linspace(-size, size, 360))
    growth = np.abs(stability_function(each, x + 1j * y))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.0, 4.4), layout="constrained")
        axes = figure.add_subplot(aspect="equal", xlabel="Re hλ", ylabel="Im hλ")
        axes.contourf(x, y, growth, levels=[0.0, 1.0 + 1e-9], colors=[BLUE], alpha=0.35)
        axes.contour(x, y, growth, levels=[1.0 + 1e-9], colors=[BLUE], linewidths=1.2)
        axes.axhline(0.0, color="0.4", linewidth=0.6)
        axes.axvline(0.0, color="0.4", linewidth=0.6)
        figure.savefig(path, metadata={"Date": None})


def rules_page(folder: Path) -> str:
    """Return the page of lumping rules: hinge positions and weights."""
    known = {name: lumping_rule(name) for name in data_files.names("lumping")}
    parts = [
        heading("Lumping rules"),
        "A lumping rule, ``link.NAME.lumping``, places the hinges of a flexible link and gives each the share w of\n"
        "the beam's length: k = EI / (w L). Keys of a custom rule file: :doc:`data_files`.\n",
        "Rules with cells also have springs between the hinges of a cell. Their w belongs to the diagonal of K and\n"
        "does not sum to 1. The table lists, for each rule, the smallest number of hinges, the number that every\n"
        "number of hinges must be a multiple of, and the number of hinges in a cell:\n",
        table(
            ("rule", "least", "multiple of", "hinges per cell"), [_numbers(name, rule) for name, rule in known.items()]
        ),
    ]
    for name, rule in known.items():
        counts = [count for count in (2, 4, 8) if _exists(rule, count)]
        _draw_hinges(rule, counts, folder / f"hinges_{name}.svg")
        caption = f"Hinges of {name} from root (0) to tip (1) of a link, and their weights"
        parts += [_section(name, rule), _figure(f"hinges_{name}.svg", caption)]
    return "\n".join(parts)


def _numbers(name: str, rule: LumpingRule) -> tuple[str, ...]:
    taken = [count for count in range(1, 25) if _exists(rule, count)]
    shared = str(rule.cells.hinges) if rule.cells else "1"
    return literal(name), str(taken[0]), str(math.gcd(*taken)), shared


def _exists(rule: LumpingRule, count: int) -> bool:
    try:
        rule.hinges(count)
    except ArgumentError:
        return False
    return True


def _draw_hinges(rule: LumpingRule, counts: list[int], path: Path) -> None:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.0, 2.4), layout="constrained")
        axes = figure.add_subplot(xlabel="position on the link, x / L [1]", ylabel="hinges", xlim=(-0.04, 1.04))
        axes.set_yticks(range(len(counts)), [str(count) for count in counts])
        axes.set_ylim(-0.6, len(counts) - 0.4)
        for row, count in enumerate(counts):
            nodes, weights = rule.hinges(count)
            axes.plot([0, 1], [row, row], color="0.6", linewidth=3, solid_capstyle="butt", zorder=1)
            axes.scatter(nodes, np.full(count, row), s=900 * weights / 2 + 8, color=BLUE, alpha=0.45, zorder=2)
            axes.scatter(nodes, np.full(count, row), s=14, color=VERMILION, zorder=3)
        figure.savefig(path, metadata={"Date": None})


def shapers_page(folder: Path) -> str:
    """Return the page of input shapers: impulses, and residual vibration if the frequency is wrong."""
    known = {name: data_files.load("shapers", "kind", name, ShaperRule) for name in data_files.names("shapers")}
    _draw_sensitivity(known, folder / "shapers.svg")
    heads = ("shaper", "impulses", "longer by", "zeros")
    rows = [
        (literal(name), str(len(each.half_periods)), f"{max(each.half_periods) / 2:g} periods", str(each.zeros))
        for name, each in known.items()
    ]
    parts = [
        heading("Input shapers"),
        "An input shaper, ``drive.reference.shaper.kind``, adds delayed copies of a reference so that the vibrations\n"
        "they cause cancel. Keys of a custom shaper file: :doc:`data_files`.\n",
        table(heads, rows),
        _figure("shapers.svg", "Residual vibration of an undamped mode whose frequency differs from the shaper's"),
    ]  # fmt: skip
    for name, each in known.items():
        parts.append(_section(name, each))
    return "\n".join(parts)


def _draw_sensitivity(known: dict[str, ShaperRule], path: Path) -> None:
    ratio = np.linspace(0.5, 1.5, 301)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.0, 3.4), layout="constrained")
        axes = figure.add_subplot(xlabel="true frequency / shaper frequency [1]", ylabel="residual vibration [%]")
        for (name, each), style in zip(known.items(), ("-", "--", "-.", ":", (0, (1, 1))), strict=False):
            times, weights = each.impulses(2j * np.pi)
            left = np.abs(np.exp(-2j * np.pi * ratio[:, None] * times) @ weights)
            axes.plot(ratio, 100 * left, linestyle=style, label=name)
        axes.legend()
        axes.set_ylim(0, 100)
        figure.savefig(path, metadata={"Date": None})


def _section(name: str, each: Method | LumpingRule | ShaperRule) -> str:
    return f"{heading(name, 1)}\n{_sentence(each.about)} Source: {_sentence(each.source)}\n"


def _figure(name: str, text: str) -> str:
    return directive("figure", name, text, alt=text)


def _sentence(text: str) -> str:
    return prose(text if text.endswith(".") else f"{text}.")
