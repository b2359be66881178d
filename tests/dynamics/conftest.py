"""Chains on which claims about small motion are tested."""

from pathlib import Path

import pytest

import flexlink as fl
from tests.chain.test_cells import CHAINS
from tests.conftest import MODELS, flexible, make_scene, nasty_scene

PLAIN = {path.stem: path for path in MODELS}


TURNED = make_scene(
    flexible("a", "xyz", 5, lumping="lobatto2_rotation"), flexible("b", "xyz", lumping="gauss_rotation"),
    gravity=(1.0, -9.0, 2.0),
)  # fmt: skip


@pytest.fixture(params=[*PLAIN, "nasty", "rotation", *CHAINS])
def any_chain(request: pytest.FixtureRequest, tmp_path: Path) -> fl.Chain:
    """Chains of all scenes in `models/`, of the arm with every feature, of arms with rotation or coupled springs."""
    if request.param in CHAINS:
        return CHAINS[request.param](tmp_path)
    made = {"nasty": nasty_scene(), "rotation": TURNED}
    return fl.lump(fl.load_scene(PLAIN[request.param]) if request.param in PLAIN else made[request.param])
