"""Sentences below the fields of records in the source, and the units in them."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import re
import textwrap

from flexlink.describe.spec import Spec, fields_of


@functools.cache
def sentences(kind: type[Spec]) -> dict[str, str]:
    """Return the sentence below each field of a record, by its key in a file; empty if the source is not available."""
    texts: dict[str, str] = {}
    for each in (part for part in reversed(kind.__mro__) if issubclass(part, Spec)):
        texts |= _sentences(each)
    return {field.encode_name: texts[field.name] for field in fields_of(kind) if field.name in texts}


def _sentences(kind: type[Spec]) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(kind))
    except OSError:
        return {}
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    return {
        field.target.id: inspect.cleandoc(str(text.value.value))
        for field, text in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }  # fmt: skip


def units_in(sentence: str) -> tuple[str, ...]:
    """Return all units in a sentence, each once.

    >>> print(units_in("Spring of the gear [N m/rad]; of a prismatic joint [N/m]."))
    ('N m/rad', 'N/m')
    """
    return tuple(dict.fromkeys(re.findall(r"\[([^\[\],]+)\]", re.sub(r"`[^`]*`", "", sentence))))
