"""Averaged cross-spectra and the transmissibilities that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, nearest
from opid.signals.recording import FloatArray

ComplexArray = NDArray[np.complex128]
Window = str | tuple[str, float]
Estimator = Literal["H1", "H2", "Hv"]
ESTIMATORS: tuple[Estimator, ...] = ("H1", "H2", "Hv")
WINDOWS = ("hann", "hamming", "blackman", "blackmanharris", "nuttall", "flattop", "boxcar", "bartlett", "cosine")
"""Names of the windows that a study can state."""
_LEAST_BLOCK = 32  # samples: a Welch spectrum of fewer has no tenth that is the quietest
# the windows that the methods use unasked are sums of these cosines: 0, 1, ... periods in a block
_COSINES: dict[Window, tuple[float, ...]] = {
    "hann": (0.5, 0.5),
    "flattop": (0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368),
}


@dataclass(frozen=True)
class TransmissibilitySettings:
    """How a transmissibility is estimated; what is None is chosen by the method that estimates it.

    Args:
        window: window of a block, one of `WINDOWS`.
        overlap: fraction of a block that it shares with the next one.
        estimator: "H1", "H2" or "Hv", see `transmissibility`.
        block_s: length of a block, s; the lines are 1/`block_s` apart.

    Raises:
        InputError: an unknown window or estimator, an overlap outside 0 to 0.95, or a length that is not positive.

    >>> TransmissibilitySettings(window="flattop").completed_by(TransmissibilitySettings("hann", 0.5, "H1", 8.0))
    TransmissibilitySettings(window='flattop', overlap=0.5, estimator='H1', block_s=8.0)
    """

    window: str | None = None
    overlap: float | None = None
    estimator: Estimator | None = None
    block_s: float | None = None

    def __post_init__(self) -> None:
        if self.window is not None and self.window not in WINDOWS:
            raise InputError(f"there is no window {self.window!r}: {nearest(str(self.window), WINDOWS)}")
        if self.estimator is not None and self.estimator not in ESTIMATORS:
            raise InputError(f"there is no estimator {self.estimator!r}: {nearest(str(self.estimator), ESTIMATORS)}")
        if self.overlap is not None and not _is_number(self.overlap, 0.0, 0.95):
            is_percent = _is_number(self.overlap, 1.0, 95.0)
            percent = f" ({self.overlap:g} % are {self.overlap / 100:g})" if is_percent else ""
            raise InputError(f"the overlap is {self.overlap!r}: give a fraction of a block, 0 to 0.95{percent}")
        if self.block_s is not None and not (_is_number(self.block_s, 0.0, 1e6) and self.block_s > 0):
            raise InputError(f"block_s is {self.block_s!r}: give the length of a block in s, 32 for lines of 1/32 Hz")

    def completed_by(self, usual: TransmissibilitySettings) -> TransmissibilitySettings:
        """Return these settings with those of a method in the place of what is None.

        Args:
            usual: the settings of the method.
        """
        return replace(usual, **{name: value for name, value in vars(self).items() if value is not None})


BY_METHOD = TransmissibilitySettings()
"""Nothing is stated: the method chooses."""


def _is_number(value: object, least: float, most: float) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most


@dataclass(frozen=True, eq=False)
class CrossSpectra:
    """Averaged one-sided cross-spectral densities of several signals.

    Args:
        frequency_hz: (n_lines,) Hz.
        density: (n_lines, n_signals, n_signals) Hermitian, E[conj(X_i) X_j], unit^2/Hz.
        n_blocks: number of averaged blocks.
        n_averages: number of independent averages with the same scatter (overlapping blocks are not independent).
        window: scipy's name of the window.
        nperseg: number of samples of a block.
        noverlap: number of samples that neighbouring blocks have in common.
        fs: sampling rate, Hz.
    """

    frequency_hz: FloatArray
    density: ComplexArray
    n_blocks: int
    n_averages: float
    window: Window
    nperseg: int
    noverlap: int
    fs: float


@dataclass(frozen=True, eq=False)
class Transmissibility:
    """Ratio of two response spectra, T = X_out / X_in, with its coherence.

    Args:
        frequency_hz: (n_lines,) Hz.
        value: (n_lines,) complex ratio.
        coherence: (n_lines,) in 0..1; always 1 for a single average.
        estimator: "H1", "H2" or "Hv".
        spectra: the cross-spectra it was computed from.
    """

    frequency_hz: FloatArray
    value: ComplexArray
    coherence: FloatArray
    estimator: Estimator
    spectra: CrossSpectra

    @property
    def relative_std(self) -> FloatArray:
        """Standard deviation of |T| over |T|, sqrt((1 - coherence)/(2 coherence n)) (Bendat & Piersol, 9.3)."""
        coherence = np.maximum(self.coherence, 1e-12)
        return np.sqrt((1 - self.coherence) / (2 * coherence * self.spectra.n_averages))


def cross_spectra(
    signals: ArrayLike,
    *,
    fs: float,
    window: Window = "hann",
    nperseg: int | None = None,
    noverlap: int | None = None,
) -> CrossSpectra:
    """Average the cross-spectra of overlapping windowed blocks (Welch 1967).

    Args:
        signals: (n_samples, n_signals) array.
        fs: sampling rate, Hz.
        window: any name that scipy.signal.get_window takes, "flattop" included.
        nperseg: number of samples of a block; by default 8 s of them, or the whole run if it is shorter.
        noverlap: number of samples that neighbouring blocks have in common; by default half of a block.

    Raises:
        InputError: blocks longer than the run, or an overlap that is not below a block.

    >>> rng = np.random.default_rng(0)
    >>> spectra = cross_spectra(rng.standard_normal((4096, 2)), fs=256.0, nperseg=512)
    >>> spectra.density.shape, spectra.n_blocks
    ((257, 2, 2), 15)
    """
    from scipy import fft

    samples = np.asarray(signals, dtype=np.float64)
    if samples.ndim != 2:
        raise InputError(f"signals have shape {samples.shape}: give an array (n_samples, n_signals)")
    n_samples = samples.shape[0]
    block = min(round(8 * fs), n_samples) if nperseg is None else int(nperseg)
    overlap = block // 2 if noverlap is None else int(noverlap)
    if block < 2 <= n_samples:
        raise InputError(
            f"a block of the spectra has {block} samples at a rate of {fs:.3g} Hz: check the rate and the unit of the "
            "time (time_unit in [log]), or give longer blocks"
        )
    if not 2 <= block <= n_samples:
        raise InputError(
            f"nperseg is {block} ({block / fs:.3g} s) and the run has {n_samples} samples ({n_samples / fs:.3g} s): "
            "give blocks no longer than the run"
        )
    if not 0 <= overlap < block:
        raise InputError(f"noverlap is {overlap}: give a number from 0 to below nperseg = {block}")
    taper = sample_window(window, block)
    blocks = np.lib.stride_tricks.sliding_window_view(samples, block, axis=0)[:: block - overlap]
    lines = fft.rfft((blocks - blocks.mean(axis=-1, keepdims=True)) * taper).transpose(2, 1, 0)
    density = lines.conj() @ lines.transpose(0, 2, 1) / (blocks.shape[0] * fs * float(taper @ taper))
    # the lines of negative frequency have the same power
    density[1 : None if block % 2 else -1] *= 2
    n_averages = _count_independent_averages(taper, blocks.shape[0], block - overlap)
    return CrossSpectra(
        fft.rfftfreq(block, 1 / fs), density, blocks.shape[0], n_averages, window, block, overlap, float(fs)
    )


def transmissibility(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    estimator: Estimator = "H1",
    window: Window = "hann",
    nperseg: int | None = None,
    noverlap: int | None = None,
) -> Transmissibility:
    """Estimate T = X2/X1 between two accelerations (the same ratio as between displacements).

    Noise on the sprung channel does not bias H1 = S12/S11, noise on the unsprung one does not bias H2 = S22/S21; Hv
    assumes equal noise on both (the eigenvector of the larger eigenvalue of the 2 x 2 density).

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        estimator: "H1", "H2" or "Hv".
        window: any name that scipy.signal.get_window takes.
        nperseg: number of samples of a block, see `cross_spectra`.
        noverlap: number of samples that neighbouring blocks have in common, see `cross_spectra`.

    Raises:
        InputError: an unknown estimator, arrays of different lengths, or an error of `cross_spectra`.

    >>> rng = np.random.default_rng(0)
    >>> x = rng.standard_normal(8192)
    >>> T = transmissibility(x, 0.5 * x, fs=256.0, nperseg=1024)
    >>> bool(np.allclose(T.value, 0.5))
    True
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if lower.shape != upper.shape:
        raise InputError(f"unsprung has shape {lower.shape} and sprung {upper.shape}: give runs of one length")
    if estimator not in ESTIMATORS:
        raise InputError(f"there is no estimator {estimator!r}: {nearest(estimator, ESTIMATORS)}")
    spectra = cross_spectra(np.stack([lower, upper], axis=1), fs=fs, window=window, nperseg=nperseg, noverlap=noverlap)
    density = spectra.density
    s11, s22, s12 = density[:, 0, 0].real, density[:, 1, 1].real, density[:, 0, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.abs(s12) ** 2 / (s11 * s22)
        if estimator == "H1":
            value = s12 / s11
        elif estimator == "H2":
            value = s22 / s12.conj()
        else:
            value = s12 / np.abs(s12) * (s22 - s11 + np.hypot(s22 - s11, 2 * np.abs(s12))) / (2 * np.abs(s12))
    return Transmissibility(
        spectra.frequency_hz,
        np.nan_to_num(value),
        np.clip(np.nan_to_num(coherence), 0, 1),
        estimator,
        spectra,
    )


def sample_window(name: Window, n_samples: int) -> FloatArray:
    """Return a window of blocks, one period of it as spectra need it.

    `scipy.signal` takes longer to load than most spectra to compute: the usual windows need none of it.

    Args:
        name: any name that scipy.signal.get_window takes.
        n_samples: number of samples.
    """
    if name in _COSINES:
        angle = np.linspace(-np.pi, np.pi, n_samples + 1)[:-1]
        return np.asarray(sum(each * np.cos(k * angle) for k, each in enumerate(_COSINES[name])))
    from scipy import signal

    return np.asarray(signal.get_window(name, n_samples))


def noise_floor(samples: ArrayLike, *, fs: float) -> float:
    """Estimate the rms of the white noise of a channel from the quietest tenth of its spectrum.

    The lowest decile of a Welch spectrum is an upper bound for the broadband noise: at some frequencies a structure
    hardly moves, and the noise dominates.

    Args:
        samples: (n,) one channel.
        fs: sampling rate, Hz.

    Returns:
        The standard deviation that white noise of that density would have, in the unit of `samples`.

    >>> rng = np.random.default_rng(0)
    >>> bool(abs(noise_floor(0.01 * rng.standard_normal(20000), fs=500.0) / 0.01 - 1) < 0.1)
    True
    """
    channel = np.asarray(samples, dtype=np.float64)[:, np.newaxis]
    spectra = cross_spectra(channel, fs=fs, nperseg=min(channel.size, max(round(2 * fs), _LEAST_BLOCK)))
    return white_noise_rms(spectra.frequency_hz, spectra.density[:, 0, 0].real, spectra.n_blocks, fs=fs)


def incoherent_noise(channels: ArrayLike, others: ArrayLike, *, fs: float, band_hz: tuple[float, float]) -> FloatArray:
    """Return an upper bound of the noise of channels in a band: the part that is not coherent with other channels.

    Noise is not coherent with other channels. The response of a nonlinear structure to their motion is not coherent
    either, so that the bound may lie far above the noise. The bound is that of the median line, because noise need not
    be white: the noise of a differentiated path nearly vanishes at the lower end of a band.

    Args:
        channels: (n, n_channels) samples of the channels whose noise is bounded.
        others: (n, n_others) samples of other channels measured at the same time.
        fs: sampling rate, Hz.
        band_hz: band of the lines that are used, Hz.

    Returns:
        (n_channels,) the standard deviation that white noise of that density would have, in the unit of `channels`;
        infinite where the run is too short.

    >>> rng = np.random.default_rng(0)
    >>> x = rng.standard_normal((20000, 1))
    >>> y = 0.5 * x + 0.01 * rng.standard_normal((20000, 1))
    >>> bool(abs(incoherent_noise(y, x, fs=500.0, band_hz=(1.0, 40.0))[0] / 0.01 - 1) < 0.1)
    True
    """
    own, other = np.asarray(channels, dtype=np.float64), np.asarray(others, dtype=np.float64)
    # with blocks of 4 s, a lightly damped resonance leaks little
    found = _separate_incoherent(own, other, fs=fs, band_hz=band_hz, nperseg=min(len(own), round(4 * fs)))
    if found is None:
        return np.full(own.shape[1], np.inf)
    lines_hz, _, left, n_free = found
    return np.array([white_noise_rms(lines_hz, each, n_free, fs=fs, quantile=0.5) for each in left.T])


def coherent_fraction(
    channels: ArrayLike, others: ArrayLike, *, fs: float, band_hz: tuple[float, float], nperseg: int
) -> float:
    """Return the fraction of the power of channels, in a band, that is coherent with other channels.

    It is the squared multiple coherence, weighted by the power and without its bias: about 0 for independent channels
    (Bendat & Piersol 2010, Random data, sec. 9.2); NaN where the run is too short.

    Args:
        channels: (n, n_channels) samples of the channels.
        others: (n, n_others) samples of other channels measured at the same time.
        fs: sampling rate, Hz.
        band_hz: band of the lines that are used, Hz.
        nperseg: number of samples of a block.

    >>> rng = np.random.default_rng(0)
    >>> x, y = rng.standard_normal((2, 20000, 2))
    >>> for of_others in (0.0, 1.0):
    ...     fraction = coherent_fraction(y + of_others * x, x, fs=500.0, band_hz=(1.0, 40.0), nperseg=500)
    ...     print(f"{abs(fraction):.1f}")
    0.0
    0.5
    """
    own, other = np.asarray(channels, dtype=np.float64), np.asarray(others, dtype=np.float64)
    found = _separate_incoherent(own, other, fs=fs, band_hz=band_hz, nperseg=nperseg)
    if found is None:
        return float("nan")
    _, total, left, _ = found
    return 1.0 - float(left.sum() / total.sum())


def _separate_incoherent(
    own: FloatArray, other: FloatArray, *, fs: float, band_hz: tuple[float, float], nperseg: int
) -> tuple[FloatArray, FloatArray, FloatArray, float] | None:
    """Return the frequencies of the lines, Hz, the spectra, their incoherent parts, and the number of free averages.

    The spectra have the shape (n_lines, n_channels). The result is None where the run is too short.
    """
    n_own, n_other = own.shape[1], other.shape[1]
    spectra = cross_spectra(np.concatenate([own, other], axis=1), fs=fs, nperseg=nperseg)
    n_free = spectra.n_averages - n_other
    inside = (spectra.frequency_hz >= band_hz[0]) & (spectra.frequency_hz <= band_hz[1])
    if n_free < 2 or not inside.any():
        return None
    density = spectra.density[inside]
    cross = density[:, n_own:, :n_own]
    explained = np.einsum("koi,koi->ki", cross.conj(), np.linalg.pinv(density[:, n_own:, n_own:]) @ cross).real
    total = np.einsum("kii->ki", density[:, :n_own, :n_own]).real
    left = np.maximum(total - explained, 0.0) * spectra.n_averages / n_free
    return spectra.frequency_hz[inside], total, left, n_free


def white_noise_rms(
    frequency_hz: FloatArray, density: FloatArray, n_blocks: float, *, fs: float, quantile: float = 0.1
) -> float:
    """Return the standard deviation of the white noise whose spectrum has the same quantile as a Welch spectrum."""
    from scipy import special

    # the anti-aliasing filter often leaves nothing just below the Nyquist frequency
    inside = (frequency_hz > 0) & (frequency_hz < 0.4 * fs)
    # n averaged periodograms of white noise follow a gamma distribution: this is its quantile over its mean
    over_mean = special.gammaincinv(n_blocks, quantile) / n_blocks
    return float(np.sqrt(np.quantile(density[inside], quantile) / over_mean * fs / 2))


def _count_independent_averages(window: FloatArray, n_blocks: int, step: int) -> float:
    """Return the equivalent number of independent blocks, n / (1 + 2 sum_k (1 - k/n) rho_k) (Welch 1967, eq. 11)."""
    power = float(window @ window)
    variance = 1.0
    for k in range(1, n_blocks):
        shift = k * step
        if shift >= window.size:
            break
        rho = float(window[shift:] @ window[:-shift] / power) ** 2
        variance += 2 * (1 - k / n_blocks) * rho
    return n_blocks / variance
