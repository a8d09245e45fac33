"""From the files of a run to the `Run`: health, the stretch to identify from, one clock for all of its channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from opid.errors import InputError
from opid.identify.study import SAME_RATE, Run
from opid.signals.conversion import recording_of
from opid.signals.health import inspect
from opid.signals.health_result import Finding
from opid.signals.log_settings import AS_WRITTEN, ChannelSettings, LogSettings
from opid.signals.logs import open_log
from opid.signals.recording import Recording
from opid.signals.resampling import on_common_clock, resampled
from opid.signals.segments import taxi_segment

REDUCED_ABOVE_HZ, REDUCED_TO_HZ = 1100.0, 500.0
"""Runs sampled faster are reduced: the band that is compared ends at 40 Hz, and time is spent on every sample."""


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
    """What a run is made of.

    Args:
        name: of the run.
        sources: by the name that the channel will have.
        mass_change_kg: sprung mass less that of the reference, kg.
        start_s: first time, s; None to find the stretch (if `stop_s` is None, too).
        stop_s: end, s.
    """

    name: str
    sources: Mapping[str, Source]
    mass_change_kg: float
    start_s: float | None = None
    stop_s: float | None = None


def run_from_files(files: RunFiles, *, progress: Callable[[str], None] | None = None) -> Run:
    """Read a run: check its logs, find the sound stretch of sustained motion, and put its channels on one clock.

    Args:
        files: what it is made of.
        progress: called with the name of each log as it is read.

    Raises:
        InputError: a log or a channel is at fault, or nothing of it is sound.
    """
    if files.start_s is not None and files.stop_s is not None and files.start_s >= files.stop_s:
        raise InputError(f"start_s is {files.start_s:g} and stop_s {files.stop_s:g}: give a stop after the start")
    say = progress or (lambda step: None)
    groups: dict[tuple[Path, LogSettings, float], dict[str, ChannelSettings]] = {}
    for name, source in files.sources.items():
        key = (source.file, source.settings, source.channel.shift_s)
        groups.setdefault(key, {})[name] = source.channel
    found = files.start_s is None and files.stop_s is None
    logs = {}
    begin, end = files.start_s, files.stop_s
    findings: list[Finding] = []
    for (path, settings, shift_s), channels in groups.items():
        say(f"{path.name}")
        log = logs[path, settings, shift_s] = open_log(path, settings)
        health = inspect(log, settings, channels=channels, thorough=False)
        serious = [finding for finding in health.findings if finding.severity != "note"]
        if not found:
            # what is wrong with the channels in the stretch that the user chose is found with the recording
            findings += [finding for finding in serious if not finding.channel]
        else:
            segment = taxi_segment(health, tuple(channels))
            begin = _latest(begin, None if segment.start_s is None else segment.start_s + shift_s)
            end = _earliest(end, None if segment.stop_s is None else segment.stop_s + shift_s)
            faulty = any(left.why == "faulty" for left in segment.left_out)
            findings += [finding for finding in serious if faulty or not finding.channel]
            if segment.reason:
                findings.append(Finding("warning" if faulty else "note", "", f"{path.name}: {segment.reason}"))
    if begin is not None and end is not None and begin >= end:
        raise InputError(f"the sound stretches of its logs share no time (from {begin:g} s on, up to {end:g} s)")
    parts = []
    for (path, settings, shift_s), channels in groups.items():
        say(f"{path.name}")
        part = recording_of(
            logs[path, settings, shift_s],
            settings,
            channels=channels,
            start_s=None if begin is None else begin - shift_s,
            stop_s=None if end is None else end - shift_s,
        )
        parts.append(_shifted(part, shift_s))
    recording = parts[0] if len(parts) == 1 else on_common_clock(parts, order=tuple(files.sources))
    return Run(files.name, _reduced(recording), files.mass_change_kg, tuple(findings))


def at_one_rate(runs: Sequence[Run], fs_hz: float | None = None) -> tuple[Run, ...]:
    """Return the runs at one rate.

    Args:
        runs: of one study.
        fs_hz: the rate, Hz; the lowest of theirs where left out.
    """
    if not runs:
        return ()
    fs = fs_hz or min(run.recording.fs for run in runs)
    return tuple(
        run if abs(run.recording.fs / fs - 1) < SAME_RATE else replace(run, recording=resampled(run.recording, fs))
        for run in runs
    )


def _reduced(recording: Recording) -> Recording:
    if recording.fs <= REDUCED_ABOVE_HZ:
        return recording
    return resampled(recording, recording.fs / int(recording.fs // REDUCED_TO_HZ))


def _shifted(recording: Recording, shift_s: float) -> Recording:
    if not shift_s:
        return recording
    words = f"{', '.join(recording.names)}: times shifted by {shift_s:g} s"
    return replace(recording, start_s=recording.start_s + shift_s, history=(*recording.history, words))


def _latest(one: float | None, other: float | None) -> float | None:
    return one if other is None else other if one is None else max(one, other)


def _earliest(one: float | None, other: float | None) -> float | None:
    return one if other is None else other if one is None else min(one, other)
