"""`--json`: print the result of a command as one JSON document, for scripts."""

from __future__ import annotations

import msgspec
import numpy as np

from flexlink.common.errors import Diagnostic


def print_json(document: object) -> None:
    """Print a document in SI units, with null for numbers that are not finite and [re, im] for complex numbers."""
    print(msgspec.json.format(msgspec.json.encode(document, enc_hook=_plain), indent=1).decode())


def with_ids(texts: tuple[str, ...]) -> list[dict[str, str]]:
    """Diagnostics as objects with id and text."""
    return [{"id": text.id if isinstance(text, Diagnostic) else "", "text": str(text)} for text in texts]


def _plain(value: object) -> object:
    """Convert types unknown to msgspec: arrays, NumPy numbers, complex numbers, texts with an id."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Diagnostic):
        return str(value)
    if isinstance(value, complex):
        return value.real, value.imag
    raise NotImplementedError(type(value).__name__)
