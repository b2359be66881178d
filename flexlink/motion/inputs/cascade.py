"""Arrays of a cascade drive: gains of its rate loop, and the filters of its torques for its sampling rate."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.drive import Drive, DriveFilter
from flexlink.describe.joint_units import in_si, together
from flexlink.describe.scene import Scene
from flexlink.dynamics.filters import linear_filter, transition


def servo_of(scene: Scene, chain: Chain) -> Array:
    """k_i, v_max [rad/s, m/s], rate feedforward and inertia of each driven joint, shape (d, 4), as in `cascade`."""
    drive, links = scene.drive, _links(chain)
    nothing = (0.0,) * len(scene.arm.links)
    fastest = in_si(scene.arm.slides, together(scene.arm.slides, drive.max_rate_deg, drive.max_rate_m))
    found = np.zeros((len(links), 4))
    found[:, 0] = np.array(drive.ki or nothing)[links]
    found[:, 1] = np.where(fastest > 0.0, fastest, np.inf)[links]
    found[:, 2] = 1.0 if drive.rate_feedforward is None else drive.rate_feedforward
    found[:, 3] = np.array(drive.inertia or nothing)[links]
    return found


def filters_of(scene: Scene, chain: Chain, rate: float) -> Array:
    """Φ, Γ, Ψ, S, C, D of the filters of each driven joint, shape (d, f + 1, f + 3), as in `cascade`."""
    names = [scene.arm.links[k].name for k in _links(chain)]
    series = [_series(scene.drive, name) for name in names]
    f = max((len(linear_filter(each).B) for each in series), default=0)
    found = np.zeros((len(names), f + 1, f + 3))
    for block, filters in zip(found, series, strict=True):
        own, (Φ, Γ, Ψ) = linear_filter(filters), transition(filters, 1.0 / rate)
        n = len(own.B)
        block[:n, :n], block[:n, f], block[:n, f + 1] = Φ, Γ, Ψ
        block[:n, f + 2] = own.settled if n else 0.0
        block[f, :n], block[f, f] = own.C, own.D
    return found


def _series(drive: Drive, link: str) -> tuple[DriveFilter, ...]:
    return tuple(each for each in drive.filter if each.link in {"", link})


def _links(chain: Chain) -> list[int]:
    """Index of the link of each driven joint."""
    return [chain.coordinates[k].link - 1 for k in chain.active.tolist()]
