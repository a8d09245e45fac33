"""What is wrong with a log and what to do about it, clock by clock and channel by channel, read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate, chain, combinations

import numpy as np

from opid.errors import FileError, InputError, NotDeterminedError, list_names
from opid.signals.clock import ClockError
from opid.signals.conversion import choose_channels
from opid.signals.health.across_channels import check_magnitudes, check_pair, compare_pairs
from opid.signals.health.channel import Bins, MomentCheck, RunCheck, describe_channel
from opid.signals.health.chunks import Chunk, chunk_rows, make_chunks, regroup
from opid.signals.health.clock import MOST_SHOWN, USUAL_STAMPS, ClockCheck, describe_clock
from opid.signals.health.gravity import find_orientation, group_axes
from opid.signals.health.result import (
    ChannelHealth,
    ClockHealth,
    Finding,
    Health,
    Kind,
    Overview,
    PairHealth,
    RmsHistory,
    Severity,
    SpectralLine,
    Stretch,
)
from opid.signals.health.settings import HEALTH
from opid.signals.health.spectrum import LEAST_LONG_AVERAGES, LongBlocks, SpectrumCheck, floor_of, lines_of, rms_above
from opid.signals.health.spikes import SpikeSearch, remove_spikes
from opid.signals.log import AS_WRITTEN, Block, ChannelSettings, Log, LogSettings, Track, log_of_recording
from opid.signals.orientation import align_spectra, say_movement
from opid.signals.recording import FloatArray, Recording
from opid.signals.spectra import ComplexArray

__all__ = ["Finding", "check_channels", "clipped_fractions", "findings_in_words", "inspect", "remove_spikes"]

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
        settings: the user's settings for what the file does not state.
        channels: names of the inspected channels, or {name in the recording: settings}; by default all channels.
        thorough: whether channels are compared with each other, and the data of pictures are kept.
        progress: function that is called with the fraction of the rows that has been read, if their number is known.

    Raises:
        InputError: neither a log nor a recording, a channel that is not there, neither a rate nor time stamps, or an
            error of reading the file.

    >>> rng = np.random.default_rng(0)
    >>> samples = np.clip(rng.standard_normal((2000, 1)).cumsum(axis=0), -20, 20)
    >>> from opid.signals.recording import Channel
    >>> health = inspect(Recording(samples, fs=100.0, channels=(Channel("upper_z", "m/s^2"),)))
    >>> health.findings[0].severity, health.findings[0].channel
    ('warning', 'upper_z')
    """
    if not isinstance(what, Log | Recording):
        raise InputError(f"what is of type {type(what).__name__}: give a Log, as open_log makes one, or a Recording")
    log = log_of_recording(what) if isinstance(what, Recording) else what
    wanted = _choose(log, channels, settings)
    n_done, n_all = 0, sum(track.n_samples or 0 for track in log.tracks)
    results: list[_TrackFigures] = []
    for track in log.tracks:
        own = {name: each for name, each in wanted.items() if each.track is track}
        if own:
            shown = None if not track.n_samples else progress
            results.append(_inspect_track(log, track, own, settings, thorough, shown, n_done, n_all))
            n_done += track.n_samples or 0
    health = _merge(results, wanted)
    if thorough:
        health = _find_mountings(health, results)
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
    number: int  # its number in the log, as `Log.find` takes it
    to_si: Callable[[FloatArray], tuple[FloatArray, str]]  # what is written -> SI, and its unit
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
        number = first[id(track)] + column
        wanted[name] = _Wanted(
            track, column, number, partial(own.to_si, written_unit=written), unit, states_unit, no_unit
        )
    return wanted


def _inspect_track(
    log: Log,
    track: Track,
    wanted: Mapping[str, _Wanted],
    settings: LogSettings,
    thorough: bool,
    progress: Callable[[float], None] | None,
    n_before: int,
    n_all: int,
) -> _TrackFigures:
    n = len(wanted)
    blocks = iter(track.blocks([each.column for each in wanted.values()]))
    fs = settings.fs_hz or track.fs
    first, usual = _read_first_stamps(blocks, stated=fs is not None)
    if not first:
        raise FileError(f"{log.path} holds no samples: export the log again")
    if fs is None and first[0].stamps is None:
        raise FileError(f"{log.path} states neither a rate nor time stamps: give fs_hz in [log]")
    start_s = 0.0 if settings.fs_hz and track.fs is None else track.start_s
    try:
        clock = ClockCheck(fs=fs, start_s=start_s, setting=settings.clock, usual=usual, n_channels=n)
    except ClockError as error:
        raise FileError(f"{log.path}: {error}") from None
    check = _TrackCheck(track.name, tuple(wanted), [each.unit for each in wanted.values()], clock, thorough=thorough)
    rows = chunk_rows(clock.bin_rows, n)
    regrouped = regroup(chain(first, blocks), n, rows)
    pieces = ((samples, clock.add(stamps, samples.shape[1])) for samples, stamps in regrouped)
    for chunk in make_chunks(pieces, [each.to_si for each in wanted.values()], clock.bin_rows, rows):
        check.add(chunk)
        if progress is not None:
            progress(min(1.0, (n_before + clock.n) / n_all))
    return check.finish()


def _read_first_stamps(blocks: Iterator[Block], *, stated: bool) -> tuple[list[Block], FloatArray]:
    """Return the first blocks, and as many of their stamps as show what is usual."""
    first: list[Block] = []
    n = 0
    for block in blocks:
        first.append(block)
        n += block.samples.shape[0]
        if stated or block.stamps is None or n >= USUAL_STAMPS:
            break
    stamps = [block.stamps for block in first if block.stamps is not None]
    return first, np.concatenate(stamps)[:USUAL_STAMPS] if stamps and not stated else np.empty(0)


def _merge(results: Sequence[_TrackFigures], wanted: Mapping[str, _Wanted]) -> Health:
    found = {channel.name: channel for result in results for channel in result.channels}
    channels = tuple(replace(found[name], number=own.number) for name, own in wanted.items())
    findings = [*(finding for result in results for finding in result.findings), *_find_unit_faults(wanted)]
    index = {name: i for i, name in enumerate(("", *wanted))}
    findings.sort(key=lambda finding: (_SEVERITIES.index(finding.severity), index[finding.channel]))
    main = max((result.clock for result in results), key=lambda clock: clock.n_samples)
    pairs = tuple(pair for result in results for pair in result.pairs)
    return Health(
        fs=main.fs,
        duration_s=main.duration_s,
        n_samples=main.n_samples,
        channels=channels,
        looks_unsprung=_find_unsprung(channels, pairs),
        findings=tuple(findings),
        clocks=tuple(result.clock for result in results),
        pairs=pairs,
        rms_history=tuple(result.rms_history for result in results),
    )


def _find_mountings(health: Health, results: Sequence[_TrackFigures]) -> Health:
    """Return the health with how its three-axis accelerometers are mounted, and turned against each other."""
    groups = group_axes({channel.name: channel.unit for channel in health.channels if not channel.mute})
    orientations, findings = {}, []
    for name, axes in groups.items():
        try:
            orientations[name] = mounted = find_orientation(health, axes)
        except InputError as error:
            findings.append(Finding("note", "no_orientation", name, str(error)))
            continue
        if mounted.has_slipped:
            findings.append(Finding("warning", "sensor_moved", name, say_movement(mounted)))
    alignments = []
    for one, other in combinations(groups, 2):
        crossed = next((each.crossed for each in results if {*groups[one], *groups[other]} <= {*each.crossed[0]}), None)
        if crossed is None:
            continue
        names, frequency_hz, density, averages = crossed
        columns = [names.index(axis) for axis in (*groups[one], *groups[other])]
        upper = density[np.ix_(columns, columns)]
        # Only one triangle of the cross-spectra is kept, by the order of the channels.
        later = np.array(columns)[:, np.newaxis] > np.array(columns)
        whole = np.where(later[:, :, np.newaxis], upper.conj().transpose(1, 0, 2), upper).transpose(2, 0, 1)
        known = one in orientations and other in orientations
        verticals = (orientations[one].vertical, orientations[other].vertical) if known else None
        try:
            found = align_spectra(frequency_hz, whole, averages, verticals)
            alignments.append(replace(found, first=one, second=other))
        except NotDeterminedError as error:
            findings.append(Finding("note", "no_orientation", other, f"beside {one!r}: {error}"))
    every = sorted([*health.findings, *findings], key=lambda finding: _SEVERITIES.index(finding.severity))
    return replace(health, orientations=orientations, alignments=tuple(alignments), findings=tuple(every))


def _find_unsprung(channels: Sequence[ChannelHealth], pairs: Sequence[PairHealth]) -> str | None:
    """Return that one of two coherent accelerations that has more motion at high frequencies."""
    accelerations = [channel for channel in channels if channel.unit == "m/s^2"]
    names = {channel.name for channel in accelerations}
    is_coherent = any({pair.first, pair.second} == names and pair.coherent_band_hz for pair in pairs)
    return max(accelerations, key=lambda each: each.high_frequency_rms).name if is_coherent else None


def _find_unit_faults(wanted: Mapping[str, _Wanted]) -> Iterator[Finding]:
    without = {name: own for name, own in wanted.items() if own.no_unit}
    silent = [name for name, own in without.items() if not own.states_unit]
    if len(silent) > 1:
        names = list_names(map(repr, silent), 4)
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
        recording: recording of the run.
        pairs: names of the channels below and above each suspension.
        used: names of all channels that are used.
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
            raise error.reword(f"run {run!r}: {error}") from None
    found += check_magnitudes(recording, sorted(used))
    health = inspect(recording, thorough=False)
    # notes are left out: gravity on a channel, say, is taken off with the mean anyway
    return [*found, *(each for each in health.findings if each.severity != "note" and each.channel in used)]


def clipped_fractions(recording: Recording) -> dict[str, float]:
    """Return the channels that are clipped, and which fraction of the samples of each.

    Args:
        recording: a recording.
    """
    channels = inspect(recording, thorough=False).channels
    return {each.name: each.clipped_fraction for each in channels if each.clipped_fraction > 0}


def findings_in_words(run: str, findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the findings of the channels of a run, one sentence each; notes are left out."""
    for finding in findings:
        if finding.severity != "note":
            channel = f", {finding.channel!r}" if finding.channel else ""
            yield f"run {run!r}{channel}: {finding.message}"


# ---- the checks of one track -----------------------------------------------------------------------


_Crossed = tuple[tuple[str, ...], FloatArray, ComplexArray, float]
"""Names of channels, frequencies, Hz, densities (n, n, n_lines) of which one triangle is set, and averages."""


@dataclass(frozen=True, eq=False)
class _TrackFigures:
    clock: ClockHealth  # figures of its clock
    channels: tuple[ChannelHealth, ...]  # figures of each channel
    pairs: tuple[PairHealth, ...]  # figures of each two accelerations
    findings: tuple[Finding, ...]  # what is wrong with the clock, between channels and with each channel
    rms_history: RmsHistory  # how strong the motion is, second by second
    crossed: _Crossed  # cross-spectra of some accelerations


@dataclass(frozen=True, eq=False)
class _ChannelFigures:
    health: ChannelHealth
    findings: list[Finding]
    is_sound: np.ndarray  # (n_bins,)
    is_complete: np.ndarray  # (n_bins,)


class _TrackCheck:
    """The checks of the clock and of all channels of one track, as `inspect` asks for them."""

    def __init__(
        self, track: str, names: Sequence[str], units: Sequence[str], clock: ClockCheck, *, thorough: bool
    ) -> None:
        n, bin_rows = len(names), clock.bin_rows
        flat_rows = int(np.ceil(HEALTH.flat_s * clock.fs - 1e-9)) + 1
        accelerations = [i for i in range(n) if units[i] == "m/s^2"][: HEALTH.most_crossed]
        crossed = accelerations if thorough and len(accelerations) > 1 else ()
        self._track, self._names, self._units, self._thorough = track, tuple(names), tuple(units), thorough
        self._clock = clock
        self._moments = MomentCheck(n, envelope=thorough)
        self._runs = [RunCheck(i, bin_rows=bin_rows, flat_rows=flat_rows) for i in range(n)]
        self._spikes = [SpikeSearch(i, bin_rows) for i in range(n)]
        self._spectra = SpectrumCheck(n, bin_rows, crossed=crossed, spectrogram=thorough)
        self._long_blocks = LongBlocks(n, bin_rows)

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        self._moments.add(chunk)
        self._spectra.add(chunk)
        self._long_blocks.add(chunk)
        for run, spikes in zip(self._runs, self._spikes, strict=True):
            run.add(chunk)
            spikes.add(chunk)

    def finish(self) -> _TrackFigures:
        """Return what was found, after the last chunk."""
        for run in self._runs:
            run.finish()
        self._spectra.finish()
        clock = self._clock.result(self._track, self._names)
        bins = self._moments.bins(self._clock.bin_rows)
        frequency_hz, psd, averages = self._spectra.mean.psd(clock.fs)
        lines = self._find_lines(clock.fs)
        overviews = self._make_overviews(clock, frequency_hz, psd)
        channels = [
            self._make_channel(i, clock.fs, bins, (frequency_hz, psd[i], float(averages[i])), lines[i], overviews[i])
            for i in range(len(self._names))
        ]
        crossed = self._cross(clock.fs)
        pairs, between = compare_pairs(*crossed, fs=clock.fs) if len(crossed[0]) > 1 else ((), ())
        findings = [
            Finding(severity, code, "", message) for severity, code, message in describe_clock(self._clock, clock)
        ]
        findings += [*between, *(finding for each in channels for finding in each.findings)]
        healths = tuple(each.health for each in channels)
        history = self._make_rms_history(clock.fs, bins, channels)
        return _TrackFigures(clock, healths, pairs, tuple(findings), history, crossed)

    def _find_lines(self, fs: float) -> list[tuple[SpectralLine, ...]]:
        """Return the spectral lines of each channel, by the long blocks where there are enough of them."""
        short, long = ((blocks, *blocks.psd(fs)) for blocks in (self._spectra.mean, self._long_blocks.mean))
        every = []
        for i, run in enumerate(self._runs):
            blocks, frequency_hz, psd, _ = long if long[3][i] >= LEAST_LONG_AVERAGES else short
            every.append(() if run.is_mute else lines_of(frequency_hz, psd[i], blocks.line_averages(i), fs=fs))
        return every

    def _make_channel(
        self,
        i: int,
        fs: float,
        bins: Bins,
        spectrum: tuple[FloatArray, FloatArray, float],
        lines: tuple[SpectralLine, ...],
        overview: Overview | None,
    ) -> _ChannelFigures:
        run, (frequency_hz, psd, averages) = self._runs[i], spectrum
        step = run.step()
        n_clipped, clipped_at, clipped = run.find_clipping(step)
        flat, spikes = self._find_held_and_spikes(i, bins, step)
        missing = run.missing.rows()
        mean, rms, peak = bins.moments(i)
        drift, drift_part_s = bins.drift(i, fs)
        kinds: dict[Kind, np.ndarray] = {"missing": missing, "clipped": clipped, "flat": flat}
        kinds["spike"] = np.stack([spikes, spikes + 1], axis=1)
        health = ChannelHealth(
            name=self._names[i],
            unit=self._units[i],
            mean=mean,
            rms=rms,
            peak=peak,
            crest_factor=0.0 if run.is_mute or not rms else peak / rms,
            high_frequency_rms=rms_above(frequency_hz, psd, HEALTH.high_frequency_hz),
            quantisation_step=step,
            clipped_fraction=n_clipped / max(run.n_values, 1),
            longest_flat_s=max(run.longest - 1, 0) / fs,
            spikes=int(spikes.size),
            mute=run.is_mute,
            missing=run.n_missing,
            drift=drift,
            noise_floor=0.0 if run.is_mute else floor_of(frequency_hz, psd, averages, fs=fs),
            lines=lines,
            stretches=tuple(stretch for kind, rows in kinds.items() for stretch in self._make_stretches(kind, rows)),
            overview=overview,
        )
        longest = flat[np.argmax(flat[:, 1] - flat[:, 0])] if flat.size else None
        sentences = describe_channel(
            health,
            n_values=run.n_values,
            clipped_at=clipped_at,
            held_s=0.0 if longest is None else (longest[1] - longest[0] - 1) / fs,
            held_from_s=np.nan if longest is None else float(self._clock.seconds(longest[:1])[0]),
            drift_part_s=drift_part_s,
        )
        most_spikes = HEALTH.most_spikes * bins.rows / self._clock.bin_rows
        has_many_spikes = np.bincount(spikes // bins.rows, minlength=bins.n.shape[0]) > most_spikes
        is_complete = ~bins.touched_by(missing)
        is_sound = is_complete & ~bins.touched_by(clipped) & ~bins.touched_by(flat) & ~has_many_spikes
        findings = [Finding(severity, code, health.name, message) for severity, code, message in sentences]
        return _ChannelFigures(health, findings, is_sound & (not run.is_mute), is_complete)

    def _find_held_and_spikes(self, i: int, bins: Bins, step: float | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the stretches of a held value beside motion, (n, 2) rows, and the rows of the spikes."""
        if self._runs[i].is_mute:
            return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64)
        flat = self._runs[i].flat.rows()
        # a standstill below the resolution has no motion beside it, and is no dropout
        flat = flat[bins.rms_beside(i, flat) > HEALTH.coarse_steps * (step or 0.0)]
        spikes = self._spikes[i].rows(step)
        return flat, spikes[~_is_beside_held(spikes, flat)]

    def _make_stretches(self, kind: Kind, rows: np.ndarray) -> tuple[Stretch, ...]:
        starts, stops = self._clock.seconds(rows[:MOST_SHOWN].T)
        return tuple(Stretch(kind, float(a), float(b)) for a, b in zip(starts, stops, strict=True))

    def _make_rms_history(self, fs: float, bins: Bins, channels: Sequence[_ChannelFigures]) -> RmsHistory:
        jumps = self._clock.jumps()
        has_no_jump = ~bins.touched_by(np.stack([jumps, jumps + 1], axis=1))[:, np.newaxis]
        is_complete = np.stack([each.is_complete for each in channels], axis=1)
        return RmsHistory(
            start_s=self._clock.seconds(np.arange(bins.n.shape[0]) * bins.rows),
            length_s=bins.rows / fs,
            rms=np.where(is_complete, bins.rms, np.nan),
            mean=bins.mean,
            sound=np.stack([each.is_sound for each in channels], axis=1) & has_no_jump,
            complete=is_complete & has_no_jump,
        )

    def _make_overviews(
        self, clock: ClockHealth, frequency_hz: FloatArray, psd: FloatArray
    ) -> Sequence[Overview | None]:
        if not self._thorough:
            return [None] * len(self._names)
        units, lowest, highest = self._moments.envelope()
        step = units * self._clock.bin_rows // 64
        middles = self._clock.seconds(_find_middles(lowest.shape[0], step, clock.n_samples))
        joined, lines_hz, density = self._spectra.spectrogram(clock.fs)
        times = _find_middles(density.shape[1], joined * self._clock.bin_rows, clock.n_samples)
        # the last stretch may lie wholly beyond the end, where the last bin was filled up
        inside = np.arange(lowest.shape[0]) * step < clock.n_samples
        return [
            Overview(
                time_s=middles[inside],
                lowest=lowest[inside, i],
                highest=highest[inside, i],
                frequency_hz=frequency_hz,
                psd=psd[i],
                spectrogram_s=self._clock.seconds(times),
                spectrogram_hz=lines_hz,
                spectrogram=density[i],
            )
            for i in range(len(self._names))
        ]

    def _cross(self, fs: float) -> _Crossed:
        """Return the cross-spectra of the accelerations that are not mute."""
        kept = [k for k, i in enumerate(self._spectra.crossed) if not self._runs[i].is_mute]
        if len(kept) < 2:
            return (), np.empty(0), np.empty((0, 0, 0), dtype=np.complex128), 0.0
        frequency_hz, density, averages = self._spectra.cross(fs)
        names = tuple(self._names[self._spectra.crossed[k]] for k in kept)
        return names, frequency_hz, density[np.ix_(kept, kept)], averages


def _is_beside_held(spikes: np.ndarray, flat: np.ndarray) -> np.ndarray:
    if not flat.size:
        return np.zeros(spikes.size, dtype=bool)
    after = np.searchsorted(flat[:, 0], spikes + HEALTH.held_rows, "right") - 1
    return (after >= 0) & (spikes < flat[np.maximum(after, 0), 1] + HEALTH.held_rows)


def _find_middles(n: int, rows: int, n_samples: int) -> FloatArray:
    """Return the row in the middle of each of n stretches of so many rows; the last one ends with the samples."""
    starts = np.arange(n) * rows
    return np.asarray(0.5 * (starts + np.minimum(starts + rows, n_samples)), dtype=np.float64)
