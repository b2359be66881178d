"""Equations of motion of a chain on a tape: ẋ = f(x, u) with x = (z, ż), and the position of the tip.

They are those of the kernels `forward_dynamics` and `forward_kinematics`, so code has every feature of a chain. Their
derivatives follow from inverse dynamics at given z̈, with T_net = T_EX − T_FL − T_FR − T_GC − M q̈:

    Φᵀ M Φ ∂z̈/∂x = ∂(Φᵀ T_net)/∂x        Φᵀ M Φ = −∂(Φᵀ T_net)/∂z̈

On request the inputs include the tip wrench and parameters, so derivatives by them are derivatives by inputs.

`cases` are states with ẋ from the compiled kernels, for the test that generated code contains.
"""

from __future__ import annotations

import math
import re
from types import CellType, FunctionType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
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
from flexlink.kernels.forward import articulated_layout
from flexlink.kernels.forward.articulated_rows import articulated_workspace
from flexlink.kernels.forward.shaped import shaped_workspace
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.layout import ChainArrays
from flexlink.kernels.tools import lanes, rare, sincos, solve

ALLOWED = 1e-8  # largest difference of ẋ in the test of a file, relative to its largest entry; arms may be stiff


class Model(NamedTuple):
    """Equations of a chain on a tape."""

    chain: Chain
    arrays: ChainArrays  # with parameters as numbers of the tape
    wrench: Objects  # on the tip, (6,)
    tape: Tape
    x: list[Number]  # z, ż
    u: list[Number]  # torques of the driven joints; accelerations of joints with a given motion; extra inputs
    rate: list[Real]  # ẋ
    tip: list[Real]  # position [m]
    turned: list[Real]  # rotation of the tip frame, R: v_0 = R v_tip, row by row


def extra_inputs() -> dict[str, str]:
    """Names, with units, and descriptions of the inputs that follow those of the joints on request."""
    return {
        **{f"tip.force.{axis} [N]": "force on the tip, in axes of frame 0" for axis in "xyz"},
        **{f"tip.moment.{axis} [N m]": "moment on the tip, in axes of frame 0" for axis in "xyz"},
        **{f"gravity.{axis} [m/s²]": "acceleration due to gravity, in axes of frame 0" for axis in "xyz"},
        "payload [kg]": "point mass at the tip, in addition to the arm's own",
        "stiffness [1]": "factor of the springs of all hinges that no drive moves",
        "damping [1]": "factor of the viscous damping of all hinges that no drive moves",
    }


def model_of(chain: Chain, *, extra: bool = False) -> Model:
    """Equations of motion of a chain, on request with the `extra_inputs`."""
    tape, m, joints = Tape(), require_type("chain", chain, Chain).freedoms, first_joints(chain, np.arange(chain.n))
    x, u = [tape.input() for _ in range(2 * m)], [tape.input() for _ in chain.active]
    q, qd, tau, qdd = state_of(chain, x, u)
    more = [tape.input() for _ in extra_inputs() if extra]
    arrays, wrench = _with_parameters(chain, more[6:]), np.array(more[:6] or np.zeros(6), object)
    if chain.shapes is None:
        work = on_tape(planar_workspace if chain.is_planar else articulated_workspace)(arrays)
    else:
        work = on_tape(shaped_workspace)(arrays, chain.shapes, _inverse_workspace(chain, arrays))
    on_tape(forward_dynamics)(wrench, q, qd, tau, qdd, work)
    zdd = np.where(chain.held[joints], qdd[joints], qdd if chain.shapes is None else work.z)
    placed = on_tape(forward_kinematics)(arrays, q)
    tip, R = list(placed.points[-1]), [*placed.rotations[-1].flat]
    return Model(chain, arrays, wrench, tape, x, [*u, *more], [*x[m:], *zdd], tip, R)


def _with_parameters(chain: Chain, parameters: list[Number]) -> ChainArrays:
    """Arrays of a chain with its parameters, the last `extra_inputs`, in place of their values."""
    if not parameters:
        return chain.arrays
    *gravity, payload, stiffness, damping = parameters
    bodies, hinges, couplings = map(_of_objects, (chain.bodies, chain.hinges, chain.couplings))
    bodies[-1]["mass"] = payload + bodies[-1]["mass"]
    passive = np.setdiff1d(np.arange(chain.n), chain.active)
    hinges["stiffness"][passive] *= stiffness
    hinges["damping"][passive] *= damping
    couplings["stiffness"] *= stiffness
    couplings["damping"] *= damping
    rare = chain.arrays.rare if chain.arrays.rare is None else chain.arrays.rare._replace(couplings=couplings)
    return ChainArrays(bodies, hinges, np.array(gravity, object), rare)


def _of_objects(records: NDArray[np.void]) -> NDArray[np.void]:
    """A copy of records whose floats are objects, and may become numbers of a tape."""
    kinds = {name: records.dtype[name] for name in records.dtype.names or ()}
    fields = [(name, object if kind.base == np.float64 else kind.base, kind.shape) for name, kind in kinds.items()]
    return records.astype(np.dtype((np.record, np.dtype(fields))))


def state_of(chain: Chain, x: list[Number], u: list[Number]) -> tuple[Any, Any, Any, Any]:
    """Angles, rates, torques and given accelerations of all joints."""
    Φ, m, given, inputs = all_motions(chain), chain.freedoms, chain.held, np.zeros(chain.n, object)
    inputs[chain.active] = u[: len(chain.active)]
    q = Φ @ np.array(x[:m]) + (0.0 if chain.shapes is None else chain.rest)
    return q, Φ @ np.array(x[m:]), np.where(given, 0.0, inputs), np.where(given, inputs, 0.0)


def _inverse_workspace(chain: Chain, arrays: ChainArrays) -> Any:
    return on_tape(planar_workspace if chain.is_planar else rne_workspace)(arrays)


def implicit_of(model: Model) -> tuple[Indices, Objects, Objects, Objects]:
    """Rows of ż of the free coordinates, M and N of M ∂z̈/∂(x, u) = N for them, and ∂ẋ/∂(x, u) at their given z̈."""
    chain, tape, m, by = model.chain, model.tape, model.chain.freedoms, [*model.x, *model.u]
    free = np.flatnonzero(~chain.held[first_joints(chain, np.arange(chain.n))])
    rate = np.array(model.rate, object)
    rate[m + free] = [tape.hold(each) for each in rate[m + free]]
    net = _net_torques(model, *state_of(chain, model.x, model.u)[:3], all_motions(chain) @ rate[m:])[free].tolist()
    M = -np.array(tape.slopes(net, rate[m + free]), object)
    N, known = (np.array(tape.slopes(rows, by), object).T for rows in (net, rate.tolist()))
    return m + free, M, N.reshape(len(free), len(by)), known


def slopes_of(model: Model) -> tuple[list[list[Real]], list[list[Real]]]:
    """Columns of ∂ẋ/∂x and ∂ẋ/∂u."""
    free, M, N, slopes = implicit_of(model)
    slopes[free] = solve_symmetric(M, N)
    return slopes.T[: len(model.x)].tolist(), slopes.T[len(model.x) :].tolist()


def _net_torques(model: Model, q: Objects, qd: Objects, tau: Objects, qdd: Objects) -> Objects:
    """Φᵀ T_net."""
    chain, arrays, forces = model.chain, model.arrays, on_tape(forces_of)(model.arrays)
    required = np.zeros(chain.n, object)
    on_tape(inverse_dynamics_into)(arrays, model.wrench, q, qd, qdd, required, _inverse_workspace(chain, arrays))
    if forces is not None:
        on_tape(add_torques)(forces.elements, q, qd, required)
    for k, hinge in enumerate(arrays.hinges):
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


def layout_of(bodies: Any, hinges: Any) -> Any:
    """`layout_of`, for which a mass on the tape is not 0."""
    known = bodies.copy()
    known["mass"] = [1.0 if isinstance(mass, Number) else mass for mass in bodies["mass"]]
    return _copy(articulated_layout.layout_of.py_func)(known, hinges)


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
    (articulated_layout.layout_of, layout_of), (rotation_springs.NEAR, Least()), (rotation_springs.find_far, find_far),
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
    return COPIES.setdefault(id(value), _copy(plain))


def _copy(plain: FunctionType) -> FunctionType:
    """A function that sees the copies of all that it refers to."""
    names, cells = on_tape(plain.__globals__), plain.__closure__
    held = None if cells is None else tuple(CellType(on_tape(cell.cell_contents)) for cell in cells)
    return FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, held)
