"""How noisy the sensors are, and whether what a fit leaves is only their noise.

The noise is as stated, as their quietest spectra say, or as the errors of the fitted model tell. What is left is
compared with it, and where that is more or not white, it is said in which band it stands out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, incoherent_noise, noise_floor
from opid.suspensions.fitting.fit import NO_FIT, Fit, fit_model
from opid.suspensions.model.driven_model import Model
from opid.suspensions.sensor_facts import SIDES, Sensors
from opid.suspensions.settings import RunSettings

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
    index = np.minimum(np.digitize(frequency_hz, edges) - 1, known.n_bands - 1)
    count = np.bincount(index, minlength=known.n_bands)
    level = np.sqrt(np.bincount(index, power, minlength=known.n_bands) / np.maximum(count, 1) / power.mean())
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


def goes_with_drive(fit: Fit) -> float:
    """Return the fraction of the power of what a fit leaves in all runs that is coherent with the motion below.

    What a linear structure lacks is coherent with it, a force that nobody measured is not; of a missing friction about
    a tenth is. NaN where the runs are too short to tell.
    """
    n_sensors = len(fit.model.sensors.sprung)
    power = [float(np.sum(np.abs(line) ** 2)) for line in fit.errors.lines]
    fractions = [
        run.goes_with_drive(prediction.innovation[:n_sensors].T)
        for run, prediction in zip(fit.model.runs, fit.errors.predictions, strict=True)
    ]
    return float(np.average(fractions, weights=power))


def is_of_others(fit: Fit) -> bool:
    """Return whether what several suspensions leave exceeds the noise and is incoherent with every motion below.

    Neither laws nor faults of sensors mend what others do to a body.
    """
    alone, least = fit.model.body.n_interfaces == 1, fit.model.settings.process.least_coherent
    return not alone and not is_noise(fit) and goes_with_drive(fit) < least


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


@dataclass(frozen=True, eq=False)
class KnownNoise:
    """What is known of the noise of the sensors before a model is fitted.

    Args:
        levels: (n_interfaces,) below the suspensions and (n_sensors,) on the body, m/s^2.
        most: the noise in the band may be so many times as large: 1 where it was stated, or where spectra tell it.
        quietest: what the spectra of the quieter side tell, whatever was stated, m/s^2.
    """

    levels: tuple[FloatArray, FloatArray]
    most: float = 1.0
    quietest: float = 0.0


def known_noise(
    sensors: Sensors, arrays: Sequence[tuple[FloatArray, ...]], *, fs: float, settings: RunSettings
) -> KnownNoise:
    """Return the noise of the sensors: as stated, else from the quieter of both sides, for a wheel is never still.

    Spectra tell the noise where they are quietest, and it is no larger than what the two sides do not share in the
    band. A log that was low-pass filtered is as quiet as no sensor is: then only bounds are known.
    """
    stated = [np.array([each.noise_m_per_s2 or np.nan for each in side]) for side in (sensors.unsprung, sensors.sprung)]
    band_hz = (settings.band_hz[0], min(settings.band_hz[1], settings.highest_fraction * fs))
    sides = []
    for own, other in ((0, 1), (1, 0)):
        rows = [
            (
                [noise_floor(channel, fs=fs) for channel in run[own].T],
                incoherent_noise(run[own], run[other], fs=fs, band_hz=band_hz),
                settings.least_noise_fraction * run[own].std(axis=0),
                settings.most_noise_fraction * run[own].std(axis=0),
            )
            for run in arrays
        ]
        floor, bound, least, largest = np.moveaxis(np.array(rows), 1, 0).reshape(4, -1)
        credible = np.maximum(np.minimum(floor, bound), least)
        # over runs and channels of a side
        most = np.maximum(np.minimum(bound, largest), credible)
        sides.append(tuple(mean_level(each.tolist()) for each in (credible, most, floor, least)))
    level, highest, quietest, believed = min(sides)
    levels = [np.where(np.isnan(side), level, side) for side in stated]
    is_bound = quietest < believed and any(np.isnan(side).any() for side in stated)
    return KnownNoise((levels[0], levels[1]), highest / level if is_bound else 1.0, level)


def is_noise_above_stated(fit: Fit, known: KnownNoise) -> bool:
    """Return whether what a fit leaves is the noise of sensors of which less was stated than they have.

    It is white, and their spectra are nowhere quieter. White alone is what a force may leave that nobody measured.

    Args:
        fit: that leaves more than the noise known beforehand.
        known: of the noise.
    """
    left = fit.ratio * fit.model.level
    return left <= fit.model.settings.verdicts.explained * known.quietest and measure_whiteness(fit).white


def with_noise_of_the_band(fit: Fit) -> Fit:
    """Return the fit with what it leaves as the noise, where that is white and nothing else tells the noise."""
    ratio = fit.ratio
    if fit.model.most_noise == 1.0 or ratio <= fit.model.settings.verdicts.explained or not is_noise(fit):
        return fit
    return with_noise_of_errors(replace(fit, model=replace(fit.model, most_noise=1.0)))


def with_noise_of_errors(fit: Fit) -> Fit:
    """Fit once more with what a fit leaves as the noise: what was known before the data then counts as it should.

    Args:
        fit: that leaves another level than that of the noise that was assumed.
    """
    below, above = fit.model.noise
    return fit_model(replace(fit.model, noise=(fit.ratio * below, fit.ratio * above)), fit.theta)


def with_own_noise(fit: Fit) -> Fit:
    """Fit once more with the ratio of the noise below to that on the body that makes the readings most likely.

    Only their ratio weighs the data. It is estimated where the noise of no sensor of a side was stated, and the fit is
    returned as it is where the data do not speak for another ratio.
    """
    from scipy import optimize

    model, theta, known = fit.model, fit.theta, fit.model.settings.intervals
    if all(any(facts.noise_m_per_s2 for facts in model.sensors.facts(side)) for side in SIDES):
        return fit

    def unlikely(log_ratio: float) -> float:
        changed = _at_ratio(model, log_ratio)
        return -changed.log_likelihood(changed.evaluate(theta, sensitivity=False), theta)

    bound = float(np.log(known.largest_noise_ratio))
    below, above = (float(np.sqrt(np.mean(np.square(side)))) for side in model.noise)
    now = float(np.log(below / above))
    try:
        here = -model.log_likelihood(fit.errors, theta)
        promised = _promised(unlikely, now, here, known.noise_probe, known.least_noise_gain)
        if here - promised < known.least_noise_gain / 4:
            return fit
        best = optimize.minimize_scalar(unlikely, bounds=(-bound, bound), method="bounded", options={"xatol": 0.05})
        if here - best.fun < known.least_noise_gain:
            return fit
        return fit_model(_at_ratio(model, float(best.x)), theta)
    except NO_FIT:
        return fit


def _promised(unlikely: Callable[[float], float], now: float, here: float, probe: float, gain: float) -> float:
    """The least value near `now`: that of a parabola through three points, or of the lowest where there is none."""
    below, above = unlikely(now - probe), unlikely(now + probe)
    slope, bend = (above - below) / 2, above + below - 2 * here
    if bend <= abs(slope):  # no least value between the three
        return min(below, above, here) - gain
    return here - slope**2 / (2 * bend)


def _at_ratio(model: Model, log_ratio: float) -> Model:
    """The model with another ratio of the sides, their mean square kept."""
    sides = [side / np.sqrt(np.mean(side**2)) for side in model.noise]
    ratio = float(np.exp(log_ratio))
    above = model.level * float(np.sqrt(2 / (1 + ratio**2)))
    return replace(model, noise=(ratio * above * sides[0], above * sides[1]))
