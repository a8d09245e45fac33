"""The maximum of a posterior, its evidence by Laplace and by quadrature, and the influence of the priors on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg
from scipy.special import gammaln, log_ndtr, logsumexp, ndtri_exp

from opid.errors import InputError, NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.model_class import ModelClass, Prior
from opid.updating.sampling.chains import (
    Chain,
    LogDensity,
    covariance_root,
    effective_samples,
    evaluate,
    find_pressures,
    posterior_density,
    write_theta,
)
from opid.updating.settings import UPDATING

Support = Sequence[tuple[float, float]] | FloatArray | None  # (lower, upper) of each parameter, or none


@dataclass(frozen=True, eq=False)
class Maximum:
    """The maximum of a log density, with its slope and curvature there."""

    theta: FloatArray  # (n_parameters,) parameters at the maximum
    log_density: float  # logarithm of the density at theta
    gradient: FloatArray  # (n_parameters,) gradient of the log density; 0 except at a bound
    hessian: FloatArray  # (n_parameters, n_parameters) Hessian of the log density, by central differences
    at_bound: FloatArray  # (n_parameters,) -1 at the lower bound, 1 at the upper one, 0 between
    n_evaluations: int  # number of rows of theta that were evaluated

    @property
    def covariance(self) -> FloatArray:
        """(n_parameters, n_parameters) of the normal distribution of this curvature.

        Where a maximum at a bound has no curvature, the slope limits it.
        """
        return _invert(self.precision)

    @property
    def covariance_inside(self) -> FloatArray:
        """(n_parameters, n_parameters) of roughly the part within the bounds, for starts and proposals of chains.

        At a bound a steep density falls off as an exponential over the length 1 / slope, however small its curvature.
        """
        return _invert(self.precision + np.diag(self._steep))

    @property
    def _steep(self) -> FloatArray:
        return np.where(self.at_bound != 0, self.gradient**2, 0.0)

    @property
    def precision(self) -> FloatArray:
        """Inverse of `covariance`: the curvature, made positive with the slopes at bounds where it is not."""
        for fraction in (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0):
            matrix = -self.hessian + fraction * np.diag(self._steep)
            scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
            if scale.all() and linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > 1e-12:
                return matrix
        raise NotDeterminedError(
            "the log density has no curvature at its maximum: the data do not determine a parameter, leave it out"
        )


def _invert(precision: FloatArray) -> FloatArray:
    """Return the inverse for parameters that may have very different sizes."""
    scale = np.sqrt(np.diag(precision))
    return np.asarray(linalg.inv(precision / np.outer(scale, scale)) / np.outer(scale, scale))


def read_bounds(support: Support, n_parameters: int) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper ends, each (n_parameters,); InputError for another shape, or ends in the wrong order."""
    if support is None:
        return np.full(n_parameters, -np.inf), np.full(n_parameters, np.inf)
    pairs = np.array(support, dtype=np.float64)
    if pairs.shape != (n_parameters, 2) or not (pairs[:, 0] < pairs[:, 1]).all():
        raise InputError(
            f"the support is {pairs.tolist()}: give (lower, upper) for each of {n_parameters} parameter(s)"
        )
    return pairs[:, 0], pairs[:, 1]


def maximum_a_posteriori(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    support: Support = None,
    tolerance: float = 1e-10,
    max_iterations: int = 200,
) -> Maximum:
    """Return the maximum of a log density that is smooth within its support.

    Each iteration evaluates all points of a stencil at once, takes the Newton step of its quadratic within the bounds,
    and tries many fractions of that step at once. The stencil is scaled to a twentieth of a standard deviation. Of
    several maxima it finds one that is higher than the best start: give draws of the prior as starts where there may be
    several. Theta is right to about a thousandth of a standard deviation, limited by the size of the stencil.

    Args:
        log_density: function (n, n_parameters) -> (n,), up to a constant; -inf outside the support.
        start: (n_parameters,) start, or (n, n_parameters) starts, of which the best is taken.
        support: lower and upper end of each parameter, for example `[prior.support for prior in priors]`.
        tolerance: largest distance of the logarithm from the maximum.
        max_iterations: number of iterations after which the search gives up.

    Raises:
        InputError: no start inside the support, or a log density of another shape or not a number.
        NotDeterminedError: no maximum: the density is flat along a parameter, or ends where no bound was stated; its
            `partial` is the best theta.

    >>> peak = maximum_a_posteriori(lambda t: -0.5 * np.sum((t - 3) ** 2, axis=1), [0.0], support=[(0.0, 10.0)])
    >>> peak.theta.round(6).tolist(), peak.covariance.round(6).tolist()
    ([3.0], [[1.0]])
    """
    rows = np.array(start, dtype=np.float64, ndmin=2)
    if rows.ndim != 2 or not rows.size or not np.isfinite(rows).all():
        raise InputError(f"the start has shape {rows.shape}: give finite numbers, (n_parameters,) or (n, n_parameters)")
    low, high = read_bounds(support, rows.shape[1])
    rows = rows[np.all((rows >= low) & (rows <= high), axis=1)]
    values = evaluate(log_density, rows) if len(rows) else np.array([])
    if not np.isfinite(values).any():
        raise InputError(
            "no start lies inside the support: start where the density is not zero, for example at draws of the prior"
        )
    theta, value, counted = rows[int(np.argmax(values))], float(values.max()), len(rows)
    widest = np.where(np.isfinite(high - low), (high - low) / 4, np.inf)
    step = np.minimum(0.01 * np.where(np.isfinite(widest), 4 * widest, np.maximum(np.abs(theta), 1.0)), widest)
    fractions = 2.0 ** np.arange(4, -15, -1)[:, None]  # fractions of a Newton step
    for _ in range(max_iterations):
        middle = np.clip(theta, low + step, high - step)  # the whole stencil then lies inside
        points = middle + step * _make_stencil(theta.size)
        f = evaluate(log_density, points)
        counted += len(points)
        candidates, found, change = points, f, np.array(0.25)
        if np.isfinite(f).all():
            slope, curvature = _fit_quadratic(f, theta.size)
            slope = slope + curvature @ ((theta - middle) / step)
            fixed = ((theta <= low) & (slope < 0)) | ((theta >= high) & (slope > 0))
            direction, gain, peaked = _find_newton_step(slope, curvature, ~fixed)
            change = _scale_stencil(slope, curvature, fixed)
            is_scaled = bool(np.all((change > 0.5) & ((change < 2.0) | (step >= widest))))
            is_near = peaked and is_scaled and gain < STALLED
            is_found = is_near and gain < max(tolerance, 1e-14 * abs(value))
            if not is_found:
                along = np.clip(theta + fractions * direction * step, low, high)
                candidates, found = np.concatenate([points, along]), np.concatenate([f, evaluate(log_density, along)])
                counted += len(along)
            if is_found or (is_near and found.max() <= value):
                side = np.where(fixed, np.where(theta <= low, -1.0, 1.0), 0.0)
                hessian = curvature / np.outer(step, step)
                return Maximum(theta, value, np.where(fixed, slope / step, 0.0), hessian, side, counted)
        best = int(np.argmax(found))
        if found[best] > value:
            theta, value = candidates[best], float(found[best])
        step = np.minimum(step * change, widest)
    raise NotDeterminedError(
        f"no maximum was found in {max_iterations} steps; the best was theta = {write_theta(theta)}: the density may "
        "be flat there, or end where no bound was stated (give the support)",
        partial=theta,
    )


# Gain of the log density that a quadratic may still predict where no point is higher: the third derivative tilts the
# stencil, and theta is right to a thousandth of a standard deviation.
STALLED = 1e-6


def _make_stencil(d: int) -> FloatArray:
    """Return the stencil, (1 + 2 d + 2 d (d - 1), d): the middle, a step along each axis, the corners of each plane."""
    axes = np.eye(d)
    rows = [np.zeros((1, d)), axes, -axes]
    for i in range(d):
        for j in range(i):
            rows.append(np.array([s * axes[i] + t * axes[j] for s, t in ((1, 1), (-1, -1), (1, -1), (-1, 1))]))
    return np.concatenate(rows)


def _fit_quadratic(f: FloatArray, d: int) -> tuple[FloatArray, FloatArray]:
    """Return slope and curvature in steps of the stencil."""
    ahead, behind = f[1 : 1 + d], f[1 + d : 1 + 2 * d]
    curvature = np.diag(ahead + behind - 2 * f[0])
    rows, columns = np.tril_indices(d, -1)
    corners = f[1 + 2 * d :].reshape(-1, 4)
    curvature[rows, columns] = curvature[columns, rows] = corners @ [0.25, 0.25, -0.25, -0.25]
    return (ahead - behind) / 2, curvature


def _find_newton_step(slope: FloatArray, curvature: FloatArray, free: np.ndarray) -> tuple[FloatArray, float, bool]:
    """Return the direction uphill, the gain that the quadratic predicts, and whether it has a peak at all."""
    direction = np.zeros(slope.size)
    if not free.any():
        return direction, 0.0, True
    values, vectors = linalg.eigh(-curvature[np.ix_(free, free)])
    sizes = np.maximum(np.abs(values), max(1e-10 * np.abs(values).max(), 1e-300))
    parts = vectors.T @ slope[free]
    direction[free] = np.clip(vectors @ (parts / sizes), -1e4, 1e4)
    return direction, 0.5 * float(np.sum(parts**2 / sizes)), bool(values[0] > 0)


def _scale_stencil(slope: FloatArray, curvature: FloatArray, fixed: np.ndarray) -> FloatArray:
    """Return the factor that brings each step of the stencil towards a twentieth of a standard deviation.

    Such a step is long enough to rise above the numerical noise of a model.
    """
    bend = np.sqrt(np.maximum(-np.diag(curvature), 0.0))
    size = np.maximum(bend, np.where(fixed, np.abs(slope), 0.0))
    return np.clip(0.05 / np.maximum(size, 1e-300), 1 / 8, 8.0)


FAR = 8.5  # standard deviations beyond which a bound cuts nothing off a normal distribution (1e-17)
LATTICE = 8191  # points of the rule that integrates a normal distribution over a box


@dataclass(frozen=True)
class Evidence:
    """Logarithm of the evidence p(D | M) by one method.

    Args:
        method: "laplace", "transitional", "importance" or "quadrature".
        log_evidence: natural logarithm of the evidence.
        std: standard deviation of that logarithm, 0 where the method gives none.
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
        maximum: maximum of log likelihood plus log prior, both with all their constants.
        support: lower and upper end of each parameter; None if there are none.

    Raises:
        InputError: a support of another shape.
        NotDeterminedError: no curvature at the maximum.

    >>> from opid.updating.sampling.evidence import maximum_a_posteriori
    >>> peak = maximum_a_posteriori(lambda t: -0.5 * np.sum(t**2, axis=1), [1.0])
    >>> round(laplace(peak).log_evidence, 6)  # log(2 pi) / 2
    0.918939
    """
    covariance = maximum.covariance
    shift = covariance @ maximum.gradient
    value = maximum.log_density + 0.5 * float(maximum.gradient @ shift) + _find_log_volume(covariance)
    value += log_probability_inside(maximum.theta + shift, covariance, support)
    return Evidence("laplace", float(value))


def laplace_of_samples(log_density_at_best: float, best: FloatArray, chain: Chain) -> Evidence:
    """Return the evidence with mean and covariance of samples (Song et al. 2021, eq. 16), with its standard deviation.

    The density at `best`, (n_parameters,), has all its constants. The standard deviation is that of the determinant for
    the finite number of effective samples; it does not include the error for a posterior that is not normal. Where the
    posterior presses against a bound, take `laplace` or `quadrature` instead. NotDeterminedError: samples that do not
    scatter in one direction.
    """
    d, (deviation, root) = chain.n_parameters, _find_scatter(chain)
    score = linalg.solve_triangular(root, (best - chain.pooled.mean(axis=0)) / deviation, lower=True)
    value = log_density_at_best + 0.5 * (d * np.log(2 * np.pi) + float(score @ score)) + _log_size(deviation, root)
    return Evidence("laplace", value, float(np.sqrt(d / (2 * effective_samples(chain.samples).min()))))


def importance(log_density: LogDensity, chain: Chain, *, rng: np.random.Generator, n_draws: int = 2000) -> Evidence:
    """Return the evidence as the mean of density over proposal, for draws of a Student t distribution about samples.

    The proposal has mean and covariance of the samples and wide tails (five degrees of freedom), so that the weights
    are bounded where the density falls off as a normal one. It needs no bounds: draws outside the support weigh
    nothing. The standard deviation follows from the scatter of the weights.

    Args:
        log_density: log likelihood plus log prior with all their constants.
        chain: samples of the density.
        rng: source of chance.
        n_draws: number of draws.

    Raises:
        NotDeterminedError: the draws are worth too few, for the density is far from a normal one; or the samples do
            not scatter in one direction.

    >>> rng = np.random.default_rng(1)
    >>> samples = rng.standard_normal((4, 500, 2))
    >>> chain = Chain(samples, np.zeros((4, 500)), 1.0, 0, "exact", 0)
    >>> found = importance(lambda t: -0.5 * np.sum(t**2, axis=1), chain, rng=rng)
    >>> abs(found.log_evidence - np.log(2 * np.pi)) < 4 * found.std < 0.1
    True
    """
    nu, d, (deviation, root) = UPDATING.proposal_freedom, chain.n_parameters, _find_scatter(chain)
    # Parameters may have very different sizes: the proposal is made in units of their standard deviations.
    stretch = np.sqrt((nu - 2) / rng.chisquare(nu, size=(n_draws, 1)))
    score = stretch * rng.standard_normal((n_draws, d))
    theta = chain.pooled.mean(axis=0) + deviation * (score @ root.T)
    log_proposal = gammaln((nu + d) / 2) - gammaln(nu / 2) - 0.5 * d * np.log((nu - 2) * np.pi)
    log_proposal -= _log_size(deviation, root) + 0.5 * (nu + d) * np.log1p(np.sum(score**2, axis=1) / (nu - 2))
    log_weight = evaluate(log_density, theta) - log_proposal
    if np.isneginf(log_weight).all():
        raise NotDeterminedError("no draw about the samples has a density: the samples are not of this density")
    total = float(logsumexp(log_weight))
    weight = np.exp(log_weight - total)
    worth = 1 / float(weight @ weight)
    if worth < UPDATING.least_worth * n_draws:
        raise NotDeterminedError(
            f"{n_draws} draws about the samples are worth only {worth:.0f}: the posterior is far from a normal "
            "distribution, which the transitional sampler does not mind"
        )
    return Evidence("importance", total - float(np.log(n_draws)), float(np.sqrt(1 / worth - 1 / n_draws)))


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
    root, bounds = covariance_root(covariance, middle.size), read_bounds(support, middle.size)
    window = np.tile([-7.0, 7.0], (middle.size, 1))
    n, asked, before = 16, 0, np.inf
    while True:
        theta, log_weight, open_edge = _place_nodes(n, middle, root, window, bounds)
        asked += len(theta)
        if asked > max_evaluations:
            break
        parts = log_weight + evaluate(log_density, theta) if len(theta) else np.array([-np.inf])
        value = float(logsumexp(parts))
        if np.isneginf(value):
            raise NotDeterminedError("the density is zero all around the centre: give the centre of the posterior")
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
        "steps, long tails or several maxima, which the transitional sampler does not mind; draw more samples, which "
        "show how far it reaches",
        partial=before,
    )


def log_probability_inside(mean: FloatArray, covariance: FloatArray, support: Support) -> float:
    """Return the logarithm of the probability of a normal distribution within a box, right in far tails, too.

    One parameter after the other is integrated, each given those before it (Genz 1992), on a lattice that is not
    random; scipy has no logarithm of it.

    >>> round(float(np.exp(log_probability_inside(np.zeros(2), np.eye(2), [(0, np.inf), (0, np.inf)]))), 6)
    0.25
    """
    low, high = read_bounds(support, mean.size)
    deviation = np.sqrt(np.diag(covariance))
    low, high = (low - mean) / deviation, (high - mean) / deviation
    near = np.flatnonzero((low > -FAR) | (high < FAR))
    if not near.size:
        return 0.0
    near = near[np.argsort(_find_log_between(low[near], high[near]))]  # the tightest first
    low, high = low[near], high[near]
    root = linalg.cholesky((covariance / np.outer(deviation, deviation))[np.ix_(near, near)], lower=True)
    primes = np.array([p for p in range(2, 300) if all(p % q for q in range(2, p))][: near.size])
    lattice = np.abs(2 * np.modf(np.arange(1, LATTICE + 1)[:, None] * np.sqrt(primes))[0] - 1)
    quantiles = np.zeros((LATTICE, near.size))
    total = np.zeros(LATTICE)
    for k in range(near.size):
        given = quantiles[:, :k] @ root[k, :k]
        left, right = (low[k] - given) / root[k, k], (high[k] - given) / root[k, k]
        inside = _find_log_between(left, right)
        total += inside
        # The quantiles are taken from the side of the tail.
        flip = left + right > 0
        tail = np.where(flip, -right, left)
        tail_of = np.logaddexp(log_ndtr(tail), np.log(np.clip(lattice[:, k], 1e-12, 1.0)) + inside)
        quantiles[:, k] = np.where(flip, -1.0, 1.0) * ndtri_exp(np.minimum(tail_of, -1e-300))
    return float(logsumexp(total)) - np.log(LATTICE)


def _find_log_between(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return log(Phi(right) - Phi(left)), from the side on which both are small."""
    flip = left + right > 0
    a, b = np.where(flip, -right, left), np.where(flip, -left, right)
    upper, lower = log_ndtr(b), log_ndtr(a)
    return upper + np.log(-np.expm1(np.minimum(lower - upper, -1e-16)))


def _find_scatter(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of samples, (d,), and the lower triangular root of their correlations, (d, d).

    NotDeterminedError: a parameter that is the same in all samples, or parameters that follow each other exactly.
    """
    middle = chain.pooled.mean(axis=0)
    centred = chain.pooled - middle
    reach = np.abs(centred).max(axis=0)
    # Numbers that differ in their last bits only are the same.
    still = np.flatnonzero(~(reach > 8 * np.spacing(np.abs(middle))))
    if still.size:
        raise NotDeterminedError(
            f"the samples do not scatter in {_name_parameters(still)}: give a known value, or a scale with which theta "
            "is about 1"
        )
    deviation = reach * np.sqrt(np.sum((centred / reach) ** 2, axis=0) / (len(centred) - 1))
    scores = centred / deviation
    correlation = scores.T @ scores / (len(scores) - 1)
    values, vectors = linalg.eigh(correlation)
    if values[0] < 1e-12:
        together = np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)
        raise NotDeterminedError(
            f"{_name_parameters(together)} follow each other exactly in the samples: give a known value of one of them"
        )
    return deviation, linalg.cholesky(correlation, lower=True)


def _name_parameters(indices: Sequence[int] | NDArray[np.intp]) -> str:
    return " and ".join(f"theta_{index + 1}" for index in indices)


def _log_size(deviation: FloatArray, root: FloatArray) -> float:
    """Return half of the logarithm of the determinant of a covariance, from `_find_scatter`."""
    return float(np.sum(np.log(deviation)) + np.sum(np.log(np.diag(root))))


def _find_log_volume(covariance: FloatArray) -> float:
    """Return -log N(theta | theta, covariance)."""
    return 0.5 * float(np.linalg.slogdet(2 * np.pi * covariance)[1])


def _place_nodes(
    n: int, centre: FloatArray, root: FloatArray, window: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes (m, d), log weights (m,), and which are at an edge of the window that is not a bound, (m, d, 2)."""
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
        limited = np.stack([left > low[kept], right < high[kept]], axis=1)  # whether the window is the limit
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
    pressed = {each.parameter for each in find_pressures(samples, model_class.priors)}
    found = {}
    for k, each in enumerate(model_class.parameters):
        prior, wide = each.prior, each.prior.widen(*each.limits)
        if k + 1 not in pressed or prior.family != "uniform":
            # The posterior has almost nothing outside the narrow prior, so a mean over the samples is enough.
            ratio = wide.log_density(samples[:, k]) - prior.log_density(samples[:, k])
            change = float(np.logaddexp.reduce(ratio) - np.log(len(ratio)))
        else:
            change = _compare_beyond(likelihood, model_class, k, wide, best)
        found[f"theta_{k + 1}"] = change
    return found


def _compare_beyond(likelihood: LogDensity, model_class: ModelClass, k: int, wide: Prior, best: FloatArray) -> float:
    """Return the change by two Laplace approximations, for a posterior that goes on beyond the prior; nan for none."""
    values = []
    for each in (model_class, model_class.with_prior(k, wide)):
        support = [prior.support for prior in each.priors]
        try:
            peak = maximum_a_posteriori(posterior_density(likelihood, each.log_prior), best, support=support)
            values.append(laplace(peak, support=support).log_evidence)
        except NotDeterminedError:
            return float("nan")
    return values[1] - values[0]
