"""What is wrong with a log and what to do about it, clock by clock and channel by channel, read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate, chain

import numpy as np

from opid.errors import InputError
from opid.signals.conversion import choose_channels
from opid.signals.health.across_channels import check_magnitudes, check_pair
from opid.signals.health.chunks import chunk_rows, make_chunks, regroup
from opid.signals.health.clock import USUAL_STAMPS, ClockCheck
from opid.signals.health.result import Finding, Health, Severity
from opid.signals.health.spikes import remove_spikes
from opid.signals.health.track import TrackCheck, TrackFigures
from opid.signals.log import AS_WRITTEN, Block, ChannelSettings, Log, LogSettings, Track, log_of_recording
from opid.signals.recording import FloatArray, Recording

__all__ = ["Finding", "check_channels", "findings_in_words", "inspect", "remove_spikes"]

_SEVERITIES: tuple[Severity, ...] = ("fault", "warning", "note")


def inspect(
    what: Log | Recording,
    settings: LogSettings = AS_WRITTEN,
    *,
    channels: Mapping[str, ChannelSettings] | Sequence[str] | None = None,
    thorough: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Health:
    """Return the health of a log or a recording: figures of every clock and channel, and findings with what to do.

    A log is read once, block by block; memory does not grow with its length.

    Args:
        what: a log as its file holds it, or a recording.
        settings: what the file does not say.
        channels: those wanted, by their names in the log, or {name in the recording: settings}; all where left out.
        thorough: whether channels are compared with each other, and what a picture shows is kept.
        progress: called with the fraction of the rows that has been read, where their number is known.

    Raises:
        InputError: a channel that is not there, neither a rate nor time stamps, or what reading the file raises.

    >>> rng = np.random.default_rng(0)
    >>> samples = np.clip(rng.standard_normal((2000, 1)).cumsum(axis=0), -20, 20)
    >>> from opid.signals.recording import Channel
    >>> health = inspect(Recording(samples, fs=100.0, channels=(Channel("upper_z", "m/s^2"),)))
    >>> health.findings[0].severity, health.findings[0].channel
    ('warning', 'upper_z')
    """
    log = log_of_recording(what) if isinstance(what, Recording) else what
    wanted = _choose(log, channels, settings)
    n_done, n_all = 0, sum(track.n_samples or 0 for track in log.tracks)
    results: list[TrackFigures] = []
    for track in log.tracks:
        own = {name: each for name, each in wanted.items() if each.track is track}
        if own:
            shown = None if progress is None or not track.n_samples else _fraction_of_all(progress, n_done, n_all)
            results.append(_inspect_track(log, track, own, settings, thorough, shown))
            n_done += track.n_samples or 0
    health = _merge(results, wanted)
    remarks = (Finding("note", "remark", "", each) for each in log.remarks)
    return replace(
        health,
        findings=(*health.findings, *remarks),
        files=what.files,
        log="" if isinstance(what, Recording) else str(log.path),
    )


@dataclass(frozen=True, eq=False)
class _Wanted:
    """A channel that is inspected."""

    track: Track
    column: int
    number: int  # in the log, as `Log.find` takes it
    convert: Callable[[FloatArray], FloatArray]  # what is written -> SI
    unit: str  # SI, "?" where none is known
    states_unit: bool
    no_unit: str  # why no unit is known, empty where one is


def _choose(
    log: Log, channels: Mapping[str, ChannelSettings] | Sequence[str] | None, settings: LogSettings
) -> dict[str, _Wanted]:
    before = accumulate((len(track.channels) for track in log.tracks), initial=1)
    first = {id(track): number for track, number in zip(log.tracks, before, strict=False)}
    wanted = {}
    for name, own in choose_channels(log, channels).items():
        track, column = log.find(own.channel)
        written: str | None = track.channels[column].unit or settings.unit
        states_unit, unit, no_unit = (own.unit or written) is not None, "?", ""
        try:
            unit = own.to_si(np.zeros(1), written)[1]
        except InputError as error:
            # scale, offset and sign hold in any unit
            own, written, no_unit = replace(own, unit="1"), None, str(error)
        convert = partial(_convert, own, written)
        wanted[name] = _Wanted(track, column, first[id(track)] + column, convert, unit, states_unit, no_unit)
    return wanted


def _convert(own: ChannelSettings, written: str | None, samples: FloatArray) -> FloatArray:
    return own.to_si(samples, written)[0]


def _fraction_of_all(progress: Callable[[float], None], n_done: int, n_all: int) -> Callable[[int], None]:
    return lambda rows: progress(min(1.0, (n_done + rows) / n_all))


def _inspect_track(
    log: Log,
    track: Track,
    wanted: Mapping[str, _Wanted],
    settings: LogSettings,
    thorough: bool,
    progress: Callable[[int], None] | None,
) -> TrackFigures:
    n = len(wanted)
    blocks = iter(track.blocks([each.column for each in wanted.values()]))
    fs = settings.fs_hz or track.fs
    first, usual = _read_first_stamps(blocks, stated=fs is not None)
    if not first:
        raise InputError(f"{log.path} holds no samples: export the log again")
    if fs is None and first[0].stamps is None:
        raise InputError(f"{log.path} states neither a rate nor time stamps: give fs_hz in [log]")
    start_s = 0.0 if settings.fs_hz and track.fs is None else track.start_s
    reconstruct = settings.clock == "reconstructed"
    clock = ClockCheck(fs=fs, start_s=start_s, reconstruct=reconstruct, usual=usual, n_channels=n)
    check = TrackCheck(track.name, tuple(wanted), [each.unit for each in wanted.values()], clock, thorough=thorough)
    rows = chunk_rows(clock.bin_rows, n)
    regrouped = regroup(chain(first, blocks), n, rows)
    pieces = ((samples, clock.add(stamps, samples.shape[1])) for samples, stamps in regrouped)
    for chunk in make_chunks(pieces, [each.convert for each in wanted.values()], clock.bin_rows, rows):
        check.add(chunk)
        if progress is not None:
            progress(clock.n)
    return check.finish()


def _read_first_stamps(blocks: Iterator[Block], *, stated: bool) -> tuple[list[Block], FloatArray]:
    """The first blocks, and as many of their stamps as show what is usual."""
    first: list[Block] = []
    n = 0
    for block in blocks:
        first.append(block)
        n += block.samples.shape[0]
        if stated or block.stamps is None or n >= USUAL_STAMPS:
            break
    stamps = [block.stamps for block in first if block.stamps is not None]
    return first, np.concatenate(stamps)[:USUAL_STAMPS] if stamps and not stated else np.empty(0)


def _merge(results: Sequence[TrackFigures], wanted: Mapping[str, _Wanted]) -> Health:
    found = {channel.name: channel for result in results for channel in result.channels}
    channels = tuple(replace(found[name], number=own.number) for name, own in wanted.items())
    findings = [*(finding for result in results for finding in result.findings), *_find_unit_faults(wanted)]
    index = {name: i for i, name in enumerate(("", *wanted))}
    findings.sort(key=lambda finding: (_SEVERITIES.index(finding.severity), index[finding.channel]))
    main = max((result.clock for result in results), key=lambda clock: clock.n_samples)
    accelerations = [channel for channel in channels if channel.unit == "m/s^2"]
    loudest = max(accelerations, key=lambda c: c.high_frequency_rms) if len(accelerations) > 1 else None
    return Health(
        fs=main.fs,
        duration_s=main.duration_s,
        n_samples=main.n_samples,
        channels=channels,
        looks_unsprung=loudest.name if loudest else None,
        findings=tuple(findings),
        clocks=tuple(result.clock for result in results),
        pairs=tuple(pair for result in results for pair in result.pairs),
        rms_history=tuple(result.rms_history for result in results),
    )


def _find_unit_faults(wanted: Mapping[str, _Wanted]) -> Iterator[Finding]:
    """What to do about channels without a unit, in one sentence where several state none."""
    without = {name: own for name, own in wanted.items() if own.no_unit}
    silent = [name for name, own in without.items() if not own.states_unit]
    if len(silent) > 1:
        names = ", ".join(map(repr, silent[:4])) + (f" and {len(silent) - 4} more" if len(silent) > 4 else "")
        yield Finding(
            "warning",
            "no_unit",
            "",
            f"{len(silent)} channels state no unit ({names}), they are inspected as written: give `unit` in their "
            "tables of [channels] of a study, or in [log] for all (--unit without a study)",
        )
    for name, own in without.items():
        if len(silent) < 2 or own.states_unit:
            yield Finding("warning", "no_unit", name, f"{own.no_unit}; it is inspected as written")


def check_channels(
    recording: Recording, pairs: Sequence[tuple[str, str]], used: Sequence[str], *, run: str
) -> list[Finding]:
    """Return what is wrong with the channels of a run; notes are left out.

    Two channels that look exchanged are only a warning: a lightly damped frame may look so, and if they are exchanged,
    no model will follow them.

    Args:
        recording: of the run.
        pairs: channels below and above each suspension.
        used: all channels that count.
        run: name of the run.

    Raises:
        InputError: two channels that are no pair: one is mute or in another unit, or both are the same signal.
    """
    found: list[Finding] = []
    for below, above in pairs:
        try:
            samples = recording.channel(below), recording.channel(above)
            found += check_pair(*samples, fs=recording.fs, names=(below, above))
        except InputError as error:
            raise InputError(f"run {run!r}: {error}") from None
    found += check_magnitudes(recording, sorted(used))
    health = inspect(recording, thorough=False)
    # notes are left out: gravity on a channel, say, is taken off with the mean anyway
    return [*found, *(each for each in health.findings if each.severity != "note" and each.channel in used)]


def findings_in_words(run: str, findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the findings of the channels of a run, one sentence each; notes are left out."""
    for finding in findings:
        if finding.severity != "note":
            channel = f", {finding.channel!r}" if finding.channel else ""
            yield f"run {run!r}{channel}: {finding.message}"
