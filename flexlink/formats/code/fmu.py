"""FMUs: the equations of motion as a component for other simulators, by FMI 3.0 or 2.0.

An FMU is a zip archive of a description, modelDescription.xml, of C sources, and of a library compiled from them. The
parts in C are step.c, the step of Co-Simulation, fmu.c, which both versions of FMI have in common, fmi2.c and fmi3.c.
"""

from __future__ import annotations

import collections
import hashlib
import io
import platform
import re
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import integer, positive, require_bool, state
from flexlink.chain.chain import Chain
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.common.versions import __version__
from flexlink.describe.scene import Scene
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.c_text import function, head, in_blocks, slopes_by_rows, step_function, template
from flexlink.formats.code.model import Model, extra_inputs, model_of, name_of
from flexlink.formats.code.sensors import signals_of
from flexlink.formats.code.tape import Number, Real


def to_fmu(
    chain: Chain, initial: tuple[ArrayLike, ArrayLike], *, fmi: int = 3, sample: float = 0.005, duration: float = 1.0,
    binary: bool = True, scene: Scene | None = None,
) -> bytes:  # fmt: skip
    """Equations of motion of an arm as an FMU for Model Exchange and Co-Simulation.

    Inputs are the torques of the driven joints, or their accelerations if their motion is prescribed, and a force and
    moment on the tip in frame 0. Outputs are angles and rates of these joints, position and rotation matrix of the
    tip. Gravity, a point mass added at the tip, `payload` [kg], and factors of `stiffness` and `damping` of all other
    hinges may change between steps. Co-Simulation uses the implicit `arm_step` of `to_c`, in equal steps of at most
    the parameter `step`, initially a tenth of `sample`. Drives and loads of a scene are not in the FMU. Signals of its
    sensors are outputs, in SI units and without the effects of the instruments: gain, bias, delay, filters, noise.

    Parameters
    ----------
    chain, initial
        The chain, and q and q̇ at the start, shape (n,) each [rad, rad/s; m, m/s].
    fmi
        Version of FMI, 2 or 3.
    sample, duration
        Step of communication and duration that the FMU proposes [s].
    binary
        Whether the archive contains, besides its sources, a library for this computer, which takes a C compiler.
    scene
        The scene of the chain, for its sensors.

    Returns
    -------
    bytes
        The archive.

    Raises
    ------
    ArgumentError
        The code is too long, `fmi` is not 2 or 3, an argument has a wrong shape, or the scene is that of another arm.
    SceneError
        The signal of a sensor is not in FMUs.
    MissingDependencyError
        `binary`, and there is no C compiler, or it fails.

    Examples
    --------
    >>> archive = fl.to_fmu(chain, (q, qd), binary=False)
    >>> print(archive[:2])
    b'PK'
    """
    fmi = integer("fmi", fmi, least=2, most=3)
    model, name = model_of(chain, extra=True), name_of(chain)
    known = np.concatenate([np.zeros(len(chain.active) + 6), chain.gravity, [0.0, 1.0, 1.0]])
    q, qd = state("initial", initial, chain.n)
    rest, back = (0.0, np.eye(chain.n)) if chain.shapes is None else (chain.rest, chain.shapes.inverse.T)
    x, step = np.append(back @ (q - rest), back @ qd), positive("sample", sample) / 10
    sensed, held = signals_of(model, scene)
    source, token = _source(model, fmi, x, known, step, [*sensed.values()], held)
    experiment = {"startTime": "0.0", "stopTime": repr(positive("duration", duration)), "stepSize": repr(float(sample))}
    described = _description(chain, fmi, token, _variables(model, x, known, step, sensed), experiment)
    files = {"modelDescription.xml": described, f"sources/{name}.c": source.encode()}
    if fmi == 3:
        files["sources/buildDescription.xml"] = (
            f'<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="{name}"><SourceFileSet '
            f'language="C99"><SourceFile name="{name}.c"/></SourceFileSet></BuildConfiguration></fmiBuildDescription>'
        ).encode()
    files |= _library(source, name, fmi) if require_bool("binary", binary) else {}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path, content in files.items():
            entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))  # the archive depends only on its files
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def _source(
    model: Model, fmi: int, x: Array, u: Array, step: float, sensed: list[Real], held: list[Number]
) -> tuple[str, str]:
    """The C file and the token that the FMU checks, a hash of the file."""
    name, outputs = name_of(model.chain), [*model.tip, *model.turned, *sensed]
    slopes = in_blocks(model, f"{name}_output_slopes", {"S": slopes_by_rows(model, outputs, held)}, "static ")
    begin = ", ".join(["0.0", repr(step), *("{" + ", ".join(map(repr, values.tolist())) + "}" for values in (x, u))])
    words = {"START": begin, "fmiN": f"fmi{fmi}", "Flag": "bool", "RATES": "GetContinuousStateDerivatives"}
    if fmi == 2:
        words |= {"Flag": "int", "RATES": "GetDerivatives", "FMUState": "FMUstate", "Deserialize": "DeSerialize"}
    parts = [
        head(model, extra_inputs()), f"#define {name.upper()}_OUTPUTS {len(outputs)}",
        function(model, f"{name}_rate", "xu", {"dx": model.rate}), slopes, step_function(model),
        in_blocks(model, f"{name}_outputs", {"y": outputs}, "static "),
        template("fmu.c", name, words), template(f"fmi{fmi}.c", name),
    ]  # fmt: skip
    text = "\n\n".join(parts) + "\n"
    token = f"{{{uuid.UUID(hashlib.sha256(text.encode()).hexdigest()[:32])}}}"
    return text.replace('"TOKEN"', f'"{token}"'), token


def _library(source: str, name: str, fmi: int) -> dict[str, bytes]:
    """The compiled library, by its path in the archive."""
    compiler, why, machine = shutil.which("cc") or shutil.which("gcc"), "no C compiler, cc or gcc", platform.machine()
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder) / f"{name}.c", Path(folder) / f"{name}.so"
        code.write_text(source, encoding="utf-8")
        if compiler:
            options = f"-std=c99 -O1 -s -shared -fPIC -fvisibility=hidden {code.name} -o {library.name} -lm".split()
            done = subprocess.run([compiler, *options], cwd=folder, capture_output=True, text=True, check=False)
            why = f"{compiler} failed: {done.stderr.strip()[:200]!r}"
        if library.exists():
            system = "linux64" if fmi == 2 and machine == "x86_64" else f"{machine}-linux"
            return {f"binaries/{system}/{name}.so": library.read_bytes()}
    raise MissingDependencyError(f"{why}; install one, or write only the sources, with binary=False", id="no-compiler")


class Variable(NamedTuple):
    """A variable of the FMU; its place in the list is its value reference."""

    label: tuple[str, str]  # name and unit
    what: str  # description
    causality: str
    start: float | None = None  # None: time, or calculated
    variability: str = "continuous"
    rate_of: int | None = None  # value reference of the state whose derivative it is
    depends: tuple[int, ...] = ()  # value references of the states and inputs from which it is computed

    @property
    def initial(self) -> str:
        """How its initial value is found; "" for time and inputs."""
        if self.causality in {"independent", "input"}:
            return ""
        return "calculated" if self.start is None else "exact"


def _variables(model: Model, x: Array, u: Array, step: float, sensed: dict[str, Real]) -> list[Variable]:
    """All variables, in the order of the value references of fmu.c."""
    chain, m, inputs = model.chain, model.chain.freedoms, len(model.chain.active) + 6
    joints, first = {chain.joint_name(k) for k in chain.active}, 1 + len(u)
    places = {number.line: first + k for k, number in enumerate(model.x)}
    places |= {number.line: 1 + k for k, number in enumerate(model.u[:inputs])}

    def depends(value: Real) -> tuple[int, ...]:
        return tuple(sorted(places[line] for line in model.tape.needed([value]) if line in places))

    given = dict.fromkeys(input_names(chain), "torque or given acceleration of a joint") | extra_inputs()
    inward = [("input", "continuous")] * inputs + [("parameter", "tunable")] * (len(u) - inputs)
    states, names = _split(state_names(chain)), chain.freedom_names * 2
    what = [f"{kind} of {name}" for kind, name in zip(["position"] * m + ["rate"] * m, names, strict=True)]
    tip = [f"tip.{axis} [m]" for axis in "xyz"] + [f"tip.R{i}{j} [1]" for i in "123" for j in "123"]
    about, longest = ["position of the tip"] * 3 + ["rotation matrix of the tip"] * 9, "longest step of Co-Simulation"
    return [
        Variable(("time", "s"), "time", "independent"),
        *(Variable(label, text, causality, start, variability) for label, text, (causality, variability), start
          in zip(_split(given), given.values(), inward, u, strict=True)),
        *(Variable(label, text, "output" if name in joints else "local", start) for label, text, name, start
          in zip(states, what, names, x, strict=True)),
        *(Variable((f"der({name})", f"{unit}2" if k >= m else f"{unit}/s"), "derivative", "local", rate_of=first + k,
                   depends=depends(model.rate[k])) for k, (name, unit) in enumerate(states)),
        *(Variable(label, text, "output", depends=depends(value)) for label, text, value
          in zip(_split(tip), about, [*model.tip, *model.turned], strict=True)),
        *(Variable(label, "signal of a sensor", "output", depends=depends(value)) for label, value
          in zip(_split(sensed), sensed.values(), strict=True)),
        Variable(("step", "s"), longest, "parameter", step, "fixed"),
    ]  # fmt: skip


def _split(names: Iterable[str]) -> list[tuple[str, str]]:
    """Names and units of FMI: "q.left_panel.1.z" and "rad" of "q left panel.1.z [rad]"."""
    split = [name.removesuffix("]").rpartition(" [")[::2] for name in names]
    plain = [name.replace(" ", ".", 1).replace(" ", "_") for name, _ in split]
    different = len(set(plain)) == len(split)  # unless links are named "left panel" and "left_panel"
    units = [unit.replace("²", "2").replace(" ", ".") for _, unit in split]
    return list(zip(plain if different else [name for name, _ in split], units, strict=True))


def _description(chain: Chain, fmi: int, token: str, variables: list[Variable], experiment: dict[str, str]) -> bytes:
    """modelDescription.xml. FMI 2.0 counts variables from 1, where FMI 3.0 has value references."""
    old, name, add, of = fmi == 2, name_of(chain), ET.SubElement, "index" if fmi == 2 else "valueReference"
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{fmi}.0", "modelName": chain.name, "guid" if old else "instantiationToken": token,
        "description": "flexible arm", "generationTool": f"flexlink {__version__}", "variableNamingConvention": "flat",
    })  # fmt: skip
    state, slopes = ("state", "providesDirectionalDerivative") if old else ("State", "providesDirectionalDerivatives")
    can = dict.fromkeys([f"canGetAndSetFMU{state}", f"canSerializeFMU{state}", slopes], "true")
    for kind, more in ("ModelExchange", {}), ("CoSimulation", {"canHandleVariableCommunicationStepSize": "true"}):
        element = add(root, kind, {"modelIdentifier": name} | can | more)
        if old:
            add(add(element, "SourceFiles"), "File", name=f"{name}.c")
    units = add(root, "UnitDefinitions")
    for unit in sorted({each.label[1] for each in variables}):
        add(add(units, "Unit", name=unit), "BaseUnit", _base_of(unit))
    add(add(root, "LogCategories"), "Category", name="logStatusError")
    add(root, "DefaultExperiment", experiment)
    listed, structure = add(root, "ModelVariables"), add(root, "ModelStructure")
    groups = [add(structure, each) if old else structure for each in ("Outputs", "Derivatives", "InitialUnknowns")]
    kinds = ["Unknown"] * 3 if old else ["Output", "ContinuousStateDerivative", "InitialUnknown"]
    for k, each in enumerate(variables):
        own = {"name": each.label[0], "valueReference": str(k), "description": each.what, "causality": each.causality}
        own |= {"variability": each.variability} | ({"initial": each.initial} if each.initial else {})
        value = {"unit": each.label[1]} | ({} if each.start is None else {"start": repr(float(each.start))})
        value |= {} if each.rate_of is None else {"derivative": str(each.rate_of + old)}
        add(add(listed, "ScalarVariable", own), "Real", value) if old else add(listed, "Float64", own | value)
    for group, kind, members in zip(groups, kinds, (
        [k for k, each in enumerate(variables) if each.causality == "output"],
        [k for k, each in enumerate(variables) if each.rate_of is not None],
        [k for k, each in enumerate(variables) if each.initial == "calculated"],
    ), strict=True):  # fmt: skip
        for k in members:
            depends = (k,) if variables[k].start is not None else variables[k].depends
            add(group, kind, {of: str(k + old), "dependencies": " ".join(str(each + old) for each in depends)})
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))


def _base_of(unit: str) -> dict[str, str]:
    """Exponents of SI units, {"kg": "1", "m": "1", "s": "-2"} for "N"."""
    exponents = collections.Counter[str]()
    for sign, side in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(\d*)", side):
            for base, own in ({"kg": 1, "m": 1, "s": -2} if name == "N" else {name: 1}).items():
                exponents[base] += sign * own * int(power or 1)
    return {base: str(power) for base, power in exponents.items() if power}
