"""All that was measured, by what it is for."""

from __future__ import annotations

from flexlink.common.errors import DataFileError, SceneError
from flexlink.identification.problem import FitProblem, Use
from flexlink.identification.recorded import Recorded, recorded
from flexlink.identification.single import Sagged, Tapped

Source = Recorded | Tapped | Sagged


def sources_of(problem: FitProblem, use: Use) -> list[Source]:
    """What was measured, and is used so.

    Raises
    ------
    DataFileError, SceneError
        A file or its columns, or what a run sets, are wrong; the message names the run.
    """
    found: list[Source] = []
    for run in problem.run:
        if run.use == use:
            try:
                found.append(recorded(problem, run))
            except (DataFileError, SceneError) as error:
                said = str(error)
                raise type(error)(said if said.startswith("run ") else f"run {run.name!r}: {said}") from None
    found += [Tapped(problem, one, k) for k, one in enumerate(problem.modes, 1) if one.use == use]
    found += [Sagged(problem, one, k) for k, one in enumerate(problem.static, 1) if one.use == use]
    return found
