"""Spectra of a log that is read once: averages of blocks, spectrogram, and the lines that stand out of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.health.chunks import Chunk, Thinning
from opid.signals.health.result import SpectralLine
from opid.signals.health.settings import HEALTH
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, white_noise_rms

OVERLAPPED_BINS = 512
"""In so many bins (9 min) blocks overlap by a half, for smoother averages; later there are enough blocks without."""

MOST_MISSING = 0.05
"""Fraction of a block that may be missing: it is interpolated. A block that misses more is left out."""

SPECTROGRAM_TIMES = 300
"""Times of a spectrogram, at the most."""

BAND_FRACTION = 0.025
"""Width of the spectrogram's bands over their frequency: those of a suspension's motion are single lines."""

LONG_BINS, LEAST_LONG_BINS, LONG_VALUES = 16, 4, 1 << 22
"""Bins (seconds) of the long blocks that show lines, at most and at least; and the values that they may hold."""

LEAST_LONG_AVERAGES = 3.0
"""So many long blocks show lines better than the many short blocks of the same record."""

LINES_A_BAND, EVEN_BAND_FRACTION = 32, 0.1
"""Least lines, and width over frequency, of the bands whose power is compared from block to block.

A band has enough lines that their power scatters by a tenth only, and so few that the spectrum is flat there."""

MAINS_HZ = (50.0, 60.0)
AIRCRAFT_HZ = 400.0

SHARED_BY_LINES = 1.94
"""Variance of a mean over neighbouring lines under a Hann window, over that of independent lines.

It is 1 + 2 ((2/3)^2 + (1/6)^2)."""


class BlockMean:
    """The mean of the spectra of blocks under a Hann window, channel by channel.

    Where the power of the blocks differs, as in a run whose speed falls, the mean of blocks of powers Q_b scatters like
    the mean of (sum Q_b)^2 / sum Q_b^2 blocks of equal power.
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
        """Return the number of blocks of equal power that scatter like the density of each line, (n_lines,)."""
        total, squares = self._sums[:, channel]
        worth = np.divide(total**2, squares, out=np.zeros_like(total), where=squares > 0)
        return np.repeat(worth, np.diff(np.append(self._edges, self._power.shape[1])))

    def frequencies(self, fs: float) -> FloatArray:
        """Return the frequencies of the lines, Hz."""
        return np.arange(self.nperseg // 2 + 1, dtype=np.float64) * float(fs / max(self.nperseg, 1))

    def scale(self, fs: float) -> FloatArray:
        """Return the factor from the squared transform of a block to a one-sided density, (n_lines,)."""
        scale = np.full(self.nperseg // 2 + 1, 2 / (fs * max(np.sum(self.window**2), 1e-300)))
        scale[0] /= 2
        if self.nperseg % 2 == 0:
            scale[-1] /= 2
        return scale


class SpectrumCheck:
    """Welch spectra of all channels and cross-spectra of some; a block is two bins."""

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
            # an end of the log that is no whole bin counts in the spectrogram only
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
        """Add blocks to the spectra; return their powers in bands and whether they are usable, (n_channels, n, ...)."""
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
        """Add an item for each bin: the block that ends with it, or the one that begins with it if that is unusable.

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
        # blocks that overlap by a half under a Hann window have a correlation of 1/6 (Welch 1967)
        shared = 1 + 2 * (1 / 6) ** 2 if total == squares else 1.0
        return self.mean.frequencies(fs), density, float(total**2 / max(squares, 1e-300) / shared)

    def spectrogram(self, fs: float) -> tuple[int, FloatArray, FloatArray]:
        """Return the number of bins of a time, frequencies, Hz, and densities (n_channels, n_times, n_lines) or NaN."""
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
    """Spectra of long blocks, whose fine resolution distinguishes lines from resonances."""

    def __init__(self, n_channels: int, bin_rows: int) -> None:
        bins = min(LONG_BINS, LONG_VALUES // (n_channels * bin_rows))
        # a power of two of bins, so that chunks fill a block exactly
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
    """Return the rms of a spectrum, evenly spaced from 0 Hz, above a frequency; of all lines where it ends below."""
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
    """Interpolate the few missing values in place; return which blocks are usable, and set the others to zero."""
    gone = np.isnan(blocks)
    part = gone.mean(axis=1)
    rows = np.arange(blocks.shape[1])
    for k in np.flatnonzero((part > 0) & (part <= MOST_MISSING)):
        blocks[k, gone[k]] = np.interp(rows[gone[k]], rows[~gone[k]], blocks[k, ~gone[k]])
    blocks[part > MOST_MISSING] = 0.0
    return part <= MOST_MISSING


# ---- lines -----------------------------------------------------------------------------------------


def lines_of(frequency_hz: FloatArray, psd: FloatArray, averages: FloatArray, *, fs: float) -> tuple[SpectralLine, ...]:
    """Return the narrow peaks of a spectrum, the strongest first; electric supplies and their harmonics have names.

    The half-width of a resonance is zeta f. Where that of a resonance of 1 % damping is below the distance of the
    spectrum's lines, a peak may be a line or a resonance: it is not resolved. `averages` is the number of periodograms
    under a Hann window of equal power that scatter like each line.
    """
    if psd.size < 40 or averages.max() <= 0 or not np.isfinite(psd).all() or psd.max() <= 0:
        return ()
    from scipy.ndimage import median_filter

    edges = growing_edges(psd.size, fraction=HEALTH.line_group)
    sizes = np.diff(np.append(edges, psd.size))
    power = np.add.reduceat(psd, edges) / sizes
    usual = median_filter(power, size=HEALTH.usual_groups, mode="reflect")
    near = median_filter(power, size=HEALTH.near_groups, mode="reflect")
    df = float(frequency_hz[1])
    resolved_hz = df / HEALTH.least_damping
    ends = np.append(edges, psd.size)
    found = []
    averages_of_groups = np.maximum(averages[edges], 1.0) * np.maximum(1.0, sizes / SHARED_BY_LINES)
    for k in _find_narrow_peaks(power, usual, near, averages_of_groups):
        inside = slice(ends[k - 2], ends[k + 3])
        around = np.maximum(psd[inside] - usual[k], 0.0)
        # the main lobe of the window is symmetric about a pure tone, so its centre is the frequency
        found.append((float(frequency_hz[inside] @ around / around.sum()), float(np.sqrt(around.sum() * df))))
    found.sort(key=lambda each: -each[1])
    # in the minutes of a log the mains wander by more than the distance of the lines of long blocks
    names = name_lines([at for at, _ in found], fs=fs, resolution_hz=max(df, HEALTH.mains_wander_hz))
    every = [
        SpectralLine(at, rms, *name, resolved=at >= resolved_hz) for (at, rms), name in zip(found, names, strict=True)
    ]
    named = [line for line in every if line.name]
    return tuple(sorted({*every[: HEALTH.most_lines], *named[: HEALTH.most_lines]}, key=lambda line: -line.rms))


def growing_edges(n_lines: int, *, fraction: float) -> np.ndarray:
    """Return the first line of each group of lines; a group has this fraction of its frequency, or one line.

    >>> growing_edges(12, fraction=0.4).tolist()
    [0, 1, 2, 3, 4, 5, 7, 9]
    """
    edges = []
    line = 0
    while line < n_lines:
        edges.append(line)
        line += max(1, int(fraction * line))
    return np.array(edges)


def _find_narrow_peaks(power: FloatArray, usual: FloatArray, near: FloatArray, averages: FloatArray) -> np.ndarray:
    """Return the indices of the groups that stand out of a spectrum and are as narrow as a line under the window."""
    from scipy import special
    from scipy.ndimage import maximum_filter

    inner = slice(5, power.size - 5)
    own, base, n = power[inner], usual[inner], averages[inner]
    chance = special.gammainccinv(n, HEALTH.line_chance / n.size) / special.gammaincinv(n, 0.5)
    peak = (own == maximum_filter(power, size=5)[inner]) & (
        own > np.maximum(HEALTH.line_ratio, chance) * np.maximum(base, near[inner])
    )
    beside = np.convolve(power, np.full(3, 1 / 3), mode="valid")
    scatter = 1 + 3 * np.sqrt(SHARED_BY_LINES / (3 * n))
    narrow = np.maximum(beside[: own.size], beside[8 : 8 + own.size]) < own / HEALTH.line_width + scatter * base
    return np.flatnonzero(peak & narrow) + 5


def name_lines(lines_hz: Sequence[float], *, fs: float, resolution_hz: float) -> list[tuple[str, int | None]]:
    """Return the name of each line and which harmonic it is: of the mains at 50 or 60 Hz, or an aircraft's 400 Hz.

    A harmonic (or its alias `|k f - n fs|`) has a name only where its fundamental is among the lines.

    >>> name_lines([50.0, 150.02, 33.0], fs=512.0, resolution_hz=0.5)
    [('mains, 50 Hz', 1), ('harmonic 3 of the mains (50 Hz)', 3), ('', None)]
    >>> name_lines([60.0, 20.0], fs=200.0, resolution_hz=0.5)
    [('mains, 60 Hz', 1), ('harmonic 3 of the mains (60 Hz), aliased', 3)]
    """
    names: list[tuple[str, int | None]] = [("", None)] * len(lines_hz)
    supplies = [(hz, f"mains, {hz:g} Hz", f"the mains ({hz:g} Hz)", HEALTH.mains_tolerance) for hz in MAINS_HZ]
    supplies.append((AIRCRAFT_HZ, "aircraft supply, 400 Hz", "the aircraft supply (400 Hz)", HEALTH.aircraft_tolerance))
    for supply_hz, name, of, tolerance in supplies:
        if supply_hz >= fs / 2:
            continue
        slack = tolerance * supply_hz + 0.2 * resolution_hz
        near = [i for i, hz in enumerate(lines_hz) if abs(hz - supply_hz) <= slack and names[i][1] is None]
        if not near:
            continue
        base = min(near, key=lambda i: abs(lines_hz[i] - supply_hz))
        names[base] = name, 1
        own_hz = lines_hz[base]
        for k in range(2, HEALTH.most_harmonic + 1):
            folded = abs(k * own_hz - fs * round(k * own_hz / fs))
            alias = ", aliased" if k * own_hz > fs / 2 else ""
            slack = (0.1 * k + 0.2) * resolution_hz
            for i, hz in enumerate(lines_hz):
                if names[i][1] is None and abs(hz - folded) <= slack:
                    names[i] = f"harmonic {k} of {of}{alias}", k
    return names
