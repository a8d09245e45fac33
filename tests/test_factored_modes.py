"""The modes of a structure as functions of its factors, and posteriors of factors together with laws."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.curves import likelihood_function, slopes_function
from opid.updating.model_class import PAPER_CLASSES, Prior, StiffnessFactor
from opid.updating.posterior import update_class
from opid.updating.sampling.chains import Chain
from opid.updating.sampling.evidence import importance, quadrature
from opid.updating.structure.factored_modes import factored_modes
from opid.updating.structure.reduction import lowest_modes
from opid.virtual.backbone_tests.measured import synthetic_backbones
from opid.virtual.backbone_tests.wing_engine import UPDATED, laws_of_pylons, wing_engine_structure

COVARIANCE = np.diag([1e-4, 1e-5])


@pytest.fixture(scope="module")
def structure():
    return wing_engine_structure()


@pytest.fixture(scope="module")
def factored(structure):
    return factored_modes(structure, UPDATED, COVARIANCE)


@pytest.mark.parametrize("change", [(1.3, 1.0), (1.0, 1.3), (0.8, 1.1)])
def test_the_modes_at_other_factors_are_those_of_the_whole_structure(structure, factored, change):
    factors = factored.reference * change
    exact = lowest_modes(structure.mass, structure.stiffness_at(dict(zip(UPDATED, factors, strict=True))), 8)[0]
    system, couplings = factored.at(factors)
    at_reference = lowest_modes(structure.mass, structure.stiffness_at(UPDATED), 8)[0]
    reduced = factored.base.eigenvalue[6:8] / at_reference[6:] - 1
    np.testing.assert_allclose(system.eigenvalue[6:8] / exact[6:] - 1, reduced, atol=4e-6)
    # d lambda / d theta by the couplings and by differences
    ahead, behind = (factored.at(factors + np.array([side * 1e-4, 0]))[0].eigenvalue for side in (1, -1))
    np.testing.assert_allclose(couplings[0, 7, 7], (ahead[7] - behind[7]) / 2e-4, rtol=1e-5)


def test_factors_without_stiffness_are_refused(factored):
    with pytest.raises(InputError, match="make the stiffness negative"):
        factored.at(np.array([-1.0, 0.3]))


@pytest.fixture(scope="module")
def joint(factored):
    """Backbones of two pylons with laws of their own, and a class whose factors are unknown, too."""
    apart = laws_of_pylons(PAPER_CLASSES[4], PAPER_CLASSES[4])
    measured = synthetic_backbones(
        factored.base, apart, (1.49, 0.51, 1.49, 0.51), rng=np.random.default_rng(3), linear_error=0.0
    )
    data = replace(backbone_data(factored.base, measured), structure=factored)
    factors = tuple(StiffnessFactor(name, Prior("uniform", 0.05, 5.0)) for name in factored.names)
    return data, replace(apart, factors=factors)


def test_the_slopes_of_the_likelihood_are_those_of_differences(joint):
    data, model_class = joint
    likelihood, slopes = likelihood_function(data, model_class), slopes_function(data, model_class)
    theta = np.array([[1.45, 0.55, 1.52, 0.4, 0.885, 0.309], [1.6, 0.2, 1.4, 0.9, 0.87, 0.312]])
    value, gradient = slopes(theta)
    np.testing.assert_allclose(value, likelihood(theta)[0], rtol=1e-12)
    for k in range(theta.shape[1]):
        step = 1e-5 * np.eye(theta.shape[1])[k]
        by_difference = (likelihood(theta + step)[0] - likelihood(theta - step)[0]) / 2e-5
        # the residual flexibility of the modes that are left out moves with the factors by a little more
        assert gradient[:, k] == pytest.approx(by_difference, rel=1e-5 if k < 4 else 0.01, abs=1e-3)


def test_a_theta_without_a_curve_has_no_slope(joint):
    data, model_class = joint
    value, gradient = slopes_function(data, model_class)(np.array([[1.5, 0.5, 1.5, 0.5, 0.06, 0.06]]))
    assert np.isneginf(value).all()
    assert not gradient.any()


def test_six_parameters_at_once_hold_the_truth(joint):
    data, model_class = joint
    found = update_class(data, model_class, rng=np.random.default_rng(0), sampler="nuts", n_samples=1000)
    truth = [1.49, 0.51, 1.49, 0.51, *UPDATED.values()]
    off = [(each.value - true) / each.std for each, true in zip(found.estimates.values(), truth, strict=True)]
    assert np.abs(off).max() < 3
    assert found.diagnostics.effective_samples > 500
    assert found.diagnostics.r_hat < 1.02
    first, second = found.evidences
    assert (first.method, second.method) == ("importance", "laplace")
    assert first.std < 0.05
    assert first.log_evidence == pytest.approx(second.log_evidence, abs=0.5)
    assert [each.key for each in model_class.parameters][-2:] == list(UPDATED)


def test_importance_sampling_is_right_within_its_error():
    rng, support = np.random.default_rng(4), [(0.0, np.inf), (-np.inf, np.inf)]

    def density(theta):
        skewed = -theta[:, 0] + 1.5 * np.log(np.maximum(theta[:, 0], 1e-300))
        return np.where(theta[:, 0] > 0, skewed - 0.5 * (theta[:, 1] - theta[:, 0]) ** 2, -np.inf)

    first = rng.gamma(2.5, size=(4, 1000))
    samples = np.stack([first, first + rng.standard_normal(first.shape)], axis=2)
    chain = Chain(samples, np.zeros(first.shape), 1.0, 0, "exact", 0)
    exact = quadrature(density, samples.mean(axis=(0, 1)), chain.covariance, support=support).log_evidence
    found = [importance(density, chain, rng=rng) for _ in range(20)]
    score = np.array([(each.log_evidence - exact) / each.std for each in found])
    assert np.abs(score).max() < 4
    assert 0.5 < np.sqrt(np.mean(score**2)) < 1.6
