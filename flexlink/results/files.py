"""A run as a file or as a table of pandas or xarray, which are imported only if they are used; formats of files."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, MissingDependencyError, how_to_install
from flexlink.dynamics.result import write_archive
from flexlink.results.samples import Columns, RunSamples


def write(run: RunSamples, format: str, path: Path) -> None:
    """Write a trajectory to a path in a format."""
    if format == ".npz":
        write_archive(path, _arrays(run))
        return
    rows = zip(*(column.tolist() for column in Columns(run).values()), strict=True)
    header = ",".join('"' + name.replace('"', '""') + '"' for name in Columns(run))
    with path.open("w", encoding="utf-8") as file:
        file.write(header + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def _arrays(run: RunSamples) -> dict[str, Any]:
    """All data of a run and, for use by other programs, its imbalance and the names of its joints."""
    chain, balanced = run.chain, run.work is not None
    return {
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
        **_of_shapes(chain), **_of_base(run), **_of_sensors(run),
        **_of_stated_error(run),
    }  # fmt: skip


def _of_shapes(chain: Chain) -> dict[str, Any]:
    if chain.shapes is None:
        return {}
    matrix, first, stop, *_ = chain.shapes
    return {"chain_shapes": matrix, "chain_shape_ranges": np.array([first, stop])}


def _of_base(run: RunSamples) -> dict[str, Any]:
    if run.base is None:
        return {}
    moving = {f"momentum_{name}": value for name, value in run.base.momentum._asdict().items()}
    return {"attitude": run.base.attitude, "spin": run.base.spin, **moving}


def _of_sensors(run: RunSamples) -> dict[str, Any]:
    """Sensor readings, for use by other programs; a loaded run computes them from its scene."""
    names = run.sensor_names
    return {"sensors": np.array(names), "readings": np.array([run.readings[name] for name in names])} if names else {}


def _of_stated_error(run: RunSamples) -> dict[str, Any]:
    """The stated error, and the motion up to the end of the run; n joints give times and states of 1 + 2n numbers."""
    if (stated := run.stated) is None:
        return {}
    outputs, so_far = stated.outputs, np.array([stated.travelled, stated.drifting, stated.drifted])
    ends = {} if stated.end is None else {"motion_end": np.hstack(stated.end), "motion_delayed": stated.delayed}
    return {
        "error": stated.tip, "error_allowed": stated.allowed, "error_compared": stated.compared,
        "error_outputs": np.array(list(outputs), str), "error_of_outputs": np.array(list(outputs.values())),
        "motion_start": np.hstack(stated.start), "motion_so_far": so_far, **ends,
    }  # fmt: skip


def picture_format(path: Path) -> str:
    """Format of a picture, from the extension of `path`.

    Raises
    ------
    ArgumentError
        The extension is not .png, .svg or .pdf.
    """
    return ending(path, (".png", ".svg", ".pdf"), "a picture")


def output_format(path: Path) -> str:
    """Format of a trajectory file, ".npz" or ".csv", from the extension of `path`.

    Raises
    ------
    ArgumentError
        The extension is another one.
    """
    return ending(path, (".npz", ".csv"), "a trajectory")


def ending(path: Path, allowed: tuple[str, ...], what: str) -> str:
    """Suffix of a file to write, which must be allowed."""
    if path.suffix not in allowed:
        raise ArgumentError(
            f"{str(path)!r}: unknown format; {what} is saved as {' or '.join(allowed)}", id="unknown-format"
        )
    return path.suffix


def to_pandas(run: RunSamples) -> Any:
    """`Columns(run)` as a DataFrame with the time as its index."""
    columns = dict(Columns(run))
    time = columns.pop("t [s]")
    pandas = _package("pandas")
    return pandas.DataFrame(columns, index=pandas.Index(time, name="t [s]"))


def to_xarray(run: RunSamples) -> Any:
    """States, torques, tip and energies as a Dataset with dimensions time, joint and axis, and with units."""
    per_time = {
        "kinetic": run.energy.kinetic, "gravity": run.energy.gravity, "elastic": run.energy.elastic,
        **({} if run.work is None else {"work": run.work, "imbalance": run.imbalance}),
    }  # fmt: skip
    mixed = "m" in run.chain.joint_units
    units = ("rad or m", "rad/s or m/s", "N m or N") if mixed else ("rad", "rad/s", "N m")
    per_joint = dict(zip(("q", "qd", "tau"), zip((run.q, run.qd, run.tau), units, strict=True), strict=True))
    return _package("xarray").Dataset(
        {
            **{name: (("time", "joint"), values, {"units": unit}) for name, (values, unit) in per_joint.items()},
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


def _package(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingDependencyError(
            f"a run as a table of {name} needs {name}; install it with: {how_to_install('tables')}",
            id="package-missing",
        ) from None
