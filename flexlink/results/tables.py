"""Tables of a run for pandas and xarray, which are imported only if they are used."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from flexlink.common.errors import MissingDependencyError
from flexlink.common.installing import how_to_install
from flexlink.results.columns import Columns
from flexlink.results.samples import RunSamples


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
