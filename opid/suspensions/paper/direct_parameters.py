"""Direct parameter estimation: ratios to the sprung mass from transmissibility (Iwaniec & Uhl 2007, eqs. 5-9).

Three methods, from the paper's to the best: one equation at a peak of |T|; complex least squares over a band; and its
errors-in-variables form on the transforms themselves (`opid.suspensions.paper.spectral_equation`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws.law import Law
from opid.signals.spectra import Transmissibility
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import RATIOS, EquationLines, FittedRatios, fit_equation
from opid.suspensions.paper.transmissibility import Peak


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

    As printed the magnitude |T| stands for T. Above its only resonance T is negative, and a magnitude below T(0) gives
    a negative stiffness; `restore_sign` takes T = -|T|, still without damping.

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

    Exact at every damping for noise-free T, where the peak formula is not. Noise on T stands on both sides of the
    equation, so the estimate shrinks; `errors_in_variables` does not.

    Args:
        T: complex transmissibility.
        band_hz: lowest and highest line to use, Hz.
        ground: whether K3 is free (else it is 0).

    Raises:
        InputError: fewer than 5 lines in the band.
    """
    inside = (T.frequency_hz >= band_hz[0]) & (T.frequency_hz <= band_hz[1]) & (T.coherence > 0)
    # of a run of one block the force leaves no motion to divide by
    inside &= np.isfinite(T.value) & np.isfinite(T.relative_std) & (np.abs(T.value) > 1e-9)
    if inside.sum() < 5:
        raise InputError(
            f"the band {band_hz[0]:g} to {band_hz[1]:g} Hz holds {int(inside.sum())} usable lines of T: widen it or "
            "take longer blocks"
        )
    ratio, omega = T.value[inside], 2 * np.pi * T.frequency_hz[inside]
    # an error of T enters through k2 + k3 - w^2 + j w c2, which grows like w over most of the band
    weight = np.sqrt(T.coherence[inside]) / (omega * np.maximum(T.relative_std[inside], 1e-3) * np.abs(ratio))
    columns = np.stack([ratio - 1, 1j * omega * (ratio - 1), ratio], axis=1)[:, : 3 if ground else 2]
    left_lines, right_lines = columns * weight[:, np.newaxis], omega**2 * ratio * weight
    left = np.concatenate([left_lines.real, left_lines.imag])
    right = np.concatenate([right_lines.real, right_lines.imag])
    scale = np.sqrt(np.mean(left**2, axis=0))
    solution = np.linalg.lstsq(left / scale, right, rcond=None)[0]
    residual = right - left / scale @ solution
    variance = float(residual @ residual) / max(right.size - solution.size, 1)
    # a window smears neighbouring lines: there are fewer independent ones, by its equivalent noise bandwidth
    variance *= _noise_bandwidth(T)
    covariance = variance * np.linalg.pinv((left / scale).T @ (left / scale)) / np.outer(scale, scale)
    pad = (0, 3 - solution.size)
    return DirectParameters(RATIOS, np.pad(solution / scale, pad), np.pad(covariance, pad))


def _noise_bandwidth(T: Transmissibility) -> float:
    """Equivalent noise bandwidth of the window, lines: n sum(w^2)/sum(w)^2."""
    from scipy import signal

    window = signal.get_window(T.spectra.window, T.spectra.nperseg)
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
