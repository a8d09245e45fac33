"""Lines of a band that prediction errors are compared on, and records cut and sampled to fit them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.settings import RunSettings


@dataclass(frozen=True, eq=False)
class BandLines:
    """Lines of a band.

    Args:
        n_samples: that are taken of the record.
        omega: (n_lines,) rad/s.
        finer: how many times finer the record is sampled, so that a step of the model is short enough.
    """

    n_samples: int
    omega: FloatArray
    finer: int

    def prepared(self, samples: FloatArray) -> FloatArray:
        """Return a record cut, without its mean, and sampled finer where needed."""
        centred = samples[: self.n_samples] - samples[: self.n_samples].mean(axis=0)
        return centred if self.finer == 1 else sampled_finer(centred, self.finer)


def band_lines(
    n_samples: int, *, fs: float, band_hz: tuple[float, float] | None = None, settings: RunSettings | None = None
) -> BandLines:
    """Return the lines of a band of a record.

    Args:
        n_samples: of the record.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line, Hz; cut at 0.4 fs; that of the settings where left out.
        settings: how runs are prepared.

    Raises:
        InputError: a band that is none or has fewer than 20 lines.

    >>> band_lines(1000, fs=100.0, band_hz=(1.0, 5.0)).omega.size
    41
    """
    settings = settings or RunSettings()
    band_hz = band_hz or settings.band_hz
    n = fft.prev_fast_len(n_samples, real=True)
    frequency_hz = fft.rfftfreq(n, 1 / fs)
    if not 0 < band_hz[0] < band_hz[1]:
        raise InputError(f"band_hz is ({band_hz[0]:g}, {band_hz[1]:g}): give 0 < low < high, Hz")
    low, high = float(band_hz[0]), min(float(band_hz[1]), settings.highest_fraction * fs)
    if low >= high:
        raise InputError(
            f"the band {band_hz[0]:g} to {band_hz[1]:g} Hz lies above {high:g} Hz, {settings.highest_fraction:g} of "
            f"the rate of {fs:g} Hz, where the filters of loggers begin: give a band below it"
        )
    keep = np.flatnonzero((frequency_hz >= low) & (frequency_hz <= high) & (frequency_hz > 0))
    if keep.size < settings.least_lines:
        raise InputError(
            f"the band {low:g} to {high:g} Hz holds {keep.size} lines of a run of {n_samples / fs:.3g} s: give a "
            "longer run or a wider band"
        )
    finer = int(np.ceil(lowest_rate_hz(float(band_hz[1]), settings) / fs))
    return BandLines(n, 2 * np.pi * frequency_hz[keep], max(1, finer))


def lowest_rate_hz(highest_hz: float, settings: RunSettings) -> float:
    """Return how many steps a second the model needs at least, Hz.

    Args:
        highest_hz: highest line that is compared.
        settings: how runs are prepared.
    """
    return min(settings.lowest_rate_hz, settings.rate_over_band * highest_hz)


def band_places(omega: FloatArray, per_octave: float, least_lines: int) -> NDArray[np.int64]:
    """Return the number of the band of each line: fractions of octaves that hold some lines at least.

    Args:
        omega: (n_lines,) rad/s, ascending.
        per_octave: bands of an octave.
        least_lines: of a band, but for the last one.

    >>> band_places(np.arange(1.0, 9.0), 1.0, 2)
    array([0, 0, 1, 1, 2, 2, 2, 3])
    """
    octave = np.floor(per_octave * np.log2(omega / omega[0]) + 1e-9)
    found, count = np.zeros(omega.size, dtype=np.int64), 1
    for k in range(1, omega.size):
        ends = octave[k] != octave[k - count] and count >= least_lines
        found[k] = found[k - 1] + ends
        count = 1 if ends else count + 1
    return found


def sampled_finer(samples: FloatArray, by: int) -> FloatArray:
    """Return a record with more samples, a band-limited one between the given ones.

    Args:
        samples: (n, ...).
        by: how many times as many.
    """
    return np.asarray(signal.resample_poly(samples, by, 1, axis=0, padtype="line"))


def places_of(omega: FloatArray, n_samples: int, fs: float) -> slice:
    """Return the places of the lines of a band among all lines of the transform."""
    first = round(float(omega[0]) / (2 * np.pi) * n_samples / fs)
    return slice(first, first + omega.size)


def at_lines(samples: FloatArray, omega: FloatArray, fs: float) -> ComplexArray:
    """Return Fourier lines along the last axis, scaled so that unit white noise has unit parts."""
    n = samples.shape[-1]
    return fft.rfft(samples)[..., places_of(omega, n, fs)] / np.sqrt(n / 2)
