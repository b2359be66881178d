"""Python code of the equations of motion for CasADi, and a model for acados, with a self-test."""

from __future__ import annotations

from flexlink.chain.chain import Chain
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.c_text import check_length, inputs_of, operand, statements
from flexlink.formats.code.model import ALLOWED, cases, model_of, name_of


def to_casadi(chain: Chain) -> str:
    """Equations of motion of an arm as a Python module for CasADi: ẋ = f(x, u) and the tip as SX expressions.

    The module defines `STATES` and `INPUTS`, names with units; `model()`, which returns x, u, ẋ and the tip [m];
    `functions()`, which returns the CasADi functions f(x, u) and tip(x), whose derivatives CasADi computes exactly;
    `acados_model()`; and `test()`, which compares f and tip with numbers of flexlink's solver. Run as a program, the
    module tests itself. States and inputs are those of `to_c`.

    Parameters
    ----------
    chain
        The chain.

    Returns
    -------
    str
        The text of a .py file, which needs only casadi.

    Raises
    ------
    ArgumentError
        As in `to_c`.

    Examples
    --------
    >>> text = fl.to_casadi(chain)
    >>> print("'q upper [rad]'" in text, "def acados_model():" in text)
    True True
    """
    model, name = model_of(chain), name_of(chain)
    check_length(model.tape, chain)
    names = inputs_of(model)
    results = [model.rate, model.tip]
    lines = statements(model.tape, results, names, "t{} = {}", "t{}", "ca.", "ca.if_else({} >= 0.0, {}, {})")
    body = "\n    ".join(lines)
    rate, tip = (", ".join(operand(value, names) for value in values) for values in results)
    tests = ",\n".join(f"    {tuple(part.tolist() for part in row)!r}" for row in cases(chain))
    return f'''"""Equations of motion of {chain.name.replace(chr(34), "'")!r} for CasADi, written by flexlink."""

import casadi as ca

STATES = {state_names(chain)!r}
INPUTS = {input_names(chain)!r}


def model():
    """Return x, u, the derivative of x and the position of the tip [m], as SX expressions."""
    x, u = ca.SX.sym("x", {len(model.x)}), ca.SX.sym("u", {len(model.u)})
    {body}
    return x, u, ca.vertcat({rate}), ca.vertcat({tip})


def functions():
    """Return the CasADi functions f(x, u), the derivative of x, and tip(x) [m]."""
    x, u, rate, tip = model()
    f = ca.Function("f", [x, u], [rate], ["x", "u"], ["dx"])
    return f, ca.Function("tip", [x], [tip], ["x"], ["tip"])


def acados_model():
    """Return the model for acados."""
    from acados_template import AcadosModel

    x, u, rate, _ = model()
    dx = ca.SX.sym("dx", {len(model.x)})
    found = AcadosModel()
    found.name, found.x, found.u, found.xdot = {name!r}, x, u, dx
    found.f_expl_expr, found.f_impl_expr = rate, dx - rate
    return found


TESTS = [  # x, u, dx, tip
{tests}
]


def test():
    """Return the largest relative difference from numbers of flexlink's solver; fail if it exceeds {ALLOWED!r}."""
    f, tip = functions()
    worst = 0.0
    for x, u, dx, end in TESTS:
        worst = max(worst, float(ca.norm_inf(f(x, u) - ca.DM(dx))) / max(map(abs, dx)))
        worst = max(worst, float(ca.norm_inf(tip(x) - ca.DM(end))) / {max(float(chain.size), 1e-300)!r})
    assert worst <= {ALLOWED!r}, worst
    return worst


if __name__ == "__main__":
    print(f"largest relative difference from flexlink: {{test():.2g}}")
'''
