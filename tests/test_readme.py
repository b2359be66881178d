"""Every command and every block of Python in the README runs as written."""

from __future__ import annotations

import itertools
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import MissingDependencyError
from flexlink.robots.collection import folder

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, re.DOTALL)
COMMANDS = [
    [line for line in block.replace("\\\n", " ").splitlines() if line.startswith("flexlink")]
    for kind, block in BLOCKS
    if kind == "sh"
]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch) -> Path:
    """A folder with the scenes in it, as the README takes for granted."""
    for name in ("models", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("lines", [lines for lines in COMMANDS if lines], ids=lambda lines: lines[0].split()[1])
def test_commands_of_the_readme_run(lines: list[str], checkout: Path) -> None:
    if lines[0].startswith("flexlink robots"):
        try:
            folder()
        except MissingDependencyError as error:
            pytest.skip(str(error))
    for line in lines:
        words = shlex.split(line, comments=True)
        assert main(words[1:]) == 0, line
        named = [checkout / name for flag, name in itertools.pairwise(words) if flag in {"-o", "--out", "--plot"}]
        assert all(path.exists() for path in named)


def test_the_sweep_of_the_readme_is_the_one_that_runs() -> None:
    (block,) = (block for kind, block in BLOCKS if kind == "toml" and "[drive]" not in block)
    assert block == (ROOT / "models" / "sweeps" / "payload.toml").read_text(encoding="utf-8")


def test_the_reference_of_the_readme_is_a_drive() -> None:
    (block,) = (block for kind, block in BLOCKS if kind == "toml" and "[drive]" in block)
    reference = fl.Drive(**tomllib.loads(block)["drive"]).reference
    assert reference is not None
    assert reference.course((0.0, 0.0, 0.0)).knots[-1] > 1.0


@pytest.mark.slow
def test_python_of_the_readme_runs(checkout: Path) -> None:
    names: dict[str, object] = {}
    for kind, block in BLOCKS:
        if kind == "python":
            exec(block, names)
    assert (checkout / "fall.csv").exists()
    assert (checkout / "boom.png").exists()


def test_the_boom_of_the_readme_gets_the_damping_that_it_asks_for() -> None:
    names: dict[str, object] = {}
    block = next(block for kind, block in BLOCKS if kind == "python" and "at_hz=4.23" in block)
    exec("import flexlink as fl\n" + block[: block.index("fl.simulate(")], names)
    scene = names["scene"]
    assert isinstance(scene, fl.Scene)
    damping = scene.arm.links[0].damping
    assert damping is not None
    first = fl.modes(fl.lump(scene), locked=["boom"])
    assert first.hertz[0] == pytest.approx(damping.at_hz, rel=1e-3)
    assert first.damping_ratios[0] == pytest.approx(damping.ratio, rel=1e-3)


def test_links_of_the_readme_lead_to_files() -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if not link.startswith("http")]
    assert links
    left_out = re.findall(r"^prune (.+)$", (ROOT / "MANIFEST.in").read_text(), re.MULTILINE)  # of a source distribution
    gone = tuple(folder for folder in left_out if not (ROOT / folder).is_dir())
    assert [link for link in links if not (ROOT / link).exists() and not link.startswith(gone)] == []
