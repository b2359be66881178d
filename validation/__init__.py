"""The validation study: cases (data) → kinds (how to measure) → store (results). Run: python -m validation.

A new case is a TOML file in `cases/`: scenes from `models/` or `scenes/`, a kind, its settings, and a metric, a
tolerance and a reason for each quantity. A new way to measure is a generator in `kinds/`, where it is found.
The study reads its cases and scenes from a checkout of the project.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one thread, set before NumPy is imported: the study runs a process per core
