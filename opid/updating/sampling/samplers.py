"""Samplers of a posterior: Metropolis-Hastings, adaptive Metropolis, emcee's ensemble, transitional Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import logsumexp

from opid.errors import InputError, NotDeterminedError, require
from opid.signals.recording import FloatArray
from opid.updating.sampling.chains import (
    Chain,
    LogDensity,
    Progress,
    covariance_root,
    evaluate,
    require_count,
    starting_densities,
)
from opid.updating.sampling.evidence import Evidence
from opid.updating.settings import UPDATING


def metropolis(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    covariance: ArrayLike,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    adaptive: bool = False,
    progress: Progress | None = None,
) -> Chain:
    """Return random-walk Metropolis-Hastings chains, (n_chains, n_samples, n_parameters), after their warm-up.

    They begin at the rows of `start`, (n_chains, n_parameters). Proposals have 2.38^2 / n_parameters times the
    covariance, which is best for a normal distribution (Song et al. 2021, refs. 46 and 60). Give the covariance of the
    posterior as far as it is known (Laplace approximation), or (n_parameters,) variances. `adaptive` chains take it as
    a first guess and learn a better one from the past of all chains (Haario et al. 2001), without its older half, so
    that far starts are forgotten. It changes less and less, as convergence requires.

    This and the other samplers move all chains by one evaluation of the density, and the same `rng` in the same state
    gives the same chains to the last bit. InputError: a start outside the support, a log density of another shape or
    not a number, a covariance that is not positive definite, or counts that are not positive.

    >>> chain = metropolis(lambda t: -0.5 * np.sum(t**2, axis=1), np.zeros((4, 1)), covariance=1.0,
    ...                    n_samples=2000, n_warm_up=100, rng=np.random.default_rng(1))
    >>> chain.samples.shape, bool(abs(chain.samples.var() - 1) < 0.2)
    ((4, 2000, 1), True)
    """
    dropped = require_count(n_warm_up, "n_warm_up", least=0)
    n_steps = require_count(n_samples, "n_samples", least=1) + dropped
    theta, value = starting_densities(log_density, start)
    n_chains, n_parameters = theta.shape
    first, scale = covariance_root(covariance, n_parameters), 2.38**2 / n_parameters
    root, done = first * np.sqrt(scale), 0
    samples, values = np.empty((n_steps, n_chains, n_parameters)), np.empty((n_steps, n_chains))
    taken = np.zeros((n_steps, n_chains), dtype=bool)
    while done < n_steps:
        # Chains adapt after 50 steps, then whenever they are a tenth longer; other chains report every 250 steps.
        last = min(done + (max(50, done // 10) if adaptive else 250), n_steps)
        jumps = rng.standard_normal((last - done, n_chains, n_parameters)) @ root.T
        threshold = -rng.standard_exponential((last - done, n_chains))  # logarithm of a uniform number
        for step, jump, bar in zip(range(done, last), jumps, threshold, strict=True):
            proposal = theta + jump
            proposed = evaluate(log_density, proposal)
            taken[step] = proposed - value > bar
            theta = np.where(taken[step, :, None], proposal, theta)
            value = np.where(taken[step], proposed, value)
            samples[step], values[step] = theta, value
        done = last
        if adaptive:
            learnt = np.atleast_2d(np.cov(samples[done // 2 : done].reshape(-1, n_parameters), rowvar=False))
            # A little of the given covariance keeps the sum from being singular (Haario's epsilon).
            root = covariance_root(scale * (learnt + 1e-6 * (first @ first.T)), n_parameters)
        if progress:
            progress(done / n_steps)
    return Chain(
        samples=np.ascontiguousarray(samples[dropped:].transpose(1, 0, 2)),
        log_density=np.ascontiguousarray(values[dropped:].T),
        acceptance=float(taken[dropped:].mean()),
        n_evaluations=taken.size + n_chains,
        sampler="adaptive_metropolis" if adaptive else "metropolis",
        n_warm_up=dropped,
    )


def require_emcee() -> None:
    """Raise an InputError if emcee is not installed, before long work that would need it."""
    require("emcee", "the ensemble sampler", "emcee", "ensemble")


def ensemble(
    log_density: LogDensity,
    start: ArrayLike,
    *,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Chain:
    """Return the walkers of emcee's stretch move (Goodman & Weare 2010; Foreman-Mackey et al. 2013), one chain each.

    The walkers move along the lines between them: no covariance has to be known, and the scales of the parameters have
    no effect. Arguments are those of `metropolis`; `start` has an even number of walkers, at least twice the number of
    parameters, which are not all in one plane. InputError: another start, or emcee is not installed.
    """
    require_emcee()
    import emcee

    kept, dropped = require_count(n_samples, "n_samples", least=1), require_count(n_warm_up, "n_warm_up", least=0)
    rows, value = starting_densities(log_density, start)
    n_walkers, n_parameters = rows.shape
    if n_walkers < 2 * n_parameters or n_walkers % 2:
        raise InputError(
            f"{n_walkers} walker(s) for {n_parameters} parameter(s): give an even number of at least {2 * n_parameters}"
        )
    scatter = rows - rows.mean(axis=0)
    size = np.abs(scatter).max(axis=0)
    if not size.all() or np.linalg.matrix_rank(scatter / size, tol=1e-6) < n_parameters:
        raise InputError("the walkers start in one plane and would never leave it: scatter them in every parameter")
    counted = [n_walkers]

    def evaluate_counted(theta: FloatArray) -> FloatArray:
        counted[0] += len(theta)
        return evaluate(log_density, theta)

    sampler = emcee.EnsembleSampler(n_walkers, n_parameters, evaluate_counted, vectorize=True)
    # emcee takes no other kind of generator
    chance = np.random.RandomState(np.random.MT19937(int(rng.integers(2**63))))
    state = emcee.State(rows, log_prob=value, random_state=chance.get_state())
    total = dropped + kept
    for step, _ in enumerate(sampler.sample(state, iterations=total, skip_initial_state_check=True), start=1):
        if progress and (step % 50 == 0 or step == total):
            progress(step / total)
    samples = np.ascontiguousarray(sampler.get_chain(discard=dropped).transpose(1, 0, 2))
    # A proposal is never exactly where its walker was.
    moved = np.any(np.diff(samples, axis=1) != 0, axis=2)
    return Chain(
        samples=samples,
        log_density=np.ascontiguousarray(sampler.get_log_prob(discard=dropped).T),
        acceptance=float(moved.mean()) if kept > 1 else float(np.mean(sampler.acceptance_fraction)),
        n_evaluations=counted[0],
        sampler="ensemble",
        n_warm_up=dropped,
    )


@dataclass(frozen=True, eq=False)
class Transitional:
    """Samples of the posterior, the evidence, and the stages between prior and posterior."""

    # one chain of n_particles; particles with the same parent are neighbours, so that copies reduce the number of
    # effective samples
    chain: Chain
    evidence: Evidence  # logarithm of the evidence with its standard deviation
    exponents: FloatArray  # (n_stages + 1,) exponents of the likelihood, from 0 to 1
    acceptance: FloatArray  # (n_stages,) fraction of the proposals of each stage


def transitional(
    log_likelihood: LogDensity,
    log_prior: LogDensity,
    sample_prior: Callable[[int, np.random.Generator], FloatArray],
    *,
    rng: np.random.Generator,
    n_particles: int = 1000,
    n_moves: int = 5,
    progress: Progress | None = None,
) -> Transitional:
    """Return samples of the posterior and its evidence (Ching & Chen 2007; Song et al. 2021, ref. 48).

    The likelihood is raised to exponents that grow from 0 to 1, each as far as the variation of the weights allows;
    particles are drawn again by weight and moved by Metropolis steps with their own covariance. The evidence is the
    product of the mean weights, kept as a logarithm. Its standard deviation follows from the fraction of the weight
    that each first ancestor has at the end (Lee & Whiteley 2018); it includes the errors that later stages inherit.

    `log_likelihood` is only evaluated where `log_prior`, which is normalised, is not -inf; `sample_prior` makes
    (n, n_parameters) independent draws from n and rng. Each of the particles takes `n_moves` Metropolis steps in each
    stage, and `progress` is called with the exponent. InputError: functions of wrong shape or nan, draws outside the
    prior, or counts out of range. NotDeterminedError: no draw of the prior has a likelihood, or the exponent no longer
    grows.
    """
    n = require_count(n_particles, "n_particles", least=20)
    require_count(n_moves, "n_moves", least=1)
    swarm = _Swarm(log_likelihood, log_prior, sample_prior, n, rng)
    spread = np.atleast_2d(np.cov(swarm.theta, rowvar=False)) * 1e-10  # keeps the covariance from becoming singular
    exponents, acceptance, log_evidence, scale = [0.0], [], 0.0, 2.38**2 / swarm.theta.shape[1]
    while exponents[-1] < 1.0:
        if len(exponents) > UPDATING.most_stages:
            raise NotDeterminedError(
                f"the posterior was not reached in {UPDATING.most_stages} stages: the likelihood may have no maximum; "
                "check it, or narrow the prior"
            )
        step = _choose_exponent_step(swarm.likelihood, 1.0 - exponents[-1])
        if exponents[-1] + step == exponents[-1]:
            raise NotDeterminedError("the likelihood is too steep for the particles: take more of them")
        log_weight = step * np.where(np.isfinite(swarm.likelihood), swarm.likelihood, -np.inf)
        log_evidence += float(logsumexp(log_weight)) - np.log(n)
        weight = np.exp(log_weight - logsumexp(log_weight))
        exponents.append(1.0 if step == 1.0 - exponents[-1] else exponents[-1] + step)
        # The weight of each first ancestor is taken before resampling drops some ancestors.
        concentration = float(np.sum(np.bincount(swarm.ancestor, weight) ** 2))
        covariance = np.atleast_2d(np.cov(swarm.theta, rowvar=False, aweights=weight)) + spread
        swarm.resample(weight, rng)
        taken, scale = swarm.move(n_moves, exponents[-1], covariance_root(covariance, len(spread)), scale, rng)
        acceptance.append(taken)
        if progress:
            progress(exponents[-1])
    n_stages = len(acceptance)
    # The variance is 1 - (n / (n-1))^n_stages * (probability that two ancestors differ), by Lee & Whiteley.
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
    """The particles of transitional Monte Carlo, their densities, and the first ancestor of each."""

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
            raise InputError("sample_prior draws where log_prior is -inf: give both for the same prior")
        self.likelihood = evaluate(log_likelihood, self.theta)
        if not np.isfinite(self.likelihood).any():
            raise NotDeterminedError(f"none of {n} draws of the prior has a likelihood: widen or move the prior")
        self.ancestor = np.arange(n)
        self.n_evaluations = n

    def resample(self, weight: FloatArray, rng: np.random.Generator) -> None:
        """Replace the particles by draws with replacement, those of one parent side by side."""
        parent = np.sort(rng.choice(len(weight), size=len(weight), p=weight))
        self.theta, self.ancestor = self.theta[parent], self.ancestor[parent]
        self.prior, self.likelihood = self.prior[parent], self.likelihood[parent]

    def move(
        self, n_moves: int, exponent: float, root: FloatArray, scale: float, rng: np.random.Generator
    ) -> tuple[float, float]:
        """Take Metropolis steps at one exponent; return the fraction that was taken and the next scale of the jumps."""
        fractions = []
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
            fractions.append(float(taken.mean()))
            scale = float(np.clip(scale * np.exp(2.0 * (fractions[-1] - UPDATING.aimed_acceptance)), 1e-6, 1e2))
        return float(np.mean(fractions)), scale


def _choose_exponent_step(log_likelihood: FloatArray, remaining: float) -> float:
    """Return the growth of the exponent for which the weights of particles vary by `weight_variation`."""
    alive = log_likelihood[np.isfinite(log_likelihood)]
    alive = alive - alive.max()

    def excess(log_step: float) -> float:
        first, second = (logsumexp(k * np.exp(log_step) * alive) for k in (1, 2))
        # The mean square over the squared mean of the weights is 1 + variation^2.
        return second - 2 * first + np.log(len(alive)) - np.log1p(UPDATING.weight_variation**2)

    if excess(np.log(remaining)) <= 0:
        return remaining
    low = np.log(remaining) - 60.0
    if excess(low) >= 0:
        return 0.0
    return float(np.exp(brentq(excess, low, np.log(remaining), xtol=1e-6)))
