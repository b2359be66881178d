"""URDF files that lie, harm or are not what they seem: each is refused in one line, from its own bytes alone."""

from __future__ import annotations

import re
import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexlink.cli.main import main

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
BODY = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
JOINT = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
GOOD = f'<robot name="r"><link name="a"/><link name="b">{BODY}</link>{JOINT}</robot>'


def edited(*pairs: str) -> str:
    """The good file with each first text replaced by the second."""
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
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    # no robot
    "empty": ("", "not XML"),
    "blank": (" \n", "not XML"),
    "no XML": ("name = 'arm'", "not XML"),
    "cut off": (GOOD[:-5], "not XML"),
    "latin-1 bytes": (GOOD.replace('"r"', '"ä"').encode("latin-1"), "not XML"),
    "null": (GOOD.replace('"r"', '"\0"'), "not XML"),
    "an image": (b"\x89PNG\r\n\x1a\n" + bytes(100), "not XML"),
    "SDF": ("<sdf version='1.10'/>", "<sdf>: the root element of a URDF file is <robot>"),
    "MJCF": ("<mujoco/>", "<mujoco>: the root element"),
    "our own export": (edited("</joint>", '<flexlink stiffness="9"/></joint>'), "exported by flexlink"),
    "no link": ("<robot name='r'/>", "no link"),
    "no joint": ("<robot name='r'><link name='a'/></robot>", "no movable joint"),
    # entities, size, depth
    "billion laughs": (f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHS}]><robot name="&l9;"/>', "<!DOCTYPE r>"),
    "quadratic": (f'<!DOCTYPE r [<!ENTITY x "{"x" * 100_000}">]><robot>{"&x;" * 100_000}</robot>', "<!DOCTYPE r>"),
    "external entity": ('<!DOCTYPE r [<!ENTITY x SYSTEM "secret.txt">]><robot name="&x;"/>', "<!DOCTYPE r>"),
    "external type": ('<!DOCTYPE r SYSTEM "secret.txt"><robot/>', "<!DOCTYPE r>"),
    "parameter entity": ('<!DOCTYPE r [<!ENTITY % x SYSTEM "secret.txt"> %x;]><robot/>', "<!DOCTYPE r>"),
    "entity in UTF-16": (
        '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE r [<!ENTITY x "y">]><robot/>'.encode("utf-16"),
        "<!DOCTYPE r>",
    ),
    "deep": ("<robot>" + "<a>" * 100_000, "nested deeper"),
    "many elements": ("<robot>" + "<a/>" * 500_000 + "</robot>", "more than"),
    "huge": ("<robot>" + " " * 6_000_000 + "</robot>", "more than 5000000 bytes"),
    "10,000 links": (rope(10_000), "10000 links; at most 5000 are read"),
    # xacro
    "xacro property": (edited('value="1"', 'value="${m}"'), "expand it first"),
    "xacro macro": (
        edited('<robot name="r">', '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/>'),
        "expand it first",
    ),
    "xacro prefix": (edited('<robot name="r">', '<robot name="r"><xacro:arm/>'), "not XML: unbound prefix"),
    # numbers
    "NaN": (edited('value="1"', 'value="nan"'), "link 'b': <mass value> = 'nan': expected a finite number"),
    "infinite": (edited('ixx="1"', 'ixx="inf"'), "<inertia ixx> = 'inf'"),
    "too large": (edited('value="1"', 'value="1e999"'), "<mass value> = '1e999'"),
    "comma": (edited('value="1"', 'value="1,5"'), "<mass value> = '1,5'"),
    "underscore": (edited('value="1"', 'value="1_5"'), "<mass value> = '1_5'"),
    "hexadecimal": (edited('value="1"', 'value="0x1p3"'), "<mass value> = '0x1p3'"),
    "other digits": (edited('value="1"', 'value="١"'), "<mass value> = '١'"),
    "empty number": (edited('value="1"', 'value=""'), "<mass value> = ''"),
    "two numbers": (edited("<inertial>", '<inertial><origin xyz="1 2"/>'), "<origin xyz> = '1 2': expected 3"),
    "four numbers": (edited("<inertial>", '<inertial><origin rpy="1 2 3 4"/>'), "<origin rpy> = '1 2 3 4'"),
    "long word": (edited('value="1"', f'value="{"9" * 9_000}x"'), "<mass value> = "),
    "long type": (edited("continuous", "x" * 1_000_000), "<joint>: has an attribute of more than 10000 characters"),
    "long number": (edited('value="1"', f'value="{"9" * 9_000}"'), "<mass value>"),
    "far away": (edited("<inertial>", '<inertial><origin xyz="1e200 0 0"/>'), "must be at most 1e+09"),
    # bodies
    "negative mass": (edited('value="1"', 'value="-1"'), "<mass value> = -1.0: must not be negative"),
    "A + B < C": (edited('izz="1"', 'izz="3"'), "link 'b': inertia"),
    "negative moment": (edited('ixx="1"', 'ixx="-1"'), "no body can have it"),
    "unphysical once folded": (
        robot("abc", joint("j", "a", "b"), joint("k", "b", "c", kind="fixed")).replace('izz="1"', 'izz="2.1"'),
        "link 'b' with c: inertia",
    ),
    "no mass": (edited('<mass value="1"/>', ""), "link 'b': <mass>: missing"),
    "no value": (edited('value="1"', ""), "<mass value>: missing"),
    "no inertia": (edited(INERTIA, ""), "<inertia>: missing"),
    "no product": (edited('ixy="0"', ""), "<inertia ixy>: missing"),
    "two inertials": (edited(BODY, BODY * 2), "<inertial> is given 2 times"),
    "nothing moves": (edited(BODY, ""), "no link of this file has mass; give the links that move their <inertial>"),
    # names and the tree
    "link without name": (edited('<link name="a"/>', "<link/>"), "link 1: name: missing"),
    "joint without name": (edited('name="j"', ""), "joint 1: name: missing"),
    "two links of one name": (robot("abb", joint("j", "a", "b")), "link 'b': this name is used twice"),
    "two joints of one name": (robot("abc", joint("j", "a", "b"), joint("j", "b", "c")), "'j': this name is used"),
    "missing link": (edited('<parent link="a"/>', '<parent link="z"/>'), "joint 'j': link 'z' does not exist"),
    "no parent": (edited('<parent link="a"/>', ""), "<parent>: missing"),
    "no child": (edited('<child link="b"/>', ""), "<child>: missing"),
    "child of no name": (edited('<child link="b"/>', "<child/>"), "<child link>: missing"),
    "two parents": (robot("abc", joint("j", "a", "c"), joint("k", "b", "c")), "'c' is the child of two joints, 'j'"),
    "two parents in a joint": (edited('<parent link="a"/>', '<parent link="a"/>' * 2), "<parent> is given 2 times"),
    "loop": (robot("ab", joint("j", "a", "b"), joint("k", "b", "a")), "form a loop"),
    "loop beside a tree": (
        robot("abcd", joint("j", "a", "b"), joint("k", "c", "d"), joint("l", "d", "c")),
        "links c, d form a loop",
    ),
    "link on itself": (robot("a", joint("j", "a", "a")), "form a loop"),
    "two roots": (robot("abc", joint("j", "a", "b")), "2 links have no parent joint, a, c"),
    # joints
    "no type": (edited('type="continuous"', ""), "<joint type>: missing"),
    "screw": (edited("continuous", "screw"), "type = 'screw': allowed are revolute"),
    "capital": (edited("continuous", "Continuous"), "did you mean 'continuous'"),
    "floating": (edited("continuous", "floating"), "joint 'j', beyond 'a', is floating; only hinges and slides"),
    "planar": (edited("continuous", "planar"), "joint 'j', beyond 'a', is planar; only hinges and slides"),
    "zero axis": (edited("</joint>", '<axis xyz="0 0 0"/></joint>'), "<axis xyz> = (0.0, 0.0, 0.0): must not be zero"),
    "no limit": (edited("continuous", "revolute"), "<limit>: missing"),
    "limits turned round": (
        edited("continuous", "revolute", "</joint>", '<limit lower="1" upper="-1"/></joint>'),
        "lower must not exceed upper",
    ),
    "endless limit": (
        edited("continuous", "revolute", "</joint>", '<limit lower="-inf" upper="1"/></joint>'),
        "<limit lower> = '-inf'",
    ),
    "negative damping": (edited("</joint>", '<dynamics damping="-1"/></joint>'), "<dynamics damping> = -1.0"),
    "negative friction": (edited("</joint>", '<dynamics friction="-1"/></joint>'), "<dynamics friction> = -1.0"),
    "follows nothing": (edited("</joint>", MIMIC.format("z") + "</joint>"), "mimics 'z', which does not exist"),
    "follows itself": (edited("</joint>", MIMIC.format("j") + "</joint>"), "mimics itself"),
    "follow each other": (
        robot("abc", joint("j", "a", "b", MIMIC.format("k")), joint("k", "b", "c", MIMIC.format("j"))),
        "mimics itself, by way of j, k",
    ),
}  # fmt: skip


def test_there_are_enough() -> None:
    assert len(HOSTILE) >= 40


@pytest.fixture
def opened(capsys) -> Iterator[list[str]]:
    """Paths that are opened meanwhile, by a command that is loaded."""
    main(["import", "nowhere.urdf"])
    capsys.readouterr()
    found: list[str] = []
    hooks.append(found)
    yield found
    hooks.remove(found)


hooks: list[list[str]] = []


def _hear(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and hooks:
        hooks[-1].append(str(arguments[0]))


sys.addaudithook(_hear)  # for good; it hears only while a list is there


LONG = {"many elements", "10,000 links"}
ENDLESS = 5.0  # s of processor time, on any machine: what grows with the square of these files takes minutes


@pytest.mark.parametrize("name", [pytest.param(x, marks=pytest.mark.slow if x in LONG else ()) for x in HOSTILE])
def test_a_hostile_file_is_refused_in_one_line_and_nothing_else_is_touched(
    name: str, tmp_path: Path, monkeypatch, capsys, opened: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    data, message = HOSTILE[name]
    Path("bad.urdf").write_bytes(data if isinstance(data, bytes) else data.encode())
    Path("secret.txt").write_text("secret", encoding="utf-8")
    opened.clear()
    start = time.process_time()
    assert main(["import", "bad.urdf", "-o", "out.toml"]) == 2
    assert time.process_time() - start < ENDLESS
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("flexlink: bad.urdf: ")
    assert message in lines[0]
    assert len(lines[0]) < 400
    assert {name for name in opened if "/.out-" not in name} <= {"bad.urdf"}  # one is made, to know whether it can be
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.urdf", "secret.txt"]


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
    path = tmp_path / "bad.urdf"
    path.write_text(str(HOSTILE[name][0]), encoding="utf-8")
    tracemalloc.start()
    try:
        assert main(["import", str(path)]) == 2
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()


def test_files_that_are_none_are_refused(tmp_path: Path, capsys) -> None:
    for path, message in {
        tmp_path: "cannot be read: Is a directory",
        tmp_path / "no.urdf": "cannot be read: No such file",
        Path("/dev/zero"): "is a pipe or a device",
        Path("ur55"): "no such file; known arms are ur3, ur5",
    }.items():
        assert main(["import", str(path)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert re.search(re.escape(message), line)


def test_a_body_that_cannot_be_may_be_part_of_one_that_can(tmp_path: Path) -> None:
    text = HOSTILE["unphysical once folded"][0]
    assert isinstance(text, str)
    path = tmp_path / "odd.urdf"
    path.write_text(text.replace('izz="2.1"', 'izz="1"').replace('izz="1"', 'izz="2.1"', 1), encoding="utf-8")
    assert main(["import", str(path)]) == 0


@pytest.mark.slow
def test_the_longest_robot_that_is_read_needs_no_recursion(tmp_path: Path) -> None:
    """Python's stack ends at 1000 calls."""
    path = tmp_path / "rope.urdf"
    path.write_text(rope(3000).replace("continuous", "fixed").replace('"fixed"', '"continuous"', 1), encoding="utf-8")
    assert main(["import", str(path), "--tip", "l1"]) == 0
