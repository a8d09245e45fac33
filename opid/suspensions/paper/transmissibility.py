"""Transmissibility, its peaks, and ratios to the sprung mass from it (Iwaniec & Uhl 2007, eqs. 4-9).

A nonlinear force f acts on the sprung mass beside the linear ones, so X2 = T X1 - G F with T the transmissibility of
the linear suspension. The paper (eqs. 4-6) subtracts f from the acceleration and divides; that ratio,
(X2'' + F/M2)/X1'', is not T, because the force also moves the mass through G. The right method takes F as a second
input, and T as the response to X1 beside it (conditioned reverse path: Bendat 1990; Richards & Singh 1998). Both
methods are available.

Direct parameters follow from T by three methods: the paper's equation at one peak of |T|; complex least squares over a
band; and their errors-in-variables form on the transforms themselves (`spectral_equation`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import Law
from opid.signals.recording import FloatArray
from opid.signals.spectra import (
    Transmissibility,
    TransmissibilitySettings,
    Window,
    cross_spectra,
    sample_window,
    transmissibility,
)
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import RATIOS, EquationLines, FittedRatios, fit_equation

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


def estimate_transmissibility(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    settings: TransmissibilitySettings,
    shortened: int = 1,
) -> Transmissibility:
    """Estimate T = X2/X1 by the settings of a study or a method.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        settings: window, overlap, estimator and length of the blocks, all of them given.
        shortened: blocks are at most the run over this number.

    Raises:
        InputError: arrays of different lengths.

    >>> x = np.random.default_rng(0).standard_normal(8192)
    >>> T = estimate_transmissibility(x, 0.5 * x, fs=256.0, settings=TransmissibilitySettings("hann", 0.5, "H1", 8.0))
    >>> T.spectra.nperseg, T.spectra.noverlap
    (2048, 1024)
    """
    taken = block_of(settings, np.size(unsprung), fs, shortened)
    return transmissibility(unsprung, sprung, fs=fs, estimator=settings.estimator or "H1", **taken)


def block_of(settings: TransmissibilitySettings, n_samples: int, fs: float, shortened: int = 1) -> dict[str, Any]:
    """Return the arguments of `opid.signals.cross_spectra` that say how a run of `n_samples` is averaged."""
    assert settings.block_s is not None  # `completed_by` has filled them
    assert settings.overlap is not None
    nperseg = min(round(settings.block_s * fs), n_samples // shortened)
    return {"window": settings.window or "hann", "nperseg": nperseg, "noverlap": int(settings.overlap * nperseg)}


def transmissibility_without_force(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    force_per_mass: ArrayLike,
    *,
    fs: float,
    method: Method = "conditioned",
    window: Window = "hann",
    nperseg: int | None = None,
    noverlap: int | None = None,
) -> Transmissibility:
    """Estimate the transmissibility of the linear suspension beside a known nonlinear force (H1).

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        force_per_mass: (n,) f/M2, m/s^2.
        fs: sampling rate, Hz.
        method: "conditioned" (a second input, right) or "subtracted" (the paper's).
        window: window of a block, as in `opid.signals.cross_spectra`.
        nperseg: samples of a block, as there.
        noverlap: samples that neighbouring blocks have in common, as there.

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
        return transmissibility(x1, x2 + force, fs=fs, window=window, nperseg=nperseg, noverlap=noverlap)
    spectra = cross_spectra(np.stack([x1, force, x2], 1), fs=fs, window=window, nperseg=nperseg, noverlap=noverlap)
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
    """Find the peaks of |T| that exceed its random error.

    Args:
        T: the transmissibility.
        band_hz: band of the search, Hz.
        prominence_std: prominence of log |T| over its standard deviation, below which a maximum is taken as chance.
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
    inside = np.flatnonzero((T.frequency_hz >= band_hz[0]) & (T.frequency_hz <= band_hz[1]) & (np.abs(T.value) > 0))
    if inside.size < 3:
        return ()
    height = np.log(np.abs(T.value[inside]))
    least = np.maximum(prominence_std * T.relative_std[inside], np.log(prominence_ratio))
    spacing = float(T.frequency_hz[1] - T.frequency_hz[0])
    peaks = []
    for index in _find_prominent_maxima(height, least):
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


def _find_prominent_maxima(height: FloatArray, least: FloatArray) -> list[int]:
    """Return the maxima that stand above the higher of their two feet by `least`, (n,) for each index.

    A foot is the lowest point on one side, up to where the curve is higher than the maximum.
    """
    found = []
    for k in 1 + np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])):
        higher = np.flatnonzero(height > height[k])
        at = int(np.searchsorted(higher, k))
        begin = higher[at - 1] + 1 if at else 0
        end = higher[at] if at < higher.size else height.size
        if height[k] - max(height[begin:k].min(), height[k:end].min()) >= least[k]:
            found.append(int(k))
    return found


def read_static_transmissibility(T: Transmissibility, *, up_to_hz: float = PaperSettings.static_hz) -> float:
    """Return T(0) as the paper read it from its figure: the median of |T| over the lowest lines, at least two of them.

    Args:
        T: the transmissibility.
        up_to_hz: the last of these lines, Hz.
    """
    low = (T.frequency_hz > 0) & (T.frequency_hz <= max(up_to_hz, 2.5 * T.frequency_hz[1]))
    return float(np.median(np.abs(T.value[low])))


def suspension_transmissibility(
    frequency_hz: ArrayLike,
    *,
    stiffness_per_mass: float,
    damping_per_mass: float,
    ground_stiffness_per_mass: float = 0.0,
) -> np.ndarray:
    """Return T = (k2 + j w c2)/(k2 + k3 - w^2 + j w c2), which has one resonance and does not depend on the tyre.

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


@dataclass(frozen=True, eq=False)
class DirectParameters(FittedRatios):
    """Ratios to the sprung mass of one run: K2/M2 (1/s^2), C2/M2 (1/s) and K3/M2 (1/s^2)."""

    @property
    def natural_frequency_hz(self) -> float:
        """sqrt((K2 + K3)/M2)/(2 pi), Hz; NaN when the sum is negative."""
        total = self.value[0] + self.value[2]
        return float(np.sqrt(total) / (2 * np.pi)) if total > 0 else float("nan")

    @property
    def damping_ratio(self) -> float:
        """C2/(2 sqrt((K2 + K3) M2)); NaN when the stiffness is negative."""
        return float(self.value[1] / (4 * np.pi * self.natural_frequency_hz))

    @property
    def static_transmissibility(self) -> float:
        """T(0) = K2/(K2 + K3) (eq. 8)."""
        return float(self.value[0] / (self.value[0] + self.value[2]))


def mass_over_stiffness(peak: Peak, *, static_transmissibility: float = 0.7, restore_sign: bool = False) -> float:
    """Return M2/K2 = (1/T(0) - 1/T)/w^2 from one peak (eq. 9), s^2.

    The paper uses the magnitude |T| for T. Above its only resonance T is negative, and a magnitude below T(0) gives a
    negative stiffness; `restore_sign` takes T = -|T|, still without damping.

    Args:
        peak: frequency and |T|.
        static_transmissibility: T(0) = K2/(K2 + K3); the paper read 0.7 off its figure.
        restore_sign: whether T is taken negative.

    Raises:
        InputError: a frequency, a magnitude or T(0) that is not positive.

    >>> round(mass_over_stiffness(Peak(1.812, 0.490)), 5)
    -0.00472
    """
    if min(peak.frequency_hz, peak.magnitude, static_transmissibility) <= 0:
        raise InputError(
            f"the peak is ({peak.frequency_hz} Hz, {peak.magnitude}) and T(0) {static_transmissibility}: "
            "all must be positive"
        )
    ratio = -peak.magnitude if restore_sign else peak.magnitude
    return (1 / static_transmissibility - 1 / ratio) / (2 * np.pi * peak.frequency_hz) ** 2


def complex_least_squares(
    T: Transmissibility, *, band_hz: tuple[float, float] = PaperSettings.band_hz, ground: bool = True
) -> DirectParameters:
    """Solve w^2 T = k2 (T - 1) + j w c2 (T - 1) + k3 T over a band by weighted least squares.

    Without noise it is exact at every damping, which the peak formula is not. Noise on T is on both sides of the
    equation and biases the estimate towards zero; that of `errors_in_variables` is not biased.

    Args:
        T: complex transmissibility.
        band_hz: lowest and highest line to use, Hz.
        ground: whether K3 is free (else it is 0).

    Raises:
        InputError: fewer than 5 lines in the band.
    """
    inside = (T.frequency_hz >= band_hz[0]) & (T.frequency_hz <= band_hz[1]) & (T.coherence > 0)
    # In a run of one block the force explains all of the motion, and T is not defined.
    inside &= np.isfinite(T.value) & np.isfinite(T.relative_std) & (np.abs(T.value) > 1e-9)
    if inside.sum() < 5:
        raise InputError(
            f"the band {band_hz[0]:g} to {band_hz[1]:g} Hz holds {int(inside.sum())} usable lines of T: widen it or "
            "take longer blocks"
        )
    ratio, omega = T.value[inside], 2 * np.pi * T.frequency_hz[inside]
    # An error of T enters through k2 + k3 - w^2 + j w c2, which grows like w over most of the band.
    weight = np.sqrt(T.coherence[inside]) / (omega * np.maximum(T.relative_std[inside], 1e-3) * np.abs(ratio))
    columns = np.stack([ratio - 1, 1j * omega * (ratio - 1), ratio], axis=1)[:, : 3 if ground else 2]
    left_lines, right_lines = columns * weight[:, np.newaxis], omega**2 * ratio * weight
    left = np.concatenate([left_lines.real, left_lines.imag])
    right = np.concatenate([right_lines.real, right_lines.imag])
    scale = np.sqrt(np.mean(left**2, axis=0))
    solution = np.linalg.lstsq(left / scale, right, rcond=None)[0]
    residual = right - left / scale @ solution
    variance = float(residual @ residual) / max(right.size - solution.size, 1)
    # A window smears neighbouring lines: the number of independent lines is smaller by its equivalent noise bandwidth.
    variance *= _compute_noise_bandwidth(T)
    covariance = variance * np.linalg.pinv((left / scale).T @ (left / scale)) / np.outer(scale, scale)
    pad = (0, 3 - solution.size)
    return DirectParameters(RATIOS, np.pad(solution / scale, pad), np.pad(covariance, pad))


def _compute_noise_bandwidth(T: Transmissibility) -> float:
    """Equivalent noise bandwidth of the window, lines: n sum(w^2)/sum(w)^2."""
    window = sample_window(T.spectra.window, T.spectra.nperseg)
    return float(window.size * np.sum(window**2) / np.sum(window) ** 2)


def errors_in_variables(
    run: EquationLines,
    law: Law,
    *,
    start: DirectParameters,
    ground: bool = True,
    cluster_hz: float = PaperSettings.cluster_hz,
) -> DirectParameters:
    """Fit K2/M2, C2/M2, K3/M2 and the law of one run with noise on both channels (spectral_equation, eq. for R).

    Args:
        run: the Fourier lines of the run.
        law: nonlinear law per unit of mass to start from; `Law()` for a linear suspension.
        start: start values, for instance of `complex_least_squares`.
        ground: whether K3 is free (else it is 0).
        cluster_hz: width of neighbouring lines that are taken together in the covariance, Hz.
    """
    fit = fit_equation(
        [run],
        law,
        stiffness_per_mass=max(start.value[0], 1.0),
        damping_per_mass=max(start.value[1], 0.01),
        ground=ground,
        cluster_hz=cluster_hz,
    )
    n = 2 + ground
    return DirectParameters(RATIOS, np.array(fit.ratios), np.pad(fit.covariance[:n, :n], (0, 3 - n)))
