"""Pictures of pages are shortened without a visible change."""

from flexlink.pages.picture import _short


def test_coordinates_keep_a_tenth_and_lines_one_letter() -> None:
    """After M, more points are lines; a curve keeps its letters."""
    assert _short("M 10.123456 -2.04 L 3.9 4 \nL 5.32 6.71 ") == "M 10.1 -2.0 3.9 4 5.3 6.7"
    assert _short("M 1.11 2.22 \nC 3 4 5 6 7.04 8 L 9.0123 0") == "M 1.1 2.2 \nC 3 4 5 6 7.0 8 L 9.0 0"
