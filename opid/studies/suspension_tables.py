"""What may stand in a study file, of one gear or of a body on several suspensions, and what is wrong with one."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from datetime import date, datetime
from pathlib import Path
from typing import Any, get_args

from opid.errors import InputError, nearest
from opid.studies.kinds import SUSPENSIONS
from opid.studies.tables import CHANNEL, LOG, NUMBER, TEXT, Document, Key, maybe, misspelt, table_faults
from opid.suspensions.sensor_facts import SIDES, SensorFacts
from opid.suspensions.study import KINDS, Axis, PointMass

# Keys of the study of a body that one gear has not, and where they belong.
_OF_A_BODY = {
    "the study": ("structure", "body_sensors"),
    "[[runs]]": ("loading",),
}

_AXIS = maybe(str, "one of " + ", ".join(map(repr, get_args(Axis))))

# Every key of a study file. A further table is one more row here and one more line in `document_faults`.
_GEAR_STUDY = {
    "title": maybe(str, "text in quotes"),
    "date": maybe(date, "a date without quotes, as 2026-03-01"),
    "fs_hz": maybe((int, float), "a number"),
    "repeatability": maybe((int, float), "a number"),
    "axis": _AXIS,
    "piston_area_m2": maybe((int, float), "a number"),
    **{name: SUSPENSIONS.tables[name] for name in ("log", "channels", "runs", "sensors")},
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
_GEAR_RUN = {
    "name": TEXT,
    "log": maybe(str, "text in quotes"),
    "mass_change_kg": NUMBER,
    "start_s": maybe((int, float), "a number"),
    "stop_s": maybe((int, float), "a number"),
    "channels": maybe(dict, "a table [runs.channels]"),
}

COLUMNS = ("mass_kg", "x_m", "y_m")
"""Of a loading table."""

_NUMBER = maybe((int, float), "a number")
_STUDY = {
    "title": maybe(str, "text in quotes"),
    "date": maybe(date, "a date without quotes, as 2026-03-01"),
    "fs_hz": _NUMBER,
    "repeatability": _NUMBER,
    **{name: SUSPENSIONS.tables[name] for name in ("log", "body_sensors", "structure", "runs")},
    "channels": maybe(dict, "a table [channels]"),
    "interfaces": Key(list, "one table [[interfaces]] for each suspension"),
}
_INTERFACE = {
    "name": TEXT,
    "sprung": maybe(str, "the name of a channel in quotes"),
    "unsprung": maybe(str, "the name of a channel in quotes"),
    "x_m": NUMBER,
    "y_m": NUMBER,
    "sensor_x_m": _NUMBER,
    "sensor_y_m": _NUMBER,
    "axis": _AXIS,
    "piston_area_m2": _NUMBER,
}
_OF_ONE_GEAR = ("axis", "piston_area_m2")
_BODY_SENSOR = {"channel": TEXT, "x_m": NUMBER, "y_m": NUMBER}
_STRUCTURE = {
    "kind": maybe(str, "one of " + ", ".join(map(repr, KINDS))),
    "shared": maybe(list, 'a list of lists of names, as [["left", "right"]]'),
    "position_tolerance_m": _NUMBER,
    "noise_m_per_s2": _NUMBER,
}
_RUN = {
    "name": TEXT,
    "log": maybe(str, "text in quotes"),
    "loading": maybe((list, str), "rows [[mass_kg, x_m, y_m], ...] or the name of a CSV file in quotes"),
    "mass_change_kg": _NUMBER,
    "start_s": _NUMBER,
    "stop_s": _NUMBER,
    "channels": maybe(dict, "a table [runs.channels]"),
}
_BODY_LEAK = {
    "channel": TEXT,
    "into": Key(str, "the name of the channel that lets it in"),
    "tolerance": _NUMBER,
}

_OF_A_SENSOR = "[channels.NAME] of a sensor of an interface or of the body"


def is_body_study(document: Mapping[str, Any]) -> bool:
    """Return whether a study file is about a body on several suspensions: it has [[interfaces]], misspelt perhaps.

    Args:
        document: what the file holds.

    >>> is_body_study({"interfaces": []}), is_body_study({"channels": {}})
    (True, False)
    """
    return "interfaces" in {*document, *misspelt(document, _STUDY)}


def document_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with the keys of a study file and the types of their values.

    Args:
        document: what the file holds.
    """
    yield from _body_faults(document) if is_body_study(document) else _gear_faults(document)


def _body_faults(document: Document) -> Iterator[str]:
    """Of a study with [[interfaces]]."""
    yield from table_faults("the study", _without(document, ("sensors", *_OF_ONE_GEAR)), _STUDY)
    for key in _OF_ONE_GEAR:
        if key in document:
            yield f"the study has {key!r}, which belongs to one gear: give it in each table [[interfaces]]"
    yield from _general_faults(document)
    if isinstance(document.get("sensors"), list):
        yield "[[sensors]] is no table of the study of a body, call further sensors on the body [[body_sensors]]"
    elif isinstance(document.get("sensors"), dict):
        yield from _body_sensor_faults(document["sensors"], _sensors_named(document))
    elif "sensors" in document:
        yield f"'sensors' in the study is {document['sensors']!r}, give tables [[sensors.leak]]"
    if isinstance(document.get("channels"), dict):
        yield from _channel_faults("channels", document["channels"])
        yield from _useless_facts("channels", document["channels"], _sensors_named(document), _OF_A_SENSOR)
    for number, entry in _tables(document, "interfaces"):
        yield from _interface_faults(number, entry)
    for number, entry in _tables(document, "body_sensors"):
        yield from table_faults(f"[[body_sensors]] number {number}", entry, _BODY_SENSOR)
    if isinstance(document.get("structure"), dict):
        yield from _structure_faults(document["structure"])
    for number, entry in _tables(document, "runs"):
        yield from _run_faults(number, entry)


def loading_of(entry: Mapping[str, Any], directory: Path) -> tuple[PointMass, ...]:
    """Return what a run carries more than the reference.

    Args:
        entry: a table [[runs]], checked by `document_faults`.
        directory: where the file of a loading table is looked for.

    Raises:
        InputError: a file that is not there or no loading table.
    """
    loading = entry.get("loading", [])
    if isinstance(loading, str):
        return read_loading(directory / loading)
    return tuple(PointMass(*(float(value) for value in row)) for row in loading)


def read_loading(path: Path) -> tuple[PointMass, ...]:
    """Read a loading table: a CSV file with the columns mass_kg, x_m and y_m, in any order among others.

    Args:
        path: the file; its columns stand apart by commas, or by semicolons (numbers may then have decimal commas).

    Raises:
        InputError: no such file, a column that is missing, a cell that is no number: all at once.
    """
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except OSError as error:
        raise InputError(f"cannot read the loading table {path}: {error.strerror}: check the name") from error
    except ValueError as error:  # no UTF-8, or a zero byte in the name
        raise InputError(f"the loading table {path} is no UTF-8 text: give a CSV file") from error
    delimiter = ";" if lines and ";" in lines[0] else ","
    head, *rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter)] or [[]]
    faults = [f"lacks the column {name!r} ({nearest(name, head)})" for name in COLUMNS if name not in head]
    loading = []
    for number, row in enumerate([] if faults else rows, start=2):
        cells = [row[head.index(name)] if head.index(name) < len(row) else "" for name in COLUMNS]
        values = [_number(cell.replace(",", ".") if delimiter == ";" else cell) for cell in cells]
        faults += [
            f"has {cell!r} for {name} in row {number}, give a number"
            for name, cell, value in zip(COLUMNS, cells, values, strict=True)
            if value is None
        ]
        loading.append(PointMass(*(math.nan if value is None else value for value in values)))
    if not faults and not rows:
        faults = ["has no row below its head, give one a mass (for the reference leave 'loading' out)"]
    if faults:
        raise InputError(f"the loading table {path} {'; it '.join(faults)}")
    return tuple(loading)


def _body_sensor_faults(sensors: Mapping[str, Any], names: Sequence[str]) -> Iterator[str]:
    right = "what is known of a sensor of a body stands in the table of its channel"
    for key in sensors:
        if key in names:
            yield f"[sensors.{key}] is no table of the study of a body, write [channels.{key}]: {right}"
        elif key != "leak":
            yield (
                f"[sensors.{key}] is no table of the study of a body: {right}, [channels.NAME]; "
                f"{nearest(key, ('leak', *names))}"
            )
    leaks = sensors.get("leak", [])
    if not isinstance(leaks, list):
        yield "'leak' in [sensors] is no list, give one table [[sensors.leak]] for each recorded axis that leaks in"
    for number, entry in enumerate(leaks if isinstance(leaks, list) else [], start=1):
        yield from table_faults(f"[[sensors.leak]] number {number}", entry, _BODY_LEAK)


def _tables(document: Document, name: str) -> Iterator[tuple[int, Any]]:
    entries = document.get(name)
    return enumerate(entries if isinstance(entries, list) else [], start=1)


def _called(what: str, number: int, entry: Any) -> str:
    name = entry.get("name") if isinstance(entry, dict) else None
    return f"[[{what}]] {name!r}" if isinstance(name, str) and name else f"[[{what}]] number {number}"


def _interface_faults(number: int, entry: Any) -> Iterator[str]:
    where = _called("interfaces", number, entry)
    yield from table_faults(where, entry, _INTERFACE)
    if not isinstance(entry, dict):
        return
    there = {*entry, *misspelt(entry, _INTERFACE)}
    if "sprung" not in there and "unsprung" not in there:
        yield f"{where} has neither 'sprung' nor 'unsprung', give the channels above and below the suspension"
    elif "sprung" not in there:
        yield f"{where} has 'unsprung' without 'sprung', give the channel on the body above the suspension, too"
    elif "unsprung" not in there:
        yield (
            f"{where} has 'sprung' without 'unsprung', give the channel below the suspension, too "
            "(a sensor on the body alone belongs in [[body_sensors]])"
        )


def _structure_faults(structure: Mapping[str, Any]) -> Iterator[str]:
    yield from table_faults("[structure]", structure, _STRUCTURE)
    shared = structure.get("shared")
    if isinstance(shared, list):
        if shared and all(isinstance(name, str) for name in shared):
            written = ", ".join(f'"{name}"' for name in shared)
            yield f"'shared' in [structure] is a list of names, give a list of groups: [[{written}]]"
            return
        for group in shared:
            if not isinstance(group, list) or not all(isinstance(name, str) for name in group) or len(group) < 2:
                yield f"'shared' in [structure] has the group {group!r}, give two names or more in each"


def _run_faults(number: int, entry: Any) -> Iterator[str]:
    where = _called("runs", number, entry)
    yield from table_faults(where, entry, _RUN)
    if not isinstance(entry, dict):
        return
    change = entry.get("mass_change_kg")
    if change is not None and "loading" in entry:
        yield f"{where} has 'loading' and 'mass_change_kg', leave out 'mass_change_kg': the loading says it"
    elif isinstance(change, (int, float)) and change != 0:
        yield (
            f"{where} has 'mass_change_kg' = {change:g}, say where that mass is, too: "
            f"loading = [[{change:g}, x_m, y_m]] in its place"
        )
    if isinstance(entry.get("loading"), list):
        yield from _loading_faults(where, entry["loading"])
    if isinstance(entry.get("channels"), dict):
        yield from _channel_faults("runs.channels", entry["channels"])
        yield from _useless_facts("runs.channels", entry["channels"], (), _OF_A_SENSOR)


def _sensors_named(document: Document) -> list[str]:
    """Channels that the tables of a body call sensors."""
    named = (("interfaces", "sprung"), ("interfaces", "unsprung"), ("body_sensors", "channel"))
    entries = [(entry, key) for name, key in named for _, entry in _tables(document, name) if isinstance(entry, dict)]
    return [entry[key] for entry, key in entries if isinstance(entry.get(key), str)]


def _loading_faults(where: str, rows: Sequence[Any]) -> Iterator[str]:
    if len(rows) == 3 and all(_is_number(value) for value in rows):
        written = ", ".join(f"{value:g}" for value in rows)
        yield f"'loading' in {where} is one row, give a list of rows: [[{written}]]"
        return
    for place, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != 3 or not all(_is_number(value) for value in row):
            yield f"row {place} of 'loading' in {where} is {row!r}, give three numbers [mass_kg, x_m, y_m]"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _gear_faults(document: Document) -> Iterator[str]:
    """Of a study with [channels] sprung and unsprung."""
    yield from table_faults("the study", _without(document, _OF_A_BODY["the study"]), _GEAR_STUDY)
    yield from _facts_of_a_body(document)
    yield from _general_faults(document)
    if isinstance(document.get("channels"), dict):
        for side in SIDES:
            if side not in document["channels"]:
                hint = nearest(side, document["channels"])
                yield f"[channels] lacks {side!r}, give the name of a channel or a table ({hint})"
        yield from _channel_faults("channels", document["channels"])
        yield from _useless_facts("channels", document["channels"], SIDES)
    if isinstance(document.get("runs"), list):
        for number, entry in enumerate(document["runs"], start=1):
            yield from table_faults(f"[[runs]] number {number}", _without(entry, _OF_A_BODY["[[runs]]"]), _GEAR_RUN)
            if isinstance(entry, dict) and isinstance(entry.get("channels"), dict):
                yield from _channel_faults("runs.channels", entry["channels"])
                yield from _useless_facts("runs.channels", entry["channels"], ())
    if isinstance(document.get("sensors"), dict):
        channels = document.get("channels")
        yield from _sensor_faults(document["sensors"], channels if isinstance(channels, dict) else {})


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


def _general_faults(document: Document) -> Iterator[str]:
    """Of the keys that every study file may have: date, rate, [log]."""
    # a date with a time is a date to Python
    if isinstance(document.get("date"), datetime):
        yield f"'date' in the study is {document['date']}, give the day alone, as {document['date'].date()}"
    if isinstance(document.get("log"), dict):
        yield from table_faults("[log]", document["log"], LOG)
    fs_hz = document.get("fs_hz", 1.0)
    if isinstance(fs_hz, (int, float)) and not (math.isfinite(fs_hz) and fs_hz > 0):
        yield f"'fs_hz' in the study is {fs_hz}, give a positive rate in Hz"


def _channel_faults(where: str, entries: Mapping[str, Any]) -> Iterator[str]:
    """Of the entries of [channels], or of [runs.channels]."""
    for name, entry in entries.items():
        if isinstance(entry, dict):
            yield from table_faults(f"[{where}.{name}]", entry, _CHANNEL)
            if isinstance(entry.get("log"), dict):
                yield from table_faults(f"[{where}.{name}.log]", entry["log"], LOG)
        elif not isinstance(entry, (str, int)) or isinstance(entry, bool):
            yield f"{name!r} in [{where}] is {entry!r}, give the name of a channel, its number or a table"


def _useless_facts(
    where: str,
    entries: Mapping[str, Any],
    known: Sequence[str],
    right: str = "[channels.sprung] or [channels.unsprung]",
) -> Iterator[str]:
    """Facts of sensors where nothing would come of them, and where they would be right."""
    for name, entry in entries.items():
        for key in SENSOR_KEYS if isinstance(entry, dict) and name not in known else ():
            if key in entry:
                yield f"{key!r} stands in [{where}.{name}], give it in {right}"


def _sensor_faults(sensors: Mapping[str, Any], channels: Mapping[str, Any]) -> Iterator[str]:
    called = {entry.get("channel") if isinstance(entry, dict) else entry: side for side, entry in channels.items()}
    by_channel = [name for name in sensors if name not in _SENSORS and called.get(name) in SIDES]
    for name in by_channel:
        yield f"[sensors.{name}] is called by its channel, write [sensors.{called[name]}]"
    yield from table_faults("[sensors]", _without(sensors, by_channel), _SENSORS)
    for side in SIDES:
        if isinstance(sensors.get(side), dict):
            yield from table_faults(f"[sensors.{side}]", sensors[side], _SENSOR)
    for number, entry in enumerate(sensors.get("leak", []) if isinstance(sensors.get("leak"), list) else [], 1):
        yield from table_faults(f"[[sensors.leak]] number {number}", entry, _LEAK)
