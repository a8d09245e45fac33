"""How noisy the sensors are: as stated, as their quietest spectra say, and as the errors of the fitted model tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import noise_floor
from opid.suspensions.fit import NO_FIT, Fit, fit_model
from opid.suspensions.model import Model
from opid.suspensions.sensor_facts import SIDES, Sensors
from opid.suspensions.settings import RunSettings


def known_noise(
    sensors: Sensors, arrays: Sequence[tuple[FloatArray, ...]], *, fs: float, settings: RunSettings
) -> tuple[FloatArray, FloatArray]:
    """Return the noise of each sensor below and on the body, m/s^2: as stated, else from the quieter of both sides.

    A wheel is never still: only the quieter side tells of the noise. The arrays are (n, n_interfaces) below and
    (n, n_sensors) on the body of each run, m/s^2.
    """
    stated = [np.array([each.noise_m_per_s2 or np.nan for each in side]) for side in (sensors.unsprung, sensors.sprung)]
    if any(np.isnan(side).any() for side in stated):
        floors = [_floor([run[side] for run in arrays], fs, settings) for side in (0, 1)]
        stated = [np.where(np.isnan(side), min(floors), side) for side in stated]
    return stated[0], stated[1]


def _floor(samples: Sequence[FloatArray], fs: float, settings: RunSettings) -> float:
    """The rms over runs and channels of one side."""
    floors = [
        max(noise_floor(channel, fs=fs), settings.least_noise_fraction * float(channel.std()))
        for run in samples
        for channel in run.T
    ]
    return float(np.sqrt(np.mean(np.square(floors))))


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
