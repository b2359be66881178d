"""Checks of a saved run: finite numbers, shapes that match its samples and joints, and a consistent chain.

Kernels do not check the indices in a chain; a wrong index would make them read unrelated memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.builder import record_branches
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import STRETCH, Coordinate
from flexlink.kernels.layout import FORCES


def check_samples(arrays: Mapping[str, NDArray[Any]], n: int) -> None:
    """Check the arrays that have one entry per sample; skip those that are missing.

    Raises
    ------
    ValueError
        An array has the wrong type or shape, or is not finite; or times do not increase.
    """
    shapes: dict[str, tuple[int, ...]] = {  # shape of each array at one sample
        "t": (), "q": (n,), "qd": (n,), "tau": (n,), "tip": (3,), "tip_wrench": (6,), "kinetic": (), "gravity": (),
        "elastic": (), "work": (), "attitude": (4,), "spin": (3,), "momentum_linear": (3,), "momentum_angular": (3,),
        "momentum_center": (3,), "error": (),
    }  # fmt: skip
    samples = len(arrays["t"]) if arrays["t"].ndim else 0
    for name in (name for name in shapes if name in arrays):
        array, wanted = arrays[name], (samples, *shapes[name])
        if array.dtype != np.float64:
            raise ValueError(f"{name} is of type {array.dtype}; expected float64")
        if array.shape != wanted and not (name == "tip_wrench" and array.shape == (0, 6)):  # empty if not from a run
            raise ValueError(f"{name} has shape {array.shape}; expected {wanted}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has numbers that are not finite")
    if (np.diff(arrays["t"]) <= 0).any():
        raise ValueError("t does not increase")
    if "delayed" in arrays:
        check_delayed(arrays["delayed"])


def check_delayed(delayed: NDArray[Any]) -> None:
    """Check the torques on their way at the end of a run.

    Raises
    ------
    ValueError
        The array is not a table of finite numbers, or its times do not increase.
    """
    if delayed.dtype != np.float64 or delayed.ndim != 2 or not delayed.shape[1]:
        raise ValueError(f"delayed has shape {delayed.shape} and type {delayed.dtype}; expected a table of float64")
    if not np.isfinite(delayed).all() or (np.diff(delayed[:, 0]) <= 0).any():
        raise ValueError("delayed has numbers that are not finite, or times that do not increase")


def check_chain(chain: Chain) -> None:
    """Check that the chain's numbers are finite, and that its bodies, hinges and force elements are consistent.

    Raises
    ------
    ValueError
        The chain is not valid.
    """
    # fields that may be infinite
    unlimited = {"lower", "upper"}
    forces = {name: chain.force(name) for name in FORCES}
    parts = {"bodies": chain.bodies, "hinges": chain.hinges, "axes": chain.described, **forces}
    for part, rows in parts.items():
        for name in set(rows.dtype.names or ()) - unlimited:
            if not np.isfinite(rows[name]).all():
                raise ValueError(f"its chain's {part} have a {name} that is not finite")
    if chain.gravity.shape != (3,) or chain.gravity.dtype != np.float64 or not np.isfinite(chain.gravity).all():
        raise ValueError("its chain's gravity is not three finite numbers")
    known = [_names_a_joint(coordinate, len(chain.link_names)) for coordinate in chain.coordinates]
    if len(known) != chain.n or not all(known):
        raise ValueError("its chain's coordinates do not match its hinges and links")
    if len(chain.joints_of_links) != len(chain.link_names):
        raise ValueError("its chain's names of joints do not match its links")
    belong = {name: _are_within(chain, rows) for name, rows in forces.items()}
    for part, good in ({"bodies": _is_tree(chain)} | belong).items():
        if not good:
            raise ValueError(f"its chain's {part} do not belong together")


def _names_a_joint(coordinate: Coordinate, links: int) -> bool:
    link, segment, axis = coordinate
    whole = all(type(index) is int for index in coordinate)
    return whole and 0 <= link <= links and segment >= 0 and (link == 0) <= axis <= (STRETCH + 2 if link else 6)


def _is_tree(chain: Chain) -> bool:
    bodies, hinges, again = chain.bodies, chain.hinges, chain.bodies.copy()
    if not len(bodies) or (bodies["parent"] < 0).any() or (bodies["parent"] > np.arange(len(bodies))).any():
        return False
    record_branches(again)
    ends = np.append(0, bodies["stop"])
    in_order = bool((bodies["first"] == ends[:-1]).all() and ends[-1] == chain.n and (np.diff(ends) >= 0).all())
    known = np.isin(hinges["axis"], range(6)).all() and np.isin(bodies["springs"], range(3)).all()
    on = all(-1 <= body < len(bodies) for body in chain.tips.values())  # -1: the base
    in_order = in_order and len(chain.described) == len(bodies)
    return in_order and bool(known) and on and again.tobytes() == bodies.tobytes()


def _are_within(chain: Chain, rows: NDArray[np.void]) -> bool:
    """Whether force elements refer to existing hinges and bodies, and each coupling lists its inner hinge first."""
    names = set(rows.dtype.names or ())
    ends = {"hinge": chain.n, "inner": chain.n, "outer": chain.n, "body": len(chain.bodies)}
    there = all(((rows[name] >= 0) & (rows[name] < ends[name])).all() for name in names & ends.keys())
    return bool(there and ("inner" not in names or (rows["inner"] < rows["outer"]).all()))
