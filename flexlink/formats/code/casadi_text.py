"""Python code of the equations of motion for CasADi, and a model for acados, with a self-test."""

from __future__ import annotations

from flexlink.chain.chain import Chain
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.c_text import check_length, inputs_of, operand, statements, with_words
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
    rate, tip = (", ".join(operand(value, names) for value in values) for values in results)
    tests = ",\n".join(f"    {tuple(part.tolist() for part in row)!r}" for row in cases(chain))
    words = {
        "@title": repr(chain.name.replace(chr(34), chr(39))), "@body": "\n    ".join(lines), "@nx": f"{len(model.x)}",
        "@states": repr(state_names(chain)), "@inputs": repr(input_names(chain)), "@nu": f"{len(model.u)}",
        "@rate": rate, "@tests": tests, "@tip": tip, "@name": repr(name), "@allowed": repr(ALLOWED),
        "@size": repr(max(float(chain.size), 1e-300)),
    }  # fmt: skip
    return with_words("casadi.txt", words) + "\n"
