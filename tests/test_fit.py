"""The driven model fitted to runs of known truth: one gear, and an aircraft on three."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_runs import NOISE, aircraft, arrays_of, short_runs, study, task_of
from law_runs import fitted, gear_model, runs_of, shared, true_values, vector_of

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR, Law, default_law, law
from opid.mechanics.structure import Structure
from opid.suspensions.candidates import fit_alone, fit_rigid, groups_of, is_mass_free, loading_matrix, static_loads
from opid.suspensions.fitting.fit import (
    carry_over,
    first_vector,
    fit_model,
    left_out_ratio,
    loading_changes,
    refit,
    with_laws,
)
from opid.suspensions.fitting.start import start_values
from opid.suspensions.law_search.pursuit import library
from opid.suspensions.model.body import own_body, rigid_body
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import driven_run
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair, ideal_sensors
from opid.suspensions.settings import Settings
from opid.suspensions.study import MeasuredInterface, PointMass
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.sensors import Sensor

FS = 256

FAR = {"stiffness_per_mass": 190.0, "damping_per_mass": 2.5, "inverse_mass": 1 / 1500}
LAWS_TRIED = [
    LINEAR,
    DEFAULT_LAW,
    law("arctan_displacement", amplitude_n=800.0, scale_m=0.002),
    default_law("quadratic_damping"),
    default_law("cubic_stiffness"),
    DEFAULT_LAW + default_law("cubic_stiffness"),
]


def is_true(fit, truth, **others):
    return np.all(np.abs(shared(fit) - true_values(fit, truth, **others)) < 4 * fit.std)


@pytest.mark.parametrize("truth", LAWS_TRIED, ids=lambda t: t.name)
def test_every_law_is_found_at_the_noise_with_its_slow_motion(truth):
    fit = fitted(runs_of(truth), truth.scaled(1.2) if truth.terms else truth, start=FAR)
    assert is_true(fit, truth)
    assert fit.std[fit.model.names.index("inverse_mass")] * 1850 < 0.004
    assert fit.noise_m_per_s2 == pytest.approx(5e-3, rel=0.06)
    lines = np.concatenate(fit.errors.lines)
    assert fit.variance == pytest.approx(np.sum(np.abs(lines) ** 2) / (fit.n_data - fit.theta.size))
    assert fit.n_data == 2 * lines.size


@pytest.mark.parametrize("seed", range(4))
def test_errors_are_those_of_the_vector_also_where_the_last_step_was_not_looked_at(seed):
    fit = fitted(runs_of(DEFAULT_LAW, seed), DEFAULT_LAW)
    again = fit.model.evaluate(fit.theta)
    difference = float(fit.errors.stacked @ fit.errors.stacked) - float(again.stacked @ again.stacked)
    assert abs(difference) < 2 * fit.model.settings.fit.negligible_promise * fit.variance
    np.testing.assert_allclose(fit.errors.stacked, again.stacked, atol=0.05)


def test_a_ground_spring_is_found():
    runs = runs_of(gear=LandingGear(ground_stiffness_n_per_m=1.67e5))
    fit = fitted(runs, DEFAULT_LAW, ground=True, start={"ground_stiffness_per_mass": 70.0})
    assert is_true(fit, DEFAULT_LAW, ground_stiffness_per_mass=1.67e5 / 1850)
    assert fit.value("ground_stiffness_per_mass") == pytest.approx(1.67e5 / 1850, rel=0.005)
    assert fit.value("gain_sprung") == 0.0


def test_stated_errors_are_the_spread():
    fits = [fitted(runs_of(DEFAULT_LAW, seed), DEFAULT_LAW) for seed in range(12)]
    spread = np.std([shared(fit) for fit in fits], axis=0)
    np.testing.assert_allclose(np.mean([fit.std for fit in fits], axis=0), spread, rtol=0.6)


def test_refitting_without_a_term_starts_where_it_left():
    both = DEFAULT_LAW + default_law("cubic_stiffness")
    fit = fitted(runs_of(both), both)
    model, begun = with_laws(fit, {"": Law(fit.laws[""].terms[:1])})
    # what the dropped term does on average goes to the stiffness
    travel, velocity = fit.motion(0)
    slope = np.mean(Law(fit.laws[""].terms[1:]).gradient(travel, velocity)[0])
    assert begun[0] - fit.theta[0] == pytest.approx(slope)
    assert begun.size == fit.theta.size - 1
    assert model.names == tuple(name for name in fit.model.names if name != "law[2]")
    less = refit(fit, {"": Law(fit.laws[""].terms[:1])})
    assert less.law_name == "arctan_velocity"
    assert less.noise_m_per_s2 > 5 * fit.noise_m_per_s2
    # a law that lets the motion grow without bound is no fit
    assert refit(fit, {"": law("cubic_stiffness", stiffness_n_per_m3=-1e12)}) is None


@pytest.mark.parametrize("fs", [64.0, 100.0])
def test_a_slow_logger_costs_no_accuracy(fs):
    """One step of the model a sample would be too coarse: the run is sampled finer inside."""
    fit = fitted(runs_of(DEFAULT_LAW, fs=fs, duration_s=40), DEFAULT_LAW)
    assert fit.model.runs[0].fs >= 250
    assert is_true(fit, DEFAULT_LAW)
    # what the friction does above the Nyquist frequency is missing from the drive
    assert 4.7e-3 < fit.noise_m_per_s2 < 7e-3


@pytest.mark.parametrize("name", ["coulomb_friction", "cubic_stiffness", "arctan_velocity"])
def test_every_start_a_fifth_off_leads_to_the_truth(name):
    truth = default_law(name)
    model = gear_model(runs_of(truth), truth)
    at = vector_of(model)
    at[: model.n_shared] = true_values(SimpleNamespace(model=model), truth)
    fits = []
    for seed in range(6):
        off = np.random.default_rng(seed).uniform(-0.2, 0.2, at.size)
        # a logarithm moves by the factor
        logarithm = np.array([name == "law[1]" for name in model.names] + [False] * (at.size - model.n_shared))
        fits.append(fit_model(model, np.where(logarithm, at + off, at * np.exp(off))))
        assert is_true(fits[-1], truth)
        # one minimum, not six near it
        np.testing.assert_array_less(np.abs(shared(fits[-1]) - shared(fits[0])), 0.1 * fits[0].std)


# ---- faults of the sensors that are stated ---------------------------------------------------------

COUPLED = {"corner_hz": 0.4, "corner_tolerance": 0.3}
ACROSS = (Leak("lower_x", "unsprung"), Leak("upper_x", "sprung"))
# what the lower and the upper sensor do, and what is known of it
STATED = {
    "gain": ({"gain": 1.03}, {}, SensorPair(SensorFacts(gain_tolerance=0.03))),
    "corners 40 % apart": (
        {"corner_hz": 0.33},
        {"corner_hz": 0.462},
        SensorPair(SensorFacts(**COUPLED), SensorFacts(**COUPLED)),
    ),
    "lag of one sample": ({}, {"lag_s": 1 / FS}, SensorPair(sprung=SensorFacts(lag_tolerance_s=2 / FS))),
    "leak": ({"cross_axis": 0.03}, {"cross_axis": 0.03}, SensorPair(leaks=ACROSS)),
    "all together": (
        {"gain": 1.03, "corner_hz": 0.33, "cross_axis": 0.03},
        {"lag_s": 1 / FS, "corner_hz": 0.462, "cross_axis": 0.03},
        SensorPair(SensorFacts(gain_tolerance=0.03, **COUPLED), SensorFacts(lag_tolerance_s=2 / FS, **COUPLED), ACROSS),
    ),
}


def misread(lower, upper, sensors):
    leaks = tuple(leak.channel for leak in sensors.leaks)
    return runs_of(DEFAULT_LAW, lower_sensor=Sensor(**lower), upper_sensor=Sensor(**upper), fore_aft=True, leaks=leaks)


@pytest.mark.parametrize("case", STATED)
def test_stated_faults_are_found_and_cost_the_mass_nothing(case):
    lower, upper, sensors = STATED[case]
    sound = fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)
    fit = fitted(misread(lower, upper, sensors), DEFAULT_LAW, sensors=sensors)
    expected = {
        "gain_unsprung": lower.get("gain"),
        "corner_unsprung_hz": lower.get("corner_hz"),
        "corner_sprung_hz": upper.get("corner_hz"),
        "lag_s": upper.get("lag_s"),
        "leak[0]": lower.get("cross_axis"),
        "leak[1]": upper.get("cross_axis"),
    }
    assert set(fit.model.names) - set(sound.model.names) == {name for name, value in expected.items() if value}
    assert is_true(fit, DEFAULT_LAW, **expected)
    assert fit.noise_m_per_s2 == pytest.approx(5e-3, rel=0.06)
    # mass and stiffness are hardly less well known than from sensors without a fault
    for name in ("inverse_mass", "stiffness_per_mass"):
        place = sound.model.names.index(name)
        assert fit.std[fit.model.names.index(name)] < 1.6 * sound.std[place]


def test_faults_that_are_not_stated_spoil_what_stated_ones_leave_alone():
    lower, upper, _ = STATED["all together"]
    assert fitted(misread(lower, upper, SensorPair()), DEFAULT_LAW).noise_m_per_s2 > 10 * 5e-3


def test_a_common_gain_cannot_be_seen_and_scales_the_law_alone():
    """Gains a and a of both sensors make motion and force a times as large: only inner scales and amplitudes know."""
    tolerance = 0.03
    loose = SensorFacts(gain_tolerance=tolerance)
    sound, fit = (
        fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW, sensors=pair) for pair in (SensorPair(), SensorPair(loose, loose))
    )
    place = {name: k for k, name in enumerate(fit.model.names)}
    gains = [place[f"gain_{side}"] for side in ("unsprung", "sprung")]
    covariance = fit.covariance[np.ix_(gains, gains)]
    mean_std = np.sqrt(covariance.sum()) / 2
    difference_std = np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1])
    # of two independent priors, the mean is known as before and the difference from the data
    assert mean_std == pytest.approx(tolerance / np.sqrt(2), rel=1e-3)
    assert difference_std < 0.01 * tolerance
    assert fit.theta[gains].mean() == pytest.approx(1.0, abs=0.1 * tolerance)
    for name in ("stiffness_per_mass", "damping_per_mass", "inverse_mass"):
        at = sound.model.names.index(name)
        assert fit.std[place[name]] == pytest.approx(sound.std[at], rel=0.03)
        assert abs(fit.theta[place[name]] - sound.theta[at]) < 0.3 * sound.std[at]
    # the amplitude is relative; the scale is a logarithm
    for name, size in (("law[0]", sound.value("law[0]")), ("law[1]", 1.0)):
        at = sound.model.names.index(name)
        assert fit.std[place[name]] / size == pytest.approx(np.hypot(sound.std[at] / size, mean_std), rel=0.03)


# ---- runs that are left out ------------------------------------------------------------------------


def test_a_run_that_is_left_out_is_predicted_to_the_noise():
    fit = fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)
    assert left_out_ratio(fit) == pytest.approx(1.0, abs=0.05)
    alone = fitted(runs_of(DEFAULT_LAW)[:1], DEFAULT_LAW, mass_free=False)
    assert left_out_ratio(alone) is None


def test_entries_that_are_held_stay():
    model = gear_model(runs_of(DEFAULT_LAW), DEFAULT_LAW)
    theta = vector_of(model)
    only_starts = fit_model(model, theta, free=slice(model.n_shared, None), most_evaluations=3)
    np.testing.assert_array_equal(shared(only_starts), theta[: model.n_shared])
    assert np.any(only_starts.theta[model.n_shared :] != 0.0)
    assert only_starts.n_evaluations <= 4


def test_what_is_carried_over_stays_and_what_is_new_is_nominal():
    fit = fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)
    sensors = fit.model.sensors.changed("sprung", 0, gain_tolerance=0.03, corner_hz=0.3, corner_tolerance=0.5)
    groups = (replace(fit.model.groups[0], ground=True),)
    theta = carry_over(fit, replace(fit.model, sensors=sensors, groups=groups), {"damping_per_mass": 7.0})
    model = replace(fit.model, sensors=sensors, groups=groups)
    found = dict(zip(model.names, theta, strict=False))
    assert found | {"damping_per_mass": 0.0} == dict(zip(fit.model.names, fit.theta, strict=False)) | {
        "damping_per_mass": 0.0,
        "ground_stiffness_per_mass": 0.0,
        "gain_sprung": 1.0,
        "corner_sprung_hz": 0.3,
    }
    assert found["damping_per_mass"] == 7.0
    np.testing.assert_array_equal(theta[model.n_shared :], fit.theta[fit.model.n_shared :])


# ---- an aircraft -----------------------------------------------------------------------------------

FRICTION = law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02)


@pytest.fixture(scope="module")
def found():
    """The rigid body with the kind of law that the aircraft has."""
    return fit_rigid(task_of(study(), FRICTION))


def test_the_origin_of_coordinates_changes_nothing(found):
    """An origin off the plane of symmetry brings a product of inertia."""
    shift = np.array([12.0, 0.5])
    runs = tuple(
        replace(run, loading=tuple(PointMass(e.mass_kg, *np.add((e.x_m, e.y_m), shift)) for e in run.masses))
        for run in short_runs()
    )
    moved = fit_rigid(task_of(study(runs=runs, shift=tuple(shift)), FRICTION))
    here, there = (each.known.estimate_rigid_body()[0] for each in (found, moved))
    for name, estimate in here.items():
        expected = estimate.value + dict(zip(("x_cg_m", "y_cg_m"), shift, strict=True)).get(name, 0.0)
        assert abs(getattr(there, name).value - expected) < 0.1 * estimate.std, name
    assert abs(here.sprung_mass_kg.value - aircraft().mass_kg) < 4 * here.sprung_mass_kg.std


@pytest.fixture(scope="module")
def started():
    """Start values from the equation of motion, with laws."""
    given = study()
    body = rigid_body([i.place for i in given.interfaces], [i.sensor_place for i in given.interfaces])
    runs = [
        driven_run(below, above, fs=given.fs, loading=loading_matrix(given, place))
        for place, (below, above, _) in enumerate(arrays_of(given))
    ]
    start = start_values(runs, body, groups_of(given), mass_free=True, ground=True, kinds=library())
    return runs, body, groups_of(given), start


def test_the_equation_of_motion_gives_a_start_near_the_truth(started):
    _, _, _, start = started
    true = aircraft()
    assert 1 / start.inverse_mass == pytest.approx(true.mass_kg, rel=0.25)
    assert start.factors[0] == pytest.approx(true.x_cg_m, abs=0.1)
    stiffness = [gear.suspension_stiffness_n_per_m / true.mass_kg for gear in true.gears]
    np.testing.assert_allclose(start.stiffness, stiffness, rtol=0.2)
    # it was allowed springs to the ground, and asks for none
    assert not start.has_ground


def test_a_vector_holds_what_the_start_says(started):
    runs, body, _, start = started
    levels = (np.full(3, NOISE), np.full(3, NOISE))
    sensors = ideal_sensors(3, 3)
    model = Model(tuple(runs), body, start.groups, sensors, True, start.motion_rms, Settings(), noise=levels)
    theta = first_vector(model, start)
    assert theta.size == model.n_shared + 12
    assert theta[model.names.index("inverse_mass")] == start.inverse_mass
    np.testing.assert_allclose([theta[first] for first in model.first_of_group], start.stiffness)
    assert not theta[model.n_shared :].any()


def test_sensors_that_do_not_see_a_motion_are_told(started):
    runs, _, groups, _ = started
    frame = Structure(np.eye(4), np.zeros((4, 4)), np.zeros((4, 4)), names=("a", "b", "c", "d"))
    with pytest.raises(InputError, match=r"see 3 of its 4 degrees of freedom \(a, b, c, d\): measure at more places"):
        start_values(runs, own_body(frame, ["a", "b", "c"], ["a", "b", "c"]), groups, mass_free=False)


PLACES_IN_LINE = [
    # statics on three; the lever rule on a line, also beyond the ends; off the line by the foot of the perpendicular
    ([(5.0, 0.0), (0.0, 1.6), (0.0, -1.6)], (2.5, 0.0), (45, 22.5, 22.5)),
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
    found = static_loads(SimpleNamespace(interfaces=interfaces), PointMass(90.0, *np.add(load, origin).tolist()))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_what_rounding_leaves_of_a_share_is_no_loading():
    """All of the load is over the nose; statics leaves 1e-15 kg of it to the main gears."""
    light, heavy = short_runs()
    given = study(runs=(light, replace(heavy, loading=(PointMass(500.0, 5.0, 1e-4),))))
    for attachment, told in ((0, True), (1, False), (2, False)):
        assert fit_alone(task_of(given, LINEAR), (attachment,)).fit.model.mass_free is told


def test_the_mass_is_told_by_loadings_that_differ_or_by_what_is_known_in_kg(started):
    runs, body, _, _ = started
    ballast = np.full((3, 3), 500.0)
    assert not loading_changes([ballast, ballast + 1e-12])
    assert loading_changes([ballast, ballast + 1.0])
    assert is_mass_free(runs, body)
    assert not is_mass_free(runs[:1], body)
    two = Structure(np.diag([3.0, 2.0]), np.zeros((2, 2)), np.zeros((2, 2)), names=("low", "high"))
    assert is_mass_free(runs[:1], own_body(two, ["low"], ["low"], unknown_mass=["high"]))
    assert not is_mass_free(runs[:1], own_body(two, ["low"], ["low"], unknown_mass=["low", "high"]))
    assert not is_mass_free(runs[:1], own_body(two, ["low"], ["low"]))
