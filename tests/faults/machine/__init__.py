"""Automatic mutation testing: small mistakes at random places in every folder, and the fraction that tests detect.

    python -m tests.faults --machine                          every folder, as many mutants as `machine.toml` gives
    python -m tests.faults --machine flexlink/dynamics/sensors         one folder; a file; a glob
    python -m tests.faults --machine --seed 7 --most 3        other mutants, fewer of them

`operators` defines the mutations, `generator` finds and samples them, `recording` finds the tests that run a function,
`judge` applies a mutation in a running process and runs the tests. `machine.toml` contains the seed, the number per
folder and equivalent mutants. `judged.toml` contains the results.
"""
