"""Test matrix: every claim that must be true for any arm is tested for every feature of an arm.

`chains/*.toml` are the arms, one scene each; a new file there is a new column. Functions of a `Case` in `states.py`,
`runs.py`, `rest.py`, `files.py` and `public.py` are the claims; a new function there is a new row.
`expected.toml` lists the cells that are refused, with the error ids. `test_matrix.py` makes one test per cell.
"""
