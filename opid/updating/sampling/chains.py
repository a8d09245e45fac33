"""Markov chains: their records, the checks that every sampler makes, diagnostics, and the export to ArviZ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, linalg, special, stats

from opid.errors import InputError
from opid.estimate import Estimate
from opid.provenance import time_of_writing
from opid.signals.recording import FloatArray
from opid.updating.model_class import Prior

LogDensity = Callable[[FloatArray], FloatArray]
"""theta (n, n_parameters) -> (n,) logarithm of a density, up to a constant; -inf outside the support, never nan."""

Progress = Callable[[float], None]  # called with the fraction that is done, from 0 to 1


@dataclass(frozen=True, eq=False)
class Chain:
    """The samples of several chains without their warm-up.

    Args:
        samples: (n_chains, n, n_parameters) samples.
        log_density: (n_chains, n) logarithm of the density of the samples.
        acceptance: fraction of the proposals that were taken, of all chains after the warm-up.
        n_evaluations: number of rows of theta at which the density was evaluated, the warm-up included.
        sampler: name of the method.
        n_warm_up: number of samples of each chain that were dropped.
        divergent: fraction of the samples at which a walk along the slope went astray; 0 for samplers without slopes.
    """

    samples: FloatArray
    log_density: FloatArray
    acceptance: float
    n_evaluations: int
    sampler: str
    n_warm_up: int
    divergent: float = 0.0

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return self.samples.shape[-1]

    @property
    def pooled(self) -> FloatArray:
        """(n_chains n, n_parameters) samples of all chains, one after the other."""
        return self.samples.reshape(-1, self.n_parameters)

    @property
    def covariance(self) -> FloatArray:
        """(n_parameters, n_parameters) covariance of the pooled samples."""
        return np.atleast_2d(np.cov(self.pooled, rowvar=False))

    @property
    def best(self) -> FloatArray:
        """(n_parameters,) sample with the largest density."""
        return self.pooled[int(np.argmax(self.log_density))]

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, n_parameters) samples, drawn with replacement."""
        return self.pooled[rng.integers(len(self.pooled), size=n)]

    def thinned(self, n: int) -> FloatArray:
        """(n, n_parameters) samples, evenly spaced over all chains; all of them where there are fewer."""
        rows = np.linspace(0, len(self.pooled) - 1, min(n, len(self.pooled)))
        return self.pooled[np.round(rows).astype(np.intp)]


@dataclass(frozen=True)
class Diagnostics:
    """How well a posterior was sampled.

    Args:
        sampler: name of the method.
        n_samples: number of samples of all chains that were kept.
        n_evaluations: number of evaluations of the posterior.
        acceptance: fraction of the proposals that were taken.
        effective_samples: number of effective samples, the least of all parameters.
        r_hat: R-hat, the largest of all parameters (1 is converged); nan for a single chain.
        divergent: fraction of the samples at which a walk along the slope went astray; 0 for samplers without slopes.
    """

    sampler: str
    n_samples: int
    n_evaluations: int
    acceptance: float
    effective_samples: float
    r_hat: float
    divergent: float = 0.0


@dataclass(frozen=True)
class Pressure:
    """A prior that the posterior presses against."""

    parameter: int  # number of the parameter, from 1
    side: Literal["lower", "upper"]  # "lower" or "upper"
    sentence: str  # the warning, without the name of the parameter at its beginning


# ---- checks of every sampler -----------------------------------------------------------------------


def evaluate(log_density: LogDensity, theta: FloatArray) -> FloatArray:
    """Return the log density of each row; InputError, with the theta, for nan, inf or another shape."""
    value = np.asarray(log_density(theta), dtype=np.float64)
    if value.shape != (len(theta),):
        raise InputError(
            f"the log density of theta with shape {theta.shape} has shape {value.shape}: return one number for each "
            f"row, shape {(len(theta),)}"
        )
    wrong = ~(value < np.inf)  # nan compares as False
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"the log density is {value[row]} at theta = {write_theta(theta[row])}: return a finite number, or -inf "
            "where theta is impossible"
        )
    return value


def posterior_density(log_likelihood: LogDensity, log_prior: LogDensity) -> LogDensity:
    """Return the sum of both; the likelihood is only evaluated where the prior is not zero."""

    def posterior(theta: FloatArray) -> FloatArray:
        value = log_prior(theta)
        inside = np.isfinite(value)
        if inside.any():
            value[inside] += log_likelihood(theta[inside])
        return value

    return posterior


def starting_densities(log_density: LogDensity, start: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the starts as rows, (n_chains, n_parameters), all within the support, and their densities, (n_chains,)."""
    rows = np.array(start, dtype=np.float64, ndmin=2)
    if rows.ndim != 2 or not rows.size or not np.isfinite(rows).all():
        raise InputError(
            f"the start has shape {rows.shape}: give finite numbers, one row for each chain and one column for each "
            "parameter"
        )
    value = evaluate(log_density, rows)
    if not np.isfinite(value).all():
        row = int(np.argmin(value))
        raise InputError(
            f"chain {row + 1} starts outside the support, at theta = {write_theta(rows[row])}: start where the density "
            "is not zero, for example at draws of the prior"
        )
    return rows, value


def spread_starts(
    log_density: LogDensity, centre: ArrayLike, covariance: ArrayLike, *, n_chains: int, rng: np.random.Generator
) -> FloatArray:
    """Return starts scattered twice as widely as the posterior, (n_chains, n_parameters), all inside the support.

    The centre is usually the maximum a posteriori, and the covariance that of the Laplace approximation.
    """
    middle = starting_densities(log_density, centre)[0][0]
    root = 2.0 * covariance_root(covariance, middle.size)
    kept: list[FloatArray] = []
    for _ in range(50):
        candidates = middle + rng.standard_normal((4 * n_chains, middle.size)) @ root.T
        kept.extend(candidates[np.isfinite(evaluate(log_density, candidates))])
        if len(kept) >= n_chains:
            return np.array(kept[:n_chains])
        root = 0.7 * root  # the support is narrower than the covariance
    raise InputError(
        "no start was found near the centre: it lies at the edge of the support, or the covariance is wrong; give "
        "another centre or covariance"
    )


def covariance_root(covariance: ArrayLike, n_parameters: int) -> FloatArray:
    """Return the lower triangular root of a covariance; a number or (n_parameters,) variances make a diagonal one.

    >>> covariance_root(4.0, 2).tolist()
    [[2.0, 0.0], [0.0, 2.0]]
    """
    matrix = np.array(covariance, dtype=np.float64)
    if matrix.ndim < 2 and matrix.size in (1, n_parameters):
        matrix = np.diag(np.broadcast_to(matrix, n_parameters))
    if matrix.shape != (n_parameters, n_parameters):
        raise InputError(f"the covariance has shape {matrix.shape}: give {(n_parameters, n_parameters)}")
    if not np.isfinite(matrix).all() or np.abs(matrix - matrix.T).max() > 1e-8 * np.abs(matrix).max():
        raise InputError("the covariance is not symmetric or not finite: take that of the Laplace approximation")
    try:
        return linalg.cholesky(matrix, lower=True)
    except linalg.LinAlgError:
        raise InputError("the covariance is not positive definite: every parameter needs a variance above 0") from None


def require_count(value: int, name: str, *, least: int) -> int:
    """Return a whole number of at least `least`; InputError for another one."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name} is {value!r}: give a whole number of at least {least}")
    return int(value)


def write_theta(theta: FloatArray) -> str:
    """Write one theta, (n_parameters,), as a message shows it: "(1.5, -2)"."""
    return "(" + ", ".join(f"{value:.6g}" for value in theta) + ")"


# ---- diagnostics -----------------------------------------------------------------------------------


def diagnose(chain: Chain) -> Diagnostics:
    """Return how well a posterior was sampled."""
    n_chains, n, _ = chain.samples.shape
    return Diagnostics(
        sampler=chain.sampler,
        n_samples=n_chains * n,
        n_evaluations=chain.n_evaluations,
        acceptance=chain.acceptance,
        effective_samples=float(effective_samples(chain.samples).min()),
        r_hat=float(split_r_hat(chain.samples).max()) if n_chains > 1 else float("nan"),
        divergent=chain.divergent,
    )


def estimates_of(chain: Chain, names: Sequence[str]) -> dict[str, Estimate]:
    """Return mean, standard deviation and 95 % interval of each parameter, by its name."""
    low, high = np.quantile(chain.pooled, [0.025, 0.975], axis=0).tolist()
    mean, std = chain.pooled.mean(axis=0).tolist(), chain.pooled.std(axis=0, ddof=1).tolist()
    return {name: Estimate(mean[k], std[k], (low[k], high[k])) for k, name in enumerate(names)}


def effective_samples(samples: ArrayLike, *, ranked: bool = True) -> FloatArray:
    """Return the number of independent samples, (n_parameters,), that chains (n_chains, n, n_parameters) are worth.

    Each chain is cut in halves. The autocorrelation over all halves is summed as far as pairs of lags are positive, and
    made monotone (Geyer 1992), as in Stan and ArviZ (Vehtari et al. 2021); a plain installation has no ArviZ. With
    `ranked` it is that of the normal scores of ranks ("bulk"), which is right for heavy tails, too; otherwise that of
    the samples. The walkers of an ensemble count as chains although they depend on each other. Chains that never move
    are worth a single sample.
    """
    halves = _find_normal_scores(_cut_in_halves(samples)) if ranked else _cut_in_halves(samples)
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
    times = np.array([_find_correlation_time(each, n_chains * n) for each in correlation.T])
    return np.where(still, 1.0, n_chains * n / times)


def split_r_hat(samples: ArrayLike) -> FloatArray:
    """Return the rank-normalised split R-hat of chains (n_chains, n, n_parameters); 1 is converged.

    It is the larger one of those of location and spread (Vehtari et al. 2021), (n_parameters,). A chain that stands
    still while others move gives a large number.
    """
    halves = _cut_in_halves(samples)
    folded = np.abs(halves - np.median(halves, axis=(0, 1)))
    return np.maximum(_find_r_hat(_find_normal_scores(halves)), _find_r_hat(_find_normal_scores(folded)))


def _cut_in_halves(samples: ArrayLike) -> FloatArray:
    """Return the first and the second half of each chain, (2 n_chains, n // 2, n_parameters), without an odd middle."""
    array = np.asarray(samples, dtype=np.float64)
    if array.ndim != 3 or array.shape[1] < 4 or not array.size:
        raise InputError(
            f"samples have shape {array.shape}: give (chains, samples, parameters) with at least four samples in each "
            "chain"
        )
    if not np.isfinite(array).all():
        raise InputError("some samples are not finite, which no sampler returns: check where they come from")
    half = array.shape[1] // 2
    return np.concatenate([array[:, :half], array[:, -half:]])


def _find_normal_scores(halves: FloatArray) -> FloatArray:
    """Return the ranks over all chains as quantiles of the normal distribution (Blom)."""
    flat = halves.reshape(-1, halves.shape[-1])
    rank = stats.rankdata(flat, axis=0)
    return special.ndtri((rank - 0.375) / (len(flat) + 0.25)).reshape(halves.shape)


def _find_r_hat(halves: FloatArray) -> FloatArray:
    n = halves.shape[1]
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    between = halves.mean(axis=1).var(axis=0, ddof=1)
    ratio = np.divide(between, within, out=np.where(between > 0, np.inf, 1.0 / n), where=within > 0)
    return np.sqrt((n - 1) / n + ratio)


def _find_correlation_time(correlation: FloatArray, n_samples: int) -> float:
    """Return the sum over Geyer's initial monotone sequence of pairs of lags, and the even lag after it."""
    n = correlation.size
    n_pairs = 1 + len(range(1, n - 3, 2))  # the number that Stan takes
    pairs = correlation[: 2 * n_pairs].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0)
    stop = int(negative[0]) if negative.size else n_pairs - 1
    falling = np.minimum.accumulate(pairs[:stop])
    time = -1.0 + 2.0 * float(falling.sum()) + max(float(correlation[2 * stop]), 0.0)
    # Anticorrelated samples are worth more than their number, but Stan limits how much.
    return max(time, 1.0 / np.log10(n_samples))


# ---- the influence of the prior --------------------------------------------------------------------


def find_pressures(samples: ArrayLike, priors: Sequence[Prior]) -> tuple[Pressure, ...]:
    """Return which priors the samples of a posterior, (n_samples, n_parameters), press against, and on which side.

    A posterior presses against a bound where its density is more than a tenth of its largest, and against a prior
    without bounds if its median is more than two standard deviations of the prior from the centre of the prior.

    >>> samples = np.abs(np.random.default_rng(1).normal(0.0, 0.5, (4000, 1)))
    >>> print(find_pressures(samples, [Prior("uniform", 0.0, 10.0)])[0].sentence)
    presses against the lower end 0 of its uniform prior: widen the prior, or try another class
    """
    rows = np.asarray(samples, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(priors) or not np.isfinite(rows).all():
        raise InputError(
            f"samples have shape {rows.shape}: give finite numbers, one column for each of {len(priors)} prior(s)"
        )
    if len(rows) < 100:
        raise InputError(f"{len(rows)} samples are too few to judge the edge of a prior: give at least 100")
    found: list[Pressure] = []
    for number, (prior, column) in enumerate(zip(priors, np.sort(rows, axis=0).T, strict=True), start=1):
        found += (
            _check_bounds(column, prior, number)
            if prior.family == "uniform"
            else _check_distance(column, prior, number)
        )
    return tuple(found)


def _check_bounds(column: FloatArray, prior: Prior, number: int) -> list[Pressure]:
    """Compare densities over one width, a quarter of a robust standard deviation, of a sorted column."""
    low, high = prior.support
    width = np.clip((np.quantile(column, 0.84) - np.quantile(column, 0.16)) / 8, (high - low) * 1e-9, (high - low) / 10)
    densest = np.max(np.searchsorted(column, column + width, side="right") - np.arange(column.size))
    found = []
    sides: tuple[tuple[Literal["lower", "upper"], float], ...] = (("lower", low), ("upper", high))
    for side, bound in sides:
        if np.count_nonzero(np.abs(column - bound) <= width) / densest > 0.1:
            words = (
                f"presses against the {side} end {bound:g} of its uniform prior: widen the prior, or try another class"
            )
            found.append(Pressure(number, side, words))
    return found


def _check_distance(column: FloatArray, prior: Prior, number: int) -> list[Pressure]:
    median = float(np.median(column))
    distance = np.log(median / prior.first) if prior.family == "lognormal" else median - prior.first
    score = float(distance / prior.second)
    if abs(score) <= 2.0:
        return []
    side: Literal["lower", "upper"] = "lower" if score < 0 else "upper"
    words = (
        f"lies {abs(score):.1f} standard deviations out on the {side} side of its {prior.family} prior: widen or move "
        "the prior, or try another class"
    )
    return [Pressure(number, side, words)]


# ---- ArviZ -----------------------------------------------------------------------------------------


def to_inference_data(chain: Chain, names: Sequence[str]) -> Any:
    """Return ArviZ's own object where ArviZ is installed (`pip install '.[bayes]'`), otherwise a dict of its groups.

    That object is an `InferenceData` before ArviZ 1.0 and a `DataTree` of xarray since; the dict is
    {"posterior": {name: (n_chains, n)}, "sample_stats": {"lp": (n_chains, n)}}.

    Args:
        chain: chain of any sampler.
        names: one name for each parameter.

    Raises:
        InputError: a name that is missing or given twice.
    """
    if len(names) != chain.n_parameters or len(set(names)) < len(names):
        raise InputError(
            f"names are {list(names)}: give {chain.n_parameters} different name(s), one for each parameter"
        )
    posterior = {name: np.array(chain.samples[:, :, k]) for k, name in enumerate(names)}
    groups = {"posterior": posterior, "sample_stats": {"lp": np.array(chain.log_density)}}
    try:
        import arviz
    except ImportError:
        return groups
    # The signature of from_dict differs between versions, and groups were a method.
    from_dict: Any = arviz.from_dict
    is_old = int(arviz.__version__.split(".")[0]) < 1
    found = from_dict(**groups) if is_old else from_dict(groups)
    for group in found.groups() if is_old else found.groups:
        found[group].attrs["created_at"] = time_of_writing()
    return found
