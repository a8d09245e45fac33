"""Maximum, Laplace approximation and quadrature against integrals that are known."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import integrate, special, stats

from opid.errors import InputError, NotDeterminedError
from opid.updating.sampling.chains import spread_starts
from opid.updating.sampling.evidence import (
    laplace,
    laplace_of_samples,
    log_probability_inside,
    maximum_a_posteriori,
    quadrature,
)
from opid.updating.sampling.samplers import metropolis

LOW, HIGH = np.array([0.0, 0.0, -20.0]), np.array([10.0, 10.0, 20.0])


def normal(mean, covariance):
    precision, constant = np.linalg.inv(covariance), -0.5 * np.linalg.slogdet(2 * np.pi * np.asarray(covariance))[1]
    return lambda t: constant - 0.5 * np.einsum("ni,ij,nj->n", t - mean, precision, t - mean)


def within(density, support):
    low, high = np.transpose(support)
    return lambda t: np.where(np.all((t >= low) & (t <= high), axis=1), density(t), -np.inf)


def correlated(d, correlation=0.9):
    deviation = np.array([0.01, 0.3, 2.0])[:d]
    matrix = correlation * np.ones((d, d)) + (1 - correlation) * np.eye(d)
    return np.array([1.58, 3.0, 0.0])[:d], matrix * np.outer(deviation, deviation)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_normal_likelihood_with_uniform_priors(d):
    mean, covariance = correlated(d, 0.984 if d == 2 else 0.9)
    support = np.stack([LOW[:d], HIGH[:d]], axis=1)
    truth = -np.log(HIGH[:d] - LOW[:d]).sum()
    likelihood = normal(mean, covariance)
    posterior = within(lambda t: likelihood(t) + truth, support)
    peak = maximum_a_posteriori(posterior, support.mean(axis=1) + 0.1, support=support)
    np.testing.assert_allclose(peak.theta, mean, atol=1e-5)
    np.testing.assert_allclose(peak.covariance, covariance, rtol=1e-6)
    assert not peak.at_bound.any()
    assert laplace(peak, support=support).log_evidence == pytest.approx(truth, abs=1e-6)
    tolerance = {"tolerance": 1e-8} if d == 3 else {"tolerance": 1e-9}
    found = quadrature(posterior, peak.theta, peak.covariance, support=support, **tolerance)
    assert found.log_evidence == pytest.approx(truth, abs=1e-8)
    assert found.std < 1e-8


@pytest.mark.parametrize("d", [1, 2, 3])
def test_normal_likelihood_with_normal_priors(d):
    # y = theta + noise, theta normal: y is normal with both covariances added
    mean, covariance = correlated(d)
    prior_covariance = np.diag([1.0, 2.0, 3.0][:d]) ** 2
    likelihood, prior = normal(mean, covariance), normal(np.zeros(d), prior_covariance)
    truth = stats.multivariate_normal.logpdf(mean, np.zeros(d), covariance + prior_covariance)
    peak = maximum_a_posteriori(lambda t: likelihood(t) + prior(t), np.zeros(d))
    assert laplace(peak).log_evidence == pytest.approx(truth, abs=1e-6)
    found = quadrature(lambda t: likelihood(t) + prior(t), peak.theta, peak.covariance, tolerance=1e-8)
    assert found.log_evidence == pytest.approx(truth, abs=1e-8)


@pytest.mark.parametrize("bound", [-3.0, -1.0, 0.0, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_posterior_cut_off_by_a_bound(bound, side):
    support = [(bound, np.inf)] if side < 0 else [(-np.inf, -bound)]
    density = within(normal(np.zeros(1), np.eye(1)), support)
    peak = maximum_a_posteriori(density, [-side * (bound + 1.3)], support=support)
    truth = special.log_ndtr(-bound)
    assert peak.at_bound[0] == (side if bound > 0 else 0)
    assert laplace(peak, support=support).log_evidence == pytest.approx(truth, abs=1e-8)
    found = quadrature(density, peak.theta, peak.covariance, support=support, tolerance=1e-9)
    assert found.log_evidence == pytest.approx(truth, abs=1e-8)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (1.0, -1.0), (2.0, 0.5), (-0.5, 4.0)])
def test_two_correlated_parameters_in_a_corner(corner):
    covariance = np.array([[1.0, 0.9], [0.9, 1.0]])
    support = [(corner[0], 9.0), (corner[1], 9.0)]
    density = within(normal(np.zeros(2), covariance), support)
    peak = maximum_a_posteriori(density, [5.0, 5.0], support=support)
    # the outer integral by scipy, the inner one in closed form
    inner = stats.norm(0, np.sqrt(1 - 0.9**2)).sf
    truth = np.log(integrate.quad(lambda x: stats.norm.pdf(x) * inner(corner[1] - 0.9 * x), corner[0], 9, epsabs=0)[0])
    assert laplace(peak, support=support).log_evidence == pytest.approx(truth, abs=1e-4)
    found = quadrature(density, peak.theta, peak.covariance, support=support, tolerance=1e-9)
    assert found.log_evidence == pytest.approx(truth, abs=1e-7)


def test_a_density_that_only_falls_from_its_bound():
    support = [(0.0, 10.0)]
    density = within(lambda t: np.log(50.0) - 50.0 * t[:, 0], support)
    peak = maximum_a_posteriori(density, [5.0], support=support)
    assert peak.at_bound.tolist() == [-1.0]
    assert peak.gradient[0] == pytest.approx(-50.0)
    assert laplace(peak, support=support).log_evidence == pytest.approx(0.0, abs=1e-3)
    assert quadrature(density, peak.theta, peak.covariance, support=support).log_evidence == pytest.approx(
        0.0, abs=1e-6
    )


@pytest.mark.parametrize("width", [1.0, 0.5])
def test_quadrature_of_a_banana(width):
    def banana(t):
        return -0.5 * t[:, 0] ** 2 - 0.5 * ((t[:, 1] - t[:, 0] ** 2) / width) ** 2

    peak = maximum_a_posteriori(banana, [-2.0, -3.0])
    np.testing.assert_allclose(peak.theta, 0.0, atol=1e-4)
    truth = np.log(2 * np.pi * width)
    assert quadrature(banana, peak.theta, peak.covariance).log_evidence == pytest.approx(truth, abs=1e-6)


def test_quadrature_of_two_modes_by_the_covariance_of_both():
    one, other = normal(np.array([-1.0]), np.array([[0.01]])), normal(np.array([1.0]), np.array([[0.04]]))

    def both(t):
        return np.logaddexp(np.log(0.3) + one(t), np.log(0.7) + other(t))

    found = quadrature(both, [0.4], 0.3 * 0.01 + 0.7 * 0.04 + 0.21 * 4.0, support=[(-10.0, 10.0)])
    assert found.log_evidence == pytest.approx(0.0, abs=1e-6)


def test_a_lognormal_posterior_agrees_between_the_methods():
    # skewed: Laplace is near, quadrature exact
    density = lambda t: stats.lognorm.logpdf(t[:, 0], 0.2)  # noqa: E731
    peak = maximum_a_posteriori(density, [3.0], support=[(0.0, np.inf)])
    assert peak.theta[0] == pytest.approx(np.exp(-0.04), rel=1e-4)
    assert laplace(peak, support=[(0.0, np.inf)]).log_evidence == pytest.approx(0.0, abs=0.05)
    found = quadrature(density, peak.theta, peak.covariance, support=[(0.0, np.inf)])
    assert found.log_evidence == pytest.approx(0.0, abs=1e-6)


def test_laplace_by_samples_states_its_error():
    mean, covariance = correlated(2)
    density = normal(mean, covariance)
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(12):
        start = spread_starts(density, mean, covariance, n_chains=16, rng=rng)
        chain = metropolis(density, start, covariance=covariance, n_samples=250, n_warm_up=50, rng=rng)
        found = laplace_of_samples(float(density(mean[None])[0]), mean, chain)
        assert 0.01 < found.std < 0.15
        scores.append(found.log_evidence / found.std)
    assert np.abs(scores).max() < 4.5
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.0


# ------------------------------------------------------------------------------------------------ the maximum


@settings(max_examples=15)
@given(
    scale=st.lists(st.floats(1e-6, 1e6), min_size=2, max_size=2),
    correlation=st.floats(-0.99, 0.99),
    start=st.lists(st.floats(-30.0, 30.0), min_size=2, max_size=2),
)
def test_the_maximum_does_not_depend_on_the_units(scale, correlation, start):
    deviation = np.array(scale)
    covariance = np.array([[1.0, correlation], [correlation, 1.0]]) * np.outer(deviation, deviation)
    mean = 5.0 * deviation
    peak = maximum_a_posteriori(normal(mean, covariance), mean + np.array(start) * deviation)
    np.testing.assert_allclose((peak.theta - mean) / deviation, 0.0, atol=1e-4)
    np.testing.assert_allclose(
        peak.covariance / np.outer(deviation, deviation), covariance / np.outer(deviation, deviation), atol=1e-5
    )
    assert laplace(peak).log_evidence == pytest.approx(0.0, abs=1e-5)


def test_the_best_of_several_starts_is_taken():
    def two(t):
        return np.logaddexp(-0.5 * (t[:, 0] + 3) ** 2, 1.0 - 0.5 * (t[:, 0] - 3) ** 2)

    starts = np.linspace(-9.0, 9.0, 40)[:, None]
    assert maximum_a_posteriori(two, starts, support=[(-8, 8)]).theta[0] == pytest.approx(3.0, abs=1e-3)


def test_the_noise_of_an_iterative_model_does_not_reach_the_curvature():
    deviation = np.array([1e-3, 1.0])

    def noisy(t):
        return -1e4 - 0.5 * np.sum((t / deviation) ** 2, axis=1) + 1e-8 * np.sin(1e9 * t[:, 0])

    peak = maximum_a_posteriori(noisy, [0.1, 3.0])
    np.testing.assert_allclose(peak.covariance / np.outer(deviation, deviation), np.eye(2), atol=1e-4)


def test_no_maximum_is_said():
    with pytest.raises(NotDeterminedError, match="flat there") as caught:
        maximum_a_posteriori(lambda t: -0.5 * t[:, 0] ** 2, [1.0, 1.0], support=[(-5, 5), (0, 10)])
    assert caught.value.partial[0] == pytest.approx(0.0, abs=1e-4)
    with pytest.raises(NotDeterminedError, match="give the support"):
        maximum_a_posteriori(lambda t: np.where(t[:, 0] > 0.5, -t[:, 0], -np.inf), [1.0])


@pytest.mark.parametrize(
    ("start", "support", "message"),
    [
        ([-1.0], [(0.0, 10.0)], "no start lies inside the support"),
        ([np.nan], None, "give finite numbers"),
        ([1.0], [(0.0, 10.0), (0.0, 1.0)], "for each of 1 parameter"),
        ([1.0], [(10.0, 0.0)], "for each of 1 parameter"),
    ],
)
def test_bad_starts_and_supports(start, support, message):
    with pytest.raises(InputError, match=message):
        maximum_a_posteriori(lambda t: -(t[:, 0] ** 2), start, support=support)


def test_bad_densities():
    with pytest.raises(InputError, match="one number for each row"):
        maximum_a_posteriori(lambda t: t, [1.0, 2.0])
    with pytest.raises(InputError, match="nan at theta"):
        quadrature(lambda t: np.full(len(t), np.nan), [0.0], 1.0)
    with pytest.raises(InputError, match="one to three parameters"):
        quadrature(lambda t: t[:, 0], np.zeros(4), np.eye(4))
    with pytest.raises(NotDeterminedError, match="zero all around"):
        quadrature(lambda t: np.full(len(t), -np.inf), [0.0], 1.0)
    with pytest.raises(NotDeterminedError, match="did not converge to 1e-06 within"):
        quadrature(lambda t: np.zeros(len(t)), [0.0], 1.0, max_evaluations=10_000)


# ------------------------------------------------------------------------------------------------ boxes


def test_the_probability_of_a_box():
    covariance = np.array([[1.0, 0.5, 0.2], [0.5, 2.0, -0.3], [0.2, -0.3, 0.5]])
    low, high = np.array([-1.0, 0.0, -0.5]), np.array([0.5, 3.0, np.inf])
    exact = stats.multivariate_normal(np.zeros(3), covariance, abseps=1e-9, releps=1e-9, maxpts=2_000_000)
    truth = np.log(exact.cdf(np.minimum(high, 50.0), lower_limit=low))
    assert log_probability_inside(np.zeros(3), covariance, np.stack([low, high], axis=1)) == pytest.approx(
        truth, abs=2e-4
    )


def test_a_box_in_the_far_tail():
    # independent: a sum of logarithms that no probability could hold
    support = [(30.0, np.inf), (-np.inf, -25.0), (-1.0, 1.0)]
    truth = special.log_ndtr(-30.0) + special.log_ndtr(-25.0) + np.log(special.ndtr(1.0) - special.ndtr(-1.0))
    assert log_probability_inside(np.zeros(3), np.eye(3), support) == pytest.approx(truth, rel=1e-9)


def test_bounds_far_away_take_nothing():
    assert log_probability_inside(np.zeros(2), np.eye(2), [(-9.0, 9.0), (-np.inf, np.inf)]) == 0.0


def test_in_a_steep_corner_chains_are_given_the_width_of_the_slopes():
    """exp(-a x - b y) in a corner, with a ridge across it that bends hardly at all: deviations 1/a and 1/b."""
    slopes = np.array([3e4, 5e4])

    def ridge(t):
        inward = t - np.array([0.2, 0.3])
        along = inward @ np.array([1.0, -1.0])
        return -inward @ slopes - 0.5 * (0.6 * inward @ slopes) ** 2 * 1e-3 - 0.5 * along**2

    support = [(0.2, 1.0), (0.3, 1.0)]
    density = within(ridge, support)
    peak = maximum_a_posteriori(density, [0.5, 0.6], support=support)
    np.testing.assert_allclose(peak.theta, [0.2, 0.3])
    assert np.sqrt(np.diag(peak.covariance)).max() > 1e-2
    np.testing.assert_allclose(np.sqrt(np.diag(peak.covariance_inside)), 1 / slopes, rtol=0.01)
    rng = np.random.default_rng(0)
    start = spread_starts(density, peak.theta, peak.covariance_inside, n_chains=4, rng=rng)
    settings = {"covariance": peak.covariance_inside, "n_samples": 2000, "n_warm_up": 500, "rng": rng}
    samples = metropolis(density, start, **settings).pooled
    np.testing.assert_allclose(samples.mean(axis=0) - [0.2, 0.3], 1 / slopes, rtol=0.15)


def test_a_steep_density_that_curves_upward_at_its_bound_has_the_width_of_its_slope():
    """log p = a (t - 1) + b (t - 1)^2 up to 1, of a law far from the data: it falls off over 1 / a, whatever b."""
    a, b = 1e6, 4e8
    density = within(lambda t: (a * (t - 1) + b * (t - 1) ** 2).sum(axis=1), [(0.999, 1.0)])
    peak = maximum_a_posteriori(density, [0.9999], support=[(0.999, 1.0)])
    assert peak.theta.tolist() == [1.0]
    assert peak.hessian[0, 0] == pytest.approx(2 * b, rel=1e-3)
    assert np.sqrt(peak.covariance_inside[0, 0]) == pytest.approx(1 / a, rel=0.1)
