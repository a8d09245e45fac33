"""The files of a run -> `Run`: its channels and their tables, the stretch to identify from, one clock."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar, TypeVar

import numpy as np

from opid.errors import InputError
from opid.progress import Say, Step
from opid.provenance import read_file
from opid.signals.clock_matching import ClockMatch, match_clocks
from opid.signals.conversion import read_with_stamps, require_distinct
from opid.signals.health.inspection import inspect, remove_spikes
from opid.signals.health.result import Finding, Health
from opid.signals.log import AS_WRITTEN, LARGEST_DRIFT_PPM, ChannelSettings, Log, LogSettings
from opid.signals.logs import open_log
from opid.signals.orientation import Axes
from opid.signals.recording import Recording
from opid.signals.resampling import on_common_clock, resampled
from opid.signals.segments import sound_segments, taxi_segment
from opid.signals.stamps import StampEvidence
from opid.studies.schema import NO_KEY, prefix_errors, recast
from opid.studies.triaxial import TriaxialSensor, describe_mounting
from opid.suspensions.settings import RunSettings
from opid.suspensions.study import SAME_RATE, Run

DEFAULTS = RunSettings()

UNKNOWN_SHIFT_S = 60.0
"""Standard deviation of the shift between two files where the user states nothing: recorders are started by hand."""


@dataclass(frozen=True)
class Source:
    """Where a channel is found.

    Args:
        file: the log.
        channel: which one, and what its values mean.
        settings: how the log is to be read.
    """

    file: Path
    channel: ChannelSettings
    settings: LogSettings = AS_WRITTEN


@dataclass(frozen=True)
class RunFiles:
    """The files of a run.

    Args:
        name: of the run.
        sources: by the name that the channel will have.
        mass_change_kg: sprung mass less that of the reference, kg.
        start_s: first time, s; None to find the stretch (if `stop_s` is None, too).
        stop_s: end, s.
        sensors: three-axis sensors, by the name that the channel of their vertical motion will have.
    """

    name: str
    sources: Mapping[str, Source]
    mass_change_kg: float
    start_s: float | None = None
    stop_s: float | None = None
    sensors: Mapping[str, TriaxialSensor] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Recorder:
    """One file of a run, with the channels that are taken from it; the run's clock is that of its first recorder."""

    log: Log
    settings: LogSettings
    channels: dict[str, ChannelSettings]
    health: Health
    shift_s: float
    match: ClockMatch | None = None

    @property
    def channel(self) -> ChannelSettings:
        """Settings of its first channel: all its channels have the same shift."""
        return next(iter(self.channels.values()))

    def to_run(self, stamp_s: float) -> float:
        """Return the time on the run's clock, s."""
        shifted_s = stamp_s + self.shift_s
        return self.match.to_reference(shifted_s) if self.match else shifted_s

    def from_run(self, time_s: float) -> float:
        """Return the time on the file's own clock, s."""
        return (self.match.from_reference(time_s) if self.match else time_s) - self.shift_s


def read_run(
    files: RunFiles,
    *,
    fs_hz: float | None = None,
    is_bench: bool = False,
    settings: RunSettings = DEFAULTS,
    progress: Say | None = None,
) -> Run:
    """Read a run: check its logs, find the sound stretch of sustained motion, and put its channels on one clock.

    Without a given rate the lowest of the channels' rates is taken, reduced if it is above
    `settings.reduced_above_hz`. The record of a test bench is taken whole and at its own rate, and its channels are
    not judged singly: a force and a travel are not judged like accelerations.

    Raises:
        InputError: a log or a channel is at fault, or nothing of it is sound.
    """
    for word, value in (("start_s", files.start_s), ("stop_s", files.stop_s)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"{word} is {value}: give a time in s, or leave it out")
    if files.start_s is not None and files.stop_s is not None and files.start_s >= files.stop_s:
        raise InputError(f"start_s is {files.start_s:g} and stop_s {files.stop_s:g}: give a stop after the start")
    recorders, findings = _open_recorders(files, progress or (lambda step: None))
    recorders, more = _match_recorders(recorders, files, is_bench=is_bench)
    findings += more
    if is_bench or files.start_s is not None or files.stop_s is not None:
        # The channels are judged later, in the stretch that the user chose.
        begin, end, reasons = files.start_s, files.stop_s, ""
        findings += [each for recorder in recorders for each in _find_serious(recorder) if not each.channel]
    else:
        begin, end, reasons, more = _find_stretch(recorders, [*files.sensors.values()])
        findings += more
    parts = []
    for recorder in recorders:
        part, judged = _read_part(recorder, begin, end, reasons)
        part, blank = _cut_blank_ends(part, [*files.sensors.values()])
        parts.append(part)
        findings += blank
        findings += [
            Finding(
                "note" if each.is_sure else "warning", "judged_stamps", "", f"{recorder.log.path.name}: {each.sentence}"
            )
            for each in judged
        ]
    fs = fs_hz or _find_lowest_rate(parts, recorders)
    fs = fs if fs_hz or is_bench else _reduce_rate(fs, settings)
    recording, more = _put_on_one_clock(parts, tuple(files.sources), fs)
    matches = tuple(recorder.match for recorder in recorders if recorder.match)
    more += [Finding("note", "matched_clocks", "", match.sentence) for match in matches]
    if matches:
        findings = [finding for finding in findings if finding.code != "unknown_start"]
    is_warned = any(finding.code == "several_recorders" for finding in findings)
    if len({recorder.log.path for recorder in recorders}) > 1 + len(matches) and not is_warned:
        words = (
            f"its channels come from {len(parts)} recorders: a wrong shift_s, or clocks that drift apart (20 ppm are "
            "0.8 ms in 40 s), passes for damping and friction"
        )
        words += "; shift_tolerance_s in [channels.sprung] lets offset and drift be fitted" * (not is_bench)
        more.append(Finding("warning", "several_recorders", "", words))
    if len(parts) > 1 and not is_bench:
        alone = inspect(recording, thorough=False).findings
        more += [found for found in inspect(recording).findings if found.severity != "note" and found not in alone]
    orientations = {}
    for name, sensor in files.sensors.items():
        health = next((each.health for each in recorders if set(sensor.axes) <= set(each.channels)), None)
        if health is None:
            raise InputError(f"the axes of {name!r} are in several files: give three channels of one recorder")
        with prefix_errors(f"{name!r}: "):
            orientations[name] = sensor.find(health)
        more += describe_mounting(name, sensor, orientations[name], health)
    every = tuple(dict.fromkeys([*findings, *more]))
    return Run(files.name, recording, files.mass_change_kg, every, orientations, clocks=matches)


def _find_serious(recorder: _Recorder) -> list[Finding]:
    return [finding for finding in recorder.health.findings if finding.severity != "note"]


def _find_stretch(
    recorders: Sequence[_Recorder], sensors: Sequence[TriaxialSensor]
) -> tuple[float | None, float | None, str, list[Finding]]:
    """Return begin and end of the stretch that is sound in all files, why parts are left out, and the findings.

    The axes of a sensor show together whether the vehicle moves. The rates of its gyroscope do not: on a wheel they
    hold noise alone.
    """
    begins: list[float] = []
    ends: list[float] = []
    reasons, findings = "", list[Finding]()
    for recorder in recorders:
        segment = taxi_segment(recorder.health, _name_movers(recorder, sensors))
        begins += [] if segment.start_s is None else [recorder.to_run(segment.start_s)]
        ends += [] if segment.stop_s is None else [recorder.to_run(segment.stop_s)]
        is_faulty = any(left.why == "faulty" for left in segment.left_out)
        findings += [finding for finding in _find_serious(recorder) if is_faulty or not finding.channel]
        if segment.reason:
            words = f"{recorder.log.path.name}: {segment.reason}"
            reasons += f" ({words})"
            findings.append(Finding("warning" if is_faulty else "note", "left_out", "", words))
    begin, end = max(begins, default=None), min(ends, default=None)
    if begin is not None and end is not None and begin >= end:
        raise InputError(
            f"its logs have no sound stretch in common: one is sound only from {begin:g} s on, another only up to "
            f"{end:g} s{reasons}; check shift_s, or give start_s and stop_s"
        )
    return begin, end, reasons, findings


def _name_movers(recorder: _Recorder, sensors: Sequence[TriaxialSensor]) -> list[str | Axes]:
    """Return the channels of a recorder that show whether the vehicle moves; the axes of one sensor are a tuple."""
    own = [sensor for sensor in sensors if {*sensor.axes} <= {*recorder.channels}]
    within = {name for sensor in own for name in (*sensor.axes, *sensor.rates)}
    return [*(name for name in recorder.channels if name not in within), *(sensor.axes for sensor in own)]


def add_files(recording: Recording, *files: Path) -> Recording:
    """Return a recording that also names other files that it depends on: the study, loading tables, modes."""
    return replace(recording, files=(*map(read_file, files), *recording.files))


def bring_to_one_rate(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Return the runs at the lowest of their rates."""
    fs = min((run.recording.fs for run in runs), default=0.0)
    changed = []
    for run in runs:
        recording, findings = _put_on_one_clock([run.recording], run.recording.names, fs)
        changed.append(replace(run, recording=recording, findings=(*run.findings, *findings)))
    return tuple(changed)


def _open_recorders(files: RunFiles, say: Say) -> tuple[list[_Recorder], list[Finding]]:
    """Open and inspect each file once, and put the times of all on one axis."""
    groups: dict[tuple[Path, LogSettings, float, float | None, float], dict[str, ChannelSettings]] = {}
    for name, source in files.sources.items():
        own = source.channel
        key = (source.file, source.settings, own.shift_s, own.shift_tolerance_s, own.drift_tolerance_ppm)
        groups.setdefault(key, {})[name] = own
    logs = {path: open_log(path, settings) for path, settings, *_ in groups}
    zero, findings = _find_zeros(logs, [shift_s for _, _, shift_s, *_ in groups])
    recorders = []
    for (path, settings, shift_s, *_), channels in groups.items():
        log = logs[path] if len(logs) == len(groups) else open_log(path, settings)
        require_distinct(log, channels)

        def say_part(fraction: float, name: str = path.name) -> None:
            say(Step(name, fraction))

        health = inspect(log, settings, channels=channels, progress=say_part)
        recorders.append(_Recorder(log, settings, channels, health, shift_s + zero[path]))
    return recorders, findings


def _find_zeros(logs: Mapping[Path, Log], shifts_s: Sequence[float]) -> tuple[dict[Path, float], list[Finding]]:
    """Return the time zero of each file, s after that of the first; 0 for all if not all files state it."""
    if len(logs) == 1:
        return dict.fromkeys(logs, 0.0), []
    zeros = [log.zero for log in logs.values()]
    first = zeros[0]
    alike = first is not None and all(
        each is not None and (each.tzinfo is None) == (first.tzinfo is None) for each in zeros
    )
    if alike and first is not None:
        return {path: (each - first).total_seconds() for path, each in zip(logs, zeros, strict=True) if each}, []
    if any(shifts_s):
        return dict.fromkeys(logs, 0.0), []
    names = " and ".join(path.name for path in logs)
    words = f"the times of {names} are taken to count from the same moment: if they do not, give shift_s in [channels]"
    return dict.fromkeys(logs, 0.0), [Finding("note", "unknown_start", "", words)]


def _match_recorders(
    recorders: Sequence[_Recorder], files: RunFiles, *, is_bench: bool
) -> tuple[list[_Recorder], list[Finding]]:
    """Return the recorders, with the clocks matched of those whose shift is not known, and the findings.

    A stated tolerance asks for a match. Several files without any shift or tolerance are matched, too, except those of
    a test bench; where that fails, their dates count if they state any.
    """
    if len({recorder.log.path for recorder in recorders}) > 1 and not is_bench:
        is_silent = not any(each.channel.shift_s or each.channel.shift_tolerance_s is not None for each in recorders)
    else:
        is_silent = False
    reference = next((each for each in recorders if not each.channel.shift_tolerance_s), recorders[0])
    found, findings = [], list[Finding]()
    for each in recorders:
        std_s = UNKNOWN_SHIFT_S if is_silent else each.channel.shift_tolerance_s or 0.0
        if each is reference or not std_s:
            found.append(each)
            continue
        try:
            found.append(replace(each, match=_match_to(reference, each, files, std_s)))
        except InputError as error:
            if not (is_silent and each.log.zero and reference.log.zero):
                raise
            found.append(each)
            words = f"the clocks of {reference.log.path.name} and {each.log.path.name} are taken to be right: {error}"
            findings.append(Finding("warning", "several_recorders", "", words))
    return found, findings


def _match_to(reference: _Recorder, recorder: _Recorder, files: RunFiles, std_s: float) -> ClockMatch:
    begin, end = _find_sound(reference, (files.start_s, files.stop_s))
    near = (None if begin is None else begin - 3 * std_s, None if end is None else end + 3 * std_s)
    return match_clocks(
        _read_part(reference, begin, end, "")[0],
        _read_part(recorder, *_find_sound(recorder, near), "")[0],
        offset_std_s=std_s,
        drift_std_ppm=recorder.channel.drift_tolerance_ppm,
    )


def _find_lowest_rate(parts: Sequence[Recording], recorders: Sequence[_Recorder]) -> float:
    """Return the lowest rate, Hz; rates that differ only by the drift of a clock count as that of the run's clock."""
    own = [part.fs for part, recorder in zip(parts, recorders, strict=True) if recorder.match is None]
    usual = min(own)
    return min([usual, *(part.fs for part in parts if part.fs < (1 - 3e-6 * LARGEST_DRIFT_PPM) * usual)])


def _find_sound(recorder: _Recorder, within: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    """Return begin and end, on the run's clock, of the longest sound stretch of a file in a part of it.

    None stands for the begin or end of the log, also in `within`; a whole log is cut to its steadiest five minutes.
    """
    channels = tuple(recorder.channels)
    segments = sound_segments(recorder.health, channels)
    if within == (None, None):
        segments = (taxi_segment(recorder.health, channels),)
    low, high = -math.inf if within[0] is None else within[0], math.inf if within[1] is None else within[1]
    begin, end = low, high
    longest_s = 0.0
    for each in segments:
        start_s = -math.inf if each.start_s is None else recorder.to_run(each.start_s)
        stop_s = math.inf if each.stop_s is None else recorder.to_run(each.stop_s)
        start_s, stop_s = max(low, start_s), min(high, stop_s)
        if stop_s - start_s > longest_s:
            begin, end, longest_s = start_s, stop_s, stop_s - start_s
    return (None if begin == -math.inf else begin), (None if end == math.inf else end)


def _read_part(
    recorder: _Recorder, begin: float | None, end: float | None, reasons: str
) -> tuple[Recording, tuple[StampEvidence, ...]]:
    """Return the stretch of one file with its times on the axis of the run, and how irregular stamps were judged."""
    try:
        part, judged = read_with_stamps(
            recorder.log,
            recorder.settings,
            channels=recorder.channels,
            start_s=None if begin is None else recorder.from_run(begin),
            stop_s=None if end is None else recorder.from_run(end),
        )
    except InputError as error:
        raise error.reword(f"{error}{reasons}") from None
    history, names, fs = list(part.history), ", ".join(part.names), part.fs
    if recorder.shift_s:
        history.append(f"{names}: times shifted by {recorder.shift_s:g} s")
    if recorder.match:
        fs /= 1 + 1e-6 * recorder.match.drift_ppm
        history.append(recorder.match.sentence)
    return replace(part, fs=fs, start_s=recorder.to_run(part.start_s), history=tuple(history)), judged


def _cut_blank_ends(part: Recording, sensors: Sequence[TriaxialSensor]) -> tuple[Recording, list[Finding]]:
    """Return a recording without the rows at its ends in which a three-axis sensor had not read anything yet.

    All three axes are exactly zero there, and an accelerometer reads that only in free fall.
    """
    blank = np.zeros(part.n_samples, dtype=bool)
    for sensor in sensors:
        if {*sensor.axes} <= {*part.names}:
            blank |= np.all([part.channel(axis) == 0.0 for axis in sensor.axes], axis=0)
    read = np.flatnonzero(~blank)
    if not read.size or read.size == part.n_samples:
        return part, []
    n_cut = part.n_samples - (int(read[-1]) - int(read[0]) + 1)
    if not n_cut:
        return part, []
    words = f"{n_cut} row(s) at its ends are left out, in which the three axes of a sensor read nothing but zeros"
    kept = part.section(part.time_s[read[0]], part.time_s[read[-1]] + 1 / part.fs)
    return replace(kept, history=(*kept.history, words)), [Finding("note", "left_out", "", words)]


def _put_on_one_clock(parts: Sequence[Recording], order: Sequence[str], fs: float) -> tuple[Recording, list[Finding]]:
    """Return the parts at one rate, and the findings that can no longer be seen once a part is resampled."""
    if len(parts) == 1 and abs(parts[0].fs / fs - 1) < SAME_RATE:
        return parts[0], []
    findings: list[Finding] = []
    for part in parts:
        findings += [f for f in inspect(part, thorough=False).findings if f.severity != "note" and f.channel]
    mended = [_mend_spikes(part) for part in parts]
    recording = resampled(mended[0], fs) if len(parts) == 1 else on_common_clock(mended, order=order, fs_hz=fs)
    return recording, findings


def _mend_spikes(recording: Recording) -> Recording:
    """Return the recording without single spikes, which the filter of the resampling would make longer."""
    columns, history = [], list(recording.history)
    for channel, samples in zip(recording.channels, recording.samples.T, strict=True):
        mended, spikes = remove_spikes(samples, fs=recording.fs)
        columns.append(mended)
        history += [f"{channel.name}: {spikes.size} spike(s) mended"] * (spikes.size > 0)
    return replace(recording, samples=np.stack(columns, axis=1), history=tuple(history))


def _reduce_rate(fs: float, settings: RunSettings) -> float:
    return fs if fs <= settings.reduced_above_hz else fs / int(fs // settings.reduced_to_hz)


# ---- the tables [channels.NAME] of a study file -----------------------------------------------------

CHANNEL = "the name of a channel, its number or a table"
"""What an entry of [channels] may be."""


@dataclass(frozen=True, kw_only=True)
class ChannelTable(ChannelSettings):
    """A table [channels.NAME].

    Args:
        channel: as in `ChannelSettings`; the name of the table where left out.
        log: how its file is to be read; as [log] says where left out.
        given: the keys that stand in it.
    """

    ELSEWHERE: ClassVar[dict[str, str]] = {"name": "write `channel` for the name of the channel in the log"}
    channel: str | int | None = None  # type: ignore[assignment]
    log: LogSettings | None = None
    given: Annotated[frozenset[str], NO_KEY] = frozenset()


C = TypeVar("C", bound=ChannelTable)


def tabulate_channel(kind: type[C], name: str, entry: str | int | C) -> C:
    """Return an entry of [channels] as a table; the entry may be a name, a number or a table without either."""
    if isinstance(entry, str | int):
        return kind(channel=entry, given=frozenset({"channel"}))
    return replace(entry, channel=name if entry.channel is None else entry.channel)


def find_sources(
    channels: Mapping[str, ChannelTable], *, run: str, log: str | None, settings: LogSettings, directory: Path
) -> dict[str, Source]:
    """Return where the channels of a run are found.

    Args:
        channels: by the names that they will have.
        run: its name, for which `{run}` stands in the name of a file.
        log: the file of channels that name none.
        settings: of logs whose channels give none.
        directory: of the study.

    Raises:
        InputError: a channel without a file in a run without a log.
    """
    sources = {}
    for name, table in channels.items():
        channel = recast(ChannelSettings, table)
        if channel.file is not None:
            channel = replace(channel, file=channel.file.replace("{run}", run))
        file = log if channel.file is None else channel.file
        if file is None:
            raise InputError(f"run {run!r} has no 'log', and [channels.{name}] no 'file': give one of them")
        sources[name] = Source(directory / file, channel, table.log or settings)
    return sources
