"""Check every claim in `matrix/`, which must be true for any arm, for every arm in `matrix/chains`."""

import inspect
import tomllib
from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import flexlink as fl
from tests.matrix import case, files, public, rest, runs, states

EXPECTED: dict[str, list[dict[str, Any]]] = tomllib.loads(
    (Path(__file__).parent / "expected.toml").read_text(encoding="utf-8")
)


def claims(module: ModuleType) -> Iterator[tuple[str, Callable[[case.Case], None]]]:
    """Functions of a module whose only argument is a case."""
    for name, function in vars(module).items():
        own = getattr(function, "__module__", "") == module.__name__ and not name.startswith("_")
        if own and list(inspect.signature(function).parameters) == ["case"]:
            yield name, function


CLAIMS = {name: claim for module in (states, runs, rest, files) for name, claim in claims(module)}
CLAIMS |= public.CLAIMS
FIRST = ("tied", "crane")
"""Arms whose kernels are compiled by these tests."""


def row_of(kind: str, claim: str, chain: str) -> dict[str, Any] | None:
    """The row of `expected.toml` for this claim and this arm, or None."""
    rows = [row for row in EXPECTED.get(kind, []) if claim in row["claims"] and _named(row["chains"], chain)]
    assert len(rows) <= 1, f"{kind}: {claim}-{chain} is in {len(rows)} rows"
    return rows[0] if rows else None


def _named(patterns: list[str], chain: str) -> bool:
    return any(fnmatchcase(chain, pattern) for pattern in patterns)


def cells() -> Iterator[Any]:
    """All cells; two of three are long: a run without them still sees all claims and all arms."""
    every = {chain: k for k, chain in enumerate(case.names())}
    for row, claim in enumerate(CLAIMS):
        for chain in public.ONLY.get(claim, case.names()):
            if row_of("left_out", claim, chain):
                continue
            fault = row_of("fault", claim, chain)
            marks = [pytest.mark.xfail(strict=True, reason=fault["reason"])] if fault else []
            slow = claim in public.SLOW or fnmatchcase(chain, public.SLOW_CHAINS.get(claim, ""))
            marks += [pytest.mark.slow] if slow else []
            marks += [pytest.mark.first] if chain in FIRST else []
            marks += [pytest.mark.long] if (row + every[chain]) % 3 else []
            yield pytest.param(claim, chain, id=f"{claim}-{chain}", marks=marks)


@pytest.mark.parametrize(("claim", "chain"), list(cells()))
def test_matrix(claim: str, chain: str) -> None:
    """The claim is true for the arm, or the arm is refused with an id from `expected.toml`."""
    refused = row_of("refused", claim, chain)
    if refused is None:
        CLAIMS[claim](case.case(chain))
        return
    with pytest.raises(fl.FlexlinkError) as caught:
        CLAIMS[claim](case.case(chain))
    assert caught.value.id in refused["ids"], str(caught.value)


def test_every_row_of_expected_toml_names_a_cell() -> None:
    for row in (row for rows in EXPECTED.values() for row in rows):
        assert set(row["claims"]) <= set(CLAIMS), row
        names = {name for claim in row["claims"] for name in public.ONLY.get(claim, case.names())}
        assert all(any(fnmatchcase(name, pattern) for name in names) for pattern in row["chains"]), row


def test_the_matrix_calls_every_public_function_of_a_scene_a_chain_or_a_run() -> None:
    assert public.uncalled() == set()
