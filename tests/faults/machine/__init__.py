"""Faults made by machine: small mistakes at random places of every room, and the share that the tests notice.

    python -m tests.faults --machine                          every room, as many as `machine.toml` says
    python -m tests.faults --machine flexlink/dynamics/sensors         one room; a file; a glob
    python -m tests.faults --machine --seed 7 --most 3        other mistakes, fewer

`operators` says which mistakes there are, `generator` finds and draws them, `recording` which tests run a function,
`judge` puts a mistake into a running process and runs them. The seed, how many a room and which mean the same stand in
`machine.toml`, what came out in `judged.toml`.
"""
