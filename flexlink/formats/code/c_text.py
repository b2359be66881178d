"""C code of the equations of motion, without dependencies, with derivatives and a self-test."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.model import ALLOWED, Model, cases, model_of, name_of, slopes_of
from flexlink.formats.code.tape import Number, Real, Tape

LONGEST = 400_000
"""Largest number of operations of a file."""


def to_c(chain: Chain, *, slopes: bool = False) -> str:
    """Equations of motion of an arm as C code: ẋ = f(x, u), the tip, and the derivatives ∂f/∂x and ∂f/∂u.

    The states x are angles and rates (z, ż) of all joints or, for links with `modes`, of their shapes; the inputs u are
    the torques of the driven joints, or their accelerations if their motion is prescribed. Their names and units are in
    the first comment. Functions, with the arm's name for `arm`; arrays are row-major:

        void arm_rate(const double *x, const double *u, double *dx);
        void arm_tip(const double *x, double *tip);                             position in frame 0 [m]
        void arm_slopes(const double *x, const double *u, double *A, double *B);

    Compiled with -DARM_TEST (the name in capitals), the file is a program that compares `arm_rate` and `arm_tip` with
    numbers of flexlink's solver, and returns 0 if they agree.

    Parameters
    ----------
    chain
        The chain.
    slopes
        Whether the file contains `arm_slopes`, which then has most of its lines, and takes compilers up to minutes.

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
    rate = f"void {name}_rate(const double *x, const double *u, double *dx)"
    tip = f"void {name}_tip(const double *x, double *tip)"
    parts = [_head(model, name), _function(model, rate, {"dx": model.rate}), _function(model, tip, {"tip": model.tip})]
    if slopes:
        by_x, by_u = ([*itertools.chain.from_iterable(zip(*by, strict=True))] for by in slopes_of(model))  # row by row
        head = f"void {name}_slopes(const double *x, const double *u, double *A, double *B)"
        parts.append(_in_blocks(model, head, f"{name}_slopes", {"A": by_x, "B": by_u}))
    return "\n\n".join([*parts, _test(model, name)]) + "\n"


def check_length(tape: Tape, chain: Chain) -> None:
    """Refuse code with too many operations."""
    if len(tape.operations) > LONGEST:
        text = f"code of more than {LONGEST} operations; use fewer segments, strain modes, or slopes=False"
        raise ArgumentError(f"{chain.name}: {text}", id="code-too-long")


def _head(model: Model, name: str) -> str:
    rows = [f"x[{k}] {state}" for k, state in enumerate(state_names(model.chain))]
    rows += [f"u[{k}] {given}" for k, given in enumerate(input_names(model.chain))]
    listed = "\n".join(f"   {row}" for row in rows).replace("*/", "* /")
    return (
        f"/* Equations of motion of {model.chain.name.replace('*/', '* /')!r}, written by flexlink.\n{listed}\n*/\n"
        f"#include <math.h>\n\n#define {name.upper()}_STATES {len(model.x)}\n"
        f"#define {name.upper()}_INPUTS {len(model.u)}"
    )


def _function(model: Model, head: str, results: Mapping[str, Sequence[Real]]) -> str:
    """A function that writes arrays."""
    check_length(model.tape, model.chain)
    names = inputs_of(model)
    lines = [f"    {line}" for line in statements(model.tape, results.values(), names, "const double t{} = {};")]
    return head + "\n{\n" + "\n".join([*lines, *_written(results, names)]) + "\n}"


def _written(results: Mapping[str, Sequence[Real]], names: dict[int, str]) -> list[str]:
    """Assignments of the results to their arrays."""
    every = ((array, k, value) for array, values in results.items() for k, value in enumerate(values))
    return [f"    {array}[{k}] = {operand(value, names)};" for array, k, value in every]


BLOCK = 1000
"""Number of operations of a C function of a long computation: the time of compilers grows faster than this number."""


def _in_blocks(model: Model, head: str, name: str, results: Mapping[str, Sequence[Real]]) -> str:
    """A function that writes arrays, divided into short functions that share an array of intermediate results."""
    check_length(model.tape, model.chain)
    names = inputs_of(model)
    lines = statements(model.tape, results.values(), names, "t[{}] = {};", "t[{}]")
    blocks = [lines[first : first + BLOCK] for first in range(0, len(lines), BLOCK)]
    arguments = "const double *x, const double *u, double *t"
    parts = [
        f"static void {name}_{k}({arguments})\n{{\n    (void)u;\n" + "\n".join(f"    {line}" for line in block) + "\n}"
        for k, block in enumerate(blocks)
    ]
    calls = [f"    {name}_{k}(x, u, t);" for k in range(len(blocks))]
    body = "\n".join([f"    double t[{max(len(lines), 1)}];", *calls, *_written(results, names)])
    return "\n\n".join([*parts, f"{head}\n{{\n{body}\n}}"])


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
    rows = cases(model.chain)

    def table(values: Iterable[Iterable[float]]) -> str:
        return ",\n".join("    {" + ", ".join(repr(float(x)) for x in row) + "}" for row in values)

    n, m, count = len(model.x), len(model.u), len(rows)
    return f"""#ifdef {name.upper()}_TEST
#include <stdio.h>
static const double {name}_case_x[{count}][{n}] = {{\n{table(row.x for row in rows)}\n}};
static const double {name}_case_u[{count}][{max(m, 1)}] = {{\n{table(row.u if m else [0.0] for row in rows)}\n}};
static const double {name}_case_dx[{count}][{n}] = {{\n{table(row.rate for row in rows)}\n}};
static const double {name}_case_tip[{count}][3] = {{\n{table(row.tip for row in rows)}\n}};
int main(void)
{{
    double worst = 0.0, dx[{n}], tip[3];
    for (int i = 0; i < {count}; i++) {{
        double size = 1e-300, off = 0.0;
        {name}_rate({name}_case_x[i], {name}_case_u[i], dx);
        {name}_tip({name}_case_x[i], tip);
        for (int k = 0; k < {n}; k++) {{
            size = fmax(size, fabs({name}_case_dx[i][k]));
            off = fmax(off, fabs(dx[k] - {name}_case_dx[i][k]));
        }}
        worst = fmax(worst, off / size);
        for (int k = 0; k < 3; k++)
            worst = fmax(worst, fabs(tip[k] - {name}_case_tip[i][k]) / {max(float(model.chain.size), 1e-300)!r});
    }}
    printf("largest relative difference from flexlink: %.2g\\n", worst);
    return worst <= {ALLOWED!r} ? 0 : 1;
}}
#endif"""
