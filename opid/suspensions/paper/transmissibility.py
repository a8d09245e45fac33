"""Transmissibility with the nonlinear force taken out, and its peaks.

A nonlinear force f acts on the sprung mass beside the linear ones, so X2 = T X1 - G F with T the transmissibility of
the linear suspension. Iwaniec & Uhl (2007, eqs. 4-6) subtract f from the acceleration and divide; that ratio,
(X2'' + F/M2)/X1'', is not T (the force also moved the mass through G). Taking F as a second input, and T as what X1
explains beside it, is right (conditioned reverse path: Bendat 1990; Richards & Singh 1998). Both are offered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.signals.spectra import Transmissibility, cross_spectra, transmissibility
from opid.suspensions.paper.settings import PaperSettings

Method = Literal["conditioned", "subtracted"]


@dataclass(frozen=True)
class Peak:
    """A local maximum of |T|.

    Args:
        frequency_hz: Hz.
        magnitude: |T| there.
        resolution_hz: spacing of the lines, Hz.
    """

    frequency_hz: float
    magnitude: float
    resolution_hz: float = 0.0


def transmissibility_without_force(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    force_per_mass: ArrayLike,
    *,
    fs: float,
    method: Method = "conditioned",
    nperseg: int | None = None,
) -> Transmissibility:
    """Estimate the transmissibility of the linear suspension beneath a known nonlinear force (H1).

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        force_per_mass: (n,) f/M2, m/s^2.
        fs: sampling rate, Hz.
        method: "conditioned" (a second input, right) or "subtracted" (the paper's).
        nperseg: samples of a block, as in `opid.signals.cross_spectra`.

    Raises:
        InputError: arrays of different lengths or an unknown method.

    >>> rng = np.random.default_rng(0)
    >>> x, f = rng.standard_normal((2, 8192))
    >>> T = transmissibility_without_force(x, 0.5 * x - 2 * f, f, fs=256.0, nperseg=512)
    >>> bool(np.allclose(T.value, 0.5))
    True
    """
    signals = [np.asarray(array, dtype=np.float64) for array in (unsprung, sprung, force_per_mass)]
    if len({array.shape for array in signals}) != 1:
        raise InputError(f"the arrays have shapes {[array.shape for array in signals]}: give runs of one length")
    x1, x2, force = signals
    if method not in ("conditioned", "subtracted"):
        raise InputError(f"method is {method!r}: give 'conditioned' or 'subtracted'")
    if method == "subtracted" or not np.any(force):
        return transmissibility(x1, x2 + force, fs=fs, estimator="H1", nperseg=nperseg)
    spectra = cross_spectra(np.stack([x1, force, x2], 1), fs=fs, nperseg=nperseg)
    density = spectra.density
    s11, sff, s1f = density[:, 0, 0].real, density[:, 1, 1].real, density[:, 0, 1]
    s12, sf2, s22 = density[:, 0, 2], density[:, 1, 2], density[:, 2, 2].real
    with np.errstate(divide="ignore", invalid="ignore"):
        value = (s12 * sff - s1f * sf2) / (s11 * sff - np.abs(s1f) ** 2)
        through_force = (sf2 * s11 - s1f.conj() * s12) / (s11 * sff - np.abs(s1f) ** 2)
        explained = (value * s12.conj() + through_force * sf2.conj()).real
        coherence = np.clip(np.nan_to_num(explained / s22), 0, 1)
    return Transmissibility(spectra.frequency_hz, np.nan_to_num(value), coherence, "H1", spectra)


def transmissibility_peaks(
    T: Transmissibility,
    *,
    band_hz: tuple[float, float] = (PaperSettings.band_hz[0], PaperSettings.highest_peak_hz),
    prominence_std: float = PaperSettings.peak_prominence_std,
    prominence_ratio: float = PaperSettings.peak_prominence_ratio,
) -> tuple[Peak, ...]:
    """Find the peaks of |T| that stand out of its own random error.

    Args:
        T: the transmissibility.
        band_hz: where to look, Hz.
        prominence_std: prominence of log |T| over its standard deviation, below which a maximum is taken for chance.
        prominence_ratio: |T| at the peak over |T| at its foot, below which it is a ripple.

    Returns:
        Peaks by frequency, each refined by a parabola through three lines of log |T|.

    >>> rng = np.random.default_rng(0)
    >>> from scipy import signal
    >>> x = rng.standard_normal(2**15)
    >>> y = signal.lfilter(*signal.iirpeak(5, 3, fs=256), x)
    >>> T = transmissibility(x, y, fs=256.0, nperseg=2048)
    >>> [round(peak.frequency_hz, 1) for peak in transmissibility_peaks(T)]
    [5.0]
    """
    from scipy import signal

    inside = np.flatnonzero((T.frequency_hz >= band_hz[0]) & (T.frequency_hz <= band_hz[1]) & (np.abs(T.value) > 0))
    if inside.size < 3:
        return ()
    height = np.log(np.abs(T.value[inside]))
    least = np.maximum(prominence_std * T.relative_std[inside], np.log(prominence_ratio))
    indices, _ = signal.find_peaks(height, prominence=least)
    spacing = float(T.frequency_hz[1] - T.frequency_hz[0])
    peaks = []
    for index in indices:
        left, middle, right = height[index - 1 : index + 2]
        shift = 0.5 * (left - right) / (left - 2 * middle + right)
        peaks.append(
            Peak(
                frequency_hz=float(T.frequency_hz[inside[index]] + shift * spacing),
                magnitude=float(np.exp(middle - 0.25 * (left - right) * shift)),
                resolution_hz=spacing,
            )
        )
    return tuple(peaks)


def suspension_transmissibility(
    frequency_hz: ArrayLike,
    *,
    stiffness_per_mass: float,
    damping_per_mass: float,
    ground_stiffness_per_mass: float = 0.0,
) -> np.ndarray:
    """Return T = (k2 + j w c2)/(k2 + k3 - w^2 + j w c2): one resonance, and nothing of the tyre in it.

    Args:
        frequency_hz: (n,) Hz.
        stiffness_per_mass: K2/M2, 1/s^2.
        damping_per_mass: C2/M2, 1/s.
        ground_stiffness_per_mass: K3/M2, 1/s^2.

    >>> T = suspension_transmissibility([0.0], stiffness_per_mass=7, damping_per_mass=1, ground_stiffness_per_mass=3)
    >>> abs(T).round(3).tolist()
    [0.7]
    """
    omega: FloatArray = 2 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    spring = stiffness_per_mass + 1j * omega * damping_per_mass
    return spring / (spring + ground_stiffness_per_mass - omega**2)
