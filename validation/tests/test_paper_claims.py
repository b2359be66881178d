"""The paper's claims: measurements decide the verdict, and the page shows it for every claim."""

import re

import numpy as np
import pytest

from flexlink.describe.spec import decode
from flexlink.pages.numbers import JOIN
from reports.findings.paper import order_conditions, paper_claims
from reports.results import Results
from tests.support.words import reviewed
from validation.case import ALL, CLAIM, Measured, load_cases
from validation.kinds import KINDS, paper_costs, paper_methods
from validation.kinds.paper_equations import _types_verdict as _verdict
from validation.measuring import judged
from validation.speed.races import Race
from validation.tests.studies import row, stored, words_from


def measured(name, **changes):
    """Rows of a case by quantity, with other settings."""
    (case,) = load_cases(name)
    settings = decode(case.settings | changes, KINDS[case.kind].settings)
    found = {}
    for each in KINDS[case.kind].measurements(case, settings):
        found.setdefault(getattr(each, "quantity", "series"), []).append(each)
    return found


def test_a_type_with_too_small_an_accuracy_gain_is_named():
    assert _verdict({"T1, arm": 2.5}) == "holds"
    below, worse = _verdict({"T1, arm": 1.25, "T2, arm": 3.0}), _verdict({"T1, arm": 0.8})
    assert below.startswith("holds ") and below.endswith("T1, arm 1.25")
    assert not worse.startswith("holds") and worse.endswith("T1, arm 0.8")
    reviewed("paper claims: types", below)
    reviewed("paper claims: types", worse)


def test_rounding_equals_the_step_error_where_both_lines_cross():
    errors = [paper_methods.Errors(h, h**4, 1e-16) for h in (1e-2, 1e-3)]
    assert paper_methods._meeting(errors, 4) == pytest.approx(1e-4)


def times(**by_method):
    names = dict(zip(("one", "two", "three", "later"), paper_costs.METHODS, strict=True))
    return Race("T1", "M", 40, {names[name]: value for name, value in by_method.items()})


def test_a_mass_matrix_method_slower_than_the_previous_one_is_named():
    good, slow = times(one=9.0, two=6.0, three=3.0, later=1.0), times(one=9.0, two=12.0, three=3.0, later=1.0)
    held, broken = paper_costs._mass_verdict([good], good), paper_costs._mass_verdict([slow], good)
    assert held.startswith("holds;") and not broken.startswith("holds")
    assert all(part in held for part in ("n = 40", " 3 times", "method 3"))
    assert all(part in broken for part in ("method 2", "n = 40", "T1"))
    reviewed("paper claims: mass matrix", held)
    reviewed("paper claims: mass matrix", broken)


def test_the_exponent_of_a_power_law_is_found():
    found = [Race("T1", "M", n, dict.fromkeys(paper_costs.METHODS, 3.0 * n**2)) for n in (4, 10, 20)]
    assert [row.value for row in paper_costs._exponents(found)] == [pytest.approx(2.0)] * len(paper_costs.METHODS)


def need(error, situation="bare", **evaluations):
    return paper_methods.Need(situation, error, evaluations)


def test_the_verdict_names_the_first_error_at_which_rk10_is_cheaper():
    coarse, fine = need(1e-2, RK2=9.0, RK4=1.0, RK10=2.0), need(1e-3, RK2=99.0, RK4=6.0, RK10=2.0)
    assert paper_methods._of_tenth([coarse], 1) == "holds"
    found = paper_methods._of_tenth([coarse, need(1e-3, RK2=9.0, RK4=1.0, RK10=2.0), fine], 2)
    assert found.startswith("holds ")
    assert all(part in found for part in (" 0.01 ", " 0.001 RK10 ", "1 of 2", "3 times"))
    reviewed("paper claims: RK10", found)
    for broken in (fine, need(1e-2, RK2=9.0, RK4=np.inf, RK10=np.inf)):
        text = paper_methods._of_tenth([broken], 1)
        assert not text.startswith("holds")
        reviewed("paper claims: RK10", text)


def test_rk4_and_rk10_are_each_compared_with_rk2():
    bare, damped = need(1e-2, RK2=3.0, RK4=2.0, RK10=4.0), need(1e-2, "damped", RK2=2.0, RK4=3.0, RK10=1.0)
    assert paper_methods._of_second([bare], "RK4") == "holds"
    verdicts = {
        "both": paper_methods._of_second([bare, damped], "RK4"), "damped": paper_methods._of_second([damped], "RK4"),
        "bare": paper_methods._of_second([bare], "RK10"),
    }  # fmt: skip
    assert [text.startswith("holds ") for text in verdicts.values()] == [True, False, False]
    assert all(part in verdicts["both"] for part in ("bare", "damped", "1 of 1", "1.5 times"))
    assert all(arm in text for arm, text in list(verdicts.items())[1:])
    for text in verdicts.values():
        reviewed("paper claims: RK2", text)
    assert paper_methods._of_second([damped], "RK10") == "holds"


def test_all_three_methods_are_compared_with_a_more_precise_reference():
    found = measured(
        "paper_methods", segments=[2], types={"T1": "z"}, errors=[1e-3], halvings={"RK2": 0, "RK4": 1, "RK10": 0},
        situation={"short": {"run.duration": 0.02, "run.sample": 0.01}},
    )  # fmt: skip
    assert {each.varied["method"] for each in found["RK4 / rival"]} == {"RK2", "RK10"}
    claims = [each.varied["claim"] for each in found["claim on RK2"]]
    assert [claim.split()[0] for claim in claims] == ["RK4", "RK10"]
    assert all(claim.endswith(" RK2") for claim in claims)
    for claim in claims:
        reviewed("paper claims: claim", claim)
    largest, (own,) = found["error at the largest step"], found["own error / smallest aim"]
    assert found["claim"][0].value == largest[0].value < 1e-2
    assert own.value < 0.1


def test_segments_that_make_the_error_larger_are_named():
    prices = [paper_costs.Price("arm", *each) for each in ((2, 4.0, 1.0), (3, 5.0, 2.0), (4, 1.0, 8.0))]
    verdict = paper_costs._segments_verdict(prices, {"arm": paper_costs._gain(prices)})
    assert verdict.startswith("holds ") and "error ÷ 4" in verdict and "cost × 8" in verdict
    reviewed("paper claims: segments", verdict)


def test_the_title_of_a_case_does_not_repeat_its_claim():
    claims = {case.name: (case.title, case.claim) for case in load_cases(*ALL) if CLAIM in case.quantity}
    assert len(claims) >= 13
    for name, (title, claim) in claims.items():
        assert claim, f"{name}: no claim is checked by its quantity `claim`"
        assert claim.partition(":")[0] not in title, f"{name}: the title repeats the claim, which may be refuted"


def test_a_row_about_a_claim_contains_the_claim():
    (case,) = load_cases("paper_springs")
    varied = judged(case, Measured("claim", 0.0, note="holds"), 0.0, "k").varied
    assert varied == {"claim": case.claim}
    assert judged(case, Measured("T_GC / T_FL", 0.0), 0.0, "k").varied == {}


@pytest.fixture
def results(tmp_path):
    claims = [
        row(
            f"paper_{k}", kind="paper_types", title=f"claim {k}", quantity=quantity, note=note, tolerance=None,
            value=float(k),
        )
        for k, (quantity, note) in enumerate((
            ("claim", "holds; more"), ("claim on RK2", "holds for T1"), ("claim", "does not hold"), ("no claim", ""),
        ))
    ]  # fmt: skip
    return stored(tmp_path / "results", *claims)


def test_every_claim_has_a_line_with_number_and_verdict(results):
    (found,) = paper_claims(Results.read(results))
    assert found.lines[1][0].split() == ["confirmed", "within", "limits"]
    assert found.lines[1][1:] == ("“claim 1”", "for T1", "1: max |Δ|")
    assert found.classes == ("pass", "doubt", "fail")
    assert [int(number) for number in re.findall(r"\d+", found.sentences[0])] == [3, 1, 1, 1]
    reviewed("paper claims: verdicts", found.sentences[0])


def test_a_claim_of_two_cases_has_the_verdict_of_the_case_with_more_arms(tmp_path):
    rows = [
        row(f"paper_{arms}", kind="paper_methods", quantity="claim", varied={"claim": "RK4 suffices", "arms": arms},
            note=f"holds on {arms}", tolerance=None)
        for arms in (18, 81)
    ]  # fmt: skip
    (found,) = paper_claims(Results.read(stored(tmp_path / "results", *rows)))
    assert [(line[1], line[2]) for line in found.lines] == [("“RK4 suffices”", "on 81")]


@pytest.mark.parametrize(("note", "word", "look"), [
    ("holds", "confirmed", "pass"), ("holds for T1; not for T3", "confirmed within limits", "doubt"),
    ("does not hold", "refuted", "doubt"), ("no: the opposite holds", "refuted", "doubt"),
    ("holds|does not hold", "confirmed; refuted", "doubt"),
])  # fmt: skip
def test_a_passed_case_is_not_green_if_it_refutes_the_claim(tmp_path, note, word, look):
    notes = note.split("|")
    claims = [row(kind="paper_types", quantity="claim", note=each, tolerance=None) for each in notes]
    page = words_from(stored(tmp_path / "results", row(kind="paper_types"), *claims), tmp_path)
    state = f'<details class="case {look}"><summary><span class="state">{word}</span>'
    assert state in page


def test_order_conditions_are_summed_up_by_the_largest_residual_met_and_the_smallest_of_the_next_order(tmp_path):
    residuals = {"RK2": (1e-16, 0.2), "RK4": (3e-15, 0.004), "RK10": (2e-16, None), "Gauss6": (None, 0.05)}
    rows = [
        row("orders", value, kind="order_conditions", quantity=quantity, varied={"method": method})
        for method, values in residuals.items()
        for quantity, value in zip(("residual", "residual one order above"), values, strict=True)
    ]
    (found,) = order_conditions(Results.read(stored(tmp_path, *rows)))
    assert found.lines == tuple((method, *values) for method, values in residuals.items())
    assert re.findall(r"3 × 10⁻¹⁵|\b0\.\d+", found.sentences[0].replace(JOIN, " ")) == ["3 × 10⁻¹⁵", "0.004"]


@pytest.mark.slow
def test_a_table_that_answers_the_question_is_unfolded(results, tmp_path):
    page = words_from(results, tmp_path)
    unfolded = re.compile(r"<details open><summary>[^<]*\(3 ")
    assert unfolded.search(page)
