"""Study files and logs -> `Study`, and back: one gear by its two channels, or a body by its interfaces."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from datetime import date
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from opid.errors import FileError, InputError, meant_by, nearest, refuse
from opid.progress import Say
from opid.signals.files import read_table
from opid.signals.health.result import Finding
from opid.signals.log import AS_WRITTEN, ChannelSettings, LogSettings
from opid.signals.logs import write_log
from opid.signals.spectra import BY_METHOD, TransmissibilitySettings
from opid.studies.run_files import (
    CHANNEL,
    RunFiles,
    Source,
    add_files,
    bring_to_one_rate,
    find_sources,
    read_run,
    tabulate_channel,
)
from opid.studies.schema import (
    NO_KEY,
    Document,
    collect_faults,
    find_misspelt,
    format_toml,
    load,
    name_source,
    read_tables,
    recast,
    require_plain,
    select_stated,
)
from opid.studies.sensor_tables import (
    FACTS,
    STRUT_SENSORS,
    InterfaceTable,
    SensorTable,
    read_other_quantities,
    tabulate_struts,
)
from opid.studies.study_file import SUSPENSIONS, kind_of
from opid.studies.triaxial import Mounting, TriaxialSensor, level_runs
from opid.suspensions.sensor_facts import (
    IDEAL,
    LEAK_TOLERANCE,
    SIDES,
    Leak,
    SensorFacts,
    SensorPair,
    Side,
)
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

# ---- the tables of a study file --------------------------------------------------------------------

LOADING_COLUMNS = ("mass_kg", "x_m", "y_m")
"""The columns of a loading table."""

FACTS_OF_RUN = ("weighed_mass_kg", "weighed_tolerance_kg", "speed_m_per_s")
"""The keys of a run that a record of it keeps as they are: what a scale read, and how fast the vehicle was."""
OF_A_BODY = (
    "which belongs to a body on several suspensions: describe each suspension in [[interfaces]] (name, sprung, "
    "unsprung, x_m, y_m), or leave it out for one gear"
)
OF_ONE_GEAR = "which belongs to one gear: give it in each table [[interfaces]]"


_Channels = Mapping[str, Annotated[str | int | SensorTable, CHANNEL]]


@dataclass(frozen=True, kw_only=True)
class _Run:
    ELSEWHERE: ClassVar[dict[str, str]] = {"loading": OF_A_BODY}
    name: str
    log: str | None = None
    mass_change_kg: float
    start_s: float | None = None
    stop_s: float | None = None
    weighed_mass_kg: float | None = None
    weighed_tolerance_kg: float | None = None
    speed_m_per_s: Annotated[float | str | None, "a number in m/s, or the name of a channel in quotes"] = None
    channels: _Channels = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _BodyRun(_Run):
    mass_change_kg: float = 0.0
    loading: Annotated[
        str | tuple[tuple[float, float, float], ...],
        "rows [[mass_kg, x_m, y_m], ...] or the name of a CSV file in quotes",
    ] = ()

    def __post_init__(self) -> None:
        if self.mass_change_kg:
            raise InputError(
                f"'mass_change_kg' = {self.mass_change_kg:g} belongs to one gear, say where that mass is, too: "
                f"loading = [[{self.mass_change_kg:g}, x_m, y_m]] in its place"
            )


@dataclass(frozen=True, kw_only=True)
class _Leak:
    channel: str
    into: Annotated[str, "the name of the channel that lets it in"]
    tolerance: float = LEAK_TOLERANCE


@dataclass(frozen=True, kw_only=True)
class _GearLeak(_Leak):
    into: Side | None = None  # type: ignore[assignment]


@dataclass(frozen=True, kw_only=True)
class _Sensors:
    ELSEWHERE: ClassVar[dict[str, str]] = {"": "what is known of a sensor of a body stands in [channels.NAME]"}
    leak: tuple[_Leak, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _GearSensors(_Sensors):
    ELSEWHERE: ClassVar[dict[str, str]] = {"": "call it by its side, [sensors.sprung] or [sensors.unsprung]"}
    sprung: SensorFacts = IDEAL
    unsprung: SensorFacts = IDEAL
    leak: tuple[_GearLeak, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _BodySensor(BodySensor):
    facts: Annotated[SensorFacts, NO_KEY] = IDEAL
    leaks: Annotated[tuple[Leak, ...], NO_KEY] = ()


@dataclass(frozen=True, kw_only=True)
class _Study:
    title: str | None = None
    date: date | None = None
    fs_hz: float | None = None
    repeatability: float | None = None
    log: LogSettings = AS_WRITTEN


@dataclass(frozen=True, kw_only=True)
class _Body(_Study):
    ELSEWHERE: ClassVar[dict[str, str]] = dict.fromkeys(("axis", "piston_area_m2"), OF_ONE_GEAR) | {
        "transmissibility": "which belongs to the study of one gear: leave it out"
    }
    transmissibility: Annotated[TransmissibilitySettings, NO_KEY] = BY_METHOD
    channels: _Channels = field(default_factory=dict)
    structure: StructureSettings = field(default_factory=StructureSettings)
    sensors: Annotated[_Sensors, "tables [[sensors.leak]] (further sensors on the body are [[body_sensors]])"] = (
        _Sensors()
    )
    interfaces: Annotated[tuple[InterfaceTable, ...], "one table [[interfaces]] for each suspension"]
    body_sensors: tuple[_BodySensor, ...] = ()
    runs: Annotated[tuple[_BodyRun, ...], SUSPENSIONS.needs["runs"]]

    @property
    def sensor_channels(self) -> list[str]:
        channels = [channel for each in self.interfaces or () for channel in (each.unsprung, each.sprung)]
        return [*channels, *(each.channel for each in self.body_sensors)]

    @property
    def strut_channels(self) -> list[str]:
        return [channel for each in self.interfaces or () for channel in (each.travel, each.force) if channel]


@dataclass(frozen=True, kw_only=True)
class _Gear(_Study):
    ELSEWHERE: ClassVar[dict[str, str]] = dict.fromkeys(("structure", "body_sensors"), OF_A_BODY)
    axis: Axis = "up"
    piston_area_m2: float | None = None
    transmissibility: TransmissibilitySettings = BY_METHOD
    channels: Annotated[_Channels, SUSPENSIONS.needs["channels"]]
    sensors: Annotated[_GearSensors, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]"] = _GearSensors()
    runs: Annotated[tuple[_Run, ...], SUSPENSIONS.needs["runs"]]

    def to_body(self) -> _Body:
        """Return the gear as a body with one interface; its channels have the names of the recordings."""
        names = {key: entry if isinstance(entry, str) else key for key, entry in self.channels.items()}
        channels: dict[str, str | int | SensorTable] = {}
        for key, entry in self.channels.items():
            if channels.setdefault(names[key], entry) != entry:
                raise InputError(f"[channels]: {key!r} and another entry are both called {names[key]!r}: rename one")
        for side in SIDES:
            beside, table = (
                select_stated(getattr(self.sensors, side)),
                tabulate_channel(SensorTable, side, self.channels[side]),
            )
            for fact in sorted(beside.keys() & table.given):
                raise InputError(f"{fact!r} stands in [channels.{side}] and in [sensors.{side}]: give it once")
            channels[names[side]] = replace(table, **beside)
        leaks = tuple(
            _Leak(channel=names.get(leak.channel, leak.channel), into=names[side], tolerance=leak.tolerance)
            for leak in self.sensors.leak
            for side in ([leak.into] if leak.into else SIDES[::-1])
        )
        runs = tuple(
            recast(
                _BodyRun,
                run,
                mass_change_kg=0.0,
                loading=((run.mass_change_kg, 0.0, 0.0),) if run.mass_change_kg else (),
                channels={names.get(key, key): entry for key, entry in run.channels.items()},
                speed_m_per_s=names.get(run.speed_m_per_s, run.speed_m_per_s)
                if isinstance(run.speed_m_per_s, str)
                else run.speed_m_per_s,
            )
            for run in self.runs
        )
        read = {side: names[side] for side in SIDES} | {each: names.get(each, "") for each in STRUT_SENSORS}
        gear = recast(InterfaceTable, self, name="gear", x_m=0.0, y_m=0.0, **read)
        return recast(_Body, self, channels=channels, sensors=_Sensors(leak=leaks), interfaces=(gear,), runs=runs)


def read_suspension_tables(document: Document) -> tuple[_Gear | _Body, list[str]]:
    """Return the content of a study file of suspensions and its faults; one with [[interfaces]] is that of a body.

    >>> read_suspension_tables({"interfacs": [], "runs": []})[1]
    ["the study has an unknown key 'interfacs' (did you mean 'interfaces'?)"]
    """
    is_body = "interfaces" in {*document, *find_misspelt(document, [each.name for each in fields(_Body)])}
    study, faults = read_tables(_Body, document) if is_body else read_tables(_Gear, document)
    if study.fs_hz is not None and not (math.isfinite(study.fs_hz) and study.fs_hz > 0):
        faults.append(f"'fs_hz' in the study is {study.fs_hz}, give a positive rate in Hz")
    channels = study.channels or {}
    if isinstance(study, _Gear):
        known = [*SIDES, *STRUT_SENSORS]
        right = "[channels.sprung], [channels.unsprung], [channels.travel] or [channels.force]"
        further = [name for name in channels if name not in known]
        faults += [
            f"[channels] lacks {side!r}, give {CHANNEL}"
            + "".join(f" (did you mean {side!r} by {each!r}?)" for each in meant_by(side, further)[:1])
            for side in SIDES
            if study.channels is not None and side not in document["channels"]
        ]
    else:
        known = [*study.sensor_channels, *study.strut_channels]
        right = "[channels.NAME] of a sensor of an interface or of the body"
    tables = [("channels", channels, known), *(("runs.channels", run.channels, []) for run in study.runs or ())]
    faults += [
        f"{fact!r} stands in [{where}.{name}], give it in {right}"
        for where, entries, sensors in tables
        for name, entry in entries.items()
        if isinstance(entry, SensorTable) and name not in sensors
        for fact in FACTS
        if fact in entry.given
    ]
    return study, faults


# ---- tables -> study -------------------------------------------------------------------------------


@dataclass(frozen=True)
class LogReading:
    """How a study reads a log.

    Args:
        settings: of the log.
        channels: those taken from it, by the names that they will have; None for all, as the log calls them.
        runs: names of the runs that take channels from it; the first is the one that is described here.
    """

    settings: LogSettings
    channels: Mapping[str, ChannelSettings] | None = None
    runs: tuple[str, ...] = ()


def build_study(document: Document, source: Path, say: Say) -> Study:
    """Read the logs and loading tables that a study file of suspensions names, and return the study.

    Args:
        document: content of the study file.
        source: its path; logs are beside it.
        say: called with the name of each file as it is read.

    Raises:
        InputError: the study or a file that it names is at fault: all faults at once.
    """
    study = _read_body(document, source)
    with name_source(source):
        interfaces, further = _attach_facts(study)
        all_files = [_find_run_files(study, run, source.parent) for run in study.runs]
    runs: list[Run] = []
    faults: list[str] = []
    for each, files in zip(study.runs, all_files, strict=True):
        rows, loading = each.loading, tuple[PointMass, ...]()
        beside = [source]
        with collect_faults(faults, f"run {files.name!r}: "):
            if isinstance(rows, str):
                loading = read_loading(source.parent / rows)
                beside.append(source.parent / rows)
            else:
                loading = tuple(PointMass(*row) for row in rows)
        with collect_faults(faults, f"run {files.name!r}: "):
            run = read_run(files, fs_hz=study.fs_hz, progress=say)
            stated = {name: getattr(each, name) for name in FACTS_OF_RUN}
            runs.append(replace(run, loading=loading, recording=add_files(run.recording, *beside), **stated))
    refuse(faults, source)
    with name_source(source):
        levelled, mountings = level_runs(
            bring_to_one_rate(_warn_of_one_log(runs, all_files)),
            [files.sensors for files in all_files],
            level_pair=_find_level_pair(study, all_files),
        )
        interfaces, further = _attach_mountings(interfaces, further, mountings)
        tables = {
            channel: tabulate_channel(SensorTable, channel, study.channels.get(channel, channel))
            for channel in (*study.sensor_channels, *study.strut_channels)
        }
        levelled, interfaces = read_other_quantities(study.interfaces, tables, levelled, interfaces)
    return recast(
        Study,
        study,
        title=source.stem if study.title is None else study.title,
        interfaces=interfaces,
        runs=levelled,
        sensors=further,
        source=source,
    )


def read_loading(path: Path) -> tuple[PointMass, ...]:
    """Read a loading table: a CSV file with the columns mass_kg, x_m and y_m, in any order among others.

    Args:
        path: the file; its columns stand apart by commas, or by semicolons (numbers may then have decimal commas).

    Raises:
        InputError: no such file, a column that is missing, a cell that is no number: all at once.
    """
    try:
        table, delimiter = read_table(path)
    except OSError as error:
        raise FileError(f"cannot read the loading table {path}: {error.strerror}: check the name") from error
    except InputError as error:
        raise FileError(f"cannot read the loading table {path}: {error}") from error
    head, *rows = [row for row in table if any(row)] or [[]]
    faults = [f"lacks the column {name!r} ({nearest(name, head)})" for name in LOADING_COLUMNS if name not in head]
    loading = []
    for number, row in enumerate([] if faults else rows, start=2):
        cells = [row[head.index(name)] if head.index(name) < len(row) else "" for name in LOADING_COLUMNS]
        values = [_read_number(cell.replace(",", ".") if delimiter == ";" else cell) for cell in cells]
        faults += [
            f"has {cell!r} for {name} in row {number}, give a number"
            for name, cell, value in zip(LOADING_COLUMNS, cells, values, strict=True)
            if value is None
        ]
        loading.append(PointMass(*(math.nan if value is None else value for value in values)))
    if not faults and not rows:
        faults = ["has no row below its head, give one a mass (for the reference leave 'loading' out)"]
    if faults:
        raise FileError(f"the loading table {path} {'; it '.join(faults)}")
    return tuple(loading)


def _read_number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _read_body(document: Document, source: Path) -> _Body:
    study, faults = read_suspension_tables(document)
    refuse(faults, source)
    with name_source(source):
        return study.to_body() if isinstance(study, _Gear) else study


def _find_run_files(study: _Body, run: _BodyRun, directory: Path) -> RunFiles:
    named = [
        *study.sensor_channels,
        *study.strut_channels,
        *study.channels,
        *(leak.channel for leak in study.sensors.leak),
    ]
    channels = {name: tabulate_channel(SensorTable, name, study.channels.get(name, name)) for name in named}
    for name, own in run.channels.items():
        if isinstance(own, SensorTable) and name in channels:
            stated = {each: getattr(own, each) for each in own.given}
            channels[name] = replace(channels[name], **stated, given=channels[name].given | own.given)
        else:
            channels[name] = tabulate_channel(SensorTable, name, own)
    triaxial = {name: table for name, table in channels.items() if table.axes}
    sensors = {
        name: TriaxialSensor(name, bool(table.gyroscope), table.vertical, table.tilt_tolerance_deg)
        for name, table in triaxial.items()
    }
    for name, table in channels.items():
        alone = sorted({"gyroscope", "vertical", "tilt_tolerance_deg"} & select_stated(table).keys())
        if alone and not table.axes:
            raise InputError(f"[channels.{name}] has {alone[0]!r} and no axes: name its three axes, or leave it out")
    read = {
        name: each
        for own, table in channels.items()
        for name, each in (_find_axes(sensors[own], table, channels) if own in sensors else {own: table}).items()
    }
    used = {axis for table in triaxial.values() for axis in (*table.axes, *table.gyroscope)}
    # An entry that describes an axis is read as that axis.
    read = {name: table for name, table in read.items() if name not in used or name in study.sensor_channels}
    sources = find_sources(read, run=run.name, log=run.log, settings=study.log, directory=directory)
    return RunFiles(run.name, sources, 0.0, run.start_s, run.stop_s, sensors)


def _find_axes(
    sensor: TriaxialSensor, table: SensorTable, channels: Mapping[str, SensorTable]
) -> dict[str, SensorTable]:
    """Return the channels of a three-axis sensor: as their own entries say, or as that of the sensor says."""
    place: dict[str, Any] = {
        name: getattr(table, name) for name in ("file", "shift_s", "shift_tolerance_s", "drift_tolerance_ppm", "log")
    }
    shared = {"axes": place | {"unit": table.unit, "scale": table.scale}, "gyroscope": place}
    found = {}
    for kind, names in (("axes", sensor.axes), ("gyroscope", sensor.rates)):
        for name, channel in zip(names, getattr(table, kind), strict=False):
            own = channels.get(channel, SensorTable(channel=channel))
            others = {key: value for key, value in shared[kind].items() if key not in own.given}
            found[name] = replace(own, **others)
    return found


def _attach_facts(study: _Body) -> tuple[tuple[MeasuredInterface, ...], tuple[BodySensor, ...]]:
    """Return the interfaces and the further sensors on the body, with the facts that are known of each sensor."""
    for leak in study.sensors.leak:
        if leak.into not in study.sensor_channels:
            raise InputError(
                f"[[sensors.leak]] leaks into {leak.into!r}, which is no sensor of an interface or on the body: "
                f"{nearest(leak.into, study.sensor_channels)}"
            )

    def find_facts(channel: str) -> SensorFacts:
        return recast(SensorFacts, tabulate_channel(SensorTable, channel, study.channels.get(channel, channel)))

    def find_leaks(**channels: str) -> tuple[Leak, ...]:
        into = [(leak, side) for leak in study.sensors.leak for side in SIDES if channels.get(side) == leak.into]
        return tuple(recast(Leak, leak, into=side) for leak, side in into)

    interfaces = (
        (
            each,
            SensorPair(
                find_facts(each.unsprung),
                find_facts(each.sprung),
                find_leaks(unsprung=each.unsprung, sprung=each.sprung),
            ),
        )
        for each in study.interfaces
    )
    return tuple(
        recast(MeasuredInterface, each, facts=pair, travel=None, force=None) for each, pair in interfaces
    ), tuple(
        recast(BodySensor, each, facts=find_facts(each.channel), leaks=find_leaks(sprung=each.channel))
        for each in study.body_sensors
    )


def _find_level_pair(study: _Body, files: Sequence[RunFiles]) -> tuple[str, str] | None:
    """Return the channels below and above a suspension that moves horizontally, if one of them has three axes."""
    if len(study.interfaces) != 1 or study.interfaces[0].axis != "horizontal" or study.body_sensors:
        return None
    pair = study.interfaces[0].unsprung, study.interfaces[0].sprung
    return pair if any(name in each.sensors for each in files for name in pair) else None


def _attach_mountings(
    interfaces: Sequence[MeasuredInterface], further: Sequence[BodySensor], mountings: Mapping[str, Mounting]
) -> tuple[tuple[MeasuredInterface, ...], tuple[BodySensor, ...]]:
    """Return the sensors with what their mounting leaves unknown: leaks of the motion across, and their gain."""

    def change(facts: SensorFacts, channel: str) -> SensorFacts:
        tolerance = mountings[channel].gain_tolerance if channel in mountings else 0.0
        return facts if facts.gain_tolerance else replace(facts, gain_tolerance=tolerance)

    def find_leaks(side: Side, channel: str) -> Iterator[Leak]:
        for across, tolerance in mountings[channel].leaks if channel in mountings else ():
            yield Leak(across, side, tolerance)

    for each in interfaces:
        named = next((channel for channel in (each.sprung, each.unsprung) if channel in mountings), None)
        is_level = len(interfaces) == 1 and not further and each.axis == "horizontal"
        if named and each.axis != "up" and not is_level:
            raise InputError(
                f"the axis{f' of {each.name!r}' if len(interfaces) > 1 else ''} is {each.axis!r} and {named!r} has "
                "three axes, whose vertical motion counts up: give the axis 'up', or 'horizontal' for one suspension "
                "that moves horizontally"
            )
    changed = (
        (
            each,
            SensorPair(
                change(each.facts.unsprung, each.unsprung),
                change(each.facts.sprung, each.sprung),
                (
                    *each.facts.leaks,
                    *find_leaks("unsprung", each.unsprung),
                    *find_leaks("sprung", each.sprung),
                ),
            ),
        )
        for each in interfaces
    )
    return tuple(replace(each, facts=facts) for each, facts in changed), tuple(
        replace(each, facts=change(each.facts, each.channel), leaks=(*each.leaks, *find_leaks("sprung", each.channel)))
        for each in further
    )


def _warn_of_one_log(runs: Sequence[Run], files: Sequence[RunFiles]) -> list[Run]:
    """Warn of runs from one log: they do not show how much flights differ."""
    found: list[Run] = []
    for index, (run, own) in enumerate(zip(runs, files, strict=True)):
        logs = {each.file for each in own.sources.values()}
        alike = [
            other.name
            for other, theirs in zip(runs[:index], files, strict=False)
            if other.masses == run.masses and not logs.isdisjoint(each.file for each in theirs.sources.values())
        ]
        if alike:
            words = (
                f"it is from one log with run {' and '.join(map(repr, alike))} and counts as another flight, though it "
                "says nothing about how much flights differ: the intervals are too narrow; give one run for each flight"
            )
            run = replace(run, findings=(*run.findings, Finding("warning", "same_log", "", words)))
        found.append(run)
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
    transmissibility: TransmissibilitySettings = BY_METHOD,
    settings: LogSettings = AS_WRITTEN,
    progress: Say | None = None,
) -> Study:
    """Return the study of some logs of one gear; the first log is the reference.

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
        transmissibility: how the transmissibilities are estimated; the method chooses what is left out.
        settings: how the logs are to be read, like their units where they state none.
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
            raise FileError(f"a log is {path!r}: give the name of its file")
        if list(paths).count(path) > 1:
            raise FileError(f"the log {path} is given twice: each run has a log of its own")
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
            channel: Source(Path(path), ChannelSettings(channel), settings)
            for channel in dict.fromkeys((unsprung, sprung))
        }
        run = read_run(RunFiles(name, sources, float(change)), progress=progress)
        runs.append(replace(run, log=Path(path), log_settings=settings))
    return study_of_gear(
        title,
        sprung=sprung,
        unsprung=unsprung,
        runs=bring_to_one_rate(runs),
        axis=axis,
        piston_area_m2=piston_area_m2,
        repeatability=repeatability,
        transmissibility=transmissibility,
    )


def find_log_readings(path: str | os.PathLike[str], log: str | os.PathLike[str]) -> tuple[LogReading, ...]:
    """Return how a study reads one log: like the first run that takes channels from it.

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
        raise FileError(f"{source} is a study of {kind.subject}: give one of suspensions, or none")
    study = _read_body(document, source)
    with name_source(source):
        all_files = [_find_run_files(study, run, source.parent) for run in study.runs]
    users = [(files.name, taken) for files in all_files if (taken := _find_taken(files, _resolve_path(log)))]
    if not users:
        return (LogReading(study.log),)
    runs = tuple(name for name, _ in users)
    return tuple(LogReading(how, channels, runs) for how, channels in users[0][1].items())


def _find_taken(files: RunFiles, path: str) -> dict[LogSettings, dict[str, ChannelSettings]]:
    """Return the channels that a run takes from a file, grouped by the settings of the log."""
    taken: dict[LogSettings, dict[str, ChannelSettings]] = {}
    for name, source in files.sources.items():
        if _resolve_path(source.file) == path:
            taken.setdefault(source.settings, {})[name] = source.channel
    return taken


def _resolve_path(path: str | os.PathLike[str]) -> str:
    """Return the real path of a file, which need not exist."""
    try:
        return os.path.realpath(path)
    except ValueError:  # It holds a zero byte, which no name of a file does.
        return os.fspath(path)


def read_further_run(
    study: Study,
    log: str | os.PathLike[str],
    *,
    like: str | None = None,
    mass_change_kg: float | None = None,
    progress: Say | None = None,
) -> Run:
    """Read a further log of the sensors of a study, as the study file says.

    Args:
        study: a study that was read from a file.
        log: the log.
        like: name of the run whose loading the log has, and whose channels are read in the same way; the reference
            loading, and the channels of the first run, if left out.
        mass_change_kg: sprung mass of one gear less that of the reference, kg, in the place of the loading of a run.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a study without a file, an unknown run, channels from several files, sensors of three axes, a mass
            change of a body on several suspensions, or a log that lacks a channel or cannot be read.
    """
    if study.source is None:
        raise InputError("the study was not read from a file, so that nothing says how to read the log: give a Run")
    names = [run.name for run in study.runs]
    if any(run.highest_hz for run in study.runs) or study.strut_sensors:
        raise FileError(
            f"{study.source} has sensors of velocity, displacement, travel or force: add the log to it as a run, and "
            "name the run"
        )
    if like is not None and like not in names:
        raise FileError(f"{study.source} has no run {like!r}: {nearest(like, names)}")
    if mass_change_kg is not None and not study.is_one_gear:
        raise InputError("a mass change has a place on a body with several suspensions: name a run with that loading")
    index = 0 if like is None else names.index(like)
    path = Path(log)
    tables = _read_body(load(study.source), study.source)
    with name_source(study.source):
        files = _find_run_files(tables, replace(tables.runs[index], log=str(path.absolute())), study.source.parent)
    if any(source.channel.file is not None for source in files.sources.values()):
        raise FileError(
            f"{study.source} takes the channels of a run from several files: add the log to it as a run, and name the "
            "run"
        )
    if files.sensors:
        raise FileError(
            f"{study.source} has sensors of three axes, whose vertical is that of all its runs: add the log to it as a "
            "run, and name the run"
        )
    with name_source(path):
        run = read_run(replace(files, name=path.stem, start_s=None, stop_s=None), fs_hz=tables.fs_hz, progress=progress)
    loading: tuple[PointMass, ...] | float = () if like is None else study.runs[index].masses
    return replace(
        run,
        loading=loading if mass_change_kg is None else mass_change_kg,
        recording=add_files(run.recording, study.source),
        log=path,
    )


# ---- study -> tables -------------------------------------------------------------------------------


def write_files(study: Study, directory: Path) -> str:
    """Write the log of each run, and return the text of the study file."""
    for run in study.runs:
        require_plain("run", run.name)
    for run in study.runs:
        write_log(run.recording, directory / f"{run.name}.csv")
    return format_toml(_tabulate_gear(study) if _is_plain_gear(study) else _tabulate_body(study))


def _is_plain_gear(study: Study) -> bool:
    """Return whether a study file with [channels], which is that of one gear, can hold the whole study."""
    first = study.interfaces[0]
    plain = MeasuredInterface(
        "gear",
        first.sprung,
        first.unsprung,
        facts=first.facts,
        axis=first.axis,
        piston_area_m2=first.piston_area_m2,
        travel=first.travel,
        force=first.force,
    )
    return study.is_one_gear and first == plain and study.structure == StructureSettings()


def _tabulate_gear(study: Study) -> _Gear:
    gear = study.interfaces[0]
    channels: dict[str, str | int | SensorTable] = {"unsprung": gear.unsprung, "sprung": gear.sprung}
    facts, taken = gear.facts, [gear.unsprung, gear.sprung]
    for place, table in tabulate_struts(gear):
        channels[place] = table
        taken.append(str(table.channel))
    leaks = tuple(recast(_GearLeak, leak) for leak in facts.leaks)
    return recast(
        _Gear,
        study,
        axis=gear.axis,
        piston_area_m2=gear.piston_area_m2,
        channels=channels | _list_further_channels(study, taken),
        sensors=_GearSensors(unsprung=facts.unsprung, sprung=facts.sprung, leak=leaks),
        runs=tuple(_Run(**_tabulate_run(run), mass_change_kg=run.mass_change_kg) for run in study.runs),
    )


def _list_further_channels(study: Study, used: Collection[str]) -> dict[str, str]:
    """Return the other channels of the runs, each by its own name, so that they are read back."""
    return {name: name for run in study.runs for name in run.recording.names if name not in used}


def _tabulate_run(run: Run) -> dict[str, Any]:
    # With a start the whole log is read back; without one a stretch would be searched.
    stated = {name: getattr(run, name) for name in FACTS_OF_RUN}
    return {"name": run.name, "log": f"{run.name}.csv", "start_s": run.recording.start_s, **stated}


def _tabulate_body(study: Study) -> _Body:
    known = {interface.sprung: interface.facts.sprung for interface in study.interfaces}
    known |= {interface.unsprung: interface.facts.unsprung for interface in study.interfaces}
    known |= {sensor.channel: sensor.facts for sensor in study.sensors}
    struts = [dict(tabulate_struts(each)) for each in study.interfaces]
    taken = [*known, *(str(table.channel) for tables in struts for table in tables.values())]
    channels: dict[str, str | int | SensorTable] = {**_list_further_channels(study, taken)}
    channels |= {
        name: recast(SensorTable, facts, channel=name) for name, facts in known.items() if select_stated(facts)
    }
    for each, tables in zip(study.interfaces, struts, strict=True):
        channels |= {
            each.unsprung if place == "unsprung" else str(table.channel): table for place, table in tables.items()
        }
    leaks = tuple(
        _Leak(channel=channel, into=study.channels(side)[index], tolerance=tolerance)
        for channel, side, index, tolerance in study.leaks()
    )
    return recast(
        _Body,
        study,
        channels=channels,
        interfaces=tuple(
            recast(
                InterfaceTable,
                each,
                travel=str(tables["travel"].channel) if "travel" in tables else "",
                force=str(tables["force"].channel) if "force" in tables else "",
            )
            for each, tables in zip(study.interfaces, struts, strict=True)
        ),
        body_sensors=tuple(recast(_BodySensor, each) for each in study.sensors),
        sensors=_Sensors(leak=leaks),
        runs=tuple(_BodyRun(**_tabulate_run(run), loading=tuple(map(astuple, run.masses))) for run in study.runs),
    )
