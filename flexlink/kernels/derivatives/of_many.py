"""Slopes of forward and inverse dynamics at many states of a chain: one after another, on one scratch."""

from flexlink.kernels.derivatives.forward_derivatives import (
    ForwardDerivativesWork,
    derivatives_in_space,
    forward_derivatives_workspace,
)
from flexlink.kernels.derivatives.inverse_derivatives import (
    InverseDerivativesWork,
    derivatives_workspace,
    inverse_derivatives,
)
from flexlink.kernels.tools.compiler import by_type, kernel


@by_type(
    {
        ForwardDerivativesWork: derivatives_in_space,
        InverseDerivativesWork: inverse_derivatives,
    }
)
def derivatives_into(chain, wrench, q, qd, given, found, work):
    """Write the slopes along q, q̇ and `given`, T_EX or q̈, three arrays (n, n); whether all is finite."""


@kernel
def write_all(chain, wrench, q, qd, given, found, work):
    """Slopes of states (b, n), wrenches (b, 6), into `found` (3, b, n, n); whether all are finite."""
    finite = True
    for k in range(len(q)):
        slopes = (found[0, k], found[1, k], found[2, k])
        finite = derivatives_into(chain, wrench[k], q[k], qd[k], given[k], slopes, work) and finite
    return finite


@kernel
def forward_derivatives_of_many(chain, wrench, q, qd, tau, found):
    """Of forward dynamics."""
    work = forward_derivatives_workspace(chain.bodies, chain.hinges, chain.gravity, chain.rare)
    return write_all(chain, wrench, q, qd, tau, found, work)


@kernel
def inverse_derivatives_of_many(chain, wrench, q, qd, qdd, found):
    """Of inverse dynamics."""
    return write_all(chain, wrench, q, qd, qdd, found, derivatives_workspace(chain))
