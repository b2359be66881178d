"""FMUs: the equations of motion as a component for other simulators, by FMI 3.0 or 2.0.

An FMU is a zip archive of a description, modelDescription.xml, of C sources, and of a library compiled from them. The
parts in C are step.c, the step of Co-Simulation, fmu.c, which both versions of FMI have in common, fmi2.c and fmi3.c.
"""

from __future__ import annotations

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

from flexlink.chain.arguments import integer, positive, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.common.versions import __version__
from flexlink.dynamics.free_motion import input_names, state_names
from flexlink.formats.code.c_text import head, in_blocks, rate_function, slopes_by_rows, step_function, template
from flexlink.formats.code.model import Model, extra_inputs, model_of, name_of
from flexlink.formats.code.tape import Real


def to_fmu(
    chain: Chain, initial: tuple[ArrayLike, ArrayLike], *, fmi: int = 3, sample: float = 0.005, duration: float = 1.0,
    binary: bool = True,
) -> bytes:  # fmt: skip
    """Equations of motion of an arm as an FMU for Model Exchange and Co-Simulation.

    Inputs are the torques of the driven joints, or their accelerations if their motion is prescribed, and a force and
    moment on the tip in frame 0. Outputs are angles and rates of these joints, position and rotation matrix of the
    tip. Parameters that may change between steps are gravity, a `payload` [kg], a point mass added at the tip, and
    factors of the `stiffness` and `damping` of all other hinges. Drives and loads of a scene are not in the FMU.

    Co-Simulation divides a step into equal steps of at most the parameter `step`, initially a tenth of `sample`, by the
    implicit `arm_step` of `to_c`. Model Exchange has states with derivatives, without events. Both have directional
    derivatives, and states that can be stored and restored.

    Parameters
    ----------
    chain
        The chain.
    initial
        q and q̇ at the start, shape (n,) each [rad, rad/s; m, m/s].
    fmi
        Version of FMI, 2 or 3.
    sample, duration
        Step of communication and duration that the FMU proposes [s].
    binary
        Whether the archive contains a library for this computer, which takes a C compiler, cc, a minute for an arm
        with many coordinates. The sources are always in it.

    Returns
    -------
    bytes
        The archive; equal arguments give equal bytes with the same compiler.

    Raises
    ------
    ArgumentError
        The code is too long, there is no such version, or an argument has a wrong shape.
    MissingDependencyError
        `binary`, and there is no C compiler, or it fails.

    Examples
    --------
    >>> archive = fl.to_fmu(chain, (q, qd), binary=False)
    >>> print(archive[:2])
    b'PK'
    """
    fmi = integer("fmi", fmi, least=2, most=3)
    model, name = model_of(require_type("chain", chain, Chain), extra=True), name_of(chain)
    known = np.concatenate([np.zeros(len(chain.active) + 6), chain.gravity, [0.0, 1.0, 1.0]])
    x, step = _coordinates(chain, initial), positive("sample", sample) / 10
    source, token = _source(model, fmi, x, known, step)
    experiment = {"startTime": "0.0", "stopTime": repr(float(duration)), "stepSize": repr(float(sample))}
    described = _description(chain, fmi, token, _variables(model, x, known, step), experiment)
    files = {"modelDescription.xml": described, f"sources/{name}.c": source.encode()}
    if fmi == 3:
        files["sources/buildDescription.xml"] = _build_description(name)
    return _archive(files | (_library(source, name, fmi) if binary else {}))


def _coordinates(chain: Chain, initial: tuple[ArrayLike, ArrayLike]) -> Array:
    """z and ż of angles and rates."""
    q, qd = (vector(name, value, chain.n) for name, value in zip(("initial q", "initial qd"), initial, strict=True))
    if chain.shapes is None:
        return np.append(q, qd)
    back = chain.shapes.inverse.T
    return np.append(back @ (q - chain.rest), back @ qd)


def _source(model: Model, fmi: int, x: Array, u: Array, step: float) -> tuple[str, str]:
    """The C file and the token that the FMU checks, a hash of the file."""
    name, outputs = name_of(model.chain), [*model.tip, *model.turned]
    slopes = in_blocks(model, f"{name}_output_slopes", {"S": slopes_by_rows(model, outputs)}, "static ")
    begin = ", ".join(["0.0", repr(step), *("{" + ", ".join(map(repr, values.tolist())) + "}" for values in (x, u))])
    words = {"START": begin, "fmiN": f"fmi{fmi}", "Flag": "bool", "RATES": "GetContinuousStateDerivatives"}
    if fmi == 2:
        words |= {"Flag": "int", "RATES": "GetDerivatives", "FMUState": "FMUstate", "Deserialize": "DeSerialize"}
    parts = [
        head(model, tuple(extra_inputs())), f"#define {name.upper()}_OUTPUTS {len(outputs)}", rate_function(model),
        in_blocks(model, f"{name}_outputs", {"y": outputs}, "static "), slopes, step_function(model),
        template("fmu.c", name, words), template(f"fmi{fmi}.c", name),
    ]  # fmt: skip
    text = "\n\n".join(parts) + "\n"
    token = f"{{{uuid.UUID(hashlib.sha256(text.encode()).hexdigest()[:32])}}}"
    return text.replace('"TOKEN"', f'"{token}"'), token


def _build_description(name: str) -> bytes:
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    ET.SubElement(ET.SubElement(build, "SourceFileSet", language="C99"), "SourceFile", name=f"{name}.c")
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))


def _library(source: str, name: str, fmi: int) -> dict[str, bytes]:
    """The compiled library, by its path in the archive."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.c").write_text(source, encoding="utf-8")
        command = ["-std=c99", "-O1", "-s", "-shared", "-fPIC", "-fvisibility=hidden", f"{name}.c", "-o", f"{name}.so"]
        if compiler is None:
            why = "found no C compiler, cc or gcc"
        else:
            done = subprocess.run([compiler, *command, "-lm"], cwd=folder, capture_output=True, text=True, check=False)
            why = f"{compiler} failed: {done.stderr.strip()[:200]!r}"
            if done.returncode == 0:
                machine, known = platform.machine(), fmi == 2 and platform.machine() == "x86_64"
                system = "linux64" if known else f"{machine}-linux"
                return {f"binaries/{system}/{name}.so": (Path(folder) / f"{name}.so").read_bytes()}
    raise MissingDependencyError(f"{why}; install one, or write only the sources, with binary=False", id="no-compiler")


def _archive(files: dict[str, bytes]) -> bytes:
    """A zip archive that depends only on its files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path, content in files.items():
            entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


class Variable(NamedTuple):
    """A variable of the FMU; its place in the list is its value reference."""

    name: str
    unit: str
    what: str  # description
    kind: dict[str, str]  # causality, variability and, if it has one, how its initial value is found
    start: float | None = None
    rate_of: int | None = None  # value reference of the state whose derivative it is
    depends: tuple[int, ...] = ()  # value references of the states and inputs from which it is computed


def _variables(model: Model, x: Array, u: Array, step: float) -> list[Variable]:
    """All variables, in the order of the value references of fmu.c."""
    chain, m, outputs = model.chain, model.chain.freedoms, [*model.tip, *model.turned]
    driven, joints = len(chain.active), {chain.joint_name(k) for k in chain.active}
    first, inputs = 1 + len(u), driven + 6
    places = {number.line: first + k for k, number in enumerate(model.x)}
    places |= {number.line: 1 + k for k, number in enumerate(model.u[:inputs])}

    def kind(causality: str, variability: str = "continuous", initial: str = "") -> dict[str, str]:
        return {"causality": causality, "variability": variability} | ({"initial": initial} if initial else {})

    def depends(value: Real) -> tuple[int, ...]:
        return tuple(sorted(places[line] for line in model.tape.needed([value]) if line in places))

    found = [Variable("time", "s", "time", kind("independent"))]
    given = dict.fromkeys(input_names(chain), "torque or given acceleration of a joint") | extra_inputs()
    for k, ((name, unit), what) in enumerate(zip(_split(given), given.values(), strict=True)):
        own = kind("input") if k < inputs else kind("parameter", "tunable", "exact")
        found.append(Variable(name, unit, what, own, u[k]))
    states = _split(state_names(chain))
    for k, (name, unit) in enumerate(states):
        seen = "output" if chain.freedom_names[k % m] in joints else "local"
        what = f"{('position', 'rate')[k >= m]} of {chain.freedom_names[k % m]}"
        found.append(Variable(name, unit, what, kind(seen, initial="exact"), x[k]))
    calculated = kind("local", initial="calculated")
    for k, ((name, unit), value) in enumerate(zip(states, model.rate, strict=True)):
        per = f"{unit}2" if k >= m else f"{unit}/s"
        found.append(Variable(f"der({name})", per, "derivative", calculated, rate_of=first + k, depends=depends(value)))
    names = [f"tip.{axis} [m]" for axis in "xyz"] + [f"tip.R{i}{j} [1]" for i in "123" for j in "123"]
    for (name, unit), value in zip(_split(names), outputs, strict=True):
        what = "position of the tip" if unit == "m" else "rotation matrix of the tip frame"
        own = kind("output", initial="calculated")
        found.append(Variable(name, unit, what, own, depends=depends(value)))
    longest = "longest step of Co-Simulation within a step of communication"
    return [*found, Variable("step", "s", longest, kind("parameter", "fixed", "exact"), step)]


def _split(names: Iterable[str]) -> list[tuple[str, str]]:
    """Names and units of FMI: "q.left_panel.1.z" and "rad" of "q left panel.1.z [rad]"."""
    split = [name.removesuffix("]").rpartition(" [")[::2] for name in names]
    plain = [name.replace(" ", ".", 1).replace(" ", "_") for name, _ in split]
    different = len(set(plain)) == len(split)  # unless links are named "left panel" and "left_panel"
    units = [unit.replace("²", "2").replace(" ", ".") for _, unit in split]
    return list(zip(plain if different else [name for name, _ in split], units, strict=True))


def _description(chain: Chain, fmi: int, token: str, variables: list[Variable], experiment: dict[str, str]) -> bytes:
    """modelDescription.xml."""
    name = name_of(chain)
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{fmi}.0", "modelName": chain.name, "guid" if fmi == 2 else "instantiationToken": token,
        "description": "flexible arm", "generationTool": f"flexlink {__version__}", "variableNamingConvention": "flat",
    })  # fmt: skip
    both = ("canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative")
    can = dict.fromkeys(both, "true") if fmi == 2 else {key.replace("state", "State"): "true" for key in both[:2]}
    for kind in ("ModelExchange", "CoSimulation"):
        own = can | ({"providesDirectionalDerivatives": "true"} if fmi == 3 else {})
        if kind == "CoSimulation":
            own |= {"canHandleVariableCommunicationStepSize": "true"}
        element = ET.SubElement(root, kind, {"modelIdentifier": name} | own)
        if fmi == 2:
            ET.SubElement(ET.SubElement(element, "SourceFiles"), "File", name=f"{name}.c")
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({each.unit for each in variables}):
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", _base_of(unit))
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="reasons of errors")
    ET.SubElement(root, "DefaultExperiment", experiment)
    listed = ET.SubElement(root, "ModelVariables")
    for reference, each in enumerate(variables):
        _put_variable(listed, reference, each, fmi)
    _put_structure(ET.SubElement(root, "ModelStructure"), variables, fmi)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))


def _base_of(unit: str) -> dict[str, str]:
    """Exponents of SI units, {"kg": "1", "m": "1", "s": "-2"} for "N"."""
    exponents = dict[str, int]()
    for sign, side in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(\d*)", side):
            for base, own in ({"kg": 1, "m": 1, "s": -2} if name == "N" else {name: 1}).items():
                exponents[base] = exponents.get(base, 0) + sign * own * int(power or 1)
    return {base: str(power) for base, power in exponents.items() if power}


def _put_variable(listed: ET.Element, reference: int, each: Variable, fmi: int) -> None:
    whole = {"name": each.name, "valueReference": str(reference), "description": each.what} | each.kind
    value = {"unit": each.unit}
    if each.start is not None:
        value["start"] = repr(float(each.start))
    if each.rate_of is not None:
        value["derivative"] = str(each.rate_of + (fmi == 2))  # FMI 2.0 counts variables from 1
    if fmi == 2:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", whole), "Real", value)
    else:
        ET.SubElement(listed, "Float64", whole | value)


def _put_structure(root: ET.Element, variables: list[Variable], fmi: int) -> None:
    """Outputs, derivatives, and what an importer may ask for before the run, with what they depend on."""
    outputs = [k for k, each in enumerate(variables) if each.kind["causality"] == "output"]
    rates = [k for k, each in enumerate(variables) if each.rate_of is not None]
    computed = [k for k, each in enumerate(variables) if each.kind.get("initial") == "calculated"]
    groups = {("Output", "Outputs"): outputs, ("ContinuousStateDerivative", "Derivatives"): rates}
    for (one, many), members in (groups | {("InitialUnknown", "InitialUnknowns"): computed}).items():
        group = ET.SubElement(root, many) if fmi == 2 else root
        for k in members:
            own = (k,) if variables[k].start is not None else variables[k].depends
            depends = {"dependencies": " ".join(str(each + (fmi == 2)) for each in own)}
            of = {"index": str(k + 1)} if fmi == 2 else {"valueReference": str(k)}
            ET.SubElement(group, "Unknown" if fmi == 2 else one, of | (depends if one != "InitialUnknown" else {}))
