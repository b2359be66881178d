"""Runs side by side that are sound beyond doubt: the checks of `monitor`, of all at once and a little stricter.

A run that passes them has nothing to be told of. Every other one is judged by its own `RunMonitor`, with all its words.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.motion.monitor import DOUBT, FAR, TIP_SHARE
from flexlink.motion.verification import FAR_TRAVELLED
from flexlink.results.balance import SHARE, imbalance, turned_over
from flexlink.results.record import Record


def sound(records: Sequence[Record], probed: NDArray[np.intp], errors: Array) -> NDArray[np.bool_]:
    """Which of some finished runs of fixed steps, of chains of one layout, are so: shape (runs,).

    Parameters
    ----------
    records
        Their samples, all of them derived.
    probed, errors
        Samples whose next step's error is known, evenly spaced, and these errors at the tip [m], shape (runs, probed).
    """
    run = records[0].run
    if len(probed) < 2 or records[0].problem.scene.drive.rate is not None:  # a loop that is sampled may be unstable
        return np.zeros(len(records), dtype=bool)
    q, qd, tip = (np.array([getattr(record, name) for record in records]) for name in ("q", "qd", "tip"))
    with np.errstate(all="ignore"):  # what is not finite is below no limit
        error = errors.sum(axis=1) * (probed[1] - probed[0]) * run.steps_per_sample
        accurate = error <= DOUBT * TIP_SHARE * np.linalg.norm(np.ptp(tip, axis=1), axis=1)
        kept = _within_limits(records, q) & _keeps_digits(run.step, q, qd) & _calm(records, qd)
        return np.asarray(accurate & kept & _balanced(records))


def _balanced(records: Sequence[Record]) -> NDArray[np.bool_]:
    """The energy balances without any allowance for rounding, and all is finite."""
    energy = np.array([record.energy for record in records])
    work = np.array([record.work(slice(None)) for record in records])
    tau = np.array([record.tau for record in records])
    r = np.abs(imbalance(energy, work, energy[..., 0]))
    X = np.maximum.accumulate(turned_over(energy, work, energy[..., 0]), axis=1)
    small = (r <= SHARE * X).all(axis=1) & (r.max(axis=1) <= DOUBT * SHARE * X[:, -1])
    finite = np.isfinite(X[:, -1]) & np.isfinite(tau).all(axis=(1, 2))
    return np.asarray(small & finite & (energy[:, 0] >= 0.0).all(axis=1))


def _within_limits(records: Sequence[Record], q: Array) -> NDArray[np.bool_]:
    """Joints are within their limits, hinges not bent too far, and no rotor is negative."""
    chains = [record.chain for record in records]
    passive = [k for k, c in enumerate(chains[0].coordinates) if c.segment]
    least, most, rotors = (
        np.array([chain.hinges[name] for chain in chains]) for name in ("lower", "upper", "armature")
    )
    within = ((q >= least[:, None]) & (q <= most[:, None])).all(axis=(1, 2))
    straight = np.abs(q[..., passive]).max(axis=(1, 2), initial=0.0) <= FAR
    return np.asarray(within & straight & (rotors >= 0.0).all(axis=1))


def _keeps_digits(step: float, q: Array, qd: Array) -> NDArray[np.bool_]:
    """Rounding of q + h q̇ takes no more than a place's own."""
    lost = np.minimum(step * np.abs(qd).max(axis=1), np.spacing(np.abs(q).max(axis=1)) / 2).sum(axis=1)
    return np.asarray(lost <= rounding.of_reach(1.0))


def _calm(records: Sequence[Record], qd: Array) -> NDArray[np.bool_]:
    """Driven joints do not travel so far that errors may have grown on the way."""
    chain = records[0].chain
    free = [k for k in chain.active if not chain.hinges["prescribed"][k]]
    return np.asarray(np.trapezoid(np.abs(qd[..., free]), records[0].t, axis=1).sum(axis=1) <= FAR_TRAVELLED)
