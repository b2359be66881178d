"""Inertias that no real body has: used as given if the mass matrix M is positive, because the torques need only M.

They come from rounded numbers, from models with moments about the joints' axes alone, and from identification.
"""

import math
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from flexlink.chain.chain import Chain
from flexlink.common.errors import Diagnostic, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.arm import Arm
from flexlink.describe.rigid_body import RigidBody
from flexlink.kernels.bodies.mass import mass_composite


def odd_bodies(arm: Arm) -> dict[str, RigidBody]:
    """Bodies of an arm whose inertia no real body has, by their paths in the scene."""
    odd = {name: body for name, body in (("base", arm.base), ("tip", arm.tip)) if body.excess}
    of_links = ((k, name, getattr(link, name)) for k, link in enumerate(arm.links, 1) for name in ("hub", "end"))
    return odd | {f"{arm.path(k)}.{name}": body for k, name, body in of_links if body.excess}


def of_odd_bodies(arm: Arm) -> Iterator[Diagnostic]:
    """Note each inertia that no real body has: by how much, and whether rounding to a few digits explains it."""
    for path, body in odd_bodies(arm).items():
        first = math.floor(math.log10(max(map(abs, body.principal_moments))))
        digits = math.floor(first + 1 - math.log10(body.excess / 1.5))
        cause = f"as rounding to about {digits} digits gives" if digits >= 3 else "as base parameters have"
        what = "the largest moment exceeds the sum of the others" if body.mass else "a moment is negative"
        text = f"{path}.inertia: {what} by {body.excess:.3g} kg m², {cause}; no real body has it"
        yield Diagnostic(f"{text}, but M is positive, so it is used{_reordered(body)}", "inertia-of-no-body")


def _reordered(body: RigidBody) -> str:
    """The inertia of a real body, if the numbers are in the order of URDF, as the end of a message; else empty."""
    if len(body.inertia) < 6:
        return ""
    xx, xy, xz, yy, yz, zz = body.inertia
    moved = xx, yy, zz, xy, xz, yz
    likely = f"; likely given as xx, xy, xz, yy, yz, zz: as xx, yy, zz, xy, xz, yz it is {list(moved)}"
    return "" if replace(body, inertia=moved).excess else likely


def require_positive_mass(chain: Chain, arm: Arm) -> None:
    """Refuse odd inertias with which M is indefinite at rest or in one of 200 random postures."""
    odd = odd_bodies(arm)
    if odd and (place := negative_inertia(chain)):
        path, body = max(odd.items(), key=lambda item: item[1].excess)
        text = f"no body can have it, and with it {place}; check the moments, their unit, and that they are about the "
        text += f"centre of mass{_reordered(body)}"
        raise SceneError(f"{path}.inertia = {truncated(body.inertia)}: {text}", id="inertia-impossible")


def negative_inertia(chain: Chain) -> str:
    """Return a joint that has negative inertia, and its position, in words; empty if M is positive in all postures."""
    for q in _postures(chain):
        k = _negative(chain, q)
        if k is not None:
            return f"joint {chain.joint_name(k)!r} has negative inertia at {chain.place_in_words(k, float(q[k]))}"
    return ""


def _postures(chain: Chain) -> Iterator[Array]:
    """Yield the unloaded posture, and random ones of the joints inside their limits, with straight beams."""
    wide = max(chain.size, np.pi)  # m or rad
    joints = chain.hinges[chain.active]
    low = np.where(np.isfinite(joints["lower"]), joints["lower"], -wide)
    high = np.where(np.isfinite(joints["upper"]), joints["upper"], wide)
    yield chain.rest
    for row in np.random.default_rng(0).random((200, len(joints))):
        q = chain.rest.copy()
        q[chain.active] = low + row * (high - low)
        yield q


def _negative(chain: Chain, q: Array) -> int | None:
    """Return the joint that moves most in a motion of negative kinetic energy; None if there is no such motion."""
    M, rounding = np.zeros((chain.n, chain.n)), 1e-10  # a singular M is reported where it is inverted
    mass_composite(chain.arrays, q, M)
    free = chain.free
    M = M[np.ix_(free, free)]
    scale = np.sqrt(np.where(M.diagonal() == 0, 1.0, np.abs(M.diagonal())))
    M /= np.outer(scale, scale)
    try:
        np.linalg.cholesky(M + rounding * np.eye(len(M)))
    except np.linalg.LinAlgError:
        return int(free[np.abs(np.linalg.eigh(M)[1][:, 0]).argmax()])
    return None
