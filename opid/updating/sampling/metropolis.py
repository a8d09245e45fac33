"""Random-walk Metropolis-Hastings and adaptive Metropolis, all chains moved by one evaluation of the density."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.updating.sampling.chains import (
    Chain,
    LogDensity,
    Progress,
    as_count,
    covariance_root,
    evaluate,
    starting_densities,
)

BLOCK = 250
"""Steps between two reports of progress."""

FIRST_ADAPTATION = 50
"""Steps before the first adaptation; later ones follow when the chains are a tenth longer."""

FLOOR = 1e-6
"""Share of the given covariance that is added to the adapted one, lest it become singular (Haario's epsilon)."""


def metropolis(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    covariance: ArrayLike,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    scale: float | None = None,
    progress: Progress | None = None,
) -> Chain:
    """Return random-walk Metropolis-Hastings chains (Song et al. 2021, refs. 46 and 60).

    Args:
        log_density: (n, n_parameters) -> (n,), of the posterior up to a constant; -inf outside the support.
        start: (n_chains, n_parameters), one row a chain.
        covariance: (n_parameters, n_parameters) of the posterior as far as it is known (Laplace approximation);
            (n_parameters,) variances make a diagonal one.
        n_samples: kept of each chain.
        n_warm_up: dropped of each chain before them.
        rng: source of chance; the same one in the same state gives the same chains to the last bit.
        scale: what the covariance is multiplied by for a proposal; 2.38^2 / n_parameters, the best for a normal
            distribution, unless given.
        progress: called with the share that is done.

    Raises:
        InputError: a start outside the support, a log density of another shape or not a number, a covariance that is
            not positive definite, counts or a scale that are not positive.

    >>> chain = metropolis(lambda t: -0.5 * np.sum(t**2, axis=1), np.zeros((4, 1)), covariance=1.0,
    ...                    n_samples=2000, n_warm_up=100, rng=np.random.default_rng(1))
    >>> chain.samples.shape, bool(abs(chain.samples.var() - 1) < 0.2)
    ((4, 2000, 1), True)
    """
    walk = _Walk(log_density, start, n_samples, n_warm_up)
    root = covariance_root(covariance, walk.n_parameters) * np.sqrt(_scale(scale, walk.n_parameters))
    while walk.done < walk.n_steps:
        walk.go(BLOCK, root, rng)
        if progress:
            progress(walk.done / walk.n_steps)
    return walk.chain("metropolis")


def adaptive_metropolis(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    covariance: ArrayLike,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Chain:
    """Return chains whose proposals learn the covariance of the posterior from their own past (Haario et al. 2001).

    The past is that of all chains, its older half forgotten so that far starts do not stay in it. The covariance
    changes less and less, as convergence asks for.

    Args:
        log_density: (n, n_parameters) -> (n,), of the posterior up to a constant; -inf outside the support.
        start: (n_chains, n_parameters), one row a chain.
        covariance: (n_parameters, n_parameters) or (n_parameters,) variances: a first guess of that of the posterior.
        n_samples: kept of each chain.
        n_warm_up: dropped of each chain before them.
        rng: source of chance; the same one in the same state gives the same chains to the last bit.
        progress: called with the share that is done.

    Raises:
        InputError: as `metropolis` does.
    """
    walk = _Walk(log_density, start, n_samples, n_warm_up)
    d = walk.n_parameters
    first = covariance_root(covariance, d)
    floor = FLOOR * (first @ first.T)
    root = first * np.sqrt(_scale(None, d))
    while walk.done < walk.n_steps:
        walk.go(max(FIRST_ADAPTATION, walk.done // 10), root, rng)
        past = walk.samples[walk.done // 2 : walk.done].reshape(-1, d)
        learnt = np.atleast_2d(np.cov(past, rowvar=False))
        root = covariance_root(_scale(None, d) * (learnt + floor), d)
        if progress:
            progress(walk.done / walk.n_steps)
    return walk.chain("adaptive_metropolis")


class _Walk:
    """The running state of several chains: where they are, what they saw, how many proposals were taken."""

    def __init__(self, log_density: LogDensity, start: ArrayLike, n_samples: int, n_warm_up: int) -> None:
        self.n_warm_up = as_count(n_warm_up, "n_warm_up", least=0)
        self.n_steps = as_count(n_samples, "n_samples", least=1) + self.n_warm_up
        self.log_density = log_density
        self.theta, self.value = starting_densities(log_density, start)
        n_chains, self.n_parameters = self.theta.shape
        self.samples = np.empty((self.n_steps, n_chains, self.n_parameters))
        self.values = np.empty((self.n_steps, n_chains))
        self.taken = np.zeros((self.n_steps, n_chains), dtype=bool)
        self.done = 0

    def go(self, n: int, root: FloatArray, rng: np.random.Generator) -> None:
        """Take at most n steps with jumps of the covariance root root^T."""
        last = min(self.done + n, self.n_steps)
        jumps = rng.standard_normal((last - self.done, *self.theta.shape)) @ root.T
        threshold = -rng.standard_exponential((last - self.done, len(self.theta)))  # logarithm of a uniform number
        for step, jump, bar in zip(range(self.done, last), jumps, threshold, strict=True):
            proposal = self.theta + jump
            value = evaluate(self.log_density, proposal)
            taken = value - self.value > bar
            self.theta = np.where(taken[:, None], proposal, self.theta)
            self.value = np.where(taken, value, self.value)
            self.samples[step], self.values[step], self.taken[step] = self.theta, self.value, taken
        self.done = last

    def chain(self, sampler: str) -> Chain:
        """What was seen after the warm-up."""
        kept = slice(self.n_warm_up, None)
        return Chain(
            samples=np.ascontiguousarray(self.samples[kept].transpose(1, 0, 2)),
            log_density=np.ascontiguousarray(self.values[kept].T),
            acceptance=float(self.taken[kept].mean()),
            n_evaluations=self.taken.size + len(self.theta),
            sampler=sampler,
            n_warm_up=self.n_warm_up,
        )


def _scale(scale: float | None, n_parameters: int) -> float:
    if scale is None:
        return 2.38**2 / n_parameters
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"scale is {scale}: give a positive number, or leave it out")
    return float(scale)
