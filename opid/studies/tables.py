"""What may stand in the tables of a TOML file, and what is wrong with one: shared by the studies of all wings."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from opid.errors import InputError, meant_by, nearest
from opid.signals.log_settings import ChannelSettings, LogSettings

Document = dict[str, Any]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Args:
        kind: type of its value.
        what: that value in words.
        required: whether it must be there.
    """

    kind: type | tuple[type, ...]
    what: str
    required: bool = True


def maybe(kind: type | tuple[type, ...], what: str) -> Key:
    """Return a key that may be left out.

    Args:
        kind: type of its value.
        what: that value in words.
    """
    return Key(kind, what, required=False)


TEXT = Key(str, "text in quotes")
NUMBER = Key((int, float), "a number")
NAME_OR_PLACE = maybe((str, int), "a name in quotes or a number counted from 1")

LOG = {
    "names": maybe(list, "a list of names"),
    "time": NAME_OR_PLACE,
    "time_unit": maybe(str, "text in quotes"),
    "clock": maybe(str, "'stamps' or 'reconstructed'"),
    "fs_hz": maybe((int, float), "a number"),
    "unit": maybe(str, "text in quotes"),
    "full_scale": maybe((int, float), "a number"),
    "delimiter": maybe(str, "text in quotes"),
    "decimal": maybe(str, "'.' or ','"),
    "encoding": maybe(str, "text in quotes"),
    "skip_lines": maybe(int, "a whole number"),
}
"""[log]: how a log is to be read."""

CHANNEL = {
    "channel": NAME_OR_PLACE,
    "file": maybe(str, "text in quotes"),
    "unit": maybe(str, "text in quotes"),
    "scale": maybe((int, float), "a number"),
    "offset": maybe((int, float), "a number"),
    "sign": maybe((int, float), "1 or -1"),
    "shift_s": maybe((int, float), "a number"),
    "log": maybe(dict, "a table like [log]"),
}
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


def table_faults(where: str, table: object, keys: Mapping[str, Key]) -> Iterator[str]:
    """Yield what is wrong with the keys of a table and the types of their values.

    Args:
        where: what the table is called.
        table: what stands there.
        keys: what may.
    """
    if not isinstance(table, dict):
        yield f"{where} is {table!r} where a table is needed"
        return
    for name, value in table.items():
        if name not in keys:
            yield f"{where} has an unknown key {name!r} ({nearest(name, keys)})"
        # a TOML boolean is an int to Python
        elif not isinstance(value, keys[name].kind) or isinstance(value, bool):
            yield f"{name!r} in {where} is {value!r}, give {keys[name].what}"
    meant = misspelt(table, keys)
    for name, key in keys.items():
        if key.required and name not in table and name not in meant:
            yield f"{where} lacks {name!r}, give {key.what}"


def misspelt(table: Mapping[str, object], keys: Iterable[str]) -> set[str]:
    """Return the keys that are missing because another one was written in their place: one fault, told once.

    Args:
        table: what stands there.
        keys: what may.

    >>> misspelt({"mas": 1.0, "x": 2.0}, ["mass", "length"])
    {'mass'}
    """
    known = list(keys)
    return {meant for name in table if name not in known for meant in meant_by(name, known)[:1]}


def log_settings(table: Mapping[str, Any], where: str = "[log]") -> LogSettings:
    """Return the settings that a table [log] gives.

    Args:
        table: checked by `table_faults`.
        where: what it is called.

    Raises:
        InputError: a value that cannot be.
    """
    try:
        return LogSettings(**{**table, "names": tuple(table.get("names", ()))})
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def channel_settings(key: str, entry: str | int | Mapping[str, Any], *, without: Sequence[str] = ()) -> ChannelSettings:
    """Return the settings of a channel that an entry of [channels] gives: a name, a number, or a table.

    Args:
        key: name of the entry, and of the channel where the table gives none.
        entry: checked by `table_faults`.
        without: keys of the table that are no settings of a channel.

    Raises:
        InputError: a value that cannot be.
    """
    if not isinstance(entry, Mapping):
        return ChannelSettings(entry)
    own = {name: value for name, value in entry.items() if name not in without}
    try:
        return ChannelSettings(**{"channel": key, **own})
    except InputError as error:
        raise InputError(f"[channels.{key}]: {error}") from None
