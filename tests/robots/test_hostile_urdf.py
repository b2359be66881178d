"""Wrong or malicious URDF files: each is refused in one line, and no other file is opened."""

import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexlink.cli.main import main
from tests.support.urdf_texts import saved
from tests.support.words import refused_line

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
BODY = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
JOINT = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
GOOD = f'<robot name="r"><link name="a"/><link name="b">{BODY}</link>{JOINT}</robot>'


def edited(*pairs: str) -> str:
    """The good file, in which the first text of each pair is replaced by the second."""
    text = GOOD
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    return text


def joint(name: str, parent: str, child: str, more: str = "", kind: str = "continuous") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'


def robot(links: str, *joints: str) -> str:
    return f'<robot name="r">{"".join(f"""<link name="{x}">{BODY}</link>""" for x in links)}{"".join(joints)}</robot>'


def rope(count: int) -> str:
    links = "".join(f'<link name="l{k}">{BODY}</link>' for k in range(count))
    return f'<robot name="r">{links}{"".join(joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(count - 1))}</robot>'


LAUGHS = "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(9))
MIMIC = '<mimic joint="{}"/>'
HOSTILE: dict[str, tuple[str | bytes, str, str]] = {
    # files without a robot
    "empty": ("", "not-xml", ""),
    "blank": (" \n", "not-xml", ""),
    "no XML": ("name = 'arm'", "not-xml", ""),
    "cut off": (GOOD[:-5], "not-xml", ""),
    "latin-1 bytes": (GOOD.replace('"r"', '"ä"').encode("latin-1"), "not-xml", ""),
    "null": (GOOD.replace('"r"', '"\0"'), "not-xml", ""),
    "an image": (b"\x89PNG\r\n\x1a\n" + bytes(100), "not-xml", ""),
    "no model": ("<sdf version='1.10'/>", "element-twice", "<sdf>"),
    "our own export": (edited("</joint>", '<flexlink stiffness="9"/></joint>'), "exported-by-flexlink", "<flexlink>"),
    "no link": ("<robot name='r'/>", "no-link", ""),
    "no joint": ("<robot name='r'><link name='a'/></robot>", "no-movable-joint", "'a'"),
    # XML entities, file size, nesting depth
    "billion laughs": (f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHS}]><robot name="&l9;"/>', "xml-entities", "<!DOCTYPE r>"),
    "quadratic": (
        f'<!DOCTYPE r [<!ENTITY x "{"x" * 100_000}">]><robot>{"&x;" * 100_000}</robot>', "xml-entities", "<!DOCTYPE r>"
    ),
    "external entity": (
        '<!DOCTYPE r [<!ENTITY x SYSTEM "secret.txt">]><robot name="&x;"/>', "xml-entities", "<!DOCTYPE r>"
    ),
    "external type": ('<!DOCTYPE r SYSTEM "secret.txt"><robot/>', "xml-entities", "<!DOCTYPE r>"),
    "parameter entity": (
        '<!DOCTYPE r [<!ENTITY % x SYSTEM "secret.txt"> %x;]><robot/>', "xml-entities", "<!DOCTYPE r>"
    ),
    "entity in UTF-16": (
        '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE r [<!ENTITY x "y">]><robot/>'.encode("utf-16"),
        "xml-entities", "<!DOCTYPE r>",
    ),
    "deep": ("<robot>" + "<a>" * 100_000, "xml-too-deep", "1000"),
    "many elements": ("<robot>" + "<a/>" * 500_000 + "</robot>", "file-too-large", "200000"),
    "huge": ("<robot>" + " " * 6_000_000 + "</robot>", "file-too-large", "5000000"),
    "10,000 links": (rope(10_000), "file-too-large", "10000"),
    # xacro
    "xacro property": (edited('value="1"', 'value="${m}"'), "number-in-file", "link 'b': <mass value> = '${m}'"),
    "xacro macro": (
        edited('<robot name="r">', '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/>'),
        "xacro", "<xacro:arm>",
    ),
    "xacro prefix": (edited('<robot name="r">', '<robot name="r"><xacro:arm/>'), "xacro", "<xacro:arm>"),
    # numbers
    "NaN": (edited('value="1"', 'value="nan"'), "number-in-file", "link 'b': <mass value> = 'nan'"),
    "infinite": (edited('ixx="1"', 'ixx="inf"'), "number-in-file", "<inertia ixx> = 'inf'"),
    "too large": (edited('value="1"', 'value="1e999"'), "number-in-file", "<mass value> = '1e999'"),
    "comma": (edited('value="1"', 'value="1,5"'), "number-in-file", "<mass value> = '1,5'"),
    "underscore": (edited('value="1"', 'value="1_5"'), "number-in-file", "<mass value> = '1_5'"),
    "hexadecimal": (edited('value="1"', 'value="0x1p3"'), "number-in-file", "<mass value> = '0x1p3'"),
    "other digits": (edited('value="1"', 'value="١"'), "number-in-file", "<mass value> = '١'"),
    "empty number": (edited('value="1"', 'value=""'), "number-in-file", "<mass value> = ''"),
    "two numbers": (edited("<inertial>", '<inertial><origin xyz="1 2"/>'), "number-in-file", "<origin xyz> = '1 2'"),
    "four numbers": (
        edited("<inertial>", '<inertial><origin rpy="1 2 3 4"/>'), "number-in-file", "<origin rpy> = '1 2 3 4'"
    ),
    "long word": (edited('value="1"', f'value="{"9" * 9_000}x"'), "number-in-file", "<mass value> = "),
    "long type": (edited("continuous", "x" * 1_000_000), "file-too-large", "10000"),
    "long number": (edited('value="1"', f'value="{"9" * 9_000}"'), "number-in-file", "<mass value>"),
    "far away": (edited("<inertial>", '<inertial><origin xyz="1e200 0 0"/>'), "number-in-file", "1e+09"),
    # bodies
    "negative mass": (edited('value="1"', 'value="-1"'), "number-in-file", "<mass value> = -1.0"),
    "negative moment": (edited('ixx="1"', 'ixx="-1"'), "inertia-impossible", "(-1.0, 1.0, 1.0)"),
    "no mass": (edited('<mass value="1"/>', ""), "missing-in-file", "link 'b': <mass>"),
    "no value": (edited('value="1"', ""), "missing-in-file", "<mass value>"),
    "no inertia": (edited(INERTIA, ""), "missing-in-file", "<inertia>"),
    "no product": (edited('ixy="0"', ""), "missing-in-file", "<inertia ixy>"),
    "two inertials": (edited(BODY, BODY * 2), "element-twice", "<inertial>"),
    "nothing moves": (edited(BODY, ""), "no-mass", "<inertial>"),
    # names and the tree
    "link without name": (edited('<link name="a"/>', "<link/>"), "missing-in-file", "link 1"),
    "joint without name": (edited('name="j"', ""), "missing-in-file", "joint 1"),
    "two links of one name": (robot("abb", joint("j", "a", "b")), "name-twice", "link 'b'"),
    "two joints of one name": (robot("abc", joint("j", "a", "b"), joint("j", "b", "c")), "name-twice", "'j'"),
    "missing link": (edited('<parent link="a"/>', '<parent link="z"/>'), "link-missing-in-file", "link> = 'z'"),
    "no parent": (edited('<parent link="a"/>', ""), "missing-in-file", "<parent>"),
    "no child": (edited('<child link="b"/>', ""), "missing-in-file", "<child>"),
    "child of no name": (edited('<child link="b"/>', "<child/>"), "missing-in-file", "<child link>"),
    "two parents": (robot("abc", joint("j", "a", "c"), joint("k", "b", "c")), "closed-loop", "'c'"),
    "two parents in a joint": (edited('<parent link="a"/>', '<parent link="a"/>' * 2), "element-twice", "<parent>"),
    "loop": (robot("ab", joint("j", "a", "b"), joint("k", "b", "a")), "closed-loop", "links a, b form"),
    "loop beside a tree": (
        robot("abcd", joint("j", "a", "b"), joint("k", "c", "d"), joint("l", "d", "c")),
        "closed-loop", "c, d",
    ),
    "link on itself": (robot("a", joint("j", "a", "a")), "closed-loop", "link a forms"),
    "two roots": (robot("abc", joint("j", "a", "b")), "several-roots", "a, c"),
    # joints
    "no type": (edited('type="continuous"', ""), "missing-in-file", "<joint type>"),
    "screw": (edited("continuous", "screw"), "joint-type-in-file", "'screw'"),
    "capital": (edited("continuous", "Continuous"), "joint-type-in-file", "'continuous'"),
    "floating": (edited("continuous", "floating"), "joint-type-in-file", "joint 'j'"),
    "planar": (edited("continuous", "planar"), "joint-type-in-file", "joint 'j'"),
    "zero axis": (edited("</joint>", '<axis xyz="0 0 0"/></joint>'), "zero-direction", "<axis xyz> = (0.0, 0.0, 0.0)"),
    "endless limit": (
        edited("continuous", "revolute", "</joint>", '<limit lower="-inf" upper="1"/></joint>'),
        "number-in-file", "<limit lower> = '-inf'",
    ),
    "negative damping": (
        edited("</joint>", '<dynamics damping="-1"/></joint>'), "number-in-file", "<dynamics damping> = -1.0"
    ),
    "negative friction": (
        edited("</joint>", '<dynamics friction="-1"/></joint>'), "number-in-file", "<dynamics friction> = -1.0"
    ),
    "follows nothing": (edited("</joint>", MIMIC.format("z") + "</joint>"), "mimic", "'z'"),
    "follows itself": (edited("</joint>", MIMIC.format("j") + "</joint>"), "mimic", "joint 'j'"),
    "follow each other": (
        robot("abc", joint("j", "a", "b", MIMIC.format("k")), joint("k", "b", "c", MIMIC.format("j"))),
        "mimic", "j, k",
    ),
}  # fmt: skip
"""Content of a file, the id of its error, and a part of the message: names and values."""


@pytest.fixture
def opened(capsys, tmp_path_factory) -> Iterator[list[str]]:
    """Paths that are opened during a test, after the command and its kernels are loaded."""
    odd = tmp_path_factory.mktemp("odd") / "odd.urdf"
    odd.write_text(edited('izz="1"', 'izz="3"'), encoding="utf-8")
    assert main(["import", str(odd)]) == 0
    capsys.readouterr()
    found: list[str] = []
    hooks.append(found)
    yield found
    hooks.remove(found)


hooks: list[list[str]] = []


def _hear(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and hooks:
        hooks[-1].append(str(arguments[0]))


sys.addaudithook(_hear)  # an audit hook cannot be removed; it records only while `hooks` has a list


LONG = {"many elements", "10,000 links"}
ENDLESS = 5.0  # s of CPU time, on any machine: an algorithm of quadratic cost takes minutes with these files


@pytest.mark.parametrize("name", [pytest.param(x, marks=pytest.mark.slow if x in LONG else ()) for x in HOSTILE])
def test_a_hostile_urdf_is_refused_in_one_line_and_no_other_file_is_opened(
    name: str, tmp_path: Path, monkeypatch, capsys, opened: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    data, id, part = HOSTILE[name]
    Path("bad.urdf").write_bytes(data if isinstance(data, bytes) else data.encode())
    Path("secret.txt").write_text("secret", encoding="utf-8")
    opened.clear()
    start = time.process_time()
    assert main(["import", "bad.urdf", "-o", "out.toml"]) == 2
    assert time.process_time() - start < ENDLESS
    printed = capsys.readouterr().err
    (line,) = printed.splitlines()
    assert len(line) < 400
    assert {name for name in opened if "/.out-" not in name} <= {
        "bad.urdf"
    }  # `.out-` files are created to check that the folder is writable
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.urdf", "secret.txt"]
    text = refused_line(printed, id, values=name != "too large")  # 1e999 is read as infinity
    assert text.split(": ")[:2] == ["flexlink", "bad.urdf"]
    assert part in text.partition("bad.urdf: ")[2]


def test_the_good_file_is_imported_and_only_it_is_opened(tmp_path: Path, monkeypatch, opened: list[str]) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = '<visual><geometry><mesh filename="file:///etc/hostname"/></geometry></visual>'
    Path("good.urdf").write_text(edited(BODY, BODY + mesh), encoding="utf-8")
    opened.clear()
    assert main(["import", "good.urdf"]) == 0
    assert {name for name in opened if "/.out-" not in name} == {"good.urdf"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["billion laughs", "quadratic", "deep", "many elements", "huge", "10,000 links"])
def test_a_large_file_takes_little_memory(name: str, tmp_path: Path) -> None:
    path = saved(tmp_path, str(HOSTILE[name][0]), "bad")
    tracemalloc.start()
    try:
        assert main(["import", str(path)]) == 2
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()


def test_folders_devices_and_missing_files_are_refused(tmp_path: Path, capsys) -> None:
    (tmp_path / "folder").mkdir()
    for path, id in {
        tmp_path / "folder": "cannot-read",
        tmp_path / "no.urdf": "cannot-read",
        Path("/dev/zero"): "cannot-read",
        Path("ur55"): "unknown-robot",
    }.items():
        assert main(["import", str(path)]) == 2
        printed = capsys.readouterr().err
        assert len(printed.splitlines()) == 1
        text = refused_line(printed, id)
        assert path.name in text
    assert "ur3, ur5" in text


@pytest.mark.slow
def test_the_longest_accepted_robot_needs_no_recursion(tmp_path: Path) -> None:
    """Python allows only 1000 nested calls; the robot has 3000 links."""
    path = saved(tmp_path, rope(3000).replace("continuous", "fixed").replace('"fixed"', '"continuous"', 1), "rope")
    assert main(["import", str(path), "--tip", "l1"]) == 0
