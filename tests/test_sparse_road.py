"""Which law, by sparse regression on the reconstructed motion."""

import numpy as np
import pytest
from law_runs import fitted, runs_of

from opid.errors import InputError
from opid.mechanics.landing_gear import DEFAULT_LAW
from opid.mechanics.laws import default_law
from opid.suspensions.one_gear.sparse_road import force_points, sparse_road, which_law
from opid.suspensions.paper.joint_fit import chosen


def test_the_force_is_that_of_the_true_suspension_and_sensor_noise():
    runs = runs_of(DEFAULT_LAW)
    points = force_points(runs, fitted(runs, DEFAULT_LAW))
    z, v = points.travel, points.velocity
    truth = (3.9e5 * z + 6e3 * v + DEFAULT_LAW.force(z, v)) / 1850
    left = points.force_per_mass - truth
    # the reading's own noise and that of the reconstructed motion
    assert 4e-3 < left.std() < 9e-3
    assert np.corrcoef(points.force_per_mass, truth)[0, 1] > 0.999


@pytest.mark.parametrize("name", ["cubic_stiffness", "arctan_velocity+cubic_stiffness"])
def test_the_true_law_is_proposed_and_chosen(name):
    truth = default_law(name)
    runs = runs_of(truth)
    near = fitted(runs, default_law("coulomb_friction+cubic_stiffness"))
    road = sparse_road(runs, near, n_models=5)
    assert name in road.proposed_by
    assert chosen(road.ladder).law_name == name
    assert chosen(road.ladder).road == "sparse regression"
    assert road.inclusion["cubic_stiffness"] == 1.0
    assert set(road.proposed_by[name]) <= {"STLSQ", "SR3", "SSR", "FROLS"}


def test_both_roads_end_at_the_same_law():
    truth = default_law("quadratic_damping")
    runs = runs_of(truth)
    ladder = which_law(runs, fitted(runs, default_law("cubic_damping")), roads=("pursuit", "sparse regression"))
    assert chosen(ladder).law_name == "quadratic_damping"
    assert {step.road for step in ladder} >= {"pursuit"}


def test_a_road_that_is_none():
    runs = runs_of(DEFAULT_LAW)
    with pytest.raises(InputError, match="no road 'sparce'"):
        which_law(runs, fitted(runs, DEFAULT_LAW), roads=("sparce",))
