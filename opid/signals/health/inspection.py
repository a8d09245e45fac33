"""What is wrong with a log and what to do about it, clock by clock and channel by channel, read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, chain

import numpy as np

from opid.errors import InputError
from opid.signals.conversion import choose_channels
from opid.signals.health.across_channels import check_magnitudes, check_pair
from opid.signals.health.channel import MomentCheck, RunCheck
from opid.signals.health.chunks import Chunk, ChunkMaker, chunk_rows, regroup, rows_of_a_bin
from opid.signals.health.clock import USUAL_STAMPS, ClockCheck
from opid.signals.health.figures import Checks, TrackFigures, track_figures
from opid.signals.health.findings import NoUnit, channel_findings, unit_findings
from opid.signals.health.result import ChannelHealth, Finding, Health, Severity
from opid.signals.health.settings import HEALTH
from opid.signals.health.spectrum import LongBlocks, SpectrumCheck
from opid.signals.health.spikes import SpikeSearch, remove_spikes
from opid.signals.log import Block, Log, Track, log_of_recording
from opid.signals.log_settings import AS_WRITTEN, ChannelSettings, LogSettings
from opid.signals.recording import FloatArray, Recording

__all__ = [
    "ChannelHealth",
    "Finding",
    "Health",
    "Severity",
    "check_channels",
    "check_magnitudes",
    "check_pair",
    "findings_in_words",
    "inspect",
    "remove_spikes",
]

Converter = Callable[[FloatArray], FloatArray]

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
        thorough: whether channels are looked at beside each other, and what a picture shows is kept.
        progress: called with the fraction of the rows that is read, where their number is known.

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
    wanted = {name: (own, log.find(own.channel)) for name, own in choose_channels(log, channels).items()}
    done, every = 0, sum(track.n_samples or 0 for track in log.tracks)
    results: list[TrackFigures] = []
    for track in log.tracks:
        columns = {name: column for name, (_, (where, column)) in wanted.items() if where is track}
        if not columns:
            continue
        shown = None if progress is None or not track.n_samples else _part(progress, done, every)
        own = {name: wanted[name][0] for name in columns}
        results.append(_inspect_track(log, track, columns, own, settings, thorough, shown))
        done += track.n_samples or 0
    health = _merge(results, order=tuple(wanted), numbers=_numbers(log, wanted))
    remarks = (Finding("note", "", each) for each in log.remarks)
    health = replace(health, findings=(*health.findings, *remarks))
    return replace(health, files=what.files, log="" if isinstance(what, Recording) else str(log.path))


def _numbers(log: Log, wanted: Mapping[str, tuple[ChannelSettings, tuple[Track, int]]]) -> dict[str, int]:
    """Number of each channel in the log, as `Log.find` takes it."""
    before = accumulate((len(track.channels) for track in log.tracks), initial=1)
    first = {id(track): number for track, number in zip(log.tracks, before, strict=False)}
    return {name: first[id(track)] + column for name, (_, (track, column)) in wanted.items()}


def _part(progress: Callable[[float], None], done: int, every: int) -> Callable[[int], None]:
    return lambda rows: progress(min(1.0, (done + rows) / every))


def _inspect_track(
    log: Log,
    track: Track,
    columns: Mapping[str, int],
    wanted: Mapping[str, ChannelSettings],
    settings: LogSettings,
    thorough: bool,
    progress: Callable[[int], None] | None,
) -> TrackFigures:
    """Read the channels of one clock once."""
    blocks = iter(track.blocks(list(columns.values())))
    fs = settings.fs_hz or track.fs
    first, usual = _first_stamps(blocks, stated=fs is not None)
    if not first:
        raise InputError(f"{log.path} holds no samples: export the log again")
    if fs is None and first[0].stamps is None:
        raise InputError(f"{log.path} states neither a rate nor time stamps: give fs_hz in [log]")
    start_s = 0.0 if settings.fs_hz and track.fs is None else track.start_s
    clock = ClockCheck(fs=fs, start_s=start_s, reconstruct=settings.clock == "reconstructed", usual=usual)
    bin_rows = rows_of_a_bin(clock.fs, len(columns))
    clock.keep_every(bin_rows)
    checks, convert = _checks(track, columns, wanted, settings, clock, bin_rows, thorough)
    rows = chunk_rows(bin_rows, len(columns))
    maker = ChunkMaker(convert, bin_rows, rows)
    every: list[Callable[[Chunk], None]] = [checks.moments.add, checks.spectra.add, checks.long_blocks.add]
    every += [run.add for run in checks.runs] + [search.add for search in checks.spikes]
    for samples, stamps in regroup(chain(first, blocks), len(columns), rows):
        chunk = maker.chunk(samples, clock.add(stamps, samples.shape[1]))
        for add in every:
            add(chunk)
        if progress is not None:
            progress(clock.n)
    for run in checks.runs:
        run.finish()
    checks.spectra.finish()
    return track_figures(checks)


def _checks(
    track: Track,
    columns: Mapping[str, int],
    wanted: Mapping[str, ChannelSettings],
    settings: LogSettings,
    clock: ClockCheck,
    bin_rows: int,
    thorough: bool,
) -> tuple[Checks, list[Converter]]:
    """What looks at the rows of a track, and what makes its channels SI."""
    n = len(columns)
    convert, units, without = _conversions(track, columns, wanted, settings)
    flat_rows = int(np.ceil(HEALTH.flat_s * clock.fs - 1e-9)) + 1
    crossed = [i for i in range(n) if units[i] == "m/s^2"][: HEALTH.most_crossed] if thorough else []
    checks = Checks(
        track=track.name,
        names=tuple(columns),
        units=tuple(units),
        without_unit=tuple(without),
        bin_rows=bin_rows,
        clock=clock,
        moments=MomentCheck(n, envelope=thorough),
        runs=tuple(RunCheck(i, bin_rows=bin_rows, flat_rows=flat_rows) for i in range(n)),
        spikes=tuple(SpikeSearch(i, bin_rows) for i in range(n)),
        spectra=SpectrumCheck(n, bin_rows, crossed=crossed if len(crossed) > 1 else (), spectrogram=thorough),
        long_blocks=LongBlocks(n, bin_rows),
        thorough=thorough,
    )
    return checks, convert


def _first_stamps(blocks: Iterator[Block], *, stated: bool) -> tuple[list[Block], FloatArray]:
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


def _conversions(
    track: Track, columns: Mapping[str, int], wanted: Mapping[str, ChannelSettings], settings: LogSettings
) -> tuple[list[Converter], list[str], list[NoUnit | None]]:
    """For each channel: what makes it SI, its unit, and why none is known."""
    convert: list[Converter] = []
    units: list[str] = []
    without: list[NoUnit | None] = []
    for name, column in columns.items():
        own, written = wanted[name], track.channels[column].unit or settings.unit
        why = None
        try:
            unit = own.to_si(np.zeros(1), written)[1]
        except InputError as error:
            unit, why = "?", NoUnit((own.unit or written) is not None, str(error))
            # scale, offset and sign hold in any unit
            own, written = replace(own, unit="1"), None
        convert.append(_converter(own, written))
        units.append(unit)
        without.append(why)
    return convert, units, without


def _converter(own: ChannelSettings, written: str | None) -> Converter:
    return lambda samples: own.to_si(samples, written)[0]


def _merge(results: Sequence[TrackFigures], *, order: Sequence[str], numbers: Mapping[str, int]) -> Health:
    """The health of all clocks."""
    found = [channel for result in results for channel in result.channels]
    channels = {channel.name: replace(channel, number=numbers[channel.name]) for channel in found}
    findings = [finding for result in results for finding in result.findings]
    details = {name: own_details for result in results for name, own_details in result.details.items()}
    for name in order:
        findings += channel_findings(channels[name], details[name])
    findings += unit_findings({name: why for name in order if (why := details[name].without_unit) is not None})
    index = {name: i for i, name in enumerate(("", *order))}
    findings.sort(key=lambda finding: (_SEVERITIES.index(finding.severity), index.get(finding.channel, 0)))
    main = max((result.clock for result in results), key=lambda clock: clock.n_samples)
    accelerations = [channels[name] for name in order if channels[name].unit == "m/s^2"]
    loudest = max(accelerations, key=lambda c: c.high_frequency_rms) if len(accelerations) > 1 else None
    return Health(
        fs=main.fs,
        duration_s=main.duration_s,
        n_samples=main.n_samples,
        channels=tuple(channels[name] for name in order),
        looks_unsprung=loudest.name if loudest else None,
        findings=tuple(findings),
        clocks=tuple(result.clock for result in results),
        pairs=tuple(pair for result in results for pair in result.pairs),
        rms_history=tuple(result.rms_history for result in results),
    )


def check_channels(
    recording: Recording, pairs: Sequence[tuple[str, str]], used: Sequence[str], *, run: str
) -> list[Finding]:
    """Return what is to be said of the channels of a run.

    Two that look exchanged are a warning and no more: a lightly damped frame may look so, and if they are, no model
    will follow them.

    Args:
        recording: of the run.
        pairs: channels below and above each suspension.
        used: all channels that count.
        run: name of the run.

    Raises:
        InputError: two channels that make no pair: one is mute, in another unit, or the other one once more.
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
    """Yield the findings of the channels of a run, one sentence each, without mere notes."""
    for finding in findings:
        if finding.severity != "note":
            channel = f", {finding.channel!r}" if finding.channel else ""
            yield f"run {run!r}{channel}: {finding.message}"
