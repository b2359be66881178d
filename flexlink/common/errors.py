"""Errors of flexlink, with one base class: every message names the item, its value and what is allowed."""

from __future__ import annotations

import contextlib
import copyreg
import importlib
import signal
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flexlink.common.types import T


ALSO = "; also "  # separator between two mistakes in one message


class Diagnostic(str):
    """A message for the user, of any severity, with a stable `id`, such as `"unknown-key"`, which the site explains."""

    __slots__ = ("id",)

    id: str

    def __new__(cls, text: str, id: str) -> Self:
        """Return the text as a string with an id."""
        self = super().__new__(cls, text)
        self.id = id
        return self

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        """Arguments for unpickling: text and id."""
        return str(self), self.id


class FlexlinkError(Exception):
    """Base class of all errors that flexlink raises on purpose; the command line prints them as one line.

    `error.id` is a stable name of the mistake, such as `"unknown-key"`; the page "Messages" explains all of them.

    Examples
    --------
    >>> try:
    ...     fl.load_scene("missing.toml")
    ... except fl.FlexlinkError as error:
    ...     print(type(error).__name__, error.id)
    SceneError cannot-read
    """

    _id = ""

    def __init__(self, message: str = "", *, id: str = "") -> None:
        super().__init__(message)
        if known := id or getattr(message, "id", ""):
            self._id = known

    @property
    def id(self) -> str:
        """Stable name of the mistake; by default the id of the error being handled when this one was raised."""
        return self._id or getattr(self.__cause__ or self.__context__, "id", "")

    @property
    def diagnostic(self) -> Diagnostic:
        """The message with its id."""
        return Diagnostic(str(self), self.id)

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep all attributes when pickled; by default, a process pool rebuilds an error only from its message."""
        return copyreg.__newobj__, (type(self), *self.args), {**self.__dict__, "_id": self.id}  # type: ignore[attr-defined]


class SceneError(FlexlinkError, ValueError):
    """A scene, or a part of a scene such as a link, is invalid (TOML file or Python object).

    Examples
    --------
    >>> fl.Section(shape="tube", outer=0.05, inner=0.06)
    Traceback (most recent call last):
        ...
    flexlink.common.errors.SceneError: inner = 0.06: must be smaller than outer = 0.05
    """


class DataFileError(FlexlinkError, ValueError):
    """An invalid data file, such as a lumping rule, a Runge-Kutta method, an engine's XML or a validation case.

    Examples
    --------
    >>> _ = Path("mine.toml").write_text("order = 4")
    >>> fl.simulate(scene, method="mine.toml")
    Traceback (most recent call last):
        ...
    flexlink.common.errors.DataFileError: run.method = ...: about: missing; this key is required
    """


class ArgumentError(FlexlinkError, ValueError):
    """A function argument has a wrong shape, dtype, value or name.

    Examples
    --------
    >>> fl.tip_position(chain, [0.0])
    Traceback (most recent call last):
        ...
    flexlink.common.errors.ArgumentError: q has shape (1,); expected (6,), or (b, 6) for b states: ...
    """


class SingularMassError(FlexlinkError, ArithmeticError):
    """The mass matrix is not positive definite in this configuration: some joint has no inertia attached.

    Examples
    --------
    >>> wire = fl.Arm(links=(fl.Link(name="wire"),))  # without mass, hub, armature
    >>> weightless = fl.Scene(name="wire", arm=wire)
    >>> fl.forward_dynamics(fl.lump(weightless), [0.0], [0.0], [0.0])
    Traceback (most recent call last):
        ...
    flexlink.common.errors.SingularMassError: mass matrix of 'wire' is singular: joint 'wire' has no ...
    """


class OutputError(FlexlinkError, OSError):
    """A result could not be written; if it was saved elsewhere, the message states where.

    Examples
    --------
    >>> scene.save("nowhere/scene.toml")
    Traceback (most recent call last):
        ...
    flexlink.common.errors.OutputError: nowhere/scene.toml: cannot be written: No such file or ...
    """


class MissingDependencyError(FlexlinkError, ImportError):
    """An optional package (an engine, matplotlib) is not installed; the message names the extra to install.

    Examples
    --------
    >>> try:
    ...     table = run.to_pandas()
    ... except fl.errors.MissingDependencyError as error:
    ...     print(error)  # the package, and how to install it
    """


class EngineError(FlexlinkError, RuntimeError):
    """Another engine failed: its process crashed, or did not answer in time.

    Examples
    --------
    >>> try:
    ...     found = fl.compare(scene, engines=["mujoco"], samples=2)
    ... except fl.errors.EngineError as error:
    ...     print(error)  # its process crashed
    """


class UnstableStepError(FlexlinkError, ValueError):
    """The step exceeds the largest stable step, `largest` [s]; `unstable = "allow"` permits the run.

    Examples
    --------
    >>> try:
    ...     fl.simulate(scene, step=2e-3)
    ... except fl.errors.UnstableStepError as error:
    ...     print(f"{error.largest:.2g} s")
    0.00095 s
    """

    def __init__(self, message: str, largest: float, *, id: str = "") -> None:
        super().__init__(message, id=id)
        self.largest = largest


class ConvergenceError(FlexlinkError, ArithmeticError):
    """The static solver did not converge; `q` is the last equilibrium it found, at the fraction `load` of the load.

    Examples
    --------
    >>> try:
    ...     rest = fl.solve_static(chain, tip_wrench=[0.0, -1e9, 0.0, 0.0, 0.0, 0.0], locked=chain.active)
    ... except fl.errors.ConvergenceError as error:
    ...     print(error.load < 1.0, error.q.shape)  # the fraction of the load that was reached
    True (6,)
    """

    def __init__(self, message: str, q: NDArray[np.float64], load: float, *, id: str = "") -> None:
        super().__init__(message, id=id)
        self.q, self.load = q, load


class IdentifiabilityError(FlexlinkError, ValueError):
    """Some parameters are not identifiable from the data; `check` is the result of `check_fit`.

    Examples
    --------
    >>> friction = fl.fits.FitParameter(path="link.upper.joint.viscous", start=1.0)
    >>> # joints held: frequencies do not depend on friction
    >>> tapped = fl.fits.FitModes(hertz=(5.7, 26.9), deviation=(0.01,))
    >>> try:
    ...     fl.fit(fl.fits.FitProblem(scene=scene, parameter=(friction,), modes=(tapped,)))
    ... except fl.errors.IdentifiabilityError as error:
    ...     print(error)
    link.upper.joint.viscous has no effect on the data
    """

    _id = "not-identifiable"

    def __init__(self, message: str, check: object) -> None:
        super().__init__(message)
        self.check = check


class InterruptedSweepError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM interrupted a sweep; `signal` is the number of the signal."""

    def __init__(self, message: str, number: int = signal.SIGINT) -> None:
        super().__init__(message)
        self.signal = number


def how_to_install(what: str) -> str:
    """Commands that install an extra of flexlink, or packages; one for conda if conda-forge has them."""
    by_conda = {
        "completion": "shtab", "control": "control", "dask": "distributed", "engines": "pinocchio mujoco",
        "report": "matplotlib jinja2", "robots": "example-robot-data", "tables": "pandas xarray h5netcdf h5py",
        "witness": "",
    }  # fmt: skip
    by_pip = f"'flexlink[{what}]'" if what in by_conda else what
    packages = by_conda.get(what, what)
    also = f", or with: conda install -c conda-forge {packages}" if packages else ""
    return f"python -m pip install {by_pip}{also}"


def imported(name: str, needs: str, extra: str) -> ModuleType:
    """Import a module that is needed only here; `extra` is the part of flexlink that installs what it needs."""
    try:
        return importlib.import_module(name)
    except ImportError:
        why = f"{needs} install it with: {how_to_install(extra)}"
        raise MissingDependencyError(why, id="package-missing") from None


@contextlib.contextmanager
def errors_at(place: str, *others: type[FlexlinkError], file: str = "") -> Iterator[None]:
    """Let errors of a description begin with its place in a scene or file; `others` become errors of the scene.

    A `file` that the place names is not repeated.
    """
    described: tuple[type[FlexlinkError], ...] = (SceneError, DataFileError, *others)
    try:
        yield
    except described as error:
        kind = DataFileError if isinstance(error, DataFileError) else SceneError
        raise kind(f"{place}{str(error).removeprefix(f'{file}: ')}") from None


def or_error(function: Callable[..., Any], *arguments: object) -> Any:
    """What a function returns, or the error that it raises."""
    try:
        return function(*arguments)
    except FlexlinkError as error:
        return error


def or_raise(found: T | FlexlinkError) -> T:
    """A value, unless it is an error, which is raised."""
    if isinstance(found, FlexlinkError):
        raise found
    return found
