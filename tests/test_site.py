"""Every public name, key, option, data file and error stands on one reference page, and says what it is."""

from __future__ import annotations

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
from flexlink.describe.plausibility.ranges import ranges
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import LumpingRule
from flexlink.describe.schemes.methods import Method
from flexlink.describe.shaping import ShaperRule
from flexlink.describe.spec import Spec, units_of
from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun, FitStatic
from flexlink.robots.collection import KnownArm
from flexlink.robots.flexible import FlexibleLink
from flexlink.sweeps.plan import Sweep
from flexlink.sweeps.ranges import Range, Spread
from tests.words import refused

KINDS_IN_A_SCENE = [kind for _, kind in keys.records(Scene, "", set()) if kind is not Scene]
KEY_PAGES = {
    "scene.rst": [Scene],
    "sweep.rst": [Sweep, Range, Spread],
    "fit.rst": [FitProblem, FitParameter, FitRun, FitModes, FitStatic],
    "data_files.rst": [LumpingRule, Method, ShaperRule, KnownArm, FlexibleLink],
}
WITHOUT_UNIT = {"FitParameter", "FitRun.noise", "Range", "Spread", "Element", "Jacobi", "RunSettings.max_evaluations"}
"""What varies has the unit of its key; places on an element, exponents and counts have none."""


@pytest.fixture(scope="module")
def texts(tmp_path_factory) -> dict[str, str]:
    """Every generated page."""
    folder = tmp_path_factory.mktemp("generated")
    return {name: page(folder) for name, page in PAGES.items() if name != "study.rst" or stored()}


def stored() -> bool:
    return (Path(__file__).parents[1] / "reports" / "full").is_dir()


def twice_or_never(found: list[str], wanted: list[str]) -> dict[str, int]:
    """What does not stand there exactly once, and how often it does."""
    times = Counter(found)
    return {name: times[name] for name in {*found, *wanted} if times[name] != 1 or name not in wanted}


def records() -> list[type[msgspec.Struct]]:
    known: set[type[msgspec.Struct]] = set()
    return [kind for roots in KEY_PAGES.values() for root in roots for _, kind in keys.records(root, "", known)]


def test_every_public_name_stands_in_one_group() -> None:
    listed = [name for group in api.GROUPS for name in group["names"]]
    assert twice_or_never(listed, fl.__all__) == {}
    assert twice_or_never([*listed, "simulate"], fl.__all__) == {"simulate": 2}
    assert twice_or_never([name for name in listed if name != "modes"], fl.__all__) == {"modes": 0}


def test_every_error_has_a_page(texts: dict[str, str]) -> None:
    listed = re.findall(r"^   flexlink\.(?:errors\.)?(\w+Error)$", texts["api.rst"], re.MULTILINE)
    assert twice_or_never(listed, fl.errors.__all__) == {}


def test_every_key_says_what_it_does() -> None:
    assert len(records()) > 20
    silent = [
        f"{kind.__name__}.{field.name}" for kind in records() for field, told in keys.entries(kind) if len(told) < 8
    ]
    assert silent == []


def test_no_sentence_of_a_key_is_indented() -> None:
    """Which would be a list of definitions, its first line in bold."""
    of_keys = [told for kind in records() for _, told in keys.entries(kind)]
    assert any("\n" in told for told in of_keys)
    assert [told for told in of_keys if "\n " in told] == []


def test_a_key_without_a_sentence_is_noticed() -> None:
    class Silent(Spec, frozen=True):
        told: float = 0.0
        """What it is."""
        untold: float = 0.0

    with refused(KeyError, "test-site"):
        keys.entries(Silent)


def of_numbers(kind: object) -> bool:
    if get_origin(kind) is Annotated or get_args(kind):
        return any(of_numbers(part) for part in get_args(kind))
    return kind is float


def test_every_number_of_a_record_has_a_unit() -> None:
    without = [
        f"{kind.__name__}.{field.name}"
        for kind in records() for field, told in keys.entries(kind)
        if of_numbers(field.type) and not units_in(told) and field.name not in {"axis", "up"}
    ]  # fmt: skip
    assert [key for key in without if not {key, key.partition(".")[0]} & WITHOUT_UNIT] == []


def test_units_of_fields_are_those_of_their_sentences() -> None:
    marked = {}
    for field, told in (pair for kind in (Scene, *KINDS_IN_A_SCENE) for pair in keys.entries(kind)):
        if units_of(field.type):
            marked[field.encode_name, told] = units_in(told)
            assert units_of(field.type) == units_in(told), field.name
        else:  # a pure number, one of several, or one that a sensor's own key says
            said = units_in(told)
            assert len(said) != 1 or re.fullmatch(r"1|.*(;|\bunit\b).*", said[0]), (field.name, told)
    assert len(marked) > 80


def test_every_key_stands_on_its_page_once(texts: dict[str, str]) -> None:
    listed: list[str] = []
    for page, roots in KEY_PAGES.items():
        known: set[type[msgspec.Struct]] = set()
        wanted = sum(len(keys.entries(kind)) for root in roots for _, kind in keys.records(root, "", known))
        shown = "".join(texts[name] for name in (page, *(f"{part}.rst" for part in keys.PARTS if page == "scene.rst")))
        found = re.findall(r"^\.\. confval:: (\S+)$", shown, re.MULTILINE)
        assert len(found) == wanted, page
        listed += found
    assert [key for key, times in Counter(listed).items() if times > 1] == []
    assert {"link.NAME.joint.armature", "run.tolerance", "drive.reference.shaper.kind", "rule.element.nodes"} <= {
        *listed
    }


def test_every_option_stands_once_below_its_command(texts: dict[str, str]) -> None:
    _, *sections = re.split(r"^\.\. program:: (.+)$", texts["command_line.rst"], flags=re.MULTILINE)
    told = dict(zip(sections[::2], sections[1::2], strict=True))
    parser = build_parser()
    every = {"flexlink": parser, **{f"flexlink {name}": each for name, each in command_line.commands(parser).items()}}
    assert list(told) == list(every)
    for name, command in every.items():
        listed = re.findall(r"^\.\. option:: (.+)$", told[name], re.MULTILINE)
        found = [word for line in listed for word in re.findall(r"(?<!\S)--?[\w-]+", line)]
        wanted = {option for action in command._actions for option in action.option_strings} - {"-h", "--help"}
        assert twice_or_never(found, sorted(wanted)) == {}, name


def test_every_data_file_is_a_section_of_its_page(texts: dict[str, str]) -> None:
    for folder, page in (("methods", "methods.rst"), ("lumping", "rules.rst"), ("shapers", "shapers.rst")):
        titles = re.findall(r"^(\S+)\n-{2,}$", texts[page], re.MULTILINE)
        assert twice_or_never(titles, list(data_files.names(folder))) == {}
    listed = re.findall(r"^\s+\* - ``(\w+)``$", texts["plausibility.rst"], re.MULTILINE)
    assert twice_or_never(listed, list(ranges())) == {}


def test_every_text_of_the_source_is_on_a_page_of_messages(texts: dict[str, str]) -> None:
    found = [text for several in messages.texts().values() for text in several]
    assert len(found) > 400
    pages = "".join(text for name, text in texts.items() if name.startswith("messages"))
    assert [text for text in found if prose(text) not in pages] == []
