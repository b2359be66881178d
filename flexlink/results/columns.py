"""The columns of a trajectory by name, each computed when it is used: sweeps use only a few."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.results.samples import BaseMotion, RunSamples

Source = Callable[[Any], Array]
"""Function of `RunSamples`, or of an object with its fields and runs as a last axis."""


def _of_base(part: Callable[[BaseMotion], Array], k: int) -> Source:
    return lambda run: part(run.base)[:, k]


class Columns(Mapping[str, Array]):
    """Every sampled quantity of a run, shape (samples,), by its name with unit."""

    def __init__(self, run: RunSamples) -> None:
        sources = sources_of(run.chain, run.work is not None)
        self._run, self._sources = run, {**sources, **{name: _reading(name) for name in run.sensor_names}}

    def __getitem__(self, name: str) -> Array:
        return self._sources[name](self._run)

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)


def sources_of(chain: Chain, balanced: bool = True) -> Mapping[str, Source]:
    """Source of each column of runs of a chain, in the order of the CSV file; `balanced`: with work and imbalance."""
    # attitude as a unit quaternion, angular velocity in axes of the base, momentum of all bodies in frame 0
    of_a_free_base: Mapping[str, Source] = {
        f"{name} {axis} [{unit}]": _of_base(part, k)
        for name, axes, unit, part in (
            ("attitude", "wxyz", "1", lambda base: base.attitude),
            ("spin", "xyz", "rad/s", lambda base: base.spin),
            ("momentum", "xyz", "N s", lambda base: base.momentum.linear),
            ("angular momentum", "xyz", "N m s", lambda base: base.momentum.angular),
        )
        for k, axis in enumerate(axes)
    }
    found = _sources(chain.joint_names, (chain.joint_units, chain.torque_units), tuple(chain.active.tolist()), balanced)
    return {**found, **of_a_free_base} if chain.has_free_base else found


@functools.lru_cache(maxsize=64)
def _sources(
    joints: tuple[str, ...], units: tuple[tuple[str, ...], tuple[str, ...]], active: tuple[int, ...], balanced: bool
) -> Mapping[str, Source]:
    """Source of each column, in the order of the CSV file; runs of one layout share it."""
    # only flexlink's own runs have these
    of_balanced: Mapping[str, Source] = {
        "work [J]": lambda run: np.asarray(run.work),
        "imbalance [J]": lambda run: run.imbalance,
    }
    return {
        "t [s]": lambda run: run.t,
        **{f"q {name} [{units[0][k]}]": _of("q", k) for k, name in enumerate(joints)},
        **{f"qd {name} [{units[0][k]}/s]": _of("qd", k) for k, name in enumerate(joints)},
        **{f"tau {joints[k]} [{units[1][k]}]": _of("tau", k) for k in active},
        **{f"tip {axis} [m]": _of("tip", k) for k, axis in enumerate("xyz")},
        "kinetic [J]": lambda run: np.asarray(run.energy.kinetic),
        "gravity [J]": lambda run: np.asarray(run.energy.gravity),
        "elastic [J]": lambda run: np.asarray(run.energy.elastic),
        **(of_balanced if balanced else {}),
    }


def _reading(name: str) -> Source:
    return lambda run: run.readings[name]


def _of(field: str, k: int) -> Source:
    """Column `k` of an array (samples, …)."""
    return lambda run: getattr(run, field)[:, k]
