"""One figure a file.

A module here says which chapter it belongs to (`SECTION`, an id of sections.toml), which stored series it takes
care of (`TAKES`, patterns of names; all others are drawn plainly) and has `draw(results) -> Iterator[Picture]`,
which yields nothing when the study holds nothing to draw. That is all: it is found by being here.
"""
