"""Every file reads back to the chain it was written from, bit for bit; a file with any other content is refused."""

import contextlib
import dataclasses
from collections.abc import Iterator
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.safe_xml import parse
from flexlink.formats import FORMATS
from tests.conftest import flexible, make_scene, nasty_scene
from tests.support.words import refused

READ = {name: format for name, format in FORMATS.items() if format.read is not None}
EVERY = pytest.mark.parametrize("format", READ.values(), ids=READ)


def odd_chain(rng: np.random.Generator) -> fl.Chain:
    """The nasty scene with every number of every hinge set, some limits, an elastic gear, and full inertias."""
    chain = fl.lump(
        nasty_scene().varied({"link.upper.joint.gear_stiffness": 100.0, "link.upper.joint.limits_deg": (-90.0, 70.0)})
    )
    hinges, bodies = chain.hinges.copy(), chain.bodies.copy()
    for field in ("stiffness", "rest", "damping", "coulomb", "coulomb_width", "armature"):
        hinges[field] = rng.uniform(0.1, 1.0, chain.n)
    B = rng.normal(size=(len(bodies), 3, 3))
    S = 0.1 * B @ B.transpose(0, 2, 1)  # ∫ x xᵀ dm of a possible body
    full = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S
    heavy = bodies["mass"] > 0
    bodies["inertia"][heavy] = (full + full.transpose(0, 2, 1))[heavy] / 2  # exactly symmetric
    return dataclasses.replace(chain, hinges=hinges, bodies=bodies)


def values_of(chain: fl.Chain) -> list[object]:
    """All values of a chain, for comparison."""
    arrays = [(array[field].tolist(), field) for array in (chain.bodies, chain.hinges) for field in array.dtype.names]
    return [chain.name, chain.link_names, chain.coordinates, chain.gravity.tolist(), *arrays]


def assert_same(one: fl.Chain, other: fl.Chain) -> None:
    for first, second in zip(values_of(one), values_of(other), strict=True):
        assert first == second


def same(one: fl.Chain, other: fl.Chain) -> bool:
    return values_of(one) == values_of(other)


@EVERY
def test_every_file_reads_back_to_the_same_chain(format, chain: fl.Chain) -> None:
    assert_same(format.read(format.write(chain)), chain)
    assert_same(format.read(format.write(chain, shapes=False).encode()), chain)


@EVERY
def test_every_number_reads_back_to_the_bit(format, rng: np.random.Generator) -> None:
    chain = odd_chain(rng)
    assert_same(format.read(format.write(chain)), chain)


@EVERY
@pytest.mark.parametrize("limits", [(-1e300, 1e300), (-360.0, 1e11), (-1e11, 360.0)])
def test_limits_wider_than_the_placeholder_for_no_limit_are_kept(format, limits: tuple[float, float]) -> None:
    chain = fl.lump(nasty_scene().varied({"link.upper.joint.limits_deg": limits}))
    assert_same(format.read(format.write(chain)), chain)


@EVERY
@pytest.mark.parametrize(("end", "limit"), [("lower", -0.5), ("upper", 0.5)])
def test_a_limit_at_one_end_is_kept(format, end: str, limit: float) -> None:
    chain = small_chain()
    hinges = chain.hinges.copy()
    hinges[end][0] = limit
    changed = dataclasses.replace(chain, hinges=hinges)
    assert_same(format.read(format.write(changed)), changed)


def small_chain() -> fl.Chain:
    """A chain with one of everything: a massless waist, a rotated mount, two axes at a point, a rotor, friction."""
    arm = flexible(
        "arm", "yz", 2, mount=fl.Mount(rpy_deg=(20.0, 30.0, 40.0)), joint=fl.Joint(armature=0.1, coulomb=0.2)
    )
    return fl.lump(make_scene(fl.Link(name="waist", length=0.5), arm, tip=fl.RigidBody(mass=0.3, inertia=(1, 2, 2.5))))


def places(root: ET.Element) -> Iterator[tuple[ET.Element, str | None]]:
    """Every attribute, and every text (key None), of a file."""
    for element in root.iter():
        yield from ((element, key) for key in element.attrib)
        if (element.text or "").strip():
            yield element, None


def value(element: ET.Element, key: str | None) -> str:
    return (element.text or "") if key is None else element.attrib[key]


@contextlib.contextmanager
def replaced(element: ET.Element, key: str | None, text: str) -> Iterator[None]:
    """Replace the text in one place for the block."""
    old = value(element, key)
    for words in (text, old):
        if key is None:
            element.text = words
        else:
            element.set(key, words)
        if words is text:
            yield


def document(format) -> ET.Element:
    return parse(format.write(small_chain(), shapes=False), "arm")


def text_of(root: ET.Element) -> str:
    for number, uri in enumerate(("http://drake.mit.edu", "urn:flexlink")):
        ET.register_namespace(("drake", "flexlink")[number], uri)
    return ET.tostring(root, encoding="unicode")


@pytest.mark.slow
@EVERY
def test_a_number_that_is_changed_is_in_the_chain_or_refused(format) -> None:
    """A reader must not ignore any changed number."""
    root, original = document(format), small_chain()
    passed_over, changed = set(), 0
    for element, key in places(root):
        words = value(element, key).split()
        for k, word in enumerate(words):
            with contextlib.suppress(ValueError):
                words[k] = repr(float(word) * 1.01 + 0.01)
                with replaced(element, key, " ".join(words)):
                    try:
                        chain = format.read(text_of(root))
                    except fl.errors.DataFileError as error:
                        assert "\n" not in str(error)
                        continue
                    finally:
                        words[k] = word
                changed += 1
                if same(chain, original):
                    passed_over.add(f"{element.tag}.{key}")
    assert changed > 20  # masses, centres, moments, springs, …
    assert not passed_over


@EVERY
@pytest.mark.parametrize("wrong", ["nan", "1,5", "${mass}", "", "1e999", "0 0", "1_0", "٣"])
def test_text_in_place_of_a_number_is_refused_in_one_line(format, wrong: str) -> None:
    root = document(format)
    for element, key in places(root):
        try:
            float(value(element, key).split()[0])
        except (ValueError, IndexError):
            continue
        with replaced(element, key, wrong), refused(fl.errors.DataFileError, "file-content"):
            format.read(text_of(root), what="arm.xml")


@EVERY
def test_a_changed_name_or_word_is_refused_except_the_name_of_the_robot(format) -> None:
    root, own = document(format), set()
    for element, key in places(root):
        try:
            float(value(element, key).split()[0])
        except ValueError:
            with replaced(element, key, "other"), contextlib.suppress(fl.errors.DataFileError):
                format.read(text_of(root))
                own.add(f"{element.tag}.{key}")
    assert own <= {"robot.name"}


@pytest.mark.slow
@EVERY
def test_an_element_that_is_left_out_or_doubled_or_unknown_is_refused(format) -> None:
    """Exception: a hinge or a mass that is left out gives another valid arm."""
    root = document(format)
    for parent in list(root.iter()):
        for k, child in enumerate(list(parent)):
            for others in ([], [child, child], [child, ET.Element("unknown")]):
                parent[k : k + 1] = others
                try:
                    assert not same(format.read(text_of(root)), small_chain())
                    assert others == [] and child.tag in {"joint", "inertial"}
                except fl.errors.DataFileError as error:
                    assert "\n" not in str(error)
                parent[k : k + len(others)] = [child]
    assert same(format.read(text_of(root)), small_chain())


@EVERY
def test_an_attribute_that_flexlink_does_not_write_is_refused(format) -> None:
    root = document(format)
    for element in root.iter():
        element.set("other", "1")
        with refused(fl.errors.DataFileError, "file-content"):
            format.read(text_of(root))
        del element.attrib["other"]


@EVERY
@pytest.mark.parametrize("change", [lambda all: all.update(other="1"), dict.popitem], ids=["more", "less"])
def test_an_attribute_too_many_or_too_few_in_the_last_element_is_refused(format, change) -> None:
    root = document(format)
    change([element for element in root.iter() if element.attrib][-1].attrib)
    with pytest.raises(fl.errors.DataFileError) as caught:
        format.read(text_of(root))
    assert caught.value.id == "file-content"


@EVERY
def test_a_rotation_that_is_stretched_or_mirrored_is_refused(format) -> None:
    """Only the matrix is changed; roll, pitch and yaw keep the correct values."""
    root = document(format)
    found = 0
    for element, key in list(places(root)):
        words = value(element, key).split()
        for first in range(len(words) - 8) if str(key).endswith(("rotation", "data")) else ():
            for factor in (1.0 + 1e-12, -1.0) if len(words) - first == 9 else ():
                R = [factor * float(word) for word in words[first:]]
                text = " ".join([*words[:first], *map(repr, R)])
                with replaced(element, key, text), pytest.raises(fl.errors.DataFileError) as caught:
                    format.read(text_of(root))
                assert caught.value.id == "file-content" and str(R) in str(caught.value)
                found += 1
    assert found >= 2


@EVERY
def test_edited_visual_shapes_are_accepted(format) -> None:
    root = parse(format.write(small_chain()), "arm")
    for element in list(root.iter()):
        for shape in [one for one in element if one.tag in {"visual", "geom"}]:
            element.remove(shape)
    assert same(format.read(text_of(root)), small_chain())


@EVERY
@pytest.mark.parametrize("text", ["<robot", "<other/>", "<robot name='a'/>", "<mujoco/>", "<sdf/>", "", "<a>" * 500])
def test_other_files_are_refused_in_one_line(format, text: str) -> None:
    with pytest.raises(fl.errors.DataFileError, match=r"^arm\.xml: [^\n]+$"):
        format.read(text, what="arm.xml")


@EVERY
@pytest.mark.parametrize(("field", "value"), [("damping", -1.0), ("coulomb", -1.0), ("coulomb_width", 0.0)])
def test_a_negative_damper_or_friction_and_friction_of_no_width_are_refused(format, field: str, value: float) -> None:
    chain = small_chain()
    hinges = chain.hinges.copy()
    hinges[field][1] = value
    with refused(fl.errors.DataFileError, "file-content"):
        format.read(format.write(dataclasses.replace(chain, hinges=hinges)))


@EVERY
def test_names_read_back_unchanged_except_characters_invalid_in_xml(format) -> None:
    for name, back in {"a\x00b": "a\ufffdb", "a::b": "a::b", "world": "world", 'ä "<&> 関': 'ä "<&> 関'}.items():
        chain = dataclasses.replace(fl.lump(make_scene(flexible(name, segments=2))), name=name)
        read = format.read(format.write(chain))
        assert (read.name, read.link_names) == (back, (back,))
