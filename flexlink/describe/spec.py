"""Base class of all descriptions, which are checked when built in Python, and decoded strictly from parsed TOML."""

import functools
import math
import operator
import re
import reprlib
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, TypeGuard, Union, cast, get_args, get_origin

import msgspec
import numpy as np

from flexlink.common.errors import ALSO, ArgumentError, Diagnostic, SceneError
from flexlink.common.types import T
from flexlink.common.wording import did_you_mean, missing, truncated
from flexlink.describe.expected import expected, kinds_of, why_not, words

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
SMALL, LARGE = 1e-30, 1e30
"""Range of scale factors and deviations; fourth powers of numbers divided by them then do not overflow float64."""
Deviation = Annotated[float, msgspec.Meta(ge=SMALL, le=LARGE)]
Vector3 = tuple[float, float, float]
ONE_PER_LINK = msgspec.Meta(extra={"one per": "link"})
"""Marks a list with one number per link, whose items have paths with a link's name or number."""


def measured_in(*units: str) -> msgspec.Meta:
    """Metadata with the unit of a number; for a joint's number two units, if it is an angle and if it is a length."""
    return msgspec.Meta(extra={"units": units})


PerLink = Annotated[tuple[float, ...], ONE_PER_LINK]
NonNegativePerLink = Annotated[tuple[NonNegative, ...], ONE_PER_LINK]
PositivePerLink = Annotated[tuple[Positive, ...], ONE_PER_LINK]

BRIEF = reprlib.Repr()
BRIEF.maxtuple = BRIEF.maxlist = BRIEF.maxdict = 6
BRIEF.maxstring, BRIEF.maxother = 60, 400

TOO_DEEP = "nested too deeply"

_thread = threading.local()
"""`validated`: whether the values of a description being built are checked already; `consistent`: also as a whole."""


def build_validated(make: Callable[..., T], *arguments: Any, **fields: Any) -> T:
    """Build a description from checked values; only their consistency is checked again."""
    before = getattr(_thread, "validated", False)
    _thread.validated = True
    try:
        return make(*arguments, **fields)
    finally:
        _thread.validated = before


def build_unchecked(make: Callable[..., T], *arguments: Any, **fields: Any) -> T:
    """Build a description of checked values that are known to be consistent."""
    _thread.consistent = True
    try:
        return build_validated(make, *arguments, **fields)
    finally:
        _thread.consistent = False


def is_unchecked() -> bool:
    """Whether the description being built is known to be consistent."""
    return getattr(_thread, "consistent", False)


class _Explained(msgspec.StructMeta):
    """Type of descriptions: unknown and missing arguments are explained as the keys of a file are."""

    if not TYPE_CHECKING:

        def __call__(self, *values: Any, **fields: Any) -> Any:
            try:
                return super().__call__(*values, **fields)
            except TypeError:
                known = fields_of(self)
                if values and isinstance(values[0], str) and values[0].endswith(".toml"):
                    text = f"{self.__name__}({values[0]!r}): fl.load_scene reads a file"
                    raise SceneError(text, id="wrong-type") from None
                required = [field.name for field in known if field.required] if not values else []
                for wrong in key_mistakes(fields, [field.name for field in known], required, self.__name__):
                    raise SceneError(wrong, id=wrong.id) from None
                raise

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.__setattr__ = _refuse_to_change


def _refuse_to_change(part: object, name: str, value: object) -> None:
    kind = type(part).__name__
    remedy = "scene.varied returns one with other values, such as scene.varied({'tip.mass': 2.0})"
    why = f"scenes and their parts cannot be changed in place; {remedy}"
    raise ArgumentError(f"{kind}.{name} = {truncated(value)}: {why}", id="unchangeable")


class Spec(
    msgspec.Struct, metaclass=_Explained, frozen=True, forbid_unknown_fields=True, kw_only=True, cache_hash=True
):
    """Frozen record whose fields are checked against their annotations, however it is built."""

    def __post_init__(self) -> None:
        if getattr(_thread, "validated", False):
            return
        for field in fields_of(type(self)):
            if getattr(self, field.name) is field.default:  # remains this object: notes recognise it
                continue
            try:
                value = to_builtin(getattr(self, field.name))
            except RecursionError:
                raise SceneError(f"{field.encode_name}: {TOO_DEEP}", id="nested-too-deeply") from None
            _check_finite(value, field.type, field.encode_name)
            try:
                kept = msgspec.convert(value, field.type)  # list to tuple, dict to Spec, int to float
            except msgspec.ValidationError as error:
                raise SceneError(_explain(value, field.type, field.encode_name, error)) from None
            msgspec.structs.force_setattr(self, field.name, kept)

    def _check_kind(self, what: str, kind: str, *never: str) -> None:
        """Check that all keys are given that a kind of `kinds_of` needs, and none that it, or no kind, takes."""
        needs, may, _ = kinds_of(what)[kind]
        known = [*dict.fromkeys(key for needed, others, _ in kinds_of(what).values() for key in (*needed, *others))]
        defaults = {field.encode_name: default_of(field) for field in fields_of(type(self))}
        takes = ", ".join(words()["form"].get(key, key) for key in (*needs, *may)) or f"none of {', '.join(known)}"
        for key in (*known, *never):
            value, taken = operator.attrgetter(key)(self), key in (*needs, *may)
            if value is None and key in needs:
                raise missing(key, f"kind {kind!r} takes {takes}")
            if value not in (None, defaults.get(key)) and not taken:
                raise self._refused(key, f"kind {kind!r} takes {takes}", "key-of-another-kind")

    def _refused(self, key: str, why: str, id: str) -> SceneError:
        """The error of the value of a key, also of one of a part, such as `to.axis`."""
        value = operator.attrgetter(key)(self)
        return SceneError(f"{key} = {repr(value) if isinstance(value, str) else truncated(value)}: {why}", id=id)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Name the part with the attribute, or with the key of a file, that this description lacks."""
            named = [(each.name, bare_type(each.type)) for each in fields_of(type(self)) if name[:1] != "_"]
            has = [f"; see {part}.{name}" for part, kind in named if is_record(kind) and hasattr(kind, name)]
            keys = [(part, f) for part, kind in named if is_record(kind) for f in fields_of(kind)]
            has += [f"; see {part}.{f.name}" for part, f in keys if f.encode_name == name]
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{''.join(has[:1])}")

    def __repr__(self) -> str:
        """Fields that differ from their defaults; long texts and tables are truncated."""
        fields = [
            f"{field.name}={BRIEF.repr(getattr(self, field.name))}"
            for field in msgspec.structs.fields(self)
            if getattr(self, field.name) != default_of(field)
        ]
        return f"{type(self).__name__}({', '.join(fields)})"


def default_of(field: msgspec.structs.FieldInfo) -> object:
    """Default value of a field; msgspec's NODEFAULT if the field is required."""
    factory = field.default_factory
    return field.default if factory is msgspec.NODEFAULT else factory()


@functools.cache
def fields_of(kind: type[msgspec.Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    """Fields of a record, cached because msgspec evaluates annotations in every call."""
    return msgspec.structs.fields(kind)


def to_builtin(value: object) -> object:
    """Convert NumPy numbers, strings and arrays, which msgspec does not accept, to built-in types, at any depth."""
    if isinstance(value, np.ndarray) or hasattr(type(value), "to_numpy"):  # also columns of pandas
        return to_builtin(np.asarray(value).tolist())
    if isinstance(value, np.generic):  # `item` alone would return a longdouble unchanged
        return float(value) if isinstance(value, np.floating) else value.item()
    if type(value) in {list, tuple}:
        return type(value)(to_builtin(item) for item in value)  # type: ignore[attr-defined, call-arg]
    return {to_builtin(key): to_builtin(item) for key, item in value.items()} if type(value) is dict else value


def decode(raw: object, kind: type[T] | Any, path: str = "", *, finite: bool = False) -> T:
    """Convert parsed TOML at a key path into a type; errors name the path, the value and what is allowed.

    `finite`: all numbers are known to be finite, and from a file.
    """
    try:
        if not finite:
            _check_finite(raw, kind, path)
    except RecursionError:
        raise SceneError(f"{path}: {TOO_DEEP}", id="nested-too-deeply") from None
    if get_origin(kind) is dict and isinstance(raw, dict):  # a table of named items: put the name into the path
        below = get_args(kind)[1]
        return {key: decode(item, below, f"{path}.{key}", finite=True) for key, item in raw.items()}  # type: ignore[return-value]
    try:
        return build_validated(msgspec.convert, raw, kind)  # type: ignore[no-any-return]
    except msgspec.ValidationError as error:
        raise SceneError(_explain(raw, kind, path, error)) from None


def _explain(raw: object, kind: Any, path: str, error: msgspec.ValidationError) -> Diagnostic:
    """Convert msgspec's "reason - at `$.path`" to a message with key path, value and what is allowed."""
    reason, _, tail = str(error).rpartition(" - at `$") if " - at `$" in str(error) else (str(error), "", "")
    value, below = cast("Any", raw), kind
    keys: list[Any] = []
    units = units_of(kind)
    for part in re.findall(r"\w+|\.\.\.", tail.rstrip("`")):
        if part == "...":  # msgspec does not name the key of a dict
            key = next(k for k, item in value.items() if mistakes(item, type_below(below, k)))
        else:
            key = int(part) if isinstance(value, list | tuple) else part
        keys.append(key)
        inner = type_below(below, key)
        units = units_of(inner) if isinstance(bare_type(below), type) else units  # the unit is marked on the whole list
        value, below = value[key], inner
    where, kind = path_to(keys, raw, kind, path), bare_type(below)
    if error.__cause__ is not None:  # the message of a nested Spec already names field, value and what is allowed
        return Diagnostic(f"{where}.{error.__cause__}".lstrip("."), getattr(error.__cause__, "id", ""))
    if (unknown := re.search(r"unknown field `(.*)`", reason)) and is_record(kind):
        return _unknown(unknown[1], value.get(unknown[1]), [field.encode_name for field in fields_of(kind)], where)
    if absent := re.search(r"missing required field `(.*)`", reason):
        return _missing(f"{where}.{absent[1]}".lstrip("."))
    wanted = expected(str(where), kind, value, reason, units)
    return Diagnostic(f"{where} = {truncated(value)}: {wanted}{why_not('', value)}".removeprefix(" = "), "wrong-value")


def check_keys(raw: Mapping[str, Any], allowed: Iterable[str], required: Iterable[str]) -> None:
    """Check the top-level keys of a parsed file."""
    for wrong in key_mistakes(raw, list(allowed), required):
        raise SceneError(wrong, id=wrong.id)


def key_mistakes(
    raw: Mapping[str, Any], allowed: Sequence[str], required: Iterable[str], path: str = ""
) -> Iterator[Diagnostic]:
    """Mistakes in the keys of a table at a path: first unknown keys, then missing ones."""
    yield from (_unknown(key, value, allowed, path) for key, value in raw.items() if key not in allowed)
    yield from (_missing(f"{path}.{key}".lstrip(".")) for key in required if key not in raw)


def _unknown(name: str, value: object, allowed: Sequence[str], where: str = "") -> Diagnostic:
    key = f"{where}.{name}".lstrip(".")
    near = did_you_mean(name, allowed)
    named = ": parameters are written below keys, [sample.keys]" if where == "sample" else why_not(name, value, near)
    reason = named or f": unknown key; allowed are {', '.join(allowed)}{near}"
    return Diagnostic(f"{key} = {truncated(value)}{reason}", "unknown-key")


def _missing(key: str) -> Diagnostic:
    how = words()["required"].get(key.rpartition(".")[2], "")
    return Diagnostic(f"{key}: missing; this key is required{how}", "missing-key")


def path_to(keys: Iterable[Any], value: Any, kind: Any, path: str = "") -> str:
    """Path of an item, as in `Scene.varied` and `--set`.

    Keys and indices lead from `value`, of a kind, at `path` to the item. Items of links, motions and lists of one
    number per link are given by the link's name, or its number from 1; items of other lists by an index in brackets.
    """
    for key in keys:
        if not isinstance(value, list | tuple):
            path += f".{key}"
        elif is_per_link(kind):
            path += f".{key + 1}"
        elif is_record(bare_type(type_below(kind, key))):
            path += f".{link_key([_link_name(item) for item in value], key)}"
        else:
            path += f"[{key}]"
        value, kind = value[key], type_below(kind, key)
    return path.lstrip(".")


@functools.cache
def is_per_link(kind: Any) -> bool:
    """Whether an annotation, or a member of a union, is marked by `ONE_PER_LINK`."""
    if get_origin(kind) is Annotated:
        inner, *marks = get_args(kind)
        return ONE_PER_LINK in marks or is_per_link(inner)
    return get_origin(kind) in {Union, UnionType} and any(map(is_per_link, get_args(kind)))


def units_of(kind: Any) -> tuple[str, ...]:
    """Units of an annotation, given by `measured_in`."""
    marks = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    extras = (mark.extra or {} for mark in marks if isinstance(mark, msgspec.Meta))
    return next((extra["units"] for extra in extras if "units" in extra), ())


def link_key(names: Sequence[object], k: int) -> str:
    """Part of a path for the link at index `k`: its name, in quotes if it has a dot, or else its number from 1."""
    name = names[k]
    if not isinstance(name, str) or not name or names.count(name) > 1 or re.search(r"[\"'*]", name):
        return str(k + 1)
    return f'"{name}"' if "." in name else name


def _link_name(item: Any) -> object:
    """Name in the table of a link or motion; None if it is not a table."""
    table = msgspec.structs.asdict(item) if isinstance(item, Spec) else item
    return table.get("name", table.get("link")) if isinstance(table, dict) else None


def is_record(kind: Any) -> TypeGuard[type[msgspec.Struct]]:
    """Whether a type is a description or another record, with fields."""
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


@functools.cache
def type_below(kind: Any, key: str) -> Any:
    """Annotation of `key` inside `kind`, one level down a key path."""
    kind = bare_type(kind)
    if is_record(kind):
        return next((f.type for f in fields_of(kind) if f.encode_name == key), None)
    inner = [a for a in get_args(kind) if a is not Ellipsis]
    return inner[-1] if inner and get_origin(kind) in {tuple, list, dict} else None


@functools.cache
def bare_type(kind: Any) -> Any:
    """An annotation without its constraints and without `| None`."""
    while get_origin(kind) in {Annotated, Union, UnionType}:
        kind = next(part for part in get_args(kind) if part is not NoneType)
    return kind


def _check_finite(value: object, kind: Any, path: str) -> None:
    if (flaw := _flaw(value)) is not None:
        *keys, text = flaw
        raise SceneError(f"{path_to(keys, value, kind, path)} = {text}", id="not-finite")


def _flaw(value: object) -> tuple[Any, ...] | None:
    """Keys that lead to the first infinite, nan or unordered item in a value, followed by the reason; or None."""
    if isinstance(value, float):
        return None if math.isfinite(value) else (f"{value!r}: must be a finite number",)
    if isinstance(value, (str, int, NoneType, Spec)):  # contains no float, or is already checked
        return None
    if isinstance(value, (set, frozenset)):
        return (f"{truncated(value)}: a set has no order; expected a list",)
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list | tuple) else ()
    return next(((key, *flaw) for key, item in items if (flaw := _flaw(item)) is not None), None)


def mistakes(raw: Any, kind: Any, path: str = "") -> list[Diagnostic]:
    """Return all mistakes that `decode`, with the same arguments, would find in a value and its nested values."""
    try:
        decode(raw, kind, path)
    except SceneError as error:
        deep = error.id == "nested-too-deeply"
        return [error.diagnostic] if deep else list(_below(raw, kind, path)) or [error.diagnostic]
    return []


def _below(raw: Any, kind: Any, path: str) -> Iterator[Diagnostic]:
    """Mistakes in a table's keys and in lists of tables; none if the value itself has the wrong type."""
    bare = bare_type(kind)
    if get_origin(bare) is dict and isinstance(raw, dict):
        for key, item in raw.items():
            yield from mistakes(item, get_args(bare)[1], f"{path}.{key}")
    elif is_record(bare) and isinstance(raw, dict):
        fields = fields_of(bare)
        names = [field.encode_name for field in fields]
        yield from key_mistakes(raw, names, (f.encode_name for f in fields if f.required), path)
        for key in (key for key in raw if key in names):  # in the order of the file
            yield from mistakes(raw[key], type_below(bare, key), f"{path}.{key}".lstrip("."))
    elif get_origin(bare) is tuple and isinstance(raw, list) and Ellipsis in get_args(bare):
        for k, item in enumerate(raw):
            if isinstance(item, dict):
                yield from mistakes(item, get_args(bare)[0], path_to([k], raw, kind, path))


def raise_together(found: Iterable[Diagnostic]) -> None:
    """Raise one error that lists all mistakes, if there are any, with the id of the first mistake."""
    most = 20  # a file with more is probably not a scene
    texts = list(dict.fromkeys(found))
    if texts:
        more = [f"{len(texts) - most} more"] if len(texts) > most else []
        raise SceneError(ALSO.join([*texts[:most], *more]), id=texts[0].id)


def check_all(checks: Sequence[Callable[[], object]]) -> None:
    """Run all checks, and raise all mistakes together as in `raise_together`."""
    found = []
    for check in checks:
        try:
            check()
        except SceneError as error:
            found.append(error.diagnostic)
    raise_together(found)
