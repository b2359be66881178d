"""The tests as other computers: BLAS, NumPy and our own kernels of other CPUs, other Pythons, less of a machine.

    python -m tests.machines                 the whole suite as every one of them
    python -m tests.machines --quick         those of .ci/run, with few of all fast tests
    python -m tests.machines noise           a CPU that nobody has: what hangs on rounding fails there first
    python -m tests.machines oldest -- -x    one of them; after -- what pytest takes

Machines are data (`machines.toml`). What this computer cannot be, an AVX-512 server without AVX-512, or a Python that
is not installed, is skipped and said.
"""
