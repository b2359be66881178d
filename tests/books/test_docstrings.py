"""Each public name has a working example, run in a folder with the models of the checkout."""

import doctest
import importlib
import inspect
import re
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

import flexlink as fl
from flexlink.common.versions import old_names
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.dynamics import rounding
from flexlink.dynamics.vibration import stability
from flexlink.dynamics.vibration.modal import Modes
from flexlink.engines import ENGINES, base, load
from tests.conftest import MODELS, ROOT, compiled
from tests.support.words import refused

pytestmark = compiled  # `prepared.py` prepares a run with compiled kernels

MODULES = {name: module for name in fl.__all__ if inspect.ismodule(module := getattr(fl, name))}
PUBLIC = {name: getattr(fl, name) for name in fl.__all__ if name not in MODULES} | {
    f"{name}.{one}": getattr(module, one) for name, module in MODULES.items() for one in module.__all__
}
RUN = PUBLIC | {"Modes": Modes, "ReferenceTrajectory": ReferenceTrajectory}  # some results also have examples
SLOW = {"Trajectory", "advise", "compare", "compare_trajectories", "report"}  # other engines, pages, many runs
NEEDS = {"compare": "mujoco", "compare_trajectories": "mujoco", "errors.EngineError": "mujoco", "report": "pinocchio"}


def without_example(names: Mapping[str, object]) -> list[str]:
    """Names of objects whose docstring has no runnable example."""
    return [
        name for name, thing in names.items() if not doctest.DocTestParser().get_examples(inspect.getdoc(thing) or "")
    ]


def examples(name: str, names: dict[str, Any]) -> Iterator[doctest.DocTest]:
    """Examples in the docstrings of a public name and of its public methods."""
    thing = RUN[name]
    parser = doctest.DocTestParser()
    members = inspect.getmembers(thing) if inspect.isclass(thing) else []
    methods = {f"{name}.{key}": value for key, value in members if not key.startswith("_") and inspect.isroutine(value)}
    for place, one in {name: thing, **methods}.items():
        yield parser.get_doctest(inspect.getdoc(one) or "", dict(names), place, None, 0)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """The names available to every example, from `prepared.py`."""
    return {"Path": Path, **runpy.run_path(str(ROOT / "tests" / "support" / "prepared.py"))}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in RUN])
def test_examples_run_as_written(name: str, names: dict[str, Any], tmp_path, monkeypatch) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    for folder in ("models", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("Agg")
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    printed: list[str] = []
    for test in examples(name, names):
        runner.run(test, out=printed.append)
    assert not runner.failures, "".join(printed)


def test_every_public_name_has_an_example() -> None:
    assert without_example(PUBLIC) == []


def test_a_name_without_an_example_is_reported() -> None:
    def bare() -> None:
        """A docstring without an example, as >> is not a prompt."""

    assert without_example({"mass_matrix": fl.mass_matrix, "bare": bare, "no text": object()}) == ["bare", "no text"]


STATE = ["q", "qd", "qdd", "tau"]
OF_A_STATE = [
    *(fl.inverse_dynamics, fl.bias_torque, fl.gravity_torque, fl.elastic_torque, fl.friction_torque, fl.mass_matrix),
    *(fl.forward_dynamics, fl.energy, fl.frames, fl.tip_position, fl.modes, fl.natural_frequencies, fl.solve_static),
    *(fl.inverse_dynamics_derivatives, fl.forward_dynamics_derivatives, fl.jacobian, fl.linearize),
    *(fl.strength.internal_loads, fl.point_motion),
    *(fl.strength.buckling_loads, fl.stable_step, stability.eigenvalues, stability.fastest_eigenvalues),
    *(rounding.of_mass_matrix, rounding.of_bias_torque, rounding.of_elastic_torque),
    *(rounding.of_friction_torque, rounding.of_residual, rounding.of_acceleration, rounding.acceleration_error),
]
OF_OTHERS = {
    fl.simulate: ["scene"], fl.simulate_many: ["scenes"], fl.compare: ["scene"], fl.lump: ["scene"],
    fl.initial_state: ["scene", "chain"], fl.to_urdf: ["chain"], fl.to_mjcf: ["chain"], fl.to_sdf: ["chain"],
    fl.sensitivities: ["scene", "parameters"],
    fl.strength.beam_strain: ["scene", "q"],
    fl.load_scene: ["path"], fl.Sweep.load: ["path"], fl.Trajectory.load: ["path"],
    fl.sweep: ["what"], load: ["name", "chain"],
}  # fmt: skip


def positional(function: Callable[..., object]) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    return [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD and p.name != "self"]


def by_name(function: Callable[..., object]) -> list[str]:
    return [p.name for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY]


@pytest.mark.parametrize("function", OF_A_STATE, ids=lambda function: function.__name__)
def test_chain_and_state_are_positional_and_other_arguments_keyword_only(function: Callable[..., object]) -> None:
    chain, *state = positional(function)
    assert chain == "chain"
    assert state == [name for name in STATE if name in state]


@pytest.mark.parametrize("function", OF_OTHERS, ids=lambda function: function.__name__)
def test_the_subject_of_a_function_is_positional_and_other_arguments_keyword_only(function: Callable) -> None:
    assert positional(function) == OF_OTHERS[function]


def test_options_with_the_same_name_have_the_same_order() -> None:
    order = ["tip_wrench", "frame", "gains", "locked", "solver", "algorithm", "method", "tolerance"]
    for function in OF_A_STATE:
        options = [name for name in by_name(function) if name in order]
        assert options == sorted(options, key=order.index), function


PUBLIC_MODULES = [fl, *(thing for name in fl.__all__ if inspect.ismodule(thing := getattr(fl, name)))]
FUNCTIONS = [
    function
    for module in PUBLIC_MODULES
    for name in module.__all__
    if inspect.isfunction(function := getattr(module, name))
]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_a_public_function_documents_its_parameters_result_and_errors(function: Callable) -> None:
    docstring = inspect.getdoc(function) or ""
    for section in ("Parameters", "Returns", "Raises"):
        assert f"\n\n{section}\n{'-' * len(section)}\n" in docstring
    named = {
        name
        for line in docstring.splitlines()
        if re.fullmatch(r"\**\w+(, \**\w+)*", line)
        for name in re.findall(r"\w+", line)
    }
    assert set(inspect.signature(function).parameters) <= named


@pytest.mark.parametrize("engine", ENGINES)
def test_engine_methods_follow_the_same_argument_rules(engine: str) -> None:
    try:
        kind = type(load(engine, fl.lump(fl.load_scene(MODELS[0]))))
    except fl.errors.MissingDependencyError as missing:
        pytest.skip(str(missing))
    for name in ("mass_matrix", "bias_torque", "gravity_torque", "elastic_torque", "friction_torque"):
        function = getattr(kind, name)
        assert positional(function) == positional(getattr(fl, name))[1:]
        assert inspect.signature(function).parameters.keys() == (
            inspect.signature(getattr(base.Engine, name)).parameters.keys()
        )


def test_every_public_name_exists_and_engines_are_loaded_on_demand() -> None:
    code = (
        "import sys; sys.modules['pinocchio'] = sys.modules['mujoco'] = None\n"
        "import flexlink as fl\n"
        "assert not [name for name in sys.modules if name.startswith('flexlink.engines')]\n"
        "assert [name for name in dir(fl) if name[:2] != '__'] == sorted(fl.__all__)\n"
        "for name in fl.__all__: getattr(fl, name)\n"
        "assert fl.compare.__wrapped__ is sys.modules['flexlink.diagnosis.comparison'].compare\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with refused(AttributeError, "test-grammar"):
        fl.compere  # noqa: B018
    with refused(AttributeError, "test-grammar"):
        fl.FitRun  # noqa: B018


@pytest.mark.parametrize("path", old_names())
def test_a_deprecated_name_works_and_states_its_successor(path: str) -> None:
    module, _, name = path.rpartition(".")
    with pytest.warns(DeprecationWarning, match=re.escape(f"{path} is deprecated; it is now {old_names()[path][1]}")):
        assert callable(getattr(importlib.import_module(module), name))
    assert path.removeprefix("flexlink.") not in PUBLIC
