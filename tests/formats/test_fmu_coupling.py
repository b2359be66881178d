"""A crane and its hydraulic cylinder as two FMUs, coupled at fixed steps, against one scene that contains both."""

import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from tests.formats.test_code import needs_a_compiler
from tests.formats.test_fmu import Opened

END, SAMPLE, STEPS = 3.0, 0.02, (5e-3, 2.5e-3, 1.25e-3)
VARIABLES = {"q": "input", "qd": "input", "torque": "output", "bore": "output", "rod": "output"}
LISTED = '<ScalarVariable name="{}" valueReference="{}" causality="{}"><Real{}/></ScalarVariable>'
FOUND = '<Unknown index="3"/><Unknown index="4"/><Unknown index="5"/>'
DESCRIPTION = f"""<fmiModelDescription fmiVersion="2.0" modelName="cylinder" guid="cylinder"><CoSimulation
modelIdentifier="cylinder" canHandleVariableCommunicationStepSize="true"/><ModelVariables>{{}}</ModelVariables>
<ModelStructure><Outputs>{FOUND}</Outputs><InitialUnknowns>{FOUND}</InitialUnknowns></ModelStructure>
</fmiModelDescription>"""


def crane() -> fl.Scene:
    """A stiff foot, which a cylinder lifts, with a boom that bends and 500 kg at its end."""
    box = {"material": "steel", "section": "box"}
    foot = fl.Link(name="foot", length=2.5, flex="rigid", **box)
    damped = {"damping": fl.Damping(ratio=0.02, at_hz=2.0), "joint": fl.Joint(locked=True)}
    boom = fl.Link(name="boom", length=7.0, flex="z", segments=5, **damped, **box)
    lift = fl.details.Tie(
        name="lift", kind="cylinder", bore=0.16, rod=0.09, stroke=(1.4, 2.6), dead_volume=1e-3, bulk_modulus=1.2e9,
        pressures=(8e6, 1e6), damping=4e4, times=(0.0, 2.0), lengths=(2.0, 2.3), link="foot", point=(2.0, -0.2, 0.0),
        to=fl.details.TieEnd(point=(0.9, -1.5, 0.0)),
    )  # fmt: skip
    return fl.Scene(
        name="crane",
        arm=fl.Arm(
            links=(foot, boom),
            materials={"steel": fl.Material(young=210e9, density=7850.0)},
            sections={"box": fl.Section(shape="box", height=0.3, width=0.2, wall=0.008)},
            tip=fl.RigidBody(mass=500.0),
        ),
        gravity=(0.0, -9.81, 0.0),
        initial=fl.InitialState(joint_deg=(20.0, 0.0), passive="static"),
        tie=(lift,),
        run=fl.RunSettings(tolerance=1e-9, duration=END, sample=SAMPLE, outputs=("loads",)),
    )


def cylinder(tie: fl.details.Tie, folder: Path) -> Any:
    """An instance of the FMU of a cylinder, `cylinder.c`."""
    fmpy, library = pytest.importorskip("fmpy"), folder / "cylinder.so"
    (Ax, Ay, _), (Bx, By, _), (*_, T), (L0, L1) = tie.point, tie.to.point, tie.times, tie.lengths
    numbers = {"AX": Ax, "AY": Ay, "BX": Bx, "BY": By, "T": T, "L0": L0, "L1": L1}
    numbers |= {"BULK": tie.bulk_modulus, "DAMPING": tie.damping}
    areas = np.pi / 4 * tie.bore**2, np.pi / 4 * (tie.rod**2 - tie.bore**2)
    for side, area, end, first in zip(("BORE", "ROD"), areas, tie.stroke, tie.pressures, strict=True):
        numbers |= {f"AREA_{side}": area, f"VOLUME_{side}": tie.dead_volume - area * end, f"FIRST_{side}": first}
    given = [f"-D{name}=({float(value)!r})" for name, value in numbers.items()]
    code = Path(__file__).with_name("cylinder.c")
    subprocess.run(["cc", "-std=c99", "-O1", "-shared", "-fPIC", *given, code, "-o", library, "-lm"], check=True)
    rows = enumerate(VARIABLES.items())
    listed = [LISTED.format(name, k, kind, ' start="0"' * (kind == "input")) for k, (name, kind) in rows]
    with zipfile.ZipFile(folder / "cylinder.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION.format("".join(listed)))
        archive.write(library, f"binaries/{fmpy.platform}/cylinder.so")
    description, unpacked = (each(folder / "cylinder.fmu") for each in (fmpy.read_model_description, fmpy.extract))
    made = fmpy.instantiate_fmu(unpacked, description, fmi_type="CoSimulation")
    made.setupExperiment()
    made.enterInitializationMode()
    made.exitInitializationMode()
    return made


def coupled(step: float, folder: Path, *, ahead: bool) -> tuple[np.ndarray, np.ndarray]:
    """The tip, and the pressures, with the torque at the begin of each step, or `ahead`, in its middle."""
    opened, oil = Opened(crane(), folder), cylinder(crane().tie[0], folder)
    arm, number, tips, pressures, last = opened.instance(), opened.numbers, list[Any](), list[Any](), None
    for k in range(round(END / step) + 1):
        oil.setReal([0, 1], arm.getFloat64([number["q.foot"], number["qd.foot"]]))
        torque, *sides = oil.getReal([2, 3, 4])
        if k % round(SAMPLE / step) == 0:
            tips.append(arm.getFloat64([number[f"tip.{axis}"] for axis in "xyz"]))
            pressures.append(sides)
        middle = 1.5 * torque - 0.5 * last if ahead and last is not None else torque  # extrapolated
        arm.setFloat64([number["tau.foot"]], [middle])
        arm.doStep(k * step, step)
        oil.doStep(k * step, step)
        last = torque
    return np.array(tips), np.array(pressures)


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize(
    ("ahead", "order", "most"),
    [pytest.param(False, 1, (1e-4, 2e-3), id="held"), pytest.param(True, 2, (1e-5, 2e-4), id="extrapolated")],
)
def test_a_crane_and_its_cylinder_as_two_fmus_move_as_one_scene(
    ahead: bool, order: int, most: tuple[float, float], tmp_path: Path
) -> None:
    run, errors = fl.simulate(crane()), list[list[float]]()
    pairs = (run.tip, np.ptp(run.tip, axis=0).max()), (run.pressures["lift"], run.pressures["lift"].max())
    for step in STEPS:
        found = coupled(step, tmp_path, ahead=ahead)
        errors.append([np.abs(own - one).max() / size for own, (one, size) in zip(found, pairs, strict=True)])
    assert (np.array(errors[0]) <= most).all()
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(np.full((2, 2), order), abs=0.2)
