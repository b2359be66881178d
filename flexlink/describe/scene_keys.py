"""Keys of a scene file, in which the keys of the arm are at the top level, beside the keys of the scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from flexlink.common.errors import Diagnostic, SceneError
from flexlink.describe.arm import Arm
from flexlink.describe.spec import (
    build_validated,
    check_keys,
    decode,
    fields_of,
    key_mistakes,
    mistakes,
    raise_together,
)

OF_ARM = {field.encode_name: field for field in fields_of(Arm)}
"""Fields of the arm, by their keys."""


def read_keys(
    raw: Mapping[str, Any],
    kinds: Mapping[str, Any],
    required: Sequence[str],
    kept: Mapping[str, Any],
    arm: Arm | None = None,
    *,
    finite: bool = False,
) -> tuple[Arm, dict[str, Any]]:
    """Decode a parsed file into the arm and all other values by key; `kept` and `arm` are already checked.

    Parameters
    ----------
    raw
        Parsed TOML.
    kinds
        Type annotation of each key.
    required
        Required keys.
    kept, arm
        Parts that are already checked.
    finite
        As in `decode`.

    Raises
    ------
    SceneError
        The message lists all mistakes, each with its key path, its value and what is allowed.
    """
    try:
        check_keys(raw, kinds, required)
        values = {**kept, **{key: decode(value, kinds[key], key, finite=finite) for key, value in raw.items()}}
        return arm or _arm_of(values), {key: value for key, value in values.items() if key not in OF_ARM}
    except SceneError:
        raise_together(_mistakes(raw, kinds, kept, required))
        raise


def _arm_of(values: Mapping[str, Any]) -> Arm:
    arm: Arm = build_validated(Arm, **{OF_ARM[key].name: value for key, value in values.items() if key in OF_ARM})
    return arm


def _mistakes(
    raw: Mapping[str, Any], kinds: Mapping[str, Any], kept: Mapping[str, Any], required: Sequence[str]
) -> Iterator[Diagnostic]:
    """All mistakes in a parsed file, key by key; if the arm's parts are valid, also contradictions between them."""
    yield from key_mistakes(raw, list(kinds), required)
    known = {key: value for key, value in raw.items() if key in kinds}
    wrong = {key: mistakes(value, kinds[key], key) for key, value in known.items()}
    for found in wrong.values():
        yield from found
    of_arm = {key: value for key, value in known.items() if key in OF_ARM}
    if not any(wrong[key] for key in of_arm) and "link" in {*kept, *of_arm}:
        try:
            _arm_of({**kept, **{key: decode(value, kinds[key], key) for key, value in of_arm.items()}})
        except SceneError as error:
            yield error.diagnostic
