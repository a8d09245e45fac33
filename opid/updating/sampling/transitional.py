"""Transitional Markov chain Monte Carlo: particles from prior to posterior in steps, and the evidence on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp

from opid.errors import InputError, NotDeterminedError
from opid.signals.recording import FloatArray
from opid.updating.result import Evidence
from opid.updating.sampling.chains import Chain, LogDensity, Progress, as_count, covariance_root, evaluate

MOST_STAGES = 500
"""More than that, and the likelihood has no maximum that the particles can reach."""

AIMED_ACCEPTANCE = 0.3
"""Share of proposals the jumps are scaled for."""


@dataclass(frozen=True, eq=False)
class Transitional:
    """Samples of the posterior, the evidence, and the road between prior and posterior.

    Args:
        chain: one chain of n_particles, those with the same parent side by side so that its effective samples tell
            how many of them are copies.
        evidence: its logarithm with the standard deviation of that.
        exponents: (n_stages + 1,) of the likelihood, from 0 to 1.
        acceptance: (n_stages,) share of the proposals of each stage.
    """

    chain: Chain
    evidence: Evidence
    exponents: FloatArray
    acceptance: FloatArray


def transitional(
    log_likelihood: LogDensity,
    log_prior: LogDensity,
    sample_prior: Callable[[int, np.random.Generator], FloatArray],
    *,
    rng: np.random.Generator,
    n_particles: int = 1000,
    n_moves: int = 5,
    coefficient_of_variation: float = 1.0,
    progress: Progress | None = None,
) -> Transitional:
    """Return samples of the posterior and its evidence (Ching & Chen 2007; Song et al. 2021, ref. 48).

    The likelihood is raised to exponents that grow from 0 to 1, each as far as the coefficient of variation of the
    weights allows; particles are drawn again by weight and moved by Metropolis steps with their own covariance. The
    evidence is the product of the mean weights, kept as a logarithm. Its standard deviation follows from the share
    of the weight that each first ancestor holds at the end (Lee & Whiteley 2018), so that what the particles
    of later stages inherit is in it.

    Args:
        log_likelihood: (n, n_parameters) -> (n,); only asked where the prior is not zero.
        log_prior: (n, n_parameters) -> (n,), normalised; -inf outside the support.
        sample_prior: (n, rng) -> (n, n_parameters) independent draws of the prior.
        rng: source of chance; the same one in the same state gives the same samples to the last bit.
        n_particles: how many.
        n_moves: Metropolis steps of each particle in each stage.
        coefficient_of_variation: of the weights in each stage; smaller ones take more stages.
        progress: called with the exponent that was reached.

    Raises:
        InputError: functions of wrong shape or nan, draws outside the prior, counts or coefficients out of range.
        NotDeterminedError: no draw of the prior has a likelihood, or the exponent no longer grows.
    """
    n = as_count(n_particles, "n_particles", least=20)
    as_count(n_moves, "n_moves", least=1)
    if not 0 < coefficient_of_variation < 10:
        raise InputError(f"coefficient_of_variation is {coefficient_of_variation}: give a number near 1")
    swarm = _Swarm(log_likelihood, log_prior, sample_prior, n, rng)
    spread = np.atleast_2d(np.cov(swarm.theta, rowvar=False)) * 1e-10  # keeps the covariance from becoming singular
    exponents, acceptance, log_evidence, scale = [0.0], [], 0.0, 2.38**2 / swarm.theta.shape[1]
    while exponents[-1] < 1.0:
        if len(exponents) > MOST_STAGES:
            raise NotDeterminedError(f"the posterior was not reached in {MOST_STAGES} stages: does the likelihood end?")
        step = _step(swarm.likelihood, 1.0 - exponents[-1], coefficient_of_variation)
        if exponents[-1] + step == exponents[-1]:
            raise NotDeterminedError("the likelihood is too steep for the particles: take more of them")
        log_weight = step * np.where(np.isfinite(swarm.likelihood), swarm.likelihood, -np.inf)
        log_evidence += float(logsumexp(log_weight)) - np.log(n)
        weight = np.exp(log_weight - logsumexp(log_weight))
        exponents.append(1.0 if step == 1.0 - exponents[-1] else exponents[-1] + step)
        # the share of each first ancestor, before any is dropped
        concentration = float(np.sum(np.bincount(swarm.ancestor, weight) ** 2))
        covariance = np.atleast_2d(np.cov(swarm.theta, rowvar=False, aweights=weight)) + spread
        swarm.draw_again(weight, rng)
        share, scale = swarm.move(n_moves, exponents[-1], covariance_root(covariance, len(spread)), scale, rng)
        acceptance.append(share)
        if progress:
            progress(exponents[-1])
    n_stages = len(acceptance)
    # 1 - (n / (n-1))^n_stages * (probability that two ancestors differ), as Lee & Whiteley have it
    variance = -np.expm1(n_stages * np.log(n / (n - 1)) + np.log1p(-min(concentration, 1 - 1e-12)))
    return Transitional(
        chain=Chain(
            samples=swarm.theta[None],
            log_density=(swarm.likelihood + swarm.prior)[None],
            acceptance=acceptance[-1],
            n_evaluations=swarm.n_evaluations,
            sampler="transitional",
            n_warm_up=0,
        ),
        evidence=Evidence("transitional", float(log_evidence), float(np.sqrt(max(variance, 0.0)))),
        exponents=np.array(exponents),
        acceptance=np.array(acceptance),
    )


class _Swarm:
    """The running state: particles, their densities, the first ancestor of each."""

    def __init__(
        self,
        log_likelihood: LogDensity,
        log_prior: LogDensity,
        sample_prior: Callable[[int, np.random.Generator], FloatArray],
        n: int,
        rng: np.random.Generator,
    ) -> None:
        self.log_likelihood, self.log_prior = log_likelihood, log_prior
        self.theta = np.array(sample_prior(n, rng), dtype=np.float64)
        if self.theta.ndim != 2 or len(self.theta) != n:
            raise InputError(f"sample_prior returned shape {self.theta.shape}: return ({n}, number of parameters)")
        self.prior = evaluate(log_prior, self.theta)
        if not np.isfinite(self.prior).all():
            raise InputError("sample_prior draws where log_prior is -inf: they belong to different priors")
        self.likelihood = evaluate(log_likelihood, self.theta)
        if not np.isfinite(self.likelihood).any():
            raise NotDeterminedError(f"none of {n} draws of the prior has a likelihood: widen or move the prior")
        self.ancestor = np.arange(n)
        self.n_evaluations = n

    def draw_again(self, weight: FloatArray, rng: np.random.Generator) -> None:
        """Replace the particles by draws with replacement, those of one parent side by side."""
        parent = np.sort(rng.choice(len(weight), size=len(weight), p=weight))
        self.theta, self.ancestor = self.theta[parent], self.ancestor[parent]
        self.prior, self.likelihood = self.prior[parent], self.likelihood[parent]

    def move(
        self, n_moves: int, exponent: float, root: FloatArray, scale: float, rng: np.random.Generator
    ) -> tuple[float, float]:
        """Take Metropolis steps at one exponent; return the share that was taken and the next scale of the jumps."""
        shares = []
        for _ in range(n_moves):
            proposal = self.theta + np.sqrt(scale) * (rng.standard_normal(self.theta.shape) @ root.T)
            bar = -rng.standard_exponential(len(proposal))
            prior = evaluate(self.log_prior, proposal)
            likelihood = np.full(len(proposal), -np.inf)
            possible = np.isfinite(prior)
            if possible.any():
                likelihood[possible] = evaluate(self.log_likelihood, proposal[possible])
                self.n_evaluations += int(possible.sum())
            taken = exponent * (likelihood - self.likelihood) + prior - self.prior > bar
            self.theta[taken], self.prior[taken] = proposal[taken], prior[taken]
            self.likelihood[taken] = likelihood[taken]
            shares.append(float(taken.mean()))
            scale = float(np.clip(scale * np.exp(2.0 * (shares[-1] - AIMED_ACCEPTANCE)), 1e-6, 1e2))
        return float(np.mean(shares)), scale


def _step(log_likelihood: FloatArray, remaining: float, aim: float) -> float:
    """How far the exponent may grow: the weights of the particles that have a likelihood vary by `aim`."""
    alive = log_likelihood[np.isfinite(log_likelihood)]
    alive = alive - alive.max()

    def excess(log_step: float) -> float:
        first, second = (logsumexp(k * np.exp(log_step) * alive) for k in (1, 2))
        # mean square over squared mean of the weights is 1 + variation^2
        return second - 2 * first + np.log(len(alive)) - np.log1p(aim**2)

    if excess(np.log(remaining)) <= 0:
        return remaining
    low = np.log(remaining) - 60.0
    if excess(low) >= 0:
        return 0.0
    return float(np.exp(brentq(excess, low, np.log(remaining), xtol=1e-6)))
