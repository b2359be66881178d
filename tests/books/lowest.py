"""Print the lowest versions that pyproject.toml allows, as constraints for pip, to run the tests with them.

python -m tests.books.lowest > lowest.txt
python -m pip install -c lowest.txt -e '.[test]' && python -m pytest        # in a separate environment
"""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
OWN = "flexlink["  # begins a requirement that refers to another extra of flexlink
TOOLS = "dev"  # extra that checks the sources, independently of other versions


def requirements(text: str) -> list[str]:
    """All third-party requirements of a pyproject.toml, to run and to test."""
    project = tomllib.loads(text)["project"]
    extras = [named for extra, named in project["optional-dependencies"].items() if extra != TOOLS]
    return [one for named in (project["dependencies"], *extras) for one in named if not one.startswith(OWN)]


def lowest(requirement: str) -> str:
    """Convert `name>=1.2,<3` to `name==1.2`.

    Raises
    ------
    ValueError
        The requirement has no lowest version.
    """
    found = re.fullmatch(r"([\w.-]+)>=([\w.]+)(,<[\w.]+)?", requirement)
    if not found:
        raise ValueError(f"{requirement!r}: no lowest version; write name>=version")
    return f"{found[1]}=={found[2]}"


if __name__ == "__main__":
    print(*map(lowest, requirements(PROJECT.read_text(encoding="utf-8"))), sep="\n")
