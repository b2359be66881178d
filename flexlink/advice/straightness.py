"""Measure axial loads and large bends of an arm; without these, rules with one spring per hinge have order 4.

    γ = max |F_x| L² / EI            axial load of a link in a run, due to weight, spin and tip wrench
    θ = |Σ θ_k|                      total bend of the link [rad]

Both reduce the order of these rules to 2, while cells stay at order 4. For the first frequency of a cantilever
with N hinges, the error is 5.2e-4 γ (8/N)² with gauss for γ up to 1, and 3.9e-5 (8/N)⁴ with lobatto. Beyond γ/N² = 100,
runs with cells are less accurate: the last segment, whose inertia is artificial (`Cells.tip`), follows too slowly.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.results.samples import picked
from flexlink.results.trajectory import Trajectory


def may_pay(arm: Arm, run: Trajectory, hinges: int) -> bool:
    """Whether cells may be cheaper than hinges with one spring each, judged by a run with `hinges` such hinges."""
    # Cells may be cheaper if (γ + 2 θ) N² exceeds this value, at which the errors of gauss and lobatto (see above) are
    # about equal. The validation case advice_axial checks this value. Runs of a hanging hose with gauss and lobatto2
    # have equal errors at γ/N² = 120.
    γ, both = load_and_bend(arm, run)
    return γ < 100.0 * hinges**2 and both * hinges**2 > 5.0


def load_and_bend(arm: Arm, run: Trajectory) -> tuple[float, float]:
    """Largest γ, and largest γ + 2 θ, of any link during a run."""
    # loads are evaluated at no more than 40 samples
    chain, few = run.chain, picked(run, np.unique(np.linspace(0, len(run.t) - 1, 40).astype(int)))
    force = np.abs(few.loads.N)
    found = [(0.0, 0.0)]
    for number, link in enumerate(arm.links, 1):
        hinges = [k for k, c in enumerate(chain.coordinates) if c.link == number and c.bends]
        if hinges:
            γ = force[:, [chain.body(k) for k in hinges]].max(axis=1) * link.beam.length**2 / _least_rigidity(arm, link)
            found.append((float(γ.max()), float((γ + 2 * _bend(chain, few.q, hinges)).max())))
    γ, both = map(max, zip(*found, strict=True))
    return γ, both


def _bend(chain: Chain, q: Array, hinges: list[int]) -> Array:
    """θ of bending about y and z, at every sample."""
    axes = np.array([chain.coordinates[k].axis for k in hinges])
    return np.asarray(np.hypot(*(q[:, np.array(hinges)[axes == axis]].sum(axis=1) for axis in (2, 3))))


def _least_rigidity(arm: Arm, link: Link) -> float:
    """The smallest EI of a link [N m²]."""
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        return table.stiffness_factor * min(min(column) for column in (table.ei_y, table.ei_z) if column is not None)
    ends = [arm.sections[name].properties[1:3] for name in (link.section, link.section_tip) if name]
    return arm.materials[link.material or ""].young * min(min(end) for end in ends)
