"""flexlink: robot arms with flexible links, modelled as rigid segments and springs."""

import functools
import importlib
import importlib.util
import types
from pathlib import Path

import flexlink.common.interruption  # noqa: F401  must come first: responds to signals from then on

# isort: split

from flexlink import errors as errors
from flexlink.common.errors import FlexlinkError as FlexlinkError
from flexlink.common.versions import __version__ as __version__
from flexlink.common.versions import old_name
from flexlink.common.wording import did_you_mean


@functools.cache
def _places() -> dict[str, str]:
    """Module of each public name, sorted by name, from the list for type checkers."""
    import ast  # noqa: PLC0415  saves a tenth of the time of `import flexlink`

    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    places = ((each.names[0].name, str(each.module)) for each in stub.body if isinstance(each, ast.ImportFrom))
    return {name: module for name, module in sorted(places) if name != "__version__"}


def __getattr__(name: str) -> object:
    """Load a public name when it is first used, because compiled code and linear algebra are slow to import."""
    modules = ("details", "fits", "small_motion", "strength")
    if name in modules:
        return importlib.import_module(f"flexlink.{name}")
    if name == "__all__":
        return [*_places()]
    if name in _places():
        module = importlib.import_module(_places()[name])
        public, room = getattr(module, name), module.__name__.rpartition(".")[2]
        quick = "terms", "accelerations", "conserved", "forces", "placement", "simulate"  # a check would be felt
        if isinstance(public, types.FunctionType) and room not in quick:
            from flexlink.chain.arguments import explained  # noqa: PLC0415  imports NumPy, as the function did

            public = explained(public)
        return globals().setdefault(name, public)
    if found := old_name(f"flexlink.{name}"):
        return found
    where = ""
    if not name.startswith("_") and importlib.util.find_spec(f"flexlink.{name}") is None:  # a module is also asked for
        moved = [m for m in modules if name in importlib.import_module(f"flexlink.{m}").__all__]
        elsewhere = {"crba": "mass_matrix", "rnea": "inverse_dynamics", "aba": "forward_dynamics", "load": "load_scene"}
        near = did_you_mean(elsewhere.get(name.partition("_")[0], name), _places())
        near = "; a run plots itself, run.plot()" if name == "plot" else near
        where = f"; it is flexlink.{moved[0]}.{name}" if moved else near
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{where}")


def __dir__() -> list[str]:
    return sorted({*_places(), *(name for name in globals() if name.startswith("__"))})
