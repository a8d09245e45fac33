"""The force without a law: flat beside the true law, a hill where a term is missing."""

import numpy as np
import pytest
from law_runs import fitted, runs_of

from opid.mechanics.landing_gear import DEFAULT_LAW
from opid.mechanics.laws import LINEAR
from opid.plots.laws import force_departures, force_sections, model_ladder
from opid.suspensions.one_gear.force_surface import force_surface
from opid.suspensions.one_gear.refit import refit
from opid.suspensions.paper.joint_fit import LadderStep


@pytest.fixture(scope="module")
def fits():
    runs = runs_of(DEFAULT_LAW)
    fit = fitted(runs, DEFAULT_LAW)
    return runs, fit, refit(runs, fit, LINEAR)


def test_the_true_law_leaves_nothing_but_chance(fits):
    runs, fit, _ = fits
    surface = force_surface(runs, fit)
    departures = surface.departure[np.isfinite(surface.departure)]
    assert departures.size > 40
    # standard normal: its spread within three standard errors of 1
    assert abs(departures.std() - 1) < 3 / np.sqrt(2 * departures.size) + 0.1
    assert surface.largest_standard_errors < surface.expected_standard_errors + 1
    np.testing.assert_array_equal(surface.count >= 20, np.isfinite(surface.mean))


def test_sections_are_the_true_law(fits):
    runs, fit, _ = fits
    section = force_surface(runs, fit).along_velocity
    known = np.isfinite(section.mean)
    truth = DEFAULT_LAW.force(0.0, section.position[known]) / 1850
    assert np.max(np.abs(section.mean[known] - truth)) < 4 * np.max(section.standard_error[known]) + 2e-3
    np.testing.assert_allclose(section.law[known], truth, atol=5e-3)


def test_a_missing_law_stands_out(fits):
    runs, _, linear = fits
    surface = force_surface(runs, linear)
    assert surface.largest_standard_errors > 3 * surface.expected_standard_errors
    assert surface.largest_percent > 1
    assert surface.law_name == "linear"


def test_figures_show_what_is_in_the_record(fits):
    runs, fit, linear = fits
    surface = force_surface(runs, fit)
    departures = force_departures(surface)
    np.testing.assert_array_equal(departures.collections[0].get_array().mask, ~np.isfinite(surface.departure.T))
    curve = force_sections(surface)[0, 1].get_lines()[1]
    np.testing.assert_array_equal(curve.get_ydata(), surface.along_velocity.law)
    ladder = (
        LadderStep("linear", linear, True, "pursuit"),
        LadderStep(fit.law.name, fit, True, "sparse regression", left_out_m_per_s2=6e-3),
    )
    ax = model_ladder(ladder, noise_floor_m_per_s2=5e-3)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["linear", "arctan velocity (sparse)"]
    diamond = next(line for line in ax.get_lines() if line.get_marker() == "D")
    np.testing.assert_allclose(diamond.get_xdata(), [6.0])
