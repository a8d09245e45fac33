"""The noise of the sensors, and whether a fit leaves only this noise.

The noise is stated, or estimated from the quietest spectra, or from the errors of the fitted model. The residual is
compared with it. If the residual is larger, or not white, the band in which it is largest is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.estimate import format_number
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray, incoherent_noise, noise_floor
from opid.suspensions.fitting.fit import NO_FIT, Fit, fit_model
from opid.suspensions.model.driven_model import Model
from opid.suspensions.sensor_facts import SIDES, Sensors
from opid.suspensions.settings import RunSettings

# number of points of a figure
_N_SHOWN = 4000


@dataclass(frozen=True)
class Whiteness:
    """How white the residual of a fit is.

    Args:
        statistic: largest departure of the cumulative periodogram from a straight line, times the root of the
            number of lines, for the sensor and run where it is largest.
        white: whether white noise may have this statistic.
        band_hz: the band, one of ten in logarithmic steps, in which the residual is largest, Hz.
        excess: rms of the residual there over that of all lines.
    """

    statistic: float
    white: bool
    band_hz: tuple[float, float]
    excess: float


def measure_whiteness(fit: Fit) -> Whiteness:
    """Test the residual of a fit against white noise (Bartlett 1955), and find the band in which it is largest."""
    known, statistic, rows = fit.model.settings.intervals, 0.0, list(residual_lines(fit))
    for _, line in rows:
        power = np.cumsum(np.abs(line) ** 2)
        straight = np.arange(1, line.size + 1) / line.size
        statistic = max(statistic, float(np.abs(power / power[-1] - straight).max() * np.sqrt(line.size)))
    frequency_hz = np.concatenate([frequency for frequency, _ in rows])
    power = np.abs(np.concatenate([line for _, line in rows])) ** 2
    edges = np.geomspace(frequency_hz.min(), frequency_hz.max() * (1 + 1e-9), known.n_bands + 1)
    # The first and the last band end at the outermost lines.
    edges[0], edges[-1] = frequency_hz.min(), frequency_hz.max()
    index = np.minimum(np.digitize(frequency_hz, edges) - 1, known.n_bands - 1)
    count = np.bincount(index, minlength=known.n_bands)
    level = np.sqrt(np.bincount(index, power, minlength=known.n_bands) / np.maximum(count, 1) / power.mean())
    worst = int(np.argmax(np.where(count >= 4, level, 0.0)))
    band = (float(edges[worst]), float(edges[worst + 1]))
    return Whiteness(statistic, statistic < known.white_below, band, float(level[worst]))


def is_noise(fit: Fit) -> bool:
    """Return whether a fit leaves no more than sensor noise.

    The residual is no larger than the noise that is known beforehand. If only a bound of that noise is known, the
    residual lies within the bound and is not much larger in any band.
    """
    explained, most = fit.model.settings.verdicts.explained, fit.model.most_noise
    return fit.ratio <= explained or (fit.ratio <= explained * most and measure_whiteness(fit).excess <= explained)


def measure_coherence(fit: Fit) -> float:
    """Return the fraction of the residual's power in all runs that is coherent with the motion below the suspensions.

    An error of a linear structure is coherent with that motion, an unmeasured force is not; of a missing friction about
    a tenth is coherent. NaN if the runs are too short.
    """
    power = [float(np.sum(np.abs(line) ** 2)) for line in fit.errors.lines]
    fractions = [
        run.coherent_fraction(prediction.innovation[fit.model.compared].T)
        for run, prediction in zip(fit.model.runs, fit.errors.predictions, strict=True)
    ]
    return float(np.average(fractions, weights=power))


def is_of_others(fit: Fit) -> bool:
    """Return whether the residual of several suspensions exceeds the noise and is incoherent with every motion below.

    Neither laws nor sensor faults explain the forces of others on a body.
    """
    alone, least = fit.model.body.n_interfaces == 1, fit.model.settings.process.least_coherent
    return not alone and not is_noise(fit) and measure_coherence(fit) < least


def residual_lines(fit: Fit) -> Iterator[tuple[FloatArray, ComplexArray]]:
    """Yield frequencies (Hz) and whitened lines of each sensor in each run."""
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        for own in line.reshape(-1, run.omega.size):
            # Lines are at multiples of 1/T. They are rounded, so that 0.3 Hz is reported as 0.3.
            yield np.round(run.omega / (2 * np.pi), 9), own


def sensor_ratio(fit: Fit, channel: int) -> float:
    """Return the residual of one sensor on the body over the assumed noise."""
    squares, count = 0.0, 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        own = line.reshape(-1, run.omega.size)[channel - fit.model.compared.start]
        squares, count = squares + float(np.sum(np.abs(own) ** 2)), count + 2 * own.size
    return float(np.sqrt(squares / count))


def motion_over_noise(fit: Fit) -> dict[str, float]:
    """Return the measured rms of each degree of freedom of the body over the rms that sensor noise alone would give."""
    model = fit.model
    solved = np.linalg.pinv(model.body.readings)
    noise = np.linalg.norm(solved * model.noise[1], axis=1)
    power = [
        np.mean(np.abs(solved @ run.transform(run.sprung[:: run.stride].T)) ** 2, axis=1) / 2 for run in model.runs
    ]
    ratio = np.sqrt(np.mean(power, axis=0)) / noise
    return dict(zip(model.body.dof, ratio.tolist(), strict=True))


def over_noise(ratio: float | None) -> str:
    """Return a residual over the noise with three digits; a dash if there is none.

    Args:
        ratio: the residual over the noise.

    >>> over_noise(1.0), over_noise(39.4), over_noise(493.2), over_noise(1234.5), over_noise(None)
    ('1.00', '39.4', '493', '1234', '-')
    """
    if ratio is None or not np.isfinite(ratio):
        return "-"
    return f"{ratio:#.3g}".rstrip(".") if ratio < 999.5 else format_number(round(ratio))


def thin_samples(samples: FloatArray) -> FloatArray:
    """Return the samples of all runs that a figure shows."""
    return samples[:: max(1, samples.size // _N_SHOWN)].copy()


def mean_level(parts: Sequence[float]) -> float:
    """Return the rms of several noise levels."""
    return float(np.sqrt(np.mean(np.square(parts))))


@dataclass(frozen=True, eq=False)
class KnownNoise:
    """What is known of the noise of the sensors before a model is fitted.

    Args:
        levels: (n_interfaces,) below the suspensions and (n_sensors,) on the body, rms, m/s^2.
        most: factor by which the noise in the band may be larger: 1 if it was stated, or if the spectra show it.
        quietest: noise according to the spectra of the quieter side, whatever was stated, m/s^2.
    """

    levels: tuple[FloatArray, FloatArray]
    most: float = 1.0
    quietest: float = 0.0


def known_noise(
    sensors: Sensors,
    arrays: Sequence[tuple[FloatArray, ...]],
    *,
    fs: float,
    settings: RunSettings,
    n_strut: int = 0,
    is_driven: bool = True,
) -> KnownNoise:
    """Return the noise of the sensors: as stated, else from the quieter of the two sides, because a wheel always moves.

    The last `n_strut` columns on the body read a strut itself, and the noise of each is its own. Where nothing drives
    the body that was measured, `is_driven` is False, and the noise below is taken as that on the body.

    The noise is read where the spectra are lowest, and it is no larger than the incoherent part of the two sides in the
    band. A log that was low-pass filtered is quieter there than any sensor: then only bounds are known.
    """
    stated = [np.array([each.noise_m_per_s2 or np.nan for each in side]) for side in (sensors.unsprung, sensors.sprung)]
    band_hz = (settings.band_hz[0], min(settings.band_hz[1], settings.highest_fraction * fs))

    def judge(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[float, ...]:
        rows = [
            (
                [noise_floor(channel, fs=fs) for channel in own.T],
                incoherent_noise(own, other, fs=fs, band_hz=band_hz),
                settings.least_noise_fraction * own.std(axis=0),
                settings.most_noise_fraction * own.std(axis=0),
            )
            for own, other in pairs
        ]
        floor, bound, least, largest = np.moveaxis(np.array(rows), 1, 0).reshape(4, -1)
        credible = np.maximum(np.minimum(floor, bound), least)
        most = np.maximum(np.minimum(bound, largest), credible)
        return tuple(mean_level(each.tolist()) for each in (credible, most, floor, least))

    n_above = len(sensors.sprung) - n_strut
    below, above, struts = zip(*((run[0], run[1][:, :n_above], run[1][:, n_above:]) for run in arrays), strict=True)
    if is_driven:
        sides = [judge([*zip(below, above, strict=True)]), judge([*zip(above, below, strict=True)])]
    else:
        sides = [judge([*zip(above, struts, strict=True)])]
    level, highest, quietest, believed = min(sides)
    is_bound = quietest < believed and any(np.isnan(side).any() for side in (stated[0], stated[1][:n_above]))
    most = highest / level
    levels = [np.where(np.isnan(side), level, side) for side in stated]
    of_struts = [
        judge([(own[:, [k]], beside) for own, beside in zip(struts, above, strict=True)]) for k in range(n_strut)
    ]
    for k, (own_level, *_) in enumerate(of_struts, start=n_above):
        if np.isnan(stated[1][k]):
            levels[1][k] = own_level
    if not is_driven:
        # Only the errors of the strut sensors are compared.
        levels[0][:] = levels[1][:n_above].mean()
        unknown = [each for each, level in zip(of_struts, stated[1][n_above:], strict=True) if np.isnan(level)]
        is_bound = any(quietest < believed for _, _, quietest, believed in unknown)
        most = max((highest / own_level for own_level, highest, _, _ in unknown), default=1.0)
    return KnownNoise((levels[0], levels[1]), most if is_bound else 1.0, level)


def is_noise_above_stated(fit: Fit, known: KnownNoise) -> bool:
    """Return whether a fit leaves sensor noise that is larger than stated.

    The residual is white, and the spectra are nowhere quieter. White residuals alone may be due to an unmeasured force.

    Args:
        fit: a fit that leaves more than the noise known beforehand.
        known: what is known of the noise.
    """
    left = fit.ratio * fit.model.level
    return left <= fit.model.settings.verdicts.explained * known.quietest and measure_whiteness(fit).white


def with_noise_of_the_band(fit: Fit) -> Fit:
    """Return the fit with its residual as the noise if that is white and the noise is otherwise unknown."""
    ratio = fit.ratio
    if fit.model.most_noise == 1.0 or ratio <= fit.model.settings.verdicts.explained or not is_noise(fit):
        return fit
    return with_noise_of_errors(replace(fit, model=replace(fit.model, most_noise=1.0)))


def with_noise_of_errors(fit: Fit) -> Fit:
    """Fit once more with the residual of a fit as the noise, so that prior knowledge has the right weight.

    Args:
        fit: a fit whose residual differs from the assumed noise.
    """
    below, above = fit.model.noise
    return fit_model(replace(fit.model, noise=(fit.ratio * below, fit.ratio * above)), fit.theta)


def with_own_noise(fit: Fit) -> Fit:
    """Fit once more with the most likely ratio of the noise below the suspensions to that on the body.

    Only this ratio weights the data. It is estimated if the noise of no sensor of one side was stated; the fit is
    returned unchanged if the data do not show another ratio.
    """
    from scipy import optimize

    model, theta, known = fit.model, fit.theta, fit.model.settings.intervals
    if all(any(facts.noise_m_per_s2 for facts in model.sensors.facts(side)) for side in SIDES):
        return fit
    if any(run.n_strut for run in model.runs):
        # The noise of a travel was read from its own spectrum, or stated, and has no ratio to those of accelerations.
        return fit

    def unlikely(log_ratio: float) -> float:
        changed = _with_ratio(model, log_ratio)
        return -changed.log_likelihood(changed.evaluate(theta, sensitivity=False), theta)

    bound = float(np.log(known.largest_noise_ratio))
    below, above = (float(np.sqrt(np.mean(np.square(side)))) for side in model.noise)
    now = float(np.log(below / above))
    try:
        here = -model.log_likelihood(fit.errors, theta)
        expected = _estimate_minimum(unlikely, now, here, known.noise_probe, known.least_noise_gain)
        if here - expected < known.least_noise_gain / 4:
            return fit
        best = optimize.minimize_scalar(unlikely, bounds=(-bound, bound), method="bounded", options={"xatol": 0.05})
        if here - best.fun < known.least_noise_gain:
            return fit
        return fit_model(_with_ratio(model, float(best.x)), theta)
    except NO_FIT:
        return fit


def _estimate_minimum(unlikely: Callable[[float], float], now: float, here: float, probe: float, gain: float) -> float:
    """Return the expected minimum near `now`: that of a parabola through three points.

    If the parabola has no minimum between them, it is the lowest of the three values less the gain.
    """
    below, above = unlikely(now - probe), unlikely(now + probe)
    slope, bend = (above - below) / 2, above + below - 2 * here
    if bend <= abs(slope):  # no minimum between the three points
        return min(below, above, here) - gain
    return here - slope**2 / (2 * bend)


def _with_ratio(model: Model, log_ratio: float) -> Model:
    """Return the model with another noise ratio of the two sides and the same mean square."""
    sides = [side / np.sqrt(np.mean(side**2)) for side in model.noise]
    ratio = float(np.exp(log_ratio))
    above = model.level * float(np.sqrt(2 / (1 + ratio**2)))
    return replace(model, noise=(ratio * above * sides[0], above * sides[1]))
