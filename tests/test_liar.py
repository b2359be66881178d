"""Every kind of the study is given false values and must report them: a check that always passes checks nothing.

Each case is cut short, passes as it is, and then fails where one function of the library is wrong in one call. Lies are
a few limits large, so that a limit that is 1000 times too wide lets them pass, as a mean in place of a maximum does.
"""

from __future__ import annotations

import contextlib
import math

import pytest
from liar.cut import Cut, Lie, load, not_lied_to, remembering_judges
from liar.lies import LIES, told

import flexlink as fl
from flexlink import engines
from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.dynamics import terms
from validation.kinds import KINDS
from validation.store import Row

CUTS = load()
SHARPEST = 40.0  # limits that a lie may be large: far below 1000, and well above what rounding makes of it
MILLIONTH = 1e-6


def limits(row: Row) -> float:
    """How many limits a value is large; of one that should be at least its limit, inf where it is not."""
    if row.value is None:
        return math.inf
    if row.bound == "at least":
        return math.inf if not row.passed else 0.0
    if not row.tolerance:
        return math.inf if row.value else 0.0
    return row.value / row.tolerance


def honest(cut: Cut) -> dict[str, int]:
    """The case as it is, which passes, and how often each function is called meanwhile."""
    with contextlib.ExitStack() as stack:
        paths = {LIES[lie.of].path: lie.of for lie in cut.lie}
        counts = {path: stack.enter_context(told(of, 0.0, None)) for path, of in paths.items()}
        rows = cut.rows_of()
    assert [
        f"{row.quantity}: {row.value}, limit {row.tolerance}; {row.note}" for row in rows if row.passed is False
    ] == []
    return {path: count for path, (count,) in counts.items()}


@pytest.mark.slow
@pytest.mark.parametrize("cut", CUTS, ids=str)
def test_a_kind_that_is_lied_to_fails(cut: Cut) -> None:
    with remembering_judges():
        counts, unnoticed = honest(cut), list[str]()
        for lie in cut.lie:
            calls = counts[LIES[lie.of].path]
            assert calls, f"{cut}: nothing of {lie.of} is measured"
            with told(lie.of, lie.size, lie.at(calls)):
                found = max(limits(row) for row in cut.rows_of() if row.quantity == lie.fails)
            if not (1.0 < found <= SHARPEST or found == math.inf):
                unnoticed.append(f"{lie.of} wrong by {lie.size:g}: {lie.fails} is {found:.3g} limits")
        assert unnoticed == []


@pytest.mark.slow
@pytest.mark.parametrize("cut", [cut for cut in CUTS if len(cut.made.scenes) > 1], ids=str)
def test_a_kind_that_leaves_a_scene_out_fails(cut: Cut) -> None:
    try:
        rows = cut.rows_of(left_out=1)
    except FlexlinkError:  # names it
        return
    except ValueError as error:  # a kind that takes its scenes apart by name or number
        assert "unpack" in str(error)
        return
    assert [row.quantity for row in rows if row.passed is False and row.quantity.startswith("rows of ")]


def test_every_kind_is_lied_to_or_has_a_reason_why_not() -> None:
    lied, spared = {cut.kind for cut in CUTS if cut.lie}, not_lied_to()
    assert lied | set(spared) == set(KINDS)
    assert lied & set(spared) == set()
    assert all(len(why) > 10 for why in spared.values())


def test_a_lie_is_a_millionth_at_most_or_has_a_reason_to_be_larger() -> None:
    large = [
        (cut.case, lie.of, lie.size) for cut in CUTS for lie in cut.lie if abs(lie.size) > MILLIONTH and not lie.why
    ]
    assert large == []


def test_lies_name_quantities_with_limits() -> None:
    wrong = [(cut.case, lie.fails) for cut in CUTS for lie in cut.lie if not _has_limit(cut, lie)]
    assert wrong == []


def _has_limit(cut: Cut, lie: Lie) -> bool:
    quantity = cut.made.quantity.get(lie.fails)
    return quantity is not None and quantity.tolerance is not None


@pytest.mark.slow
@pytest.mark.parametrize("case", ["random_arms", "random_trees"])
def test_an_engine_that_refuses_an_arm_fails_the_study(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (cut,) = (cut for cut in CUTS if cut.case == case)
    honest, calls = engines.load, [0]

    def load(name: str, chain: object) -> object:
        calls[0] += name == "mujoco"
        if name == "mujoco" and calls[0] == 2:
            raise EngineError("refused")
        return honest(name, chain)  # type: ignore[arg-type]

    monkeypatch.setattr("validation.kinds.random_arms.load", load)
    failed = {row.quantity for row in cut.rows_of() if row.passed is False}
    assert failed == {"arms refused"}


def test_a_lie_reaches_the_study_and_is_not_kept() -> None:
    before = fl.mass_matrix
    with told("M", 1e-6, None):
        assert fl.mass_matrix is terms.mass_matrix is not before
    assert fl.mass_matrix is terms.mass_matrix is before
