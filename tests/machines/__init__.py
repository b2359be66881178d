"""Run the tests as on other computers: BLAS, NumPy and flexlink kernels of other CPUs, other Pythons, fewer resources.

    python -m tests.machines                 the full suite on every machine
    python -m tests.machines --quick         the machines of .ci/run, with a selection of fast tests
    python -m tests.machines noise           a fictitious CPU, on which tests that depend on rounding fail first
    python -m tests.machines oldest -- -x    one machine; options of pytest after --

Machines are data (`machines.toml`). A machine that this computer cannot emulate (AVX-512 without AVX-512, a Python
that is not installed) is skipped, with a message.
"""
