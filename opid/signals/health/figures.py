"""What the checks of a track have seen, put together: figures, details, pictures, and where the motion is sound."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from opid.signals.health.across_channels import pair_findings, pairs_of
from opid.signals.health.channel import Bins, MomentCheck, RunCheck
from opid.signals.health.clock import MOST_SHOWN, ClockCheck, clock_findings
from opid.signals.health.findings import ChannelDetails, NoUnit
from opid.signals.health.lines import lines_of
from opid.signals.health.result import (
    ChannelHealth,
    ClockHealth,
    Finding,
    Kind,
    Overview,
    PairHealth,
    RmsHistory,
    SpectralLine,
    Stretch,
)
from opid.signals.health.settings import HEALTH
from opid.signals.health.spectrum import LEAST_LONG_AVERAGES, LongBlocks, SpectrumCheck, floor_of, rms_above
from opid.signals.health.spikes import SpikeSearch
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class TrackFigures:
    """All that was found in one track.

    Args:
        clock: its figures.
        channels: figures of each.
        details: where something is wrong, by the channel's name.
        pairs: accelerations beside each other.
        findings: what is wrong with the clock and between channels.
        rms_history: how strong the motion is, second by second.
    """

    clock: ClockHealth
    channels: tuple[ChannelHealth, ...]
    details: dict[str, ChannelDetails]
    pairs: tuple[PairHealth, ...]
    findings: tuple[Finding, ...]
    rms_history: RmsHistory


@dataclass(frozen=True, eq=False)
class Checks:
    """The checks of one track, after all rows.

    Args:
        track: its name.
        names: of the channels.
        units: SI, or "?".
        without_unit: why no unit is known, None where one is.
        bin_rows: rows of a bin.
        clock: of its stamps.
        moments: of all channels.
        runs: one a channel.
        spikes: one a channel.
        spectra: of all channels.
        long_blocks: of all channels.
        thorough: whether pairs and pictures are wanted.
    """

    track: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    without_unit: tuple[NoUnit | None, ...]
    bin_rows: int
    clock: ClockCheck
    moments: MomentCheck
    runs: tuple[RunCheck, ...]
    spikes: tuple[SpikeSearch, ...]
    spectra: SpectrumCheck
    long_blocks: LongBlocks
    thorough: bool


def track_figures(checks: Checks) -> TrackFigures:
    """Return what was found in a track."""
    clock = checks.clock.result(checks.track, checks.names)
    bins = checks.moments.bins(checks.bin_rows)
    short, long = checks.spectra.mean, checks.long_blocks.mean
    frequency_hz, psd, averages = short.psd(clock.fs)
    long_hz, long_psd, long_averages = long.psd(clock.fs)
    channels, details, sound, complete = [], {}, [], []
    for i, name in enumerate(checks.names):
        is_long = long_averages[i] >= LEAST_LONG_AVERAGES
        blocks, at_hz, density = (long, long_hz, long_psd) if is_long else (short, frequency_hz, psd)
        lines = () if checks.runs[i].is_mute else lines_of(at_hz, density[i], blocks.line_averages(i), fs=clock.fs)
        usual = (frequency_hz, psd[i], float(averages[i]))
        channel, own_details, good, whole = _channel(checks, i, clock.fs, bins, usual, lines)
        channels.append(channel)
        details[name] = own_details
        sound.append(good)
        complete.append(whole)
    channels = _with_overviews(checks, channels, clock, frequency_hz, psd)
    steady = ~_touched_bins(_jumps(checks.clock), bins)
    starts = checks.clock.seconds(np.arange(bins.n.shape[0]) * bins.rows)
    rms_history = RmsHistory(
        start_s=starts,
        length_s=bins.rows / clock.fs,
        rms=np.where(np.stack(complete, axis=1), bins.rms, np.nan),
        sound=np.stack(sound, axis=1) & steady[:, np.newaxis],
        complete=np.stack(complete, axis=1) & steady[:, np.newaxis],
    )
    pairs, findings = _pairs(checks, clock.fs)
    findings = (*clock_findings(checks.clock, clock), *findings)
    return TrackFigures(clock, tuple(channels), details, pairs, findings, rms_history)


def _channel(
    checks: Checks,
    i: int,
    fs: float,
    bins: Bins,
    spectrum: tuple[FloatArray, FloatArray, float],
    lines: tuple[SpectralLine, ...],
) -> tuple[ChannelHealth, ChannelDetails, np.ndarray, np.ndarray]:
    """Figures and details of one channel, and which bins are sound, which complete."""
    run, frequency_hz, psd = checks.runs[i], spectrum[0], spectrum[1]
    step = run.step()
    spikes = np.empty(0, dtype=np.int64) if run.is_mute else checks.spikes[i].rows(step)
    held, clipped_at, clipped = run.find_clipping(step)
    flat = _beside_motion(run.flat.rows(), bins, i, step) if not run.is_mute else np.empty((0, 2), dtype=np.int64)
    spikes = spikes[~_beside_held(spikes, flat)]
    missing = run.missing.rows()
    mean, rms, peak = _moments(bins, i, float(checks.moments.lowest[i]), float(checks.moments.highest[i]))
    drift, part_s = _drift(bins, i, fs)
    kinds: tuple[tuple[Kind, np.ndarray], ...] = (
        ("missing", missing),
        ("clipped", clipped),
        ("flat", flat),
        ("spike", np.stack([spikes, spikes + 1], axis=1)),
    )
    channel = ChannelHealth(
        name=checks.names[i],
        unit=checks.units[i],
        mean=mean,
        rms=rms,
        peak=peak,
        crest_factor=0.0 if run.is_mute or not rms else peak / rms,
        high_frequency_rms=rms_above(frequency_hz, psd, HEALTH.high_frequency_hz),
        quantisation_step=step,
        clipped_fraction=held / max(run.n_values, 1),
        longest_flat_s=max(run.longest - 1, 0) / fs,
        spikes=int(spikes.size),
        mute=run.is_mute,
        missing=run.n_missing,
        drift=drift,
        noise_floor=0.0 if run.is_mute else floor_of(frequency_hz, psd, spectrum[2], fs=fs),
        lines=lines,
        stretches=tuple(stretch for kind, rows in kinds for stretch in _stretches(kind, rows, checks.clock)),
    )
    longest = flat[np.argmax(flat[:, 1] - flat[:, 0])] if flat.size else None
    own_details = ChannelDetails(
        clipped_at=tuple(clipped_at),
        held_s=0.0 if longest is None else (longest[1] - longest[0] - 1) / fs,
        held_from_s=np.nan if longest is None else float(checks.clock.seconds(longest[:1])[0]),
        drift_part_s=part_s,
        without_unit=checks.without_unit[i],
    )
    most = HEALTH.most_spikes * bins.rows / checks.bin_rows
    many = np.bincount(spikes // bins.rows, minlength=bins.n.shape[0]) > most
    complete = ~_touched_bins(missing, bins)
    sound = complete & ~_touched_bins(clipped, bins) & ~_touched_bins(flat, bins) & ~many & (not run.is_mute)
    return channel, own_details, sound, complete


def _moments(bins: Bins, i: int, lowest: float, highest: float) -> tuple[float, float, float]:
    """Mean, rms about it and the largest distance from it, over all bins."""
    n = bins.n[:, i]
    total = n.sum()
    if not total:
        return np.nan, np.nan, np.nan
    means, squares = np.nan_to_num(bins.mean[:, i]), np.nan_to_num(bins.rms[:, i]) ** 2
    mean = float(n @ means / total)
    rms = float(np.sqrt(n @ (squares + (means - mean) ** 2) / total))
    return mean, rms, max(highest - mean, mean - lowest)


def _drift(bins: Bins, i: int, fs: float) -> tuple[float, float]:
    """Range of the means of long stretches, and their length, s; 0 where there are not two of them."""
    n = bins.n[:, i]
    length_s = n.size * bins.rows / fs
    parts = min(HEALTH.drift_parts, int(n.sum() / fs / HEALTH.drift_part_s), n.size)
    if parts < 2:
        return 0.0, length_s
    edges = np.arange(parts) * n.size // parts
    count = np.add.reduceat(n, edges)
    means = np.add.reduceat(n * np.nan_to_num(bins.mean[:, i]), edges)[count > 0] / count[count > 0]
    return float(np.ptp(means)), length_s / parts


def _beside_motion(flat: np.ndarray, bins: Bins, i: int, step: float | None) -> np.ndarray:
    """Those of the stretches at one value that have motion just beside: a standstill below the resolution has not."""
    if not flat.size:
        return flat
    rms, half = np.nan_to_num(bins.rms[:, i]), bins.rows // 2
    before = np.clip((flat[:, 0] - half) // bins.rows, 0, rms.size - 1)
    after = np.clip((flat[:, 1] + half) // bins.rows, 0, rms.size - 1)
    beside = np.maximum(rms[before], rms[after])
    return flat[beside > HEALTH.coarse_steps * (step or 0.0)]


def _beside_held(spikes: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Which of the spikes are but where a held value begins, ends or is held again."""
    if not flat.size:
        return np.zeros(spikes.size, dtype=bool)
    after = np.searchsorted(flat[:, 0], spikes + HEALTH.held_rows, "right") - 1
    return (after >= 0) & (spikes < flat[np.maximum(after, 0), 1] + HEALTH.held_rows)


def _touched_bins(stretches: np.ndarray, bins: Bins) -> np.ndarray:
    """Which bins the stretches touch."""
    n = bins.n.shape[0]
    edges = np.zeros(n + 1)
    if stretches.size:
        np.add.at(edges, np.minimum(stretches[:, 0] // bins.rows, n), 1)
        np.add.at(edges, np.minimum((stretches[:, 1] - 1) // bins.rows + 1, n), -1)
    return np.cumsum(edges[:-1]) > 0


def _jumps(clock: ClockCheck) -> np.ndarray:
    rows = clock.jumps()
    return np.stack([rows, rows + 1], axis=1)


def _stretches(kind: Kind, rows: np.ndarray, clock: ClockCheck) -> tuple[Stretch, ...]:
    shown = rows[:MOST_SHOWN]
    starts, stops = clock.seconds(shown[:, 0]), clock.seconds(shown[:, 1])
    return tuple(Stretch(kind, float(a), float(b)) for a, b in zip(starts, stops, strict=True))


def _with_overviews(
    checks: Checks, channels: list[ChannelHealth], clock: ClockHealth, frequency_hz: FloatArray, psd: FloatArray
) -> list[ChannelHealth]:
    """The channels with what a picture shows of them."""
    if not checks.thorough:
        return channels
    units, lowest, highest = checks.moments.envelope()
    step = units * checks.bin_rows // 64
    middles = checks.clock.seconds(_middles(lowest.shape[0], step, clock.n_samples))
    joined, lines_hz, density = checks.spectra.spectrogram(clock.fs)
    times = checks.clock.seconds(_middles(density.shape[1], joined * checks.bin_rows, clock.n_samples))
    # a last stretch may lie wholly beyond the end, where the last bin was filled up
    inside = np.arange(lowest.shape[0]) * step < clock.n_samples
    return [
        replace(
            channel,
            overview=Overview(
                time_s=middles[inside],
                lowest=lowest[inside, i],
                highest=highest[inside, i],
                frequency_hz=frequency_hz,
                psd=psd[i],
                spectrogram_s=times,
                spectrogram_hz=lines_hz,
                spectrogram=density[i],
            ),
        )
        for i, channel in enumerate(channels)
    ]


def _middles(n: int, rows: int, n_samples: int) -> FloatArray:
    starts = np.arange(n) * rows
    return np.asarray(0.5 * (starts + np.minimum(starts + rows, n_samples)), dtype=np.float64)


def _pairs(checks: Checks, fs: float) -> tuple[tuple[PairHealth, ...], tuple[Finding, ...]]:
    crossed = [i for i in checks.spectra.crossed if not checks.runs[i].is_mute]
    if len(crossed) < 2:
        return (), ()
    names = [checks.names[i] for i in crossed]
    kept = [checks.spectra.crossed.index(i) for i in crossed]
    frequency_hz, density, averages = checks.spectra.cross(fs)
    density = density[np.ix_(kept, kept)]
    pairs = pairs_of(names, frequency_hz, density, averages)
    return pairs, tuple(pair_findings(pairs, names, frequency_hz, density, fs=fs))
