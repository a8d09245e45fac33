"""Where runs rest under the weight that they carry: balance, derivatives, and what it does to an estimate."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import opid
from opid import identify, plots
from opid.mechanics.driven import Interface, UnboundedResponseError
from opid.mechanics.laws.law import LINEAR, default_law, law
from opid.mechanics.truth import GearTruth
from opid.mechanics.weight import GRAVITY_M_PER_S2, by_parameters, find_rest, laws_at_rest, resting
from opid.signals.recording import recording_from_arrays
from opid.suspensions.study import MeasuredInterface, PointMass, Run, StructureSettings, Study, study_of_gear
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test, taxi_truth
from opid.virtual.truth_file import read_truth, write_field_test

CHANNELS = ("upper_z", "lower_z")
LAWS = ("cubic_stiffness", "gas_column", "arctan_displacement", "arctan_velocity+dead_zone_stiffness")
ROWS = np.array([[1.0, 0.0, -4.0], [1.0, 2.0, 1.0], [1.0, -2.0, 1.0]])
LOAD = np.array([-3000.0, 800.0, 2500.0])


def three(name):
    """Suspensions of an aircraft, one of them on another place of its law."""
    laws = [default_law(name).resting_at(rest_m) for rest_m in (0.0, -0.006, 0.003)]
    return [Interface(k, 3e3, g, law) for k, g, law in zip((2e5, 3e5, 3.1e5), (0.0, 2e4, 0.0), laws, strict=True)]


@pytest.mark.parametrize("name", LAWS)
def test_springs_and_weight_balance(name):
    gear = Interface(3.9e5, 6e3, law=default_law(name).resting_at(-0.004))
    found = find_rest([gear], np.ones((1, 1)), np.array([-2158.0])).travel[0]
    exact = brentq(lambda d: 3.9e5 * d + float(gear.law.static_force(d)[0]) + 2158.0, -0.05, 0.05, xtol=1e-14)
    assert found == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_the_place_at_rest_is_differentiated(name):
    suspensions, found = three(name), find_rest(three(name), ROWS, LOAD)
    np.testing.assert_allclose(found.by_load, found.compliance @ np.linalg.pinv(ROWS.T) @ LOAD, rtol=1e-9)
    more = find_rest(suspensions, ROWS, 1.0001 * LOAD).travel - find_rest(suspensions, ROWS, 0.9999 * LOAD).travel
    np.testing.assert_allclose(found.by_load, more / 2e-4, rtol=1e-5)
    for number, (suspension, travel) in enumerate(zip(suspensions, found.travel, strict=True)):
        own = np.array(
            [
                suspension.stiffness,
                suspension.damping,
                suspension.ground_stiffness,
                suspension.law.rest_m,
                *suspension.law.vector,
            ]
        )
        derivatives = -np.outer(found.compliance[:, number], by_parameters(suspension, travel))
        for place, value in enumerate(own):
            step = 1e-4 * (abs(value) or 1e-3)
            moved = []
            for sign in (1, -1):
                at = own.copy()
                at[place] += sign * step
                changed = Interface(*at[:3], suspension.law.with_vector(at[4:]).resting_at(at[3]))
                moved.append(find_rest([*suspensions[:number], changed, *suspensions[number + 1 :]], ROWS, LOAD).travel)
            difference = (moved[0] - moved[1]) / (2 * step)
            size = np.abs(found.travel).max() / max(abs(value), 1e-3)
            np.testing.assert_allclose(derivatives[:, place], difference, atol=1e-4 * size)


def test_a_law_rests_where_it_is_moved_to():
    cubic = law("cubic_stiffness", stiffness_n_per_m3=3e9).resting_at(0.004)
    z = np.linspace(-0.01, 0.01, 5)
    np.testing.assert_allclose(cubic.force(z, 0.0), 3e9 * ((z + 0.004) ** 3 - 0.004**3), rtol=1e-12)
    np.testing.assert_allclose(cubic.gradient(z, 0.0)[0], 9e9 * (z + 0.004) ** 2, rtol=1e-12)
    moved = resting(Interface(1.0, 1.0, law=cubic), -0.001)
    assert moved.law.rest_m == pytest.approx(0.003)
    assert cubic.scaled(2.0).rest_m == cubic.with_vector([1.0]).rest_m == 0.004
    assert laws_at_rest([Interface(1e5, 1.0)], np.ones((1, 1)), np.array([-1e3])) == [LINEAR]


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_spring_that_gives_way_at_once_is_found_its_place(sign):
    """Newton's step from where the spring is stiffest goes far beyond the balance, and back."""
    softening = law("arctan_displacement", amplitude_n=12.0, scale_m=2e-4).resting_at(0.002 * sign)
    suspension = Interface(7.0, 1.0, law=softening)
    found = find_rest([suspension], np.ones((1, 1)), np.array([-1.5 * sign])).travel[0]
    exact = brentq(lambda d: 7.0 * d + float(softening.force(d, 0.0)) + 1.5 * sign, -3.0, 3.0, xtol=1e-14)
    assert found == pytest.approx(exact, abs=1e-9)


def test_a_spring_that_cannot_carry_the_weight_is_named():
    yielding = Interface(0.0, 1.0, law=law("arctan_displacement", amplitude_n=1e3, scale_m=0.01))
    with pytest.raises(UnboundedResponseError, match=r"at most 50 % of the weight.*beyond its stop: check the mass"):
        find_rest([yielding], np.ones((1, 1)), np.array([-2e3]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cubic_stiffness", "gas_column"])
def test_a_light_run_rests_where_its_weight_puts_it_and_the_mass_is_right(name):
    """A strut that hardens hard: without the weight the two runs are taken for two struts."""
    gear = LandingGear(law=default_law(name))
    if name == "gas_column":
        column = law(name, static_force_n=gear.sprung_mass_kg * GRAVITY_M_PER_S2, gas_length_m=0.07, exponent=1.27)
        gear = LandingGear(suspension_stiffness_n_per_m=0.0, law=column)
    test = taxi_test(gear, rng=np.random.default_rng(0))
    removed = -test.mass_change_kg * GRAVITY_M_PER_S2
    rest = test.light.gear.law.rest_m
    force = gear.suspension_stiffness_n_per_m * rest + float(gear.law.static_force(rest)[0])
    assert force == pytest.approx(removed)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    found = identify(study, law=name)
    assert found.parameters.sprung_mass_kg.holds(gear.sprung_mass_kg)
    assert found.residual_over_noise < 1.05
    flat = identify(replace(study, interfaces=(replace(study.interfaces[0], axis="horizontal"),)), law=name)
    assert flat.residual_over_noise > found.residual_over_noise
    doubts = [warning for warning in flat.warnings if "carries weight" in warning]
    assert len(doubts) == (name == "gas_column"), "no weight says what a column of gas that lies flat carries"
    assert not any("the axis is 'horizontal'" in warning for warning in found.warnings)


def test_channels_that_count_downwards_say_so():
    gear = LandingGear(law=default_law("cubic_stiffness"))
    test = taxi_test(gear, rng=np.random.default_rng(0), duration_s=20.0, fs=256.0)

    def mass(sign, axis):
        recordings = [
            recording_from_arrays([sign * run.recording.channel(name) for name in CHANNELS], CHANNELS, fs=256.0)
            for run in (test.heavy, test.light)
        ]
        runs = (Run("heavy", recordings[0]), Run("light", recordings[1], test.mass_change_kg))
        study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, axis=axis, repeatability=0.0)
        result = identify(study, law="cubic_stiffness")
        return result.residual_over_noise, result.parameters.sprung_mass_kg.value

    up, down, wrong = mass(1.0, "up"), mass(-1.0, "down"), mass(-1.0, "up")
    assert down == pytest.approx(up, rel=1e-4)
    assert wrong[0] > 1.5 * up[0]


def test_an_aircraft_on_struts_that_harden_rests_where_its_loading_puts_it():
    plain = default_aircraft()
    laws = [default_law("cubic_stiffness").scaled(factor) for factor in (1 / 3, 1.0, 1.0)]
    gears = tuple(replace(gear, law=law) for gear, law in zip(plain.gears, laws, strict=True))
    airframe, places = replace(plain, gears=gears), {gear.name: (gear.x_m, gear.y_m) for gear in gears}
    loads = (PointMass(500.0, 1.0, 0.2),)
    settings = {"duration_s": 12.0, "fs": 256.0, "lowest_step_rate_hz": 1024.0, "coherent_tracks": False}
    test = taxi_test(airframe, rng=np.random.default_rng(1), loadings=[loads], **settings)
    assert max(gear.law.rest_m for gear in test.runs[1].airframe.gears) < -0.002
    runs = [
        Run(name, run.recording, loading)
        for name, run, loading in zip(("light", "heavy"), test.runs, ((), loads), strict=True)
    ]
    interfaces = [MeasuredInterface(name, f"{name}_upper_z", f"{name}_lower_z", *at) for name, at in places.items()]
    study = Study("taxi", interfaces, runs, StructureSettings("rigid_body", noise_m_per_s2=5e-3), repeatability=0.0)
    found = identify(study, law="cubic_stiffness")
    assert found.residual_over_noise < 1.05
    for name, truth in (("sprung_mass_kg", 5400.0), ("x_cg_m", 0.6), ("y_cg_m", 0.0), ("pitch_inertia_kg_m2", 2.7e4)):
        estimate = getattr(found.parameters, name)
        assert abs(estimate.value - truth) < 3 * estimate.std, name


def test_a_spring_about_its_unloaded_length_is_found_with_its_origin(tmp_path):
    """The strut carries its body on K d + k d^3 about the unloaded length, 30 mm from where it rests."""
    cubic = law("cubic_stiffness", stiffness_n_per_m3=2.5e8)
    stiffness = (1850.0 * GRAVITY_M_PER_S2 - 2.5e8 * 0.03**3) / 0.03
    gear = LandingGear(suspension_stiffness_n_per_m=stiffness, law=cubic.resting_at(-0.03))
    test = taxi_test(gear, rng=np.random.default_rng(2), duration_s=30, fs=256)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    found = identify(study)
    (strut,) = found.interfaces
    assert found.law.name == "cubic_stiffness"
    for estimate, truth in (
        (found.parameters.sprung_mass_kg, 1850.0),
        (strut.rest_m, -0.03),
        (strut.stiffness, stiffness),
        (strut.at_rest[0].travel_m, 0.0),
        (strut.at_rest[0].stiffness, stiffness + 3 * 2.5e8 * 0.03**2),
        (strut.at_rest[0].damping, 6000.0),
    ):
        assert abs(estimate.value - truth) <= 3.5 * estimate.std
    travel = test.light.gear.law.rest_m + 0.03
    light = strut.at_rest[1]
    assert light.run == "light"
    assert light.travel_m.value == pytest.approx(travel, abs=3.5 * light.travel_m.std)
    tangent = stiffness + 3 * 2.5e8 * (travel - 0.03) ** 2
    assert light.stiffness.value == pytest.approx(tangent, abs=3.5 * light.stiffness.std)
    for each, motion in zip(strut.at_rest, found.evidence[0].fit.errors.predictions, strict=True):
        assert np.ptp(each.travelled_m) == pytest.approx(np.ptp(motion.travel))
        assert each.travelled_m[0] < each.travel_m.value < each.travelled_m[1]
    # with the truth that was written beside the runs
    write_field_test(study, taxi_truth(test), tmp_path)
    known = read_truth(tmp_path / "truth.json", GearTruth)
    told = " ".join(opid.text(found, known).split())
    assert re.search(r"rest on the law -0\.030\d* -0\.0\d* \.\. -0\.0\d* m -0\.03 ([+-]\S+ )?yes", told)
    frequency_hz = np.sqrt((stiffness + 3 * 2.5e8 * 0.03**2) / 1850.0) / (2 * np.pi)
    assert f"Hz {frequency_hz:.6g} " in told
    _shows_where_it_rests(plots.static_curves(found, truth=known)[0, 0], found)


def _shows_where_it_rests(ax, found):
    """The curve carries nothing at its origin, and in a run what weighs less than in the reference run."""
    mass_kg = found.parameters.sprung_mass_kg.value
    drawn = {line.get_label(): line.get_xydata() for line in ax.lines}
    np.testing.assert_allclose(drawn["run 'heavy' at rest, its travel shaded"][0], [-30, 0], atol=0.3)
    travel_mm, lifted_kn = drawn["run 'light' at rest, its travel shaded"][0]
    assert travel_mm == pytest.approx(-27.9, abs=0.3)
    assert lifted_kn == pytest.approx(0.22 * GRAVITY_M_PER_S2, rel=1e-4)
    far = next(xy for xy in drawn.values() if xy[-1, 0] == pytest.approx(0.0, abs=1e-9))
    assert far[-1, 1] == pytest.approx(1e-3 * mass_kg * GRAVITY_M_PER_S2, rel=0.01)
    near, true = drawn["springs, standing still"], drawn["truth"]
    np.testing.assert_allclose(np.interp(near[:, 0], *true.T), near[:, 1], atol=0.4)
    shaded = sorted(patch.get_x() for patch in ax.patches)
    assert shaded == pytest.approx(
        sorted(-30 + 1e3 * each.travelled_m[0] for each in found.interfaces[0].at_rest), abs=0.3
    )


def test_a_straight_strut_gives_way_by_the_weight_over_its_stiffness():
    test = taxi_test(LandingGear(law=LINEAR), rng=np.random.default_rng(4), duration_s=20, fs=256)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    found = identify(study, law="linear")
    light = found.interfaces[0].at_rest[1]
    assert light.travel_m.value == pytest.approx(
        -test.mass_change_kg * GRAVITY_M_PER_S2 / found.interfaces[0].stiffness.value, rel=1e-6
    )
    for name in ("value", "std"):
        alike = getattr(found.interfaces[0].stiffness, name)
        assert getattr(light.stiffness, name) == pytest.approx(alike, rel=1e-6)
    lying = identify(replace(study, interfaces=tuple(replace(each, axis="horizontal") for each in study.interfaces)))
    assert lying.interfaces[0].at_rest[1].travel_m.value is None


def test_struts_that_harden_hard_begin_with_the_run_without_loading():
    """Between its runs the stiffness of the nose strut more than doubles: no start of both runs is of any use."""
    plain = default_aircraft()
    gears = tuple(replace(gear, law=default_law("cubic_stiffness")) for gear in plain.gears)
    airframe, loads = replace(plain, gears=gears), (PointMass(500.0, 1.0, 0.2),)
    settings = {"duration_s": 12.0, "fs": 256.0, "lowest_step_rate_hz": 1024.0, "coherent_tracks": False}
    test = taxi_test(airframe, rng=np.random.default_rng(1), loadings=[loads], **settings)
    runs = [
        Run(name, run.recording, loading)
        for name, run, loading in zip(("light", "heavy"), test.runs, ((), loads), strict=True)
    ]
    interfaces = [
        MeasuredInterface(gear.name, f"{gear.name}_upper_z", f"{gear.name}_lower_z", gear.x_m, gear.y_m)
        for gear in gears
    ]
    study = Study("taxi", interfaces, runs, StructureSettings("rigid_body", noise_m_per_s2=5e-3), repeatability=0.0)
    found = identify(study, law="cubic_stiffness")
    assert found.residual_over_noise < 1.05
    mass = found.parameters.sprung_mass_kg
    assert abs(mass.value - 5400.0) < 3 * mass.std


def test_a_load_that_is_only_moved_is_fitted_from_the_run_without_it():
    """No mass comes or goes: what the runs say of the mass they say by its moments."""
    plain = default_aircraft()
    gears = tuple(replace(gear, law=default_law("cubic_stiffness")) for gear in plain.gears)
    loads = (PointMass(400.0, 4.0, 0.0), PointMass(-400.0, -1.0, 0.0))
    settings = {"duration_s": 12.0, "fs": 256.0, "lowest_step_rate_hz": 1024.0, "coherent_tracks": False}
    test = taxi_test(
        replace(plain, gears=gears),
        rng=np.random.default_rng(3),
        loadings=[loads],
        **settings,
    )
    runs = [
        Run(name, run.recording, loading)
        for name, run, loading in zip(("before", "after"), test.runs, ((), loads), strict=True)
    ]
    interfaces = [
        MeasuredInterface(gear.name, f"{gear.name}_upper_z", f"{gear.name}_lower_z", gear.x_m, gear.y_m)
        for gear in gears
    ]
    study = Study("taxi", interfaces, runs, StructureSettings("rigid_body", noise_m_per_s2=5e-3), repeatability=0.0)
    found = identify(study, law="cubic_stiffness")
    mass = found.parameters.sprung_mass_kg
    assert found.residual_over_noise < 1.05
    assert abs(mass.value - 5400.0) < 3 * mass.std


def test_a_scale_may_be_as_long_as_runs_of_other_loadings_rest_apart():
    """Over its travel a law of five times the rms is next to straight, but the light run rests 5 mm higher on it."""
    arctan = law("arctan_displacement", amplitude_n=1000.0, scale_m=5e-3)
    gear = LandingGear(suspension_stiffness_n_per_m=6e5, suspension_damping_n_s_per_m=2e4, law=arctan)
    test = taxi_test(gear, rng=np.random.default_rng(0), road_class="A", mass_removed_kg=300.0)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    found = identify(study, law="arctan_displacement")
    assert found.evidence[0].fit.motion(0)[0].std() == pytest.approx(5e-3 / 5, rel=0.1)
    assert found.parameters.sprung_mass_kg.value == pytest.approx(1850.0, rel=0.01)
    assert found.law_estimates["arctan_displacement"]["scale_m"].value == pytest.approx(5e-3, rel=0.1)
