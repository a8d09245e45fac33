"""What may stand in a study file, of one gear or of a body on several suspensions, and what is wrong with one."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Any

from opid.errors import InputError, nearest
from opid.studies.kinds import SUSPENSIONS
from opid.studies.tables import (
    CHANNEL,
    LOG,
    MAYBE_NUMBER,
    MAYBE_TEXT,
    NUMBER,
    TEXT,
    Document,
    Key,
    called,
    dict_at,
    elsewhere,
    keys_of,
    list_at,
    maybe,
    misspelt,
    one_of,
    table_faults,
)
from opid.suspensions.sensor_facts import SIDES, Leak, SensorFacts
from opid.suspensions.study import KINDS, BodySensor, MeasuredInterface, PointMass, StructureSettings

_OF_A_BODY = elsewhere(
    "which belongs to a body on several suspensions: describe each suspension in [[interfaces]] (name, sprung, "
    "unsprung, x_m, y_m), or leave it out for one gear"
)
_OF_ONE_GEAR = elsewhere("which belongs to one gear: give it in each table [[interfaces]]")

_SENSOR = keys_of(SensorFacts)
SENSOR_KEYS = tuple(_SENSOR)
_CHANNEL = {**CHANNEL, **_SENSOR}


def _run_keys(**load: Key) -> dict[str, Key]:
    return {
        "name": TEXT,
        "log": MAYBE_TEXT,
        **load,
        "start_s": MAYBE_NUMBER,
        "stop_s": MAYBE_NUMBER,
        "channels": maybe(dict, "a table [runs.channels]", entries=_CHANNEL),
    }


_INTERFACE = keys_of(
    MeasuredInterface,
    without=["facts"],
    sprung=maybe(str, "the name of a channel in quotes"),
    unsprung=maybe(str, "the name of a channel in quotes"),
    x_m=NUMBER,
    y_m=NUMBER,
)
_STUDY = {
    "title": MAYBE_TEXT,
    "date": maybe(date, "a date without quotes, as 2026-03-01"),
    "fs_hz": MAYBE_NUMBER,
    "repeatability": MAYBE_NUMBER,
}
_LOG = maybe(dict, "a table [log]", keys=LOG)
_GEAR_STUDY = {
    **_STUDY,
    **{name: _INTERFACE[name] for name in ("axis", "piston_area_m2")},
    "log": _LOG,
    "channels": Key(dict, SUSPENSIONS.needs["channels"], entries=_CHANNEL),
    "runs": Key(list, SUSPENSIONS.needs["runs"], keys=_run_keys(mass_change_kg=NUMBER, loading=_OF_A_BODY)),
    "sensors": maybe(dict, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]"),
    "structure": _OF_A_BODY,
    "body_sensors": _OF_A_BODY,
}


def _leaks(into: Key) -> Key:
    what = "one table [[sensors.leak]] for each recorded axis that leaks in"
    return maybe(list, what, keys=keys_of(Leak, into=into))


_SENSORS = {
    "sprung": maybe(dict, "a table [sensors.sprung]", keys=_SENSOR),
    "unsprung": maybe(dict, "a table [sensors.unsprung]", keys=_SENSOR),
    "leak": _leaks(maybe(str, one_of(SIDES))),
}
_STRUCTURE = keys_of(
    StructureSettings,
    kind=maybe(str, one_of(KINDS)),
    shared=maybe(list, 'a list of lists of names, as [["left", "right"]]'),
)
_LOADING = maybe((list, str), "rows [[mass_kg, x_m, y_m], ...] or the name of a CSV file in quotes")
_BODY_STUDY = {
    **_STUDY,
    "axis": _OF_ONE_GEAR,
    "piston_area_m2": _OF_ONE_GEAR,
    "log": _LOG,
    "channels": maybe(dict, "a table [channels]", entries=_CHANNEL),
    "interfaces": Key(list, "one table [[interfaces]] for each suspension", keys=_INTERFACE, is_named=True),
    "body_sensors": maybe(
        list,
        "one table [[body_sensors]] for each further sensor on the body",
        keys=keys_of(BodySensor, without=["facts", "leaks"]),
    ),
    "structure": maybe(dict, "a table [structure]", keys=_STRUCTURE),
    "sensors": maybe((dict, list), "tables [[sensors.leak]]"),
    "runs": Key(
        list,
        SUSPENSIONS.needs["runs"],
        keys=_run_keys(loading=_LOADING, mass_change_kg=MAYBE_NUMBER),
        is_named=True,
    ),
}
_BODY_LEAKS = _leaks(Key(str, "the name of the channel that lets it in"))

COLUMNS = ("mass_kg", "x_m", "y_m")
"""Of a loading table."""


def is_body_study(document: Mapping[str, Any]) -> bool:
    """Return whether a study file is about a body on several suspensions: it has [[interfaces]], misspelt perhaps.

    >>> is_body_study({"interfaces": []}), is_body_study({"channels": {}})
    (True, False)
    """
    return "interfaces" in {*document, *misspelt(document, _BODY_STUDY)}


def document_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with the keys of a study file and the types of their values."""
    is_body = is_body_study(document)
    yield from table_faults("the study", document, _BODY_STUDY if is_body else _GEAR_STUDY)
    # a date with a time is a date to Python
    if isinstance(document.get("date"), datetime):
        yield f"'date' in the study is {document['date']}, give the day alone, as {document['date'].date()}"
    fs_hz = document.get("fs_hz", 1.0)
    if NUMBER.takes(fs_hz) and not (math.isfinite(fs_hz) and fs_hz > 0):
        yield f"'fs_hz' in the study is {fs_hz}, give a positive rate in Hz"
    yield from _body_faults(document) if is_body else _gear_faults(document)
    known = _sensors_named(document) if is_body else SIDES
    right = "[channels.NAME] of a sensor of an interface or of the body" if is_body else ""
    places = [("channels", dict_at(document, "channels"), known)]
    runs = [run for run in list_at(document, "runs") if isinstance(run, dict)]
    for where, entries, sensors in (*places, *(("runs.channels", dict_at(run, "channels"), ()) for run in runs)):
        yield from _useless_facts(where, entries, sensors, right or "[channels.sprung] or [channels.unsprung]")


def _gear_faults(document: Document) -> Iterator[str]:
    """Of a study with [channels] sprung and unsprung."""
    channels = dict_at(document, "channels")
    for side in SIDES if isinstance(document.get("channels"), dict) else ():
        if side not in channels:
            yield f"[channels] lacks {side!r}, give the name of a channel or a table ({nearest(side, channels)})"
    called_in_log = {side: channels[side] for side in SIDES if side in channels}
    called_in_log |= {side: each.get("channel") for side, each in called_in_log.items() if isinstance(each, dict)}
    sensors = dict_at(document, "sensors")
    by_channel = [name for name in sensors if name not in _SENSORS and name in called_in_log.values()]
    for name in by_channel:
        side = next(side for side in SIDES if called_in_log.get(side) == name)
        yield f"[sensors.{name}] is called by its channel, write [sensors.{side}]"
    others = {name: value for name, value in sensors.items() if name not in by_channel}
    yield from table_faults("[sensors]", others, _SENSORS, "sensors")


def _body_faults(document: Document) -> Iterator[str]:
    """Of a study with [[interfaces]]."""
    if isinstance(document.get("sensors"), list):
        yield "[[sensors]] is no table of the study of a body, call further sensors on the body [[body_sensors]]"
    yield from _body_sensor_faults(dict_at(document, "sensors"), _sensors_named(document))
    for number, entry in enumerate(list_at(document, "interfaces"), start=1):
        if isinstance(entry, dict):
            yield from _side_faults(called("interfaces", number, entry), {*entry, *misspelt(entry, _INTERFACE)})
    yield from _shared_faults(list_at(dict_at(document, "structure"), "shared"))
    for number, entry in enumerate(list_at(document, "runs"), start=1):
        if isinstance(entry, dict):
            yield from _load_faults(called("runs", number, entry), entry)


def loading_of(entry: Mapping[str, Any], directory: Path) -> tuple[PointMass, ...]:
    """Return what a run carries more than the reference.

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
    leaks = {name: value for name, value in sensors.items() if name == "leak"}
    yield from table_faults("[sensors]", leaks, {"leak": _BODY_LEAKS}, "sensors")


def _side_faults(where: str, there: set[str]) -> Iterator[str]:
    if "sprung" not in there and "unsprung" not in there:
        yield f"{where} has neither 'sprung' nor 'unsprung', give the channels above and below the suspension"
    elif "sprung" not in there:
        yield f"{where} has 'unsprung' without 'sprung', give the channel on the body above the suspension, too"
    elif "unsprung" not in there:
        yield (
            f"{where} has 'sprung' without 'unsprung', give the channel below the suspension, too "
            "(a sensor on the body alone belongs in [[body_sensors]])"
        )


def _shared_faults(shared: Sequence[Any]) -> Iterator[str]:
    if shared and all(isinstance(name, str) for name in shared):
        written = ", ".join(f'"{name}"' for name in shared)
        yield f"'shared' in [structure] is a list of names, give a list of groups: [[{written}]]"
        return
    for group in shared:
        if not isinstance(group, list) or not all(isinstance(name, str) for name in group) or len(group) < 2:
            yield f"'shared' in [structure] has the group {group!r}, give two names or more in each"


def _load_faults(where: str, entry: Mapping[str, Any]) -> Iterator[str]:
    change = entry.get("mass_change_kg")
    if change is not None and "loading" in entry:
        yield f"{where} has 'loading' and 'mass_change_kg', leave out 'mass_change_kg': the loading says it"
    elif isinstance(change, (int, float)) and change != 0:
        yield (
            f"{where} has 'mass_change_kg' = {change:g}, say where that mass is, too: "
            f"loading = [[{change:g}, x_m, y_m]] in its place"
        )
    rows = list_at(entry, "loading")
    if len(rows) == 3 and all(NUMBER.takes(value) for value in rows):
        written = ", ".join(f"{value:g}" for value in rows)
        yield f"'loading' in {where} is one row, give a list of rows: [[{written}]]"
        return
    for place, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) != 3 or not all(NUMBER.takes(value) for value in row):
            yield f"row {place} of 'loading' in {where} is {row!r}, give three numbers [mass_kg, x_m, y_m]"


def _sensors_named(document: Document) -> list[str]:
    """Channels that the tables of a body call sensors."""
    named = (("interfaces", "sprung"), ("interfaces", "unsprung"), ("body_sensors", "channel"))
    entries = [(entry, key) for name, key in named for entry in list_at(document, name) if isinstance(entry, dict)]
    return [entry[key] for entry, key in entries if isinstance(entry.get(key), str)]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _useless_facts(where: str, entries: Mapping[str, Any], known: Sequence[str], right: str) -> Iterator[str]:
    """Facts of sensors where nothing would come of them, and where they would be right."""
    for name, entry in entries.items():
        for key in SENSOR_KEYS if isinstance(entry, dict) and name not in known else ():
            if key in entry:
                yield f"{key!r} stands in [{where}.{name}], give it in {right}"
