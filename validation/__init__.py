"""The validation study: cases (data) → kinds (how to measure) → store (what came out). Run: python -m validation.

A new case is a TOML file in `cases/`: scenes from `models/` or `scenes/`, a kind, the kind's settings, and per
quantity a metric, a tolerance and the reason for it. A new way to measure is a file in `kinds/`: it is found by being
there. The study reads its cases and scenes from a checkout of the project.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before NumPy: a process a core; threads that wait for each other spin
