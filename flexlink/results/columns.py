"""The columns of a trajectory by name; each is computed only when it is used, since sweeps use only a few."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean
from flexlink.results.samples import BaseMotion, RunSamples

Source = Callable[[Any], Array]
"""Function that computes a column from `RunSamples`, or from an object with the same fields and a last axis of runs."""


def _of_base(part: Callable[[BaseMotion], Array], k: int) -> Source:
    return lambda run: part(run.base)[:, k]


class Columns(Mapping[str, Array]):
    """Every sampled quantity of a run as an array (samples,), by its name with unit."""

    def __init__(self, run: RunSamples) -> None:
        sources = sources_of(run.chain, run.work is not None)
        self._run, self._sources = run, {**sources, **{name: _reading(name) for name in run.sensor_names}}

    def __reduce__(self) -> tuple[type[Columns], tuple[RunSamples]]:
        return Columns, (self._run,)

    def __repr__(self) -> str:
        return f"<Columns of {self._run!r}: {', '.join(map(repr, self))}>"

    def __getitem__(self, name: str) -> Array:
        if name not in self._sources:
            raise KeyError(f"no column {name!r}{did_you_mean(name, self._sources)}")
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
    # only for runs of flexlink itself: other engines do not integrate work
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
    """Source of column `k` of the array (samples, …) in a field of the run."""
    return lambda run: getattr(run, field)[:, k]
