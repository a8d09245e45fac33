"""Study files and logs -> `Study`, and back: one gear by its two channels, or a body by its interfaces."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from opid.errors import InputError, nearest, refuse
from opid.signals.health.result import Finding
from opid.signals.log_settings import ChannelSettings, LogSettings
from opid.signals.logs import write_log
from opid.studies.kinds import SUSPENSIONS, kind_of
from opid.studies.run_files import RunFiles, Source, at_one_rate, run_from_files
from opid.studies.suspension_tables import SENSOR_KEYS, document_faults, is_body_study, loading_of
from opid.studies.tables import (
    Document,
    Say,
    channel_settings,
    load,
    log_settings,
    noted,
    prefixed,
    require_plain,
    stated,
    toml_of,
)
from opid.suspensions.sensor_facts import SIDES, Leak, SensorFacts, SensorPair, Side
from opid.suspensions.study import (
    Axis,
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
    study_of_gear,
)


@dataclass(frozen=True)
class LogReading:
    """How a study reads a log.

    Args:
        settings: of the log.
        channels: those taken from it, by the names that they will have; None for all, as the log calls them.
        runs: names of the runs that take channels from it; the first is the one that is told here.
    """

    settings: LogSettings
    channels: Mapping[str, ChannelSettings] | None = None
    runs: tuple[str, ...] = ()


def build_suspension_study(document: Document, source: Path, say: Say) -> Study:
    """Read the logs and loading tables that a study file of suspensions names, and return the study."""
    refuse(list(document_faults(document)), source)
    is_body = is_body_study(document)
    with prefixed(f"{source}: "):
        interfaces, further = _body_sensors(document) if is_body else ((), ())
        pair = SensorPair() if is_body else _sensors(document)
        all_files = [run_files_of(document, entry, source.parent) for entry in document["runs"]]
    runs: list[Run] = []
    faults: list[str] = []
    for entry, files in zip(document["runs"], all_files, strict=True):
        loading: tuple[PointMass, ...] | float = files.mass_change_kg
        with noted(faults, f"run {files.name!r}: "):
            loading = loading_of(entry, source.parent) if is_body else loading
        with noted(faults, f"run {files.name!r}: "):
            run = run_from_files(files, fs_hz=document.get("fs_hz"), progress=say)
            runs.append(replace(run, loading=loading))
    refuse(faults, source)
    runs = _with_stretches_of_one_log(runs, all_files)
    shared: dict[str, Any] = {"title": document.get("title", source.stem), "runs": at_one_rate(runs), "source": source}
    shared |= {name: document[name] for name in ("date", "repeatability") if name in document}
    if is_body:
        structure = _structure(document.get("structure", {}))
        return Study(interfaces=interfaces, structure=structure, sensors=further, **shared)
    shared |= {name: document[name] for name in ("axis", "piston_area_m2") if name in document}
    shared |= {side: _name(document["channels"], side) for side in SIDES}
    return study_of_gear(sensors=pair, **shared)


def _with_stretches_of_one_log(runs: Sequence[Run], files: Sequence[RunFiles]) -> list[Run]:
    """Say of runs that they are one flight: what differs from flight to flight is not seen between them."""
    found: list[Run] = []
    for place, (run, own) in enumerate(zip(runs, files, strict=True)):
        logs = {each.file for each in own.sources.values()}
        alike = [
            other.name
            for other, theirs in zip(runs[:place], files, strict=False)
            if other.masses == run.masses and not logs.isdisjoint(each.file for each in theirs.sources.values())
        ]
        words = (
            f"it is from one log with run {' and '.join(map(repr, alike))} and counts as another flight, though it "
            "tells nothing of how much flights differ: the intervals are too narrow; give one run for each flight"
        )
        more = (Finding("warning", "", words),) * bool(alike)
        found.append(replace(run, findings=(*run.findings, *more)))
    return found


def study_from_logs(
    paths: Sequence[str | os.PathLike[str]],
    *,
    sprung: str,
    unsprung: str,
    mass_changes_kg: Sequence[float],
    title: str = "",
    axis: Axis = "up",
    piston_area_m2: float | None = None,
    repeatability: float | None = None,
    progress: Say | None = None,
) -> Study:
    """Return the study of some logs of one gear, the first of which is the reference.

    Args:
        paths: the logs.
        sprung: name of the channel on the airframe.
        unsprung: name of the channel on the spindle.
        mass_changes_kg: sprung mass of each further log less that of the first, kg.
        title: of the study.
        axis: where the channels count positive, "up" or "down"; "horizontal" for motion that no weight acts on.
        piston_area_m2: what the gas of the strut pushes on; None where it is not known, or no gas carries the gear.
        repeatability: relative standard deviation by which springs, damping and friction differ from run to run; 0
            where they are known to be the same, None for what is usual.
        progress: called with the name of each log as it is read.

    Raises:
        InputError: no log, a number of mass changes other than of further logs, a log is at fault, or as `Study`.
    """
    for name, given, each in (("paths", paths, "a log"), ("mass_changes_kg", mass_changes_kg, "a further log")):
        if isinstance(given, (str, bytes, os.PathLike)) or not isinstance(given, Sequence | np.ndarray):
            raise InputError(f"{name} is {given!r}: give a list, with one entry for {each}")
    for change in mass_changes_kg:
        if isinstance(change, bool) or not isinstance(change, Real):
            raise InputError(f"a mass change is {change!r}: give a number, kg")
    for path in paths:
        if not isinstance(path, (str, os.PathLike)):
            raise InputError(f"a log is {path!r}: give the name of its file")
        if list(paths).count(path) > 1:
            raise InputError(f"the log {path} is given twice: each run has a log of its own")
    if len(paths) == 0 or len(mass_changes_kg) != len(paths) - 1:
        raise InputError(
            f"{len(paths)} log(s) and {len(mass_changes_kg)} mass change(s) are given: "
            "give the reference log first and one mass change for each log after it (--mass-change)"
        )
    names = [Path(path).stem for path in paths]
    if len(set(names)) < len(names):
        names = [str(path) for path in paths]
    runs = []
    for name, path, change in zip(names, paths, (0.0, *mass_changes_kg), strict=True):
        sources = {
            channel: Source(Path(path), ChannelSettings(channel)) for channel in dict.fromkeys((unsprung, sprung))
        }
        run = run_from_files(RunFiles(name, sources, float(change)), progress=progress)
        runs.append(replace(run, log=Path(path)))
    return study_of_gear(
        title,
        sprung=sprung,
        unsprung=unsprung,
        runs=at_one_rate(runs),
        axis=axis,
        piston_area_m2=piston_area_m2,
        repeatability=repeatability,
    )


def log_readings(path: str | os.PathLike[str], log: str | os.PathLike[str]) -> tuple[LogReading, ...]:
    """Return how a study reads one log: as the first run does that takes channels from it.

    Args:
        path: the study file; none of its logs need be there.
        log: the file, by any path that leads to it.

    Returns:
        One reading, or several where channels of the log have different `log` tables. A log from which no run takes a
        channel is read whole, as `[log]` says.

    Raises:
        InputError: the study is missing or no TOML, an unknown, missing or mistyped key, or a value that cannot be.
    """
    source = Path(path)
    document = load(source)
    if (kind := kind_of(document, source)) is not SUSPENSIONS:
        raise InputError(f"{source} is a study of {kind.subject}: give one of suspensions, or none")
    refuse(list(document_faults(document)), source)
    with prefixed(f"{source}: "):
        settings = log_settings(document.get("log", {}))
        all_files = [run_files_of(document, entry, source.parent) for entry in document["runs"]]
    users = [(files.name, taken) for files in all_files if (taken := _taken(files, _place(log)))]
    if not users:
        return (LogReading(settings),)
    runs = tuple(name for name, _ in users)
    return tuple(LogReading(how, channels, runs) for how, channels in users[0][1].items())


def write_suspension_logs(study: Study, directory: Path) -> str:
    """Write the log of each run, and return the text of the study file."""
    for run in study.runs:
        require_plain("run", run.name)
    for run in study.runs:
        write_log(run.recording, directory / f"{run.name}.csv")
    return _gear_text(study) if _is_told_by_channels(study) else _body_text(study)


def _is_told_by_channels(study: Study) -> bool:
    """Whether a study file with [channels] says all that is known."""
    first = study.interfaces[0]
    plain = MeasuredInterface(
        "gear",
        first.sprung,
        first.unsprung,
        facts=first.facts,
        axis=first.axis,
        piston_area_m2=first.piston_area_m2,
    )
    return study.is_one_gear and first == plain and study.structure == StructureSettings()


# ---- Study -> text ---------------------------------------------------------------------------------


_OF_THE_BODY = ("name", "sprung", "unsprung", "x_m", "y_m", "sensor_x_m", "sensor_y_m", "facts")
"""Fields of an interface that the study of one gear gives in other words, or not at all."""


def _gear_text(study: Study) -> str:
    channels = {"unsprung": study.unsprung, "sprung": study.sprung}
    sensors = _sensor_tables(study.interfaces[0].facts)
    head = (
        _head_of(study)
        | stated(study.interfaces[0], without=_OF_THE_BODY)
        | {"channels": channels | _further_of(study, channels.values())}
    )
    runs = [_run_table(run, mass_change_kg=run.mass_change_kg) for run in study.runs]
    return toml_of(head | ({"sensors": sensors} if sensors else {}), runs=runs)


def _head_of(study: Study) -> dict[str, Any]:
    known = {"title": study.title, "date": study.date, "repeatability": study.repeatability}
    return {name: value for name, value in known.items() if value is not None}


def _further_of(study: Study, used: Collection[str]) -> dict[str, str]:
    """Every further channel of the runs by its own name, so that it is read back."""
    return {name: name for run in study.runs for name in run.recording.names if name not in used}


def _run_table(run: Run, **more: float) -> dict[str, Any]:
    # all of it: without a start the stretch in motion would be looked for
    return {"name": run.name, "log": f"{run.name}.csv", **more, "start_s": run.recording.start_s}


def _body_text(study: Study) -> str:
    head = _head_of(study)
    facts = {name: stated(known) for name, known in _facts_by_channel(study).items() if stated(known)}
    used = {*study.channels("unsprung"), *study.channels("sprung")}
    channels: dict[str, Any] = _further_of(study, used)
    channels |= {name: {"channel": name, **known} for name, known in facts.items()}
    if channels:
        head["channels"] = channels
    head["structure"] = stated(study.structure, "kind")
    leaks = [
        {"channel": channel, "into": study.channels(side)[place], "tolerance": tolerance}
        for channel, side, place, tolerance in study.leaks()
    ]
    interfaces = [stated(each, "x_m", "y_m", without=["facts"]) for each in study.interfaces]
    sensors = [stated(each, without=["facts", "leaks"]) for each in study.sensors]
    loadings = [[[each.mass_kg, each.x_m, each.y_m] for each in run.masses] for run in study.runs]
    runs = [
        _run_table(run) | ({"loading": rows} if rows else {}) for run, rows in zip(study.runs, loadings, strict=True)
    ]
    head |= {"sensors": {"leak": leaks}} if leaks else {}
    return toml_of(head, interfaces=interfaces, body_sensors=sensors, runs=runs)


def _facts_by_channel(study: Study) -> dict[str, SensorFacts]:
    known = {interface.sprung: interface.facts.sprung for interface in study.interfaces}
    known |= {interface.unsprung: interface.facts.unsprung for interface in study.interfaces}
    return known | {sensor.channel: sensor.facts for sensor in study.sensors}


def _sensor_tables(sensors: SensorPair) -> dict[str, Any]:
    tables: dict[str, Any] = {side: stated(getattr(sensors, side)) for side in SIDES}
    tables["leak"] = [asdict(leak) for leak in sensors.leaks]
    return {name: table for name, table in tables.items() if table}


# ---- tables -> settings ----------------------------------------------------------------------------


def _name(channels: Mapping[str, Any], key: str) -> str:
    """What a channel is called in the recordings: by its name in the log, or by its table."""
    entry = channels[key]
    return entry if isinstance(entry, str) else key


def run_files_of(document: Document, entry: Mapping[str, Any], directory: Path) -> RunFiles:
    """Return where each channel of a run is found, and how it is read, from its table [[runs]]."""
    channels = _body_channels(document) if is_body_study(document) else document["channels"]
    wanted: dict[str, str | int | Mapping[str, Any]] = {}
    for key in channels:
        name = _name(channels, key)
        if name in wanted and channels[key] != wanted[name]:
            raise InputError(f"[channels]: {key!r} and another entry both give a channel called {name!r}: rename one")
        wanted[name] = channels[key]
    for leak in document.get("sensors", {}).get("leak", []):
        wanted.setdefault(_leaking(channels, leak), leak["channel"])
    for key, own in entry.get("channels", {}).items():
        name = _name(channels, key) if key in channels else key
        before = wanted.get(name, {})
        wanted[name] = {**_as_table(before), **own} if isinstance(own, Mapping) else own
    sources = {}
    for name, table in wanted.items():
        settings = channel_settings(name, table, without=(*SENSOR_KEYS, "log"))
        if settings.file is not None:
            settings = replace(settings, file=settings.file.replace("{run}", entry["name"]))
        how, where = document.get("log", {}), "[log]"
        if isinstance(table, Mapping) and "log" in table:
            how, where = table["log"], f"[channels.{name}.log]"
        if settings.file is None and "log" not in entry:
            raise InputError(f"run {entry['name']!r} has no 'log', and [channels.{name}] no 'file': give one of them")
        sources[name] = Source(directory / (settings.file or entry["log"]), settings, log_settings(how, where))
    change = float(entry.get("mass_change_kg", 0.0))
    return RunFiles(entry["name"], sources, change, entry.get("start_s"), entry.get("stop_s"))


def _body_channels(document: Document) -> dict[str, Mapping[str, Any]]:
    """The channels of a body; in the recordings each has the name by which the study calls it."""
    named = document.get("channels", {})
    wanted = [side for each in document["interfaces"] for side in (each["unsprung"], each["sprung"])]
    wanted += [each["channel"] for each in document.get("body_sensors", [])]
    return {name: _as_table(named.get(name, name)) for name in dict.fromkeys([*wanted, *named])}


def _taken(files: RunFiles, place: str) -> dict[LogSettings, dict[str, ChannelSettings]]:
    """The channels that a run takes from the file at this place, those that are read alike together."""
    taken: dict[LogSettings, dict[str, ChannelSettings]] = {}
    for name, source in files.sources.items():
        if _place(source.file) == place:
            taken.setdefault(source.settings, {})[name] = source.channel
    return taken


def _place(path: str | os.PathLike[str]) -> str:
    """The one path of a file, which need not be there."""
    try:
        return os.path.realpath(path)
    except ValueError:  # no file has such a name (a zero byte)
        return os.fspath(path)


def _leaking(channels: Mapping[str, Any], leak: Mapping[str, Any]) -> str:
    """What the channel of a leak is called in the recordings: it may be named by its key in [channels]."""
    return _name(channels, leak["channel"]) if leak["channel"] in channels else leak["channel"]


def _leak_of(channels: Mapping[str, Any], entry: Mapping[str, Any], into: str) -> Leak:
    with prefixed("[sensors] "):
        return Leak(**{**entry, "channel": _leaking(channels, entry), "into": into})


def _as_table(entry: str | int | Mapping[str, Any]) -> Mapping[str, Any]:
    return entry if isinstance(entry, Mapping) else {"channel": entry}


def _structure(table: Mapping[str, Any]) -> StructureSettings:
    shared = tuple(tuple(group) for group in table.get("shared", []))
    return StructureSettings(**{**table, "shared": shared})


def _facts_of(table: Mapping[str, Any], more: Mapping[str, Any] | None = None) -> SensorFacts:
    with prefixed("[sensors] "):
        return SensorFacts(**(more or {}), **{key: value for key, value in table.items() if key in SENSOR_KEYS})


def _body_sensors(document: Document) -> tuple[tuple[MeasuredInterface, ...], tuple[BodySensor, ...]]:
    """Interfaces and further sensors of a body, with what is known of each sensor."""
    channels = _body_channels(document)
    sides: dict[str, tuple[int, Side]] = {}
    for place, entry in enumerate(document["interfaces"]):
        sides |= {entry["unsprung"]: (place, "unsprung"), entry["sprung"]: (place, "sprung")}
    for place, entry in enumerate(document.get("body_sensors", []), start=len(document["interfaces"])):
        sides |= {entry["channel"]: (place, "sprung")}
    leaks: dict[int, list[Leak]] = {}
    for entry in document.get("sensors", {}).get("leak", []):
        if entry["into"] not in sides:
            raise InputError(
                f"[[sensors.leak]] leaks into {entry['into']!r}, which is no sensor of an interface or on the body: "
                f"{nearest(entry['into'], list(sides))}"
            )
        place, side = sides[entry["into"]]
        leaks.setdefault(place, []).append(_leak_of(channels, entry, side))
    interfaces = tuple(
        MeasuredInterface(
            **entry,
            facts=SensorPair(
                _facts_of(channels[entry["unsprung"]]),
                _facts_of(channels[entry["sprung"]]),
                tuple(leaks.get(place, ())),
            ),
        )
        for place, entry in enumerate(document["interfaces"])
    )
    further = tuple(
        BodySensor(**entry, facts=_facts_of(channels[entry["channel"]]), leaks=tuple(leaks.get(place, ())))
        for place, entry in enumerate(document.get("body_sensors", []), start=len(interfaces))
    )
    return interfaces, further


def _sensors(document: Document) -> SensorPair:
    """What is known of the sensors of one gear, from [sensors.SIDE] and from the tables of their channels."""
    tables, facts = document.get("sensors", {}), {}
    for side in SIDES:
        entry = _as_table(document["channels"][side])
        for key in sorted(tables.get(side, {}).keys() & entry.keys() & {*SENSOR_KEYS}):
            raise InputError(f"{key!r} stands in [channels.{side}] and in [sensors.{side}]: give it once")
        facts[side] = _facts_of(entry, tables.get(side, {}))
    leaks = [
        _leak_of(document["channels"], entry, into)
        for entry in tables.get("leak", [])
        for into in ([entry["into"]] if "into" in entry else ["unsprung", "sprung"])
    ]
    return SensorPair(facts["unsprung"], facts["sprung"], tuple(leaks))
