"""The paper's claims: what is measured decides the verdict, and the page says it claim by claim."""

import numpy as np
import pytest
from studies import row, stored, words_from

from flexlink.describe.spec import decode
from reports.findings import paper_claims
from reports.results import Results
from validation.case import ALL, CLAIM, Measured, load_cases
from validation.kinds import (
    KINDS,
    SETTINGS,
    measurements,
    paper_mass,
    paper_methods,
    paper_rounding,
    paper_segments,
)
from validation.kinds.paper_types import _verdict
from validation.runner import judged
from validation.speed.races import Race


def measured(name, **changes):
    """Quantity → rows of a case, with other settings."""
    (case,) = load_cases(name)
    settings = decode(case.settings | changes, SETTINGS[case.kind])
    found = {}
    for each in measurements(KINDS[case.kind], case, settings):
        found.setdefault(getattr(each, "quantity", "series"), []).append(each)
    return found


def test_a_type_that_gains_nothing_somewhere_is_named():
    assert _verdict({"T1 on an arm": 2.5}) == "holds"
    assert _verdict({"T1 on an arm": 1.25, "T2 on an arm": 3.0}) == (
        "holds as the paper limits it, by manipulator and task: the error of the previous type is less than "
        "2 times larger in T1 on an arm 1.25"
    )
    assert _verdict({"T1 on an arm": 0.8}) == "does not hold: less precise than the previous type: T1 on an arm 0.8"


def test_rounding_meets_the_error_of_the_step_where_both_lines_cross():
    errors = [paper_rounding.Errors(h, h**4, 1e-16) for h in (1e-2, 1e-3)]
    assert paper_rounding._meeting(errors, 4) == pytest.approx(1e-4)


def times(**by_method):
    names = dict(zip(("one", "two", "three", "later"), paper_mass.METHODS, strict=True))
    return Race("T1", "M", 40, {names[name]: value for name, value in by_method.items()})


def test_a_method_for_the_mass_matrix_that_takes_longer_than_the_one_before_is_named():
    good, slow = times(one=9.0, two=6.0, three=3.0, later=1.0), times(one=9.0, two=12.0, three=3.0, later=1.0)
    later = "at n = 40 composite bodies in inertial axes take 3 times less than method 3"
    assert paper_mass._verdict([good], good) == f"holds; {later}"
    assert paper_mass._verdict([slow], good).startswith("does not hold for method 2, lower triangle on T1 of n = 40;")


def test_the_exponent_is_that_of_a_power_law():
    found = [Race("T1", "M", n, dict.fromkeys(paper_mass.METHODS, 3.0 * n**2)) for n in (4, 10, 20)]
    assert [row.value for row in paper_mass._exponents(found)] == [pytest.approx(2.0)] * len(paper_mass.METHODS)


def need(error, situation="bare", **evaluations):
    return paper_methods.Need(situation, error, evaluations)


def test_rk4_is_enough_down_to_the_first_error_at_which_rk10_is_cheaper_on_any_arm():
    coarse, fine = need(1e-2, RK2=9.0, RK4=1.0, RK10=2.0), need(1e-3, RK2=99.0, RK4=6.0, RK10=2.0)
    assert paper_methods._of_tenth([coarse], 1) == "holds"
    found = paper_methods._of_tenth([coarse, need(1e-3, RK2=9.0, RK4=1.0, RK10=2.0), fine], 2)
    assert (
        found == "holds down to errors of 0.01 of the motion; at 0.001 RK10 is cheaper on 1 of 2 arms, by up to 3 times"
    )
    assert paper_methods._of_tenth([fine], 1).startswith("does not hold: ")
    assert paper_methods._of_tenth([need(1e-2, RK2=9.0, RK4=np.inf, RK10=np.inf)], 1).startswith("does not hold: ")


def test_rk4_and_rk10_are_each_held_against_rk2():
    bare, damped = need(1e-2, RK2=3.0, RK4=2.0, RK10=4.0), need(1e-2, "damped", RK2=2.0, RK4=3.0, RK10=1.0)
    assert paper_methods._of_second([bare], "RK4") == "holds"
    assert paper_methods._of_second([bare, damped], "RK4") == (
        "holds for arms: bare; not for all: damped (in 1 of 1 pairs of arm and error it takes more, up to 1.5 times)"
    )
    assert paper_methods._of_second([damped], "RK4").startswith("does not hold: ")
    assert paper_methods._of_second([damped], "RK10") == "holds"
    assert paper_methods._of_second([bare], "RK10").startswith("does not hold: bare ")


def test_an_arm_is_judged_by_all_three_methods_against_a_better_reference():
    found = measured(
        "paper_methods", segments=[2], types={"T1": "z"}, errors=[1e-3], halvings={"RK2": 0, "RK4": 1, "RK10": 0},
        situation={"short": {"run.duration": 0.02, "run.sample": 0.01}},
    )  # fmt: skip
    assert {each.varied["method"] for each in found["RK4 / rival"]} == {"RK2", "RK10"}
    claims = [each.varied["claim"] for each in found["claim on RK2"]]
    assert claims == ["RK4 is more efficient than RK2", "RK10 is more efficient than RK2"]
    assert found["claim"][0].value == found["error at the largest step"][0].value < 1e-2
    assert found["own error / smallest aim"][0].value < 0.1


def test_segments_that_make_the_error_larger_are_named():
    prices = [paper_segments.Price("arm", *each) for each in ((2, 4.0, 1.0), (3, 5.0, 2.0), (4, 1.0, 8.0))]
    said = paper_segments._verdict(prices, {"arm": paper_segments._gain(prices)})
    assert said == "holds but for 3 segments on arm, less precise than 2; arm, 2 to 4 segments: error ÷ 4, cost × 8"


def test_the_title_of_a_case_is_not_the_claim_that_it_judges():
    claims = {case.name: (case.title, case.claim) for case in load_cases(*ALL) if CLAIM in case.quantity}
    assert len(claims) >= 13
    for name, (title, claim) in claims.items():
        assert claim, f"{name}: its quantity `claim` judges none"
        assert claim.partition(":")[0] not in title, f"{name}: passes with a title that its numbers may refute"


def test_a_row_that_judges_a_claim_says_it():
    (case,) = load_cases("paper_springs")
    said = judged(case, Measured("claim", 0.0, note="holds"), 0.0, "k").varied
    assert said == {"claim": "T_FL is T_GC with gravity taken as zero"}
    assert judged(case, Measured("T_GC / T_FL", 0.0), 0.0, "k").varied == {}


# the page


@pytest.fixture
def results(tmp_path):
    claims = [
        row(
            f"paper_{k}",
            kind="paper_types",
            title=f"claim {k}",
            quantity="claim",
            note=note,
            tolerance=None,
            value=float(k),
        )
        for k, note in enumerate(("holds; more", "holds for T1", "does not hold"))
    ]
    return stored(tmp_path / "results", *claims)


def test_every_claim_has_a_line_with_its_number_and_its_verdict(results):
    (found,) = paper_claims.find(Results.read(results))
    assert found.lines[1] == ("confirmed within limits", "“claim 1”", "for T1", "1: max |Δ|")
    assert found.classes == ("pass", "doubt", "fail")
    assert found.sentences[0] == "3 claims: 1 confirmed, 1 confirmed within limits, 1 refuted."


def test_a_claim_that_two_cases_judge_stands_once_by_the_one_with_more_arms(tmp_path):
    rows = [
        row(f"paper_{arms}", kind="paper_methods", quantity="claim", varied={"claim": "RK4 is enough", "arms": arms},
            note=f"holds on {arms}", tolerance=None)
        for arms in (18, 81)
    ]  # fmt: skip
    (found,) = paper_claims.find(Results.read(stored(tmp_path / "results", *rows)))
    assert [(line[1], line[2]) for line in found.lines] == [("“RK4 is enough”", "on 81")]


@pytest.mark.parametrize(("note", "word", "look"), [
    ("holds", "confirmed", "pass"), ("holds for T1; not for T3", "confirmed within limits", "doubt"),
    ("does not hold", "refuted", "doubt"),
])  # fmt: skip
def test_a_case_whose_checks_pass_is_not_green_where_they_refute_the_claim(tmp_path, note, word, look):
    claim = row(kind="paper_types", quantity="claim", note=note, tolerance=None)
    page = words_from(stored(tmp_path / "results", row(kind="paper_types"), claim), tmp_path)
    assert f'<details class="case {look}"><summary><span class="state">{word}</span>' in page


@pytest.mark.slow
def test_a_table_that_is_the_answer_stands_unfolded(results, tmp_path):
    page = words_from(results, tmp_path)
    assert "<details open><summary>Table (3 lines)" in page
