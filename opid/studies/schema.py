"""Tables of a study file -> frozen records, and back. Each key is a field of a record, with its type and default.

The records are those of the wings, or private ones of this folder if a file has other keys. An error says what the
type of a field needs; `Annotated[type, "words"]` gives better words. One walk finds all faults of a file, and builds
its sound parts even so, so that the files that they name can be checked at the same time.

No library does this in fewer lines. With pydantic 2, of which a part was tried, some 55 lines would turn these records
into models (in strict mode it takes no table for a dataclass and no array for a tuple, and returns 2 as 2.0), some 75
its error codes into sentences with the nearest key, and the sound parts would need a second validation. The walk below
has about 150 lines and loads nothing; pydantic adds 11 MB and 0.2 s. According to their documentation, msgspec stops
at the first fault, and cattrs needs a hook for each plain type.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, field as field_of, fields, is_dataclass, make_dataclass
from datetime import date
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tomli_w

from opid.errors import FileError, InputError, meant_by, nearest
from opid.provenance import read_content
from opid.signals.files import nearest_beside
from opid.signals.recording import LARGEST_SIZE, LEAST_SIZE

Document = dict[str, Any]
T = TypeVar("T")

_LONGEST_NAME = 200
"""Bytes of a name of a file: systems take 255, and endings are added."""

NO_KEY = object()
"""`Annotated[type, NO_KEY]` marks a field that is no key; a field `given` gets the names of the keys in the table."""

_UNIONS = (Union, types.UnionType)
_WORDS = {
    str: "text in quotes",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    date: "a date without quotes and without a time, as 2026-03-01",
}
_SEVERAL = {int: "whole numbers", float: "numbers"}
_SEVERAL_LISTS = {float: "a list of lists of numbers"}
_UNSOUND = object()


class _UnfitError(Exception):
    """A value is not of its type; the message gives the value as the end of a sentence."""


class _UnfitItemError(_UnfitError):
    """An item of a list is not of its type, or a number has a size that nothing has: more than that it is unfit."""


def load(source: Path) -> Document:
    """Return the content of a study file.

    Args:
        source: the file.

    Raises:
        InputError: it is missing, or no TOML.
    """
    if not os.path.isfile(source):
        raise FileError(f"there is no study file {source}{nearest_beside(source, ('.toml',))}")
    try:
        return tomllib.loads(read_content(source).decode("utf-8-sig"))
    except OSError as error:
        raise FileError(f"cannot read {source}: {error.strerror}") from error
    except InputError as error:
        raise FileError(f"cannot read {source}: {error}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{source} is not UTF-8 text: a study is a TOML file") from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits is a ValueError, too
        raise FileError(f"{source} is no TOML: {error}") from error


# ---- tables -> records -----------------------------------------------------------------------------


def read_tables(kind: Callable[..., T], document: Document) -> tuple[T, list[str]]:
    """Return the record that a study file describes, and the faults of the file.

    Args:
        kind: class of the record. A required field at fault is None; an optional one keeps its default; a list of
            tables keeps its valid ones. `ELSEWHERE` of this class, or of one in it, says of keys that the class does
            not have where they belong; its entry "" holds for all others.
        document: what the file holds.
    """
    faults: list[str] = []
    given = _read_arguments(kind, document, "the study", "", faults)
    lacking = {
        name: None for name, (_, default) in _list_keys(kind).items() if default is MISSING and name not in given
    }
    return kind(**given, **lacking), faults


def derive_record(record: Any, *others: str, **defaults: Any) -> Any:
    """Return a record class with the fields of another one but for some, and with some other defaults.

    Args:
        record: the other class.
        others: names of the fields that are left out.
        defaults: other defaults by the name of the field.
    """
    hints, usual = get_type_hints(record), {each.name: each.default for each in fields(record)} | defaults
    given = [(name, hints[name], field_of(default=usual[name])) for name in usual if name not in others]
    return make_dataclass(record.__name__, given, frozen=True, kw_only=True)


@cache
def _list_keys(kind: Any) -> dict[str, tuple[Any, Any]]:
    """Return the keys of the table for a record, each with its type and its default; MISSING if it is required."""
    hints, found = get_type_hints(kind, include_extras=True), {}
    for field in fields(kind):
        if NO_KEY not in getattr(hints[field.name], "__metadata__", ()):
            default = field.default if field.default_factory is MISSING else field.default_factory()
            found[field.name] = hints[field.name], default
    return found


def _read_arguments(kind: Any, table: Document, where: str, path: str, faults: list[str]) -> dict[str, Any]:
    """Return the sound entries of a table, as arguments of its record."""
    keys, elsewhere, given = _list_keys(kind), getattr(kind, "ELSEWHERE", {}), {}
    for name, value in table.items():
        if name in keys:
            given[name] = _read_entry(keys[name][0], value, name, where, path, faults)
        elif name in elsewhere or ("" in elsewhere and not meant_by(name, keys)):
            faults.append(f"{where} has {name!r}, {elsewhere.get(name) or elsewhere['']}")
        else:
            faults.append(f"{where} has an unknown key {name!r} ({nearest(name, keys)})")
    meant = find_misspelt(table, keys)
    for name, (hint, default) in keys.items():
        if default is MISSING and name not in table and name not in meant:
            faults.append(f"{where} lacks {name!r}, give {_say_what_is_needed(hint, path + name)}")
    return {name: value for name, value in given.items() if value is not _UNSOUND}


def _read_record(kind: Any, table: object, where: str, path: str, faults: list[str]) -> Any:
    if not isinstance(table, dict):
        faults.append(f"{where} is {_show(table)} where a table is needed")
        return _UNSOUND
    n_before = len(faults)
    given = _read_arguments(kind, table, where, f"{path}.", faults)
    if any(field.name == "given" for field in fields(kind)):
        given["given"] = frozenset(table)
    if len(faults) == n_before:
        with collect_faults(faults, f"{where}: "):
            return kind(**given)
    return _UNSOUND


def _read_entry(hint: Any, value: object, name: str, where: str, path: str, faults: list[str]) -> Any:
    try:
        return _convert(hint, value, path + name, faults)
    except _UnfitError as error:
        faults.append(f"{name!r} in {where} {error}, give {_say_what_is_needed(hint, path + name)}")
        return _UNSOUND


def _convert(hint: Any, value: Any, path: str, faults: list[str]) -> Any:
    """Return a value converted to its type: arrays to tuples, tables to records."""
    kind = _strip_words(hint)
    origin, within = get_origin(kind), get_args(kind)
    unfit = f"is {_show(value)}"
    if origin in _UNIONS:
        for member in within:
            try:
                return _convert(member, value, path, faults)
            except _UnfitError as error:
                if isinstance(error, _UnfitItemError):  # It says more than that the whole is unfit.
                    unfit = str(error)
    is_whole = type(value) is int and -(2**63) <= value < 2**63  # These are the integers of TOML.
    is_real = type(value) is float and (value == 0 or LEAST_SIZE <= abs(value) <= LARGEST_SIZE)
    if kind in (int, float):
        is_fit = is_whole or (kind is float and is_real)
    else:
        is_fit = type(value) is kind if origin is not Literal else value in within
    if is_fit:
        return value
    if kind is float and type(value) is float and math.isfinite(value):
        raise _UnfitItemError(f"{unfit}, whose size is not between {LEAST_SIZE:g} and {LARGEST_SIZE:g}")
    if isinstance(value, list) and origin is tuple and len(value) == (len(value) if ... in within else len(within)):
        hints = within[:1] * len(value) if ... in within else within
        found = [_read_item(*each, path, faults) for each in zip(hints, value, range(1, len(value) + 1), strict=True)]
        return tuple(each for each in found if each is not _UNSOUND)
    if isinstance(value, dict) and is_dataclass(kind):
        return _read_record(kind, value, f"[{path}]", path, faults)
    if isinstance(value, dict) and origin is Mapping:
        pairs = {
            name: _read_entry(within[1], each, name, f"[{path}]", f"{path}.", faults) for name, each in value.items()
        }
        if within[0] is int and not all(re.fullmatch(r"\d{1,9}", name) for name in pairs):
            raise _UnfitError(unfit)
        return {within[0](name): each for name, each in pairs.items() if each is not _UNSOUND}
    raise _UnfitError(unfit)


def _read_item(hint: Any, value: Any, number: int, path: str, faults: list[str]) -> Any:
    if is_dataclass(_strip_words(hint)):
        name = value.get("name") if isinstance(value, dict) else None
        return _read_record(
            hint,
            value,
            f"[[{path}]] {repr(name) if name and isinstance(name, str) else f'number {number}'}",
            path,
            faults,
        )
    try:
        return _convert(hint, value, path, faults)
    except _UnfitError:
        raise _UnfitItemError(f"holds {_show(value)}") from None


def _strip_words(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _show(value: object) -> str:
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= 80 else f"{text[:80]}..."


def _say_what_is_needed(hint: Any, path: str) -> str:
    """Return what a type needs, in words."""
    origin, within = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return str(hint.__metadata__[0])
    if origin in _UNIONS:
        return " or ".join(_say_what_is_needed(each, path) for each in within if each is not type(None))
    if origin is Literal:
        return "one of " + ", ".join(map(repr, within))
    if origin is tuple and is_dataclass(within[0]):
        return f"tables [[{path}]]"
    if origin is tuple:
        is_nested = get_origin(within[0]) is tuple
        return (
            _SEVERAL_LISTS.get(get_args(within[0])[0], 'a list of lists of names, as [["a", "b"]]')
            if is_nested
            else f"a list of {_SEVERAL.get(within[0], 'names')}"
        )
    return _WORDS.get(hint, f"a table [{path}]")


def find_misspelt(table: Mapping[str, object], keys: Iterable[str]) -> set[str]:
    """Return the keys that are missing because they are misspelt, so that each fault is reported once.

    >>> find_misspelt({"mas": 1.0, "x": 2.0}, ["mass", "length"])
    {'mass'}
    """
    known = list(keys)
    return {meant for name in table if name not in known for meant in meant_by(name, known)[:1]}


@contextmanager
def prefix_errors(words: str) -> Iterator[None]:
    """Put words before the message of an error that is raised in the block."""
    try:
        yield
    except InputError as error:
        raise error.reword(f"{words}{error}") from None


@contextmanager
def name_source(source: Path | str) -> Iterator[None]:
    """Put the name of a file before the message of an error that is raised in the block.

    Args:
        source: the file.
    """
    try:
        yield
    except InputError as error:
        raise FileError(f"{source}: {error}") from None


@contextmanager
def collect_faults(faults: list[str], words: str = "") -> Iterator[None]:
    """Add an error that is raised in the block to the faults, with some words before it; the work then goes on."""
    try:
        yield
    except InputError as error:
        faults.append(f"{words}{error}")


# ---- records -> tables -----------------------------------------------------------------------------


def select_stated(record: Any) -> dict[str, Any]:
    """Return the fields of a record that differ from their defaults, or whose keys are `given`.

    >>> from opid.signals.log import LogSettings
    >>> select_stated(LogSettings(unit="g", skip_lines=2))
    {'unit': 'g', 'skip_lines': 2}
    """
    said = {}
    for name, (_, default) in _list_keys(record.__class__).items():
        value = getattr(record, name)
        is_other = value != default or name in getattr(record, "given", ())
        if value is not None and (select_stated(value) if is_dataclass(value) and default is not MISSING else is_other):
            said[name] = value
    return said


def recast(kind: Callable[..., T], record: Any, **others: Any) -> T:
    """Return a record of another class with the fields that both have, and with some other values.

    Args:
        kind: the other class.
        record: has the values.
        others: further or other values by the name of the field.
    """
    shared = {field.name for field in fields(kind)} & {field.name for field in fields(record)}  # type: ignore[arg-type]
    return kind(**{name: getattr(record, name) for name in shared} | others)


def format_toml(record: Any) -> str:
    """Return a record as the text of a study file: defaults are left out, plain lists stand on one line."""
    plain, tables = {}, []
    for name, value in _make_plain(record).items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            tables += [f"\n[[{name}]]\n{_format_entry(name, each)}" for each in value]
        elif isinstance(value, dict):
            tables.append("\n" + tomli_w.dumps({name: value}))
        else:
            plain[name] = value
    text = tomli_w.dumps(plain) + "".join(tables)
    return re.sub(r"\[\n([^\[\]{}]*)\n *\]", _join_lines, text)


def _format_entry(name: str, entry: Mapping[str, Any]) -> str:
    """Return one table of a list of tables as text; tables inside it have the name of the list in their header."""
    inside = {key: value for key, value in entry.items() if isinstance(value, dict)}
    lists = {
        key: value for key, value in entry.items() if isinstance(value, list) and value and isinstance(value[0], dict)
    }
    text = tomli_w.dumps({key: value for key, value in entry.items() if key not in {*inside, *lists}})
    text += "".join("\n" + tomli_w.dumps({name: {key: value}}) for key, value in inside.items())
    rows = ((key, each) for key, value in lists.items() for each in value)
    return text + "".join(f"\n[[{name}.{key}]]\n{tomli_w.dumps(each)}" for key, each in rows)


def _make_plain(value: Any) -> Any:
    if is_dataclass(value):
        return {name: _make_plain(each) for name, each in select_stated(value).items()}
    if isinstance(value, Mapping):
        return {str(name): _make_plain(each) for name, each in value.items()}
    return [_make_plain(each) for each in value] if isinstance(value, tuple) else value


def _join_lines(found: re.Match[str]) -> str:
    return "[" + " ".join(line.strip() for line in found[1].splitlines()).rstrip(",") + "]"


_RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{device}{number}" for device in ("COM", "LPT") for number in range(1, 10))}
"""Names that Windows keeps for devices, whatever ending they have."""


def require_plain(what: str, name: str) -> None:
    """Refuse a name that cannot be the name of a file beside the study.

    Args:
        what: has the name, in a word.
        name: of it.

    Raises:
        InputError: it is empty, too long or has parts, or a system that the result may be copied to cannot have it.
    """
    is_long = len(name.encode("utf-8", "replace")) > _LONGEST_NAME
    is_reserved = name.rstrip(". ") != name or name.partition(".")[0].upper() in _RESERVED
    if not name or not name.isprintable() or is_long or is_reserved or Path(name).name != name or "\\" in name:
        raise InputError(f"the {what} {name!r} cannot name its log: call it by one plain word")
