"""How the numbers of a run change with one number of its scene: chain, drive and start, differentiated by path.

A polynomial goes through their values at M Chebyshev points p + Δ x_k of the number p, whose derivative at p it has:

    f ≈ Σ c_j T_j(x)        c_j = 2/M Σ_k f(x_k) T_j(x_k)        ∂f/∂p ≈ Σ c_j T_j'(x) / Δ

The c_j fall like ρ^−j, 32^−j for a pole at 0 and Δ = p/16; the last two tell whether they have, or f is not smooth.
What is left is rounding, of f by eps, of p ∂f/∂p by some 100 eps f.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec, default_of, fields_of
from flexlink.describe.vary import number_in
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.kernels.derivatives.inverse_derivatives import Arrays
from flexlink.kernels.derivatives.sensitivity import AFFINE, EPSILON, Parametric, torque_derivatives
from flexlink.kernels.layout import BODY, COUPLING, HINGE
from flexlink.motion.inputs.initial_state import initial_state, spread, stated

POINTS = 9
PARTS = 1 / 16, 1 / 128, 1 / 1024
"""Of the number, or of 1 where it is 0: Δ, the first with which the numbers of the run are smooth."""
VARIED = "material", "section", "rigidity", "link", "tip", "base", "drive", "initial"
"""Tables whose numbers are parameters; those of a run change its steps."""


class Numbers(NamedTuple):
    """The numbers that a run is computed from, by the names of its parts."""

    bodies: dict[str, Array]
    hinges: dict[str, Array]
    couplings: dict[str, Array]
    drive: Array  # (3, n) u, v, w of T_EX = u + v q + w q̇, without a table's torques, which are no parameters
    start: Array  # (2, n), before hinges are bent


def parametric(scene: Scene, chain: Chain, paths: list[str]) -> tuple[Parametric, Array]:
    """The chain and its drive with how they change along the numbers at `paths`, and δq0, δq̇0, shape (2, n, p).

    Raises
    ------
    ArgumentError
        There is no such number, it cannot be varied, or the run does not depend on it smoothly; or the scene has a
        drive or wrench that is not differentiated.
    """
    _check_known(scene, chain)
    bodies, hinges = _complex(chain.bodies, BODY, len(paths)), _complex(chain.hinges, HINGE, len(paths))
    couplings = _complex(chain.couplings, COUPLING, len(paths))
    bodies["turned"] = 1  # a mount that turns nothing has a slope, too
    drives, starts = np.empty((len(paths), 3, chain.n)), np.empty((2, chain.n, len(paths)))
    for j, path in enumerate(paths):
        slope = _slope(scene, chain, path)
        for rows, slopes in ((bodies, slope.bodies), (hinges, slope.hinges), (couplings, slope.couplings)):
            for name, values in slopes.items():
                rows[name][j] += 1j * EPSILON * values
        drives[j], starts[:, :, j] = slope.drive, slope.start
    found = Parametric(Arrays(*chain.arrays), bodies, hinges, couplings, _numbers(scene, chain).drive, drives)
    if scene.initial.passive == "static":
        _bend(scene, chain, found, starts)
    for part, whole in enumerate((scene.initial.q, scene.initial.qd)):
        starts[part] *= whole is None  # a state that is given is no angle or rate of a joint
    return found, starts


def _check_known(scene: Scene, chain: Chain) -> None:
    of_drives = {"kind", "torque", "times", "torques", "kp", "kd", "target_deg", "target_m", "smooth", "hold"}
    for name, part, known in (("drive", scene.drive, of_drives), ("wrench", scene.wrench, {"force", "moment", "on"})):
        for field, value in _said(part):
            if field not in known:
                raise ArgumentError(
                    f"{name}.{field} = {truncated(value)}: not supported by sensitivities; leave it out"
                )
    if len(chain.couplings) and scene.wrench.on not in {"", scene.arm.links[-1].name}:
        raise ArgumentError(
            f"wrench.on = {scene.wrench.on!r}: not supported by sensitivities of coupled springs but on the last link; "
            "take lumping = 'gauss'"
        )
    if scene.motion:
        raise ArgumentError(f"motion.{scene.motion[0].link}: prescribed motions are not supported by sensitivities")
    if scene.drive.kind not in {"none", "constant", "table", "pd"}:
        raise ArgumentError(f"drive.kind = {scene.drive.kind!r}: not supported by sensitivities")


def _said(part: Spec) -> Iterator[tuple[str, object]]:
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        if value != default_of(field):
            yield field.name, value


def _complex(rows: NDArray[np.void], dtype: np.dtype[Any], p: int) -> NDArray[np.void]:
    """`p` copies of the rows, whose real numbers are complex, shape (p, rows)."""
    fields = [(name, *_complex_field(dtype[name])) for name in dtype.names or ()]
    found = np.zeros((p, len(rows)), np.dtype((np.record, np.dtype(fields, align=True))))
    for name in dtype.names or ():
        found[name] = rows[name]
    return found


def _complex_field(field: np.dtype[Any]) -> tuple[type, tuple[int, ...]]:
    return (np.complex128 if field.base == np.float64 else np.int64), field.shape


def _slope(scene: Scene, chain: Chain, path: str) -> Numbers:
    """∂/∂p of all numbers."""
    p = _value(scene, path)
    reason: object = "the run does not depend on it smoothly"
    for part in PARTS:
        try:
            return _differentiated(lambda x: _numbers_at(scene, chain, path, x), p, part * (abs(p) or 1.0))
        except _RoughError:
            continue
        except FlexlinkError as error:
            reason = error
    raise ArgumentError(f"parameters: {truncated(path)} = {p!r} cannot be varied: {reason}")


def _value(scene: Scene, path: object) -> float:
    if not isinstance(path, str):
        raise ArgumentError(f"parameters: {truncated(path)}: expected a path such as 'tip.mass'")
    if path.split(".")[0] not in VARIED or path == "initial.time":
        raise ArgumentError(
            f"parameters: {truncated(path)}: not a parameter; allowed are numbers of {', '.join(VARIED)}"
        )
    values = scene.values_at(path)
    try:
        return number_in(values)
    except SceneError as error:
        raise ArgumentError(f"parameters: {truncated(path)} = {error}") from None


class _RoughError(Exception):
    """What is to be differentiated is not smooth."""


def _differentiated(f: Callable[[float], Numbers], p: float, Δ: float) -> Numbers:
    x = np.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    middle, at = (p, 0.0) if p else (Δ, -1.0)  # a number that is 0 may be one that must not be negative
    values = [f(middle + Δ * float(point)) for point in x]

    def slope(many: list[Array]) -> Array:
        return _by_chebyshev(np.array(many), x, at) / Δ

    def slopes(many: list[dict[str, Array]]) -> dict[str, Array]:
        return {name: slope([one[name] for one in many]) for name in many[0]}

    bodies, hinges, couplings, drives, starts = (list(part) for part in zip(*values, strict=True))
    return Numbers(slopes(bodies), slopes(hinges), slopes(couplings), slope(drives), slope(starts))


def _by_chebyshev(values: Array, x: Array, at: float) -> Array:
    smooth = 1e-12  # largest part of the last two terms in a number: ten times their rounding
    flat = values.reshape(POINTS, -1)
    if (flat == flat[0]).all():
        return np.zeros(values.shape[1:])
    c = 2 / POINTS * chebyshev.chebvander(x, POINTS - 1).T @ flat
    c[0] /= 2
    if (np.abs(c[-2:]).max(axis=0) > smooth * np.abs(flat).max()).any():
        raise _RoughError
    return np.asarray(chebyshev.chebval(at, chebyshev.chebder(c))).reshape(values.shape[1:])


def _numbers_at(scene: Scene, chain: Chain, path: str, value: float) -> Numbers:
    varied = scene.varied({path: value})
    other = lump(varied)
    for ours, theirs, names in (
        (chain.bodies, other.bodies, ("first", "stop")), (chain.hinges, other.hinges, ("axis", "prescribed")),
    ):  # fmt: skip
        if len(ours) != len(theirs) or any(not np.array_equal(ours[name], theirs[name]) for name in names):
            raise ArgumentError("a small change of it changes the number or kind of joints")
    return _numbers(varied, other)


def _numbers(scene: Scene, chain: Chain) -> Numbers:
    bodies = {name: chain.bodies[name] for name in ("rotation", "translation", "mass", "center", "inertia")}
    names = "stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature"
    drive, affine = scene.drive, np.zeros((3, chain.n))
    if drive.kind in {"constant", "pd"}:
        zero = (0.0,) * len(scene.arm.links)
        torque, kp, kd = (spread(chain, part or zero) for part in (drive.torque, drive.kp, drive.kd))
        target = spread(chain, scene.joint_targets)
        affine[AFFINE.u], affine[AFFINE.v], affine[AFFINE.w] = torque + kp * target, -kp, -kd
    hinges, couplings = (
        {name: rows[name] for name in fields}
        for rows, fields in ((chain.hinges, names), (chain.couplings, ("stiffness", "damping")))
    )
    return Numbers(bodies, hinges, couplings, affine, np.array(stated(scene, chain)))


def _bend(scene: Scene, chain: Chain, varied: Parametric, starts: Array) -> None:
    """δq0 of hinges in equilibrium, K δq0 = −δ(T_GC + T_FL) where they are free (implicit function theorem)."""
    (q, _), rest, wrench = initial_state(scene, chain), np.zeros(chain.n), scene.tip_wrench
    held = np.isin(np.arange(chain.n), chain.active)
    free = ~held
    if not free.any():
        return
    K = stiffness_matrix(chain, q, rest, wrench)
    still = varied._replace(drive_derivatives=np.zeros_like(varied.drive_derivatives))
    pull = torque_derivatives(still, wrench, q, rest, rest)[free] - K[np.ix_(free, held)] @ starts[0, held]
    starts[0, free] = np.linalg.solve(K[np.ix_(free, free)], pull)
