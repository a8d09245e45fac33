"""What a fit of a body leaves, against the noise of the sensors, and what that says of its numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import noise_floor
from opid.suspensions.fit import BodyFit
from opid.suspensions.one_gear.whiteness import WHITE_BELOW
from opid.suspensions.paper.classical import LEAST_NOISE

# above this residual over the noise it is the structure that hides a mass, not the runs; above the second one there are
# no numbers
FAR_OFF, REFUSED = 3.0, 20.0
# a mass that is known worse than this share is not determined
LOOSELY_KNOWN = 0.3
# points of a figure
N_SHOWN = 4000


def noise_levels(stated: float | None, arrays: Sequence[tuple[FloatArray, FloatArray]], *, fs: float) -> FloatArray:
    """Return the noise of a sensor below and on the body, (2,) m/s^2: as stated, else from the quietest of the spectra.

    Args:
        stated: rms of the white noise of all sensors, m/s^2; None to estimate it.
        arrays: (n, n_interfaces) below and (n, n_sensors) on the body of each run, m/s^2.
        fs: sampling rate, Hz.
    """
    if stated is not None:
        return np.full(2, stated)
    levels = []
    for side in (0, 1):
        floors = [
            max(noise_floor(channel, fs=fs), LEAST_NOISE * float(channel.std()))
            for run in arrays
            for channel in run[side].T
        ]
        levels.append(float(np.sqrt(np.mean(np.square(floors)))))
    # a wheel is never still: only the quieter side tells of the noise
    return np.full(2, min(levels))


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


def level_of(fit: BodyFit, slot: int) -> float:
    """Return the noise that would explain the errors of one sensor, m/s^2.

    Args:
        fit: the fit.
        slot: of the sensor.
    """
    squares, count = 0.0, 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        own = line.reshape(-1, run.omega.size)[slot]
        squares, count = squares + float(np.sum(np.abs(own) ** 2)), count + 2 * own.size
    return float(np.sqrt(np.mean(np.square(fit.model.noise)) * squares / count))


def thinned(parts: Sequence[FloatArray]) -> FloatArray:
    """Return what a figure shows of the samples of all runs.

    Args:
        parts: (n,) samples of each run.
    """
    whole = np.concatenate(parts)
    return whole[:: max(1, whole.size // N_SHOWN)].copy()


def is_white(fit: BodyFit) -> bool:
    """Return whether the cumulative periodogram of every sensor's errors is that of white noise (Bartlett 1955).

    Args:
        fit: the fit.
    """
    statistic = 0.0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        for own in line.reshape(-1, run.omega.size):
            power = np.cumsum(np.abs(own) ** 2)
            straight = np.arange(1, own.size + 1) / own.size
            statistic = max(statistic, float(np.abs(power / power[-1] - straight).max() * np.sqrt(own.size)))
    return statistic < WHITE_BELOW


def motion_over_noise(fit: BodyFit) -> dict[str, float]:
    """Return the measured rms of each motion of the body over what the noise of the sensors alone would make of it.

    Args:
        fit: of a body whose motion the sensors on it see.
    """
    model = fit.model
    solved = np.linalg.pinv(model.body.readings)
    noise = model.noise[1] * np.linalg.norm(solved, axis=1)
    power = [np.mean(np.abs(solved @ run.transform(run.sprung.T)) ** 2, axis=1) / 2 for run in model.runs]
    ratio = np.sqrt(np.mean(power, axis=0)) / noise
    return dict(zip(model.body.dof, ratio.tolist(), strict=True))
