"""The functions of one chain with little cost per call, for loops such as those of a controller or an optimizer."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import NO_WRENCH, require_type
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics import derivatives
from flexlink.dynamics.accelerations import accelerations, forward_dynamics
from flexlink.dynamics.placement import ORIGIN, jacobian, jacobian_columns
from flexlink.dynamics.terms import composite, inverse_dynamics, mass_matrix, newton_euler

OfState = Callable[[ArrayLike, ArrayLike, ArrayLike], Array]
OfPosition = Callable[[ArrayLike], Array]


class Dynamics:
    """The functions of one chain, each at about the cost of its recursion.

    For robots of a few joints the public functions spend more time on finding what belongs to the chain and on the
    objects that they return than on the equation of motion. This class does the former once, and returns arrays. The
    numbers are equal bit for bit. An argument that is not a float64 array of shape (n,) is treated as by the public
    function of the same name, with its errors; it may be a list, or contain b states. Tip wrenches are for the public
    functions only.

    Parameters
    ----------
    chain
        The chain. All objects of one chain share its scratch, also in threads: Python's lock is held during a call.

    Raises
    ------
    ArgumentError
        The argument is not a chain, or as for the public functions.

    Examples
    --------
    >>> dynamics = fl.Dynamics(chain)
    >>> v, omega = dynamics.jacobian(q) @ np.ones(chain.n)  # of the tip, in axes of frame 0
    >>> torque = dynamics.inverse_dynamics(q, qd, qdd)
    >>> print(v[:2].round(3), torque[:1].round(2), dynamics.mass_matrix(q).shape)  # m/s, N m
    [1.032 5.186] [77.6] (6, 6)
    """

    forward_dynamics: OfState
    """q̈ of `flexlink.forward_dynamics` as a function of q [rad], q̇ [rad/s] and T_EX [N m], shape (n,) [rad/s²]."""
    inverse_dynamics: OfState
    """τ = M q̈ + T_GC of `flexlink.inverse_dynamics` as a function of q, q̇ and q̈ [rad/s²], shape (n,) [N m]."""
    mass_matrix: OfPosition
    """M of `flexlink.mass_matrix` as a function of q, shape (n, n) [kg m²]."""
    jacobian: OfPosition
    """J_v and J_ω of `flexlink.jacobian` for the tip as a function of q, in one array of shape (2, 3, n)."""
    forward_dynamics_derivatives: OfState
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX as a function of q, q̇ and T_EX, in one array of shape (3, n, n)."""
    inverse_dynamics_derivatives: OfState
    """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ = M as a function of q, q̇ and q̈, in one array of shape (3, n, n)."""

    def __init__(self, chain: Chain) -> None:
        n, tip = require_type("chain", chain, Chain).n, len(chain.bodies) - 1
        self.chain = chain
        self.forward_dynamics = _of_state(accelerations(chain), (n,), functools.partial(forward_dynamics, chain))
        self.inverse_dynamics = _of_state(newton_euler(chain), (n,), functools.partial(inverse_dynamics, chain))
        self.mass_matrix = _of_position(composite(chain), (n, n), functools.partial(mass_matrix, chain))
        self.jacobian = _of_position(jacobian_columns(chain), (2, 3, n), _stacked(jacobian, chain), tip, ORIGIN)
        of_torques = _stacked(derivatives.inverse_dynamics_derivatives, chain)
        self.inverse_dynamics_derivatives = _of_state(derivatives.inverse_derivatives(chain), (3, n, n), of_torques)
        of_accelerations = _stacked(derivatives.forward_dynamics_derivatives, chain)
        if chain.shapes is None:  # as in the public function
            of_accelerations = _of_state(derivatives.forward_derivatives(chain), (3, n, n), of_accelerations)
        self.forward_dynamics_derivatives = of_accelerations
        for name, function in [*vars(self).items()][1:]:  # for messages
            function.__qualname__ = f"Dynamics.{name}"

    def __reduce__(self) -> tuple[Any, ...]:
        return Dynamics, (self.chain,)

    def __repr__(self) -> str:
        return f"<Dynamics of {self.chain.name!r}: {self.chain.n} joints>"


def _of_state(kernel: Any, shape: tuple[int, ...], checked: OfState) -> OfState:
    """The kernel as a function of a state; states of another form go to the checked function."""
    quick, new = functools.partial(kernel.quick, NO_WRENCH), np.empty

    def function(q: ArrayLike, qd: ArrayLike, tau_or_qdd: ArrayLike) -> Array:
        found = new(shape)
        try:
            if quick(q, qd, tau_or_qdd, found):
                return found
        except ValueError:  # an empty list
            pass
        return checked(q, qd, tau_or_qdd)

    return function


def _of_position(kernel: Any, shape: tuple[int, ...], checked: OfPosition, *given: Any) -> OfPosition:
    """As `_of_state`, of the position alone; `given` are the kernel's arguments before it."""
    quick, new = functools.partial(kernel.quick, *given), np.zeros

    def function(q: ArrayLike) -> Array:
        found = new(shape)
        try:
            if quick(q, found):
                return found
        except ValueError:  # an empty list
            pass
        return checked(q)

    return function


def _stacked(function: Callable[..., Any], chain: Chain) -> Callable[..., Array]:
    """The arrays of a function's result as one array."""
    return lambda *state: np.stack([*vars(function(chain, *state)).values()], axis=-3)
