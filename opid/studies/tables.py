"""What may stand in the tables of a study file, and what is wrong with one: shared by every kind of study."""

from __future__ import annotations

import re
import tomllib
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import tomli_w

from opid.errors import InputError, meant_by, nearest
from opid.signals.log_settings import ChannelSettings, LogSettings

Document = dict[str, Any]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Args:
        kind: type of its value; no type at all where the key belongs elsewhere, as `what` then says.
        what: that value in words.
        required: whether it must be there.
        keys: what may stand in its table, or in each table of its list.
        entries: what may stand in each table in its table, where these have any name; a name or a number may stand for
            such a table.
        is_named: whether tables of its list are told apart by their names in what is said of them, not by numbers.
    """

    kind: type | tuple[type, ...]
    what: str
    required: bool = True
    keys: Mapping[str, Key] | None = None
    entries: Mapping[str, Key] | None = None
    is_named: bool = False

    def takes(self, value: object) -> bool:
        """Return whether a value has the right type; a TOML boolean is an int to Python."""
        return isinstance(value, self.kind) and isinstance(value, bool) == (self.kind is bool)


def maybe(kind: type | tuple[type, ...], what: str, **more: Any) -> Key:
    """Return a key that may be left out."""
    return Key(kind, what, required=False, **more)


def elsewhere(words: str) -> Key:
    """Return a key that has its place elsewhere, as the words say after "the study has 'axis', "."""
    return maybe((), words)


def keys_of(record: type, *, without: Sequence[str] = (), **others: Key) -> dict[str, Key]:
    """Return the keys of a table that gives the fields of a record; fields with a default may be left out.

    >>> keys_of(LogSettings)["fs_hz"]
    Key(kind=(<class 'int'>, <class 'float'>), what='a number', required=False, keys=None, entries=None, is_named=False)
    """
    hints, found = get_type_hints(record), {}
    for field in fields(record):
        if field.name in others:
            found[field.name] = others[field.name]
        elif field.name not in without:
            required = field.default is MISSING and field.default_factory is MISSING
            found[field.name] = Key(*_type_in_words(hints[field.name]), required)
    return found | others


_PLAIN: dict[Any, tuple[type | tuple[type, ...], str]] = {
    str: (str, "text in quotes"),
    int: (int, "a whole number"),
    float: ((int, float), "a number"),
    bool: (bool, "true or false"),
    str | int: ((str, int), "a name in quotes or a number counted from 1"),
}


def _type_in_words(hint: Any) -> tuple[type | tuple[type, ...], str]:
    if get_origin(hint) in (Union, types.UnionType):
        hint = Union[tuple(each for each in get_args(hint) if each is not type(None))]  # noqa: UP007
    if get_origin(hint) is Literal:
        return str, one_of(get_args(hint))
    return (list, "a list of names") if get_origin(hint) is tuple else _PLAIN[hint]


def one_of(words: Sequence[str]) -> str:
    """Return a clause that lists the words that may be given.

    >>> one_of(["up", "down"]), one_of(["up", "down", "horizontal"])
    ("'up' or 'down'", "one of 'up', 'down', 'horizontal'")
    """
    quoted = [repr(word) for word in words]
    return " or ".join(quoted) if len(quoted) == 2 else "one of " + ", ".join(quoted)


TEXT, NUMBER = Key(*_PLAIN[str]), Key(*_PLAIN[float])
MAYBE_TEXT, MAYBE_NUMBER, MAYBE_WHOLE = (Key(*_PLAIN[kind], required=False) for kind in (str, float, int))

LOG = keys_of(LogSettings, decimal=maybe(str, "'.' or ','"))
"""[log]: how a log is to be read."""

CHANNEL = keys_of(
    ChannelSettings,
    channel=Key(*_PLAIN[str | int], required=False),
    sign=maybe((int, float), "1 or -1"),
    log=maybe(dict, "a table like [log]", keys=LOG),
)
"""[channels.NAME]: which channel, and what its values mean."""


def load(source: Path) -> Document:
    """Return what a study file holds.

    Args:
        source: the file.

    Raises:
        InputError: it is missing, or no TOML.
    """
    if not source.is_file():
        raise InputError(f"there is no study file {source}: check the name")
    try:
        return tomllib.loads(source.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read {source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{source} is not UTF-8 text: a study is a TOML file") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{source} is no TOML: {error}") from error


def table_faults(where: str, table: object, keys: Mapping[str, Key], path: str = "") -> Iterator[str]:
    """Yield what is wrong with the keys of a table and the types of their values, and then with the tables in it.

    In what is said the table is called `where`; it stands at `path` ("sensors.leak"; "" for the whole file).
    """
    if not isinstance(table, dict):
        yield f"{where} is {table!r} where a table is needed"
        return
    known = [name for name, key in keys.items() if key.kind != ()]
    for name, value in table.items():
        if name not in keys:
            yield f"{where} has an unknown key {name!r} ({nearest(name, known)})"
        elif keys[name].kind == ():
            yield f"{f'[[{path}]]' if where.startswith('[[') else where} has {name!r}, {keys[name].what}"
        elif not keys[name].takes(value):
            yield f"{name!r} in {where} is {value!r}, give {keys[name].what}"
    meant = misspelt(table, keys)
    for name, key in keys.items():
        if key.required and name not in table and name not in meant:
            yield f"{where} lacks {name!r}, give {key.what}"
    for name in known:
        if name in table and keys[name].takes(table[name]):
            yield from _inner_faults(f"{path}.{name}".lstrip("."), table[name], keys[name])


def _inner_faults(path: str, value: object, key: Key) -> Iterator[str]:
    if key.keys is not None and isinstance(value, dict):
        yield from table_faults(f"[{path}]", value, key.keys, path)
    if key.keys is not None and isinstance(value, list):
        for number, entry in enumerate(value, start=1):
            yield from table_faults(called(path, number, entry, is_named=key.is_named), entry, key.keys, path)
    if key.entries is not None and isinstance(value, dict):
        for name, entry in value.items():
            if isinstance(entry, dict):
                yield from table_faults(f"[{path}.{name}]", entry, key.entries, f"{path}.{name}")
            elif not isinstance(entry, (str, int)) or isinstance(entry, bool):
                yield f"{name!r} in [{path}] is {entry!r}, give the name of a channel, its number or a table"


def called(path: str, number: int, entry: object, *, is_named: bool = True) -> str:
    """Return what a table of a list is called."""
    name = entry.get("name") if is_named and isinstance(entry, dict) else None
    return f"[[{path}]] {name!r}" if isinstance(name, str) and name else f"[[{path}]] number {number}"


def dict_at(table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the table under a name; an empty one where there is none."""
    found = table.get(name)
    return found if isinstance(found, dict) else {}


def list_at(table: Mapping[str, Any], name: str) -> list[Any]:
    """Return the list under a name; an empty one where there is none."""
    found = table.get(name)
    return found if isinstance(found, list) else []


@contextmanager
def prefixed(words: str) -> Iterator[None]:
    """Put words before the message of an error that is raised in the block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{words}{error}") from None


@contextmanager
def noted(faults: list[str], words: str = "") -> Iterator[None]:
    """Add an error that is raised in the block to the faults, behind some words, and go on after the block."""
    try:
        yield
    except InputError as error:
        faults.append(f"{words}{error}")


def misspelt(table: Mapping[str, object], keys: Iterable[str]) -> set[str]:
    """Return the keys that are missing because another one was written in their place: one fault, told once.

    >>> misspelt({"mas": 1.0, "x": 2.0}, ["mass", "length"])
    {'mass'}
    """
    known = list(keys)
    return {meant for name in table if name not in known for meant in meant_by(name, known)[:1]}


def log_settings(table: Mapping[str, Any], where: str = "[log]") -> LogSettings:
    """Return the settings that a table [log] gives.

    Raises:
        InputError: a value that cannot be.
    """
    with prefixed(f"{where}: "):
        return LogSettings(**table)


def channel_settings(key: str, entry: str | int | Mapping[str, Any], *, without: Sequence[str] = ()) -> ChannelSettings:
    """Return the settings of a channel that an entry of [channels] gives: a name, a number, or a table.

    Raises:
        InputError: a value that cannot be.
    """
    if not isinstance(entry, Mapping):
        return ChannelSettings(entry)
    with prefixed(f"[channels.{key}]: "):
        return ChannelSettings(**{"channel": key, **{name: entry[name] for name in entry if name not in without}})


def stated(record: Any, *always: str, without: Sequence[str] = ()) -> dict[str, Any]:
    """Return the fields of a record that are not what they are where nothing is said, and some in any case.

    >>> stated(LogSettings(unit="g", skip_lines=2), "clock", without=["skip_lines"])
    {'clock': 'stamps', 'unit': 'g'}
    """
    given = {each.name: getattr(record, each.name) for each in fields(record) if each.name not in without}
    usual = {each.name: each.default for each in fields(record)}
    return {name: value for name, value in given.items() if name in always or value not in (None, usual[name])}


def toml_of(head: Mapping[str, Any], **lists: Sequence[Mapping[str, Any]]) -> str:
    """Return the text of a study file: what stands before the lists, and one table [[NAME]] for each entry."""
    entries = [f"\n[[{name}]]\n{tomli_w.dumps(table)}" for name, tables in lists.items() for table in tables]
    # a list of plain values on one line
    return re.sub(r"\[\n([^\[\]{}]*)\n *\]", _on_one_line, tomli_w.dumps(head) + "".join(entries))


def _on_one_line(found: re.Match[str]) -> str:
    return "[" + " ".join(line.strip() for line in found[1].splitlines()).rstrip(",") + "]"


def require_plain(what: str, name: str) -> None:
    """Refuse a name that cannot be that of a file beside the study.

    Raises:
        InputError: it is empty, or has parts.
    """
    if name in ("", ".", "..") or Path(name).name != name:
        raise InputError(f"the {what} {name!r} cannot name its log: call it by one plain word")
