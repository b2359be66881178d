"""Every public name, key, option, data file and error is on one reference page, with a description."""

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, get_args, get_origin

import msgspec
import pytest

import flexlink as fl
from docs.generators import PAGES, api, command_line, keys, messages
from docs.generators.rest import prose
from docs.generators.sentences import units_in
from flexlink.cli.main import build_parser
from flexlink.describe import data_files
from flexlink.describe.plausibility.sizes import ranges
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import LumpingRule
from flexlink.describe.schemes.methods import Method
from flexlink.describe.shaping import ShaperRule
from flexlink.describe.spec import Spec, units_of
from flexlink.identification import experiments, problem
from flexlink.robots.collection import KnownArm
from flexlink.robots.flexible import FlexibleLink
from flexlink.sweeps.plan import Sweep
from flexlink.sweeps.ranges import Range, Spread
from tests.support.words import refused

KINDS_IN_A_SCENE = [kind for _, kind in keys.records(Scene, "", set()) if kind is not Scene]
KEY_PAGES = {
    "scene.rst": [Scene],
    "sweep.rst": [Sweep, Range, Spread],
    "fit.rst": [
        *(getattr(problem, f"Fit{name}") for name in ("Problem", "Parameter", "Run", "Modes", "Static", "Frf")),
        experiments.Experiments,
        *(getattr(experiments, f"{name}Experiment") for name in ("Column", "Static", "Modes", "Motion", "Prior")),
    ],
    "data_files.rst": [LumpingRule, Method, ShaperRule, KnownArm, FlexibleLink],
}
WITHOUT_UNIT = {
    "FitParameter", "FitRun.noise", "Range", "Spread", "Element", "Jacobi", "RunSettings.max_evaluations",
    "Filter.numerator", "Filter.denominator", "DriveFilter", "ColumnExperiment.noise", "MotionExperiment.add",
    "PriorExperiment.deviation", "Scene.uncertain", "Statistics.quantiles",
}  # fmt: skip
"""Values that vary have the unit of their key; positions on an element, exponents and counts have none."""


@pytest.fixture(scope="module")
def texts(tmp_path_factory) -> dict[str, str]:
    """Every generated page."""
    folder = tmp_path_factory.mktemp("generated")
    return {name: page(folder) for name, page in PAGES.items() if name != "study.rst" or stored()}


def stored() -> bool:
    return (Path(__file__).parents[2] / "reports" / "full").is_dir()


def missing_or_repeated(found: list[str], wanted: list[str]) -> dict[str, int]:
    """Names that do not occur exactly once, with their number of occurrences."""
    times = Counter(found)
    return {name: times[name] for name in {*found, *wanted} if times[name] != 1 or name not in wanted}


def records() -> list[type[msgspec.Struct]]:
    known: set[type[msgspec.Struct]] = set()
    return [kind for roots in KEY_PAGES.values() for root in roots for _, kind in keys.records(root, "", known)]


def test_every_public_name_is_in_one_group() -> None:
    listed = [name for group in api.GROUPS for name in group["names"]]
    assert missing_or_repeated(listed, fl.__all__) == {}
    assert missing_or_repeated([*listed, "simulate"], fl.__all__) == {"simulate": 2}
    assert missing_or_repeated([name for name in listed if name != "modes"], fl.__all__) == {"modes": 0}


def test_every_error_has_a_page(texts: dict[str, str]) -> None:
    listed = re.findall(r"^   flexlink\.(?:errors\.)?(\w+Error)$", texts["api.rst"], re.MULTILINE)
    assert missing_or_repeated(listed, ["FlexlinkError", *fl.errors.__all__]) == {}


def test_every_key_has_a_description() -> None:
    assert len(records()) > 20
    short = [
        f"{kind.__name__}.{field.name}" for kind in records() for field, text in keys.entries(kind) if len(text) < 8
    ]
    assert short == []


def test_no_description_of_a_key_is_indented() -> None:
    """Markdown would render indented lines as a definition list with its first line in bold."""
    of_keys = [text for kind in records() for _, text in keys.entries(kind)]
    assert any("\n" in text for text in of_keys)
    assert [text for text in of_keys if "\n " in text] == []


def test_a_key_without_a_description_is_refused() -> None:
    class Silent(Spec, frozen=True):
        described: float = 0.0
        """What it is."""
        undescribed: float = 0.0

    with refused(KeyError, "test-site"):
        keys.entries(Silent)


def of_numbers(kind: object) -> bool:
    if get_origin(kind) is Annotated or get_args(kind):
        return any(of_numbers(part) for part in get_args(kind))
    return kind is float


def test_every_number_of_a_record_has_a_unit() -> None:
    without = [
        f"{kind.__name__}.{field.name}"
        for kind in records() for field, text in keys.entries(kind)
        if of_numbers(field.type) and not units_in(text) and field.name not in {"axis", "up"}
    ]  # fmt: skip
    assert [key for key in without if not {key, key.partition(".")[0]} & WITHOUT_UNIT] == []


def test_units_of_fields_agree_with_their_descriptions() -> None:
    marked = {}
    for field, text in (pair for kind in (Scene, *KINDS_IN_A_SCENE) for pair in keys.entries(kind)):
        if units_of(field.type):
            marked[field.encode_name, text] = units_in(text)
            assert units_of(field.type) == units_in(text), field.name
        else:  # dimensionless, with one of several units, or in the unit that another key of a sensor gives
            units = units_in(text)
            assert len(units) != 1 or re.fullmatch(r"1|.*(;|\bunit\b).*", units[0]), (field.name, text)
    assert len(marked) > 80


def test_every_key_is_on_its_page_once(texts: dict[str, str]) -> None:
    listed: list[str] = []
    for page, roots in KEY_PAGES.items():
        known: set[type[msgspec.Struct]] = set()
        wanted = sum(len(keys.entries(kind)) for root in roots for _, kind in keys.records(root, "", known))
        shown = "".join(texts[name] for name in (page, *(f"{part}.rst" for part in keys.PARTS if page == "scene.rst")))
        found = re.findall(r"^\.\. confval:: (\S+)$", shown, re.MULTILINE)
        assert len(found) == wanted, page
        listed += found
    assert [key for key, times in Counter(listed).items() if times > 1] == []
    nested = {"link.NAME.joint.armature", "run.tolerance", "drive.reference.shaper.kind", "rule.element.nodes"}
    assert nested <= {*listed}


def test_every_option_is_listed_once_under_its_command(texts: dict[str, str]) -> None:
    _, *sections = re.split(r"^\.\. program:: (.+)$", texts["command_line.rst"], flags=re.MULTILINE)
    below = dict(zip(sections[::2], sections[1::2], strict=True))
    parser = build_parser()
    every = {"flexlink": parser, **{f"flexlink {name}": each for name, each in command_line.commands(parser).items()}}
    assert list(below) == list(every)
    for name, command in every.items():
        listed = re.findall(r"^\.\. option:: (.+)$", below[name], re.MULTILINE)
        found = [word for line in listed for word in re.findall(r"(?<!\S)--?[\w-]+", line)]
        wanted = {option for action in command._actions for option in action.option_strings} - {"-h", "--help"}
        assert missing_or_repeated(found, sorted(wanted)) == {}, name


def test_every_data_file_is_a_section_of_its_page(texts: dict[str, str]) -> None:
    for folder, page in (("methods", "methods.rst"), ("lumping", "rules.rst"), ("shapers", "shapers.rst")):
        titles = re.findall(r"^(\S+)\n-{2,}$", texts[page], re.MULTILINE)
        assert missing_or_repeated(titles, list(data_files.names(folder))) == {}
    listed = re.findall(r"^\s+\* - ``(\w+)``$", texts["plausibility.rst"], re.MULTILINE)
    assert missing_or_repeated(listed, list(ranges())) == {}


def test_every_text_of_the_source_is_on_a_page_of_messages(texts: dict[str, str]) -> None:
    found = [text for several in messages.texts().values() for text in several]
    assert len(found) > 400
    pages = "".join(text for name, text in texts.items() if name.startswith("messages"))
    assert [text for text in found if prose(text) not in pages] == []
