"""What a fit leaves: against the noise of the sensors, whether it is only noise, and where it stands out if not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.fit import Fit

# points of a figure
_N_SHOWN = 4000


@dataclass(frozen=True)
class Whiteness:
    """How white the residual of a fit is.

    Args:
        statistic: largest departure of the cumulative periodogram from a straight line, times the root of the
            number of lines, of the sensor and run where it is largest.
        white: whether white noise could do that.
        band_hz: the band, a tenth of the lines in logarithmic steps, where the residual stands out most, Hz.
        excess: its level there over that of all lines.
    """

    statistic: float
    white: bool
    band_hz: tuple[float, float]
    excess: float


def measure_whiteness(fit: Fit) -> Whiteness:
    """Test the residual of a fit against white noise (Bartlett 1955), and find where it stands out."""
    known, statistic, rows = fit.model.settings.intervals, 0.0, list(residual_lines(fit))
    for _, line in rows:
        power = np.cumsum(np.abs(line) ** 2)
        straight = np.arange(1, line.size + 1) / line.size
        statistic = max(statistic, float(np.abs(power / power[-1] - straight).max() * np.sqrt(line.size)))
    frequency_hz = np.concatenate([frequency for frequency, _ in rows])
    power = np.abs(np.concatenate([line for _, line in rows])) ** 2
    edges = np.geomspace(frequency_hz.min(), frequency_hz.max() * (1 + 1e-9), known.n_bands + 1)
    # the ends of the band are those of its lines
    edges[0], edges[-1] = frequency_hz.min(), frequency_hz.max()
    place = np.minimum(np.digitize(frequency_hz, edges) - 1, known.n_bands - 1)
    count = np.bincount(place, minlength=known.n_bands)
    level = np.sqrt(np.bincount(place, power, minlength=known.n_bands) / np.maximum(count, 1) / power.mean())
    worst = int(np.argmax(np.where(count >= 4, level, 0.0)))
    band = (float(edges[worst]), float(edges[worst + 1]))
    return Whiteness(statistic, statistic < known.white_below, band, float(level[worst]))


def is_noise(fit: Fit) -> bool:
    """Return whether what a fit leaves may be the noise of the sensors.

    It is no larger than the noise that is known beforehand; or, where that is only bounded, it is within the bound and
    stands out nowhere.
    """
    explained, most = fit.model.settings.verdicts.explained, fit.model.most_noise
    return fit.ratio <= explained or (fit.ratio <= explained * most and measure_whiteness(fit).excess <= explained)


def residual_lines(fit: Fit) -> Iterator[tuple[FloatArray, ComplexArray]]:
    """Yield frequencies (Hz) and whitened lines of each sensor in each run."""
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        for own in line.reshape(-1, run.omega.size):
            # lines stand at multiples of 1/T: rounded, so that 0.3 Hz is told as 0.3
            yield np.round(run.omega / (2 * np.pi), 9), own


def sensor_ratio(fit: Fit, channel: int) -> float:
    """Return the residual of one sensor on the body over the noise that was assumed."""
    squares, count = 0.0, 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        own = line.reshape(-1, run.omega.size)[channel]
        squares, count = squares + float(np.sum(np.abs(own) ** 2)), count + 2 * own.size
    return float(np.sqrt(squares / count))


def motion_over_noise(fit: Fit) -> dict[str, float]:
    """Return the measured rms of each motion of the body over what the noise of the sensors alone would make of it."""
    model = fit.model
    solved = np.linalg.pinv(model.body.readings)
    noise = np.linalg.norm(solved * model.noise[1], axis=1)
    power = [
        np.mean(np.abs(solved @ run.transform(run.sprung[:: run.stride].T)) ** 2, axis=1) / 2 for run in model.runs
    ]
    ratio = np.sqrt(np.mean(power, axis=0)) / noise
    return dict(zip(model.body.dof, ratio.tolist(), strict=True))


def over_noise(ratio: float | None) -> str:
    """Return a residual over the noise with three digits, a dash where there is none.

    Args:
        ratio: the residual over the noise.

    >>> over_noise(1.0), over_noise(39.4), over_noise(493.2), over_noise(1234.5), over_noise(None)
    ('1.00', '39.4', '493', '1234', '-')
    """
    if ratio is None or not np.isfinite(ratio):
        return "-"
    return f"{ratio:#.3g}".rstrip(".") if ratio < 999.5 else f"{ratio:.0f}"


def thinned(samples: FloatArray) -> FloatArray:
    """Return what a figure shows of the samples of all runs."""
    return samples[:: max(1, samples.size // _N_SHOWN)].copy()


def mean_level(parts: Sequence[float]) -> float:
    """Return the rms of some levels."""
    return float(np.sqrt(np.mean(np.square(parts))))
