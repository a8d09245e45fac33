"""Markov chains as records, and the checks that every sampler shares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from opid.errors import InputError
from opid.signals.recording import FloatArray

LogDensity = Callable[[FloatArray], FloatArray]
"""theta (n, n_parameters) -> (n,) logarithm of a density, up to a constant; -inf outside the support, never nan."""

Progress = Callable[[float], None]
"""Called with the share that is done, from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Chain:
    """What a sampler returned, its warm-up dropped.

    Args:
        samples: (n_chains, n, n_parameters).
        log_density: (n_chains, n) of the samples.
        acceptance: share of the proposals that were taken, of all chains after the warm-up.
        n_evaluations: rows of theta whose density was asked for, the warm-up included.
        sampler: name of the method.
        n_warm_up: samples of each chain that were dropped.
    """

    samples: FloatArray
    log_density: FloatArray
    acceptance: float
    n_evaluations: int
    sampler: str
    n_warm_up: int

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return self.samples.shape[-1]

    @property
    def pooled(self) -> FloatArray:
        """(n_chains n, n_parameters), all chains one after the other."""
        return self.samples.reshape(-1, self.n_parameters)

    @property
    def best(self) -> FloatArray:
        """(n_parameters,), the sample with the largest density."""
        return self.pooled[int(np.argmax(self.log_density))]

    def thinned(self, n: int) -> FloatArray:
        """(n, n_parameters) samples, evenly spaced over all chains; all of them where there are fewer."""
        rows = np.linspace(0, len(self.pooled) - 1, min(n, len(self.pooled)))
        return self.pooled[np.round(rows).astype(np.intp)]


def evaluate(log_density: LogDensity, theta: FloatArray) -> FloatArray:
    """Return the density of each row and refuse what no sampler can go on with.

    Args:
        log_density: (n, n_parameters) -> (n,).
        theta: (n, n_parameters).

    Raises:
        InputError: another shape, nan or +inf; the message says for which theta.
    """
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
            f"the log density is {value[row]} at theta = {written(theta[row])}: return a finite number, or -inf where "
            "theta is impossible"
        )
    return value


def starting_densities(log_density: LogDensity, start: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the starts as rows, (n_chains, n_parameters), and their densities, (n_chains,).

    Args:
        log_density: (n, n_parameters) -> (n,).
        start: (n_chains, n_parameters), or (n_parameters,) of a single chain.

    Raises:
        InputError: starts that are not finite, of another shape, or outside the support.
    """
    rows = np.array(start, dtype=np.float64, ndmin=2)
    if rows.ndim != 2 or not rows.size or not np.isfinite(rows).all():
        raise InputError(
            f"the start has shape {rows.shape}: give finite numbers, one row a chain, one column a parameter"
        )
    value = evaluate(log_density, rows)
    if not np.isfinite(value).all():
        row = int(np.argmin(value))
        raise InputError(
            f"chain {row + 1} starts outside the support, at theta = {written(rows[row])}: start where the density is "
            "not zero, for example at draws of the prior"
        )
    return rows, value


def spread_starts(
    log_density: LogDensity, centre: ArrayLike, covariance: ArrayLike, *, n_chains: int, rng: np.random.Generator
) -> FloatArray:
    """Return starts scattered twice as widely as the posterior, (n_chains, n_parameters), all inside the support.

    Args:
        log_density: (n, n_parameters) -> (n,).
        centre: (n_parameters,), for example the maximum a posteriori.
        covariance: (n_parameters, n_parameters), for example that of `laplace`.
        n_chains: how many.
        rng: source of chance.

    Raises:
        InputError: a centre outside the support, or a covariance that is not positive definite.
    """
    middle = starting_densities(log_density, centre)[0][0]
    root = 2.0 * covariance_root(covariance, middle.size)
    kept: list[FloatArray] = []
    for _ in range(50):
        drawn = middle + rng.standard_normal((4 * n_chains, middle.size)) @ root.T
        kept.extend(drawn[np.isfinite(evaluate(log_density, drawn))])
        if len(kept) >= n_chains:
            return np.array(kept[:n_chains])
        root = 0.7 * root  # the support is narrower than the covariance says
    raise InputError(
        "no start was found near the centre: it stands at the edge of the support, or the covariance is wrong"
    )


def covariance_root(covariance: ArrayLike, n_parameters: int) -> FloatArray:
    """Return the lower triangular root of a covariance.

    Args:
        covariance: (n_parameters, n_parameters); a number or (n_parameters,) variances make a diagonal one.
        n_parameters: number of parameters.

    Raises:
        InputError: another shape, or not positive definite.

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


def as_count(value: int, name: str, *, least: int) -> int:
    """Return a whole number that is at least `least`.

    Args:
        value: what was given.
        name: what the message calls it.
        least: the smallest that makes sense.

    Raises:
        InputError: another number.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name} is {value!r}: give a whole number of at least {least}")
    return int(value)


def written(theta: FloatArray) -> str:
    """Return one theta, (n_parameters,), as a message shows it.

    Args:
        theta: (n_parameters,).

    >>> written(np.array([1.5, -2.0]))
    '(1.5, -2)'
    """
    return "(" + ", ".join(f"{value:.6g}" for value in theta) + ")"
