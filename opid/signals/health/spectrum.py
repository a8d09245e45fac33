"""Spectra of a log that is read but once: Welch averages, spectrogram, long blocks for lines, noise floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.health.chunks import Chunk
from opid.signals.health.lines import growing_edges
from opid.signals.health.thinning import Thinning
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, white_noise_rms

OVERLAPPED_BINS = 512
"""Bins (9 min) in which blocks overlap by a half, for smoother averages; later there are enough without."""

MOST_MISSING = 0.05
"""Part of a block that may be missing: it is put on straight lines; more, and the block is left out."""

SPECTROGRAM_TIMES = 300

BAND_FRACTION = 0.025
"""Width of the spectrogram's bands, as a part of their frequency: those of a suspension are single lines."""

LONG_BINS, LEAST_LONG_BINS, LONG_VALUES = 16, 4, 1 << 22
"""Bins (seconds) of the long blocks in which lines are looked for; fewer where more values would be held in memory."""

LEAST_LONG_AVERAGES = 3.0
"""From so many long blocks on they show lines better than the many short ones of the same record."""


LINES_A_BAND, EVEN_BAND_FRACTION = 32, 0.1
"""Least lines, and width over frequency, of the bands whose power is compared from block to block:
enough lines that chance moves it by a tenth, few enough that the spectrum is flat there."""


class BlockMean:
    """The mean of the spectra of blocks under a Hann window, channel by channel.

    Where the power of the blocks differs, as on a run-out whose speed falls, the mean of n blocks of powers Q_b
    scatters like that of (sum Q_b)^2 / sum Q_b^2 equal ones.
    """

    def __init__(self, n_channels: int, nperseg: int) -> None:
        n_lines = nperseg // 2 + 1
        self.nperseg, self.window = nperseg, hann(nperseg)
        self._power = np.zeros((n_channels, n_lines))
        self._weight = np.zeros((2, n_channels))  # sum of the blocks' weights, and of their squares
        self._edges = LINES_A_BAND * growing_edges(max(1, n_lines // LINES_A_BAND), fraction=EVEN_BAND_FRACTION)
        self._sums = np.zeros((2, n_channels, self._edges.size))

    def add(self, channel: int, power: FloatArray, weights: FloatArray) -> None:
        """Take the powers of blocks, (n_blocks, n_lines), with (n_blocks,) weights."""
        self._power[channel] += weights @ power
        self._weight[:, channel] += weights.sum(), weights @ weights
        own = np.add.reduceat(power, self._edges, axis=1) * weights[:, np.newaxis]
        self._sums[:, channel] += own.sum(axis=0), (own * own).sum(axis=0)

    def transform(self, blocks: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Return the spectra of blocks, (n_blocks, n_lines), and their powers; the blocks are detrended in place."""
        blocks -= blocks.mean(axis=1, keepdims=True)
        blocks *= self.window
        spectrum = np.fft.rfft(blocks, axis=1)
        power = spectrum.real**2
        power += spectrum.imag**2
        return spectrum, power

    def psd(self, fs: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return frequencies, Hz, densities (n_channels, n_lines), unit^2/Hz, and the averages of each channel."""
        total, squares = self._weight
        density = self._power / np.maximum(total, 1e-300)[:, np.newaxis] * self.scale(fs)
        density[total == 0] = np.nan
        return self.frequencies(fs), density, total**2 / np.maximum(squares, 1e-300)

    def line_averages(self, channel: int) -> FloatArray:
        """Return how many blocks of equal power the density of each line is worth, (n_lines,); 0 where none."""
        total, squares = self._sums[:, channel]
        worth = np.divide(total**2, squares, out=np.zeros_like(total), where=squares > 0)
        return np.repeat(worth, np.diff(np.append(self._edges, self._power.shape[1])))

    def frequencies(self, fs: float) -> FloatArray:
        """Return those of the lines, Hz."""
        return np.arange(self.nperseg // 2 + 1, dtype=np.float64) * float(fs / max(self.nperseg, 1))

    def scale(self, fs: float) -> FloatArray:
        """Return what makes the squared transform of a block a one-sided density, (n_lines,)."""
        scale = np.full(self.nperseg // 2 + 1, 2 / (fs * max(np.sum(self.window**2), 1e-300)))
        scale[0] /= 2
        if self.nperseg % 2 == 0:
            scale[-1] /= 2
        return scale


class SpectrumCheck:
    """Welch spectra of all channels, cross-spectra of some, block by block of two bins."""

    def __init__(self, n_channels: int, bin_rows: int, *, crossed: Sequence[int] = (), spectrogram: bool) -> None:
        self._n, self._bin, self.crossed = n_channels, bin_rows, tuple(crossed)
        self.cross_weight = np.zeros(2)
        self._begin(2 * bin_rows)
        most = min(SPECTROGRAM_TIMES, max(8, 2_000_000 // (n_channels * self._edges.size)))
        self._gram = Thinning({"power": np.add, "weight": np.add}, most) if spectrogram else None
        self._block_before: tuple[FloatArray, FloatArray] | None = None

    def _begin(self, nperseg: int) -> None:
        n_lines, n_crossed = nperseg // 2 + 1, len(self.crossed)
        self.mean = BlockMean(self._n, nperseg)
        self._cross = np.zeros((n_crossed, n_crossed, n_lines), dtype=np.complex128)
        self._edges = growing_edges(n_lines, fraction=BAND_FRACTION)

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        used = chunk.lead + chunk.n
        if chunk.first == 0 and used < self.mean.nperseg:
            self._begin(used)
        nperseg = self.mean.nperseg
        before = (chunk.first - chunk.lead) // self._bin
        starts = np.arange(0, max(used - nperseg, 0 if used >= nperseg else -1) + 1, self._bin)
        bin_index = starts // self._bin
        weights = np.where(before + bin_index < OVERLAPPED_BINS, 1.0, 2.0)
        wanted = (weights == 1.0) | ((before + bin_index) % 2 == 0)
        if used % self._bin and used > nperseg:
            # the end of a log that is no whole bin counts in the spectrogram alone
            starts, bin_index = np.append(starts, used - nperseg), np.append(bin_index, used // self._bin - 1)
            weights, wanted = np.append(weights, 0.0), np.append(wanted, True)
        first = chunk.first - chunk.lead + starts
        inside = np.searchsorted(chunk.breaks, first + nperseg) > np.searchsorted(chunk.breaks, first, "right")
        wanted &= ~inside
        grouped, usable = self._take(chunk, starts[wanted], weights[wanted])
        if self._gram is not None:
            self._add_to_gram(chunk, bin_index[wanted], usable, grouped)

    def finish(self) -> None:
        """Take the end of the last chunk."""
        if self._gram is not None and self._block_before is not None:
            power, usable = self._block_before
            self._gram.add({"power": power[np.newaxis], "weight": usable[np.newaxis]})

    def _take(self, chunk: Chunk, starts: np.ndarray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Add blocks to the spectra; return (n_channels, n, ...) their powers by bands, and whether they are usable."""
        spectra: dict[int, ComplexArray] = {}
        usable = np.ones((self._n, starts.size))
        grouped = np.zeros((self._n, starts.size, self._edges.size))
        for i, row in enumerate(chunk.values if starts.size else ()):
            blocks = np.lib.stride_tricks.sliding_window_view(row, self.mean.nperseg)[starts]
            if chunk.missing[i]:
                usable[i] = _mend(blocks)
            spectrum, power = self.mean.transform(blocks)
            self.mean.add(i, power, weights * usable[i])
            if i in self.crossed:
                spectra[i] = spectrum
            if self._gram is not None:
                grouped[i] = np.add.reduceat(power, self._edges, axis=1) * usable[i][:, np.newaxis]
        if self.crossed and starts.size:
            self._take_cross(spectra, weights * usable[list(self.crossed)].all(axis=0))
        return grouped, usable

    def _take_cross(self, spectra: dict[int, ComplexArray], weights: FloatArray) -> None:
        self.cross_weight += np.array([weights.sum(), weights @ weights])
        for i, one in enumerate(self.crossed):
            conjugate = spectra[one].conj()
            conjugate *= weights[:, np.newaxis]
            for j in range(i, len(self.crossed)):
                self._cross[i, j] += np.einsum("kl,kl->l", conjugate, spectra[self.crossed[j]])

    def _add_to_gram(self, chunk: Chunk, bin_index: np.ndarray, usable: FloatArray, grouped: FloatArray) -> None:
        """One item a bin: the block that ends with it or, where that is of no use, the one that begins with it.

        The item of the last bin waits for the next chunk.
        """
        assert self._gram is not None
        bins = -(-(chunk.lead + chunk.n) // self._bin)
        # the first is the block that ends with the first bin
        power, usable_at = np.zeros((bins, self._n, self._edges.size)), np.zeros((bins, self._n))
        if self._block_before is not None:
            power[0], usable_at[0] = self._block_before
        at = np.minimum(bin_index + 1, bins - 1)
        power[at], usable_at[at] = np.moveaxis(grouped, 0, 1), usable.T
        self._block_before = power[-1].copy(), usable_at[-1].copy()
        ending = usable_at[:-1] > 0
        items = {
            "power": np.where(ending[:, :, np.newaxis], power[:-1], power[1:]),
            "weight": np.where(ending, usable_at[:-1], usable_at[1:]),
        }
        self._gram.add(items)

    def cross(self, fs: float) -> tuple[FloatArray, ComplexArray, float]:
        """Return frequencies, Hz, densities E[conj(X_i) X_j] for i <= j (n, n, n_lines), unit^2/Hz, and averages."""
        total, squares = self.cross_weight
        density = self._cross / max(total, 1e-300) * self.mean.scale(fs)
        # blocks that overlap by a half under a Hann window share a correlation of 1/6 (Welch 1967)
        shared = 1 + 2 * (1 / 6) ** 2 if total == squares else 1.0
        return self.mean.frequencies(fs), density, float(total**2 / max(squares, 1e-300) / shared)

    def spectrogram(self, fs: float) -> tuple[int, FloatArray, FloatArray]:
        """Return the bins of a time, frequencies, Hz, and densities (n_channels, n_times, n_lines), NaN where none."""
        assert self._gram is not None
        items = self._gram.items()
        nperseg = self.mean.nperseg
        sizes = np.diff(np.append(self._edges, nperseg // 2 + 1))
        middles = (self._edges + 0.5 * (sizes - 1)) * fs / nperseg
        weight = items["weight"][:, :, np.newaxis]
        scale = 2 / (fs * np.sum(self.mean.window**2))
        density = items["power"] / np.where(weight > 0, weight, np.nan) / sizes * scale
        return 2**self._gram.n_halvings, middles, np.moveaxis(density, 1, 0)


class LongBlocks:
    """Spectra of long blocks, which distinguish lines from resonances."""

    def __init__(self, n_channels: int, bin_rows: int) -> None:
        bins = min(LONG_BINS, LONG_VALUES // (n_channels * bin_rows))
        # a power of two, so that a chunk fills it exactly or in halves
        self._nperseg = 2 ** (bins.bit_length() - 1) * bin_rows if bins >= LEAST_LONG_BINS else 0
        self.mean = BlockMean(n_channels, self._nperseg)
        self._bin = bin_rows
        self._kept = np.empty((n_channels, self._nperseg))
        self._missing: np.ndarray = np.zeros(n_channels, dtype=bool)
        self._first, self._filled, self._last_break = 0, 0, 0

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        done = 0
        while self._nperseg and done < chunk.n:
            step = min(self._nperseg - self._filled, chunk.n - done)
            self._kept[:, self._filled : self._filled + step] = chunk.new[:, done : done + step]
            self._missing |= chunk.missing
            done, self._filled = done + step, self._filled + step
            if self._filled == self._nperseg:
                before = np.searchsorted(chunk.breaks, self._first + self._nperseg)
                self._last_break = int(chunk.breaks[before - 1]) if before else self._last_break
                self._take()
        if chunk.breaks.size:
            self._last_break = int(chunk.breaks[-1])

    def _take(self) -> None:
        overlapped = self._first // self._bin < OVERLAPPED_BINS
        if self._last_break <= self._first:
            for i, row in enumerate(self._kept):
                block = row[np.newaxis].copy()
                if self._missing[i] and not _mend(block)[0]:
                    continue
                self.mean.add(i, self.mean.transform(block)[1], np.array([1.0 if overlapped else 2.0]))
        self._filled = self._nperseg // 2 if overlapped else 0
        self._first += self._nperseg - self._filled
        self._kept[:, : self._filled] = self._kept[:, self._nperseg - self._filled :]
        self._missing = np.asarray(np.isnan(self._kept[:, : self._filled]).any(axis=1))


def rms_above(frequency_hz: FloatArray, psd: FloatArray, least_hz: float) -> float:
    """Return the rms of a spectrum, evenly spaced from 0 Hz, above a frequency; without the mean if it ends below."""
    if frequency_hz.size < 2 or not np.isfinite(psd).all():
        return 0.0
    first = max(1, int(np.searchsorted(frequency_hz, least_hz - 1e-9))) if least_hz < frequency_hz[-1] else 1
    return float(np.sqrt(psd[first:].sum() * frequency_hz[1]))


def floor_of(frequency_hz: FloatArray, psd: FloatArray, averages: float, *, fs: float) -> float:
    """Return the rms of white noise as quiet as the quietest tenth of a spectrum (see `spectra.noise_floor`)."""
    if averages <= 0 or frequency_hz.size < 8 or not np.isfinite(psd).all():
        return 0.0
    return white_noise_rms(frequency_hz, psd, averages, fs=fs)


def hann(n: int) -> FloatArray:
    """Return scipy's periodic Hann window."""
    return np.hanning(n + 1)[:-1] if n > 2 else np.ones(n)


def _mend(blocks: FloatArray) -> np.ndarray:
    """Put what little is missing on straight lines, in place; say which blocks can be used, zero the others."""
    gone = np.isnan(blocks)
    part = gone.mean(axis=1)
    rows = np.arange(blocks.shape[1])
    for k in np.flatnonzero((part > 0) & (part <= MOST_MISSING)):
        blocks[k, gone[k]] = np.interp(rows[gone[k]], rows[~gone[k]], blocks[k, ~gone[k]])
    blocks[part > MOST_MISSING] = 0.0
    return part <= MOST_MISSING
