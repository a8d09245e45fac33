"""Spectra of a log that is read but once: Welch averages, spectrogram, lines and what they are called, noise floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.chunks import Chunk
from opid.signals.health_result import SpectralLine
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, white_noise_rms
from opid.signals.thinning import Thinning

HIGH_FREQUENCY_HZ = 5.0
"""Above the bounce of a vehicle (1 to 3 Hz), where the suspension isolates the sprung side."""

OVERLAPPED_BINS = 512
"""Bins (9 min) in which blocks overlap by a half, for smoother averages; later there are enough without."""

MENDED_PART = 0.05
"""Part of a block that may be missing: it is put on straight lines; more, and the block is left out."""

SPECTROGRAM_TIMES, SPECTROGRAM_LINES = 300, 512

LINE_RATIO = 8.0
"""How far a line stands above the median of its neighbours at least."""

LINE_CHANCE = 1e-6
"""Probability of such a line in noise: it takes 20 times the median in a single periodogram, less in a mean of many."""

LINE_WIDTH = 30.0
"""How far the spectrum has fallen three lines off: the window's own width, which a damped resonance exceeds."""

MOST_LINES = 10
MAINS_HZ = (50.0, 60.0)
AIRCRAFT_HZ = 400.0
MAINS_TOLERANCE, AIRCRAFT_TOLERANCE = 0.004, 0.02
MOST_HARMONIC = 13


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
        self._weight = np.zeros((2, n_channels))  # sum of the blocks' weights, and of their squares
        self._cross: ComplexArray | None = None
        self.cross_weight = np.zeros(2)
        self._nperseg = 2 * bin_rows
        self._group = -(-(bin_rows + 1) // SPECTROGRAM_LINES)
        most = min(SPECTROGRAM_TIMES, max(8, 2_000_000 * self._group // (n_channels * (bin_rows + 1))))
        self._gram = Thinning({"power": np.add, "weight": np.add}, most) if spectrogram else None

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk.

        Args:
            chunk: the next one.
        """
        used = chunk.lead + chunk.n
        if chunk.first == 0 and used < self._nperseg:
            self._nperseg = used
        if self._power is None:
            n_lines, n_crossed = self._nperseg // 2 + 1, len(self.crossed)
            self._power = np.zeros((self._n, n_lines))
            self._cross = np.zeros((n_crossed, n_crossed, n_lines), dtype=np.complex128)
        before = (chunk.first - chunk.lead) // self._bin
        starts = np.arange(0, max(used - self._nperseg, 0 if used >= self._nperseg else -1) + 1, self._bin)
        weights = np.where(before + starts // self._bin < OVERLAPPED_BINS, 1.0, 2.0)
        wanted = (weights == 1.0) | ((before + starts // self._bin) % 2 == 0)
        starts, weights = starts[wanted], weights[wanted]
        first = chunk.first - chunk.lead + starts
        inside = np.searchsorted(chunk.breaks, first + self._nperseg) > np.searchsorted(chunk.breaks, first, "right")
        starts, weights = starts[~inside], weights[~inside]
        if starts.size:
            self._take(chunk, starts, weights)
        elif self._gram is not None:
            self._add_to_gram(chunk, starts, weights, np.empty((self._n, 0, self._n_bands)))

    def _take(self, chunk: Chunk, starts: np.ndarray, weights: FloatArray) -> None:
        assert self._power is not None
        window = _hann(self._nperseg)
        spectra: dict[int, ComplexArray] = {}
        usable = np.ones((self._n, starts.size), dtype=bool)
        grouped = np.zeros((self._n, starts.size, self._n_bands))
        for i, row in enumerate(chunk.values):
            blocks = np.lib.stride_tricks.sliding_window_view(row, self._nperseg)[starts]
            if chunk.missing[i]:
                usable[i] = _mended(blocks)
            blocks -= blocks.mean(axis=1, keepdims=True)
            blocks *= window
            spectrum = np.fft.rfft(blocks, axis=1)
            own = weights * usable[i]
            power = spectrum.real**2
            power += spectrum.imag**2
            self._power[i] += own @ power
            self._weight[0, i] += own.sum()
            self._weight[1, i] += own @ own
            if i in self.crossed:
                spectra[i] = spectrum
            if self._gram is not None:
                edges = np.arange(0, power.shape[1], self._group)
                grouped[i] = np.add.reduceat(power, edges, axis=1) * own[:, np.newaxis]
        if self.crossed:
            self._take_cross(spectra, weights * usable[list(self.crossed)].all(axis=0))
        if self._gram is not None:
            self._add_to_gram(chunk, starts, weights * usable, grouped)

    def _take_cross(self, spectra: dict[int, ComplexArray], weights: FloatArray) -> None:
        assert self._cross is not None
        self.cross_weight += np.array([weights.sum(), weights @ weights])
        for i, one in enumerate(self.crossed):
            conjugate = spectra[one].conj()
            conjugate *= weights[:, np.newaxis]
            for j in range(i, len(self.crossed)):
                self._cross[i, j] += np.einsum("kl,kl->l", conjugate, spectra[self.crossed[j]])

    def _add_to_gram(self, chunk: Chunk, starts: np.ndarray, weights: FloatArray, grouped: FloatArray) -> None:
        """One item a bin: the block that begins in it, if any."""
        assert self._gram is not None
        bins = max(1, -(-chunk.n // self._bin))
        power, weight = np.zeros((bins, self._n, grouped.shape[2])), np.zeros((bins, self._n))
        if starts.size:
            # a block that begins in the bin before is the first one's: its middle lies where this one begins
            at = np.minimum(starts // self._bin, bins - 1)
            np.add.at(power, at, np.moveaxis(grouped, 0, 1))
            np.add.at(weight, at, np.broadcast_to(weights, (self._n, starts.size)).T)
        self._gram.add({"power": power, "weight": weight})

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
        edges = np.arange(0, self._nperseg // 2 + 1, self._group)
        sizes = np.diff(np.append(edges, self._nperseg // 2 + 1))
        middles = (edges + 0.5 * (sizes - 1)) * fs / self._nperseg
        weight = items["weight"][:, :, np.newaxis]
        scale = 2 / (fs * np.sum(_hann(self._nperseg) ** 2))
        density = items["power"] / np.where(weight > 0, weight, np.nan) / sizes * scale
        return 2**self._gram.level, middles, np.moveaxis(density, 1, 0)

    @property
    def _n_bands(self) -> int:
        return -(-(self._nperseg // 2 + 1) // self._group)

    def _frequencies(self, fs: float) -> FloatArray:
        return np.arange(self._nperseg // 2 + 1, dtype=np.float64) * float(fs / self._nperseg)

    def _scale(self, fs: float) -> FloatArray:
        scale = np.full(self._nperseg // 2 + 1, 2 / (fs * np.sum(_hann(self._nperseg) ** 2)))
        scale[0] /= 2
        if self._nperseg % 2 == 0:
            scale[-1] /= 2
        return scale


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
        averages: periodograms it is the mean of.
        fs: rate, Hz.
    """
    if averages <= 0 or frequency_hz.size < 8 or not np.isfinite(psd).all():
        return 0.0
    return white_noise_rms(frequency_hz, psd, averages, fs=fs)


def lines_of(frequency_hz: FloatArray, psd: FloatArray, averages: float, *, fs: float) -> tuple[SpectralLine, ...]:
    """Return the lines that stand out of a spectrum, the strongest first, supplies and their harmonics by name.

    Args:
        frequency_hz: (n_lines,) evenly spaced from 0, Hz.
        psd: (n_lines,) under a Hann window, unit^2/Hz.
        averages: periodograms it is the mean of.
        fs: rate, Hz.
    """
    if psd.size < 40 or averages <= 0 or not np.isfinite(psd).all() or psd.max() <= 0:
        return ()
    from scipy import special
    from scipy.ndimage import median_filter

    usual = median_filter(psd, size=33, mode="reflect")
    chance = float(special.gammainccinv(averages, LINE_CHANCE) / special.gammaincinv(averages, 0.5))
    inner = psd[3:-3]
    peak = (inner >= psd[2:-4]) & (inner > psd[4:-2]) & (inner > max(LINE_RATIO, chance) * usual[3:-3])
    narrow = np.maximum(psd[:-6], psd[6:]) < inner / LINE_WIDTH + 2 * usual[3:-3]
    places = np.flatnonzero(peak & narrow) + 3
    places = places[places >= 4]
    df = frequency_hz[1]
    found = []
    for k in places:
        around = np.maximum(psd[k - 2 : k + 3] - usual[k], 0.0)
        # centre of the main lobe of the window, which is symmetric about a pure tone
        at = float(frequency_hz[k] + df * (around @ np.arange(-2, 3)) / around.sum())
        found.append((at, float(np.sqrt(around.sum() * df))))
    found.sort(key=lambda each: -each[1])
    names = names_of_lines([at for at, _ in found], fs=fs, resolution_hz=df)
    every = [SpectralLine(at, rms, name) for (at, rms), name in zip(found, names, strict=True)]
    named = [line for line in every if line.name]
    return tuple(sorted({*every[:MOST_LINES], *named[:MOST_LINES]}, key=lambda line: -line.rms))


def names_of_lines(lines_hz: Sequence[float], *, fs: float, resolution_hz: float) -> list[str]:
    """Return what lines are called: mains at 50 or 60 Hz, the supply of an aircraft at 400 Hz, harmonics, aliases.

    A harmonic (or what the rate folds it to, `|k f - n fs|`) is called so only where its fundamental is there too.

    Args:
        lines_hz: their frequencies, Hz.
        fs: rate, Hz.
        resolution_hz: spacing of the spectrum's lines.

    >>> names_of_lines([50.0, 150.02, 33.0], fs=512.0, resolution_hz=0.5)
    ['mains, 50 Hz', 'harmonic 3 of the mains (50 Hz)', '']
    >>> names_of_lines([60.0, 20.0], fs=200.0, resolution_hz=0.5)
    ['mains, 60 Hz', 'harmonic 3 of the mains (60 Hz), aliased']
    """
    names = [""] * len(lines_hz)
    supplies = [(hz, f"mains, {hz:g} Hz", f"the mains ({hz:g} Hz)", MAINS_TOLERANCE) for hz in MAINS_HZ]
    supplies.append((AIRCRAFT_HZ, "aircraft supply, 400 Hz", "the aircraft supply (400 Hz)", AIRCRAFT_TOLERANCE))
    for supply_hz, name, of, tolerance in supplies:
        if supply_hz >= fs / 2:
            continue
        slack = tolerance * supply_hz + 0.2 * resolution_hz
        near = [i for i, hz in enumerate(lines_hz) if abs(hz - supply_hz) <= slack and not names[i]]
        if not near:
            continue
        base = min(near, key=lambda i: abs(lines_hz[i] - supply_hz))
        names[base] = name
        own_hz = lines_hz[base]
        for k in range(2, MOST_HARMONIC + 1):
            folded = abs(k * own_hz - fs * round(k * own_hz / fs))
            alias = ", aliased" if k * own_hz > fs / 2 else ""
            slack = (0.1 * k + 0.2) * resolution_hz
            for i, hz in enumerate(lines_hz):
                if not names[i] and abs(hz - folded) <= slack:
                    names[i] = f"harmonic {k} of {of}{alias}"
    return names


def _hann(n: int) -> FloatArray:
    """Scipy's periodic Hann window."""
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
