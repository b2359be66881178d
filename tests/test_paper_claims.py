"""The paper's claims: what is measured decides the verdict, and the page says it claim by claim."""

import pytest
from studies import row, stored, words_from

from flexlink.describe.spec import decode
from reports.findings import paper_claims
from reports.results import Results
from validation.case import load_cases
from validation.kinds import KINDS
from validation.kinds.paper_equations import _of_springs
from validation.kinds.paper_types import _verdict


def measured(name, **changes):
    """Quantity → rows of a case, with other settings."""
    (case,) = load_cases(name)
    kind = KINDS[case.kind]
    found = {}
    for each in kind.run(case, decode(case.settings | changes, kind.Settings)):
        found.setdefault(getattr(each, "quantity", "series"), []).append(each)
    return found


def test_equation_1_counts_the_joints_of_every_arm():
    (claim,) = measured("paper_freedoms", links=3, segments=[2, 4])["claim"]
    assert (claim.value, claim.note, claim.varied["arms"]) == (0, "holds", 27)


def test_nothing_is_left_of_newton_euler_without_gravity_and_motion():
    assert measured("paper_springs", samples=2)["claim"][0].note.startswith("does not hold")
    assert _of_springs(1.0) == "holds"


def test_two_axes_of_a_group_that_coincide_make_the_mass_matrix_singular():
    found = measured("paper_definite", samples=3)
    assert found["claim"][0].note.startswith("holds for T1 and T2; not for T3")
    assert 0.0 < found["claim"][0].value < 1e-15 < min(each.value for each in found["least eigenvalue"])


def test_a_type_that_gains_nothing_somewhere_is_named():
    assert _verdict({}) == "holds"
    assert _verdict({"T1 on an arm": 1.25}) == "does not hold in general; gains below 2: T1 on an arm 1.25"


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
        for k, note in enumerate(("holds", "holds for T1", "does not hold"))
    ]
    return stored(tmp_path / "results", *claims)


def test_every_claim_has_a_line_with_its_number_and_its_verdict(results):
    (found,) = paper_claims.find(Results.read(results))
    assert found.lines[1] == ("claim 1", "1: max |Δ|", "holds for T1")
    assert found.sentences[0].endswith("as they stand: 1; within limits: 1; that do not hold: 1.")


@pytest.mark.slow
def test_a_table_that_is_the_answer_stands_unfolded(results, tmp_path):
    page = words_from(results, tmp_path)
    assert "<details open><summary>The table that this stands on (3 lines)" in page
