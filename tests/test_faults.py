"""What the runs demand beside the suspensions is found, and nothing that they do not: on one gear and on three."""

from dataclasses import replace

import numpy as np
import pytest
from body_runs import NOISE, aircraft, short_runs, study, task_of
from law_runs import MASS_KG, STIFFNESS, fitted, runs_of, study_of

from opid.mechanics.laws.law import LINEAR
from opid.signals.recording import Recording
from opid.suspensions.candidates import fit_rigid, gear_body
from opid.suspensions.fitting.faults import Hypothesis, _is_plausible, _list_hypotheses, add_faults, find_coupling
from opid.suspensions.fitting.fit import carry_over, fit_model
from opid.suspensions.fitting.start import start_values
from opid.suspensions.identification import identify
from opid.suspensions.model.unknowns import GROUND, Group
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.settings import FaultSettings
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.sensors import Sensor, measure

FS, LAW = 256.0, "arctan_velocity"


def first_fit(seed=0, *, gear=None, lower=None, upper=None):
    """The fit of runs with one fault, and start values that know a ground spring."""
    sensors = {"lower_sensor": Sensor(**(lower or {})), "upper_sensor": Sensor(**(upper or {}))}
    runs = runs_of(gear=LandingGear(**(gear or {})), seed=seed, **sensors)
    group = Group("", (0,), DEFAULT_LAW.scaled(1 / MASS_KG))
    start = start_values(runs, gear_body(), (group,), mass_free=True)
    first = {"stiffness_per_mass": start.stiffness[0], "damping_per_mass": start.damping[0]}
    return fitted(runs, DEFAULT_LAW, start=first), start


@pytest.mark.parametrize("seed", range(5))
def test_sound_runs_demand_nothing(seed):
    fit, start = first_fit(seed)
    same, demands = add_faults(fit, ground=True, start=start)
    assert demands == ()
    assert same is fit


COUPLED = {"corner_hz": 0.33}
# gear, lower and upper sensor, and what has to be found
FAULTS = {
    "gain": ({}, {}, {"gain": 1.01}, {"gain_sprung": 1.01}),
    "lag": ({}, {}, {"lag_s": 0.5 / FS}, {"lag_s": 0.5 / FS}),
    "AC coupling": ({}, COUPLED, {"corner_hz": 0.462}, {"corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.462}),
    # none of the three alone lowers the error by much
    "all three": (
        {},
        COUPLED,
        {"gain": 1.03, "corner_hz": 0.462, "lag_s": 0.5 / FS},
        {"gain_sprung": 1.03, "corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.462, "lag_s": 0.5 / FS},
    ),
    "equal AC coupling": ({}, COUPLED, COUPLED, {"corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.33}),
    # far beyond the usual corner of 0.25 Hz, and nothing else would leave so little
    "high AC coupling": (
        {},
        {"corner_hz": 1.0},
        {"corner_hz": 1.0},
        {"corner_unsprung_hz": 1.0, "corner_sprung_hz": 1.0},
    ),
    "higher AC coupling": (
        {},
        {"corner_hz": 1.1},
        {"corner_hz": 2.0},
        {"corner_unsprung_hz": 1.1, "corner_sprung_hz": 2.0},
    ),
    "weak spring": ({"ground_stiffness_n_per_m": 4e3}, {}, {}, {GROUND: 4e3 / MASS_KG}),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_and_nothing_else(fault):
    gear, lower, upper, expected = FAULTS[fault]
    before, start = first_fit(gear=gear, lower=lower, upper=upper)
    fit, demands = add_faults(before, ground=True, start=start)
    assert {demand.name for demand in demands} == set(expected)
    for demand in demands:
        assert abs(demand.value - expected[demand.name]) < 5 * demand.std
        assert demand.std < 0.03 * abs(expected[demand.name])
        assert demand.error_after < demand.error_before
        assert demand == demand.update(fit)
    assert fit.ratio == pytest.approx(1.0, rel=0.06)
    assert before.ratio > 1.4 * fit.ratio
    place = fit.model.names.index("inverse_mass")
    assert abs(fit.theta[place] - 1 / MASS_KG) < 4 * fit.std[place]
    # and once in, nothing more is asked for
    again, same = add_faults(fit, demands, ground=True, start=start)
    assert {demand.name for demand in same} == set(expected)
    assert set(again.model.names) == set(fit.model.names)


def test_a_ground_spring_is_let_in_only_where_it_may_be():
    before, _ = first_fit(gear={"ground_stiffness_n_per_m": 4e3})
    fit, demands = add_faults(before, ground=False)
    assert GROUND not in fit.model.names
    # it passes for a gain error of K3/K2, which explains the runs less well than the spring does
    assert demands[0].name == "gain_sprung"
    assert demands[0].value == pytest.approx(1 - 4e3 / STIFFNESS, abs=0.004)
    assert fit.ratio > 1.05


def test_a_fault_far_beyond_what_sensors_do_is_not_let_in():
    """A gain of 1.3 would lower the error a lot, and stands in for something else: a wrong channel, another unit."""
    before, start = first_fit(upper={"gain": 1.3})
    assert before.ratio > 20
    fit, demands = add_faults(before, ground=False, start=start)
    assert "gain_sprung" not in {demand.name for demand in demands}
    for fault in fit.model.faults:
        assert abs(fit.value(fault.name) - fault.nominal) < FaultSettings().plausible_std * fault.std


@pytest.mark.parametrize(("corners_hz", "is_one"), [((1e-3, 2e-4), False), ((1e-3, 0.01), True)])
def test_an_ac_coupling_with_no_corner_is_none(corners_hz, is_one):
    """It would only free the offsets of the sensors, which mend whatever is slow."""
    fit, _ = first_fit()
    (coupling,) = (each for each in _list_hypotheses(fit.model, False, FaultSettings()) if each.is_coupling)
    model = coupling.add_to(fit.model)
    corners = dict(zip(("corner_unsprung_hz", "corner_sprung_hz"), corners_hz, strict=True))
    theta = carry_over(fit, model, corners)
    grown = replace(fit, model=model, theta=theta, errors=model.evaluate(theta))
    assert _is_plausible(grown, coupling) == is_one


def test_an_ac_coupling_is_let_in_where_a_spring_to_the_ground_stood_in_its_place():
    before, start = first_fit(lower={"corner_hz": 1.5}, upper={"corner_hz": 2.0})
    ground = Hypothesis("a spring to the ground", ground=True).add_to(before.model)
    sprung = fit_model(ground, carry_over(before, ground))
    assert sprung.ratio < 0.9 * before.ratio
    fit, demands = add_faults(sprung, ground=True, start=start)
    assert {demand.name for demand in demands} == {"corner_unsprung_hz", "corner_sprung_hz"}
    assert GROUND not in fit.model.names
    assert fit.ratio == pytest.approx(1.0, rel=0.06)


def test_a_ground_spring_that_holds_a_fit_in_a_worse_minimum_is_taken_out():
    """A fit may begin with one, for start values take a law that is missing for it. Where it harms nothing it stays."""
    ground = Hypothesis("a spring to the ground", ground=True)
    before, start = first_fit()
    sprung = ground.add_to(before.model)
    sound = fit_model(sprung, carry_over(before, sprung))
    assert add_faults(sound, ground=True, start=start)[0].model.ground
    # held away from its minimum, by as much as a hundred standard deviations of the damping
    theta = sound.theta.copy()
    theta[sprung.names.index("damping_per_mass")] += 100 * sound.std[sprung.names.index("damping_per_mass")]
    held = replace(sound, theta=theta, errors=sprung.evaluate(theta))
    fit, demands = add_faults(held, ground=True, start=start)
    assert (fit.model.ground, demands) == (False, ())
    np.testing.assert_allclose(fit.theta[:4], before.theta[:4], rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.8, 1.2])
def test_a_fault_that_is_not_let_in_is_told_and_takes_the_intervals(gain):
    result = identify(study_of(seed=3, duration_s=12, upper_sensor=Sensor(gain=gain)), law=LAW)
    (evidence,) = result.evidence
    (implausible,) = evidence.implausible
    assert implausible.name == "gain_sprung"
    assert implausible.value == pytest.approx(gain, abs=0.02)
    assert implausible.error_after < 0.2 * implausible.error_before
    assert "gain_sprung" not in evidence.fit.model.names
    said = "would reduce the error from"
    assert any(said in warning and "gain_sprung = " in warning for warning in result.warnings)
    (interface,) = result.interfaces
    told = [*result.ratios.items(), *result.parameters.items(), *interface.items()]
    told += [each for equivalent in result.equivalents for each in equivalent.items()]
    told += [each for laws in interface.law_estimates.values() for each in laws.items()]
    assert any(estimate.value for _, estimate in told)
    assert all(estimate.interval95 is None for _, estimate in told)


def test_a_tone_that_no_sensor_below_reads_is_no_implausible_fault():
    given, runs = study_of(seed=4), []
    for run in given.runs:
        samples = np.array(run.recording.samples)
        tone = 0.1 * np.sin(2 * np.pi * 12.3 * np.arange(len(samples)) / FS)
        samples[:, run.recording.names.index("upper_z")] += tone
        runs.append(replace(run, recording=Recording(samples, fs=FS, channels=run.recording.channels)))
    result = identify(replace(given, runs=tuple(runs)), law=LAW)
    assert result.residual_over_noise > 3
    assert result.evidence[0].implausible == ()
    assert result.ratios.stiffness_per_mass.interval95 is not None


# ---- three interfaces ------------------------------------------------------------------------------


def misread(channels, **faults):
    """The short runs of the aircraft, some channels read once more by a sensor with a fault."""
    sensor, runs = Sensor(noise_m_per_s2=0.0, **faults), []
    for run in short_runs():
        samples, fs = np.array(run.recording.samples), run.recording.fs
        for name in channels:
            place = run.recording.names.index(name)
            samples[:, place] = measure(samples[:, place], fs=fs, sensor=sensor, rng=np.random.default_rng(0))
        recording = Recording(samples, fs=fs, channels=run.recording.channels)
        runs.append(replace(run, recording=recording))
    return study(runs=tuple(runs))


EVERY = [f"{name}_{side}_z" for name in ("nose", "left", "right") for side in ("lower", "upper")]
OF_A_BODY = {
    "gain": (["left_upper_z"], {"gain": 1.03}, {"gain_sprung[left]": 1.03}),
    "lag": (["right_upper_z"], {"lag_s": 0.5 / FS}, {"lag_s[right]": 0.5 / FS}),
    "AC coupling": (
        EVERY,
        COUPLED,
        {f"corner_{side}_hz[{name}]": 0.33 for name in ("nose", "left", "right") for side in ("sprung", "unsprung")},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("world", ["coupled", "sound", "bending"])
def test_a_coupling_promises_to_help_before_laws_are_searched_where_there_is_one(world):
    """Each aircraft rubs, and is fitted without friction."""
    given = {
        "coupled": lambda: misread([name for name in EVERY if "lower" in name], **COUPLED),
        "sound": study,
        "bending": lambda: study(runs=short_runs(8.0)),
    }[world]()
    promising = find_coupling(fit_rigid(task_of(given, LINEAR)).fit)
    assert (promising is not None) == (world == "coupled")
    assert promising is None or promising.is_coupling


def test_a_gain_of_one_sensor_of_an_aircraft_that_is_stated_is_found():
    given = misread(["left_upper_z"], gain=1.03)
    loose = SensorPair(sprung=SensorFacts(gain_tolerance=0.03))
    interfaces = [replace(each, facts=loose) if each.name == "left" else each for each in given.interfaces]
    exact = replace(given.structure, position_tolerance_m=0.0)
    found = identify(replace(given, interfaces=interfaces, structure=exact), law=LAW)
    fit, mass = found.evidence[0].fit, found.parameters.sprung_mass_kg
    assert found.residual_over_noise < 1.05
    assert fit.value("gain_sprung[left]") == pytest.approx(1.03, abs=0.002)
    assert abs(mass.value - aircraft().mass_kg) < 4 * mass.std < 0.02 * mass.value
    assert found.warnings == ()


@pytest.mark.slow
@pytest.mark.parametrize("fault", list(OF_A_BODY))
def test_a_fault_of_one_sensor_of_an_aircraft_is_found(fault):
    channels, faults, expected = OF_A_BODY[fault]
    found = identify(misread(channels, **faults), law=LAW)
    (evidence,) = found.evidence
    assert {demand.name for demand in evidence.demands} == set(expected)
    for demand in evidence.demands:
        assert abs(demand.value - expected[demand.name]) < 4 * demand.std
    assert found.not_determined is None
    assert found.residual_over_noise < 1.1
    mass = found.parameters.sprung_mass_kg
    assert abs(mass.value - aircraft().mass_kg) < 4 * mass.std < 0.05 * mass.value
    assert any("that the study does not state was added" in warning for warning in found.warnings)


def test_sound_sensors_of_an_aircraft_demand_nothing():
    found = identify(study(), law=LAW)
    assert found.evidence[0].demands == ()
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.05)
    assert found.noise_m_per_s2 == NOISE


def test_a_stated_coupling_with_a_wide_tolerance_brings_no_ground_spring():
    """The ground below AC-coupled sensors cannot be integrated: what is not known of it must not become a spring."""
    stated = SensorFacts(corner_hz=0.396, corner_tolerance=0.3)
    sensors = {"lower_sensor": Sensor(corner_hz=0.33), "upper_sensor": Sensor(corner_hz=0.462)}
    found = identify(study_of(seed=6, duration_s=40, sensors=SensorPair(stated, stated), **sensors))
    assert found.law.name == LAW
    assert found.evidence[0].demands == ()
    assert found.parameters.sprung_mass_kg.holds(MASS_KG)
    assert found.residual_over_noise < 1.05


@pytest.mark.parametrize("seed", [1, 2])
def test_a_faint_ground_spring_is_known_no_better_than_gains_are_equal(seed):
    """Beside a gain error that nobody stated: what is free is no reason to know the spring better."""
    gear, gain = LandingGear(ground_stiffness_n_per_m=1000.0), Sensor(noise_m_per_s2=5e-3, gain=1.03)
    result = identify(study_of(gear=gear, seed=seed, upper_sensor=gain), law=LAW)
    ground = result.parameters.ground_stiffness_n_per_m
    assert ground.std >= 0.001 * STIFFNESS * 0.99
    assert abs(ground.value - 1000.0) < 3 * ground.std
