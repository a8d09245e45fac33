"""Study files and logs -> `Study`, and back."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from opid.errors import InputError
from opid.signals.files import written_whole
from opid.signals.log_settings import ChannelSettings, LogSettings
from opid.signals.logs import write_log
from opid.signals.recording import Recording
from opid.signals.tables import Document, channel_settings, load, log_settings, refuse
from opid.suspensions.one_gear.study import Study
from opid.suspensions.one_gear.study_tables import SENSOR_KEYS, document_faults
from opid.suspensions.run_files import RunFiles, Source, at_one_rate, run_from_files
from opid.suspensions.sensor_facts import IDEAL_PAIR, SIDES, Leak, SensorFacts, SensorPair
from opid.suspensions.study_tables import is_body_study

Say = Callable[[str], None]


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


def read_study(path: str | os.PathLike[str], *, progress: Say | None = None) -> Study:
    """Read a study file and the logs that it names.

    Args:
        path: a TOML file with `title`, `date` (of the runs, without quotes: 2026-03-01), a table `[channels]`
            (`sprung`, `unsprung`, and further ones by any name: each the name of a channel in the logs, or a table with
            the fields of `ChannelSettings` and `SensorFacts`), and one table `[[runs]]` for each log: `name`, `log`
            (path beside the study file), `mass_change_kg`, and optionally `start_s` and `stop_s` on the time axis of
            the log (where neither is given, the sound stretch of sustained motion is found), and `[runs.channels]` for
            what differs in this run. How logs are to be read goes into `[log]` (the fields of `LogSettings`; `log` in a
            channel's table for its own file). `{run}` in a channel's `file` stands for the run's name. `fs_hz` is the
            rate to identify at. What is known of the sensors may also stand in `[sensors.sprung]` and
            `[sensors.unsprung]`, a further recorded axis that leaks in in `[[sensors.leak]]` (`channel`, `into`,
            `tolerance`; without `into`, both sides).
        progress: called with the name of each log as it is read.

    Raises:
        InputError: the file is missing or no TOML, an unknown, missing or mistyped key, or a log is at fault.
    """
    source = Path(path)
    document = load(source)
    if is_body_study(document):
        raise InputError(
            f"{source} has [[interfaces]], so it is the study of a body on several suspensions: read it with "
            "read_body_study, or identify it with `opid identify`"
        )
    refuse(list(document_faults(document)), source)
    runs, faults = [], []
    try:
        sensors = _sensors(document)
        all_files = [run_files_of(document, entry, source.parent) for entry in document["runs"]]
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    for files in all_files:
        try:
            runs.append(run_from_files(files, fs_hz=document.get("fs_hz"), progress=progress))
        except InputError as error:
            faults.append(f"run {files.name!r}: {error}")
    refuse(faults, source)
    names = {side: _name(document["channels"], side) for side in SIDES}
    title = document.get("title", source.stem)
    return Study(title, names["sprung"], names["unsprung"], at_one_rate(runs), source, sensors, document.get("date"))


def study_from_logs(
    paths: Sequence[str | os.PathLike[str]],
    *,
    sprung: str,
    unsprung: str,
    mass_changes_kg: Sequence[float],
    title: str = "",
    progress: Say | None = None,
) -> Study:
    """Return the study of some logs, the first of which is the reference.

    Args:
        paths: the logs.
        sprung: name of the channel on the airframe.
        unsprung: name of the channel on the spindle.
        mass_changes_kg: sprung mass of each further log less that of the first, kg.
        title: of the study.
        progress: called with the name of each log as it is read.

    Raises:
        InputError: no log, a number of mass changes other than of further logs, or a log is at fault.
    """
    if not paths or len(mass_changes_kg) != len(paths) - 1:
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
        runs.append(run_from_files(RunFiles(name, sources, float(change)), progress=progress))
    return Study(title, sprung, unsprung, at_one_rate(runs))


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
    refuse(list(document_faults(document)), source)
    try:
        settings = log_settings(document.get("log", {}))
        all_files = [run_files_of(document, entry, source.parent) for entry in document["runs"]]
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    return readings_of(all_files, settings, log)


def readings_of(
    all_files: Sequence[RunFiles], settings: LogSettings, log: str | os.PathLike[str]
) -> tuple[LogReading, ...]:
    """Return how one log is read, given where the channels of each run are found.

    Args:
        all_files: of the runs.
        settings: for a log from which no run takes a channel.
        log: the file, by any path that leads to it.
    """
    users = [(files.name, taken) for files in all_files if (taken := _taken(files, _place(log)))]
    if not users:
        return (LogReading(settings),)
    runs = tuple(name for name, _ in users)
    return tuple(LogReading(how, channels, runs) for how, channels in users[0][1].items())


def write_study(study: Study, path: str | os.PathLike[str]) -> None:
    """Write a study so that `read_study` gives it back: the study file, and `NAME.csv` beside it for a run.

    Args:
        study: what to write.
        path: the study file; its directory must exist.

    Raises:
        InputError: a place that cannot be written to, or a run whose name is no file name.
    """
    target = Path(path)
    write_logs({run.name: run.recording for run in study.runs}, target.parent)
    channels = {"unsprung": study.unsprung, "sprung": study.sprung}
    # every further channel of the runs by its own name, so that it is read back
    channels |= {name: name for run in study.runs for name in run.recording.names if name not in channels.values()}
    sensors = _sensor_tables(study.sensors)
    known = {"sensors": sensors} if sensors else {}
    day = {} if study.date is None else {"date": study.date}
    text = tomli_w.dumps({"title": study.title, **day, "channels": channels, **known})
    for run in study.runs:
        entry = {"name": run.name, "log": f"{run.name}.csv", "mass_change_kg": run.mass_change_kg}
        # all of it: without a start the stretch in motion would be looked for
        entry |= {"start_s": run.recording.start_s}
        text += "\n[[runs]]\n" + tomli_w.dumps(entry)
    with written_whole(target) as file:
        file.write(text)


def write_logs(recordings: Mapping[str, Recording], directory: Path) -> None:
    """Write `NAME.csv` for each run.

    Args:
        recordings: by the name of the run.
        directory: must exist.

    Raises:
        InputError: a place that cannot be written to, or a run whose name is no file name.
    """
    for name in recordings:
        if name in ("", ".", "..") or Path(name).name != name:
            raise InputError(f"the run {name!r} cannot name its log: call it by one plain word")
    for name, recording in recordings.items():
        write_log(recording, directory / f"{name}.csv")


# ---- tables -> settings ----------------------------------------------------------------------------


def _name(channels: Mapping[str, Any], key: str) -> str:
    """What a channel is called in the recordings: by its name in the log, or by its table."""
    entry = channels[key]
    return entry if isinstance(entry, str) else key


def run_files_of(document: Document, entry: Mapping[str, Any], directory: Path) -> RunFiles:
    """Return where each channel of a run is found, and how it is read.

    Args:
        document: what a study file holds, checked.
        entry: the table [[runs]] of the run.
        directory: that paths start from.

    Raises:
        InputError: a value that cannot be, a channel that is in no file, two of one name.
    """
    channels = document["channels"]
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
    return RunFiles(entry["name"], sources, float(entry["mass_change_kg"]), entry.get("start_s"), entry.get("stop_s"))


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


def _as_table(entry: str | int | Mapping[str, Any]) -> Mapping[str, Any]:
    return entry if isinstance(entry, Mapping) else {"channel": entry}


def _sensors(document: Document) -> SensorPair:
    """What is known of the sensors, from [sensors.SIDE] and from the tables of their channels."""
    tables, facts = document.get("sensors", {}), {}
    for side in SIDES:
        entry = document["channels"][side]
        of_channel = {key: value for key, value in _as_table(entry).items() if key in SENSOR_KEYS}
        for key in sorted(of_channel.keys() & tables.get(side, {}).keys()):
            raise InputError(f"{key!r} stands in [channels.{side}] and in [sensors.{side}]: give it once")
        try:
            facts[side] = SensorFacts(**tables.get(side, {}), **of_channel)
        except InputError as error:
            raise InputError(f"[sensors] {error}") from None
    try:
        leaks = [
            Leak(**{**entry, "channel": _leaking(document["channels"], entry), "into": into})
            for entry in tables.get("leak", [])
            for into in ([entry["into"]] if "into" in entry else ["unsprung", "sprung"])
        ]
    except InputError as error:
        raise InputError(f"[sensors] {error}") from None
    if not leaks and facts["unsprung"] == facts["sprung"] == SensorFacts():
        return IDEAL_PAIR
    return SensorPair(facts["unsprung"], facts["sprung"], tuple(leaks))


def _sensor_tables(sensors: SensorPair) -> dict[str, Any]:
    """Only what differs from an ideal sensor."""
    tables: dict[str, Any] = {}
    for side in SIDES:
        facts = {name: value for name, value in asdict(getattr(sensors, side)).items() if value}
        if facts:
            tables[side] = facts
    if sensors.leaks:
        tables["leak"] = [asdict(leak) for leak in sensors.leaks]
    return tables
