"""The force without a law: flat beside the true law, a hill where a term is missing."""

import numpy as np
import pytest
from law_runs import DAMPING, MASS_KG, STIFFNESS, fitted, runs_of

from opid import identify
from opid.mechanics.laws.law import LINEAR, law
from opid.suspensions.fitting.fit import refit
from opid.suspensions.law_search.force_surface import force_points, force_surface
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test


@pytest.fixture(scope="module")
def fit():
    return fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)


@pytest.fixture(scope="module")
def linear(fit):
    return refit(fit, {"": LINEAR})


def test_the_force_is_that_of_the_true_suspension_and_sensor_noise(fit):
    points = force_points(fit, 0)
    z, v = points.travel, points.velocity
    truth = (STIFFNESS * z + DAMPING * v + DEFAULT_LAW.force(z, v)) / MASS_KG
    # the reading's own noise and that of the reconstructed motion; of the lighter run the force is as large
    assert 4e-3 < (points.force_per_mass - truth).std() < 9e-3
    assert np.corrcoef(points.force_per_mass, truth)[0, 1] > 0.999


def test_the_true_law_leaves_nothing_but_chance(fit):
    surface = force_surface(fit, 0)
    departures = surface.departure[np.isfinite(surface.departure)]
    assert departures.size > 40
    # standard normal: its spread within three standard errors of 1
    assert abs(departures.std() - 1) < 3 / np.sqrt(2 * departures.size) + 0.1
    assert surface.largest_standard_errors < surface.expected_standard_errors + 1
    np.testing.assert_array_equal(surface.count >= 20, np.isfinite(surface.mean))


def test_sections_are_the_true_law(fit):
    section = force_surface(fit, 0).along_velocity
    known = np.isfinite(section.mean)
    truth = DEFAULT_LAW.force(0.0, section.position[known]) / MASS_KG
    assert np.max(np.abs(section.mean[known] - truth)) < 4 * np.max(section.standard_error[known]) + 2e-3
    np.testing.assert_allclose(section.law[known], truth, atol=5e-3)


def test_a_missing_law_stands_out(linear):
    surface = force_surface(linear, 0)
    assert surface.largest_standard_errors > 3 * surface.expected_standard_errors
    assert surface.largest_percent > 1
    assert surface.law_name == "linear"


def test_the_force_is_told_over_the_travel_from_where_the_reference_run_rests():
    """Of the lighter run, too, which rests five millimetres elsewhere on a law that hardens."""
    hardening = law("cubic_stiffness", stiffness_n_per_m3=3e9)
    test = taxi_test(LandingGear(law=hardening), rng=np.random.default_rng(0), duration_s=12.0)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    points = force_points(identify(study, law="cubic_stiffness").evidence[0].fit, 0)
    z, v, gear = points.travel, points.velocity, test.heavy.gear
    half = z.size // 2
    travel = test.light.truth.channel("travel") + test.light.gear.law.rest_m
    assert z[half:].mean() == pytest.approx(travel.mean(), abs=2e-4)
    truth = gear.suspension_stiffness_n_per_m * z + gear.suspension_damping_n_s_per_m * v + hardening.force(z, v)
    missed = points.force_per_mass - truth / gear.sprung_mass_kg
    assert abs(missed[half:].mean() - missed[:half].mean()) < 0.02
    assert missed.std() < 0.03
