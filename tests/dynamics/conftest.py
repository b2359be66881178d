"""Chains on which claims about small motion are tested."""

from pathlib import Path

import pytest

import flexlink as fl
from tests.chain.test_cells import CHAINS
from tests.conftest import MODELS, nasty_scene

PLAIN = {path.stem: path for path in MODELS}


@pytest.fixture(params=[*PLAIN, "nasty", *CHAINS])
def any_chain(request: pytest.FixtureRequest, tmp_path: Path) -> fl.Chain:
    """Chains of all scenes in `models/`, of the arm with every feature, and of arms with coupled springs."""
    if request.param in CHAINS:
        return CHAINS[request.param](tmp_path)
    return fl.lump(fl.load_scene(PLAIN[request.param]) if request.param in PLAIN else nasty_scene())
