"""The distribution: every requirement has a testable lowest version, and no file is missing."""

import re
import runpy
import shutil
import subprocess
import tomllib

import pytest

from tests.books.lowest import PROJECT, lowest, requirements
from tests.conftest import ROOT
from tests.support.words import refused

TEXT = PROJECT.read_text(encoding="utf-8")


def test_every_requirement_has_a_lowest_version() -> None:
    constraints = [lowest(requirement) for requirement in requirements(TEXT)]
    names = [line.partition("==")[0] for line in constraints]
    assert {"numpy", "numba", "pin", "mujoco", "pytest"} < set(names)
    assert len(set(names)) == len(names)


def test_the_lowest_version_is_the_one_in_the_requirement() -> None:
    assert lowest("numba>=0.68,<0.70") == "numba==0.68"
    assert lowest("pytest-xdist>=3.6.1") == "pytest-xdist==3.6.1"
    for open_ended in ("numpy", "numpy<3", "numpy~=2.0", "numpy>2"):
        with refused(ValueError, "test-packaging"):
            lowest(open_ended)


def test_both_commands_of_the_readme_install_the_robot_files() -> None:
    extras = tomllib.loads(TEXT)["project"]["optional-dependencies"]
    assert "robots" in extras["validation"][0]
    assert "validation" in extras["test"][0]


def test_extras_that_name_each_other_and_linters_are_not_requirements() -> None:
    found = requirements(TEXT)
    assert not [one for one in found if one.startswith(("flexlink", "ruff", "mypy"))]


@pytest.mark.skipif(not (shutil.which("git") and (ROOT / ".git").exists()), reason="needs git and a checkout")
def test_the_manifest_includes_every_folder_of_the_checkout() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    manifest = (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines()
    grafted = {line.split()[1] for line in manifest if line.startswith("graft ")}
    included = {name for line in manifest if line.startswith("include ") for name in line.split()[1:]}
    by_itself = {
        "flexlink",
        "flexlink_witnesses",
        "LICENSE",
        "README.md",
        "pyproject.toml",
        "MANIFEST.in",
    }  # setuptools takes these
    assert {name.partition("/")[0] for name in listed.splitlines()} - grafted - included - by_itself == set()


def test_the_description_has_no_link_that_only_the_repository_has() -> None:
    standalone = runpy.run_path(str(ROOT / "build_tools" / "description.py"))["standalone"]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"\]\((?!https?:)|<!--|\n\n\n", standalone(readme)) == []
    plain = re.sub(r"!\[[^\]]*\]\([^)]*\)|\]\([^)]*\)|<!--.*?-->", "", readme, flags=re.DOTALL)
    assert re.findall(r"\w+", standalone(readme)) == re.findall(r"\w+", plain)
    linked = standalone("![a](b.svg)\n[*c*](docs/d.md#e), [f](#f), [g](https://g.example)", "https://h.example/tree/")
    targets = ["https://h.example/tree/docs/d.md#e", "https://g.example"]
    assert re.findall(r"\((.*?)\)", linked) == targets


def test_the_page_on_installation_has_the_size_of_every_extra() -> None:
    page = (ROOT / "docs" / "start" / "install.md").read_text(encoding="utf-8")
    measured = page.partition("<!-- extras")[2].partition("<!-- end of extras")[0]
    sizes = dict(re.findall(r"`(\w+)`\s(\d+|less)", measured))
    extras = tomllib.loads(TEXT)["project"]["optional-dependencies"]
    assert list(sizes) == list(extras)
    assert int(sizes["validation"]) > int(sizes["engines"]) + int(sizes["robots"])


def test_every_file_states_the_same_version() -> None:
    release = runpy.run_path(str(ROOT / "build_tools" / "release.py"))
    assert set(release["versions"]().values()) == {tomllib.loads(TEXT)["project"]["version"]}


def test_the_recipe_for_conda_has_the_requirements_of_the_package() -> None:
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    project = tomllib.loads(TEXT)["project"]
    spaced = [re.sub(r"(?=[<>])", " ", one, count=1) for one in project["dependencies"]]
    built = [re.sub(r"(?=[<>])", " ", one, count=1) for one in tomllib.loads(TEXT)["build-system"]["requires"]]
    for part, wanted in (("host", built), ("run", spaced)):
        listed = re.findall(r"^    - (.+)", recipe.partition(f"\n  {part}:\n")[2].partition(":\n")[0], re.MULTILINE)
        assert set(wanted) <= set(listed), part
