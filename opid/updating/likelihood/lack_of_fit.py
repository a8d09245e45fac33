"""Does a law miss the backbones in a way that all curves share, beyond what their own scatter allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.signals.recording import FloatArray
from opid.updating.data.curves import BackboneData, ModeData
from opid.updating.likelihood.model_curves import curves_of
from opid.updating.model_class import ModelClass

N_PATTERNS = 2
"""Slope and curvature over the amplitude: what the errors of a wrong law look like."""

EXPECTED_WEIGHT = 10
"""Degrees of freedom that the scatter which is expected between curves counts beside the one that is found."""

MODEL_ERROR = 1e-5
"""Of lambda, by harmonics that are left out and by interpolation: keeps curves without noise from being doubted."""


@dataclass(frozen=True)
class LackOfFit:
    """What a law leaves of the growth of the frequencies of one mode, the same way in all of its curves.

    Args:
        mode: its number, from 1.
        share: of the measured growth of lambda, both as rms over the points.
        probability: of as much by chance if the law were right.
    """

    mode: int
    share: float
    probability: float


def lack_of_fit(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> tuple[LackOfFit, ...]:
    """Return how each mode misses its curves, for modes whose curves have points enough to tell.

    A straight line and a parabola over the amplitude are fitted to the errors of lambda of each curve, beside its
    offset. If the law is right, their coefficients scatter about 0 from curve to curve (by each curve's own errors) and
    together (by the error of the linear structure that grows with lambda, `linear_error_growth`); Hotelling's T^2 tells
    how likely their mean is then. Few curves tell little of their scatter: what the points about each curve lead to
    expect, with a slope of each curve's own (`curve_growth`), counts as much as ten curves more.

    Args:
        data: the backbones.
        model_class: the law.
        theta: (n_parameters,), at its best.
    """
    found = []
    for mode in data.modes:
        eigenvalue, _, _, lost = curves_of(data, mode, model_class)(theta[None])
        if not lost[0]:
            error = (mode.eigenvalue - mode.between @ eigenvalue[0]) / mode.linear
            found += _of_one_mode(data, mode, error)
    return tuple(found)


def _of_one_mode(data: BackboneData, mode: ModeData, error: FloatArray) -> list[LackOfFit]:
    """One record; none where the curves are too short."""
    from scipy.stats import f as fisher

    terms = np.vander(mode.level, 1 + N_PATTERNS, increasing=True)
    # of one rms each and without a mean over the points, so that coefficients add up to an rms
    patterns = np.linalg.qr(terms)[0][:, 1:] * np.sqrt(len(terms))
    own, slopes, rest, freedom = [], [], 0.0, 0
    for curve in range(mode.curve[-1] + 1):
        mine = mode.curve == curve
        columns = np.column_stack([np.ones(mine.sum()), patterns[mine]])
        if mine.sum() < columns.shape[1]:
            continue
        fitted = np.linalg.lstsq(columns, np.stack([error[mine], mode.growth[mine]], axis=1), rcond=None)[0]
        own.append(fitted[1:, 0])
        slopes.append(fitted[1:, 1])
        rest += float(np.sum((error[mine] - columns @ fitted[:, 0]) ** 2))
        freedom += int(mine.sum()) - columns.shape[1]
    if freedom < 1:
        return []
    mean, slope, n = np.mean(own, axis=0), np.mean(slopes, axis=0), len(own)
    # linear_error is one of the frequency
    growth = mode.frequency_noise.common_scale if mode.frequency_noise else data.noise.linear_error_growth
    common = (2 * data.noise.linear_error * growth) ** 2 * np.outer(slope, slope)
    weight = min(EXPECTED_WEIGHT, freedom)
    per_point = np.eye(N_PATTERNS) * n / len(error) + data.noise.curve_growth**2 * np.outer(slope, slope)
    expected = rest / freedom * per_point
    between = np.array(own) - mean
    scatter = (between.T @ between + weight * expected) / (n - 1 + weight)
    exact = MODEL_ERROR**2 * np.eye(N_PATTERNS)
    score = float(mean @ np.linalg.solve(scatter / n + common + exact, mean))
    last = max(n - 1 + weight - N_PATTERNS + 1, 1)
    probability = fisher.sf(score * last / (N_PATTERNS * (n - 1 + weight)), N_PATTERNS, last)
    grown = mode.eigenvalue / mode.linear
    share = float(np.linalg.norm(mean) / max(float(grown.std()), 1e-30))
    return [LackOfFit(mode.mode, share, float(probability))]
