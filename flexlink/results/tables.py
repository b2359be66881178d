"""A run as tables of other packages: pandas and xarray, which only those need who ask for them."""

from __future__ import annotations

import importlib
from typing import Any

from flexlink.common.errors import MissingDependencyError
from flexlink.results.columns import Columns
from flexlink.results.samples import RunSamples


def to_pandas(run: RunSamples) -> Any:
    """`Columns(run)` as a DataFrame, whose index is the time."""
    columns = dict(Columns(run))
    time = columns.pop("t [s]")
    pandas = _package("pandas")
    return pandas.DataFrame(columns, index=pandas.Index(time, name="t [s]"))


def to_xarray(run: RunSamples) -> Any:
    """States, torques, tip and energies as a Dataset over time, joint and axis, with units."""
    per_time = {
        "kinetic": run.energy.kinetic, "gravity": run.energy.gravity, "elastic": run.energy.elastic,
        **({} if run.work is None else {"work": run.work, "imbalance": run.imbalance}),
    }  # fmt: skip
    per_joint = {"q": (run.q, "rad"), "qd": (run.qd, "rad/s"), "tau": (run.tau, "N m")}
    return _package("xarray").Dataset(
        {
            **{name: (("time", "joint"), values, {"units": unit}) for name, (values, unit) in per_joint.items()},
            "tip": (("time", "axis"), run.tip, {"units": "m"}),
            **{name: (("time",), values, {"units": "J"}) for name, values in per_time.items()},
        },
        coords={
            "time": ("time", run.t, {"units": "s"}), "joint": list(run.chain.joint_names), "axis": list("xyz"),
        },
        attrs={"name": run.chain.name, "warnings": "\n".join(run.warnings)},
    )  # fmt: skip


def _package(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingDependencyError(
            f"a run as a table of {name} needs {name}; install it with: python -m pip install 'flexlink[tables]'"
        ) from None
