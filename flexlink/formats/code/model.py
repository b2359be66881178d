"""Equations of motion of a chain on a tape: ẋ = f(x, u) with x = (z, ż), and the position of the tip.

They are those of the kernels `forward_dynamics` and `forward_kinematics`, so code has every feature of a chain. Their
derivatives follow from inverse dynamics at given z̈, with T_net = T_EX − T_FL − T_FR − T_GC − M q̈:

    Φᵀ M Φ ∂z̈/∂x = ∂(Φᵀ T_net)/∂x        Φᵀ M Φ = −∂(Φᵀ T_net)/∂z̈

`cases` are states with ẋ from the compiled kernels, for the test that generated code contains.
"""

from __future__ import annotations

import math
import re
from types import CellType, FunctionType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.accelerations import forward_dynamics as by_solver
from flexlink.dynamics.free_motion import all_motions, first_joints
from flexlink.dynamics.placement import tip_position
from flexlink.formats.code.tape import Number, Real, Tape, chosen
from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.bodies.plane import planar_workspace
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.forces import rotation_springs
from flexlink.kernels.forces.elements import add_torques, forces_of
from flexlink.kernels.forces.joint_torques import elastic, friction
from flexlink.kernels.forces.rotation_springs import ROW
from flexlink.kernels.forward.articulated_rows import articulated_workspace
from flexlink.kernels.forward.shaped import shaped_workspace
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.tools import lanes, rare, sincos, solve

ALLOWED = 1e-8
"""Largest difference of ẋ in the test of a file, relative to its largest entry; arms may be stiff."""


class Model(NamedTuple):
    """Equations of a chain on a tape."""

    chain: Chain
    tape: Tape
    x: list[Number]  # z, ż
    u: list[Number]  # torques of the driven joints; accelerations of joints with a given motion
    rate: list[Real]  # ẋ
    tip: list[Real]  # position [m]


def model_of(chain: Chain) -> Model:
    """Equations of motion of a chain."""
    tape, m, joints = Tape(), chain.freedoms, first_joints(chain, np.arange(chain.n))
    x, u = [tape.input() for _ in range(2 * m)], [tape.input() for _ in chain.active]
    q, qd, tau, qdd = _state(chain, x, u)
    if chain.shapes is None:
        work = on_tape(planar_workspace if chain.is_planar else articulated_workspace)(*chain.arrays)
    else:
        work = on_tape(shaped_workspace)(chain.arrays, chain.shapes, _inverse_workspace(chain))
    on_tape(forward_dynamics)(np.zeros(6), q, qd, tau, qdd, work)
    zdd = np.where(chain.held[joints], qdd[joints], qdd if chain.shapes is None else work.z)
    return Model(chain, tape, x, u, [*x[m:], *zdd], list(on_tape(forward_kinematics)(chain.arrays, q).points[-1]))


def _state(chain: Chain, x: list[Number], u: list[Number]) -> tuple[Objects, Objects, Objects, Objects]:
    """Angles, rates, torques and given accelerations of all joints."""
    Φ, m, given, inputs = all_motions(chain), chain.freedoms, chain.held, np.zeros(chain.n, object)
    inputs[chain.active] = u
    q = Φ @ np.array(x[:m]) + (0.0 if chain.shapes is None else chain.rest)
    return q, Φ @ np.array(x[m:]), np.where(given, 0.0, inputs), np.where(given, inputs, 0.0)


def _inverse_workspace(chain: Chain) -> Any:
    return on_tape(planar_workspace)(*chain.arrays) if chain.is_planar else on_tape(rne_workspace)(chain.arrays)


def slopes_of(model: Model) -> tuple[list[list[Real]], list[list[Real]]]:
    """Columns of ∂ẋ/∂x and ∂ẋ/∂u."""
    chain, tape, m, by = model.chain, model.tape, model.chain.freedoms, [*model.x, *model.u]
    free = np.flatnonzero(~chain.held[first_joints(chain, np.arange(chain.n))])
    rate = np.array(model.rate, object)
    rate[m + free] = [tape.hold(each) for each in rate[m + free]]
    net = _net_torques(chain, *_state(chain, model.x, model.u)[:3], all_motions(chain) @ rate[m:])[free].tolist()
    M = -np.array([tape.slopes(net, each) for each in rate[m + free]], object)
    columns = np.array([tape.slopes(rate.tolist(), each) for each in by], object)
    columns[:, m + free] = solve_symmetric(M, np.array([tape.slopes(net, each) for each in by], object).T).T
    return columns[: 2 * m].tolist(), columns[2 * m :].tolist()


def _net_torques(chain: Chain, q: Objects, qd: Objects, tau: Objects, qdd: Objects) -> Objects:
    """Φᵀ T_net."""
    arrays, required, forces = chain.arrays, np.zeros(chain.n, object), on_tape(forces_of)(chain.arrays)
    on_tape(inverse_dynamics_into)(arrays, np.zeros(6), q, qd, qdd, required, _inverse_workspace(chain))
    if forces is not None:
        on_tape(add_torques)(forces.elements, q, qd, required)
    for k, hinge in enumerate(chain.hinges):
        required[k] = required[k] + on_tape(elastic)(hinge, q[k]) + on_tape(friction)(hinge, qd[k])
    return np.asarray(all_motions(chain).T @ (tau - required))


class Case(NamedTuple):
    """A state with its derivative and the position of the tip."""

    x: Array
    u: Array
    rate: Array
    tip: Array


def cases(chain: Chain) -> list[Case]:
    """Three random states of small deflections."""
    rng, Φ, m, found = np.random.default_rng(0), all_motions(chain), chain.freedoms, list[Case]()
    rest, back = (0.0, Φ) if chain.shapes is None else (chain.rest, chain.shapes.inverse.T)
    for _ in range(3):
        x, u = rng.normal(size=2 * m), rng.normal(size=len(chain.active))
        x[:m] *= 0.1 / np.maximum(1.0, np.abs(Φ).sum(axis=0))
        u[chain.held[chain.active]] = 0.0  # as in `forward_dynamics`
        q, qd, tau = rest + Φ @ x[:m], Φ @ x[m:], np.zeros(chain.n)
        tau[chain.active] = u
        found.append(Case(x, u, np.append(x[m:], back @ by_solver(chain, q, qd, tau)), tip_position(chain, q)))
    return found


def name_of(chain: Chain) -> str:
    """Name of the arm as an identifier of C and Python."""
    name = re.sub(r"[^0-9a-zA-Z_]", "_", chain.name)
    return name if name[:1].isalpha() else f"arm_{name}"


# The kernels of the library in another arithmetic: one algorithm, for floats and for the numbers of a tape.
#
# `on_tape` copies a kernel as a Python function, together with all kernels that it calls. Only what depends on the type
# of numbers is replaced: `numpy` and `math` by functions for all types, whose arrays contain objects, and the few
# kernels that decide by a number.


Objects = NDArray[np.object_]  # of numbers of a tape and floats


def cos_sin_all(x: Objects, cosines: Objects, sines: Objects) -> bool:
    """`cos_sin_all`; angles on a tape are never too large."""
    for k in range(len(x)):
        cosines[k], sines[k] = np.cos(x[k]), np.sin(x[k])
    return False


def solve_symmetric(M: Objects, b: Objects, _: Any = None) -> Objects:
    """`solve_cholesky` by M = L D Lᵀ, for b (n,) or (n, columns), without its test whether M is singular; returns b."""
    for j in range(len(b)):
        for l in range(j):
            b[j] = b[j] - b[l] * M[j, l]
            M[j:, j] = M[j:, j] - M[j:, l] * (M[j, l] * M[l, l])
        M[j + 1 :, j] = M[j + 1 :, j] / M[j, j]
    for j in range(len(b) - 1, -1, -1):
        b[j] = b[j] / M[j, j]
        for i in range(j + 1, len(b)):
            b[j] = b[j] - b[i] * M[i, j]
    return b


class Least:
    """A limit that every number reaches."""

    def __le__(self, other: object) -> bool:
        return True


def find_far(numbers: Objects) -> None:
    """`find_far` of springs of rotation vectors, for every quaternion; it keeps the series where they are exact."""
    for k, (w, square) in enumerate(numbers[[ROW.w, ROW.square]].T):
        if isinstance(square, Number):
            sine = square.sqrt()
            half = sine.arctan2(w)
            for row, far in (ROW.factor, 2.0 * half / sine), (ROW.g, (1.0 - half * w / sine) / (4.0 * half * half)):
                numbers[row, k] = chosen(square - rotation_springs.NEAR, far, chosen(w, numbers[row, k], far))


objects = SimpleNamespace(**vars(np) | {
    "zeros": lambda shape, kind=object: np.zeros(shape, kind),
    "empty": lambda shape, kind=object: np.empty(shape, kind),
})  # fmt: skip
COPIES: dict[int, Any] = {id(original): copy for original, copy in (
    (np, objects), (math, objects), (rare.rarely, bool), (lanes.at, lambda array, *index: array[index]),
    (sincos.cos_sin_all, cos_sin_all), (solve.solve_cholesky, solve_symmetric),
    (rotation_springs.NEAR, Least()), (rotation_springs.find_far, find_far),
)}  # fmt: skip
"""Replacements, and copies of kernels, by the id of the original."""


def on_tape(value: Any) -> Any:
    """A kernel, or a table of kernels by name or type, for numbers of a tape; the replacement of any other object."""
    plain = getattr(value, "py_func", value)
    if id(value) in COPIES:
        return COPIES[id(value)]
    if isinstance(value, dict):
        table = COPIES[id(value)] = dict[Any, Any]()  # known before its kernels are copied, which refer to it
        table.update({key: on_tape(each) for key, each in value.items()})
        return table
    if not isinstance(plain, FunctionType) or not plain.__module__.startswith("flexlink.kernels"):
        return value
    names, cells = on_tape(plain.__globals__), plain.__closure__
    held = None if cells is None else tuple(CellType(on_tape(cell.cell_contents)) for cell in cells)
    return COPIES.setdefault(id(value), FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, held))
