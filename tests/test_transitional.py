"""Transitional Markov chain Monte Carlo against posteriors and evidences that are known."""

from functools import partial

import numpy as np
import pytest
from scipy import special

from opid.errors import InputError, NotDeterminedError
from opid.updating.model_class import Prior
from opid.updating.sampling.chains import effective_samples
from opid.updating.sampling.samplers import transitional


def priors_of(*priors):
    """log density and sampler of independent priors."""

    def log_prior(theta):
        return np.sum([prior.log_density(theta[:, k]) for k, prior in enumerate(priors)], axis=0)

    def sample(n, rng):
        return np.stack([prior.sample(n, rng) for prior in priors], axis=1)

    return log_prior, sample


def normal(mean, covariance):
    """A normalised normal distribution as a likelihood: its evidence is the prior density where that is flat."""
    precision, constant = np.linalg.inv(covariance), -0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
    return lambda t: constant - 0.5 * np.einsum("ni,ij,nj->n", t - mean, precision, t - mean)


def correlated(d):
    deviation = np.array([0.05, 0.3, 1.0])[:d]
    matrix = np.full((d, d), 0.9) + 0.1 * np.eye(d)
    return normal(np.array([1.58, 3.0, 0.0])[:d], matrix * np.outer(deviation, deviation))


UNIFORM = (Prior("uniform", 0, 10), Prior("uniform", 0, 10), Prior("uniform", -10, 10))


@pytest.mark.parametrize(("d", "n_repeats"), [(1, 20), (2, 30), (3, 20)])
def test_evidence_is_right_and_so_is_its_error(d, n_repeats):
    log_prior, sample = priors_of(*UNIFORM[:d])
    truth = -np.log([10.0, 10.0, 20.0][:d]).sum()
    rng = np.random.default_rng(10 + d)
    run = partial(transitional, correlated(d), log_prior, sample, rng=rng, n_particles=500)
    found = [run().evidence for _ in range(n_repeats)]
    error = np.array([each.log_evidence - truth for each in found])
    stated = np.array([each.std for each in found])
    assert np.mean(np.abs(error) < 3 * stated) >= 0.95
    rms = np.sqrt(np.mean(stated**2))
    assert abs(error.mean()) < 3 * rms / np.sqrt(n_repeats) + rms**2  # a logarithm is low by half its variance
    assert 1 / 1.5 < error.std(ddof=1) / rms < 1.5


def test_evidence_with_normal_priors():
    # one reading y = theta + noise: y is normal with both variances added
    y, noise, prior_std = 2.0, 0.2, 1.5
    log_prior, sample = priors_of(Prior("normal", 0.0, prior_std))
    found = transitional(normal(np.array([y]), np.array([[noise**2]])), log_prior, sample, rng=np.random.default_rng(2))
    variance = noise**2 + prior_std**2
    truth = -0.5 * np.log(2 * np.pi * variance) - 0.5 * y**2 / variance
    assert abs(found.evidence.log_evidence - truth) < 4 * found.evidence.std
    assert 0.02 < found.evidence.std < 0.2
    posterior_mean, posterior_std = y * prior_std**2 / variance, noise * prior_std / np.sqrt(variance)
    samples = found.chain.pooled
    assert abs(samples.mean() - posterior_mean) < 5 * posterior_std / np.sqrt(effective_samples(found.chain.samples)[0])
    np.testing.assert_allclose(samples.std(), posterior_std, rtol=0.12)


def test_both_of_two_modes_are_found_with_their_weights():
    left, right = (normal(np.array([at, at]), 0.01 * np.eye(2)) for at in (-2.0, 3.0))

    def likelihood(theta):
        return np.logaddexp(np.log(0.3) + left(theta), np.log(0.7) + right(theta))

    log_prior, sample = priors_of(Prior("uniform", -10, 10), Prior("uniform", -10, 10))
    found = transitional(likelihood, log_prior, sample, rng=np.random.default_rng(3), n_particles=2000)
    assert abs(found.evidence.log_evidence + 2 * np.log(20.0)) < 4 * found.evidence.std
    assert abs(np.mean(found.chain.pooled[:, 0] > 0) - 0.7) < 0.12
    at_right = found.chain.pooled[found.chain.pooled[:, 0] > 0]
    np.testing.assert_allclose(at_right.mean(axis=0), 3.0, atol=0.02)
    np.testing.assert_allclose(at_right.std(axis=0), 0.1, rtol=0.15)


def test_a_posterior_cut_by_the_prior():
    # the likelihood has its peak at -0.5, one deviation outside the prior
    log_prior, sample = priors_of(Prior("uniform", 0, 10))
    found = transitional(
        normal(np.array([-0.5]), np.array([[0.25]])), log_prior, sample, rng=np.random.default_rng(4), n_particles=2000
    )
    truth = np.log(special.ndtr(-1.0)) - np.log(10.0)
    assert abs(found.evidence.log_evidence - truth) < 4 * found.evidence.std
    assert (found.chain.pooled >= 0).all()
    mean = -0.5 + 0.5 * np.exp(-0.5) / np.sqrt(2 * np.pi) / special.ndtr(-1.0)
    np.testing.assert_allclose(found.chain.pooled.mean(), mean, rtol=0.08)


def test_a_likelihood_that_is_zero_in_most_of_the_prior():
    # flat where both lie in a corner of 4 % of the prior: the evidence is that fraction
    def likelihood(theta):
        return np.where(np.all(theta < 2.0, axis=1), 0.0, -np.inf)

    log_prior, sample = priors_of(Prior("uniform", 0, 10), Prior("uniform", 0, 10))
    found = transitional(likelihood, log_prior, sample, rng=np.random.default_rng(5), n_particles=4000)
    assert abs(found.evidence.log_evidence - np.log(0.04)) < 4 * found.evidence.std
    np.testing.assert_allclose(found.evidence.std, np.sqrt(0.96 / (0.04 * 4000)), rtol=0.25)
    assert found.chain.pooled.max() < 2.0


def test_a_likelihood_that_says_nothing_leaves_the_prior():
    log_prior, sample = priors_of(Prior("uniform", 0, 10))
    found = transitional(lambda t: np.full(len(t), -7.0), log_prior, sample, rng=np.random.default_rng(6))
    np.testing.assert_allclose(found.evidence.log_evidence, -7.0, atol=1e-12)
    assert found.evidence.std < 1e-5
    assert found.exponents.tolist() == [0.0, 1.0]


def test_huge_log_likelihoods_neither_overflow_nor_vanish():
    log_prior, sample = priors_of(*UNIFORM[:1])
    for offset in (-1e6, 1e6):
        density = correlated(1)
        found = transitional(lambda t, o=offset, f=density: f(t) + o, log_prior, sample, rng=np.random.default_rng(7))
        assert abs(found.evidence.log_evidence - offset + np.log(10.0)) < 4 * found.evidence.std


def test_the_same_chance_gives_the_same_bits():
    log_prior, sample = priors_of(*UNIFORM[:2])
    heard = []
    run = partial(transitional, correlated(2), log_prior, sample, n_particles=200)
    one, two = run(rng=np.random.default_rng(8)), run(rng=np.random.default_rng(8), progress=heard.append)
    np.testing.assert_array_equal(one.chain.samples, two.chain.samples)
    assert one.evidence == two.evidence
    assert heard == one.exponents[1:].tolist()
    assert heard[-1] == 1.0
    assert np.all(np.diff(one.exponents) > 0)
    assert one.chain.samples.shape == (1, 200, 2)
    np.testing.assert_allclose(
        one.chain.log_density[0], correlated(2)(one.chain.pooled) + log_prior(one.chain.pooled), rtol=1e-12
    )


def test_the_likelihood_is_not_asked_outside_the_prior():
    log_prior, sample = priors_of(Prior("uniform", 0, 10))
    lowest, asked = [], []

    def likelihood(theta):
        lowest.append(theta.min())
        asked.append(len(theta))
        return -theta[:, 0] * 30

    found = transitional(likelihood, log_prior, sample, rng=np.random.default_rng(9), n_particles=300)
    assert min(lowest) >= 0
    assert sum(asked) == found.chain.n_evaluations


def test_what_it_cannot_go_on_with():
    log_prior, sample = priors_of(Prior("uniform", 0, 10))
    rng = np.random.default_rng(1)
    run = partial(transitional, rng=rng, n_particles=50)
    with pytest.raises(NotDeterminedError, match="none of 50 draws of the prior has a likelihood"):
        run(lambda t: np.full(len(t), -np.inf), log_prior, sample)
    with pytest.raises(InputError, match="nan at theta"):
        run(lambda t: np.full(len(t), np.nan), log_prior, sample)
    with pytest.raises(InputError, match="one number for each row"):
        run(lambda t: t, log_prior, sample)
    with pytest.raises(InputError, match="for the same prior"):
        run(lambda t: t[:, 0], log_prior, lambda n, rng: rng.uniform(-10, 0, (n, 1)))
    with pytest.raises(InputError, match="sample_prior returned shape"):
        run(lambda t: t[:, 0], log_prior, lambda n, rng: rng.uniform(0, 1, n))
    with pytest.raises(InputError, match="n_particles is 3"):
        transitional(lambda t: t[:, 0], log_prior, sample, rng=rng, n_particles=3)
