"""From a study of one gear to an answer: right when the data tell, and silent when they do not."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from law_runs import gear_study, study_of

from opid.errors import InputError
from opid.mechanics.laws.law import default_law, law
from opid.signals.recording import recording_from_arrays
from opid.suspensions.identification import METHODS, identify
from opid.suspensions.result import GearParameters, GearRatios
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

TRUTH = LandingGear()


@pytest.fixture(scope="module")
def study():
    return study_of(duration_s=30)


@pytest.fixture(scope="module")
def result(study):
    return identify(study)


def test_every_parameter_is_within_its_interval_or_near(result):
    assert result.method == "model"
    assert result.not_determined is None
    for name, estimate in result.parameters.items():
        # a ground spring that the runs do not demand is zero, not uncertain
        assert abs(estimate.value - getattr(TRUTH, name)) <= 4 * (estimate.std or 0.0)
        assert estimate.interval95 is None or estimate.interval95[0] < estimate.value < estimate.interval95[1]
    assert result.parameters.sprung_mass_kg.std < 4
    assert result.law.name == "arctan_velocity"
    friction = result.law_estimates["arctan_velocity"]
    assert abs(friction["amplitude_n"].value - 400) < 4 * friction["amplitude_n"].std
    assert abs(friction["scale_m_per_s"].value - 0.02) < 4 * friction["scale_m_per_s"].std


def test_the_restoring_force_is_the_true_one_where_the_runs_went(result):
    force = result.restoring_force
    true = 3.9e5 * force.travel + 6e3 * force.velocity + LandingGear().law.force(force.travel, force.velocity)
    assert not force.per_mass
    assert np.std(force.force - true) < 0.01 * np.std(true)
    np.testing.assert_allclose(force.nonlinear_force, result.law.force(force.travel, force.velocity))


def test_ratios_are_those_of_the_parameters(result):
    mass = result.parameters.sprung_mass_kg.value
    np.testing.assert_allclose(
        result.ratios.stiffness_per_mass.value * mass, result.parameters.suspension_stiffness_n_per_m.value
    )
    np.testing.assert_allclose(result.ratios.natural_frequency_hz.value, 2.311, rtol=0.01)
    np.testing.assert_allclose(result.ratios.damping_ratio.value, 0.1117, rtol=0.02)
    # a ratio is known far better than the mass
    relative = result.ratios.stiffness_per_mass.std / result.ratios.stiffness_per_mass.value
    assert relative < result.parameters.sprung_mass_kg.std / mass


def test_the_same_study_gives_the_same_answer_to_the_last_digit(study, result):
    again = identify(study)
    assert again.parameters == result.parameters
    assert again.law == result.law


def test_channel_order_and_time_shift_change_nothing(study, result):
    flipped = []
    for run in study.runs:
        log = run.recording
        arrays = [log.channel("upper_z"), log.channel("lower_z")]
        shifted = recording_from_arrays(arrays, ["upper_z", "lower_z"], fs=log.fs, start_s=100.0)
        flipped.append(Run(run.name, shifted, run.mass_change_kg))
    again = identify(gear_study(*flipped))
    assert again.parameters == result.parameters


def test_the_order_of_the_runs_changes_little(study, result):
    again = identify(gear_study(*study.runs[::-1]))
    for (_, after), (_, before) in zip(again.parameters.items(), result.parameters.items(), strict=True):
        assert abs(after.value - before.value) <= 0.2 * (before.std or 0.0)


def test_three_runs_are_better_than_two():
    rng = np.random.default_rng(3)
    runs = [
        Run(
            f"minus_{-change:g}",
            taxi_run(LandingGear(sprung_mass_kg=1850 + change), rng=rng, duration_s=20, fs=256).recording,
            change,
        )
        for change in (0.0, -110.0, -220.0, -330.0)
    ]
    pair, all_four = (identify(gear_study(*chosen)) for chosen in (runs[:2], runs))
    assert all_four.parameters.sprung_mass_kg.std < 0.6 * pair.parameters.sprung_mass_kg.std
    assert abs(all_four.parameters.sprung_mass_kg.value - 1850) < 4 * all_four.parameters.sprung_mass_kg.std


def test_equal_masses_give_ratios_only():
    result = identify(study_of(seed=1, mass_removed_kg=0.0, change_kg=0.0))
    assert "only ratios to the mass" in result.not_determined
    assert result.parameters == GearParameters()
    np.testing.assert_allclose(result.ratios.stiffness_per_mass.value, 3.9e5 / 1850, rtol=0.01)
    assert result.restoring_force.per_mass
    np.testing.assert_allclose(result.law.vector, [400 / 1850, 0.02], rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize(
    ("name", "duration_s"), [("arctan_velocity", 20), ("cubic_stiffness", 12), ("quadratic_damping", 20)]
)
def test_equal_masses_that_were_not_equal_say_so(name, duration_s, given):
    """A real mass change entered as zero: the runs contradict it, no ratio belongs to both, and no fault makes up."""
    gear = LandingGear(law=default_law(name))
    test = taxi_test(gear, rng=np.random.default_rng(0), duration_s=duration_s, fs=256)
    study = gear_study(Run("heavy", test.heavy.recording), Run("light", test.light.recording))
    result = identify(study, law=name if given else None)
    assert "same sprung mass" in result.not_determined
    assert "they have different natural frequencies (2." in result.not_determined
    assert result.evidence[0].demands == ()
    assert "check mass_change_kg" in result.not_determined
    assert (result.parameters, result.ratios) == (GearParameters(), GearRatios())


def test_a_second_run_of_ten_seconds_is_enough_for_every_step(study):
    """Of so few blocks the nonlinear force was once not told from the motion, and a step divided by nothing."""
    short = study.runs[1].recording.section(start_s=study.runs[1].recording.time_s[-1] - 10.0)
    shortened = gear_study(study.runs[0], Run("light", short, study.runs[1].mass_change_kg))
    result = identify(shortened, law="arctan_velocity")
    low, high = result.parameters.sprung_mass_kg.interval95
    assert low < 1850.0 < high


@pytest.mark.slow
def test_a_clipped_channel_is_named_in_the_warnings(study):
    log = study.runs[0].recording
    clipped = np.clip(log.channel("lower_z"), -2.0, 2.0)
    recording = recording_from_arrays([clipped, log.channel("upper_z")], ["lower_z", "upper_z"], fs=log.fs)
    result = identify(gear_study(Run("heavy", recording), study.runs[1]), law="arctan_velocity")
    assert any("clip" in warning for warning in result.warnings)


def test_a_mass_change_that_did_not_happen_gives_no_mass():
    result = identify(study_of(seed=1, mass_removed_kg=0.0, change_kg=-220.0))
    assert result.not_determined is not None
    assert result.parameters.sprung_mass_kg.value is None
    assert result.ratios.stiffness_per_mass.value is not None


def test_runs_that_are_all_loaded_and_not_explained_are_answered(study):
    """No run has the reference loading, from which another search could begin."""
    runs = [Run(run.name, run.recording, change) for run, change in zip(study.runs, (1000.0, -220.0), strict=True)]
    result = identify(gear_study(*runs), law="linear")
    mass = result.parameters.sprung_mass_kg
    assert mass.value is None or mass.holds(TRUTH.sprung_mass_kg - 1000.0)


def test_the_driven_model_with_a_wrong_law_says_so_and_its_intervals_hold_the_truth(study):
    result = identify(study, law="linear")
    assert result.residual_over_noise > 10
    assert any("times the noise of the sensors" in warning for warning in result.warnings)
    mass, stiffness = result.parameters.sprung_mass_kg, result.parameters.suspension_stiffness_n_per_m
    assert mass.value is None or mass.holds(TRUTH.sprung_mass_kg)
    assert stiffness.value is None or stiffness.holds(TRUTH.suspension_stiffness_n_per_m)


@pytest.mark.slow
def test_swapped_and_mute_channels_are_refused(study):
    swapped = study_of_gear("taxi", sprung="lower_z", unsprung="upper_z", runs=study.runs)
    result = identify(swapped, law="linear")
    assert result.is_refused
    assert "check the channels (swapped" in result.not_determined
    assert any("run 'heavy'" in each and "exchange sprung and unsprung" in each for each in result.warnings)
    log = study.runs[0].recording
    mute = recording_from_arrays([log.channel("lower_z"), np.zeros(log.n_samples)], ["lower_z", "upper_z"], fs=256)
    with pytest.raises(InputError, match=r"run 'heavy'.*mute"):
        identify(gear_study(Run("heavy", mute)))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 9.80665])
def test_a_run_in_another_unit_than_the_others_is_told(study, factor):
    """Both of its channels agree, and only the law contradicts it."""
    heavy, light = study.runs
    log = light.recording
    strong = recording_from_arrays(factor * log.samples.T, log.names, fs=log.fs)
    result = identify(gear_study(heavy, Run("light", strong, light.mass_change_kg)), law="arctan_velocity")
    told = [warning for warning in result.warnings if "another unit than stated" in warning]
    assert len(told) == (factor > 1)
    assert all("every channel of run 'light'" in each and "g is 9.807 m/s^2" in each for each in told)


@pytest.mark.parametrize("method", ["model", "classical"])
def test_a_band_that_the_rate_does_not_hold_is_told(study, method):
    """At 256 Hz the lines end at 102.4 Hz."""
    law = "arctan_velocity"
    (told,) = (
        each for each in identify(study, law=law, method=method, band_hz=(0.5, 120)).warnings if "sampled" in each
    )
    assert "sampled at 256 Hz" in told
    assert "up to 102.4 Hz instead of 120 Hz, because the filters of loggers begin at 0.4 of the rate" in told
    assert not any("sampled" in each for each in identify(study, law=law, method=method, band_hz=(0.5, 100)).warnings)


def test_an_implausible_mass_change_is_seen(study):
    # grams for kilograms
    with pytest.raises(InputError, match="more than any gear carries"):
        gear_study(study.runs[0], Run("light", study.runs[1].recording, -220_000.0))


@pytest.mark.parametrize(
    ("change_kg", "unit", "mass"), [(-0.22, "tonnes", "1.85 kg"), (-9.9e4, "grams", "8.32e+05 kg")]
)
def test_a_mass_change_in_another_unit_is_asked_about(change_kg, unit, mass):
    """The runs fit as well as with the right one, so that a bench of such a mass is told no more than this sentence."""
    found = identify(study_of(change_kg=change_kg), law="arctan_velocity")
    (sentence,) = found.warnings
    assert sentence.startswith(f"the scale rests on {change_kg:+g} kg, which makes the mass {mass}: mass_change_kg is")
    assert unit in sentence
    right = identify(study_of(), law="arctan_velocity")
    assert right.warnings == ()
    assert found.residual_over_noise == pytest.approx(right.residual_over_noise, rel=1e-3)
    masses = found.parameters.sprung_mass_kg.value, right.parameters.sprung_mass_kg.value
    assert masses[0] / masses[1] == pytest.approx(change_kg / -220, rel=1e-3)


@pytest.mark.parametrize("name", ["arctan_displacement", "quadratic_damping", "cubic_stiffness"])
def test_a_given_law_is_fitted(name):
    gear = LandingGear(law=default_law(name))
    result = identify(study_of(gear, seed=2), law=name)
    assert result.law.name == name
    np.testing.assert_allclose(result.law.vector, gear.law.vector, rtol=0.1)


@pytest.mark.parametrize("channel", ["lower_z", "upper_z"])
@pytest.mark.parametrize("height", [20.0, 100.0])
def test_single_spikes_change_the_mass_by_less_than_its_deviation(study, channel, height):
    runs = []
    for run in study.runs:
        columns = {name: run.recording.channel(name).copy() for name in run.recording.names}
        columns[channel][[400, 1900, 3300]] += height
        recording = recording_from_arrays(list(columns.values()), list(columns), fs=run.recording.fs)
        runs.append(Run(run.name, recording, run.mass_change_kg))
    clean, spiked = (identify(replace(study, runs=each), law="arctan_velocity") for each in (study.runs, runs))
    assert spiked.mended_spikes == ((6, 0) if channel == "lower_z" else (0, 6))
    assert any("6 spike(s) of one sample were mended" in warning for warning in spiked.warnings)
    assert not any("spike" in warning for warning in clean.warnings)
    before, after = (each.parameters.sprung_mass_kg for each in (clean, spiked))
    assert abs(after.value - before.value) < after.std < 4 * before.std


def documented_sensors():
    """The [sensors] block of the page on one suspension as it stands there."""
    page = (Path(__file__).parents[1] / "docs" / "suspension.md").read_text(encoding="utf-8")
    (block,) = (each for each in re.findall(r"```toml\n(.*?)```", page, re.S) if "[sensors.unsprung]" in each)
    stated = tomllib.loads(block)["sensors"]
    leaks = tuple(Leak(**each) for each in stated["leak"])
    return SensorPair(SensorFacts(**stated["unsprung"]), SensorFacts(**stated["sprung"]), leaks)


def contradictions(result):
    return [each for each in result.warnings if "contradicts the runs" in each]


def test_stated_corners_that_the_runs_contradict_are_named_and_spoil_nothing():
    """Sensors that are said to be AC-coupled and are not: the corners found are next to none, and the rest is noise."""
    result = identify(study_of(sensors=documented_sensors(), duration_s=40, fore_aft=True), law="arctan_velocity")
    assert result.residual_over_noise < 1.1
    named = contradictions(result)
    assert len(named) == 2
    for side, sentence in zip(("unsprung", "sprung"), named, strict=True):
        stated = f"the stated corner of the AC coupling of the {side} sensor, 0.33 Hz with standard deviation 0.066"
        assert sentence.startswith(stated)
        assert "(5.0 standard deviations away): check the data sheet, or state a larger standard deviation" in sentence
        assert result.evidence[0].fit.value(f"corner_{side}_hz") < 0.005
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - TRUTH.sprung_mass_kg) < 4 * mass.std
    assert mass.std < 3


def test_corners_stated_far_from_the_true_ones_are_found_and_named():
    """Stated without a tolerance at 0.33 Hz, and true at 1.5 Hz, where no usual fault is looked for."""
    facts, sensor = SensorFacts(corner_hz=0.33), Sensor(corner_hz=1.5)
    coupled = {"lower_sensor": sensor, "upper_sensor": sensor, "duration_s": 20.0, "fs": 256.0}
    result = identify(study_of(seed=1, sensors=SensorPair(facts, facts), **coupled), law="arctan_velocity")
    assert {each.name for each in result.evidence[0].demands} == {"corner_unsprung_hz", "corner_sprung_hz"}
    for each in result.evidence[0].demands:
        assert each.value == pytest.approx(1.5, abs=4 * each.std)
    (named,) = (each for each in result.warnings if "than the study states without a tolerance" in each)
    assert named.startswith("AC coupling with another corner than the study states")
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - TRUTH.sprung_mass_kg) < 4 * mass.std < 24


def test_stated_corners_that_are_there_are_no_contradiction():
    coupled = {"lower_sensor": Sensor(corner_hz=0.33), "upper_sensor": Sensor(corner_hz=0.33)}
    sound = study_of(sensors=documented_sensors(), duration_s=40, fore_aft=True, **coupled)
    result = identify(sound, law="arctan_velocity")
    assert result.residual_over_noise < 1.1
    assert not contradictions(result)


@pytest.mark.slow
@pytest.mark.parametrize(("tolerance", "gain", "words"), [(0.002, 1.1, "or more"), (0.002, 0.9, "or less")])
def test_a_fact_that_ends_at_a_bound_is_told_as_a_bound(tolerance, gain, words):
    """A gain is looked for within eight standard deviations of what is stated."""
    stated = SensorPair(sprung=SensorFacts(gain_tolerance=tolerance))
    result = identify(study_of(sensors=stated, duration_s=12, upper_sensor=Sensor(gain=gain)), law="arctan_velocity")
    (sentence,) = contradictions(result)
    assert f"which show {1 + np.sign(gain - 1) * 8 * tolerance:.3g} {words} (8.0 standard deviations away)" in sentence


def test_bad_arguments_are_named(study):
    with pytest.raises(InputError, match="did you mean 'classical'"):
        identify(study, method="clasical")
    with pytest.raises(InputError, match="did you mean 'cubic_stiffness'"):
        identify(study, law="cubic_stifness")
    with pytest.raises(InputError, match="give a Study, as read_study or study_of_gear makes one"):
        identify("study.toml")
    with pytest.raises(InputError, match="give two numbers, the lowest and the highest line"):
        identify(study, band_hz=(0.3,))
    with pytest.raises(InputError, match=r"the band 300 to 400 Hz lies above .* give a band below it"):
        identify(study, band_hz=(300.0, 400.0))
    assert set(METHODS) == {"classical", "model", "paper"}


def test_the_driven_model_finds_the_gain_error_itself():
    study = study_of(upper_sensor=Sensor(gain=1.01), lower_sensor=Sensor())
    result = identify(study, law="arctan_velocity")
    said = "a gain error between the sensors that the study does not state was added"
    assert any(said in warning for warning in result.warnings)
    (demand,) = result.evidence[0].demands
    assert demand.name == "gain_sprung"
    assert abs(demand.value - 1.01) < 4 * demand.std
    for name, estimate in result.parameters.items():
        assert abs(estimate.value - getattr(TRUTH, name)) <= 4 * (estimate.std or 0.0)


def test_a_real_ground_spring_is_found_and_doubted():
    result = identify(study_of(LandingGear(ground_stiffness_n_per_m=1.67e5)), law="arctan_velocity")
    ground = result.parameters.ground_stiffness_n_per_m
    np.testing.assert_allclose(ground.value, 1.67e5, rtol=0.02)
    assert abs(ground.value - 1.67e5) < 4 * ground.std
    assert any("K3" in warning for warning in result.warnings)


def test_a_straight_arctangent_gets_no_interval_and_neither_does_what_it_trades_with():
    straight = law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.5)
    result = identify(study_of(LandingGear(law=straight)), law="arctan_velocity")
    assert any("cannot be distinguished from damping" in warning for warning in result.warnings)
    assert result.parameters.suspension_damping_n_s_per_m.interval95 is None
    assert all(each.interval95 is None for each in result.law_estimates["arctan_velocity"].values())
    # the sum of the two is determined all the same, and so is everything else
    slope = result.parameters.suspension_damping_n_s_per_m.value + float(result.law.gradient(0.0, 0.0)[1])
    np.testing.assert_allclose(slope, 6e3 + float(straight.gradient(0.0, 0.0)[1]), rtol=0.03)
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - 1850) < 4 * mass.std
