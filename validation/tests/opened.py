"""python validation/tests/opened.py CASE …: what cases use when they run, to compare with the dependencies found.

Prints the modules of the project that are loaded and the data files that are opened, one path a line. All cases must be
of one kind; no other kind is imported.
"""

import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def main(names: list[str]) -> None:
    """Run the cases, watched."""
    opened = set[Path]()

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str) and arguments[0].startswith(str(ROOT)):
            opened.add(Path(arguments[0]).resolve())

    sys.addaudithook(watch)
    import validation.case as cases  # noqa: PLC0415  watched

    wanted = cases.load_cases(*names)
    kinds = {case.kind for case in (*wanted, *sheets_of(wanted, cases.load_cases()))}
    modules = {cases.module_of(kind).rpartition(".")[2] for kind in kinds}
    every = pkgutil.iter_modules

    def only_these(path: Any = None, prefix: str = "") -> Iterator[pkgutil.ModuleInfo]:
        kinds_of_study = path is not None and any(str(each).endswith("kinds") for each in path)
        return (info for info in every(path, prefix) if not kinds_of_study or info.name in modules)

    pkgutil.iter_modules = only_these  # type: ignore[assignment]
    from validation.measuring import measure  # noqa: PLC0415  after the choice of kinds

    opened.clear()  # the files of all cases were opened to choose among them
    for case in wanted:
        for _ in measure(case, ""):
            pass
    loaded = {
        Path(file).resolve() for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))
    }
    for path in sorted(path for path in loaded | opened if path.is_relative_to(ROOT)):
        print(path.relative_to(ROOT).as_posix())


def sheets_of(wanted: list[Any], known: list[Any]) -> list[Any]:
    """The cases whose kinds a case that writes data sheets uses."""
    return [case for case in known if case.sheet and any(each.kind == "data_sheets" for each in wanted)]


if __name__ == "__main__":
    main(sys.argv[1:])
