"""Fit to a measurement with SciPy
===============================

A straight strip is released, and its tip is filmed. Which Young's modulus, payload and damping fit the film?
``fl.sensitivities`` computes a run and its derivatives with respect to them, the Jacobian for SciPy's least squares.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import flexlink as fl

strip = fl.Link(
    name="strip",
    length=0.8,
    material="steel",
    section="flat",
    flex="z",
    segments=5,
    joint=fl.Joint(locked=True),
    damping=fl.Damping(ratio=0.02, at_hz=2.0),
)
arm = fl.Arm(
    links=(strip,),
    materials={"steel": fl.Material(young=150e9, density=7850.0)},  # initial guess
    sections={"flat": fl.Section(shape="rectangle", height=0.004, width=0.03)},
    tip=fl.RigidBody(mass=0.2),
)
guess = fl.Scene(
    name="let_go",
    arm=arm,
    gravity=(0.0, -9.81, 0.0),
    run=fl.RunSettings(method="RK4", step=1e-4, duration=1.5, sample=0.01),
)
numbers = {  # path: unit
    "material.steel.young": 1e9,
    "tip.mass": 1e-3,
    "link.strip.damping.ratio": 1e-3,
}

# %%
# The measurement, here simulated with the true parameters, which the fit does not use, and 0.5 mm of noise.
truth = {
    "material.steel.young": 206e9,
    "tip.mass": 0.31,
    "link.strip.damping.ratio": 0.008,
}
NOISE = 5e-4  # m
measured = fl.simulate(guess.varied(truth)).tip[:, 1]
measured = measured + NOISE * np.random.default_rng(1).standard_normal(len(measured))
units = np.array(list(numbers.values()))


def found_with(x: np.ndarray) -> fl.Scene:
    """Return the scene with these parameters, scaled by their units."""
    return guess.varied(dict(zip(numbers, (x * units).tolist(), strict=True)))


def residual(x: np.ndarray) -> np.ndarray:
    """Residuals in standard deviations of the noise."""
    return (fl.simulate(found_with(x)).tip[:, 1] - measured) / NOISE


def jacobian(x: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals with respect to the parameters."""
    return fl.sensitivities(found_with(x), list(numbers)).tip[:, 1] * units / NOISE


# %%
# The fit takes few iterations; standard deviations follow from the same Jacobian.
start = np.array([guess.values_at(path)[0] for path in numbers]) / units
fit = least_squares(residual, start, jacobian, x_scale=start)
spread = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
for path, value, deviation, unit in zip(numbers, fit.x, spread, units, strict=True):
    print(f"{path:25} {value * unit:.4g} ± {deviation * unit:.1g}, true value {truth[path]:.4g}")
print(f"{fit.njev} Jacobians, {fit.nfev} runs")

# %%
fig, panel = plt.subplots(figsize=(5, 3.4), layout="constrained")
before, after = fl.simulate(guess), fl.simulate(found_with(fit.x))
panel.plot(after.t, 1e3 * measured, ".", color="0.5", markersize=3, label="measured")
panel.plot(after.t, 1e3 * before.tip[:, 1], "--", linewidth=1, label="initial guess")
panel.plot(after.t, 1e3 * after.tip[:, 1], linewidth=1, label="fitted")
panel.set(xlabel="time [s]", ylabel="tip, height [mm]")
panel.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)
panel.grid(alpha=0.3)
