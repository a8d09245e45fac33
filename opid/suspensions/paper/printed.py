"""The chain of Iwaniec & Uhl (2007) to the letter: what it gives stands beside the mended chain, and is not an answer.

Every step is the printed one: the mean is removed before each integration; the arctangent of eq. (3), of fixed
amplitude, is fitted to the stiffness curve and to the damping curve; both forces are subtracted from the acceleration
(eq. 4) before T and T(0) are read; the spectra have the settings of Table 2; the peaks of both T are matched by hand,
here by `match_peaks`; and eqs. (9) and (10) give M2, K2 and K3 of each pair (`two_peak_mass`).

Two readings are necessary, because the print leaves them open. The slope a of eq. (3) stays in K2, from which it cannot
be distinguished; `PrintedSettings.subtracts_slope` subtracts it too. T(0) is read from the lowest lines of the
reference run.
"""

from __future__ import annotations

from dataclasses import dataclass

from opid.mechanics.laws.law import Law
from opid.signals.motion import Motion, relative_motion
from opid.signals.recording import FloatArray
from opid.signals.spectra import Transmissibility
from opid.suspensions.paper.restoring_force import LawFit, RestoringForce, SliceCurve, fit_slice, slice_curve
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.transmissibility import Peak, estimate_transmissibility, transmissibility_peaks


@dataclass(frozen=True, eq=False)
class PrintedRun:
    """The printed steps on one run, in their order.

    Args:
        motion: relative motion, the mean removed before each integration.
        slices: stiffness curve and damping curve of that motion.
        slice_fits: the arctangent of eq. (3) on each.
        law: both arctangents, per unit of the sprung mass of this run, m/s^2.
        T: transmissibility with their force subtracted from the acceleration.
        peaks: peaks of |T|.
    """

    motion: Motion
    slices: tuple[SliceCurve, ...]
    slice_fits: tuple[LawFit, ...]
    law: Law
    T: Transmissibility
    peaks: tuple[Peak, ...]


def run_as_printed(
    unsprung: FloatArray, sprung: FloatArray, *, fs: float, settings: PaperSettings = DEFAULTS
) -> PrintedRun:
    """Take the printed steps on one run, up to the peaks of |T|.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        settings: its `printed` part, the width of the slices, and what counts as a peak.

    Raises:
        InputError: a slice with fewer than 50 points.
    """
    printed, mended = settings.printed, settings
    motion = relative_motion(unsprung, sprung, fs=fs, method="mean_removed")
    points = RestoringForce(motion.displacement, motion.velocity, sprung.mean() - sprung, fs)
    width = mended.slice_half_width
    slices = tuple(slice_curve(points, along=along, half_width_std=width) for along in ("travel", "velocity"))
    amplitude = printed.amplitude_m_per_s2
    fits = tuple(fit_slice(curve, amplitude_m_per_s2=amplitude, settings=settings) for curve in slices)
    law = Law(tuple(term for fit in fits for term in fit.law.terms))
    force = law.force(motion.displacement, motion.velocity)
    if printed.subtracts_slope:
        stiffness, damping = fits[0].straight["stiffness_per_mass"], fits[1].straight["damping_per_mass"]
        force = force + stiffness * motion.displacement + damping * motion.velocity
    T = estimate_transmissibility(unsprung, sprung + force, fs=fs, settings=printed.transmissibility)
    return PrintedRun(
        motion=motion,
        slices=slices,
        slice_fits=fits,
        law=law,
        T=T,
        peaks=transmissibility_peaks(
            T,
            band_hz=(printed.lowest_peak_hz, min(mended.highest_peak_hz, mended.highest_fraction_of_rate * fs)),
            prominence_std=mended.peak_prominence_std,
            prominence_ratio=mended.peak_prominence_ratio,
        ),
    )
