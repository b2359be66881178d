"""XML from unknown sources: harmful documents are refused before anything is expanded, fetched or stored."""

import pytest

from flexlink.common import safe_xml
from flexlink.common.errors import DataFileError
from flexlink.common.safe_xml import parse
from tests.support.words import refused

BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
SECRET = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot>&x;</robot>'
HARMFUL = {
    "bomb": BOMB,
    "bomb in UTF-16": f'<?xml version="1.0" encoding="utf-16"?>{BOMB}'.encode("utf-16"),
    "file": SECRET,
    "bare document type": '<!DOCTYPE robot SYSTEM "robot.dtd"><robot/>',
}
BROKEN = {
    "nothing": "",
    "no XML": "name = 'arm'",
    "cut off": "<robot><link>",
    "two roots": "<a/><b/>",
    "twice the same attribute": '<a b="1" b="2"/>',
    "undefined entity": "<a>&x;</a>",
    "undeclared prefix": "<a><drake:b/></a>",
    "null": b"<a>\x00</a>",
    "surrogate": "<a>\ud800</a>",
    "not UTF-8": b"<a>\xff</a>",
    "unknown encoding": b'<?xml version="1.0" encoding="klingon"?><a/>',
    "encoding of many bytes": b'<?xml version="1.0" encoding="utf-7"?><a/>',
}


@pytest.mark.parametrize("text", HARMFUL.values(), ids=HARMFUL)
def test_a_document_type_is_refused_before_anything_is_expanded(text: str | bytes) -> None:
    with refused(DataFileError, "xml-entities"):
        parse(text, "arm.urdf")


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_a_document_that_is_not_xml_is_refused(text: str | bytes) -> None:
    with refused(DataFileError, "not-xml"):
        parse(text, "arm.urdf")


def test_a_document_of_excessive_size_or_depth_is_refused() -> None:
    many = safe_xml.MOST_ELEMENTS
    for text, id, parts in (
        ("<a>" + " " * safe_xml.LARGEST + "</a>", "file-too-large", ("5000000",)),
        ("<a>" + "<b/>" * many + "</a>", "file-too-large", ("200000",)),
        ("<a " + " ".join(f'b{k}=""' for k in range(many)) + "/>", "file-too-large", ("200000",)),
        ("<a>" * (safe_xml.DEEPEST + 1), "xml-too-deep", ("1000", "<a>")),
    ):
        with refused(DataFileError, id) as caught:
            parse(text, "big")
        assert all(part in str(caught.value) for part in parts)


def test_text_and_bytes_of_every_usual_encoding_read_the_same() -> None:
    text = '<?xml version="1.0" encoding="{}"?><!-- c --><arm name="Gelenk-äö"><?p x?><b>1 &lt; 2</b></arm>'
    for encoding in ("utf-8", "utf-16", "iso-8859-1"):
        for document in (text.format(encoding), text.format(encoding).encode(encoding)):
            root = parse(document, "arm")
            assert (root.tag, root.get("name"), [child.text for child in root]) == ("arm", "Gelenk-äö", ["1 < 2"])


def test_white_space_before_the_declaration_is_skipped_only_without_namespaces() -> None:
    text = '\n <?xml version="1.0"?><arm/>'
    assert parse(text, "arm", namespaces=False).tag == "arm"
    with pytest.raises(DataFileError) as caught:
        parse(text, "arm")
    assert caught.value.id == "not-xml"


def test_a_namespace_is_part_of_a_name() -> None:
    (child,) = parse('<sdf xmlns:drake="http://drake.mit.edu"><drake:rotor_inertia/></sdf>', "arm")
    name = "{http://drake.mit.edu}rotor_inertia"
    assert child.tag == name
