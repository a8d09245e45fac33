"""Intervals that hold for a coloured residual, and numbers that are what they are called."""

import numpy as np
import pytest
from law_runs import DAMPING, MASS_KG, STIFFNESS, fitted, logs_of, runs_of, shared

from opid.estimate import Estimate
from opid.mechanics.laws.law import LINEAR
from opid.suspensions.answer.intervals import (
    Parameters,
    bootstrap_over_white,
    honest_covariance,
    std_over_white,
    withhold_frequency,
)
from opid.suspensions.fitting.noise import measure_whiteness
from opid.suspensions.fitting.repeatability import Levels
from opid.suspensions.model.run import driven_run
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW
from opid.virtual.taxi_tests.sensors import Sensor


@pytest.fixture(scope="module")
def fit():
    return fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)


def known_of(fit):
    return Parameters(fit, honest_covariance(fit))


@pytest.fixture(scope="module")
def known(fit):
    return known_of(fit)


def test_all_deviations_agree_where_the_residual_is_white():
    ratios = []
    for seed in range(6):
        one = fitted(runs_of(DEFAULT_LAW, seed), DEFAULT_LAW)
        n = one.model.n_shared
        wider = std_over_white(one)[:n]
        assert np.all(wider >= 1.0)
        ratios.append([wider, bootstrap_over_white(one, np.random.default_rng(seed))[:n]])
        np.testing.assert_allclose(np.sqrt(np.diag(honest_covariance(one)))[:n], one.std * wider)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.2)


def test_a_bootstrap_is_repeated_by_its_seed(fit):
    first, again, other = (bootstrap_over_white(fit, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(other, first, rtol=0.4)
    assert np.any(other != first)


@pytest.mark.parametrize(("sensor", "law"), [({}, LINEAR), ({"cross_axis": 0.03}, DEFAULT_LAW)])
def test_deviations_of_a_coloured_residual_cover_where_plain_ones_do_not(sensor, law):
    """Mass and stiffness to mass, 12 seeds: the error over the deviation should be 1 in the mean square."""
    plain, coloured, resampled = [], [], []
    for seed in range(12):
        faults = {"lower_sensor": Sensor(**sensor), "upper_sensor": Sensor(**sensor)}
        one = fitted(runs_of(DEFAULT_LAW, seed, **faults), law)
        assert not measure_whiteness(one).white
        chosen = [0, one.model.names.index("inverse_mass")]
        error = (shared(one)[chosen] - [STIFFNESS / MASS_KG, 1 / MASS_KG]) / one.std[chosen]
        plain.append(error)
        coloured.append(error / std_over_white(one)[chosen])
        resampled.append(error / bootstrap_over_white(one, np.random.default_rng(seed))[chosen])
    before = np.sqrt(np.mean(np.square(plain), axis=0))
    assert np.all(before > 1.2)
    for better in (coloured, resampled):
        after = np.sqrt(np.mean(np.square(better), axis=0))
        assert np.all(after < 0.85 * before)
        assert np.all(after < 2.0)


def test_numbers_in_newtons_are_ratios_times_the_mass(known):
    mass = known.mass
    stiffness, damping, laws = known.suspension(0)
    per_mass, damping_per_mass, laws_per_mass = known.suspension(0, per_mass=True)
    assert abs(mass.value - MASS_KG) < 4 * mass.std < 0.02 * MASS_KG
    assert stiffness.value == pytest.approx(per_mass.value * mass.value)
    assert damping.value == pytest.approx(damping_per_mass.value * mass.value)
    amplitude = laws["arctan_velocity"]["amplitude_n"]
    assert amplitude.value == pytest.approx(laws_per_mass["arctan_velocity"]["amplitude_n"].value * mass.value)
    assert laws["arctan_velocity"]["scale_m_per_s"] == laws_per_mass["arctan_velocity"]["scale_m_per_s"]
    # the interval of the mass is longer upwards: that of its inverse is even
    low, high = mass.interval95
    assert high - mass.value > mass.value - low
    assert 1 / low - 1 / mass.value == pytest.approx(1 / mass.value - 1 / high)


def test_deviations_are_those_of_draws_from_the_covariance(fit, known):
    """First-order propagation against the spread of the same formulas over many vectors."""
    draws = np.random.default_rng(0).multivariate_normal(fit.theta, known.covariance, 20_000)
    k, c, mu = (
        draws[:, fit.model.names.index(f"{name}")]
        for name in ("stiffness_per_mass", "damping_per_mass", "inverse_mass")
    )
    ratios = known.gear_ratios(Estimate(0.0))
    stiffness, damping, _ = known.suspension(0)
    for estimate, values in (
        (stiffness, k / mu),
        (damping, c / mu),
        (known.mass, 1 / mu),
        (ratios.natural_frequency_hz, np.sqrt(k) / (2 * np.pi)),
        (ratios.damping_ratio, c / (2 * np.sqrt(k))),
    ):
        assert estimate.std == pytest.approx(values.std(), rel=0.05)
        assert estimate.value == pytest.approx(values.mean(), abs=0.2 * estimate.std)
    assert abs(ratios.damping_ratio.value - DAMPING / (2 * np.sqrt(STIFFNESS * MASS_KG))) < 4 * ratios.damping_ratio.std


@pytest.mark.parametrize("has_levels", [False, True])
def test_what_is_not_defined_has_no_estimate(fit, known, has_levels):
    """A suspension that does not spring back has no frequency, whether the runs may differ or not."""
    covariance = known.covariance
    mixture = Levels(np.array([0.01]), np.ones(1), np.ones(1), np.zeros((1, fit.theta.size)), covariance[np.newaxis])
    parameters = Parameters(fit, covariance, mixture) if has_levels else known

    def of_vector(theta):
        with np.errstate(invalid="ignore"):
            return np.array([theta[0], np.sqrt(-theta[0]), np.sqrt(theta[0] - fit.theta[0]), 5.0])

    stiffness, frequency, at_its_edge, constant = parameters.estimate_function(of_vector)
    assert stiffness.value == fit.theta[0]
    assert stiffness.std == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    assert (frequency, at_its_edge) == (Estimate(), Estimate())
    assert constant == Estimate.normal(5.0, 0.0)


def test_an_entry_that_nothing_determines_has_the_numbers_of_the_others(fit, known):
    """The logarithm of a stop's stiffness that is never reached: a step of its own deviation would be no number."""
    covariance = known.covariance.copy()
    covariance[1, 1] = 1e12
    parameters = Parameters(fit, covariance)
    stiffness, stop = parameters.estimate_function(lambda theta: np.array([theta[0], np.exp(theta[1])]))
    assert stiffness.std == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    assert stop.std > 1e4 * stop.value


def test_no_ground_spring_is_zero_as_well_as_it_would_be_known(known):
    assert known.ground(0, None, per_mass=False) == Estimate(0.0)
    told = known.ground(0, 1.0, per_mass=False)
    # none is known better than gains are equal, 0.1 %
    least = 1e-3 * known.suspension(0)[0].value
    assert (told.value, told.std) == (0.0, pytest.approx(np.hypot(known.mass.value, least)))


def test_a_mass_change_of_the_wrong_sign_is_a_negative_mass(known):
    runs = [
        driven_run(log.channel("lower_z"), log.channel("upper_z"), fs=log.fs, loading=-change)
        for log, change in logs_of()
    ]
    wrong = known_of(fitted(runs, DEFAULT_LAW))
    assert wrong.has_negative_mass
    assert wrong.mass == Estimate(None)
    assert not known.has_negative_mass


def test_a_frequency_that_may_as_well_be_zero_is_withheld():
    frequency, zeta = Estimate.normal(2.0, 12.0), Estimate.normal(0.2, 1.6)
    assert withhold_frequency(frequency, zeta) == (Estimate(), Estimate())
    loose = Estimate.normal(2.0, 1.5)
    assert withhold_frequency(loose, zeta) == (Estimate(2.0, 1.5, (0.0, 2.0 + 1.96 * 1.5)), zeta), "none is negative"
    known = Estimate.normal(2.0, 0.1)
    assert withhold_frequency(known, zeta) == (known, zeta)
    assert withhold_frequency(Estimate(2.0), zeta) == (Estimate(2.0), zeta), "without an interval the value stands"
