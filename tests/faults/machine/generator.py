"""Generate mutants: all that `operators` can make in a file, and a reproducible random sample of them."""

import ast
import hashlib
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

from tests.faults.machine.operators import changes
from tests.faults.plant import ROOT

TREES = ("flexlink", "validation", "reports")
SPOKEN = frozenset({"__repr__", "__str__", "_repr_html_", "_repr_png_"})
"""Functions that only display results; they are not mutated."""
SHOWN = frozenset({
    "alpha", "bbox_to_anchor", "bottom", "color", "dpi", "elinewidth", "figsize", "fontsize", "height", "labelpad",
    "left", "lw", "linewidth", "loc", "markersize", "markeredgewidth", "ms", "pad", "right", "rotation", "stacklevel",
    "top", "width", "zorder", "decimals", "digits", "maxsize", "size",
})  # fmt: skip
"""Keywords that affect only presentation or memory use."""
NON_NUMERIC = frozenset({"Memo", "lru_cache", "numbered", "warn", "cast", "TypeVar", "NewType", "print", "Gauge"})
"""Calls whose arguments are messages, types, names or memory sizes."""
NUMBERS = frozenset({"constant", "count", "factor", "sign"})
NOT_HERE = "__init__.py", "__main__.py", "drake*.py", "exudyn*.py"
"""Files that are commands, or that run only with the extra `witness`."""
DRAWN = ("flexlink/pages", "flexlink/results/pictures", "reports", "reports/figures")
"""Folders whose numbers are positions in drawings; only logic is mutated there."""


class Mutant(NamedTuple):
    """One mutant: bytes `start` to `end` change from `was` to `becomes`."""

    file: str
    line: int
    where: str  # enclosing function; empty: module or class level
    kind: str
    was: str
    becomes: str
    start: int
    end: int
    again: int  # number of identical mutants before this one in the same function

    @property
    def key(self) -> str:
        """Name of the mutant, which does not depend on line numbers."""
        return f"{self.file}|{self.where}|{self.kind}|{self.was}|{self.becomes}|{self.again}"

    @property
    def room(self) -> str:
        """Folder of the file."""
        return str(Path(self.file).parent)

    def planted(self, source: bytes) -> bytes:
        """Mutated source, with an unchanged number of lines."""
        gone = source[self.start : self.end].count(b"\n")
        planted = " ".join(line.strip() for line in self.becomes.split("\n"))
        rest = source[self.end :]
        head, newline, tail = rest.partition(b"\n")  # preserve the line numbers of later functions
        return source[: self.start] + planted.encode() + head + b"\n" * gone + newline + tail

    def __str__(self) -> str:
        was, becomes = (" ".join(text.split()) for text in (self.was, self.becomes))
        return f"{self.file}:{self.line} {was} → {becomes}"


def files(root: Path = ROOT) -> list[str]:
    """Source files to mutate."""
    paths = itertools.chain.from_iterable((root / tree).rglob("*.py") for tree in TREES)
    here = (path for path in paths if not any(fnmatch(path.name, pattern) for pattern in NOT_HERE))
    names = (path.relative_to(root).as_posix() for path in here)
    return sorted(name for name in names if not name.startswith("validation/tests/"))


def mutants(file: str, source: bytes) -> list[Mutant]:
    """All candidate mutants of a file (`is_python` checks whether each is valid Python)."""
    offsets = [0, *itertools.accumulate(len(line) for line in source.splitlines(keepends=True))]

    def place(node: ast.AST) -> tuple[int, int]:
        start, end = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]
        return offsets[start[0] - 1] + start[1], offsets[end[0] - 1] + end[1]

    def text(node: ast.AST) -> str:
        start, end = place(node)
        return source[start:end].decode()

    found: list[Mutant] = []
    seen: Counter[tuple[str, ...]] = Counter()
    for node, where, returns in visited(ast.parse(source)):
        for kind, changed, becomes in changes(node, text, returns):
            if kind in NUMBERS and str(Path(file).parent) in DRAWN:
                continue
            name = where, kind, text(changed), becomes
            mutant = Mutant(file, changed.lineno, *name, *place(changed), seen[name])  # type: ignore[attr-defined]
            seen[name] += 1
            found.append(mutant)
    return found


def is_python(mutant: Mutant, source: bytes) -> bool:
    """Return whether the mutated file is valid Python whose syntax tree differs from the original."""
    try:
        return ast.dump(ast.parse(mutant.planted(source))) != ast.dump(ast.parse(source))
    except SyntaxError:
        return False


Place = tuple[ast.AST, str, "ast.expr | None"]


def visited(tree: ast.Module) -> Iterator[Place]:
    """Nodes that may be mutated, each with its function and the function's return annotation."""
    return _walk(tree, "", None, False)


def _walk(node: ast.AST, where: str, returns: ast.expr | None, inside: bool) -> Iterator[Place]:
    match node:
        case ast.FunctionDef(name) | ast.AsyncFunctionDef(name):
            outer = where if inside else f"{where}.{name}".lstrip(".")
            defaults = filter(None, (*node.args.defaults, *node.args.kw_defaults))
            parts = [(part, where, inside) for part in defaults] + [(part, outer, True) for part in node.body]
            for part, of, within in parts if name not in SPOKEN else ():
                yield from _walk(part, of, node.returns, within)
        case ast.ClassDef(name):
            for statement in node.body:
                yield from _walk(statement, where if inside else f"{where}.{name}".lstrip("."), None, inside)
        case ast.AnnAssign(value=value):
            yield from _walk(value, where, returns, inside) if value is not None else ()
        case _ if not _computes_nothing(node):
            yield node, where if inside else "", returns
            for child in ast.iter_child_nodes(node):
                yield from _walk(child, where, returns, inside)


def _computes_nothing(node: ast.AST) -> bool:
    """Return whether the node computes nothing: a message, a type, a name or the style of a figure."""
    match node:
        case ast.Expr(ast.Call(ast.Attribute(ast.Name("axes" | "figure" | "ax")))):
            return True
        case ast.Raise() | ast.JoinedStr() | ast.Assert() | ast.Import() | ast.ImportFrom():
            return True
        case ast.If(ast.Name("TYPE_CHECKING") | ast.Compare(ast.Name("__name__"))) | ast.Assign([ast.Name("__all__")]):
            return True
        case ast.Call(ast.Name(name) | ast.Attribute(_, name)):
            return name in NON_NUMERIC
        case ast.keyword(arg):
            return arg in SHOWN
    return False


def drawn(rooms: Sequence[str], seed: int, most: int, left_out: frozenset[str], root: Path = ROOT) -> list[Mutant]:
    """Select up to `most` mutants per folder, spread over its files: those with the lowest hashes of seed and name.

    Hashes make the selection independent of changes elsewhere in the file or in other files.
    """
    by_room = defaultdict(list)
    for file in files(root):
        room = str(Path(file).parent)
        if any(fnmatch(room, pattern) or fnmatch(file, pattern) for pattern in rooms or ("*",)):
            by_room[room].append(file)
    chosen = []
    for each in by_room.values():
        ranked = [_ranked(file, seed, left_out, root) for file in each]
        rounds = itertools.zip_longest(*sorted(filter(None, ranked)))
        order = (mutant for *_, mutant in filter(None, itertools.chain.from_iterable(rounds)))
        possible = (mutant for mutant in order if is_python(mutant, (root / mutant.file).read_bytes()))
        chosen += itertools.islice(possible, most)
    return chosen


def _ranked(file: str, seed: int, left_out: frozenset[str], root: Path) -> list[tuple[int, str, Mutant]]:
    """Mutants of a file sorted by hash, the first of each kind before the second of any kind."""
    made = [mutant for mutant in mutants(file, (root / file).read_bytes()) if mutant.key not in left_out]
    hashed = sorted((hashlib.sha256(f"{seed}|{mutant.key}".encode()).hexdigest(), mutant) for mutant in made)
    before: Counter[str] = Counter()
    ranked = []
    for digest, mutant in hashed:
        ranked.append((before[mutant.kind], digest, mutant))
        before[mutant.kind] += 1
    return sorted(ranked)
