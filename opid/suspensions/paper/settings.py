"""Settings of the paper's chain, each with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from opid.signals.spectra import TransmissibilitySettings
from opid.suspensions.settings import IntervalSettings, RunSettings, Verdicts, WeighingSettings

TABLE_2 = TransmissibilitySettings(window="flattop", overlap=0.3, estimator="H1", block_s=32.0)
"""Table 2 of the paper; its peaks are at multiples of 1/32 Hz. The table has one estimator, whose number is illegible
in some copies."""

MENDED = TransmissibilitySettings(window="hann", overlap=0.5, estimator="H1", block_s=8.0)
"""Blocks of 8 s resolve a resonance of 1 to 4 Hz, and a Hann window with half of a block wastes the least of a run."""


@dataclass(frozen=True)
class PrintedSettings:
    """Settings of the chain as printed (`opid.suspensions.paper.printed`); the defaults are those of the paper.

    Args:
        transmissibility: spectra of Table 2; what a study states takes their place.
        amplitude_m_per_s2: amplitude of the arctangent of eq. (3), m/s^2: the function is bounded by pi/2.
        subtracts_slope: whether the term a z of eq. (3) is subtracted too. It cannot be distinguished from K2, so that
            nothing is left to find of K2 if it is.
        lowest_peak_hz: peaks are searched from here, Hz: the first one of Table 3 is at 0.125 Hz.
        n_pairs: pairs of peaks in Table 3.
        scales_over_rms: inner scales of the arctangent that are tried, over the rms of the motion.
        n_scales: so many of them, before the best is refined: an error surface of one dimension needs no more.
    """

    transmissibility: TransmissibilitySettings = TABLE_2
    amplitude_m_per_s2: float = math.pi / 2
    subtracts_slope: bool = False
    lowest_peak_hz: float = 0.1
    n_pairs: int = 3
    scales_over_rms: tuple[float, float] = (0.01, 100.0)
    n_scales: int = 41


@dataclass(frozen=True)
class PaperSettings:
    """Settings of `opid.suspensions.paper`; each default is the only place where its value is written.

    Args:
        law: the law to fit (`opid.laws.LAWS`, sums joined by "+"); None searches among `candidates`.
        band_hz: lines of the equation, Hz. Below, sensors drift; above, the wheel is no longer rigid with a point
            contact.
        high_pass_hz: corner of the integration, Hz: below it sensor noise, integrated twice, exceeds the motion.
        ground: whether the ground spring K3 is fitted (else it is 0).
        highest_fraction_of_rate: lines above this fraction of the sampling rate are affected by the anti-aliasing
            filter.
        transmissibility: spectra of the mended chain; what a study states takes their place.
        highest_peak_hz: peaks of |T| are searched up to this frequency, Hz, as in the paper's figures.
        peak_prominence_std: least prominence of a peak of log |T|, in standard deviations; less is chance.
        peak_prominence_ratio: least |T| at a peak over |T| at its foot; less is a ripple.
        static_hz: T(0) is read from the lines up to this frequency, Hz, as the paper read 0.7 from its figure.
        n_cells: cells along each axis of the restoring-force surface: a run of a minute fills those that it visits.
        least_points_of_cell: a cell with fewer points stays empty: its mean would be chance.
        slice_half_width: half width of a slice over the standard deviation of the other coordinate.
        force_cells: cells along each axis of the plane on which the identified force is given.
        candidates: laws that the search may add.
        most_terms: most terms of a law: one for stiffness and one for damping, as in eq. (3) of the paper.
        bic_margin: criteria closer than this do not distinguish two laws (10 is "very strong" by Kass & Raftery 1995).
        noise_margin: a further term must lower the unexplained noise by this fraction as well: with thousands of lines
            the criterion alone would pay for correcting the filter.
        first_order_error: the error expected from columns of candidates may be wrong by this fraction: a friction whose
            amplitude is large is ranked by its columns with an error of 5 %.
        start_points: number of points that start values are fitted to; more take time and change nothing.
        seen_above: evidence above which a term is significant: chi-square (2 degrees of freedom, amplitude and scale)
            at 0.999.
        least_departure: a significant term must depart from a straight line by this fraction of its rms.
        cluster_s: correlated residuals in time: scores are added up over blocks of this length, s.
        cluster_hz: correlated residuals of lines: scores are added up over neighbouring lines of this width, Hz.
        start_mass_over_change: the fit of the mass starts at this multiple of the largest mass change.
        largest_mass_fraction: a peak shift that needs a larger change of the mass than this is not credible.
        least_remainder: a run that keeps a smaller fraction of the sprung mass has a mistyped mass change.
        mass_seen_above: 1/M2 must stand this many standard deviations from zero.
        printed: settings of the chain as printed.
        verdicts: thresholds of the whole package on the residual over the noise.
        least_noise: no model of a strut is better than this fraction of the motion, however quiet the sensor.
        few_averages: independent averages below which the coherence is near 1 by construction.
        equal_gains: no two sensors have gains more equal than this, and a gain error imitates a ground spring.
        gain_like: a gain error of one or two per cent imitates a ground spring below this fraction of K2.
        negligible_ground: a ground spring below this fraction of K2 is not worth a warning.
        straight_above: a term whose scale exceeds this multiple of the rms motion is a straight line.
        loose_mass: relative standard deviation of the mass above which a larger mass change is advised.
        weighing: how masses are compared with weighed ones.
    """

    law: str | None = None
    band_hz: tuple[float, float] = (0.5, 12.0)
    high_pass_hz: float = 0.3
    ground: bool = True
    # transmissibility
    highest_fraction_of_rate: float = 0.4
    transmissibility: TransmissibilitySettings = MENDED
    highest_peak_hz: float = 25.0
    peak_prominence_std: float = 5.0
    peak_prominence_ratio: float = 1.3
    static_hz: float = 0.5
    # restoring force
    n_cells: int = 25
    least_points_of_cell: int = 5
    slice_half_width: float = 0.15
    force_cells: int = 31
    # law
    candidates: tuple[str, ...] = (
        "arctan_velocity",
        "arctan_displacement",
        "coulomb_friction",
        "quadratic_damping",
        "quadratic_stiffness",
        "cubic_stiffness",
    )
    most_terms: int = 2
    bic_margin: float = 10.0
    noise_margin: float = 0.02
    first_order_error: float = 0.1
    start_points: int = 3000
    seen_above: float = 13.8
    least_departure: float = 0.01
    cluster_s: float = 0.5
    cluster_hz: float = 0.25
    # mass
    start_mass_over_change: float = 8.0
    largest_mass_fraction: float = 0.5
    least_remainder: float = IntervalSettings.least_remainder
    mass_seen_above: float = 4.0
    # the chain as printed
    printed: PrintedSettings = field(default_factory=PrintedSettings)
    # answer
    verdicts: Verdicts = field(default_factory=Verdicts)
    least_noise: float = RunSettings.least_noise_fraction
    few_averages: float = 4.0
    equal_gains: float = IntervalSettings.equal_gains
    gain_like: float = 0.05
    negligible_ground: float = IntervalSettings.negligible_ground
    straight_above: float = 2.0
    loose_mass: float = 0.02
    weighing: WeighingSettings = field(default_factory=WeighingSettings)

    def stated_by(self, stated: TransmissibilitySettings) -> PaperSettings:
        """Return these settings with what a study states of the transmissibility, mended and as printed.

        Args:
            stated: settings of the study.
        """
        return replace(
            self,
            transmissibility=stated.completed_by(self.transmissibility),
            printed=replace(self.printed, transmissibility=stated.completed_by(self.printed.transmissibility)),
        )

    def band_at(self, fs: float) -> tuple[float, float]:
        """Return the band that a sampling rate leaves of `band_hz`, Hz.

        Args:
            fs: sampling rate, Hz.

        >>> PaperSettings().band_at(20.0)
        (0.5, 8.0)
        """
        return float(self.band_hz[0]), min(float(self.band_hz[1]), self.highest_fraction_of_rate * fs)


DEFAULTS = PaperSettings()
"""The settings of a call that gives none."""
