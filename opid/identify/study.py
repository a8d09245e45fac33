"""A study: runs of one structure at known mass changes, and which channels are its two sides."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from opid.errors import InputError, nearest
from opid.identify.sensor_facts import IDEAL_PAIR, SIDES, Leak, SensorFacts, SensorPair
from opid.signals.files import written_whole
from opid.signals.logs import read_log, write_log
from opid.signals.recording import FloatArray, Recording

MINIMUM_SAMPLES = 256
"""The shortest run taken: a spectrum of fewer samples does not separate a peak from its neighbours."""

LARGEST_CHANGE_KG = 1e5
"""No single gear carries more: the heaviest aircraft puts 50 t on one."""

SAME_RATE = 1e-5
"""Relative difference up to which two rates are one: clocks of crystals agree to some parts in a million."""


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded run at a known mass change.

    Args:
        name: of the run.
        recording: what was measured.
        mass_change_kg: sprung mass of this run less that of the reference, kg; negative if mass was removed.
    """

    name: str
    recording: Recording
    mass_change_kg: float


@dataclass(frozen=True, eq=False)
class Study:
    """Runs of one structure, checked against each other when the study is made.

    The mass that is identified is the one at a mass change of 0, whether or not a run was made there.

    Args:
        title: of the study.
        sprung: name of the channel on the airframe, an acceleration.
        unsprung: name of the channel on the spindle, an acceleration.
        runs: one or more.
        source: the study file, None if the study was made otherwise.
        sensors: what is known of the sensors beforehand.

    Raises:
        InputError: everything that is wrong at once: a missing channel, another unit than m/s^2, different
            rates, a run too short, one name twice.

    >>> from opid.signals.recording import recording_from_arrays
    >>> samples, names = np.random.default_rng(0).standard_normal((2, 2, 512)), ["lower_z", "upper_z"]
    >>> heavy, light = (recording_from_arrays(each, names, fs=512.0) for each in samples)
    >>> runs = (Run("heavy", heavy, 0.0), Run("light", light, -220.0))
    >>> Study("taxi", sprung="upper_z", unsprung="lower_z", runs=runs).fs
    512.0
    """

    title: str
    sprung: str
    unsprung: str
    runs: tuple[Run, ...]
    source: Path | None = None
    sensors: SensorPair = IDEAL_PAIR

    def __post_init__(self) -> None:
        object.__setattr__(self, "runs", tuple(self.runs))
        _refuse(list(_study_faults(self)), self.source)

    @property
    def fs(self) -> float:
        """Sampling rate of all runs, Hz."""
        return self.runs[0].recording.fs

    def accelerations(self, run: Run) -> tuple[FloatArray, FloatArray]:
        """Unsprung and sprung acceleration of a `run` of this study, each (n_samples,) m/s^2."""
        return run.recording.channel(self.unsprung), run.recording.channel(self.sprung)


def read_study(path: str | os.PathLike[str]) -> Study:
    """Read a study file and the logs that it names.

    Args:
        path: a TOML file with `title`, a table `[channels]` (`sprung`, `unsprung`) and one table `[[runs]]`
            for each log: `name`, `log` (path beside the study file), `mass_change_kg`, and optionally
            `start_s` and `stop_s` on the time axis of the log. What is known of the sensors goes into
            `[sensors.sprung]` and `[sensors.unsprung]` (the fields of `SensorFacts`), a further recorded axis
            that leaks in into `[[sensors.leak]]` (`channel`, `into`, `tolerance`; without `into`, both sides).

    Raises:
        InputError: the file is missing or no TOML, an unknown, missing or mistyped key, or a log is at fault.
    """
    source = Path(path)
    document = _load(source)
    _refuse(list(_document_faults(document)), source)
    runs, faults = [], []
    for entry in document["runs"]:
        try:
            recording = read_log(source.parent / entry["log"])
            if "start_s" in entry or "stop_s" in entry:
                recording = recording.section(entry.get("start_s"), entry.get("stop_s"))
            runs.append(Run(entry["name"], recording, float(entry["mass_change_kg"])))
        except InputError as error:
            faults.append(f"run {entry['name']!r}: {error}")
    _refuse(faults, source)
    channels = document["channels"]
    title = document.get("title", source.stem)
    try:
        sensors = _sensors(document.get("sensors", {}))
    except InputError as error:
        raise InputError(f"{source}: [sensors] {error}") from None
    return Study(title, channels["sprung"], channels["unsprung"], tuple(runs), source, sensors)


def study_from_logs(
    paths: Sequence[str | os.PathLike[str]],
    *,
    sprung: str,
    unsprung: str,
    mass_changes_kg: Sequence[float],
    title: str = "",
) -> Study:
    """Return the study of some logs, the first of which is the reference.

    Args:
        paths: the logs.
        sprung: name of the channel on the airframe.
        unsprung: name of the channel on the spindle.
        mass_changes_kg: sprung mass of each further log less that of the first, kg.
        title: of the study.

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
    runs = zip(names, map(read_log, paths), (0.0, *mass_changes_kg), strict=True)
    return Study(title, sprung, unsprung, tuple(Run(*run) for run in runs))


def write_study(study: Study, path: str | os.PathLike[str]) -> None:
    """Write a study so that `read_study` gives it back: the study file, and `NAME.csv` beside it for a run.

    Args:
        study: what to write.
        path: the study file; its directory must exist.

    Raises:
        InputError: a place that cannot be written to, or a run whose name is no file name.
    """
    target = Path(path)
    for run in study.runs:
        if run.name in ("", ".", "..") or Path(run.name).name != run.name:
            raise InputError(f"the run {run.name!r} cannot name its log: call it by one plain word")
    for run in study.runs:
        write_log(run.recording, target.parent / f"{run.name}.csv")
    channels = {"sprung": study.sprung, "unsprung": study.unsprung}
    sensors = _sensor_tables(study.sensors)
    known = {"sensors": sensors} if sensors else {}
    text = tomli_w.dumps({"title": study.title, "channels": channels, **known})
    for run in study.runs:
        entry = {"name": run.name, "log": f"{run.name}.csv", "mass_change_kg": run.mass_change_kg}
        text += "\n[[runs]]\n" + tomli_w.dumps(entry)
    with written_whole(target) as file:
        file.write(text)


# ---- the study file ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Key:
    kind: type | tuple[type, ...]
    what: str
    required: bool = True


_TEXT = _Key(str, "text in quotes")
_NUMBER = _Key((int, float), "a number")
_TIME = _Key((int, float), "a number", required=False)

# Every key of a study file. A further table is one more row here and one more line in `_document_faults`.
_STUDY = {
    "title": _Key(str, "text in quotes", required=False),
    "channels": _Key(dict, "a table [channels]"),
    "runs": _Key(list, "one table [[runs]] for each log"),
    "sensors": _Key(dict, "tables [sensors.sprung], [sensors.unsprung], [[sensors.leak]]", required=False),
}
_CHANNELS = {"sprung": _TEXT, "unsprung": _TEXT}
_SENSOR = {field.name: _Key((int, float), "a number", required=False) for field in fields(SensorFacts)}
_SENSORS = {
    "sprung": _Key(dict, "a table [sensors.sprung]", required=False),
    "unsprung": _Key(dict, "a table [sensors.unsprung]", required=False),
    "leak": _Key(list, "one table [[sensors.leak]] for each recorded axis that leaks in", required=False),
}
_LEAK = {
    "channel": _TEXT,
    "into": _Key(str, "'sprung' or 'unsprung'", required=False),
    "tolerance": _Key((int, float), "a number", required=False),
}
_RUN = {"name": _TEXT, "log": _TEXT, "mass_change_kg": _NUMBER, "start_s": _TIME, "stop_s": _TIME}


def _load(source: Path) -> dict[str, Any]:
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


def _document_faults(document: dict[str, Any]) -> Iterator[str]:
    yield from _table_faults("the study", document, _STUDY)
    if isinstance(document.get("channels"), dict):
        yield from _table_faults("[channels]", document["channels"], _CHANNELS)
    if isinstance(document.get("runs"), list):
        for number, entry in enumerate(document["runs"], start=1):
            yield from _table_faults(f"[[runs]] number {number}", entry, _RUN)
    if isinstance(document.get("sensors"), dict):
        sensors = document["sensors"]
        yield from _table_faults("[sensors]", sensors, _SENSORS)
        for side in SIDES:
            if isinstance(sensors.get(side), dict):
                yield from _table_faults(f"[sensors.{side}]", sensors[side], _SENSOR)
        for number, entry in enumerate(sensors.get("leak", []) if isinstance(sensors.get("leak"), list) else [], 1):
            yield from _table_faults(f"[[sensors.leak]] number {number}", entry, _LEAK)


def _sensors(tables: dict[str, Any]) -> SensorPair:
    facts = {side: SensorFacts(**tables.get(side, {})) for side in SIDES}
    leaks = [
        Leak(**{**entry, "into": into})
        for entry in tables.get("leak", [])
        for into in ([entry["into"]] if "into" in entry else ["unsprung", "sprung"])
    ]
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


def _table_faults(where: str, table: object, keys: dict[str, _Key]) -> Iterator[str]:
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


# ---- the runs among each other -------------------------------------------------------------------


def _study_faults(study: Study) -> Iterator[str]:
    leaks = [(leak.channel, leak.into) for leak in study.sensors.leaks]
    for channel, into in sorted({leak for leak in leaks if leaks.count(leak) > 1}):
        yield f"the leak of {channel!r} into the {into} sensor stands twice, give it once"
    for leak in study.sensors.leaks:
        if leak.channel == (study.sprung if leak.into == "sprung" else study.unsprung):
            yield f"the leak {leak.channel!r} is the {leak.into} channel itself, name another axis"
    if study.sprung == study.unsprung:
        yield f"sprung and unsprung are both {study.sprung!r}, name the channels of two sensors"
    if not study.runs:
        yield "there are no runs, give at least one"
    names = [run.name for run in study.runs]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"{names.count(name)} runs are called {name!r}, rename all but one"
    for run in study.runs:
        yield from (f"run {run.name!r}: {fault}" for fault in _run_faults(study, run))
    for first, second in combinations(study.runs, 2):
        one, other = first.recording, second.recording
        if first.mass_change_kg != second.mass_change_kg and np.array_equal(one.samples, other.samples):
            yield f"runs {first.name!r} and {second.name!r} hold the same samples, name two logs"
        if first is study.runs[0] and abs(other.fs / one.fs - 1) > SAME_RATE:
            yield (
                f"run {first.name!r} has {one.fs:.9g} Hz and run {second.name!r} has {other.fs:.9g} Hz, "
                "resample one to the rate of the other"
            )


def _run_faults(study: Study, run: Run) -> Iterator[str]:
    if not math.isfinite(run.mass_change_kg):
        yield f"the mass change is {run.mass_change_kg} kg, give a number"
    elif abs(run.mass_change_kg) > LARGEST_CHANGE_KG:
        yield (
            f"the mass change is {run.mass_change_kg:g} kg, more than any gear carries "
            f"({LARGEST_CHANGE_KG:g} kg): give it in kg, for this gear alone"
        )
    if run.recording.n_samples < MINIMUM_SAMPLES:
        yield (
            f"it has {run.recording.n_samples} samples ({run.recording.duration_s:.3g} s) and at least "
            f"{MINIMUM_SAMPLES} are needed, give some tens of seconds"
        )
    for name in dict.fromkeys((study.sprung, study.unsprung, *(leak.channel for leak in study.sensors.leaks))):
        if name not in run.recording.names:
            yield f"there is no channel {name!r} in its log ({nearest(name, run.recording.names)})"
        elif run.recording.unit(name) != "m/s^2":
            yield f"channel {name!r} is in {run.recording.unit(name)} where an acceleration is needed"


def _refuse(faults: list[str], source: Path | None) -> None:
    if not faults:
        return
    place = f"{source}: " if source else ""
    if len(faults) == 1:
        raise InputError(place + faults[0])
    listed = "; ".join(f"({number}) {fault}" for number, fault in enumerate(faults, start=1))
    raise InputError(f"{place}{len(faults)} faults: {listed}")
