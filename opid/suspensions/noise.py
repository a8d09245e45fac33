"""How noisy the sensors are: as stated, as their quietest spectra say, and as the errors of the fitted model tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import incoherent_noise, noise_floor
from opid.suspensions.fit import NO_FIT, Fit, fit_model
from opid.suspensions.model import Model
from opid.suspensions.residual import is_noise, mean_level
from opid.suspensions.sensor_facts import SIDES, Sensors
from opid.suspensions.settings import RunSettings


@dataclass(frozen=True, eq=False)
class KnownNoise:
    """What is known of the noise of the sensors before a model is fitted.

    Args:
        levels: (n_interfaces,) below the suspensions and (n_sensors,) on the body, m/s^2.
        most: the noise in the band may be so many times as large: 1 where it was stated, or where spectra tell it.
    """

    levels: tuple[FloatArray, FloatArray]
    most: float = 1.0


def known_noise(
    sensors: Sensors, arrays: Sequence[tuple[FloatArray, ...]], *, fs: float, settings: RunSettings
) -> KnownNoise:
    """Return the noise of the sensors: as stated, else from the quieter of both sides, for a wheel is never still.

    Spectra tell the noise where they are quietest, and it is no larger than what the two sides do not share in the
    band. A log that was low-pass filtered is as quiet as no sensor is: then only bounds are known.

    Args:
        sensors: what was stated of them.
        arrays: (n, n_interfaces) below and (n, n_sensors) on the body of each run, m/s^2.
        fs: sampling rate, Hz.
        settings: the band, and how quiet a sensor may be.
    """
    stated = [np.array([each.noise_m_per_s2 or np.nan for each in side]) for side in (sensors.unsprung, sensors.sprung)]
    if not any(np.isnan(side).any() for side in stated):
        return KnownNoise((stated[0], stated[1]))
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
    return KnownNoise((levels[0], levels[1]), highest / level if quietest < believed else 1.0)


def with_noise_of_the_band(fit: Fit) -> Fit:
    """Return the fit with what it leaves as the noise, where that is white and nothing else tells the noise."""
    ratio = fit.ratio
    if fit.model.most_noise == 1.0 or ratio <= fit.model.settings.verdicts.explained or not is_noise(fit):
        return fit
    below, above = fit.model.noise
    return fit_model(replace(fit.model, noise=(ratio * below, ratio * above), most_noise=1.0), fit.theta)


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
        here = unlikely(now)
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
    """The least value near `now`: that of a parabola through three places, or of the lowest where there is none."""
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
