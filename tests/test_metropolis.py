"""Metropolis-Hastings, adaptive Metropolis and the ensemble sampler against distributions that are known."""

from functools import partial

import numpy as np
import pytest

from opid.errors import InputError
from opid.updating.sampling.chains import diagnose, effective_samples, split_r_hat, spread_starts
from opid.updating.sampling.samplers import ensemble, metropolis

MEAN = np.array([1.6, -1.0])
# as narrow and as correlated as the posterior of the paper's class 4
COVARIANCE = np.array([[1.0, 0.984], [0.984, 1.0]]) * np.outer([0.05, 0.4], [0.05, 0.4])


def correlated(theta):
    return -0.5 * np.einsum("ni,ij,nj->n", theta - MEAN, np.linalg.inv(COVARIANCE), theta - MEAN)


def banana(theta):
    """x normal, y normal about x^2 with deviation 1/2: E y = 1, var y = 2.25, cov = 0."""
    return -0.5 * theta[:, 0] ** 2 - 2.0 * (theta[:, 1] - theta[:, 0] ** 2) ** 2


def half_normal(theta):
    """|N(0, 1)| beside N(0, 1): mean sqrt(2/pi), variance 1 - 2/pi."""
    return np.where(theta[:, 0] >= 0, -0.5 * np.sum(theta**2, axis=1), -np.inf)


# each with its mean, its covariance, and coordinates whose squares are 1 in the mean
adaptive_metropolis = partial(metropolis, adaptive=True)
TARGETS = {
    "correlated": (
        correlated,
        MEAN,
        COVARIANCE,
        lambda t: (t - MEAN) @ np.linalg.inv(np.linalg.cholesky(COVARIANCE)).T,
    ),
    "banana": (
        banana,
        np.array([0.0, 1.0]),
        np.diag([1.0, 2.25]),
        lambda t: np.stack([t[..., 0], 2 * (t[..., 1] - t[..., 0] ** 2)], axis=-1),
    ),
    "half normal": (half_normal, np.array([np.sqrt(2 / np.pi), 0.0]), np.diag([1 - 2 / np.pi, 1.0]), lambda t: t),
}

SAMPLERS = {
    "metropolis": lambda f, start, covariance, **how: metropolis(f, start, covariance=covariance, **how),
    "adaptive": lambda f, start, covariance, **how: adaptive_metropolis(f, start, covariance=covariance, **how),
    "ensemble": lambda f, start, covariance, **how: ensemble(f, start, **how),
}


def deviations(values, truth):
    """Distance of the means of values (n_chains, n, k) from the truth, in their own standard errors."""
    error = values.std(axis=(0, 1)) / np.sqrt(effective_samples(values, ranked=False))
    return np.abs(values.mean(axis=(0, 1)) - truth) / error


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_mean_and_spread_of_a_known_distribution(sampler, target):
    density, mean, covariance, coordinates = TARGETS[target]
    rng = np.random.default_rng(5)
    start = spread_starts(density, mean, covariance, n_chains=32, rng=rng)
    chain = SAMPLERS[sampler](density, start, covariance, n_samples=1000, n_warm_up=300, rng=rng)
    assert effective_samples(chain.samples).min() > 150
    assert deviations(chain.samples, mean).max() < 4.5
    assert deviations(coordinates(chain.samples) ** 2, 1.0).max() < 4.5
    assert split_r_hat(chain.samples).max() < 1.25  # the banana's ends are visited seldom
    np.testing.assert_allclose(density(chain.pooled).reshape(32, -1), chain.log_density, rtol=1e-12)


def test_the_laplace_covariance_is_worth_several_times_a_diagonal_one():
    rng = np.random.default_rng(6)
    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=8, rng=rng)
    run = partial(metropolis, correlated, start, n_samples=625, n_warm_up=63, rng=rng)
    diagonal, whole = (diagnose(run(covariance=each)) for each in (np.diag(COVARIANCE), COVARIANCE))
    assert whole.effective_samples > 3 * diagonal.effective_samples
    assert 400 < whole.effective_samples < 1200  # of 5000 samples
    assert 0.25 < whole.acceptance < 0.45
    adaptive = adaptive_metropolis(
        correlated, start, covariance=np.diag(COVARIANCE), n_samples=625, n_warm_up=63, rng=rng
    )
    assert diagnose(adaptive).effective_samples > 2 * diagonal.effective_samples


@pytest.mark.parametrize("wrong", [1e-6, 1e4])
def test_adaptation_mends_a_covariance_that_is_far_off(wrong):
    rng = np.random.default_rng(7)
    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=8, rng=rng)
    chain = adaptive_metropolis(
        correlated, start, covariance=wrong * np.diag(COVARIANCE.diagonal()), n_samples=1000, n_warm_up=1500, rng=rng
    )
    assert 0.2 < chain.acceptance < 0.5
    assert split_r_hat(chain.samples).max() < 1.1


def test_a_single_adaptive_chain_far_from_the_posterior_finds_it():
    rng = np.random.default_rng(8)
    chain = adaptive_metropolis(
        correlated, MEAN + np.array([1.0, -20.0]), covariance=1.0, n_samples=4000, n_warm_up=4000, rng=rng
    )
    assert chain.samples.shape == (1, 4000, 2)
    np.testing.assert_allclose(chain.pooled.mean(axis=0), MEAN, atol=0.3 * 0.4)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_same_chance_gives_the_same_bits_and_changes_no_input(sampler):
    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=8, rng=np.random.default_rng(1))
    before = start.copy()
    heard = []

    def run(seed, **more):
        how = {"n_samples": 120, "n_warm_up": 30, "rng": np.random.default_rng(seed), **more}
        return SAMPLERS[sampler](correlated, start, COVARIANCE, **how)

    one, two, other = run(3), run(3, progress=heard.append), run(4)
    np.testing.assert_array_equal(one.samples, two.samples)
    np.testing.assert_array_equal(one.log_density, two.log_density)
    assert not np.array_equal(one.samples, other.samples)
    np.testing.assert_array_equal(start, before)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    assert one.samples.shape == (8, 120, 2)
    assert one.n_evaluations == 8 * 151
    assert one.n_warm_up == 30


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_all_chains_are_evaluated_together(sampler):
    rows = []

    def counted(theta):
        rows.append(len(theta))
        return correlated(theta)

    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=40, rng=np.random.default_rng(1))
    chain = SAMPLERS[sampler](counted, start, COVARIANCE, n_samples=50, n_warm_up=0, rng=np.random.default_rng(1))
    assert sum(rows) == chain.n_evaluations
    assert len(rows) <= 101  # emcee moves one half after the other


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_what_no_sampler_can_go_on_with(sampler):
    run = SAMPLERS[sampler]
    start = np.random.default_rng(1).normal(1.0, 0.1, (8, 2))
    how = {"n_samples": 50, "n_warm_up": 0, "rng": np.random.default_rng(1)}
    with pytest.raises(InputError, match=r"return one number for each row, shape \(8,\)"):
        run(lambda t: t, start, np.eye(2), **how)
    with pytest.raises(InputError, match="outside the support"):
        run(half_normal, -start, np.eye(2), **how)
    with pytest.raises(InputError, match="nan at theta"):
        run(lambda t: np.where(t[:, 0] > 1.3, np.nan, correlated(t)), np.minimum(start, 1.25), np.eye(2), **how)
    with pytest.raises(InputError, match="n_samples is 0"):
        run(correlated, start, np.eye(2), **{**how, "n_samples": 0})
    with pytest.raises(InputError, match=r"n_warm_up is 2\.5"):
        run(correlated, start, np.eye(2), **{**how, "n_warm_up": 2.5})


def test_proposals_that_make_no_sense_are_refused():
    how = {"n_samples": 5, "n_warm_up": 0, "rng": np.random.default_rng(1)}
    with pytest.raises(InputError, match="not positive definite"):
        metropolis(correlated, MEAN, covariance=-COVARIANCE, **how)
    with pytest.raises(InputError, match="even number of at least 4"):
        ensemble(correlated, MEAN + np.eye(2), **how)
    with pytest.raises(InputError, match="in one plane"):
        ensemble(correlated, MEAN + 0.01 * np.arange(6)[:, None], **how)
