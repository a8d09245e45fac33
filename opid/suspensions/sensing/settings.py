"""The tuned numbers of virtual sensors."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SensingSettings:
    """The tuned numbers of virtual sensors.

    Args:
        n_draws: number of motions that are drawn; the standard deviation of a sample is then known to 7 %.
        n_counted: number of them whose cycles are counted, which takes longer than to draw them.
        n_bins: number of ranges of cycles.
        most_moved: up to this rms change of the vector by the record, in standard deviations, the record agrees with
            the result.
        most_contradicted: a record that contradicts the result is refused if the strut force may be wrong by more than
            this fraction: it is of another strut, or a sensor has a fault.
        followed: up to this residual over that of the fit the model explains the record; above it unmeasured forces
            are added, so that the band holds them.
        pushes: rms accelerations by unmeasured forces that are tried, over that of the readings.
        push_corners_hz: corners of their spectral density that are tried, Hz: from the bounce of a strut to the upper
            end of the compared band.
        gain_tolerance: standard deviation of a gain that all sensors share, relative, if the study states a tolerance
            above 0 for none of them: an accelerometer is calibrated to 1 to 2 %, and hardly anything in a log shows it.
        least_motion: a record whose readings are less than this times the noise is without motion.
        band_std: half width of the band in standard deviations.
    """

    n_draws: int = 100
    n_counted: int = 30
    n_bins: int = 32
    most_moved: float = 2.0
    most_contradicted: float = 0.3
    followed: float = 1.2
    pushes: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
    push_corners_hz: tuple[float, ...] = (2.0, 8.0, 30.0)
    gain_tolerance: float = 0.015
    least_motion: float = 3.0
    band_std: float = 1.96
