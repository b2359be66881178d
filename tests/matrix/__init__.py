"""Test matrix: every feature of an arm × every claim that is true of any arm.

`chains/*.toml` are the arms, one scene each; a new file there is a new column. Functions of a `Case` in `states.py`,
`runs.py`, `rest.py`, `files.py` and `public.py` are the claims; a new function there is a new row.
`expected.toml` lists the cells that are refused, and the messages. `../test_matrix.py` makes one test per cell.
"""
