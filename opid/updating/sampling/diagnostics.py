"""Were the chains long enough, and does the posterior press against its prior?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, special, stats

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.updating.model_class import Prior
from opid.updating.result import Diagnostics
from opid.updating.sampling.chains import Chain

EDGE_DENSITY = 0.1
"""Of the largest density of the samples: with more than that at a bound, the bound shapes the posterior."""

FAR_SCORE = 2.0
"""Standard deviations of a prior without bounds beyond which the median of the posterior contradicts it."""


@dataclass(frozen=True)
class Pressure:
    """A prior that the posterior presses against.

    Args:
        parameter: its number, from 1.
        side: "lower" or "upper".
        strength: density at a bound over the largest density; for a prior without a bound, the distance of the median
            of the posterior from the centre of the prior in its standard deviations.
        sentence: the same in words, with what to do.
    """

    parameter: int
    side: Literal["lower", "upper"]
    strength: float
    sentence: str


def diagnose(chain: Chain) -> Diagnostics:
    """Return how well a posterior was sampled.

    Args:
        chain: of any sampler.

    Raises:
        InputError: fewer than four samples a chain.
    """
    n_chains, n, _ = chain.samples.shape
    return Diagnostics(
        sampler=chain.sampler,
        n_samples=n_chains * n,
        n_evaluations=chain.n_evaluations,
        acceptance=chain.acceptance,
        effective_samples=float(effective_samples(chain.samples).min()),
        r_hat=float(split_r_hat(chain.samples).max()) if n_chains > 1 else float("nan"),
    )


def effective_samples(samples: ArrayLike, *, ranked: bool = True) -> FloatArray:
    """Return how many independent samples the chains are worth, (n_parameters,).

    Each chain is cut in halves; the autocorrelation over all of them is summed as far as pairs of lags are positive
    and made to fall (Geyer 1992), as Stan and ArviZ do (Vehtari et al. 2021). The walkers of an ensemble count as
    chains although they steer by each other. Chains that never move are worth a single sample.

    Args:
        samples: (n_chains, n, n_parameters).
        ranked: of the ranks ("bulk"), which is right for heavy tails too; otherwise of the mean.

    Raises:
        InputError: another shape, values that are not finite, fewer than four samples a chain.
    """
    halves = _halves(samples)
    if ranked:
        halves = _normal_scores(halves)
    n_chains, n, _ = halves.shape
    centred = halves - halves.mean(axis=1, keepdims=True)
    size = fft.next_fast_len(2 * n, real=True)
    spectrum = fft.rfft(centred, size, axis=1)
    covariance = fft.irfft(np.abs(spectrum) ** 2, size, axis=1)[:, :n].mean(axis=0) / n  # (n, n_parameters)
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + halves.mean(axis=1).var(axis=0, ddof=1)
    still = np.ptp(halves, axis=(0, 1)) == 0
    correlation = 1.0 - (within - covariance) / np.where(still, 1.0, total)
    correlation[0] = 1.0
    times = np.array([_correlation_time(each, n_chains * n) for each in correlation.T])
    return np.where(still, 1.0, n_chains * n / times)


def split_r_hat(samples: ArrayLike) -> FloatArray:
    """Return the rank-normalised split R-hat of each parameter, (n_parameters,); 1 is converged (Vehtari et al. 2021).

    The larger one of location and spread. A chain that stands still where others move gives a large number.

    Args:
        samples: (n_chains, n, n_parameters).

    Raises:
        InputError: another shape, values that are not finite, fewer than four samples a chain.

    >>> rng = np.random.default_rng(1)
    >>> together = rng.standard_normal((4, 500, 1))
    >>> apart = together + np.arange(4)[:, None, None]
    >>> bool(split_r_hat(together)[0] < 1.01), bool(split_r_hat(apart)[0] > 1.1)
    (True, True)
    """
    halves = _halves(samples)
    folded = np.abs(halves - np.median(halves, axis=(0, 1)))
    return np.maximum(_r_hat(_normal_scores(halves)), _r_hat(_normal_scores(folded)))


def presses_against(samples: ArrayLike, priors: Sequence[Prior]) -> tuple[Pressure, ...]:
    """Return which priors the posterior presses against, and on which side.

    A bound shapes a posterior whose density there is more than a tenth of its largest. A prior without a bound is
    contradicted by a posterior whose median is more than two of its standard deviations from its centre.

    Args:
        samples: (n_samples, n_parameters) of the posterior, at least 100.
        priors: one a parameter.

    Raises:
        InputError: another shape, too few samples, values that are not finite.

    >>> draws = np.abs(np.random.default_rng(1).normal(0.0, 0.5, (4000, 1)))
    >>> print(presses_against(draws, [Prior("uniform", 0.0, 10.0)])[0].sentence)
    theta_1 presses against the lower end 0 of its uniform prior: widen the prior, or doubt the class
    """
    rows = np.asarray(samples, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(priors) or not np.isfinite(rows).all():
        raise InputError(
            f"samples have shape {rows.shape}: give finite numbers, one column for each of {len(priors)} prior(s)"
        )
    if len(rows) < 100:
        raise InputError(f"{len(rows)} samples say too little about an edge: give at least 100")
    found: list[Pressure] = []
    for number, (prior, column) in enumerate(zip(priors, np.sort(rows, axis=0).T, strict=True), start=1):
        found += _at_bounds(column, prior, number) if prior.family == "uniform" else _far_off(column, prior, number)
    return tuple(found)


def _at_bounds(column: FloatArray, prior: Prior, number: int) -> list[Pressure]:
    """`column` is sorted. Both densities are those of one width, a quarter of a robust standard deviation."""
    low, high = prior.support
    width = np.clip((np.quantile(column, 0.84) - np.quantile(column, 0.16)) / 8, (high - low) * 1e-9, (high - low) / 10)
    densest = np.max(np.searchsorted(column, column + width, side="right") - np.arange(column.size))
    found = []
    sides: tuple[tuple[Literal["lower", "upper"], float], ...] = (("lower", low), ("upper", high))
    for side, bound in sides:
        strength = float(np.count_nonzero(np.abs(column - bound) <= width) / densest)
        if strength > EDGE_DENSITY:
            sentence = (
                f"theta_{number} presses against the {side} end {bound:g} of its uniform prior: widen the prior, or "
                "doubt the class"
            )
            found.append(Pressure(number, side, strength, sentence))
    return found


def _far_off(column: FloatArray, prior: Prior, number: int) -> list[Pressure]:
    median = float(np.median(column))
    distance = np.log(median / prior.first) if prior.family == "lognormal" else median - prior.first
    score = float(distance / prior.second)
    if abs(score) <= FAR_SCORE:
        return []
    side: Literal["lower", "upper"] = "lower" if score < 0 else "upper"
    sentence = (
        f"theta_{number} lies {abs(score):.1f} standard deviations out on the {side} side of its {prior.family} prior: "
        "widen or move the prior, or doubt the class"
    )
    return [Pressure(number, side, abs(score), sentence)]


def _halves(samples: ArrayLike) -> FloatArray:
    """(2 n_chains, n // 2, n_parameters): the first and the second half of each chain; an odd one loses its middle."""
    array = np.asarray(samples, dtype=np.float64)
    if array.ndim != 3 or array.shape[1] < 4 or not array.size:
        raise InputError(
            f"samples have shape {array.shape}: give (chains, samples, parameters) with at least four samples a chain"
        )
    if not np.isfinite(array).all():
        raise InputError("samples are not all finite: a sampler never returns such, look at where they come from")
    half = array.shape[1] // 2
    return np.concatenate([array[:, :half], array[:, -half:]])


def _normal_scores(halves: FloatArray) -> FloatArray:
    """Ranks over all chains as quantiles of the normal distribution (Blom's)."""
    flat = halves.reshape(-1, halves.shape[-1])
    rank = stats.rankdata(flat, axis=0)
    return special.ndtri((rank - 0.375) / (len(flat) + 0.25)).reshape(halves.shape)


def _r_hat(halves: FloatArray) -> FloatArray:
    n = halves.shape[1]
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    between = halves.mean(axis=1).var(axis=0, ddof=1)
    ratio = np.divide(between, within, out=np.where(between > 0, np.inf, 1.0 / n), where=within > 0)
    return np.sqrt((n - 1) / n + ratio)


def _correlation_time(correlation: FloatArray, n_samples: int) -> float:
    """Geyer's initial monotone sequence of pairs of lags, and the even lag after it; (n,) from lag 0."""
    n = correlation.size
    n_pairs = 1 + len(range(1, n - 3, 2))  # that Stan looks at
    pairs = correlation[: 2 * n_pairs].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0)
    stop = int(negative[0]) if negative.size else n_pairs - 1
    falling = np.minimum.accumulate(pairs[:stop])
    time = -1.0 + 2.0 * float(falling.sum()) + max(float(correlation[2 * stop]), 0.0)
    # chains that repel themselves are worth more than their number, but not without end
    return max(time, 1.0 / np.log10(n_samples))
