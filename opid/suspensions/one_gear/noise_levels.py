"""How noisy is either sensor? The errors of the fitted model know: near the resonance the spindle's noise rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.driven_model import Model
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit, fit_at
from opid.suspensions.one_gear.refit import settled
from opid.suspensions.sensor_facts import SensorPair

# the two levels are taken to differ at most so much
LARGEST_RATIO = 10.0
# equal levels are kept unless others raise the logarithm of the likelihood by this
LEAST_GAIN = 4.0
# the logarithm of the ratio is moved by so much to see whether another one would
PROBE = 0.3


def with_own_noise(runs: Sequence[DrivenRun], fit: ModelFit, sensors: SensorPair) -> ModelFit:
    """Fit once more with the noise levels that make the innovations most likely.

    Only their ratio weighs the data; it is estimated where the noise of a sensor was not stated, and the fit is
    returned as it is where the data do not speak for another ratio.

    Args:
        runs: one `DrivenRun` a run.
        fit: with the levels assumed so far.
        sensors: what was stated.
    """
    from scipy import optimize

    if sensors.unsprung.noise_m_per_s2 and sensors.sprung.noise_m_per_s2:
        return fit
    model, theta = fit.model(runs), fit.vector

    def unlikely(log_ratio: float) -> float:
        return -_at_ratio(model, theta, log_ratio)[1]

    bound = float(np.log(LARGEST_RATIO))
    now = float(np.log(fit.noise[0] / fit.noise[1]))
    try:
        here = unlikely(now)
        if here - _promised(unlikely, now, here) < LEAST_GAIN / 4:
            return fit
        best = optimize.minimize_scalar(unlikely, bounds=(-bound, bound), method="bounded", options={"xatol": 0.05})
        if here - best.fun < LEAST_GAIN:
            return fit
        changed, _ = _at_ratio(model, theta, float(best.x))
        return fit_at(changed, *settled(changed, theta))
    except UnboundedResponseError:
        return fit


def _promised(unlikely: Callable[[float], float], now: float, here: float) -> float:
    """The least value near `now`: that of a parabola through three places, or of the lowest where there is none."""
    below, above = unlikely(now - PROBE), unlikely(now + PROBE)
    slope, bend = (above - below) / 2, above + below - 2 * here
    if bend <= abs(slope):  # no least value between the three
        return min(below, above, here) - LEAST_GAIN
    return here - slope**2 / (2 * bend)


def _at_ratio(model: Model, theta: FloatArray, log_ratio: float) -> tuple[Model, float]:
    level = float(np.sqrt(np.mean(np.square(model.noise))))
    ratio = float(np.exp(log_ratio))
    sprung = level * float(np.sqrt(2 / (1 + ratio**2)))
    changed = replace(model, noise=(ratio * sprung, sprung))
    return changed, changed.log_likelihood(changed.evaluate(theta, sensitivity=False), theta)
