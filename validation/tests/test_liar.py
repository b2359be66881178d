"""Every check of the study is given false values and must report them: a check that always passes is useless.

Each case is shortened, passes unchanged, and must fail if one function of the library returns a false value in one
call. False values exceed a limit by a small factor only, so that a limit 1000 times too wide, or a mean in place of a
maximum, is found.
"""

import contextlib
import math

import pytest

import flexlink as fl
from flexlink import engines
from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.dynamics import terms
from validation.kinds import KINDS
from validation.store import Row
from validation.tests.liar.cut import Cut, Lie, load, not_lied_to, remembering_judges
from validation.tests.liar.lies import LIES, injected

CUTS = load()
SHARPEST = 40.0  # largest factor by which a false value may exceed its limit: far below 1000, well above rounding
MILLIONTH = 1e-6


def limits(row: Row) -> float:
    """A value divided by its limit; for a lower limit, inf if the value is below this limit, else 0."""
    if row.value is None:
        return math.inf
    if row.bound == "at least":
        return math.inf if not row.passed else 0.0
    if not row.tolerance:
        return math.inf if row.value else 0.0
    return row.value / row.tolerance


def honest(cut: Cut) -> dict[str, int]:
    """Run the unchanged case, which passes, and count the calls of each function."""
    with contextlib.ExitStack() as stack:
        paths = {LIES[lie.of].path: lie.of for lie in cut.lie}
        counts = {path: stack.enter_context(injected(of, 0.0, None)) for path, of in paths.items()}
        rows = cut.rows_of()
    assert [
        f"{row.quantity}: {row.value}, limit {row.tolerance}; {row.note}" for row in rows if row.passed is False
    ] == []
    return {path: count for path, (count,) in counts.items()}


@pytest.mark.slow
@pytest.mark.parametrize("cut", CUTS, ids=str)
def test_a_check_given_false_values_fails(cut: Cut) -> None:
    with remembering_judges():
        counts, unnoticed, rows = honest(cut), list[str](), dict[tuple[str, float, int | None], list[Row]]()
        for lie in cut.lie:
            calls = counts[LIES[lie.of].path]
            assert calls, f"{cut}: nothing of {lie.of} is measured"
            fault = lie.of, lie.size, lie.at(calls)
            if fault not in rows:  # several checks may have to report the same fault
                with injected(*fault):
                    rows[fault] = cut.rows_of()
            found = max(limits(row) for row in rows[fault] if row.quantity == lie.fails)
            if not (1.0 < found <= SHARPEST or found == math.inf):
                unnoticed.append(f"{lie.of} wrong by {lie.size:g}: {lie.fails} is {found:.3g} limits")
        assert unnoticed == []


@pytest.mark.slow
@pytest.mark.parametrize("cut", [cut for cut in CUTS if len(cut.made.scenes) > 1], ids=str)
def test_a_check_that_omits_a_scene_fails(cut: Cut) -> None:
    try:
        rows = cut.rows_of(left_out=1)
    except FlexlinkError:  # the error names the missing scene
        return
    except ValueError as error:  # the kind expects a fixed number of scenes
        assert "unpack" in str(error)
        return
    assert [row.quantity for row in rows if row.passed is False and row.quantity.startswith("rows of ")]


def test_every_check_is_given_false_values_or_states_why_not() -> None:
    lied, skipped = {cut.kind for cut in CUTS if cut.lie}, not_lied_to()
    assert lied | set(skipped) == set(KINDS)
    assert lied & set(skipped) == set()
    assert all(len(why) > 10 for why in skipped.values())


def test_false_values_are_off_by_at_most_a_millionth_or_state_why() -> None:
    large = [
        (cut.case, lie.of, lie.size) for cut in CUTS for lie in cut.lie if abs(lie.size) > MILLIONTH and not lie.why
    ]
    assert large == []


def test_false_values_concern_quantities_with_limits() -> None:
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

    monkeypatch.setattr("validation.kinds.engines.load", load)
    failed = {row.quantity for row in cut.rows_of() if row.passed is False}
    assert failed == {"arms refused"}


def test_a_false_value_reaches_the_study_and_is_removed_afterwards() -> None:
    before = fl.mass_matrix
    with injected("M", 1e-6, None):
        assert fl.mass_matrix is terms.mass_matrix is not before
    assert fl.mass_matrix is terms.mass_matrix is before
