"""Evidence of a model class: by the Laplace approximation and by quadrature, and how it depends on the priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg
from scipy.special import log_ndtr, logsumexp, ndtri_exp

from opid.errors import InputError, NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.model_class import ModelClass, Prior
from opid.updating.sampling.chains import (
    Chain,
    LogDensity,
    covariance_root,
    effective_samples,
    evaluate,
    posterior_density,
    presses_against,
)
from opid.updating.sampling.maximum import Maximum, Support, bounds_of, maximum_a_posteriori

FAR = 8.5  # standard deviations beyond which a bound cuts nothing off a normal distribution (1e-17)
LATTICE = 8191  # points of the rule that integrates a normal distribution over a box


@dataclass(frozen=True)
class Evidence:
    """Logarithm of the evidence p(D | M) by one method.

    Args:
        method: "laplace", "transitional" or "quadrature".
        log_evidence: its natural logarithm.
        std: its standard deviation, 0 where the method gives none.
    """

    method: str
    log_evidence: float
    std: float = 0.0


def laplace(maximum: Maximum, *, support: Support = None) -> Evidence:
    """Return the evidence of a posterior that is normal within its bounds (Song et al. 2021, eqs. 15-17).

    log p(D | M) = log p(D | theta) p(theta) - log N(theta | theta, Sigma) at the maximum a posteriori, with Sigma from
    the curvature there. Only the part of the normal distribution within the bounds counts; for a maximum at a bound
    slope and curvature put its centre outside. Exact for a normal distribution that a box cuts off.

    Args:
        maximum: of log likelihood plus log prior, both with all their constants.
        support: lower and upper end of each parameter; None if there are none.

    Raises:
        InputError: a support of another shape.
        NotDeterminedError: no curvature at the maximum.

    >>> from opid.updating.sampling.maximum import maximum_a_posteriori
    >>> peak = maximum_a_posteriori(lambda t: -0.5 * np.sum(t**2, axis=1), [1.0])
    >>> round(laplace(peak).log_evidence, 6)  # log(2 pi) / 2
    0.918939
    """
    covariance = maximum.covariance
    shift = covariance @ maximum.gradient
    value = maximum.log_density + 0.5 * float(maximum.gradient @ shift) + _log_volume(covariance)
    value += log_probability_inside(maximum.theta + shift, covariance, support)
    return Evidence("laplace", float(value))


def laplace_of_samples(log_density_at_best: float, best: FloatArray, chain: Chain) -> Evidence:
    """Return the evidence with mean and covariance of samples (Song et al. 2021, eq. 16), with its standard deviation.

    The density at `best`, (n_parameters,), has all its constants. The standard deviation is that of the determinant for
    the finite number of effective samples; it does not include the error for a posterior that is not normal. Where the
    posterior presses against a bound, take `laplace` or `quadrature` instead.
    """
    covariance, d = chain.covariance, chain.n_parameters
    root = covariance_root(covariance, d)
    score = linalg.solve_triangular(root, best - chain.pooled.mean(axis=0), lower=True)
    value = log_density_at_best + _log_volume(covariance) + 0.5 * float(score @ score)
    return Evidence("laplace", value, float(np.sqrt(d / (2 * effective_samples(chain.samples).min()))))


def quadrature(
    log_density: LogDensity,
    centre: ArrayLike,
    covariance: ArrayLike,
    *,
    support: Support = None,
    tolerance: float = 1e-6,
    max_evaluations: int = 1_000_000,
) -> Evidence:
    """Return the evidence as an integral by Gauss-Legendre nodes, for up to three parameters.

    The nodes lie in coordinates in which the covariance is the unit matrix, one parameter after the other, so that
    bounds of the parameters stay limits of the integrals. The window grows until its edges hold almost nothing; the
    nodes grow in number until the logarithm changes by less than the tolerance. That last change is the standard
    deviation.

    The density is log likelihood plus log prior with all their constants. `centre` and `covariance` are roughly those
    of the posterior; where it has several maxima, take those of samples, so that the window holds all of them.
    NotDeterminedError, with the last value as `partial`: more than `max_evaluations` rows of theta, or a density that
    is zero all around the centre.

    >>> quadrature(lambda t: -0.5 * np.sum(t**2, axis=1), [0.0], 1.0, support=[(0.0, np.inf)]).log_evidence
    0.2257913526...
    """
    middle = np.atleast_1d(np.asarray(centre, dtype=np.float64))
    if middle.ndim != 1 or not 1 <= middle.size <= 3:
        raise InputError(f"the centre has shape {middle.shape}: quadrature takes one to three parameters")
    root, bounds = covariance_root(covariance, middle.size), bounds_of(support, middle.size)
    window = np.tile([-7.0, 7.0], (middle.size, 1))
    n, asked, before = 16, 0, np.inf
    while True:
        theta, log_weight, open_edge = _nodes(n, middle, root, window, bounds)
        asked += len(theta)
        if asked > max_evaluations:
            break
        parts = log_weight + evaluate(log_density, theta) if len(theta) else np.array([-np.inf])
        value = float(logsumexp(parts))
        if np.isneginf(value):
            raise NotDeterminedError("the density is zero all around the centre: centre it on the posterior")
        at_edge = np.exp(parts - value) @ open_edge.reshape(len(parts), -1)
        spills = at_edge.reshape(middle.size, 2) > 0.1 * tolerance
        if spills.any():
            window, before = np.where(spills, 1.4 * window, window), np.inf
            continue
        if abs(value - before) < tolerance:
            return Evidence("quadrature", value, abs(value - before))
        n, before = n + n // 2, value
    raise NotDeterminedError(
        f"the integral did not converge to {tolerance:g} within {max_evaluations} evaluations: the posterior has "
        "steps, long tails or several maxima; draw more samples, which tell how far it reaches, or take the "
        "transitional evidence",
        partial=before,
    )


def log_probability_inside(mean: FloatArray, covariance: FloatArray, support: Support) -> float:
    """Return the logarithm of the probability of a normal distribution within a box, right in far tails, too.

    One parameter after the other is integrated, each given those before it (Genz 1992), on a lattice that is not
    random; scipy has no logarithm of it.

    >>> round(float(np.exp(log_probability_inside(np.zeros(2), np.eye(2), [(0, np.inf), (0, np.inf)]))), 6)
    0.25
    """
    low, high = bounds_of(support, mean.size)
    deviation = np.sqrt(np.diag(covariance))
    low, high = (low - mean) / deviation, (high - mean) / deviation
    near = np.flatnonzero((low > -FAR) | (high < FAR))
    if not near.size:
        return 0.0
    near = near[np.argsort(_log_between(low[near], high[near]))]  # the tightest first
    low, high = low[near], high[near]
    root = linalg.cholesky((covariance / np.outer(deviation, deviation))[np.ix_(near, near)], lower=True)
    primes = np.array([p for p in range(2, 300) if all(p % q for q in range(2, p))][: near.size])
    lattice = np.abs(2 * np.modf(np.arange(1, LATTICE + 1)[:, None] * np.sqrt(primes))[0] - 1)
    quantiles = np.zeros((LATTICE, near.size))
    total = np.zeros(LATTICE)
    for k in range(near.size):
        given = quantiles[:, :k] @ root[k, :k]
        left, right = (low[k] - given) / root[k, k], (high[k] - given) / root[k, k]
        inside = _log_between(left, right)
        total += inside
        # quantiles from the side of the tail
        flip = left + right > 0
        tail = np.where(flip, -right, left)
        tail_of = np.logaddexp(log_ndtr(tail), np.log(np.clip(lattice[:, k], 1e-12, 1.0)) + inside)
        quantiles[:, k] = np.where(flip, -1.0, 1.0) * ndtri_exp(np.minimum(tail_of, -1e-300))
    return float(logsumexp(total)) - np.log(LATTICE)


def _log_between(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return log(Phi(right) - Phi(left)), from the side on which both are small."""
    flip = left + right > 0
    a, b = np.where(flip, -right, left), np.where(flip, -left, right)
    upper, lower = log_ndtr(b), log_ndtr(a)
    return upper + np.log(-np.expm1(np.minimum(lower - upper, -1e-16)))


def _log_volume(covariance: FloatArray) -> float:
    """Return -log N(theta | theta, covariance)."""
    return 0.5 * float(np.linalg.slogdet(2 * np.pi * covariance)[1])


def _nodes(
    n: int, centre: FloatArray, root: FloatArray, window: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes (m, d), log weights (m,), and which are at an edge of the window that is no bound, (m, d, 2)."""
    x, weight = np.polynomial.legendre.leggauss(n)
    outer = np.stack([x < -0.9, x > 0.9], axis=1)
    u = np.zeros((1, 0))
    log_weight = np.full(1, float(np.sum(np.log(np.diag(root)))))
    edge = np.zeros((1, 0, 2), dtype=bool)
    for k in range(centre.size):
        middle = centre[k] + u @ root[k, :k]
        low, high = (bounds[0][k] - middle) / root[k, k], (bounds[1][k] - middle) / root[k, k]
        left, right = np.maximum(low, window[k, 0]), np.minimum(high, window[k, 1])
        kept = right > left
        left, right = left[kept], right[kept]
        half = 0.5 * (right - left)
        new = 0.5 * (left + right)[:, None] + half[:, None] * x
        limited = np.stack([left > low[kept], right < high[kept]], axis=1)  # by the window
        new_edge = outer[None] & limited[:, None, :]  # (rows, n, 2)
        u = np.concatenate([np.repeat(u[kept], n, axis=0), new.reshape(-1, 1)], axis=1)
        log_weight = (log_weight[kept, None] + np.log(half)[:, None] + np.log(weight)).ravel()
        edge = np.concatenate([np.repeat(edge[kept], n, axis=0), new_edge.reshape(-1, 1, 2)], axis=1)
    return centre + u @ root.T, log_weight, edge


# ---- the priors ------------------------------------------------------------------------------------


def prior_sensitivity(
    likelihood: LogDensity, model_class: ModelClass, samples: FloatArray, best: FloatArray
) -> dict[str, float]:
    """Return the change of the log evidence with each prior twice as wide, by parameter: "theta_1", "theta_2", ...

    Samples are those of the posterior, (n_samples, n_parameters), and `best` is the maximum a posteriori.
    """
    pressed = {each.parameter for each in presses_against(samples, model_class.priors)}
    found = {}
    for k, prior in enumerate(model_class.priors):
        if k + 1 not in pressed or prior.family != "uniform":
            # the posterior has almost nothing outside the narrow prior: a mean over the samples is enough
            ratio = prior.wider.log_density(samples[:, k]) - prior.log_density(samples[:, k])
            change = float(np.logaddexp.reduce(ratio) - np.log(len(ratio)))
        else:
            change = _change_beyond(likelihood, model_class, k, prior.wider, best)
        found[f"theta_{k + 1}"] = change
    return found


def _change_beyond(likelihood: LogDensity, model_class: ModelClass, k: int, wide: Prior, best: FloatArray) -> float:
    """Return the change by two Laplace approximations, for a posterior that goes on beyond the prior; nan for none."""
    priors = (*model_class.priors[:k], wide, *model_class.priors[k + 1 :])
    values = []
    for each in (model_class, replace(model_class, priors=priors)):
        support = [prior.support for prior in each.priors]
        try:
            peak = maximum_a_posteriori(posterior_density(likelihood, each.log_prior), best, support=support)
            values.append(laplace(peak, support=support).log_evidence)
        except NotDeterminedError:
            return float("nan")
    return values[1] - values[0]
