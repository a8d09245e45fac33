"""All checks of one track, and their results: figures, findings, and the stretches of sound motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.health.across_channels import compare_pairs
from opid.signals.health.channel import Bins, MomentCheck, RunCheck
from opid.signals.health.chunks import Chunk
from opid.signals.health.clock import MOST_SHOWN, ClockCheck
from opid.signals.health.findings import channel_sentences, clock_sentences
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
from opid.signals.health.spectrum import LEAST_LONG_AVERAGES, LongBlocks, SpectrumCheck, floor_of, lines_of, rms_above
from opid.signals.health.spikes import SpikeSearch
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class TrackFigures:
    """All that was found in one track.

    Args:
        clock: figures of its clock.
        channels: figures of each channel.
        pairs: figures of each two accelerations.
        findings: what is wrong with the clock, between channels and with each channel.
        rms_history: how strong the motion is, second by second.
    """

    clock: ClockHealth
    channels: tuple[ChannelHealth, ...]
    pairs: tuple[PairHealth, ...]
    findings: tuple[Finding, ...]
    rms_history: RmsHistory


@dataclass(frozen=True, eq=False)
class _ChannelFigures:
    health: ChannelHealth
    findings: list[Finding]
    is_sound: np.ndarray  # (n_bins,)
    is_complete: np.ndarray  # (n_bins,)


class TrackCheck:
    """The checks of the clock and of all channels of one track.

    Args:
        track: its name.
        names: of the channels.
        units: of the channels in SI, "?" where none is known.
        clock: the check of its stamps.
        thorough: whether pairs of channels are compared, and what a picture shows is kept.
    """

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

    def finish(self) -> TrackFigures:
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
        pairs, between = self._compare_pairs(clock.fs)
        findings = [
            Finding(severity, code, "", message) for severity, code, message in clock_sentences(self._clock, clock)
        ]
        findings += [*between, *(finding for each in channels for finding in each.findings)]
        healths = tuple(each.health for each in channels)
        return TrackFigures(clock, healths, pairs, tuple(findings), self._make_rms_history(clock.fs, bins, channels))

    def _find_lines(self, fs: float) -> list[tuple[SpectralLine, ...]]:
        """The spectral lines of each channel, by the long blocks where there are enough of them."""
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
        sentences = channel_sentences(
            health,
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
        """The stretches of a held value beside motion, (n, 2) rows, and the rows of the spikes."""
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
            sound=np.stack([each.is_sound for each in channels], axis=1) & has_no_jump,
            complete=is_complete & has_no_jump,
        )

    def _make_overviews(
        self, clock: ClockHealth, frequency_hz: FloatArray, psd: FloatArray
    ) -> Sequence[Overview | None]:
        """What a picture shows of each channel."""
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

    def _compare_pairs(self, fs: float) -> tuple[tuple[PairHealth, ...], tuple[Finding, ...]]:
        kept = [k for k, i in enumerate(self._spectra.crossed) if not self._runs[i].is_mute]
        if len(kept) < 2:
            return (), ()
        names = [self._names[self._spectra.crossed[k]] for k in kept]
        frequency_hz, density, averages = self._spectra.cross(fs)
        return compare_pairs(names, frequency_hz, density[np.ix_(kept, kept)], averages, fs=fs)


def _is_beside_held(spikes: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Whether each spike only stands where a held value begins, ends or is held again."""
    if not flat.size:
        return np.zeros(spikes.size, dtype=bool)
    after = np.searchsorted(flat[:, 0], spikes + HEALTH.held_rows, "right") - 1
    return (after >= 0) & (spikes < flat[np.maximum(after, 0), 1] + HEALTH.held_rows)


def _find_middles(n: int, rows: int, n_samples: int) -> FloatArray:
    """Row in the middle of each of n stretches of so many rows; the last one ends with the samples."""
    starts = np.arange(n) * rows
    return np.asarray(0.5 * (starts + np.minimum(starts + rows, n_samples)), dtype=np.float64)
