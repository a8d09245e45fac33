"""What may stand in a study file, table by table, and what is wrong with one."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from opid.errors import InputError, nearest
from opid.identify.sensor_facts import SIDES, SensorFacts

Document = dict[str, Any]


@dataclass(frozen=True)
class _Key:
    kind: type | tuple[type, ...]
    what: str
    required: bool = True


def _maybe(kind: type | tuple[type, ...], what: str) -> _Key:
    return _Key(kind, what, required=False)


_TEXT = _Key(str, "text in quotes")
_NUMBER = _Key((int, float), "a number")
_NAME_OR_PLACE = _maybe((str, int), "a name in quotes or a number counted from 1")

# Every key of a study file. A further table is one more row here and one more line in `document_faults`.
_STUDY = {
    "title": _maybe(str, "text in quotes"),
    "fs_hz": _maybe((int, float), "a number"),
    "log": _maybe(dict, "a table [log]"),
    "channels": _Key(dict, "a table [channels]"),
    "runs": _Key(list, "one table [[runs]] for each log"),
    "sensors": _maybe(dict, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]"),
}
_LOG = {
    "names": _maybe(list, "a list of names"),
    "time": _NAME_OR_PLACE,
    "time_unit": _maybe(str, "text in quotes"),
    "clock": _maybe(str, "'stamps' or 'reconstructed'"),
    "fs_hz": _maybe((int, float), "a number"),
    "unit": _maybe(str, "text in quotes"),
    "full_scale": _maybe((int, float), "a number"),
    "delimiter": _maybe(str, "text in quotes"),
    "decimal": _maybe(str, "'.' or ','"),
    "encoding": _maybe(str, "text in quotes"),
    "skip_lines": _maybe(int, "a whole number"),
}
_SENSOR = {field.name: _maybe((int, float), "a number") for field in fields(SensorFacts)}
SENSOR_KEYS = tuple(_SENSOR)
_CHANNEL = {
    "channel": _NAME_OR_PLACE,
    "file": _maybe(str, "text in quotes"),
    "unit": _maybe(str, "text in quotes"),
    "scale": _maybe((int, float), "a number"),
    "offset": _maybe((int, float), "a number"),
    "sign": _maybe((int, float), "1 or -1"),
    "shift_s": _maybe((int, float), "a number"),
    "log": _maybe(dict, "a table like [log]"),
    **_SENSOR,
}
_SENSORS = {
    "sprung": _maybe(dict, "a table [sensors.sprung]"),
    "unsprung": _maybe(dict, "a table [sensors.unsprung]"),
    "leak": _maybe(list, "one table [[sensors.leak]] for each recorded axis that leaks in"),
}
_LEAK = {
    "channel": _TEXT,
    "into": _maybe(str, "'sprung' or 'unsprung'"),
    "tolerance": _maybe((int, float), "a number"),
}
_RUN = {
    "name": _TEXT,
    "log": _maybe(str, "text in quotes"),
    "mass_change_kg": _NUMBER,
    "start_s": _maybe((int, float), "a number"),
    "stop_s": _maybe((int, float), "a number"),
    "channels": _maybe(dict, "a table [runs.channels]"),
}


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


def document_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with the keys of a study file and the types of their values.

    Args:
        document: what the file holds.
    """
    yield from _table_faults("the study", document, _STUDY)
    if isinstance(document.get("log"), dict):
        yield from _table_faults("[log]", document["log"], _LOG)
    if isinstance(document.get("channels"), dict):
        for side in SIDES:
            if side not in document["channels"]:
                hint = nearest(side, document["channels"])
                yield f"[channels] lacks {side!r}, give the name of a channel or a table ({hint})"
        yield from _channel_faults("channels", document["channels"])
        yield from _useless_facts("channels", document["channels"], SIDES)
    fs_hz = document.get("fs_hz", 1.0)
    if isinstance(fs_hz, (int, float)) and not (math.isfinite(fs_hz) and fs_hz > 0):
        yield f"'fs_hz' in the study is {fs_hz}, give a positive rate in Hz"
    if isinstance(document.get("runs"), list):
        for number, entry in enumerate(document["runs"], start=1):
            yield from _table_faults(f"[[runs]] number {number}", entry, _RUN)
            if isinstance(entry, dict) and isinstance(entry.get("channels"), dict):
                yield from _channel_faults("runs.channels", entry["channels"])
                yield from _useless_facts("runs.channels", entry["channels"], ())
    if isinstance(document.get("sensors"), dict):
        yield from _sensor_faults(document["sensors"])


def _channel_faults(where: str, entries: Mapping[str, Any]) -> Iterator[str]:
    for name, entry in entries.items():
        if isinstance(entry, dict):
            yield from _table_faults(f"[{where}.{name}]", entry, _CHANNEL)
            if isinstance(entry.get("log"), dict):
                yield from _table_faults(f"[{where}.{name}.log]", entry["log"], _LOG)
        elif not isinstance(entry, (str, int)) or isinstance(entry, bool):
            yield f"{name!r} in [{where}] is {entry!r}, give the name of a channel, its number or a table"


def _useless_facts(where: str, entries: Mapping[str, Any], known: Sequence[str]) -> Iterator[str]:
    """Facts of sensors where nothing would come of them."""
    for name, entry in entries.items():
        for key in SENSOR_KEYS if isinstance(entry, dict) and name not in known else ():
            if key in entry:
                yield f"{key!r} stands in [{where}.{name}], give it in [channels.sprung] or [channels.unsprung]"


def _sensor_faults(sensors: Mapping[str, Any]) -> Iterator[str]:
    yield from _table_faults("[sensors]", sensors, _SENSORS)
    for side in SIDES:
        if isinstance(sensors.get(side), dict):
            yield from _table_faults(f"[sensors.{side}]", sensors[side], _SENSOR)
    for number, entry in enumerate(sensors.get("leak", []) if isinstance(sensors.get("leak"), list) else [], 1):
        yield from _table_faults(f"[[sensors.leak]] number {number}", entry, _LEAK)


def _table_faults(where: str, table: object, keys: Mapping[str, _Key]) -> Iterator[str]:
    if not isinstance(table, dict):
        yield f"{where} is {table!r} where a table is needed"
        return
    for name, value in table.items():
        if name not in keys:
            yield f"{where} has an unknown key {name!r} ({nearest(name, keys)})"
        # a TOML boolean is an int to Python
        elif not isinstance(value, keys[name].kind) or isinstance(value, bool):
            yield f"{name!r} in {where} is {value!r}, give {keys[name].what}"
    for name, key in keys.items():
        if key.required and name not in table:
            yield f"{where} lacks {name!r}, give {key.what}"
