"""Look up links by name or number, with one rule for all arguments."""

from __future__ import annotations

from collections.abc import Sequence

from flexlink.common.errors import ArgumentError
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.spec import to_builtin


def link_number(argument: str, value: object, names: Sequence[str]) -> int:
    """Number, from 1, of the link given by its name or number.

    Parameters
    ----------
    argument
        Name of the argument, for the message.
    value
        A link's name, or its number from 1 to len(names).
    names
        Names of the links, from the base outward.

    Raises
    ------
    ArgumentError
        There is no such link; the message lists the existing ones.
    """
    wanted = to_builtin(value)
    if isinstance(wanted, str) and wanted in names:
        return names.index(wanted) + 1
    if type(wanted) is int and 1 <= wanted <= len(names):
        return wanted
    raise ArgumentError(
        f"{argument} = {truncated(value)}: no link of this arm; allowed are {short_list(names)}, or 1 … {len(names)}"
        f"{did_you_mean(wanted, names)}",
        id="unknown-link",
    )
