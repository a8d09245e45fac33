"""Restoring-force points, bins and slices on motions whose law is known."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import Law
from opid.suspensions.paper.restoring_force import RestoringForce, binned_surface, restoring_force, slice_curve
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run


@pytest.fixture(scope="module")
def run():
    return taxi_run(LandingGear(law=Law()), rng=np.random.default_rng(0), duration_s=20, fs=256)


def test_the_surface_of_a_linear_gear_is_its_plane(run):
    gear = run.gear
    surface = restoring_force(run.recording.channel("lower_z"), run.recording.channel("upper_z"), fs=256)
    plane = (
        gear.suspension_stiffness_n_per_m * surface.travel + gear.suspension_damping_n_s_per_m * surface.velocity
    ) / gear.sprung_mass_kg
    assert np.std(surface.force_per_mass - plane) < 0.02 * plane.std()


def test_the_travel_is_the_true_one_but_for_its_slow_part(run):
    surface = restoring_force(run.recording.channel("lower_z"), run.recording.channel("upper_z"), fs=256)
    margin = (run.recording.n_samples - surface.travel.size) // 2
    true = run.truth.channel("travel")[margin:-margin]
    assert np.corrcoef(surface.travel, true)[0, 1] > 0.995


def test_bins_hold_every_point_once_and_their_means(run):
    rng = np.random.default_rng(1)
    z, v = rng.standard_normal((2, 20_000))
    force = 2 * z - v + 0.1 * rng.standard_normal(z.size)
    grid = binned_surface(RestoringForce(z, v, force, 100.0), n_travel=20, n_velocity=30)
    assert grid.counts.sum() == z.size
    centre_z, centre_v = grid.centres
    full = grid.counts > 100
    np.testing.assert_allclose(grid.mean[full], (2 * centre_z - centre_v)[full], atol=0.15)
    assert np.isnan(grid.mean[~grid.visited]).all()
    assert 0.1 < grid.coverage < 0.9
    # within a cell the plane itself spreads evenly, and the noise adds to it
    width_z, width_v = np.diff(grid.travel_edges)[0], np.diff(grid.velocity_edges)[0]
    expected = np.sqrt(((2 * width_z) ** 2 + width_v**2) / 12 + 0.01)
    np.testing.assert_allclose(np.median(grid.scatter[full]), expected, rtol=0.05)


def test_slices_lie_near_their_axis():
    z, v = np.random.default_rng(2).standard_normal((2, 20_000))
    points = RestoringForce(z, v, 2 * z + 5 * v, 100.0)
    stiffness, damping = (slice_curve(points, along=along, half_width_std=0.1) for along in ("travel", "velocity"))
    assert np.abs(v[stiffness.sample]).max() <= stiffness.half_width
    np.testing.assert_allclose(np.polyfit(stiffness.position, stiffness.force_per_mass, 1)[0], 2, rtol=0.05)
    np.testing.assert_allclose(np.polyfit(damping.position, damping.force_per_mass, 1)[0], 5, rtol=0.05)


def test_bad_input_is_named(run):
    lower, upper = run.recording.channel("lower_z"), run.recording.channel("upper_z")
    with pytest.raises(InputError, match=r"to settle|three periods"):
        restoring_force(lower[:1700], upper[:1700], fs=256)
    surface = restoring_force(lower, upper, fs=256)
    with pytest.raises(InputError, match="'travel' or 'velocity'"):
        slice_curve(surface, along="speed")
    with pytest.raises(InputError, match="samples of the record lie near the axis of the travel"):
        slice_curve(surface, along="travel", half_width_std=1e-6)
    with pytest.raises(InputError, match="2 x 2"):
        binned_surface(surface, n_travel=1)
    with pytest.raises(InputError, match="moved as one"):
        binned_surface(RestoringForce(*np.zeros((3, 100)), 100.0))
