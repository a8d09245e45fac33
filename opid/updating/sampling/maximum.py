"""The maximum of a log density within bounds, with slope and curvature, by Newton steps on a stencil of many points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from opid.errors import InputError, NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.sampling.chains import LogDensity, evaluate, written

Support = Sequence[tuple[float, float]] | FloatArray | None  # (lower, upper) of each parameter, or none


@dataclass(frozen=True, eq=False)
class Maximum:
    """The maximum of a log density, with its slope and curvature there."""

    theta: FloatArray  # (n_parameters,)
    log_density: float  # at theta
    gradient: FloatArray  # (n_parameters,) of the log density; 0 except at a bound
    hessian: FloatArray  # (n_parameters, n_parameters) of the log density, by central differences
    at_bound: FloatArray  # (n_parameters,) -1 at the lower bound, 1 at the upper one, 0 between
    n_evaluations: int  # rows of theta

    @property
    def covariance(self) -> FloatArray:
        """(n_parameters, n_parameters) of the normal distribution of this curvature.

        Where a maximum at a bound has no curvature, the slope limits it.
        """
        return _inverse(self.precision)

    @property
    def covariance_inside(self) -> FloatArray:
        """(n_parameters, n_parameters) of roughly the part within the bounds, for starts and proposals of chains.

        At a bound a steep density falls off as an exponential over the length 1 / slope, however small its curvature.
        """
        return _inverse(self.precision + np.diag(self._steep))

    @property
    def _steep(self) -> FloatArray:
        return np.where(self.at_bound != 0, self.gradient**2, 0.0)

    @property
    def precision(self) -> FloatArray:
        """Inverse of `covariance`: the curvature, made positive with the slopes at bounds where it is not."""
        for fraction in (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0):
            matrix = -self.hessian + fraction * np.diag(self._steep)
            scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
            if linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > 1e-12:
                return matrix
        raise NotDeterminedError("the log density has no curvature at its maximum: the data do not tell a parameter")


def _inverse(precision: FloatArray) -> FloatArray:
    """Return the inverse for parameters that may have very different sizes."""
    scale = np.sqrt(np.diag(precision))
    return np.asarray(linalg.inv(precision / np.outer(scale, scale)) / np.outer(scale, scale))


def bounds_of(support: Support, n_parameters: int) -> tuple[FloatArray, FloatArray]:
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
        log_density: (n, n_parameters) -> (n,), up to a constant; -inf outside the support.
        start: (n_parameters,) or (n, n_parameters), of which the best is taken.
        support: lower and upper end of each parameter, for example `[prior.support for prior in priors]`.
        tolerance: largest distance of the logarithm from the maximum.
        max_iterations: before it gives up.

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
    low, high = bounds_of(support, rows.shape[1])
    rows = rows[np.all((rows >= low) & (rows <= high), axis=1)]
    values = evaluate(log_density, rows) if len(rows) else np.array([])
    if not np.isfinite(values).any():
        raise InputError("no start lies inside the support: start where the density is not zero, e.g. at prior draws")
    theta, value, counted = rows[int(np.argmax(values))], float(values.max()), len(rows)
    widest = np.where(np.isfinite(high - low), (high - low) / 4, np.inf)
    step = np.minimum(0.01 * np.where(np.isfinite(widest), 4 * widest, np.maximum(np.abs(theta), 1.0)), widest)
    fractions = 2.0 ** np.arange(4, -15, -1)[:, None]  # of a Newton step
    for _ in range(max_iterations):
        middle = np.clip(theta, low + step, high - step)  # all of the stencil inside
        points = middle + step * _offsets(theta.size)
        f = evaluate(log_density, points)
        counted += len(points)
        candidates, found, change = points, f, np.array(0.25)
        if np.isfinite(f).all():
            slope, curvature = _quadratic(f, theta.size)
            slope = slope + curvature @ ((theta - middle) / step)
            fixed = ((theta <= low) & (slope < 0)) | ((theta >= high) & (slope > 0))
            direction, gain, peaked = _newton(slope, curvature, ~fixed)
            change = _change(slope, curvature, fixed)
            is_scaled = bool(np.all((change > 0.5) & ((change < 2.0) | (step >= widest))))
            if peaked and is_scaled and gain < max(tolerance, 1e-14 * abs(value)):
                side = np.where(fixed, np.where(theta <= low, -1.0, 1.0), 0.0)
                hessian = curvature / np.outer(step, step)
                return Maximum(theta, value, np.where(fixed, slope / step, 0.0), hessian, side, counted)
            along = np.clip(theta + fractions * direction * step, low, high)
            candidates, found = np.concatenate([points, along]), np.concatenate([f, evaluate(log_density, along)])
            counted += len(along)
        best = int(np.argmax(found))
        if found[best] > value:
            theta, value = candidates[best], float(found[best])
        step = np.minimum(step * change, widest)
    raise NotDeterminedError(
        f"no maximum was found in {max_iterations} steps; the best was theta = {written(theta)}: the density may be "
        "flat there, or end where no bound was stated (give the support)",
        partial=theta,
    )


def _offsets(d: int) -> FloatArray:
    """Return the stencil, (1 + 2 d + 2 d (d - 1), d): the middle, a step along each axis, the corners of each plane."""
    axes = np.eye(d)
    rows = [np.zeros((1, d)), axes, -axes]
    for i in range(d):
        for j in range(i):
            rows.append(np.array([s * axes[i] + t * axes[j] for s, t in ((1, 1), (-1, -1), (1, -1), (-1, 1))]))
    return np.concatenate(rows)


def _quadratic(f: FloatArray, d: int) -> tuple[FloatArray, FloatArray]:
    """Return slope and curvature in steps of the stencil."""
    ahead, behind = f[1 : 1 + d], f[1 + d : 1 + 2 * d]
    curvature = np.diag(ahead + behind - 2 * f[0])
    rows, columns = np.tril_indices(d, -1)
    corners = f[1 + 2 * d :].reshape(-1, 4)
    curvature[rows, columns] = curvature[columns, rows] = corners @ [0.25, 0.25, -0.25, -0.25]
    return (ahead - behind) / 2, curvature


def _newton(slope: FloatArray, curvature: FloatArray, free: np.ndarray) -> tuple[FloatArray, float, bool]:
    """Return the direction uphill, the gain that the quadratic predicts, and whether it has a peak at all."""
    direction = np.zeros(slope.size)
    if not free.any():
        return direction, 0.0, True
    values, vectors = linalg.eigh(-curvature[np.ix_(free, free)])
    sizes = np.maximum(np.abs(values), max(1e-10 * np.abs(values).max(), 1e-300))
    parts = vectors.T @ slope[free]
    direction[free] = np.clip(vectors @ (parts / sizes), -1e4, 1e4)
    return direction, 0.5 * float(np.sum(parts**2 / sizes)), bool(values[0] > 0)


def _change(slope: FloatArray, curvature: FloatArray, fixed: np.ndarray) -> FloatArray:
    """Return the factor of each step of the stencil towards a twentieth of a standard deviation.

    That is long enough to rise above the numerical noise of a model.
    """
    bend = np.sqrt(np.maximum(-np.diag(curvature), 0.0))
    size = np.maximum(bend, np.where(fixed, np.abs(slope), 0.0))
    return np.clip(0.05 / np.maximum(size, 1e-300), 1 / 8, 8.0)
