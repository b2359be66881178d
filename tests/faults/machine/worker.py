"""Worker process: python -m tests.faults.machine.worker FILE, a JSON file of mutants; prints their outcomes."""

import json
import os
import sys
from pathlib import Path

from flexlink import load_scene, simulate
from tests.faults.machine.apart import judge_apart
from tests.faults.machine.generator import Mutant
from tests.faults.machine.judge import APART, Session, record, test_files, with_tests
from tests.faults.machine.recording import Recorded
from tests.faults.machine.run import plan
from tests.faults.machine.swap import forget
from tests.faults.plant import ROOT, copied

WARM = "computed_torque.toml", "dual_arm.toml", "gantry.toml", "paper_fig5.toml"
CACHE = ROOT / ".faults_cache"


def main(file: str) -> None:
    """Test all mutants of a file."""
    mutants = [Mutant(*each) for each in json.loads(Path(file).read_text(encoding="utf-8"))]
    output = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # pytest prints dots
    as_python = bool(os.environ.get("NUMBA_DISABLE_JIT"))
    recorded = Recorded(CACHE / ("python.json" if as_python else "fast.json"), plan().slow)
    files = list(plan().python) if as_python else test_files()

    def report(text: str) -> None:
        print(text, file=output, flush=True)

    def work(session: Session) -> None:
        if not as_python:  # load machine code here once instead of in every fork
            for scene in WARM:
                simulate(load_scene(ROOT / "models" / scene))
            forget()
        record(session, recorded, report)
        by_function = recorded.by_function()
        with copied() as copy:
            for number, mutant in enumerate(mutants):
                judged = session.judge(mutant, by_function)
                if judged.outcome == APART:
                    judged = judge_apart(copy, mutant, by_function)
                report(json.dumps([number, *judged[1:]]))

    unknown = [name for name in files if not recorded.knows(name)]
    mutated = {mutant.file for mutant in mutants}
    relevant = {ran.test.partition("::")[0] for ran in recorded if any(file in mutated for file, _ in ran.functions)}
    with_tests(sorted({*unknown, *(relevant & set(files))}), work, plan().slow)


if __name__ == "__main__":
    main(sys.argv[1])
