"""Adaptive Metropolis and the no-U-turn sampler against distributions that are known."""

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.updating.sampling.chains import diagnose, effective_samples, split_r_hat, spread_starts
from opid.updating.sampling.samplers import metropolis, nuts

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

SLOPES = {
    correlated: lambda t: (MEAN - t) @ np.linalg.inv(COVARIANCE),
    banana: lambda t: np.stack(
        [-t[:, 0] + 8.0 * t[:, 0] * (t[:, 1] - t[:, 0] ** 2), -4.0 * (t[:, 1] - t[:, 0] ** 2)], axis=1
    ),
    half_normal: lambda t: np.where(t[:, :1] >= 0, -t, 0.0),
}


def walk(density, start, covariance, **how):
    slopes = SLOPES.get(density, SLOPES[correlated])
    return nuts(lambda t: (density(t), slopes(t)), start, covariance=covariance, **how)


SAMPLERS = {
    "adaptive": lambda f, start, covariance, **how: metropolis(f, start, covariance=covariance, **how),
    "nuts": walk,
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


@pytest.mark.parametrize("covariance", [COVARIANCE, np.diag(COVARIANCE.diagonal())])
def test_adaptive_chains_know_the_covariance_or_learn_it(covariance):
    rng = np.random.default_rng(6)
    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=8, rng=rng)
    found = diagnose(metropolis(correlated, start, covariance=covariance, n_samples=625, n_warm_up=63, rng=rng))
    assert 400 < found.effective_samples < 1200  # of 5000 samples
    assert 0.25 < found.acceptance < 0.45


def test_walks_along_the_slope_are_worth_ten_times_as_much_in_eight_dimensions():
    root = np.random.default_rng(9).standard_normal((8, 8))
    covariance, rng = root @ root.T, np.random.default_rng(10)
    inverse = np.linalg.inv(covariance)

    def density(t):
        return -0.5 * np.einsum("ni,ij,nj->n", t, inverse, t)

    start = spread_starts(density, np.zeros(8), covariance, n_chains=4, rng=rng)
    how = {"covariance": covariance, "n_samples": 500, "rng": rng}
    walked = diagnose(nuts(lambda t: (density(t), -t @ inverse), start, n_warm_up=100, **how))
    stepped = diagnose(metropolis(density, start, n_warm_up=100, **how))
    assert walked.effective_samples > 10 * stepped.effective_samples
    assert walked.divergent == 0.0


@pytest.mark.parametrize("wrong", [1e-6, 1e4])
def test_adaptation_mends_a_covariance_that_is_far_off(wrong):
    rng = np.random.default_rng(7)
    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=8, rng=rng)
    chain = metropolis(
        correlated, start, covariance=wrong * np.diag(COVARIANCE.diagonal()), n_samples=1000, n_warm_up=1500, rng=rng
    )
    assert 0.2 < chain.acceptance < 0.5
    assert split_r_hat(chain.samples).max() < 1.1


def test_a_single_adaptive_chain_far_from_the_posterior_finds_it():
    rng = np.random.default_rng(8)
    chain = metropolis(
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
    assert one.n_evaluations >= 8 * 151
    assert one.n_warm_up == 30


def test_all_adaptive_chains_are_evaluated_together():
    rows = []

    def counted(theta):
        rows.append(len(theta))
        return correlated(theta)

    start = spread_starts(correlated, MEAN, COVARIANCE, n_chains=40, rng=np.random.default_rng(1))
    rng = np.random.default_rng(1)
    chain = metropolis(counted, start, covariance=COVARIANCE, n_samples=50, n_warm_up=0, rng=rng)
    assert sum(rows) == chain.n_evaluations
    assert len(rows) == 51


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_what_no_sampler_can_go_on_with(sampler):
    run = SAMPLERS[sampler]
    start = np.random.default_rng(1).normal(1.0, 0.1, (8, 2))
    how = {"n_samples": 50, "n_warm_up": 10, "rng": np.random.default_rng(1)}
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
    how = {"n_samples": 5, "n_warm_up": 10, "rng": np.random.default_rng(1)}
    with pytest.raises(InputError, match="not positive definite"):
        metropolis(correlated, MEAN, covariance=-COVARIANCE, **how)


def test_a_density_without_slope_is_refused():
    how = {"covariance": COVARIANCE, "n_samples": 50, "n_warm_up": 10, "rng": np.random.default_rng(1)}
    with pytest.raises(NotDeterminedError, match="where the density has no slope"):
        nuts(lambda t: (np.zeros(len(t)), np.zeros_like(t)), MEAN, **how)
