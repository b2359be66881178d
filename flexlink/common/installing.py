"""How to install optional packages: the command of pip, and the names that conda-forge gives the same packages."""

from __future__ import annotations


def how_to_install(what: str) -> str:
    """Return the commands that install an extra of flexlink, or packages that have one name everywhere.

    Parameters
    ----------
    what
        An extra of pyproject.toml, or names of packages separated by blanks.

    Returns
    -------
    str
        The end of a message: the command for pip, then, if conda-forge has these packages, the one for conda.
    """
    by_conda = {
        "completion": "shtab",
        "control": "control",
        "dask": "distributed",
        "engines": "pinocchio mujoco",
        "report": "matplotlib jinja2",
        "robots": "example-robot-data",
        "tables": "pandas xarray",
        "witness": "",  # Drake and Exudyn are not in conda-forge
    }
    by_pip = f"'flexlink[{what}]'" if what in by_conda else what
    packages = by_conda.get(what, what)
    also = f", or with: conda install -c conda-forge {packages}" if packages else ""
    return f"python -m pip install {by_pip}{also}"
