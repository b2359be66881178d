"""Derivatives of forward and inverse dynamics at many states of a chain, computed in turn with the same scratch."""

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
    """Write the derivatives with respect to q, q̇ and `given`, (n, n) each; return whether all are finite.

    `given` is T_EX for forward and q̈ for inverse dynamics.
    """


@kernel
def write_all(chain, wrench, q, qd, given, found, work):
    """Write derivatives at states (b, n) and wrenches (b, 6) to `found` (3, b, n, n); return whether all are finite."""
    finite = True
    for k in range(len(q)):
        slopes = (found[0, k], found[1, k], found[2, k])
        finite = derivatives_into(chain, wrench[k], q[k], qd[k], given[k], slopes, work) and finite
    return finite


@kernel
def forward_derivatives_of_many(chain, wrench, q, qd, tau, found):
    """Write the derivatives of forward dynamics at many states; return whether all are finite."""
    work = forward_derivatives_workspace(chain.bodies, chain.hinges, chain.gravity, chain.rare)
    return write_all(chain, wrench, q, qd, tau, found, work)


@kernel
def inverse_derivatives_of_many(chain, wrench, q, qd, qdd, found):
    """Write the derivatives of inverse dynamics at many states; return whether all are finite."""
    return write_all(chain, wrench, q, qd, qdd, found, derivatives_workspace(chain))
