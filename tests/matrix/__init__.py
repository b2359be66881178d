"""Every feature of an arm × every claim that holds of any arm.

`chains/*.toml` are the arms, a scene each: another file there is another column. Functions of `states.py`, `runs.py`,
`rest.py`, `files.py` and `public.py` are the claims: another function there, of a `Case`, is another row.
`expected.toml` names what is refused, and in which words. `../test_matrix.py` makes a test of every cell.
"""
