"""What may stand in a study file, table by table, and what is wrong with one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from datetime import date, datetime
from typing import Any

from opid.errors import nearest
from opid.signals.tables import CHANNEL, LOG, NUMBER, TEXT, Document, Key, maybe, table_faults
from opid.suspensions.sensor_facts import SIDES, SensorFacts

# Keys of the study of a body that one gear has not, and where they belong.
_OF_A_BODY = {
    "the study": ("structure", "body_sensors"),
    "[[runs]]": ("loading",),
}

# Every key of a study file. A further table is one more row here and one more line in `document_faults`.
_STUDY = {
    "title": maybe(str, "text in quotes"),
    "date": maybe(date, "a date without quotes, as 2026-03-01"),
    "fs_hz": maybe((int, float), "a number"),
    "log": maybe(dict, "a table [log]"),
    "channels": Key(dict, "a table [channels]"),
    "runs": Key(list, "one table [[runs]] for each log"),
    "sensors": maybe(dict, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]"),
}
_SENSOR = {field.name: maybe((int, float), "a number") for field in fields(SensorFacts)}
SENSOR_KEYS = tuple(_SENSOR)
_CHANNEL = {**CHANNEL, **_SENSOR}
_SENSORS = {
    "sprung": maybe(dict, "a table [sensors.sprung]"),
    "unsprung": maybe(dict, "a table [sensors.unsprung]"),
    "leak": maybe(list, "one table [[sensors.leak]] for each recorded axis that leaks in"),
}
_LEAK = {
    "channel": TEXT,
    "into": maybe(str, "'sprung' or 'unsprung'"),
    "tolerance": maybe((int, float), "a number"),
}
_RUN = {
    "name": TEXT,
    "log": maybe(str, "text in quotes"),
    "mass_change_kg": NUMBER,
    "start_s": maybe((int, float), "a number"),
    "stop_s": maybe((int, float), "a number"),
    "channels": maybe(dict, "a table [runs.channels]"),
}


def document_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with the keys of a study file and the types of their values.

    Args:
        document: what the file holds.
    """
    yield from table_faults("the study", _without(document, _OF_A_BODY["the study"]), _STUDY)
    yield from _facts_of_a_body(document)
    yield from general_faults(document)
    if isinstance(document.get("channels"), dict):
        for side in SIDES:
            if side not in document["channels"]:
                hint = nearest(side, document["channels"])
                yield f"[channels] lacks {side!r}, give the name of a channel or a table ({hint})"
        yield from channel_faults("channels", document["channels"])
        yield from _useless_facts("channels", document["channels"], SIDES)
    if isinstance(document.get("runs"), list):
        for number, entry in enumerate(document["runs"], start=1):
            yield from table_faults(f"[[runs]] number {number}", _without(entry, _OF_A_BODY["[[runs]]"]), _RUN)
            if isinstance(entry, dict) and isinstance(entry.get("channels"), dict):
                yield from channel_faults("runs.channels", entry["channels"])
                yield from _useless_facts("runs.channels", entry["channels"], ())
    if isinstance(document.get("sensors"), dict):
        yield from _sensor_faults(document["sensors"])


def _without(table: object, names: Sequence[str]) -> object:
    """A table without what is said of it in other words."""
    return {name: value for name, value in table.items() if name not in names} if isinstance(table, dict) else table


def _facts_of_a_body(document: Document) -> Iterator[str]:
    """Keys that only the study of a body has."""
    runs = document.get("runs")
    entries = runs if isinstance(runs, list) else []
    tables = {"the study": [document], "[[runs]]": [run for run in entries if isinstance(run, dict)]}
    for where, names in _OF_A_BODY.items():
        for name in names:
            if any(name in table for table in tables[where]):
                yield (
                    f"{where} has {name!r}, which belongs to a body on several suspensions: describe each suspension "
                    "in [[interfaces]] (name, sprung, unsprung, x_m, y_m), or leave it out for one gear"
                )


def general_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with the keys that every study file may have: date, rate, [log].

    Args:
        document: what the file holds.
    """
    # a date with a time is a date to Python
    if isinstance(document.get("date"), datetime):
        yield f"'date' in the study is {document['date']}, give the day alone, as {document['date'].date()}"
    if isinstance(document.get("log"), dict):
        yield from table_faults("[log]", document["log"], LOG)
    fs_hz = document.get("fs_hz", 1.0)
    if isinstance(fs_hz, (int, float)) and not (math.isfinite(fs_hz) and fs_hz > 0):
        yield f"'fs_hz' in the study is {fs_hz}, give a positive rate in Hz"


def channel_faults(where: str, entries: Mapping[str, Any], keys: Mapping[str, Key] = _CHANNEL) -> Iterator[str]:
    """Yield what is wrong with the entries of [channels], or of [runs.channels].

    Args:
        where: what the table is called.
        entries: what stands there.
        keys: of a channel's table.
    """
    for name, entry in entries.items():
        if isinstance(entry, dict):
            yield from table_faults(f"[{where}.{name}]", entry, keys)
            if isinstance(entry.get("log"), dict):
                yield from table_faults(f"[{where}.{name}.log]", entry["log"], LOG)
        elif not isinstance(entry, (str, int)) or isinstance(entry, bool):
            yield f"{name!r} in [{where}] is {entry!r}, give the name of a channel, its number or a table"


def _useless_facts(where: str, entries: Mapping[str, Any], known: Sequence[str]) -> Iterator[str]:
    """Facts of sensors where nothing would come of them."""
    for name, entry in entries.items():
        for key in SENSOR_KEYS if isinstance(entry, dict) and name not in known else ():
            if key in entry:
                yield f"{key!r} stands in [{where}.{name}], give it in [channels.sprung] or [channels.unsprung]"


def _sensor_faults(sensors: Mapping[str, Any]) -> Iterator[str]:
    yield from table_faults("[sensors]", sensors, _SENSORS)
    for side in SIDES:
        if isinstance(sensors.get(side), dict):
            yield from table_faults(f"[sensors.{side}]", sensors[side], _SENSOR)
    for number, entry in enumerate(sensors.get("leak", []) if isinstance(sensors.get("leak"), list) else [], 1):
        yield from table_faults(f"[[sensors.leak]] number {number}", entry, _LEAK)
