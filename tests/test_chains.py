"""Chains, their diagnostics and their export."""

import sys

import numpy as np
import pytest
from scipy.signal import lfilter

from opid.errors import InputError
from opid.updating.model_class import Prior
from opid.updating.sampling.chains import (
    Chain,
    covariance_root,
    diagnose,
    effective_samples,
    evaluate,
    find_pressures,
    split_r_hat,
    spread_starts,
    starting_densities,
    to_inference_data,
)


def autoregressive(rng, shape, memory):
    """x_k = memory x_(k-1) + noise, stationary from the first sample."""
    noise = rng.standard_normal(shape)
    noise[:, 0] /= np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], noise, axis=1)


@pytest.fixture
def three_columns():
    """An autoregressive process, the same with one chain elsewhere, the same with a heavy tail."""
    x = lfilter([1.0], [1.0, -0.8], np.random.default_rng(0).standard_normal((4, 501, 3)), axis=1)
    x[1, :, 1] += 1.0
    x[..., 2] = np.exp(x[..., 2])
    return x


def chain_of(samples):
    return Chain(samples, -0.5 * np.sum(samples**2, axis=-1), 0.3, samples.shape[0] * samples.shape[1], "metropolis", 0)


def test_effective_samples_and_r_hat_are_those_of_arviz(three_columns):
    # ArviZ 0.23.4: ess(method="bulk"), ess(method="mean"), rhat()
    bulk = [196.60518233808548, 193.262530149934, 225.2723307607192]
    mean = [196.79455593972483, 190.72390102876952, 356.71525225880976]
    r_hat = [1.0274425579785567, 1.0304516225595977, 1.0129043521220569]
    np.testing.assert_allclose(effective_samples(three_columns), bulk, rtol=1e-8)
    np.testing.assert_allclose(effective_samples(three_columns, ranked=False), mean, rtol=1e-8)
    np.testing.assert_allclose(split_r_hat(three_columns), r_hat, rtol=1e-10)


@pytest.mark.parametrize("memory", [-0.5, 0.0, 0.9, 0.99])
@pytest.mark.parametrize(("n_chains", "n"), [(2, 9), (4, 500), (3, 1001)])
def test_diagnostics_agree_with_the_arviz_that_is_installed(n_chains, n, memory):
    arviz = pytest.importorskip("arviz")
    x = autoregressive(np.random.default_rng(n), (n_chains, n, 1), memory)
    for method in ("bulk", "mean"):
        expected = arviz.ess(x[..., 0], method=method)
        np.testing.assert_allclose(effective_samples(x, ranked=method == "bulk"), expected, rtol=1e-9)
    np.testing.assert_allclose(split_r_hat(x), arviz.rhat(x[..., 0]), rtol=1e-9)


@pytest.mark.parametrize("memory", [-0.3, 0.0, 0.5, 0.9])
def test_effective_samples_of_an_autoregressive_process(memory):
    # the correlation memory^k sums to (1 + memory) / (1 - memory)
    x = autoregressive(np.random.default_rng(3), (4, 20000, 1), memory)
    np.testing.assert_allclose(effective_samples(x)[0], 80000 * (1 - memory) / (1 + memory), rtol=0.12)


def test_diagnostics_do_not_depend_on_unit_offset_or_order_of_chains(three_columns):
    moved = 1e6 * three_columns[::-1] + 3e8
    np.testing.assert_allclose(effective_samples(moved), effective_samples(three_columns), rtol=1e-6)
    np.testing.assert_allclose(split_r_hat(moved), split_r_hat(three_columns), rtol=1e-4)  # rounding makes ties


def test_chains_that_stand_still_are_seen():
    rng = np.random.default_rng(1)
    stuck = np.repeat(rng.standard_normal((4, 1, 1)), 100, axis=1)
    assert split_r_hat(stuck)[0] > 1e3
    assert effective_samples(np.ones((2, 50, 1)))[0] == 1.0
    one_stuck = rng.standard_normal((4, 500, 1))
    one_stuck[2] = one_stuck[2, 0]
    assert split_r_hat(one_stuck)[0] > 1.05


def test_chains_of_another_width_are_seen():
    wide = np.random.default_rng(1).standard_normal((4, 500, 1))
    wide[3] *= 3.0
    assert split_r_hat(wide)[0] > 1.1  # by the folded ranks; the means agree


def test_diagnosis_names_the_worst_parameter(three_columns):
    found = diagnose(chain_of(three_columns))
    assert found.n_samples == 4 * 501
    assert found.effective_samples == effective_samples(three_columns).min()
    assert found.r_hat == split_r_hat(three_columns).max()
    assert np.isnan(diagnose(chain_of(three_columns[:1])).r_hat)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((4, 3, 1)), "at least four samples"),
        (np.zeros((4, 30)), "give \\(chains, samples, parameters\\)"),
        (np.full((2, 10, 1), np.nan), "not finite"),
    ],
)
def test_diagnostics_refuse_what_they_cannot_judge(samples, message):
    with pytest.raises(InputError, match=message):
        effective_samples(samples)
    with pytest.raises(InputError, match=message):
        split_r_hat(samples)


def test_a_chain_pools_thins_and_knows_its_best():
    samples = np.arange(12.0).reshape(2, 3, 2)
    chain = Chain(samples, np.array([[0.0, 1.0, 2.0], [5.0, 4.0, 3.0]]), 0.3, 6, "metropolis", 0)
    assert chain.best.tolist() == [6.0, 7.0]
    assert chain.pooled.shape == (6, 2)
    assert chain.thinned(3)[[0, -1]].tolist() == [[0.0, 1.0], [10.0, 11.0]]
    assert len(chain.thinned(100)) == 6


# ------------------------------------------------------------------------------------------------ priors


def test_a_posterior_well_inside_presses_against_nothing():
    rng = np.random.default_rng(2)
    draws = np.stack([rng.normal(5, 1, 3000), rng.normal(0, 0.9, 3000), np.exp(rng.normal(0.1, 0.2, 3000))], axis=1)
    priors = [Prior("uniform", 0, 10), Prior("normal", 0, 1), Prior("lognormal", 1, 0.5)]
    assert find_pressures(draws, priors) == ()


@pytest.mark.parametrize("n", [200, 5000])
def test_the_side_of_each_prior_is_named(n):
    rng = np.random.default_rng(2)
    draws = np.stack(
        [
            np.abs(rng.normal(0, 0.1, n)),
            10 - rng.exponential(0.5, n),
            rng.uniform(-1, 1, n),
            rng.normal(-4, 0.3, n),
            np.exp(rng.normal(2, 0.1, n)),
        ],
        axis=1,
    )
    priors = [Prior("uniform", 0, 10), Prior("uniform", 0, 10), Prior("uniform", -1, 1), Prior("normal", 0, 1)]
    found = find_pressures(draws, [*priors, Prior("lognormal", 1, 0.5)])
    sides = [(each.parameter, each.side) for each in found]
    assert sides == [(1, "lower"), (2, "upper"), (3, "lower"), (3, "upper"), (4, "lower"), (5, "upper")]
    assert found[1].sentence.startswith("presses against the upper end 10")
    assert "4.0 standard deviations out on the lower side of its normal prior" in found[4].sentence


@pytest.mark.parametrize(("deviations", "pressed"), [(1.5, True), (2.8, False)])
def test_a_bound_counts_by_the_density_there(deviations, pressed):
    # exp(-1.5^2 / 2) = 0.32 and exp(-2.8^2 / 2) = 0.02 of the largest density
    draws = np.random.default_rng(3).normal(deviations, 1.0, 20000)
    assert bool(find_pressures(draws[draws > 0][:, None], [Prior("uniform", 0, 100)])) == pressed


def test_pressure_refuses_what_it_cannot_judge():
    with pytest.raises(InputError, match="one column for each of 2"):
        find_pressures(np.zeros((500, 1)), [Prior(), Prior()])
    with pytest.raises(InputError, match="50 samples are too few"):
        find_pressures(np.zeros((50, 1)), [Prior()])


# ------------------------------------------------------------------------------------------------ densities, starts


def test_a_density_is_refused_with_the_theta_it_failed_at():
    theta = np.array([[0.0, 1.0], [2.0, 3.0]])
    with pytest.raises(InputError, match=r"shape \(2, 2\) has shape \(2, 1\)"):
        evaluate(lambda t: t[:, :1], theta)
    with pytest.raises(InputError, match=r"nan at theta = \(2, 3\)"):
        evaluate(lambda t: np.where(t[:, 0] > 1, np.nan, 0.0), theta)
    with pytest.raises(InputError, match=r"inf at theta = \(0, 1\)"):
        evaluate(lambda t: np.where(t[:, 0] < 1, np.inf, 0.0), theta)
    assert evaluate(lambda t: np.full(len(t), -np.inf), theta).tolist() == [-np.inf, -np.inf]


def test_starts_outside_the_support_are_named():
    with pytest.raises(InputError, match=r"chain 2 starts outside the support, at theta = \(-1\)"):
        starting_densities(lambda t: np.where(t[:, 0] >= 0, 0.0, -np.inf), [[1.0], [-1.0]])
    with pytest.raises(InputError, match="finite numbers"):
        starting_densities(lambda t: np.zeros(len(t)), [[np.nan]])


def test_spread_starts_are_wide_and_inside():
    rng = np.random.default_rng(4)
    flat = spread_starts(lambda t: np.zeros(len(t)), [1.0, 2.0], np.diag([1.0, 1e-6]), n_chains=4000, rng=rng)
    np.testing.assert_allclose(flat.std(axis=0), [2.0, 2e-3], rtol=0.05)
    half = spread_starts(lambda t: np.where(t[:, 0] >= 0, 0.0, -np.inf), [0.01], 1.0, n_chains=50, rng=rng)
    assert half.shape == (50, 1)
    assert (half >= 0).all()
    with pytest.raises(InputError, match="edge of the support"):
        spread_starts(lambda t: np.where(t[:, 0] == 0, 0.0, -np.inf), [0.0], 1.0, n_chains=5, rng=rng)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.eye(3), "has shape"),
        ([[1.0, 0.5], [0.0, 1.0]], "not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "not positive definite"),
        ([1.0, 0.0], "not positive definite"),
        ([[np.nan, 0.0], [0.0, 1.0]], "not finite"),
    ],
)
def test_a_wrong_covariance_is_refused(covariance, message):
    with pytest.raises(InputError, match=message):
        covariance_root(covariance, 2)


# ------------------------------------------------------------------------------------------------ export


def test_without_arviz_the_groups_are_plain(monkeypatch, three_columns):
    monkeypatch.setitem(sys.modules, "arviz", None)
    chain = chain_of(three_columns)
    groups = to_inference_data(chain, ["a", "b", "c"])
    assert list(groups["posterior"]) == ["a", "b", "c"]
    np.testing.assert_array_equal(groups["posterior"]["b"], three_columns[:, :, 1])
    np.testing.assert_array_equal(groups["sample_stats"]["lp"], chain.log_density)
    with pytest.raises(InputError, match="give 3 different"):
        to_inference_data(chain, ["a", "b"])
    with pytest.raises(InputError, match="give 3 different"):
        to_inference_data(chain, ["a", "b", "b"])


def test_with_arviz_its_own_object_is_returned(three_columns):
    pytest.importorskip("arviz")
    data = to_inference_data(chain_of(three_columns), ["a", "b", "c"])
    assert dict(data["posterior"].sizes) == {"chain": 4, "draw": 501}
    np.testing.assert_array_equal(data["posterior"]["c"].to_numpy(), three_columns[:, :, 2])
    assert "lp" in data["sample_stats"]
