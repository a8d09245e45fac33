"""Samplers of a posterior: adaptive Metropolis, the no-U-turn sampler of nutpie, transitional Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
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
    write_theta,
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
    progress: Progress | None = None,
) -> Chain:
    """Return random-walk Metropolis-Hastings chains, (n_chains, n_samples, n_parameters), after their warm-up.

    They begin at the rows of `start`, (n_chains, n_parameters). Proposals have 2.38^2 / n_parameters times the
    covariance, which is best for a normal distribution (Song et al. 2021, refs. 46 and 60). Give the covariance of the
    posterior as far as it is known (Laplace approximation), or (n_parameters,) variances. The chains take it as a first
    guess and learn a better one from the past of all of them (Haario et al. 2001), without its older half, so that far
    starts are forgotten. It changes less and less, as convergence requires.

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
        # Chains adapt after 50 steps, then whenever they are a tenth longer.
        last = min(done + max(50, done // 10), n_steps)
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
        sampler="adaptive_metropolis",
        n_warm_up=dropped,
    )


LogDensitySlopes = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""theta (n, d) -> (n,) logarithm of a density, up to a constant, and (n, d) its derivatives; -inf and 0 outside."""


def require_nutpie() -> None:
    """Raise an InputError if nutpie is not installed, before long work that would need it."""
    require("nutpie", "the no-U-turn sampler", "nutpie", "nuts")


def nuts(
    log_density: LogDensitySlopes,
    start: ArrayLike,
    *,
    covariance: ArrayLike,
    n_samples: int,
    n_warm_up: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Chain:
    """Return chains of the no-U-turn sampler (Hoffman & Gelman 2014) of nutpie, (n_chains, n_samples, n_parameters).

    It follows the slope of the density over long ways, so that its samples are nearly independent whatever the number
    of parameters. It walks in coordinates in which the covariance is the unit matrix, and learns their scales during
    the warm-up. The density may have any support, but where it ends no slope warns the chains, and they turn back: give
    coordinates without bounds, as `Prior.from_normal` makes them.

    Args:
        log_density: the log density and its slopes.
        start: (n_chains, n_parameters) starts.
        covariance: rough covariance of the density, (n_parameters, n_parameters), or (n_parameters,) variances.
        n_samples: number of samples that are kept of each chain.
        n_warm_up: number of samples of each chain before them, in which the sampler learns its steps; 10 or more.
        rng: source of chance.
        progress: a function that is called with the fraction that is done.

    Raises:
        InputError: nutpie is not installed, or what `metropolis` refuses.
        NotDeterminedError: a start without a slope.
    """
    require_nutpie()
    import nutpie
    from nutpie.compiled_pyfunc import from_pyfunc

    kept, dropped = require_count(n_samples, "n_samples", least=1), require_count(n_warm_up, "n_warm_up", least=10)
    rows, _ = starting_densities(lambda theta: log_density(theta)[0], start)
    root = covariance_root(covariance, rows.shape[1])
    n_chains, n_parameters = rows.shape
    middle, counted = rows.mean(axis=0), [n_chains]
    at_start = solve_triangular(root, (rows - middle).T, lower=True).T
    usual = (dropped + kept) * n_chains * UPDATING.usual_steps
    refused: list[InputError | NotDeterminedError] = []

    def evaluate_one(walked: FloatArray) -> tuple[float, FloatArray]:
        theta = (middle + root @ walked)[np.newaxis]
        counted[0] += 1
        if progress and counted[0] % 500 == 0:
            progress(min(counted[0] / usual, 0.99))
        if not refused:
            try:
                value, slope = log_density(theta)
                return float(evaluate(lambda _: value, theta)[0]), slope[0] @ root
            except (InputError, NotDeterminedError) as error:
                # An error would not come back through nutpie's thread: the walk ends where nothing is possible.
                refused.append(error)
        return -np.inf, np.zeros(n_parameters)

    found = []
    # One chain after the other, each from its own start and with a seed of its own: the order of threads has no effect.
    for begin in at_start:
        model = from_pyfunc(
            n_parameters, lambda: evaluate_one, lambda *_: lambda walked: {"walked": np.asarray(walked)},
            [np.dtype("float64")], [(n_parameters,)], ["walked"],
            make_initial_point_fn=lambda _, begin=begin: begin,
        )  # fmt: skip
        try:
            found.append(nutpie.sample(
                model, draws=kept, tune=dropped, chains=1, cores=1, seed=int(rng.integers(2**31)), progress_bar=False,
            ))  # fmt: skip
        except RuntimeError:
            where = write_theta(middle + root @ begin)
            refused.append(NotDeterminedError(
                f"the no-U-turn sampler cannot begin at theta = {where}, where the density has no slope: start "
                "elsewhere, or take the adaptive sampler"
            ))  # fmt: skip
        if refused:
            raise refused[0]
    if progress:
        progress(1.0)
    walked = np.concatenate([each.posterior["walked"].to_numpy() for each in found])

    def join(name: str) -> FloatArray:
        return np.concatenate([each.sample_stats[name].to_numpy() for each in found]).astype(np.float64)

    return Chain(
        samples=np.ascontiguousarray(middle + walked @ root.T),
        log_density=join("logp"),
        acceptance=float(join("mean_tree_accept").mean()),
        n_evaluations=counted[0],
        sampler="nuts",
        n_warm_up=dropped,
        divergent=float(join("diverging").mean()),
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
