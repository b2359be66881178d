"""Identifiability computed from sensitivities does not depend on rounding or on the basis that the SVD returns."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.identifiability import Check, Direction, checked
from flexlink.identification.problem import Use
from flexlink.identification.remarks import warnings
from tests.conftest import ROOT
from tests.support.fits import CLAMPED, problem
from tests.support.words import reviewed

NAMES = ["a", "b", "c", "d", "e"]


def known(effects: list[float], mix: np.ndarray | None = None) -> np.ndarray:
    """Sensitivities J = Q diag(effects) mix of 40 residuals, where Q has orthonormal columns."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(40, len(effects))))[0]
    return Q @ np.diag(effects) @ (np.eye(len(effects)) if mix is None else mix)


def texts(check: Check) -> list[str]:
    """Reviewed texts about the directions that the data cannot determine."""
    for one in check.directions:
        reviewed("identifiability", str(one.text))
    return [str(one.text) for one in check.directions]


@pytest.mark.parametrize("rest", [0.0, 1e-16, 2.2e-8, 1e-3])
@pytest.mark.parametrize("error", [0.0, 1.5e-9, 1e-6])
def test_sensitivities_at_rounding_level_have_no_effect(rest: float, error: float) -> None:
    """An earlier version reported an effect with ± 9.1e+09 % for sensitivities of 2.2e-8 with errors of 1.5e-9."""
    assert texts(checked(known([50.0, rest]), error, NAMES[:2])) == no_effect()


def no_effect() -> list[str]:
    """The text about the second parameter if it has no effect at all."""
    (text,) = texts(checked(known([50.0, 0.0]), 0.0, NAMES[:2]))
    assert text.startswith("b ") and "%" not in text
    return [text]


@pytest.mark.parametrize("effect", [0.06, 0.5, 0.9])
def test_a_weak_effect_is_reported_with_less_than_10000_percent(effect: float) -> None:
    (text,) = texts(checked(known([50.0, effect]), 1e-9, NAMES[:2]))
    assert text.startswith("b ")
    assert f"± {196 / effect:.2g} %" in text and "95 %" in text
    assert "e+0" not in text.replace("e+02", "").replace("e+03", "")


def test_equally_involved_parameters_are_listed_in_the_order_of_the_problem() -> None:
    """Only the product of a and b matters: rounding used to decide which one was named first."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        column = 50 * rng.normal(size=(40, 1))
        J = np.hstack([column, column, 30 * rng.normal(size=(40, 1))]) * (1 + 1e-12 * rng.normal(size=(40, 3)))
        (one,) = checked(J, 1e-9, NAMES[:3]).directions
        assert one.names == ("a", "b")
        assert one.parts == pytest.approx((np.sqrt(0.5), -np.sqrt(0.5)), abs=1e-9)


def test_unidentifiable_directions_do_not_depend_on_the_svd_basis(rng: np.random.Generator) -> None:
    """Changes of a − b, c − d and e − c have no effect: the SVD may return any basis of the space that they span."""
    mix = np.array([[1.0, 1.0, 0, 0, 0], [0, 0, 1.0, 1.0, 1.0]])
    first = checked(known([60.0, 40.0], mix), 1e-9, NAMES)
    assert [one.names for one in first.directions] == [("a", "b"), ("c", "e"), ("d", "e")]
    for _ in range(20):
        Q = np.linalg.qr(rng.normal(size=(40, 40)))[0]
        other = checked(Q @ known([60.0, 40.0], mix) * (1 + 1e-13 * rng.normal(size=(40, 5))), 1e-9, NAMES)
        assert texts(other) == texts(first)


def test_weakly_identifiable_parameters_of_equal_effect_are_not_mixed(rng: np.random.Generator) -> None:
    """b and c are each known to ± 39 %, and all directions in their plane have the same effect."""
    for _ in range(20):
        Q = np.linalg.qr(rng.normal(size=(40, 40)))[0]
        check = checked(Q @ known([50.0, 5.0, 5.0]) * (1 + 1e-12 * rng.normal(size=(40, 3))), 1e-9, NAMES[:3])
        found = texts(check)
        assert [text.split()[0] for text in found] == ["b", "c"]
        assert all("± 39 %" in text and "95 %" in text for text in found)
        assert check.passed


def column(use: Use, after: float, before: float = 0.0) -> FittedColumn:
    """A column with values up to 1 and the given errors after and before the fit."""
    y, nan = np.sin(np.arange(50.0)), float("nan")
    return FittedColumn(
        source=use, name="tip y [m]", use=use, t=np.arange(50.0), measured=y, before=y + before, after=y + after,
        linear=None, gain=1.0, bias=0.0, noise=after or 1e-16, stated=False, times_noise=1.0, whiteness=nan,
    )  # fmt: skip


def test_rounding_errors_of_exact_data_do_not_affect_the_verdict() -> None:
    def better(*columns: FittedColumn) -> bool:
        verdict_columns = Fitted.verdict_columns.fget(SimpleNamespace(columns=columns))
        return Fitted.better.fget(SimpleNamespace(verdict_columns=verdict_columns))

    def worse(*columns: FittedColumn) -> int:
        return len(warnings((), (), checked(known([50.0]), 0.0, "a"), (), columns, ())) - len(
            warnings((), (), checked(known([50.0]), 0.0, "a"), (), columns[:1], ())
        )

    assert better(column("fit", after=3e-16, before=1e-16))
    assert not better(column("fit", after=3e-6, before=1e-6))
    assert worse(column("fit", after=1e-16), column("check", after=9e-16)) == 0
    assert worse(column("fit", after=1e-6), column("check", after=9e-6)) == 1


THREE = fl.load_scene(ROOT / "models" / "three_links.toml").varied({"run.duration": 1.0, "run.sample": 0.005})
WEIGHTLESS = THREE.varied({"gravity": (0.0, 0.0, 0.0)})
BARE = WEIGHTLESS.varied({"tip.mass": 0.0})
DAMPED = THREE.varied({f"link.{name}.damping": {"ratio": 0.01, "at_hz": 3.0} for name in ("upper", "fore")})
PUSHED = WEIGHTLESS.varied({  # only links have mass, and only the drive acts
    "tip.mass": 0.0, "link.*.joint.armature": 0.0, "material.aluminium.loss_time": 0.0, "initial.passive": "zero",
    "initial.rate_deg": [0.0, 0.0, 0.0], "drive": fl.Drive(kind="constant", torque=(0.0, 50.0, 0.0)),
})  # fmt: skip
STRIP = CLAMPED.varied({"link.l.root_damping": {"z": 0.01}, "tip.inertia": (1e-4,) * 3})
RUBBING = THREE.varied({"link.waist.joint.viscous": 1.0})
E, RHO, η = (f"material.aluminium.{name}" for name in ("young", "density", "loss_time"))
ROOT_SPRING, LENGTH, YOUNG = "link.l.root_stiffness.z", "link.l.length", "material.steel.young"
RATIOS = "link.upper.damping.ratio", "link.fore.damping.ratio"


def tapped(scene: fl.Scene, count: int, ratios: bool = False) -> dict[str, Any]:
    """The lowest frequencies of the arm with locked joints, and their damping ratios."""
    chain = fl.lump(scene)
    rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active.tolist())
    found = fl.modes(chain, rest.q, locked=chain.active.tolist())
    first = np.flatnonzero(np.array(found.kinds) == "elastic")[:count]
    damping_ratios = tuple(found.damping_ratios[first].tolist()) if ratios else ()
    hertz = tuple(found.hertz[first].tolist())
    return {"modes": (fl.fits.FitModes(hertz=hertz, deviation=(0.02,), ratios=damping_ratios, ratio_deviation=1e-4),)}


def sagged(_: fl.Scene) -> dict[str, Any]:
    """The tip deflection of the strip under 0.1 N."""
    pushed = {"wrench.force": (0.0, -0.1, 0.0)}
    return {"static": (fl.fits.FitStatic(axis="y", value=-1e-3, deviation=1e-5, set=pushed),)}


def filmed(scene: fl.Scene) -> dict[str, Any]:
    """The tip path of a run, measured to 1 mm."""
    run, names = fl.simulate(scene), ("tip x [m]", "tip z [m]")
    columns = {"t [s]": run.t} | {name: run.columns[name] for name in names}
    return {"run": (fl.fits.FitRun(name="filmed", columns=columns, noise=dict.fromkeys(names, 1e-3)),)}


PAIRS = [
    ("frequencies know E / ρ only, however many", BARE, (E, RHO), partial(tapped, count=3)),
    ("one frequency, density and payload", WEIGHTLESS, (RHO, "tip.mass"), partial(tapped, count=1)),
    ("two dampings, one ringing", DAMPED, RATIOS, partial(tapped, count=1, ratios=True)),
    ("frequencies know no damping", THREE, (E, η), partial(tapped, count=3)),
    ("three numbers, two frequencies", STRIP, (ROOT_SPRING, LENGTH, YOUNG), partial(tapped, count=2)),
    ("root spring and stiffness, one sag", STRIP, (ROOT_SPRING, YOUNG), sagged),
    ("torque, mass and stiffness together", PUSHED, (E, RHO, "drive.torque.upper"), filmed),
    ("friction of a joint that does not move", RUBBING, ("tip.mass", "link.waist.joint.viscous"), filmed),
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "paths", "data"), [pair[1:] for pair in PAIRS], ids=[pair[0] for pair in PAIRS])
def test_indistinguishable_parameters_are_refused_and_named(scene, paths, data) -> None:
    (lost,) = fl.fits.check_fit(problem(scene, paths, **data(scene))).lost
    assert set(lost.names) <= set(paths)
    single = {η, "link.waist.joint.viscous"} & set(paths)
    assert set(lost.names) == single if single else len(lost.names) > 1


def test_the_first_parameter_of_a_direction_changes_by_ten_percent() -> None:
    text = Direction(("a", "b"), (0.8, -0.4), 2.0, True).text
    assert "+10 %" in text and "-5 %" in text
    reviewed("slips: direction", text)
