"""Every block of code on every page runs as written; the tables of the README are those of the stored study."""

import csv
import fnmatch
import re
import tomllib
from pathlib import Path

import pytest

import flexlink as fl
from docs import snippets
from docs.generators import messages, readme
from flexlink.common.errors import MissingDependencyError
from flexlink.describe.expected import limits
from flexlink.robots.collection import folder
from tests.conftest import ROOT
from tests.support.words import refused

FOLDERS = ("", "start/", "howto/", "explanation/", "development/")
NEWS = {"changes", "history"}
"""Pages about earlier versions."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += [page for folder in FOLDERS for page in sorted(ROOT.glob(f"docs/{folder}*.md")) if page.stem not in NEWS]
PLACEHOLDER = re.compile(r"<!-- (?:folded|output|picture|table|check)")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").as_posix().removeprefix("docs/")


def with_code(path: Path) -> bool:
    return any(True for _ in snippets.blocks(path.read_text(encoding="utf-8")))


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("path", [path for path in PAGES if with_code(path)], ids=name_of)
def test_all_code_blocks_of_a_page_run_in_order(path: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = path.read_text(encoding="utf-8")
    if "import ur5" in text:
        try:
            folder()
        except MissingDependencyError as error:
            pytest.skip(str(error))
    if ("docs.generators" in text or "values(" in text) and not (ROOT / "reports" / "full").is_dir():
        pytest.skip("a source distribution has no stored study")
    work = tmp_path / "work"
    work.mkdir()
    snippets.prepare(work)
    shown = snippets.filled(name_of(path), text, work, tmp_path / "pictures")
    assert not PLACEHOLDER.findall(shown), "all results are inserted"


def test_a_failing_command_on_a_page_is_detected(tmp_path: Path) -> None:
    text = "```sh\nflexlink simulate nowhere.toml\n```\n<!-- output -->\n"
    with refused(snippets.SnippetError, "test-pages"):
        snippets.filled("page", text, tmp_path, tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "```sh\npython -c 'raise SystemExit(1)'\n```\n",
        "The sum is 2.\n<!-- check: states(f'sum is {1 + 2}') -->\n",
        "```python\nx = 2\n```\n<!-- check: assert x == 3 -->\n",
        "```toml\n[run]\nstop = 3\n```\n",
    ],
)
def test_a_wrong_number_or_key_on_a_page_is_detected(text: str, tmp_path: Path) -> None:
    with pytest.raises(snippets.SnippetError):
        snippets.filled("page", text, tmp_path, tmp_path)
    assert "check" not in snippets.unrun(text)


def test_every_block_of_code_is_of_a_kind_that_runs() -> None:
    """Others are shown text, which nothing checks."""
    kinds = {
        kind for path in PAGES for kind in re.findall(r"^ *```(\w+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert kinds <= {"sh", "python", "toml"}


def test_every_command_that_is_not_run_is_on_a_page() -> None:
    lines = [line for path in PAGES for kind, code, _ in snippets.blocks(path.read_text("utf-8")) if kind == "sh"
             for line in code.splitlines()]  # fmt: skip
    for reason, patterns in tomllib.loads(snippets.NOT_RUN.read_text(encoding="utf-8")).items():
        assert [each for each in patterns if not fnmatch.filter(lines, f"{each}*")] == [], reason


def test_code_of_a_page_sees_earlier_code_and_files(tmp_path: Path) -> None:
    file = "```toml\n# file: a.toml\nb = 1\n```\n"
    text = f"```python\nx = 2\n```\n\n{file}\n```python\nprint(x, open('a.toml').read())\n```\n<!-- output -->\n"
    shown = "```text\n2 # file: a.toml\nb = 1"
    assert shown in snippets.filled("page", text, tmp_path, tmp_path)


def test_code_can_be_folded_under_its_output(tmp_path: Path) -> None:
    code = "```python\nprint('| a |')\n```\n\n"
    shown = snippets.filled("page", f"{code}<!-- folded table -->\n{code}<!-- folded -->\n", tmp_path, tmp_path)
    first, second, third = re.split(r":::\{dropdown\} .*\n```python\n", shown)
    assert first == "| a |\n\n"
    assert second == f"{third}\n"
    assert third == "print('| a |')\n```\n:::\n"


def test_a_build_without_code_shows_one_note_instead_of_results() -> None:
    code = "```python\nprint(1)\n```\n"
    shown = snippets.unrun(f"{code}<!-- output -->\n\n{code}\n{code}<!-- folded -->\n")
    assert shown.count(snippets.UNRUN) == 1
    assert shown.count("print(1)") == 3
    assert "<!--" not in shown


def test_the_readme_is_short_and_has_the_numbers_of_the_stored_study() -> None:
    assert len(README.splitlines()) <= 130
    assert len((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split()) <= 1200
    if not (ROOT / "reports" / "full").is_dir():
        pytest.skip("a source distribution has no stored study")
    assert readme.with_tables(README) == README, "python -m docs --readme"


def test_the_readme_has_the_worst_ratio_of_the_study() -> None:
    if not (ROOT / "reports" / "full").is_dir():
        pytest.skip("a source distribution has no stored study")
    for peer in readme.PEERS:
        timed = [row for row in csv_rows("speed.csv") if row["quantity"].startswith(readme.PREPARED.format(peer))]
        assert timed
        assert f"lowest {min(float(row['value']) for row in timed):.2g} " in README


def csv_rows(name: str) -> list[dict[str, str]]:
    with (ROOT / "reports" / "full" / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_paper_has_no_number_that_is_not_of_the_stored_study() -> None:
    paper = readme.PAPER.read_text(encoding="utf-8")
    text = re.sub(r"<!-- (proof|speed):.*?<!-- end of \1 -->", "", paper.partition("\n# Summary")[2], flags=re.DOTALL)
    assert re.findall(r"(?<![\w/-])\d[\d.,]*", text) == []
    if (ROOT / "reports" / "full").is_dir():
        assert readme.with_tables(paper) == paper, "python -m docs --readme"


def test_the_paper_cites_what_its_list_of_references_has() -> None:
    cited = set(re.findall(r"@(\w+)", readme.PAPER.read_text(encoding="utf-8")))
    listed = re.findall(r"^@\w+\{(\w+),", readme.PAPER.with_suffix(".bib").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(cited)


@pytest.mark.parametrize("path", [*PAGES, ROOT / "NOTATION.md"], ids=name_of)
def test_links_lead_to_files(path: Path) -> None:
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if not link.startswith("http")]
    left_out = re.findall(r"^prune (.+)$", (ROOT / "MANIFEST.in").read_text(), re.MULTILINE)  # excluded from the sdist
    built = (ROOT / "docs" / "reference" / "generated", ROOT / "docs" / "gallery")  # checked when the site is built
    gone = tuple(ROOT / each for each in left_out if not (ROOT / each).is_dir())
    places = [(path.parent / link).resolve() for link in links if link]
    assert [place for place in places if not place.exists() and not place.is_relative_to(built[0])
            and not any(place.is_relative_to(each) for each in (*built, *gone))] == []  # fmt: skip


def test_pages_state_what_is_not_supported_in_the_words_of_the_refusals() -> None:
    refusals = " ".join(text for several in messages.texts().values() for text in several)
    said = {text.casefold() for text in re.findall(r"(?<=; )[\w ]+ are not (?:supported|modelled)", refusals)}
    assert said == {limits()["loops"]["what"].casefold()}
    for path in PAGES:
        prose = re.sub(
            r"^```.*?^```|^#.*?$|<!--.*?-->", ". ", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        sentences = re.split(r"[.:;|] ", " ".join(prose.split()).casefold())
        said |= {one[0] for text in sentences if (one := re.match(r".*\bnot (?:supported|modelled)\b", text))}
    assert len(said) > 7
    assert said <= {row["what"].casefold() for row in limits().values()}


@pytest.mark.parametrize("name", limits())
def test_a_scene_that_asks_for_what_is_not_supported_is_refused_in_the_words_of_the_pages(name: str, tmp_path) -> None:
    (crane,) = (code for kind, code, _ in snippets.blocks(README) if kind == "toml")
    asked = [f"{key} = 1\n{crane}" for key in limits()[name].get("keys", ())]
    asked += [f"{crane}joint.kind = {value!r}\n" for value in limits()[name].get("values", ())]
    for text in asked:
        (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
        with pytest.raises(fl.errors.SceneError) as caught:
            fl.load_scene(tmp_path / "arm.toml")
        assert limits()[name]["text"] in str(caught.value)
    assert asked
