"""Drag at a stage: less torque of the drive, to forward dynamics, and less of what is left, to inverse dynamics."""

from numba import types
from numba.extending import overload

from flexlink.kernels.bodies.drag import drag_torques
from flexlink.kernels.tools.compiler import INLINED, subroutine
from flexlink.kernels.tools.rare import rarely


@subroutine
def take_drag(loads, q, qd, tau):
    """Take T of drag off the drive torques (n,), which are kept."""
    drag_torques(loads.chain, loads.drag, q, qd, loads.torque, loads.work)
    for k in range(len(tau)):
        loads.kept[k] = tau[k]
        tau[k] -= loads.torque[k]


@subroutine
def give_back(loads, tau):
    """The drive torques as they were; of a joint whose motion is prescribed what it took, and T."""
    for k in range(len(tau)):
        tau[k] = tau[k] + loads.torque[k] if loads.chain.hinges[k].prescribed else loads.kept[k]


@subroutine
def subtract_from(loads, q, qd, left):
    """Subtract T from the torques that are left (n,), but of prescribed joints; returns the power that it takes [W]."""
    power = 0.0
    drag_torques(loads.chain, loads.drag, q, qd, loads.torque, loads.work)
    for k in range(len(left)):
        if not loads.chain.hinges[k].prescribed:
            left[k] -= loads.torque[k]
            power += qd[k] * loads.torque[k]
    return power


def subtract_drag(loads, q, qd, left):
    """The same where there is any; without loads, None, no code is made."""
    return 0.0 if loads is None or not len(loads.drag) else subtract_from(loads, q, qd, left)


@overload(subtract_drag, jit_options=INLINED)
def _subtract_drag(loads, q, qd, left):
    if isinstance(loads, types.NoneType):
        return lambda loads, q, qd, left: 0.0

    def subtract(loads, q, qd, left):
        power = 0.0
        if rarely(len(loads.drag) > 0):
            power = subtract_from(loads, q, qd, left)
        return power

    return subtract
