"""The tuned numbers of the estimator of wheel, tyre and road."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WheelSettings:
    """The tuned numbers of the estimator of wheel, tyre and road.

    Args:
        block_s: length of the blocks whose spectra are compared, s. Blocks of 2 s smeared the steep spectrum at the
            lowest lines and biased K1 by half a standard deviation; in longer ones the speed of a braking run changes.
        band_hz: lines that are compared, Hz: the bounce of the sprung mass, whose frequency depends on the tyre,
            belongs to it; without the lines from 1 to 2 Hz K1 has three times the standard deviation.
        highest_fraction: lines above this fraction of the sampling rate are not compared: the filters of loggers cut
            there.
        shortest_wave_m: shorter waves of the road are not compared: the tyre bridges them, and how it does so is known
            by one number, its footprint, only well above the footprint.
        least_steady: a block is left out if its lowest speed is less than this fraction of its highest one.
        n_speeds: number of speeds at which the spectrum of the road is averaged within a block.
        least_lines: a study with fewer lines below this wave length is refused.
        slope: usual slope of the spectrum of a road, that of ISO 8608 ...
        slope_std: ... and its standard deviation over measured roads.
        footprint_m: usual length over which a tyre averages the road ...
        footprint_std_m: ... and its standard deviation, from a light aircraft to a large one.
        most_left: a gear whose model leaves more than this times the noise of the sensors is refused: what pushes the
            body beside the strut passes for a force of the road.
        n_probes: random forces by which the mean response of the gear with its nonlinear strut is computed; with eight
            the result of another seed differs by less than a tenth of a standard deviation.
        probe_margin: the probes reach beyond the compared band by this factor, so that its edges are excited alike.
        most_rounds: most times that this response is computed anew ...
        settled_std: ... until no parameter moves by more than this fraction of its standard deviation.
        most_steps: most steps of the fit between two of them.
        largest_step: largest change of the logarithm of a mass or stiffness in one step.
        start_masses: unsprung over sprung mass at which the search begins ...
        start_tyre_hz: ... and frequency of the sprung mass on the tyre alone, Hz.
        rejected_p: the fit is rejected if the most unusual block, band or line of its normalised periodogram has a
            smaller probability, after division by their number.
        bands_per_octave: width of those bands.
        loosely_known: a value is not given, but an interval, if its standard deviation exceeds this fraction of it.
        unequal_std: a tyre is called nonlinear if its stiffness changes by more standard deviations.
    """

    block_s: float = 4.0
    band_hz: tuple[float, float] = (1.0, 40.0)
    highest_fraction: float = 0.4
    shortest_wave_m: float = 0.4
    least_steady: float = 0.5
    n_speeds: int = 8
    least_lines: int = 200
    slope: float = 2.0
    slope_std: float = 0.5
    footprint_m: float = 0.25
    footprint_std_m: float = 0.15
    most_left: float = 1.5
    n_probes: int = 8
    probe_margin: float = 1.5
    most_rounds: int = 12
    settled_std: float = 0.05
    most_steps: int = 40
    largest_step: float = 0.5
    start_masses: tuple[float, ...] = (0.03, 0.06, 0.12)
    start_tyre_hz: tuple[float, ...] = (1.5, 2.5, 4.0, 6.0)
    rejected_p: float = 1e-3
    bands_per_octave: float = 2.0
    loosely_known: float = 0.25
    unequal_std: float = 3.5
