"""flexarm-bench: published beams and motions of arms with flexible links, and a judge of the solvers that compute them.

A solver is `run(case, settings)`: it gets one `Case`, without its reference, and returns an array.
"""

from flexarm_bench.benchmark import Benchmark, load_benchmarks
from flexarm_bench.case import Answer, BenchError, Cannot, Case, Link, Pulse, SpinUp
from flexarm_bench.judge import Verdict, judge

__all__ = [
    "Answer",
    "BenchError",
    "Benchmark",
    "Cannot",
    "Case",
    "Link",
    "Pulse",
    "SpinUp",
    "Verdict",
    "judge",
    "load_benchmarks",
]
