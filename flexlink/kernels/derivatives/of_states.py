"""Derivatives of forward and inverse dynamics at one state or at many; the type of the scratch selects which ones."""

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
from flexlink.kernels.derivatives.planar_derivatives import OneState, derivatives_in_plane
from flexlink.kernels.tools.address import records
from flexlink.kernels.tools.compiler import allocating, by_type, kernel
from flexlink.kernels.tools.finite import is_finite


@by_type({
    OneState: derivatives_in_plane, ForwardDerivativesWork: derivatives_in_space,
    InverseDerivativesWork: inverse_derivatives,
})  # fmt: skip
def derivatives_into(chain, wrench, q, qd, given, found, work):
    """Write the derivatives by q, q̇ and T_EX or, of inverse dynamics, q̈, (n, n) each; return whether all are finite."""


def derivatives(address, wrench, q, qd, given, found):
    """Write the derivatives to `found` (3, n, n); return whether all are finite, and n finite values given each."""
    chain, work = records(address)
    n = found.shape[1]
    if not (len(q) == n and len(qd) == n and len(given) == n and is_finite(q) and is_finite(qd) and is_finite(given)):
        return False
    return derivatives_into(chain, wrench, q, qd, given, (found[0], found[1], found[2]), work)


@allocating
def derivatives_of_many(chain, wrench, q, qd, given, found, work):
    """Write the derivatives at states (b, n) with wrenches (b, 6) to `found` (3, b, n, n), in turn."""
    finite = True
    for k in range(len(q)):
        slopes = (found[0, k], found[1, k], found[2, k])
        finite = derivatives_into(chain, wrench[k], q[k], qd[k], given[k], slopes, work) and finite
    return finite


@kernel
def forward_derivatives_of_many(chain, wrench, q, qd, tau, found):
    """Write the derivatives of forward dynamics at many states; return whether all are finite."""
    return derivatives_of_many(chain, wrench, q, qd, tau, found, forward_derivatives_workspace(chain))


@kernel
def inverse_derivatives_of_many(chain, wrench, q, qd, qdd, found):
    """Write the derivatives of inverse dynamics at many states; return whether all are finite."""
    return derivatives_of_many(chain, wrench, q, qd, qdd, found, derivatives_workspace(chain))
