"""Struts of oil and gas: what carries the weight, from which starts it is found, and what is told of the gas."""

import importlib
import json
import re
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from made_body import small_body
from scripts import script

import opid
from opid import identify, read_study
from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import LAWS, LINEAR, law, law_from_parameters
from opid.mechanics.response import time_response
from opid.mechanics.weight import ATMOSPHERE_PA, GRAVITY_M_PER_S2
from opid.suspensions.answer.warnings import warn_of_gas
from opid.suspensions.candidates import gear_body
from opid.suspensions.fitting.fit import make_carrying_column
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.results import read_flights
from opid.suspensions.model.body import rigid_body
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.law_parameters import to_free
from opid.suspensions.model.run import driven_run
from opid.suspensions.model.unknowns import Group, compare_with_prior
from opid.suspensions.sensor_facts import ideal_sensors
from opid.suspensions.settings import GasSettings, Settings
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

MASS_KG = 1850.0
WEIGHT_N = MASS_KG * GRAVITY_M_PER_S2
VALUES = {
    "gas_column": {"static_force_n": WEIGHT_N, "gas_length_m": 0.08, "exponent": 1.27},
    "orifice_damping": {"damping_n_s2_per_m2": 5e4, "rebound_ratio": 2.5},
    "dahl_friction": {"amplitude_n": 300.0, "scale_m": 5e-4},
}
LAW = law_from_parameters("+".join(VALUES), VALUES)


@pytest.fixture(scope="module")
def struts():
    """The benchmark, with an integrator of its own."""
    return script("benchmarks/oleo_struts.py")


def strut_study(gear, *, seed=3, removed_kg=222.0, **known):
    """Two runs of a strut, of which the second carries less."""
    test = taxi_test(
        gear,
        rng=np.random.default_rng(seed),
        mass_removed_kg=removed_kg,
        duration_s=25.0,
        fs=256.0,
        lowest_step_rate_hz=8192.0,
    )
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    return study_of_gear("strut", sprung="upper_z", unsprung="lower_z", runs=runs, **({"repeatability": 0.0} | known))


# ---- the virtual strut -----------------------------------------------------------------------------


def test_the_integrator_of_the_benchmark_agrees_with_the_time_response(struts):
    gear = LandingGear(suspension_stiffness_n_per_m=0.0, suspension_damping_n_s_per_m=2e3, law=LAW)
    n, rng = 1025, np.random.default_rng(4)
    forces = 1e3 * np.cumsum(rng.standard_normal((2 * n - 1, 2)), axis=0) * [1.0, 0.03]
    numbers = (105.0, MASS_KG, 6.2e5, 1.5e3, 0.0, 2e3)
    values = (WEIGHT_N, 0.08, 1.27, 5e4, 1.25e5, 300.0, 5e-4)
    own = importlib.import_module("worlds")._integrated(struts.oleo, values, numbers, *forces.T.copy(), 1.0 / 32768.0)
    theirs = time_response(airframe_structure(gear.airframe), forces[:, ::-1], fs=32768.0, duration_s=n / 32768.0)
    accelerations = own[:, :2]
    np.testing.assert_allclose(
        accelerations, theirs.acceleration[:, ::-1], rtol=1e-6, atol=1e-6 * np.abs(accelerations).max()
    )


def test_a_lighter_strut_of_the_benchmark_rests_where_its_gas_does(struts):
    strut = struts.random_strut(0, "plain")
    light = strut.lighter(200.0, 0.0)
    assert light.push_n == pytest.approx(strut.push_n - 200.0 * GRAVITY_M_PER_S2)
    assert light.push_n * light.length_m == pytest.approx(strut.push_n * strut.length_m)


def test_a_gear_needs_a_spring_or_gas():
    with pytest.raises(InputError, match="suspension_stiffness_n_per_m of the landing gear is 0"):
        LandingGear(suspension_stiffness_n_per_m=0.0)


@pytest.mark.slow
def test_a_run_so_light_that_its_strut_rests_on_its_stop_is_said_to():
    """The gas gives up F0 (1 - h/(h + g)) on the way to the stop; the rest of the weight that is gone presses on it."""
    gap_m, removed_n = 0.008, 222.0 * GRAVITY_M_PER_S2
    stop = {"rebound_stop": {"stiffness_n_per_m": 2e6, "gap_m": gap_m}}
    values = {name: VALUES[name] for name in ("gas_column", "orifice_damping")} | stop
    stopped = law_from_parameters("+".join(values), values)
    gear = LandingGear(suspension_stiffness_n_per_m=0.0, suspension_damping_n_s_per_m=2e3, law=stopped)
    without = identify(strut_study(gear), law="gas_column+orifice_damping")
    assert "a mass change put the strut on a stop that the law lacks" in without.not_determined
    for removed_kg in (222.0, 100.0):
        found = identify(strut_study(gear, removed_kg=removed_kg), law=stopped.name)
        assert found.parameters.sprung_mass_kg.holds(MASS_KG)
        said = [each for each in found.warnings if "rests on its rebound_stop" in each]
        if removed_kg == 100.0:
            assert not said
            continue
        (sentence,) = said
        _, run, _, reference, *_ = sentence.split("'")
        less_n, beyond_n = (float(each) for each in re.findall(r"([\d.]+) N\b", sentence))
        assert (run, reference) == ("light", "heavy")
        assert less_n == pytest.approx(removed_n, rel=0.02)
        # where the stop gives way a little, the gas gives up a little more
        travel_m = gear_rest(gear, removed_n)
        assert beyond_n == pytest.approx(2e6 * (travel_m - gap_m), rel=0.1)
        assert "check mass_change_kg" in sentence


def gear_rest(gear, removed_n):
    """How much farther a gear rests extended whose weight is less by a force, by bisection."""
    low, high = 0.0, 0.1
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gear.law.static_force(middle)[0] < removed_n else (low, middle)
    return low


# ---- what is known of the gas ----------------------------------------------------------------------


def test_a_column_that_carries_a_weight_is_as_stiff_as_the_spring_in_its_place():
    column = make_carrying_column("gas_column", WEIGHT_N, 2.6e5)
    found = law("gas_column", **dict(zip(VALUES["gas_column"], column.values, strict=True)))
    assert float(found.gradient(0.0, 0.0)[0]) == pytest.approx(2.6e5, rel=1e-6)


def made_model(**settings):
    """Two short runs of one gear on gas, and a vector at which the gas does not carry all of the weight."""
    rng, runs = np.random.default_rng(0), []
    for loading in (0.0, -220.0):
        below, above = rng.standard_normal((2, 1024))
        runs.append(driven_run(below, 0.5 * above, fs=256.0, loading=loading))
    levels = (np.array([5e-3]), np.array([5e-3]))
    group, rms = Group("", (0,), LAW.scaled(1 / MASS_KG)), np.array([[0.01, 0.1]])
    shared = (tuple(runs), gear_body(), (group,), ideal_sensors(1, 1), True, rms, Settings())
    model = Model(*shared, noise=levels, **settings)
    theta = np.zeros(model.n_shared + model.n_own * 2)
    theta[:2] = 6.0, 3.0
    theta[model.law_indices(0)] = to_free(group.law)
    theta[model.names.index("inverse_mass")] = 1.03 / MASS_KG
    theta[model.law_indices(0).start + 2] *= 1.02
    return model, theta


@pytest.mark.parametrize("area_m2", [0.0, 0.006])
@pytest.mark.parametrize("settings", [{}, {"is_held": True}, {"repeatability": 0.01}])
def test_what_is_known_of_the_weight_is_differentiated(settings, area_m2):
    model, theta = made_model(**settings)
    model = replace(model, body=replace(model.body, piston_area_m2=area_m2))
    if model.repeatability:
        theta[model.n_shared :] = 1e-3 * np.random.default_rng(1).standard_normal(theta.size - model.n_shared)
    exact = model.evaluate(theta)
    n = 2 * sum(line.size for line in exact.lines)
    for k in range(theta.size):
        step = np.zeros(theta.size)
        step[k] = 1e-5 * max(abs(theta[k]), 1e-3)
        up, down = (model.evaluate(theta + sign * step, sensitivity=False).stacked for sign in (1, -1))
        differences = ((up - down) / (2 * step[k]))[n:]
        np.testing.assert_allclose(
            exact.jacobian[n:, k], differences, atol=1e-5 * np.abs(differences).max() + 1e-9, err_msg=str(k)
        )


def test_without_weight_nothing_is_known_of_the_gas_but_its_exponent():
    model, _ = made_model()
    assert (model.n_known_of_laws, model.weight) == (3, GRAVITY_M_PER_S2)
    for axis in ("horizontal", "down"):
        other = replace(model, body=gear_body(axis))
        assert other.n_known_of_laws == 1
        assert other.carriers == ()


def test_every_strut_of_an_aircraft_has_gas_of_a_usual_exponent_before_any_measurement():
    """Gears of a body carry fractions of the weight that are not known: of the gas of each only its exponent is."""
    names, column = ("nose", "left", "right"), LAW.scaled(1 / MASS_KG)
    places = np.array([(5.0, 0.0), (0.0, 1.5), (0.0, -1.5)])
    rng = np.random.default_rng(0)
    runs = (driven_run(*rng.standard_normal((2, 1024, 3)), fs=256.0, loading=np.zeros((3, 3))),)
    groups = tuple(Group(name, (attachment,), column) for attachment, name in enumerate(names))
    body = rigid_body(places, places, names=names)
    rms = np.tile([[0.01, 0.1]], (3, 1))
    level = np.full(3, 5e-3)
    shared = (runs, body, groups, ideal_sensors(3, 3), False, rms, Settings())
    aircraft = Model(*shared, noise=(level, level))
    assert (aircraft.carriers, aircraft.n_known_of_laws) == ((), 3)
    theta = np.zeros(aircraft.n_shared + aircraft.n_own)
    for number in range(3):
        theta[aircraft.law_indices(number)] = to_free(column)
    at_usual, usual = theta.copy(), LAWS["gas_column"].parameters[2].known
    behind = [bool(parameter.known) for parameter in column.parameter_list].index(True)
    exponents = [aircraft.law_indices(number).start + behind for number in range(3)]
    at_usual[exponents] = np.log(usual[0])
    assert not compare_with_prior(aircraft, at_usual, is_held=False)[0][-3:].any()
    far, by = compare_with_prior(aircraft, theta, is_held=False)
    np.testing.assert_allclose(far[-3:], np.log(1.27 / usual[0]) * usual[0] / usual[1])
    np.testing.assert_allclose(by[-3:, exponents], np.eye(3) * usual[0] / usual[1])


def test_gas_of_any_strut_is_doubted_and_once_where_struts_share_it():
    body = small_body()

    def on_gas(interface, exponent, shared_with=()):
        told = {"static_force_n": Estimate(2e4), "gas_length_m": Estimate(0.1), "exponent": Estimate(exponent)}
        return replace(interface, law_estimates={"gas_column": told}, shared_with=shared_with)

    nose, left, right = body.interfaces
    struts = (on_gas(nose, 1.2), on_gas(left, 1.6, ("right",)), on_gas(right, 1.6, ("left",)))
    doubts = list(warn_of_gas(struts, body.study.interfaces, GasSettings()))
    assert len(doubts) == 1
    assert doubts[0].startswith("at 'left, right': the exponent 1.6 of gas_column is unusual")


# ---- identification --------------------------------------------------------------------------------


def gear_with_stop(gap_m):
    """A strut that runs into a buffer in compression where the gap is within its travel of 9 mm."""
    stop = law("bump_stop", stiffness_n_per_m=2e6, gap_m=gap_m)
    return LandingGear(suspension_stiffness_n_per_m=0.0, suspension_damping_n_s_per_m=2e3, law=LAW + stop)


@pytest.mark.slow
def test_a_strut_that_hits_its_bump_stop_tells_mass_and_gap():
    found = identify(strut_study(gear_with_stop(0.006)))
    assert set(found.law.name.split("+")) == {*VALUES, "bump_stop"}
    stop, mass = found.law_estimates["bump_stop"], found.parameters.sprung_mass_kg
    assert mass.holds(MASS_KG)
    assert mass.std < 0.01 * MASS_KG
    assert stop["gap_m"].holds(0.006)
    assert stop["gap_m"].std < 0.05 * 0.006
    assert stop["stiffness_n_per_m"].value == pytest.approx(2e6, rel=0.02)


def test_a_stop_that_was_not_reached_is_not_chosen_and_where_it_is_asked_for_withheld():
    study = strut_study(gear_with_stop(0.03))
    searched, asked = identify(study), identify(study, law=f"{LAW.name}+bump_stop")
    assert "bump_stop" not in searched.law.name
    assert not any("stop" in warning for warning in searched.warnings)
    assert [estimate.value for estimate in asked.law_estimates["bump_stop"].values()] == [None, None]
    assert any(warning.startswith("bump_stop was not reached") for warning in asked.warnings)
    # the rest is told as without it
    for found in (searched, asked):
        assert found.parameters.sprung_mass_kg.holds(MASS_KG)
        assert found.law_estimates["gas_column"]["exponent"].holds(1.27)
    assert "bump_stop was not reached" in opid.text(asked)


@pytest.mark.slow
def test_a_strut_of_gas_oil_and_a_seal_is_found_without_being_named(struts):
    """Integrated by the benchmark itself: none of what found it made it."""
    strut = struts.random_strut(4, "plain")
    found = identify(struts.study_of_strut(strut, 4, repeatability=0.0))
    assert set(found.law.name.split("+")) == set(struts.LAW.split("+"))
    laws, mass = found.law_estimates, strut.gear.sprung_mass_kg
    assert found.parameters.sprung_mass_kg.holds(mass)
    assert found.parameters.sprung_mass_kg.value == pytest.approx(mass, rel=5e-3)
    assert laws["gas_column"]["gas_length_m"].value == pytest.approx(strut.length_m, rel=0.03)
    assert laws["gas_column"]["exponent"].value == pytest.approx(strut.exponent, abs=0.05)
    assert laws["dahl_friction"]["amplitude_n"].value == pytest.approx(strut.seal_n, rel=0.03)
    assert laws["orifice_damping"]["rebound_ratio"].holds(strut.rebound / strut.compression)
    # what carries is the gas
    tangent = found.interfaces[0].at_rest[0].stiffness
    stiffness = strut.exponent * strut.push_n / strut.length_m
    assert abs(tangent.value - stiffness) < 3.5 * tangent.std
    assert abs(found.parameters.suspension_stiffness_n_per_m.value) < 0.02 * stiffness


def test_a_named_law_is_fitted_from_generic_starts():
    gear = LandingGear(suspension_stiffness_n_per_m=0.0, suspension_damping_n_s_per_m=2e3, law=LAW)
    found = identify(strut_study(gear), law=LAW.name)
    assert found.residual_over_noise < 1.2
    for kind, values in VALUES.items():
        for name, truth in values.items():
            estimate = found.law_estimates[kind][name]
            assert abs(estimate.value - truth) < 3.5 * estimate.std, name
    frequency = found.ratios.natural_frequency_hz
    true = np.sqrt(1.27 * GRAVITY_M_PER_S2 / 0.08) / (2 * np.pi)
    assert abs(frequency.value - true) < 4 * frequency.std
    # at its own place of rest the light run moves on a softer curve than the isotherm that led there
    light = found.interfaces[0].at_rest[1]
    travel = 0.08 * (MASS_KG / (MASS_KG - 222.0) - 1)
    assert abs(light.travel_m.value - travel) < 3.5 * light.travel_m.std
    there = 1.27 * (MASS_KG - 222.0) * GRAVITY_M_PER_S2 / (0.08 + travel)
    assert abs(light.stiffness.value - there) < 3.5 * light.stiffness.std


def test_a_straight_strut_is_not_taken_for_gas():
    gear = LandingGear(law=LINEAR)
    found = identify(strut_study(gear))
    assert "gas_column" not in found.law.name
    assert found.parameters.sprung_mass_kg.holds(MASS_KG)


def test_a_spring_that_carries_much_beside_the_gas_leaves_the_mass_right():
    """What the gas does not carry is against what is known beforehand, and the runs are believed."""
    gas = law("gas_column", static_force_n=0.5 * WEIGHT_N, gas_length_m=0.05, exponent=1.2)
    gear = LandingGear(suspension_stiffness_n_per_m=1.5e5, suspension_damping_n_s_per_m=4e3, law=gas)
    found = identify(strut_study(gear), law="gas_column")
    assert found.residual_over_noise < 1.2
    assert found.parameters.sprung_mass_kg.holds(MASS_KG)
    stiffness, force = found.parameters.suspension_stiffness_n_per_m, found.law_estimates["gas_column"]
    assert stiffness.value > 0.5e5
    assert force["static_force_n"].value < 0.8 * WEIGHT_N


# ---- as it is serviced -----------------------------------------------------------------------------


def on_air(area_m2, length_m=0.08):
    """A gear on gas, with air outside."""
    push_n = WEIGHT_N + ATMOSPHERE_PA * area_m2
    gas = law("gas_column", static_force_n=push_n, gas_length_m=length_m, exponent=1.27)
    return LandingGear(suspension_stiffness_n_per_m=0.0, suspension_damping_n_s_per_m=4e3, law=gas)


def test_gas_is_told_in_pressure_and_volume_where_the_area_of_the_piston_is_stated():
    area_m2 = 0.004
    study = strut_study(on_air(area_m2), piston_area_m2=area_m2)
    found = identify(study, law="gas_column")
    gas = found.interfaces[0].gas
    push_n = WEIGHT_N + ATMOSPHERE_PA * area_m2
    for estimate, truth in (
        (gas.content_n_m, push_n * 0.08),
        (gas.pressure_pa, WEIGHT_N / area_m2),
        (gas.volume_m3, area_m2 * 0.08),
    ):
        assert abs(estimate.value - truth) < 3 * estimate.std
        assert estimate.std < 0.05 * truth
    text = opid.text(found)
    assert "gas: gauge pressure" in text
    assert "gas: volume" in text
    unstated = identify(strut_study(on_air(area_m2)), law="gas_column").interfaces[0].gas
    assert unstated.pressure_pa.value is None
    assert abs(unstated.content_n_m.value - push_n * 0.08) < 3 * unstated.content_n_m.std
    assert unstated.content_n_m.std > gas.content_n_m.std


@pytest.mark.parametrize("area_m2", [0.0, -0.004, np.nan, 40.0])
def test_a_piston_of_no_size_is_refused(area_m2):
    with pytest.raises(InputError, match=r"the piston_area_m2 is .*, give the area that the gas pushes on"):
        strut_study(on_air(0.004), piston_area_m2=area_m2)


@pytest.mark.parametrize(("axis", "remedy"), [("horizontal", "up; leave the area out"), ("down", "give both channels")])
def test_gas_that_carries_no_weight_or_counts_downwards_has_no_pressure(axis, remedy):
    with pytest.raises(InputError, match=rf"its axis is '{axis}': gas is reported only if it carries .*{remedy}"):
        strut_study(on_air(0.004), piston_area_m2=0.004, axis=axis)


@pytest.mark.parametrize("area_m2", [4e-4, 0.3])
def test_a_piston_area_that_contradicts_the_static_pressure_is_doubted(area_m2):
    found = identify(strut_study(on_air(0.004), piston_area_m2=area_m2), law="gas_column")
    assert any("contradicts the static pressure" in warning for warning in found.warnings)


def test_a_study_file_says_the_area_of_the_piston(tmp_path):
    from opid.studies.study_file import write_study

    study = strut_study(on_air(0.004), piston_area_m2=0.004)
    write_study(study, tmp_path / "study.toml")
    assert read_study(tmp_path / "study.toml").interfaces[0].piston_area_m2 == 0.004


@pytest.mark.parametrize(("changed", "words"), [(-0.08, "a gas leak"), (0.08, "an oil leak")])
def test_flights_tell_a_gas_leak_from_an_oil_leak(tmp_path, changed, words):

    from made_flights import gear_result

    rng = np.random.default_rng(6)
    for i in range(6):
        result = gear_result(rng, std=0.004, kind="gas_column", day=str(date(2026, 3, i + 1)))
        truth = 1450.0 * (1 + (changed if i > 3 else 0.0))
        value, std = truth * (1 + 0.004 * rng.standard_normal()), 0.004 * truth
        told = {"value": value, "std": std, "interval95": [value - 1.96 * std, value + 1.96 * std]}
        amplitude = result["law"]["parameters"]["gas_column"]["amplitude_n"]
        result["law"]["parameters"]["gas_column"] = {"static_force_n": amplitude}
        result["interfaces"] = [{"name": "gear", "gas": {"content_n_m": told}}]
        (tmp_path / f"flight{i}").mkdir()
        (tmp_path / f"flight{i}" / "result.json").write_text(json.dumps(result), encoding="utf-8")
    found = compare(read_flights([tmp_path]))
    (change,) = found.changes
    assert change.quantity.name == "gas"
    assert words in change.statement
    names = {series.quantity.name for series in found.series}
    assert names == {"gas", "damping", "mass"}


@pytest.fixture(scope="module")
def sound_flights():
    """Two flights of a strut that lost nothing."""
    return [flight_of_strut(0.08, number) for number in range(2)]


def flight_of_strut(length_m, number):
    study = strut_study(on_air(0.006, length_m), seed=number, piston_area_m2=0.006, date=date(2026, 3, number + 1))
    return identify(study, law="gas_column")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("volume_factor", "words"), [(0.9, "a gas leak, less pressure"), (1.1, "an oil leak, more volume"), (1.0, None)]
)
def test_a_simulated_leak_is_told_from_flight_to_flight(sound_flights, tmp_path, volume_factor, words):
    """A strut that lost gas rests on a shorter column; one that lost oil and was filled with gas, on a longer one.

    The weight sees to it that the pressure at rest stays the same.
    """
    results = [*sound_flights, flight_of_strut(0.08 * volume_factor, 2)]
    before, after = (result.interfaces[0].gas for result in results[1:])
    assert after.pressure_pa.value == pytest.approx(before.pressure_pa.value, rel=0.04)
    assert after.volume_m3.value == pytest.approx(volume_factor * before.volume_m3.value, rel=0.04)
    for number, result in enumerate(results):
        (tmp_path / f"flight{number}").mkdir()
        (tmp_path / f"flight{number}" / "result.json").write_text(json.dumps(result.to_dict()), encoding="utf-8")
    changes = compare(read_flights([tmp_path])).changes
    if words is None:
        assert changes == ()
        return
    (change,) = (each for each in changes if each.quantity.name == "gas")
    assert words in change.statement
    assert "flight2" in change.statement
    assert change.fraction.holds(volume_factor - 1)


def rubbing_strut(mass_kg, *, length_m=0.12, exponent=1.3):
    """A strut whose seals the gas presses, loaded slowly from 1850 kg at this length; 6 % of its force is friction."""
    weight, length_m = mass_kg * GRAVITY_M_PER_S2, length_m * 1850.0 / mass_kg
    gas = law("gas_column", static_force_n=weight, gas_length_m=length_m, exponent=exponent)
    seal = {"amplitude_n": 0.06 * weight, "scale_m_per_s": 0.02, "deflection_m": length_m / exponent}
    gear = LandingGear(sprung_mass_kg=mass_kg, suspension_damping_n_s_per_m=3e3)
    return replace(gear, suspension_stiffness_n_per_m=1e-3, law=gas + law("loaded_friction", **seal))


@pytest.mark.parametrize(("repeatability", "removed_kg"), [(0.0, 220.0), (0.0, 0.0), (0.01, 220.0)])
def test_friction_that_gas_loads_tells_no_mass_where_runs_of_two_masses_are_stated_to_be_alike(
    repeatability, removed_kg
):
    streams = np.random.default_rng(5).spawn(2)
    runs = [
        Run(name, taxi_run(rubbing_strut(1850.0 - less_kg), rng=rng, fs=256.0, duration_s=20.0).recording, -less_kg)
        for name, less_kg, rng in zip(("first", "second"), (0.0, removed_kg), streams, strict=True)
    ]
    study = study_of_gear("rubs", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=repeatability)
    result = identify(study, law="gas_column+loaded_friction")
    is_withheld = repeatability == 0.0 and removed_kg > 0.0
    assert result.residual_over_noise < 1.2
    assert (result.ratios.stiffness_per_mass.interval95 is None) == is_withheld
    assert (result.ratios.damping_per_mass.interval95 is None) == is_withheld
    assert ("from the gas curve of quick motion" in (result.not_determined or "")) == is_withheld
    if is_withheld:
        assert result.parameters.sprung_mass_kg == Estimate()
