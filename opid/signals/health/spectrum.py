"""Spectra of a log that is read but once: Welch averages, spectrogram, long blocks for lines, noise floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.health.chunks import Chunk
from opid.signals.health.lines import growing_edges
from opid.signals.health.thinning import Thinning
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, white_noise_rms

HIGH_FREQUENCY_HZ = 5.0
"""Above the bounce of a vehicle (1 to 3 Hz), where the suspension isolates the sprung side."""

OVERLAPPED_BINS = 512
"""Bins (9 min) in which blocks overlap by a half, for smoother averages; later there are enough without."""

MENDED_PART = 0.05
"""Part of a block that may be missing: it is put on straight lines; more, and the block is left out."""

SPECTROGRAM_TIMES = 300

BAND_PART = 0.025
"""Width of the spectrogram's bands, as a part of their frequency: those of a suspension are single lines."""

LONG_BINS, LEAST_LONG_BINS, LONG_VALUES = 16, 4, 1 << 22
"""Bins (seconds) of the long blocks in which lines are looked for; fewer where more values would be held in memory."""

LEAST_LONG_AVERAGES = 3.0
"""Long blocks that tell more of lines than the many short ones of the same record."""


LINES_A_BAND, EVEN_BAND_PART = 32, 0.1
"""Least lines, and width over frequency, of the bands whose power is compared from block to block:
enough lines that chance moves it by a tenth, few enough that the spectrum is one level there."""


class BlockPowers:
    """How many blocks a mean over blocks is worth where their power differs, as on a run-out whose speed falls.

    The mean of n blocks of powers Q_b scatters like that of (sum Q_b)^2 / sum Q_b^2 equal ones.

    Args:
        n_channels: number of channels.
        n_lines: of the spectra.
    """

    def __init__(self, n_channels: int, n_lines: int) -> None:
        self._edges = LINES_A_BAND * growing_edges(max(1, n_lines // LINES_A_BAND), part=EVEN_BAND_PART)
        self._sums = np.zeros((2, n_channels, self._edges.size))
        self._n_lines = n_lines

    def add(self, channel: int, power: FloatArray, weights: FloatArray) -> None:
        """Take blocks.

        Args:
            power: (n_blocks, n_lines) of each.
            weights: (n_blocks,) with which they enter the mean.
        """
        own = np.add.reduceat(power, self._edges, axis=1) * weights[:, np.newaxis]
        self._sums[0, channel] += own.sum(axis=0)
        self._sums[1, channel] += (own * own).sum(axis=0)

    def averages(self, channel: int) -> FloatArray:
        """Return what the mean is worth at each line, in blocks of equal power; 0 where there is none."""
        total, squares = self._sums[:, channel]
        worth = np.divide(total**2, squares, out=np.zeros_like(total), where=squares > 0)
        return np.repeat(worth, np.diff(np.append(self._edges, self._n_lines)))


class SpectrumCheck:
    """Welch spectra of all channels, cross-spectra of some, block by block of two bins.

    Args:
        n_channels: of the chunks.
        bin_rows: half a block.
        crossed: columns whose cross-spectra are wanted.
        spectrogram: whether one is wanted.
    """

    def __init__(self, n_channels: int, bin_rows: int, *, crossed: Sequence[int] = (), spectrogram: bool) -> None:
        self._n, self._bin, self.crossed = n_channels, bin_rows, tuple(crossed)
        self._power: FloatArray | None = None
        self._worth = BlockPowers(n_channels, bin_rows + 1)
        self._weight = np.zeros((2, n_channels))  # sum of the blocks' weights, and of their squares
        self._cross: ComplexArray | None = None
        self.cross_weight = np.zeros(2)
        self._nperseg, self._window = 2 * bin_rows, hann(2 * bin_rows)
        self._edges = growing_edges(bin_rows + 1, part=BAND_PART)
        most = min(SPECTROGRAM_TIMES, max(8, 2_000_000 // (n_channels * self._edges.size)))
        self._gram = Thinning({"power": np.add, "weight": np.add}, most) if spectrogram else None
        self._block_before: tuple[FloatArray, FloatArray] | None = None

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        used = chunk.lead + chunk.n
        if chunk.first == 0 and used < self._nperseg:
            self._nperseg, self._window = used, hann(used)
            self._edges = growing_edges(used // 2 + 1, part=BAND_PART)
        if self._power is None:
            n_lines, n_crossed = self._nperseg // 2 + 1, len(self.crossed)
            self._power, self._worth = np.zeros((self._n, n_lines)), BlockPowers(self._n, n_lines)
            self._cross = np.zeros((n_crossed, n_crossed, n_lines), dtype=np.complex128)
        before = (chunk.first - chunk.lead) // self._bin
        starts = np.arange(0, max(used - self._nperseg, 0 if used >= self._nperseg else -1) + 1, self._bin)
        slots = starts // self._bin
        weights = np.where(before + slots < OVERLAPPED_BINS, 1.0, 2.0)
        wanted = (weights == 1.0) | ((before + slots) % 2 == 0)
        if used % self._bin and used > self._nperseg:
            # the end of a log that is no whole bin: in the spectrogram alone
            starts, slots = np.append(starts, used - self._nperseg), np.append(slots, used // self._bin - 1)
            weights, wanted = np.append(weights, 0.0), np.append(wanted, True)
        first = chunk.first - chunk.lead + starts
        inside = np.searchsorted(chunk.breaks, first + self._nperseg) > np.searchsorted(chunk.breaks, first, "right")
        wanted &= ~inside
        grouped, usable = self._take(chunk, starts[wanted], weights[wanted])
        if self._gram is not None:
            self._add_to_gram(chunk, slots[wanted], usable, grouped)

    def finish(self) -> None:
        """Take the end of the last chunk."""
        if self._gram is not None and self._block_before is not None:
            power, usable = self._block_before
            self._gram.add({"power": power[np.newaxis], "weight": usable[np.newaxis]})

    def _take(self, chunk: Chunk, starts: np.ndarray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Add blocks to the spectra; return (n_channels, n, ...) their powers by bands, and whether they are usable."""
        assert self._power is not None
        spectra: dict[int, ComplexArray] = {}
        usable = np.ones((self._n, starts.size))
        grouped = np.zeros((self._n, starts.size, self._edges.size))
        for i, row in enumerate(chunk.values if starts.size else ()):
            blocks = np.lib.stride_tricks.sliding_window_view(row, self._nperseg)[starts]
            if chunk.missing[i]:
                usable[i] = _mended(blocks)
            blocks -= blocks.mean(axis=1, keepdims=True)
            blocks *= self._window
            spectrum = np.fft.rfft(blocks, axis=1)
            own = weights * usable[i]
            power = spectrum.real**2
            power += spectrum.imag**2
            self._power[i] += own @ power
            self._worth.add(i, power, own)
            self._weight[0, i] += own.sum()
            self._weight[1, i] += own @ own
            if i in self.crossed:
                spectra[i] = spectrum
            if self._gram is not None:
                grouped[i] = np.add.reduceat(power, self._edges, axis=1) * usable[i][:, np.newaxis]
        if self.crossed and starts.size:
            self._take_cross(spectra, weights * usable[list(self.crossed)].all(axis=0))
        return grouped, usable

    def _take_cross(self, spectra: dict[int, ComplexArray], weights: FloatArray) -> None:
        assert self._cross is not None
        self.cross_weight += np.array([weights.sum(), weights @ weights])
        for i, one in enumerate(self.crossed):
            conjugate = spectra[one].conj()
            conjugate *= weights[:, np.newaxis]
            for j in range(i, len(self.crossed)):
                self._cross[i, j] += np.einsum("kl,kl->l", conjugate, spectra[self.crossed[j]])

    def _add_to_gram(self, chunk: Chunk, slots: np.ndarray, usable: FloatArray, grouped: FloatArray) -> None:
        """One item a bin: the block that ends with it or, where that is of no use, the one that begins with it.

        The item of the last bin waits for the next chunk.
        """
        assert self._gram is not None
        bins = -(-(chunk.lead + chunk.n) // self._bin)
        # the first is the block that ends with the first bin
        power, usable_at = np.zeros((bins, self._n, self._edges.size)), np.zeros((bins, self._n))
        if self._block_before is not None:
            power[0], usable_at[0] = self._block_before
        at = np.minimum(slots + 1, bins - 1)
        power[at], usable_at[at] = np.moveaxis(grouped, 0, 1), usable.T
        self._block_before = power[-1].copy(), usable_at[-1].copy()
        ending = usable_at[:-1] > 0
        items = {
            "power": np.where(ending[:, :, np.newaxis], power[:-1], power[1:]),
            "weight": np.where(ending, usable_at[:-1], usable_at[1:]),
        }
        self._gram.add(items)

    def psd(self, fs: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return frequencies, Hz, densities (n_channels, n_lines), unit^2/Hz, and the averages of each channel.

        Args:
            fs: rate, Hz.
        """
        frequency_hz = self._frequencies(fs)
        if self._power is None:
            return frequency_hz, np.zeros((self._n, frequency_hz.size)), np.zeros(self._n)
        density = self._power / np.maximum(self._weight[0], 1e-300)[:, np.newaxis] * self._scale(fs)
        density[self._weight[0] == 0] = np.nan
        averages = self._weight[0] ** 2 / np.maximum(self._weight[1], 1e-300)
        return frequency_hz, density, averages

    def line_averages(self, channel: int) -> FloatArray:
        """Return how many blocks of equal power the density of each line is worth, (n_lines,)."""
        return self._worth.averages(channel)

    def cross(self, fs: float) -> tuple[FloatArray, ComplexArray, float]:
        """Return frequencies, Hz, densities E[conj(X_i) X_j] for i <= j (n, n, n_lines), unit^2/Hz, and the averages.

        Args:
            fs: rate, Hz.
        """
        total, squares = self.cross_weight
        assert self._cross is not None
        density = self._cross / max(total, 1e-300) * self._scale(fs)
        # blocks that overlap by a half under a Hann window share a correlation of 1/6 (Welch 1967)
        shared = 1 + 2 * (1 / 6) ** 2 if total == squares else 1.0
        return self._frequencies(fs), density, float(total**2 / max(squares, 1e-300) / shared)

    def spectrogram(self, fs: float) -> tuple[int, FloatArray, FloatArray]:
        """Return the bins of a time, frequencies, Hz, and densities (n_channels, n_times, n_lines), NaN where none.

        Args:
            fs: rate, Hz.
        """
        assert self._gram is not None
        items = self._gram.items()
        sizes = np.diff(np.append(self._edges, self._nperseg // 2 + 1))
        middles = (self._edges + 0.5 * (sizes - 1)) * fs / self._nperseg
        weight = items["weight"][:, :, np.newaxis]
        scale = 2 / (fs * np.sum(self._window**2))
        density = items["power"] / np.where(weight > 0, weight, np.nan) / sizes * scale
        return 2**self._gram.level, middles, np.moveaxis(density, 1, 0)

    def _frequencies(self, fs: float) -> FloatArray:
        return np.arange(self._nperseg // 2 + 1, dtype=np.float64) * float(fs / self._nperseg)

    def _scale(self, fs: float) -> FloatArray:
        scale = np.full(self._nperseg // 2 + 1, 2 / (fs * np.sum(self._window**2)))
        scale[0] /= 2
        if self._nperseg % 2 == 0:
            scale[-1] /= 2
        return scale


class LongBlocks:
    """Spectra of long blocks, which tell lines from resonances.

    Args:
        n_channels: of the chunks.
        bin_rows: rows of a bin.
    """

    def __init__(self, n_channels: int, bin_rows: int) -> None:
        bins = min(LONG_BINS, LONG_VALUES // (n_channels * bin_rows))
        # a power of two, so that a chunk fills it exactly or in halves
        self._nperseg = 2 ** (bins.bit_length() - 1) * bin_rows if bins >= LEAST_LONG_BINS else 0
        self._bin, self._window = bin_rows, hann(self._nperseg)
        self._kept = np.empty((n_channels, self._nperseg))
        self._missing: np.ndarray = np.zeros(n_channels, dtype=bool)
        self._first, self._filled, self._last_break = 0, 0, 0
        self._power = np.zeros((n_channels, self._nperseg // 2 + 1))
        self._worth = BlockPowers(n_channels, self._nperseg // 2 + 1)
        self._weight = np.zeros((2, n_channels))

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

    def psd(self, fs: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return frequencies, Hz, densities (n_channels, n_lines), unit^2/Hz, and the averages of each channel.

        Args:
            fs: rate, Hz.
        """
        frequency_hz = np.arange(self._nperseg // 2 + 1) * (fs / max(self._nperseg, 1))
        averages = self._weight[0] ** 2 / np.maximum(self._weight[1], 1e-300)
        if not averages.any():
            return frequency_hz, self._power, averages
        scale = 2 / (fs * np.sum(self._window**2)) / np.maximum(self._weight[0], 1e-300)
        return frequency_hz, self._power * scale[:, np.newaxis], averages

    def line_averages(self, channel: int) -> FloatArray:
        """Return how many blocks of equal power the density of each line is worth, (n_lines,)."""
        return self._worth.averages(channel)

    def _take(self) -> None:
        overlapped = self._first // self._bin < OVERLAPPED_BINS
        if self._last_break <= self._first:
            for i, row in enumerate(self._kept):
                block = row[np.newaxis].copy()
                if self._missing[i] and not _mended(block)[0]:
                    continue
                block -= block.mean()
                block *= self._window
                spectrum = np.fft.rfft(block[0])
                weight = 1.0 if overlapped else 2.0
                power = spectrum.real**2 + spectrum.imag**2
                self._power[i] += weight * power
                self._worth.add(i, power[np.newaxis], np.array([weight]))
                self._weight[:, i] += (weight, weight**2)
        self._filled = self._nperseg // 2 if overlapped else 0
        self._first += self._nperseg - self._filled
        self._kept[:, : self._filled] = self._kept[:, self._nperseg - self._filled :]
        self._missing = np.asarray(np.isnan(self._kept[:, : self._filled]).any(axis=1))


def rms_from(frequency_hz: FloatArray, psd: FloatArray, least_hz: float) -> float:
    """Return the rms above a frequency; without the mean alone if the spectrum ends below it.

    Args:
        frequency_hz: (n_lines,) evenly spaced from 0, Hz.
        psd: (n_lines,) unit^2/Hz.
        least_hz: lowest frequency, Hz.
    """
    if frequency_hz.size < 2 or not np.isfinite(psd).all():
        return 0.0
    first = max(1, int(np.searchsorted(frequency_hz, least_hz - 1e-9))) if least_hz < frequency_hz[-1] else 1
    return float(np.sqrt(psd[first:].sum() * frequency_hz[1]))


def floor_of(frequency_hz: FloatArray, psd: FloatArray, averages: float, *, fs: float) -> float:
    """Return the rms of white noise as quiet as the quietest tenth of a spectrum (see `spectra.noise_floor`).

    Args:
        frequency_hz: (n_lines,) Hz.
        psd: (n_lines,) unit^2/Hz.
        fs: rate, Hz.
    """
    if averages <= 0 or frequency_hz.size < 8 or not np.isfinite(psd).all():
        return 0.0
    return white_noise_rms(frequency_hz, psd, averages, fs=fs)


def hann(n: int) -> FloatArray:
    """Return scipy's periodic Hann window."""
    return np.hanning(n + 1)[:-1] if n > 2 else np.ones(n)


def _mended(blocks: FloatArray) -> np.ndarray:
    """Put what little is missing on straight lines, in place; say which blocks can be used, zero the others."""
    gone = np.isnan(blocks)
    part = gone.mean(axis=1)
    rows = np.arange(blocks.shape[1])
    for k in np.flatnonzero((part > 0) & (part <= MENDED_PART)):
        blocks[k, gone[k]] = np.interp(rows[gone[k]], rows[~gone[k]], blocks[k, ~gone[k]])
    blocks[part > MENDED_PART] = 0.0
    return part <= MENDED_PART
