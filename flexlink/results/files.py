"""A run as a file and back, or as a table of xarray, which is imported only if it is used; formats."""

import dataclasses
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from msgspec import convert
from numpy.typing import NDArray

from flexlink.chain.builder import record_branches
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Coordinate
from flexlink.chain.lumping import lump
from flexlink.chain.rigid import DESCRIBED
from flexlink.chain.shapes import shapes_of
from flexlink.common.errors import ArgumentError, DataFileError, Diagnostic, imported
from flexlink.describe.scene import scene_from
from flexlink.dynamics.conserved import Energy, Momentum
from flexlink.dynamics.result import read_archive, write_archive
from flexlink.kernels.bodies.shaped_mass import Shapes
from flexlink.kernels.layout import BODY, COUPLING, FORCES, HINGE
from flexlink.results.samples import BaseMotion, Columns, RunSamples, State, StatedError, Steps


def write(run: RunSamples, format: str, path: Path) -> None:
    """Write a trajectory to a path in a format."""
    if format == ".npz":
        write_archive(path, _arrays(run))
        return
    if format == ".mat":
        from scipy.io import savemat  # noqa: PLC0415  only for MATLAB

        columns = Columns(run)
        table = {"names": np.array(list(columns), object), "columns": np.column_stack([*columns.values()])}
        arrays = {name: each for name, each in _arrays(run).items() if name in FOR_MATLAB}
        savemat(path, table | arrays, appendmat=False)
        return
    if format == ".nc":
        for name in ("h5netcdf", "h5py"):
            imported(name, f"an .nc file needs {name};", "tables")
        to_xarray(run).to_netcdf(path, engine="h5netcdf")
        return
    rows = zip(*(column.tolist() for column in Columns(run).values()), strict=True)
    header = ",".join('"' + name.replace('"', '""') + '"' for name in Columns(run))
    with path.open("w", encoding="utf-8") as file:
        file.write(header + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def _arrays(run: RunSamples) -> dict[str, Any]:
    """All data of a run and, for use by other programs, its imbalance and the names of its joints."""
    chain, balanced = run.chain, run.work is not None
    found = {
        "t": run.t, "q": run.q, "qd": run.qd, "tau": run.drive_torques, "tip": run.tip, **vars(run.energy),
        "joints": np.array(chain.joint_names), **({"work": run.work, "imbalance": run.imbalance} if balanced else {}),
        "tip_wrench": run.tip_wrench, "warnings": np.array(run.warnings, str),
        "warning_ids": np.array([getattr(warning, "id", "") for warning in run.warnings], str),
        "steps": json.dumps(run.steps), "delayed": run.delayed,
        "scene": run.scene.to_toml() if run.scene else "",
        "chain_name": chain.name, "chain_bodies": chain.bodies, "chain_hinges": chain.hinges,
        "chain_gravity": chain.gravity, "chain_coordinates": np.array(chain.coordinates),
        "chain_described": chain.described,
        **{f"chain_{name}": rows for name, rows in chain.forces.items()},
        "chain_links": np.array(chain.link_names), "chain_couplings": chain.couplings,
        "chain_tips": np.array([[chain.link_names.index(link), body] for link, body in chain.tips.items()]),
        **({} if chain.joints_of_links == chain.link_names else {"chain_joints": np.array(chain.joints_of_links)}),
    }  # fmt: skip
    if chain.shapes is not None:
        found |= {"chain_shapes": chain.shapes.matrix, "chain_shape_ranges": np.array(chain.shapes[1:3])}
    if run.base is not None:
        found |= {"attitude": run.base.attitude, "spin": run.base.spin}
        found |= {f"momentum_{name}": value for name, value in run.base.momentum._asdict().items()}
    if names := run.sensor_names:  # for use by other programs; a loaded run computes its readings from its scene
        found |= {"sensors": np.array(names), "readings": np.array([run.readings[name] for name in names])}
    if (stated := run.stated) is not None:
        outputs, so_far = stated.outputs, np.array([stated.travelled, stated.drifting, stated.drifted])
        found |= {
            "error": stated.tip, "error_allowed": stated.allowed, "error_compared": stated.compared,
            "error_outputs": np.array(list(outputs), str), "error_of_outputs": np.array(list(outputs.values())),
            "motion_start": np.hstack(stated.start), "motion_so_far": so_far,
        }  # fmt: skip
        if stated.end is not None:
            found |= {"motion_end": np.hstack(stated.end), "motion_delayed": stated.delayed}
    return found


TRAJECTORY = (".npz", ".csv", ".nc", ".mat"), "a trajectory"
FOR_MATLAB = frozenset(("t", "q", "qd", "tau", "tip", "kinetic", "gravity", "elastic", "work", "imbalance", "readings"))


def ending(path: Path, allowed: tuple[str, ...], what: str) -> str:
    """Suffix of a file to write, which must be allowed."""
    if path.suffix not in allowed:
        text = f"{str(path)!r}: unknown format; {what} is saved as {' or '.join(allowed)}"
        raise ArgumentError(text, id="unknown-format")
    return path.suffix


def to_xarray(run: RunSamples) -> Any:
    """States, torques, tip and energies as a Dataset with dimensions time, joint and axis, and with units."""
    per_time = {
        "kinetic": run.energy.kinetic, "gravity": run.energy.gravity, "elastic": run.energy.elastic,
        **({} if run.work is None else {"work": run.work, "imbalance": run.imbalance}),
    }  # fmt: skip
    mixed = "m" in run.chain.joint_units
    units = ("rad or m", "rad/s or m/s", "N m or N") if mixed else ("rad", "rad/s", "N m")
    per_joint = zip(("q", "qd", "tau"), (run.q, run.qd, run.tau), units, strict=True)
    return imported("xarray", "a run as a table of xarray needs xarray;", "tables").Dataset(
        {
            **{name: (("time", "joint"), values, {"units": unit}) for name, values, unit in per_joint},
            "tip": (("time", "axis"), run.tip, {"units": "m"}),
            **{name: (("time",), values, {"units": "J"}) for name, values in per_time.items()},
            **({"readings": (("time", "sensor"), np.column_stack([*run.readings.values()]))} if run.readings else {}),
        },
        coords={
            "time": ("time", run.t, {"units": "s"}), "joint": list(run.chain.joint_names), "axis": list("xyz"),
            **({"unit": ("joint", list(run.chain.joint_units))} if mixed else {}),
            **({"sensor": list(run.readings)} if run.readings else {}),
        },
        attrs={"name": run.chain.name, "warnings": "\n".join(run.warnings)},
    )  # fmt: skip


# Kernels do not check the indices in a chain; a wrong index would make them read unrelated memory.


Run = TypeVar("Run", bound=RunSamples)


def stored_run(path: str | Path, kind: type[Run]) -> Run:
    """The run in an archive, as an object of `kind`; see `Trajectory.load`."""
    arrays = read_archive(path)
    try:
        return kind(**_fields(arrays))
    except Exception as error:  # any: the checks see only what a run is made of, not what else arrays can hold
        why = f"{error.args[0]} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise DataFileError(f"{path}: not a run of this version of flexlink: {why}", id="not-a-result") from None


def _fields(arrays: Mapping[str, Any]) -> dict[str, Any]:
    steps, table = json.loads(str(arrays["steps"])), tomllib.loads(str(arrays["scene"]))
    chain, scene = _chain(arrays), scene_from(table) if table else None
    if "chain_described" not in arrays and scene is not None:  # from an older version
        chain = dataclasses.replace(chain, described=lump(scene).described)
    check_chain(chain)
    check_samples(arrays, chain.n)
    texts, base = arrays["warnings"].tolist(), None
    ids = arrays["warning_ids"].tolist() if "warning_ids" in arrays else [""] * len(texts)  # none in older versions
    warnings = tuple(Diagnostic(*each) for each in zip(texts, ids, strict=True))
    if "attitude" in arrays:
        momentum = Momentum(*(arrays[f"momentum_{name}"] for name in Momentum._fields))
        base = BaseMotion(arrays["attitude"], arrays["spin"], momentum)
    return dict(
        chain=chain, **{name: arrays[name] for name in ("t", "q", "qd", "tip", "tip_wrench")},
        drive_torques=arrays["tau"], energy=Energy(arrays["kinetic"], arrays["gravity"], arrays["elastic"]),
        work=arrays.get("work"), warnings=warnings, steps=convert(steps, Steps | None),
        scene=scene, base=base,
        **({"delayed": arrays["delayed"]} if "delayed" in arrays else {}),
        stated=_stated(arrays) if "error" in arrays else None,
    )  # fmt: skip


def _stated(arrays: Mapping[str, Any]) -> StatedError:
    """The stated error of a run, and the motion up to its end."""
    n = arrays["q"].shape[1]
    start = _state(arrays["motion_start"], n)
    end = _state(arrays["motion_end"], n) if "motion_end" in arrays else None
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


def _chain(arrays: Mapping[str, Any]) -> Chain:
    bodies, links = _records(arrays["chain_bodies"], BODY), arrays["chain_links"].tolist()
    if "parent" not in (arrays["chain_bodies"].dtype.names or ()):  # from an older version, without branches
        bodies["parent"] = np.arange(len(bodies))
        bodies["loaded"][-1] = 1
    found = {name: arrays.get(f"chain_{name}", ()) for name in FORCES if name != "couplings"}
    forces = {name: _records(rows, FORCES[name]) for name, rows in found.items() if len(rows)}
    tips = arrays.get("chain_tips", np.array([[len(links) - 1, len(bodies) - 1]]))
    chain = Chain(
        name=str(arrays["chain_name"]), bodies=bodies, hinges=_records(arrays["chain_hinges"], HINGE),
        gravity=np.ascontiguousarray(arrays["chain_gravity"]),
        coordinates=tuple(Coordinate(*row) for row in arrays["chain_coordinates"].tolist()), link_names=tuple(links),
        couplings=_records(arrays.get("chain_couplings", np.zeros(0, COUPLING)), COUPLING),
        tips={links[link]: body for link, body in tips.tolist()}, forces=forces,
        described=_records(arrays.get("chain_described", np.zeros(0, DESCRIBED)), DESCRIBED),
        joints_of_links=tuple(arrays["chain_joints"].tolist()) if "chain_joints" in arrays else (),
    )  # fmt: skip
    return chain if "chain_shapes" not in arrays else dataclasses.replace(chain, shapes=_shapes(chain, arrays))


def _shapes(chain: Chain, arrays: Mapping[str, Any]) -> Shapes:
    """Shapes of the chain, checked to be finite and of its size."""
    Φ, (first, stop) = np.ascontiguousarray(arrays["chain_shapes"], float), arrays["chain_shape_ranges"]
    within = Φ.shape[:1] == first.shape == (chain.n,) and (first >= 0).all() and (first < stop).all()
    if not (within and (stop <= Φ.shape[1]).all() and np.isfinite(Φ).all()):
        raise ValueError("its chain's shapes do not match its hinges")
    return shapes_of(chain, Φ, first.copy(), stop.copy())


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


def check_samples(arrays: Mapping[str, NDArray[Any]], n: int) -> None:
    """Refuse arrays with one entry per sample that do not fit, as ValueError; skip those that are missing."""
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
    """Refuse torques on their way at the end of a run that are no table of finite numbers in order of time."""
    if delayed.dtype != np.float64 or delayed.ndim != 2 or not delayed.shape[1]:
        raise ValueError(f"delayed has shape {delayed.shape} and type {delayed.dtype}; expected a table of float64")
    if not np.isfinite(delayed).all() or (np.diff(delayed[:, 0]) <= 0).any():
        raise ValueError("delayed has numbers that are not finite, or times that do not increase")


def check_chain(chain: Chain) -> None:
    """Refuse a chain with numbers that are not finite, or with parts that do not belong together, as ValueError."""
    unlimited = {"lower", "upper"}  # fields that may be infinite
    forces = {name: chain.force(name) for name in FORCES}
    for part, rows in {"bodies": chain.bodies, "hinges": chain.hinges, "axes": chain.described, **forces}.items():
        for name in set(rows.dtype.names or ()) - unlimited:
            if not np.isfinite(rows[name]).all():
                raise ValueError(f"its chain's {part} have a {name} that is not finite")
    if chain.gravity.shape != (3,) or chain.gravity.dtype != np.float64 or not np.isfinite(chain.gravity).all():
        raise ValueError("its chain's gravity is not three finite numbers")
    indices = [index for coordinate in chain.coordinates for index in coordinate]
    known = all(type(index) is int and index >= 0 for index in indices)
    known = known and all(c.link <= len(chain.link_names) and c.known is not None for c in chain.coordinates)
    if len(chain.coordinates) != chain.n or not known:
        raise ValueError("its chain's coordinates do not match its hinges and links")
    if len(chain.joints_of_links) != len(chain.link_names):
        raise ValueError("its chain's names of joints do not match its links")
    belong = {name: _are_within(chain, rows) for name, rows in forces.items()}
    for part, good in ({"bodies": _is_tree(chain)} | belong).items():
        if not good:
            raise ValueError(f"its chain's {part} do not belong together")


def _is_tree(chain: Chain) -> bool:
    bodies, hinges, again = chain.bodies, chain.hinges, chain.bodies.copy()
    if not len(bodies) or (bodies["parent"] < 0).any() or (bodies["parent"] > np.arange(len(bodies))).any():
        return False
    record_branches(again)
    ends = np.append(0, bodies["stop"])
    in_order = bool((bodies["first"] == ends[:-1]).all() and ends[-1] == chain.n and (np.diff(ends) >= 0).all())
    known = np.isin(hinges["axis"], range(6)).all() and np.isin(bodies["springs"], range(3)).all()
    on = all(-1 <= body < len(bodies) for body in chain.tips.values())  # -1: the base
    whole = len(chain.described) == len(bodies) and again.tobytes() == bodies.tobytes()
    return in_order and bool(known) and on and whole


def _are_within(chain: Chain, rows: NDArray[np.void]) -> bool:
    """Whether force elements refer to existing hinges and bodies, and each coupling lists its inner hinge first."""
    names = set(rows.dtype.names or ())
    ends = {"hinge": chain.n, "inner": chain.n, "outer": chain.n, "body": len(chain.bodies)}
    there = all(((rows[name] >= 0) & (rows[name] < ends[name])).all() for name in names & ends.keys())
    return bool(there and ("inner" not in names or (rows["inner"] < rows["outer"]).all()))
