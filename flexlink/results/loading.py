"""load_trajectory(path): a run that `Trajectory.save` has written, identical bit for bit."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import convert
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Coordinate
from flexlink.chain.lumping import lump
from flexlink.chain.rigid import DESCRIBED
from flexlink.chain.shapes import shapes_of
from flexlink.common.errors import DataFileError, Diagnostic
from flexlink.describe.scene import scene_from
from flexlink.dynamics.energy import Energy
from flexlink.dynamics.momentum import Momentum
from flexlink.dynamics.result import read_archive
from flexlink.kernels.bodies.shaped_mass import Shapes
from flexlink.kernels.layout import BODY, COUPLING, FORCES, HINGE
from flexlink.results.archive_schema import check_chain, check_delayed, check_samples
from flexlink.results.samples import BaseMotion, State, StatedError, Steps
from flexlink.results.trajectory import Trajectory


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a run from an .npz archive of `Trajectory.save`, with its chain and scene.

    Parameters
    ----------
    path
        The archive.

    Returns
    -------
    Trajectory
        Identical to the saved one bit for bit, with all its properties.

    Raises
    ------
    ArgumentError
        `path` is not a path, or does not end in .npz.
    DataFileError
        The file is missing, or is not a run of this version of flexlink: its arrays have other types or shapes, numbers
        are not finite, or the parts of its chain are inconsistent.

    Examples
    --------
    >>> again = fl.load_trajectory(run.save("move.npz"))
    >>> print(again, np.array_equal(again.tip, run.tip))
    <Trajectory 'two_links': 101 samples, 0 … 1 s, 6 joints> True
    """
    arrays = read_archive(path)
    try:
        return _trajectory(arrays)
    except Exception as error:  # any: the checks see only what a run is made of, not what else arrays can hold
        why = f"{error.args[0]} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise DataFileError(f"{path}: not a run of this version of flexlink: {why}", id="not-a-result") from None


def _trajectory(arrays: Mapping[str, Any]) -> Trajectory:
    steps, table = json.loads(str(arrays["steps"])), tomllib.loads(str(arrays["scene"]))
    chain, scene = _chain(arrays), scene_from(table) if table else None
    if "chain_described" not in arrays and scene is not None:  # from an older version
        chain = dataclasses.replace(chain, described=lump(scene).described)
    check_chain(chain)
    check_samples(arrays, chain.n)
    return Trajectory(
        chain=chain,
        **{name: arrays[name] for name in ("t", "q", "qd", "tip", "tip_wrench")},
        drive_torques=arrays["tau"],
        energy=Energy(arrays["kinetic"], arrays["gravity"], arrays["elastic"]),
        work=arrays.get("work"),
        warnings=tuple(_warnings(arrays)),
        steps=convert(steps, Steps | None),
        scene=scene,
        base=_base(arrays) if "attitude" in arrays else None,
        **({"delayed": arrays["delayed"]} if "delayed" in arrays else {}),
        stated=_stated(arrays) if "error" in arrays else None,
    )


def _stated(arrays: Mapping[str, Any]) -> StatedError:
    """The stated error of a run, and the motion up to its end."""
    n = arrays["q"].shape[1]
    start, end = (_state(arrays[name], n) if name in arrays else None for name in ("motion_start", "motion_end"))
    if start is None:
        raise KeyError("motion_start")
    delayed = arrays.get("motion_delayed")
    if delayed is not None:
        check_delayed(delayed)
    outputs = dict(zip(arrays["error_outputs"].tolist(), arrays["error_of_outputs"], strict=True))
    allowed, compared = float(arrays["error_allowed"]), bool(arrays["error_compared"])
    travelled, drifting, drifted = map(float, arrays["motion_so_far"])
    return StatedError(arrays["error"], allowed, compared, outputs, start, travelled, drifting, drifted, end, delayed)


def _state(numbers: NDArray[Any], n: int) -> State:
    """Time, angles and rates of n joints, from one array."""
    if numbers.dtype != np.float64 or numbers.shape != (1 + 2 * n,) or not np.isfinite(numbers).all():
        raise ValueError(f"a state of its motion has shape {numbers.shape}; expected {1 + 2 * n} finite numbers")
    return State(float(numbers[0]), numbers[1 : 1 + n].copy(), numbers[1 + n :].copy())


def _warnings(arrays: Mapping[str, Any]) -> Iterator[Diagnostic]:
    """Warnings with their ids; archives of older versions contain no ids."""
    texts: list[str] = arrays["warnings"].tolist()
    ids: list[str] = arrays["warning_ids"].tolist() if "warning_ids" in arrays else [""] * len(texts)
    return (Diagnostic(text, id) for text, id in zip(texts, ids, strict=True))


def _base(arrays: Mapping[str, Any]) -> BaseMotion:
    momentum = Momentum(*(arrays[f"momentum_{name}"] for name in Momentum._fields))
    return BaseMotion(arrays["attitude"], arrays["spin"], momentum)


def _chain(arrays: Mapping[str, Any]) -> Chain:
    bodies, links = _records(arrays["chain_bodies"], BODY), arrays["chain_links"].tolist()
    if "parent" not in (arrays["chain_bodies"].dtype.names or ()):  # from an older version, without branches
        bodies["parent"] = np.arange(len(bodies))
        bodies["loaded"][-1] = 1
    tips = arrays.get("chain_tips", np.array([[len(links) - 1, len(bodies) - 1]]))
    chain = Chain(
        name=str(arrays["chain_name"]),
        bodies=bodies,
        hinges=_records(arrays["chain_hinges"], HINGE),
        gravity=np.ascontiguousarray(arrays["chain_gravity"]),
        coordinates=tuple(Coordinate(*row) for row in arrays["chain_coordinates"].tolist()),
        link_names=tuple(links),
        couplings=_records(arrays.get("chain_couplings", np.zeros(0, COUPLING)), COUPLING),
        tips={links[link]: body for link, body in tips.tolist()},
        forces=dict(_forces(arrays)),
        described=_records(arrays.get("chain_described", np.zeros(0, DESCRIBED)), DESCRIBED),
        joints_of_links=tuple(arrays["chain_joints"].tolist()) if "chain_joints" in arrays else (),
    )
    return chain if "chain_shapes" not in arrays else dataclasses.replace(chain, shapes=_shapes(chain, arrays))


def _shapes(chain: Chain, arrays: Mapping[str, Any]) -> Shapes:
    """Shapes of the chain, checked to be finite and of its size."""
    Φ, (first, stop) = np.ascontiguousarray(arrays["chain_shapes"], float), arrays["chain_shape_ranges"]
    within = Φ.shape[:1] == first.shape == (chain.n,) and (first >= 0).all() and (first < stop).all()
    if not (within and (stop <= Φ.shape[1]).all() and np.isfinite(Φ).all()):
        raise ValueError("its chain's shapes do not match its hinges")
    return shapes_of(chain, Φ, first.copy(), stop.copy())


def _forces(arrays: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[np.void]]]:
    """Force elements of the chain, if any, without couplings."""
    for name, dtype in FORCES.items():
        if name != "couplings" and len(rows := arrays.get(f"chain_{name}", ())):
            yield name, _records(rows, dtype)


def _records(rows: NDArray[np.void], dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Rows with the dtype for which kernels are compiled; archives store only names and formats of the dtype.

    In archives of older versions, bodies lack the field `springs` (springs then act on angles) or fields for branches.
    """
    # fields that are missing in archives of older versions
    later = {"springs", "parent", "begins", "slot", "fork", "loaded"}
    there = rows.dtype.names or ()
    if there != tuple(name for name in dtype.names or () if name not in later or name in there):
        raise ValueError(f"its chain has the fields {rows.dtype.names}, not {dtype.names}")
    found = np.zeros(len(rows), dtype)
    for name in there:
        found[name] = rows[name]
    return found
