"""Show the progress of a fit: its parts (initial guesses, ends of profiles) and the iterations of the current part."""

from __future__ import annotations

from collections.abc import Callable

Bar = Callable[[float, str], None]


def watch_with(bar: Bar | None, parts: int) -> Callable[[str], None]:
    """Function that updates `bar`: call it with the name of each part that begins, and with "" after each iteration."""
    if bar is None:
        return lambda part: None
    name, begun, iterations = "", 0, 0

    def watch(part: str) -> None:
        nonlocal name, begun, iterations
        name, begun, iterations = (part, begun + 1, 0) if part else (name, begun, iterations + 1)
        bar((begun - 1) / parts, f"{name}, iteration {iterations}")

    return watch
