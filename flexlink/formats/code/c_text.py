"""C code of the equations of motion, without dependencies, with derivatives and a self-test."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from flexlink.chain.arguments import require_bool
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.model import ALLOWED, Model, cases, implicit_of, model_of, name_of, slopes_of
from flexlink.formats.code.tape import Number, Real, Tape

LONGEST = 400_000  # largest number of operations of a file


def to_c(chain: Chain, *, slopes: bool = False, step: bool = False) -> str:
    """Equations of motion of an arm as C code: ẋ = f(x, u), the tip, derivatives ∂f/∂x and ∂f/∂u, and a time step.

    The states x are angles and rates (z, ż) of all joints or, for links with `modes`, of their shapes; the inputs u are
    the torques of the driven joints, or their accelerations if their motion is prescribed. Their names and units are in
    the first comment. Functions, with the arm's name for `arm`; arrays are row-major:

        void arm_rate(const double *x, const double *u, double *dx);
        void arm_tip(const double *x, double *tip);                             position in frame 0 [m]
        void arm_slopes(const double *x, const double *u, double *A, double *B);
        void arm_step(double *x, const double *u, double h);                    x after h seconds with constant u

    `arm_step` is an implicit step for stiff arms, RODAS of order 4 (Hairer & Wanner 1996), whose number of operations
    does not depend on x: it allocates nothing, iterates nothing, and meets a deadline always or never.

    Compiled with -DARM_TEST (the name in capitals), the file is a program that compares `arm_rate` and `arm_tip` with
    numbers of flexlink's solver, and returns 0 if they agree.

    Parameters
    ----------
    chain, slopes
        The chain, and whether the file contains `arm_slopes`, which then has most of its lines, and takes compilers up
        to minutes.
    step
        Whether the file contains `arm_step`, which has about half as many lines as `arm_slopes`.

    Returns
    -------
    str
        The text of a .c file, C99, which needs only math.h.

    Raises
    ------
    ArgumentError
        The code is too long.

    Examples
    --------
    >>> text = fl.to_c(chain)
    >>> print("void two_links_rate(const double *x, const double *u, double *dx)" in text)
    True
    """
    model, name = model_of(chain), name_of(chain)
    rate = function(model, f"{name}_rate", "xu", {"dx": model.rate})
    parts = [head(model), rate, function(model, f"{name}_tip", "x", {"tip": model.tip})]
    if require_bool("slopes", slopes):
        by_x, by_u = ([*itertools.chain.from_iterable(zip(*by, strict=True))] for by in slopes_of(model))  # row by row
        parts.append(in_blocks(model, f"{name}_slopes", {"A": by_x, "B": by_u}))
    if require_bool("step", step):
        parts.append(step_function(model))
    return "\n\n".join([*parts, _test(model, name)]) + "\n"


def step_function(model: Model) -> str:
    """The function for a step, with those that it calls."""
    m, name = model.chain.freedoms, name_of(model.chain)
    free, M_free, N_free, known = implicit_of(model)
    M, N = np.eye(m).astype(object), known[m:]  # z̈ of other coordinates is an input
    M[np.ix_(free - m, free - m)], N[free - m] = M_free, N_free
    implicit = in_blocks(model, f"{name}_implicit", {"M": [*M.flat], "N": [*N.flat]}, "static ")
    return f"#define {name.upper()}_FREEDOMS {m}\n\n{implicit}\n\n{template('step.c', name)}"


def slopes_by_rows(model: Model, values: Sequence[Real], held: Iterable[Number] = ()) -> list[Real]:
    """Derivatives of values with respect to x, u and held numbers, row by row."""
    columns = model.tape.slopes(values, (*model.x, *model.u, *held))
    return [*itertools.chain.from_iterable(zip(*columns, strict=True))]


def template(file: str, name: str, words: Mapping[str, str] | None = None) -> str:
    """A text of this folder with other words, and with the name of the arm in place of NAME."""
    return re.sub("NAME_(?=[A-Z])", f"{name.upper()}_", with_words(file, words or {})).replace("NAME", name)


def with_words(file: str, words: Mapping[str, str]) -> str:
    """A text of this folder with other words; what they mean is not replaced again."""
    text = (Path(__file__).parent / file).read_text(encoding="utf-8").strip()
    return re.sub("|".join(map(re.escape, words)) or "(?!)", lambda found: words[found[0]], text)


def check_length(tape: Tape, chain: Chain) -> None:
    """Refuse code with too many operations."""
    if len(tape.operations) > LONGEST:
        text = f"code of more than {LONGEST} operations; use fewer segments, strain modes, or slopes=False"
        raise ArgumentError(f"{chain.name}: {text}", id="code-too-long")


def head(model: Model, extra: Iterable[str] = ()) -> str:
    """The first comment, which names states and inputs, and their numbers."""
    name = name_of(model.chain)
    rows = [f"x[{k}] {state}" for k, state in enumerate(state_names(model.chain))]
    rows += [f"u[{k}] {given}" for k, given in enumerate((*input_names(model.chain), *extra))]
    listed = "\n".join(f"   {row}" for row in rows).replace("*/", "* /")
    return (
        f"/* Equations of motion of {model.chain.name.replace('*/', '* /')!r}, written by flexlink.\n{listed}\n*/\n"
        f"#include <math.h>\n\n#define {name.upper()}_STATES {len(model.x)}\n"
        f"#define {name.upper()}_INPUTS {len(model.u)}"
    )


def function(model: Model, name: str, given: str, results: Mapping[str, Sequence[Real]]) -> str:
    """A function of x or of x and u that writes arrays."""
    check_length(model.tape, model.chain)
    names = inputs_of(model)
    lines = [f"    {line}" for line in statements(model.tape, results.values(), names, "const double t{} = {};")]
    return f"{_head_of(name, given, results)}\n{{\n" + "\n".join([*lines, *_written(results, names)]) + "\n}"


def _head_of(name: str, given: str, results: Iterable[str]) -> str:
    arguments = [f"const double *{array}" for array in given] + [f"double *{array}" for array in results]
    return f"void {name}({', '.join(arguments)})"


def _written(results: Mapping[str, Sequence[Real]], names: dict[int, str]) -> list[str]:
    """Assignments of the results to their arrays."""
    every = ((array, k, value) for array, values in results.items() for k, value in enumerate(values))
    return [f"    {array}[{k}] = {operand(value, names)};" for array, k, value in every]


BLOCK = 1000
"""Number of operations of a C function of a long computation: the time of compilers grows faster than this number."""


def in_blocks(model: Model, name: str, results: Mapping[str, Sequence[Real]], static: str = "") -> str:
    """A function of x and u that writes arrays, in short functions that share an array of results."""
    check_length(model.tape, model.chain)
    names = inputs_of(model)
    lines = statements(model.tape, results.values(), names, "t[{}] = {};", "t[{}]")
    blocks = [lines[first : first + BLOCK] for first in range(0, len(lines), BLOCK)]
    written, place = _written(results, names), re.compile(r"t\[(\d+)\]")
    last = {int(k): b for b, block in enumerate([*blocks, written]) for line in block for k in place.findall(line)}
    shared = {k: row for row, k in enumerate(k for k in range(len(lines)) if last[k] > k // BLOCK)}

    def placed(line: str) -> str:
        return place.sub(lambda found: f"t[{shared[k]}]" if (k := int(found[1])) in shared else f"t{k}", line)

    def body(first: int, block: list[str]) -> str:
        kinds = ("" if k in shared else "const double " for k in range(first, first + len(block)))
        return "\n".join(f"    {kind}{placed(line)}" for kind, line in zip(kinds, block, strict=True))

    parts = [
        f"static void {name}_{b}(const double *x, const double *u, double *t)\n"
        f"{{\n    (void)x, (void)u;\n{body(b * BLOCK, block)}\n}}"
        for b, block in enumerate(blocks)
    ]
    calls = [f"    {name}_{b}(x, u, t);" for b in range(len(blocks))]
    begin = [f"    double t[{max(len(shared), 1)}];", "    (void)x, (void)u, (void)t;"]
    main = "\n".join([*begin, *calls, *map(placed, written)])
    return "\n\n".join([*parts, f"{static}{_head_of(name, 'xu', results)}\n{{\n{main}\n}}"])


def inputs_of(model: Model) -> dict[int, str]:
    """Names of the states and inputs in the code."""
    names = {number.line: f"x[{k}]" for k, number in enumerate(model.x)}
    return names | {number.line: f"u[{k}]" for k, number in enumerate(model.u)}


def statements(
    tape: Tape, results: Iterable[Sequence[Real]], names: dict[int, str], pattern: str, place: str = "t{}",
    prefix: str = "", choose: str = "{} >= 0.0 ? {} : {}",
) -> list[str]:  # fmt: skip
    """Assignments of all lines that the results need, in C's and Python's notation.

    `names` receives the names of the results, `place` with their number; `pattern` takes the number and the expression.
    Functions have a `prefix`, and the choice by a sign its own format.
    """
    found = list[str]()
    forms = {sign: f"{{}} {sign} {{}}" for sign in "+-*/"} | {"neg": "-{}", "choose": choose}
    for line in tape.needed([value for values in results for value in values]):
        name, operands = tape.operations[line]
        terms = [names[a] if isinstance(a, int) else f"({a!r})" for a in operands]
        if name == "held":
            names[line] = terms[0]
        elif name != "input":
            names[line] = place.format(len(found))
            text = forms[name].format(*terms) if name in forms else f"{prefix}{name}({', '.join(terms)})"
            found.append(pattern.format(len(found), text))
    return found


def operand(value: Real, names: dict[int, str]) -> str:
    """A result as text."""
    return names[value.line] if isinstance(value, Number) else repr(float(value))


def _test(model: Model, name: str) -> str:
    rows, n, m = cases(model.chain), len(model.x), max(len(model.u), 1)
    words = {"@count": f"{len(rows)}", "@n": f"{n}", "@m": f"{m}", "@allowed": repr(ALLOWED)}
    words["@size"] = repr(max(float(model.chain.size), 1e-300))
    for word, table in zip(("@x", "@u", "@dx", "@tip"), zip(*rows, strict=True), strict=True):
        lines = (", ".join(repr(float(x)) for x in row) or "0.0" for row in table)  # 0.0: C has no empty arrays
        words[word] = ",\n".join(f"    {{{line}}}" for line in lines)
    return template("test.c", name, words)
