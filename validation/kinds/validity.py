"""Domain of validity: the largest relative thickness and the largest axial load at which a chain is accurate.

By default a chain models an Euler-Bernoulli beam, without shear. The reference is Timoshenko's beam, also for a link
with `shear`. For a link under an axial compressive force the reference is the slender beam under that force, and the
error is due to the hinges. A turning link with `stretch` has the extension u of a bar, u'' + k² (x + u) = 0, with
k = ω √(ρ/E).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import modes
from flexlink.dynamics.vibration.steady import equilibrium_in_motion
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles import thick_beam
from validation.oracles.thick_beam import Beam
from validation.store import Series, table

SHEAR_FACTOR = 5 / 6  # shear correction factor of a rectangle
RIGID = 1e30  # N: shear stiffness of a beam without shear


class Settings(Spec, frozen=True, kw_only=True):
    """Length-to-height ratios, ascending; the number of modes; axial forces relative to Euler's load; hinges.

    `within` is the largest error that counts as valid; `thin` is the slenderness of the compressed link, `stubby` that
    of the link with shear, `stations` its numbers of hinges, and `spin` the rate of the turning bar [rad/s].
    """

    slenderness: tuple[Positive, ...]
    modes: int
    within: Positive
    push: tuple[float, ...]
    hinges: tuple[int, ...]
    thin: Positive
    stubby: Positive
    stations: tuple[int, int]
    spin: Positive


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the least slenderness at which each mode is valid, and the largest axial force for the first mode."""
    scene, turning = case.load_scenes()
    yield from _with_shear(scene, settings)
    yield _extension(turning, settings)
    errors = np.array([_by_shear(scene, ratio, settings.modes) for ratio in settings.slenderness])
    rows = []
    for k in range(settings.modes):
        name = f"mode {k + 1}"
        least = _crossing(np.log(settings.slenderness)[::-1], np.log(errors[::-1, k]), math.log(settings.within))
        note = f"At L/h = {settings.slenderness[0]:g} the error is {100 * errors[0, k]:.2g} %."
        yield Measured("least slenderness", math.exp(least), scene.name, varied={"measure": name}, note=note)
        rows += [(name, ratio, error) for ratio, error in zip(settings.slenderness, errors[:, k], strict=True)]
    columns = table(("mode", "L / h", "error"), rows)
    axes = "L / h", "length over height [1]", "frequency too high by [1]"
    yield Series("slenderness", case.title, columns, *axes, "log", "log", group="mode", part="shear")
    pushed = []
    for hinges in settings.hinges:
        found = np.array([_under_push(scene, settings.thin, part, hinges) for part in settings.push])
        most = _crossing(np.array(settings.push), found, settings.within)
        yield Measured("largest push", most, scene.name, varied={"hinges": hinges})
        pushed += [(f"{hinges} hinges", part, error) for part, error in zip(settings.push, found, strict=True)]
    columns = table(("hinges", "P / Pₑ", "error"), pushed)
    axes = "P / Pₑ", "push, of Euler's load [1]", "error of mode 1 [1]"
    yield Series("push", case.title, columns, *axes, "linear", "log", group="hinges", part="axial load")


def _beam(scene: Scene, ratio: float) -> tuple[Scene, Beam]:
    """The scene's link with a square section of height length / ratio, and the equivalent Timoshenko beam."""
    (link,), (material,) = scene.arm.links, scene.arm.materials.values()
    h = link.length / ratio
    thick = scene.varied({"section.bar.height": h, "section.bar.width": h})
    shear = SHEAR_FACTOR * material.young / (2 * (1 + material.poisson)) * h**2
    I = h**4 / 12
    return thick, Beam(material.young * I, material.density * h**2, material.density * I, shear, link.length)


def _by_shear(scene: Scene, ratio: float, count: int) -> Array:
    """Relative errors of the first frequencies due to shear."""
    thick, beam = _beam(scene, ratio)
    return np.asarray(modes(lump(thick)).frequencies[:count] / thick_beam.frequencies(beam, count) - 1)


def _with_shear(scene: Scene, settings: Settings) -> Iterator[Measured]:
    """Errors of the frequencies of a thick link with `shear`, and their orders."""
    thick, beam = _beam(scene, settings.stubby)
    exact, errors = thick_beam.frequencies(beam, settings.modes), []
    for count in settings.stations:
        chain = lump(thick.varied({"link.beam.shear": True, "link.beam.segments": count + 1}))
        errors.append(np.abs(modes(chain).frequencies[: settings.modes] / exact - 1))
    refined = math.log(settings.stations[1] / settings.stations[0])
    for k in range(settings.modes):
        facts: Facts = {"measure": f"mode {k + 1}", "hinges": settings.stations[0]}
        yield Measured("frequency error with shear", float(errors[0][k]), scene.name, varied=facts)
        order = math.log(errors[0][k] / errors[1][k]) / refined
        yield Measured("order with shear", order, scene.name, varied={"measure": f"mode {k + 1}"})


def _extension(scene: Scene, settings: Settings) -> Measured:
    """Relative error of the extension of a bar that turns at a constant rate."""
    (link,), (material,) = scene.arm.links, scene.arm.materials.values()
    count, L = settings.stations[0], link.length
    changes = {"stretch": True, "lumping": "gauss", "segments": count + 1}
    chain = lump(scene.varied({f"link.{link.name}.{key}": value for key, value in changes.items()}))
    found = tip_position(chain, equilibrium_in_motion(chain, {link.name: settings.spin}).q)[0] - L
    k = settings.spin * math.sqrt(material.density / material.young)
    exact = math.tan(k * L) / k - L
    note = f"{1e3 * exact:.3g} mm at {settings.spin:g} rad/s."
    return Measured("extension error", abs(found / exact - 1), scene.name, varied={"hinges": count}, note=note)


def _under_push(scene: Scene, ratio: float, part: float, hinges: int) -> float:
    """|error| of a chain's first frequency under the axial force `part` × Euler's load."""
    thin, beam = _beam(scene, ratio)
    push = part * math.pi**2 / 4 * beam.EI / beam.length**2
    chain = lump(thin.varied({"link.beam.segments": hinges + 1}))
    found = modes(chain, tip_wrench=[-push, 0, 0, 0, 0, 0]).frequencies[0]
    exact = thick_beam.frequencies(beam._replace(rotary=0.0, shear=RIGID, push=push), 1)[0]
    return float(abs(found / exact - 1))


def _crossing(x: Array, error: Sequence[float] | Array, bound: float) -> float:
    """Linearly interpolated x at which an error that grows along x passes a bound; nan if it does not."""
    for k in range(1, len(x)):
        low, high = error[k - 1], error[k]
        if low <= bound < high:
            return float(x[k - 1] + (x[k] - x[k - 1]) * (bound - low) / (high - low))
    return math.nan
