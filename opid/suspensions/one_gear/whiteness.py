"""Is what a fit leaves over only noise? If not: where in the spectrum is the rest, and how much wider the intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit

# Kolmogorov's statistic of the cumulative periodogram (Bartlett 1955): exceeded by white noise in 1 of 1000 runs
WHITE_BELOW = 1.95
# neighbouring lines that may be correlated: a mode of some per cent damping is this many lines of a 40 s run wide
LINES_A_CELL = 16
N_BANDS = 10
BOOTSTRAP_S, N_BOOTSTRAP = 0.5, 100


@dataclass(frozen=True)
class Whiteness:
    """How white the residual of a fit is.

    Args:
        statistic: largest departure of the cumulative periodogram from a straight line, times the root of the
            number of lines, of the run where it is largest.
        white: whether white noise could do that.
        band_hz: the band, a tenth of the lines in logarithmic steps, where the residual stands out most, Hz.
        excess: its level there over that of all lines.
    """

    statistic: float
    white: bool
    band_hz: tuple[float, float]
    excess: float


def whiteness(fit: ModelFit) -> Whiteness:
    """Test the residual of a fit against white noise, and find where it stands out.

    Args:
        fit: a fitted model.
    """
    statistic = 0.0
    for line in fit.residual:
        share = np.cumsum(np.abs(line) ** 2) / np.sum(np.abs(line) ** 2)
        straight = np.arange(1, line.size + 1) / line.size
        statistic = max(statistic, float(np.max(np.abs(share - straight)) * np.sqrt(line.size)))
    frequency_hz = np.concatenate(fit.frequency_hz)
    power = np.abs(np.concatenate(fit.residual)) ** 2
    edges = np.geomspace(frequency_hz.min(), frequency_hz.max() * (1 + 1e-9), N_BANDS + 1)
    place = np.digitize(frequency_hz, edges) - 1
    count = np.bincount(place, minlength=N_BANDS)[:N_BANDS]
    level = np.sqrt(np.bincount(place, power, minlength=N_BANDS)[:N_BANDS] / np.maximum(count, 1) / power.mean())
    worst = int(np.argmax(np.where(count >= 4, level, 0.0)))
    band = (float(edges[worst]), float(edges[worst + 1]))
    return Whiteness(statistic, statistic < WHITE_BELOW, band, float(level[worst]))


def coloured_std(fit: ModelFit) -> FloatArray:
    """Return standard deviations that hold for a coloured residual (sandwich over cells of neighbouring lines).

    What was known before the data keeps its weight.

    Args:
        fit: a fitted model.

    Returns:
        (n_parameters,) never below those for a white residual.
    """
    scores, first, n_cells = [], 0, 0
    for line in fit.residual:
        cell = np.arange(line.size) // LINES_A_CELL
        own = np.zeros((int(cell[-1]) + 1, len(fit.names)))
        for _ in range(2):
            rows = slice(first, first + line.size)
            np.add.at(own, cell, fit.jacobian[rows] * fit.errors[rows, np.newaxis])
            first += line.size
        scores.append(own)
        n_cells += own.shape[0]
    stacked = np.concatenate(scores)
    scale = np.maximum(fit.std, 1e-300)
    posterior = fit.covariance / np.outer(scale, scale)
    of_prior = _known_before(fit)
    stacked = stacked * scale
    small = n_cells / max(n_cells - len(fit.names), 1)
    meat = small * (stacked.T @ stacked) / fit.variance**2 + of_prior
    sandwich = posterior @ meat @ posterior
    return fit.std * np.sqrt(np.maximum(np.diag(sandwich), 1.0))


def _known_before(fit: ModelFit) -> FloatArray:
    """Information that was there before the data, with every parameter in units of its standard deviation."""
    scale = np.maximum(fit.std, 1e-300)
    jacobian = fit.jacobian * scale
    posterior = fit.covariance / np.outer(scale, scale)
    return np.linalg.pinv(posterior, rcond=1e-12, hermitian=True) - jacobian.T @ jacobian / fit.variance


def bootstrap_std(runs: Sequence[DrivenRun], fit: ModelFit, *, rng: np.random.Generator) -> FloatArray:
    """Return standard deviations by resampling blocks of the innovations in time, to first order.

    Each resample draws blocks of half a second with replacement (Kuensch 1989), so that what is correlated within a
    block stays so, and moves the parameters by -C J^T e/s^2.

    Args:
        runs: those that were fitted.
        fit: the fitted model.
        rng: source of the draws.

    Returns:
        (n_parameters,).
    """
    back = fit.covariance @ fit.jacobian.T / fit.variance
    moved = np.zeros((N_BOOTSTRAP, len(fit.names)))
    influences = _in_time(runs, back)
    for draw in range(N_BOOTSTRAP):
        for prediction, run, influence in zip(fit.predictions, runs, influences, strict=True):
            innovation = prediction.innovation[0]
            block = max(1, round(BOOTSTRAP_S * run.fs))
            starts = rng.integers(0, innovation.size, -(-innovation.size // block))
            places = (starts[:, np.newaxis] + np.arange(block)).ravel()[: innovation.size] % innovation.size
            moved[draw] += influence @ innovation[places]
    scale = np.maximum(fit.std, 1e-300)
    posterior = fit.covariance / np.outer(scale, scale)
    # what was known before the data is drawn anew as well
    by_prior = np.diag(posterior @ _known_before(fit) @ posterior) * scale**2
    return np.sqrt(moved.var(axis=0) + np.maximum(by_prior, 0.0))


def _in_time(runs: Sequence[DrivenRun], back: FloatArray) -> list[FloatArray]:
    """What each sample of each run does to the parameters, (n_parameters, n) a run, from what each line does."""
    found, first = [], 0
    for run in runs:
        real, imaginary = (back[:, first + k * run.omega.size :][:, : run.omega.size] for k in (0, 1))
        first += 2 * run.omega.size
        spectrum = np.zeros((back.shape[0], run.n_samples // 2 + 1), dtype=np.complex128)
        spectrum[:, run.lines] = real + 1j * imaginary
        # the transpose of `DrivenRun.transform`; the band holds neither the mean nor the highest line
        found.append(fft.irfft(spectrum, run.n_samples) * np.sqrt(run.n_samples / 2))
    return found
