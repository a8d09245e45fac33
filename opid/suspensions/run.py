"""One run of a body on several suspensions, as the model takes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, signal

from opid.errors import InputError
from opid.mechanics.driven import half_steps
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.band_lines import BAND_HZ, HIGHEST_SHARE, LOWEST_RATE_HZ, at_lines, band_lines

# what steps of a coarse run would take for the band is weakened by this
STOP_DB = 60.0


@dataclass(frozen=True, eq=False)
class BodyRun:
    """One run, ready for the model.

    Args:
        drive: (2 n - 1, n_interfaces) accelerations below the suspensions at half steps, mean removed, m/s^2.
        sprung: (n, n_sensors) accelerations of the body, mean removed, m/s^2.
        omega: (n_lines,) lines of the residual that count, rad/s.
        fs: sampling rate, Hz.
        loading: (n_dof, n_dof) mass matrix of what this run carries more than the reference, kg.
        finer: how many times finer than recorded the run is sampled, so that a step of the model is short enough.
        coarser: how many times coarser than recorded, on the way to a fit.
    """

    drive: FloatArray
    sprung: FloatArray
    omega: FloatArray
    fs: float
    loading: FloatArray
    finer: int = 1
    coarser: int = 1

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.sprung.shape[0]

    @property
    def unsprung(self) -> FloatArray:
        """(n, n_interfaces) accelerations below the suspensions, m/s^2."""
        return self.drive[::2]

    @cached_property
    def coarse(self) -> BodyRun:
        """The run at about `LOWEST_RATE_HZ`, if its lines allow that: it leads near a fit in a fraction of the time.

        Fewer readings are compared, unfiltered, so that model and sensors still tell of the same instants; below the
        suspensions the samples between them serve the half steps, without what steps so long take for the band.
        """
        highest_hz = float(self.omega[-1]) / (2 * np.pi)
        by = int(self.fs / (2 * max(LOWEST_RATE_HZ, highest_hz / HIGHEST_SHARE)))
        if by < 1:
            return self
        fs, sprung = self.fs / (2 * by), self.sprung[:: 2 * by]
        stop_hz, width_hz = fs - highest_hz, 0.1 * fs
        n_taps, beta = signal.kaiserord(STOP_DB, 2 * width_hz / self.fs)
        taps = signal.firwin(n_taps | 1, stop_hz - width_hz / 2, window=("kaiser", beta), fs=self.fs)
        drive = ndimage.convolve1d(self.unsprung, taps, axis=0, mode="nearest")[::by]
        lines = band_lines(len(sprung), fs=fs, band_hz=(float(self.omega[0]) / (2 * np.pi), highest_hz))
        n = lines.n_samples
        drive, sprung = (np.ascontiguousarray(each) for each in (drive[: 2 * n - 1], sprung[:n]))
        return BodyRun(drive, sprung, lines.omega, fs, self.loading, self.finer, 2 * by)

    def transform(self, samples: FloatArray) -> ComplexArray:
        """Fourier lines of the band along the last axis, scaled so that unit white noise has unit parts.

        Args:
            samples: (..., n).
        """
        return at_lines(samples, self.omega, self.fs)


def body_run(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    loading: FloatArray,
    band_hz: tuple[float, float] = BAND_HZ,
) -> BodyRun:
    """Prepare one run for the model.

    Args:
        unsprung: (n, n_interfaces) accelerations below the suspensions, m/s^2.
        sprung: (n, n_sensors) accelerations of the body, m/s^2.
        fs: sampling rate, Hz.
        loading: (n_dof, n_dof) mass matrix of what this run carries more than the reference, kg.
        band_hz: lowest and highest line to compare, Hz; cut at 0.4 fs.

    Raises:
        InputError: arrays of different lengths, or a band that is none or has fewer than 20 lines.
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if lower.ndim != 2 or upper.ndim != 2 or len(lower) != len(upper):
        raise InputError(f"unsprung has shape {lower.shape} and sprung {upper.shape}: give runs of one length")
    lines = band_lines(len(lower), fs=fs, band_hz=band_hz)
    return BodyRun(
        half_steps(lines.prepared(lower)),
        lines.prepared(upper),
        lines.omega,
        float(fs) * lines.finer,
        np.asarray(loading, dtype=np.float64),
        lines.finer,
    )
