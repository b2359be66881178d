"""Links given by tables of rigidity and mass: frequencies against transfer matrices, curvature, strain against M/EI."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.describe.spec import Positive
from validation.case import Case, Measured
from validation.oracles import transfer_beam
from validation.oracles.transfer_beam import Columns
from validation.physics.variant import Rule, Variant


def run(case: Case, modes: int, chains: tuple[Rule, ...], force: Positive, fibre: float) -> Iterator[Measured]:
    """Yield errors of the first frequencies, and of curvature and strain under a small transverse tip force [N].

    `fibre` is the distance of the gauge from the line through the centroids [m].
    """
    for scene in case.load_scenes():
        columns = _columns(scene)
        exact = transfer_beam.frequencies(columns, modes)
        for rule in chains:
            cut = Variant(scene=scene.name).build(case, rule)
            found = fl.modes(fl.lump(cut), count=modes).frequencies
            for k in range(modes):
                note = f"{found[k]:.8g} rad/s, transfer matrix {exact[k]:.8g}."
                error = abs(found[k] / exact[k] - 1)
                yield Measured(f"mode {k + 1}", error, scene.name, varied=rule.facts, note=note)
            rest = fl.solve_static(fl.lump(cut), tip_wrench=[0, force, 0, 0, 0, 0])
            gauges = fl.strength.beam_strain(cut, rest.q, link=1, fibre=(fibre, 0.0))
            κ = np.array(transfer_beam.curvature(columns, force, gauges.x.tolist()))
            of_κ = float(np.abs(gauges.curvature[:, 2] / κ - 1).max())
            yield Measured("curvature", of_κ, scene.name, varied=rule.facts)
            yield Measured(
                "strain", float(np.abs(gauges.strain / (-fibre * κ) - 1).max()), scene.name, varied=rule.facts
            )


def _columns(scene: fl.Scene) -> Columns:
    """x, EI and ρA from the scene's file."""
    (link,), arm = scene.arm.links, scene.arm
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        assert table.ei_z is not None
        return table.x, table.ei_z, table.rho_a
    material, section = arm.materials[str(link.material)], arm.sections[str(link.section)]
    assert section.i_z is not None and section.area is not None
    return (0.0, link.length), 2 * (material.young * section.i_z,), 2 * (material.density * section.area,)
