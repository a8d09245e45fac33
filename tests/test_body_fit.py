"""The fit of a body to short runs of an aircraft with known truth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_runs import NOISE, aircraft, short_runs, study

from opid.errors import InputError
from opid.mechanics.laws import LINEAR, law
from opid.mechanics.structure import Structure
from opid.suspensions.candidates import (
    fitted_alone,
    fitted_rigid,
    left_out_level,
    loading_matrix,
    mass_is_told,
    shares,
)
from opid.suspensions.equation import start_values
from opid.suspensions.fit import body_model, first_vector, fit_body, with_laws
from opid.suspensions.intervals import body_estimates, honest_covariance, suspension_estimates
from opid.suspensions.laws import search_laws
from opid.suspensions.levels import is_white
from opid.suspensions.model import Group
from opid.suspensions.one_gear.pursuit import library
from opid.suspensions.run import body_run
from opid.suspensions.structure import own_body, rigid_body
from opid.suspensions.study import MeasuredInterface, PointMass

FRICTION = law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02)
BAND = (0.3, 40.0)


def arrays_of(given):
    below, above = ([f"{name}_{side}_z" for name in given.names] for side in ("lower", "upper"))
    return [
        tuple(np.stack([run.recording.channel(name) for name in names], axis=1) for names in (below, above))
        for run in given.runs
    ]


def fitted(given, kind_of_law=FRICTION):
    return fitted_rigid(given, arrays_of(given), np.full(2, NOISE), law=kind_of_law, band_hz=BAND)


@pytest.fixture(scope="module")
def found():
    return fitted(study())


def near(estimate, truth):
    """Within four standard deviations, which are small beside the value."""
    return abs(estimate.value - truth) < 4 * estimate.std and estimate.std < 0.03 * abs(truth)


def test_mass_inertias_and_centre_of_gravity_are_those_of_the_aircraft(found):
    true = aircraft()
    parameters, ratios = body_estimates(found.fit, honest_covariance(found.fit))
    assert near(parameters["sprung_mass_kg"], true.mass_kg)
    assert near(parameters["roll_inertia_kg_m2"], true.ixx_kg_m2)
    assert near(parameters["pitch_inertia_kg_m2"], true.iyy_kg_m2)
    assert near(ratios["pitch_radius_m"], np.sqrt(true.iyy_kg_m2 / true.mass_kg))
    assert near(ratios["roll_radius_m"], np.sqrt(true.ixx_kg_m2 / true.mass_kg))
    assert near(ratios["x_cg_m"], true.x_cg_m)
    assert abs(ratios["y_cg_m"].value) < 4 * ratios["y_cg_m"].std < 0.02


def test_suspensions_are_those_of_the_aircraft(found):
    covariance = honest_covariance(found.fit)
    for number, gear in enumerate(aircraft().gears):
        stiffness, damping, laws = suspension_estimates(found.fit, covariance, number)
        truth = gear.law.parameters["arctan_velocity"]
        assert near(stiffness, gear.suspension_stiffness_n_per_m)
        assert abs(damping.value - gear.suspension_damping_n_s_per_m) < 4 * damping.std
        for name, estimate in laws["arctan_velocity"].items():
            assert abs(estimate.value - truth[name]) < 4 * estimate.std, (gear.name, name)
        assert laws["arctan_velocity"]["amplitude_n"].std < 0.2 * truth["amplitude_n"]


def test_what_is_left_is_the_noise_and_white(found):
    assert found.explains
    assert 0.97 < found.residual_over_noise < 1.03
    assert is_white(found.fit)
    assert found.fit.n_data == 2 * sum(line.size for line in found.fit.errors.lines)
    assert found.fit.variance == pytest.approx((found.fit.level / NOISE) ** 2)


def test_a_run_that_is_left_out_is_predicted_to_the_noise(found):
    assert 0.95 < found.left_out / NOISE < 1.1
    alone = study(runs=short_runs()[:1])
    assert left_out_level(fitted(alone).fit) is None


def test_the_search_finds_friction_at_every_gear():
    """From linear suspensions."""
    linear = fitted(study(), LINEAR)
    assert linear.residual_over_noise > 1.2
    best, steps = search_laws(linear.fit)
    for number, (group, gear) in enumerate(zip(best.groups(), aircraft().gears, strict=True)):
        # the force on the body, whatever it is called
        v = np.linspace(-0.3, 0.3, 41)
        mass = 1 / best.model.inverse_mass(best.theta)
        damping = best.theta[best.model.first_of_group[number] + 1]
        force = mass * (damping * v + group.law.force(0.0, v))
        true = gear.suspension_damping_n_s_per_m * v + gear.law.force(0.0, v)
        assert np.abs(force - true).max() < 0.1 * np.abs(true).max(), gear.name
        assert group.law.terms
    assert best.level < 1.03 * NOISE
    assert steps[0].kept
    assert best.bic <= min(step.bic for step in steps if step.kept) + 1e-6


def test_the_origin_of_coordinates_changes_nothing(found):
    """An origin off the plane of symmetry brings a product of inertia."""
    shift = np.array([12.0, 0.5])
    runs = tuple(
        replace(run, loading=tuple(PointMass(e.mass_kg, *np.add((e.x_m, e.y_m), shift)) for e in run.loading))
        for run in short_runs()
    )
    moved = fitted(study(runs=runs, shift=tuple(shift)))
    here, there = (body_estimates(each.fit, honest_covariance(each.fit))[0] for each in (found, moved))
    for name, estimate in here.items():
        expected = estimate.value + dict(zip(("x_cg_m", "y_cg_m"), shift, strict=True)).get(name, 0.0)
        assert abs(there[name].value - expected) < 0.1 * estimate.std, name


def test_a_slow_log_is_sampled_finer():
    given = study()
    below, above = arrays_of(given)[0]
    run = body_run(below[::2], above[::2], fs=128.0, loading=np.zeros((3, 3)))
    assert run.fs == 256.0
    assert run.finer == 2
    assert run.n_samples == 2 * (len(below) // 2)
    assert run.omega[-1] <= 2 * np.pi * 40.0


def test_runs_that_are_none_are_refused():
    with pytest.raises(InputError, match="give runs of one length"):
        body_run(np.zeros((300, 3)), np.zeros((301, 3)), fs=256.0, loading=np.zeros((3, 3)))
    with pytest.raises(InputError, match="holds 5 lines of a run of 1 s: give a longer run or a wider band"):
        body_run(np.zeros((256, 3)), np.zeros((256, 3)), fs=256.0, loading=np.zeros((3, 3)), band_hz=(1.0, 5.0))


@pytest.fixture(scope="module")
def started():
    """Start values from the equation of motion, with laws."""
    given = study()
    body = rigid_body([i.place for i in given.interfaces], [i.sensor_place for i in given.interfaces])
    runs = [
        body_run(below, above, fs=given.fs, loading=loading_matrix(given, place))
        for place, (below, above) in enumerate(arrays_of(given))
    ]
    groups = tuple(Group(name, (k,)) for k, name in enumerate(given.names))
    return runs, body, groups, start_values(runs, body, groups, mass_free=True, kinds=library())


def test_the_equation_of_motion_gives_a_start_near_the_truth(started):
    _, _, _, start = started
    true = aircraft()
    assert start.explained > 0.95
    assert 1 / start.inverse_mass == pytest.approx(true.mass_kg, rel=0.25)
    assert start.factors[0] == pytest.approx(true.x_cg_m, abs=0.1)
    stiffness = [gear.suspension_stiffness_n_per_m / true.mass_kg for gear in true.gears]
    np.testing.assert_allclose(start.stiffness, stiffness, rtol=0.2)


def test_a_vector_holds_what_the_start_says_and_survives_other_laws(started):
    runs, body, _, start = started
    model = body_model(runs, body, start, mass_free=True, noise_m_per_s2=(NOISE, NOISE))
    theta = first_vector(model, start)
    assert theta.size == model.n_shared + 12
    assert theta[model.names.index("inverse_mass")] == start.inverse_mass
    np.testing.assert_allclose([theta[first] for first in model.first_of_group], start.stiffness)
    changed, moved = with_laws(model, theta, [replace(group, law=LINEAR) for group in model.groups])
    assert moved.size == changed.n_shared + 12
    np.testing.assert_array_equal(moved[-12:], theta[-12:])
    assert moved[changed.names.index("x_cg_m")] == theta[model.names.index("x_cg_m")]
    # the mean slope of what was dropped goes to the damping
    nose = model.groups[0].law
    if "arctan_velocity" in nose.parameters:
        assert moved[1] > theta[1]


def test_entries_that_are_held_stay(started):
    runs, body, _, start = started
    model = body_model(runs, body, start, mass_free=True, noise_m_per_s2=(NOISE, NOISE))
    theta = first_vector(model, start)
    only_starts = fit_body(model, theta, free=slice(model.n_shared, None), most_evaluations=3)
    np.testing.assert_array_equal(only_starts.theta[: model.n_shared], theta[: model.n_shared])
    assert only_starts.n_evaluations <= 4


def test_sensors_that_do_not_see_a_motion_are_told(started):
    runs, _, groups, _ = started
    frame = Structure(np.eye(4), np.zeros((4, 4)), np.zeros((4, 4)), names=("a", "b", "c", "d"))
    with pytest.raises(InputError, match=r"see 3 of its 4 degrees of freedom \(a, b, c, d\): measure at more places"):
        start_values(runs, own_body(frame, ["a", "b", "c"], ["a", "b", "c"]), groups, mass_free=False)


def test_a_mass_rests_where_statics_puts_it():
    given = study()
    for place, expected in (((5.0, 0.0), (90, 0, 0)), ((0.0, 0.0), (0, 45, 45)), ((2.5, 0.0), (45, 22.5, 22.5))):
        np.testing.assert_allclose(shares(given, PointMass(90.0, *place)), expected, atol=1e-9)


PLACES_IN_LINE = [
    # the lever rule, also beyond the ends; off the line by the foot of the perpendicular
    ([(0.0, 1.6), (0.0, -1.6)], (0.0, 1.6), (90, 0)),
    ([(0.0, 1.6), (0.0, -1.6)], (3.0, 0.8), (67.5, 22.5)),
    ([(0.0, 0.0), (4.0, 0.0)], (-1.0, 0.0), (112.5, -22.5)),
    ([(5.0, -1.0), (5.0, 0.0), (5.0, 1.0)], (0.0, 0.0), (30, 30, 30)),
    ([(5.0, -1.0), (5.0, 0.0), (5.0, 1.0)], (5.0, 1.0), (-15, 30, 75)),
    ([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)], (0.5, 0.0), (33.75, 33.75, 11.25, 11.25)),
    ([(7.0, 2.0)], (1.0, 1.0), (90,)),
]


@pytest.mark.parametrize(("places", "load", "expected"), PLACES_IN_LINE)
@pytest.mark.parametrize("origin", [(0.0, 0.0), (-12.0, 3.0)])
def test_shares_are_the_mass_together_wherever_the_origin_is(places, load, expected, origin):
    interfaces = tuple(
        MeasuredInterface(str(k), f"{k} up", f"{k} low", *np.add(place, origin).tolist())
        for k, place in enumerate(places)
    )
    given = SimpleNamespace(interfaces=interfaces)
    found = shares(given, PointMass(90.0, *np.add(load, origin).tolist()))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_what_rounding_leaves_of_a_share_is_no_loading():
    """All of the load is over the nose; statics leaves 1e-15 kg of it to the main gears."""
    light, heavy = short_runs()
    given = study(runs=(light, replace(heavy, loading=(PointMass(500.0, 5.0, 1e-4),))))
    for slot, told in ((0, True), (1, False), (2, False)):
        alone = fitted_alone(given, arrays_of(given), np.full(2, NOISE), (slot,), law=LINEAR, band_hz=BAND)
        assert alone.found.model.mass_free is told


def test_loadings_that_differ_by_rounding_are_one(started):
    runs, body, _, _ = started
    ballast = np.full((3, 3), 500.0)
    same, more = (replace(runs[1], loading=ballast + change) for change in (1e-12, 1.0))
    reference = replace(runs[0], loading=ballast)
    assert not mass_is_told([reference, same], body)
    assert mass_is_told([reference, more], body)


def test_the_mass_is_told_by_loadings_that_differ_or_by_what_is_known_in_kg(started):
    runs, body, _, _ = started
    assert mass_is_told(runs, body)
    assert not mass_is_told(runs[:1], body)
    two = Structure(np.diag([3.0, 2.0]), np.zeros((2, 2)), np.zeros((2, 2)), names=("low", "high"))
    assert mass_is_told(runs[:1], own_body(two, ["low"], ["low"], unknown_mass=["high"]))
    assert not mass_is_told(runs[:1], own_body(two, ["low"], ["low"], unknown_mass=["low", "high"]))
    assert not mass_is_told(runs[:1], own_body(two, ["low"], ["low"]))
