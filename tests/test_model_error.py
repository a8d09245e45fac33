"""Runs that the model cannot explain: nothing, or a wide interval that holds the truth, but never a confident error."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from opid import cli
from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.mechanics.weight import GRAVITY_M_PER_S2
from opid.signals.recording import recording_from_arrays
from opid.studies.study_file import write_study
from opid.suspensions import candidates
from opid.suspensions.identification import identify
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.result import GearParameters
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.road import SpeedProfile, iso8608_road
from opid.virtual.taxi_tests.sensors import Sensor, decimate, measure
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

FS, DURATION_S, LEAD_S = 256.0, 20.0, 6.0
SHORT = {"duration_s": DURATION_S, "fs": FS}
MASS_KG, CHANGE_KG = 1850.0, -220.0
GEAR = LandingGear()


def study_of(heavy, light, sides=("lower_z", "upper_z")):
    runs = (Run("heavy", heavy, 0.0), Run("light", light, CHANGE_KG))
    return study_of_gear("taxi", sprung=sides[1], unsprung=sides[0], runs=runs, repeatability=0.0)


def taxi(seed, gear=GEAR, **settings):
    test = taxi_test(gear, rng=np.random.default_rng(seed), **SHORT, **settings)
    return study_of(test.heavy.recording, test.light.recording)


def readings(lower, upper, rng):
    """What two ordinary accelerometers make of accelerations at 8 FS, the lead-in left out."""
    first, n = round(LEAD_S * FS), round(DURATION_S * FS)
    columns = [
        measure(decimate(each, 8)[first : first + n], fs=FS, sensor=Sensor(), rng=own)
        for each, own in zip((lower, upper), rng.spawn(2), strict=True)
    ]
    return recording_from_arrays(columns, ["lower_z", "upper_z"], fs=FS)


def roads(rng, n, speed):
    length_m = float(speed.position_m(DURATION_S + 1.0) - speed.position_m(-LEAD_S))
    return [iso8608_road("B", length_m=length_m, footprint_m=0.3, rng=own) for own in rng.spawn(n)]


def tyre_forces(tracks, speed, time_s):
    time = time_s - LEAD_S
    place, velocity = speed.position_m(time) - speed.position_m(-LEAD_S), speed.speed_m_per_s(time)
    pushes = [
        GEAR.tyre_stiffness_n_per_m * road.elevation(place) + GEAR.tyre_damping_n_s_per_m * road.slope(place) * velocity
        for road in tracks
    ]
    return np.stack(pushes, axis=1)


# ---- an aircraft that rolls on two main gears ------------------------------------------------------

HALF_TRACK_M, ROLL_INERTIA_KG_M2 = 1.4, 3500.0


def rolling_run(mass_kg, inertia_kg_m2, rng, *, coherent):
    """One main gear of a body that heaves and rolls, either track over a road of its own or both over one."""
    struts = [
        Joint(
            name,
            np.array(direction),
            GEAR.suspension_stiffness_n_per_m,
            GEAR.suspension_damping_n_s_per_m,
            GEAR.law,
        )
        for name, direction in (
            ("left", [-1.0, 0.0, 1.0, HALF_TRACK_M]),
            ("right", [0.0, -1.0, 1.0, -HALF_TRACK_M]),
        )
    ]
    tyre, tyre_damping = GEAR.tyre_stiffness_n_per_m, GEAR.tyre_damping_n_s_per_m
    aircraft = Structure(
        mass=np.diag([GEAR.unsprung_mass_kg, GEAR.unsprung_mass_kg, mass_kg, inertia_kg_m2]),
        damping=np.diag([tyre_damping, tyre_damping, 0.0, 0.0]),
        stiffness=np.diag([tyre, tyre, 0.0, 0.0]),
        joints=tuple(struts),
        names=("left wheel", "right wheel", "heave", "roll"),
    )
    road_rng, noise_rng = rng.spawn(2)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    left, right = roads(road_rng, 2, speed)
    tracks = (left, left if coherent else right)

    def force(time_s):
        return np.pad(tyre_forces(tracks, speed, time_s), ((0, 0), (0, 2)))

    motion = time_response(aircraft, force, fs=8 * FS, duration_s=LEAD_S + DURATION_S + 0.5).acceleration
    return readings(motion[:, 0], motion[:, 2] + HALF_TRACK_M * motion[:, 3], noise_rng)


@cache
def rolling(seed, *, coherent=False):
    """Half the mass rests on either gear, and half the mass change."""
    rngs = np.random.default_rng(seed).spawn(2)
    masses = (2 * MASS_KG, 2 * (MASS_KG + CHANGE_KG))
    inertias = (ROLL_INERTIA_KG_M2, 0.9 * ROLL_INERTIA_KG_M2)
    return study_of(
        *(rolling_run(*each, rng, coherent=coherent) for *each, rng in zip(masses, inertias, rngs, strict=True))
    )


# ---- a strut with memory --------------------------------------------------------------------------


def hysteretic_run(mass_kg, rng, amplitude_n, travel_m, pushed_fraction):
    """A Bouc-Wen element beside the springs: F = a w, travel_m w' = z' - (0.5 |z'| w + 0.5 z' |w|), by Runge-Kutta.

    A force of a flat spectrum on the body moves it by a fraction of what two metres a second squared would be.
    """
    road_rng, noise_rng, push_rng = rng.spawn(3)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    rate = 8 * FS
    n = round((LEAD_S + DURATION_S + 0.5) * rate)
    push = tyre_forces(roads(road_rng, 1, speed), speed, np.arange(2 * n) / (2 * rate))[:, 0].tolist()
    drawn = 2.0 * pushed_fraction * push_rng.standard_normal(n // 8 + 2)
    aside = np.interp(np.arange(2 * n) / 16, np.arange(drawn.size), drawn).tolist()
    k1, c1, m1 = GEAR.tyre_stiffness_n_per_m, GEAR.tyre_damping_n_s_per_m, GEAR.unsprung_mass_kg
    k2, c2 = GEAR.suspension_stiffness_n_per_m, GEAR.suspension_damping_n_s_per_m

    def slope(state, force, pushed):
        x1, v1, x2, v2, w = state
        travel, velocity = x2 - x1, v2 - v1
        strut = k2 * travel + c2 * velocity + amplitude_n * w
        memory = (velocity - 0.5 * (abs(velocity) * w + velocity * abs(w))) / travel_m
        return v1, (strut - k1 * x1 - c1 * v1 + force) / m1, v2, pushed - strut / mass_kg, memory

    def ahead(state, rates, step):
        return tuple(each + step * rate for each, rate in zip(state, rates, strict=True))

    state, step, acceleration = (0.0,) * 5, 1 / rate, np.empty((n, 2))
    for i in range(n):
        last = min(2 * i + 2, 2 * n - 1)
        first = slope(state, push[2 * i], aside[2 * i])
        acceleration[i] = first[1], first[3]
        second = slope(ahead(state, first, step / 2), push[2 * i + 1], aside[2 * i + 1])
        third = slope(ahead(state, second, step / 2), push[2 * i + 1], aside[2 * i + 1])
        fourth = slope(ahead(state, third, step), push[last], aside[last])
        mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(first, second, third, fourth, strict=True)]
        state = ahead(state, mean, step)
    return readings(acceleration[:, 0], acceleration[:, 1], noise_rng)


def hysteretic(seed, amplitude_n=400.0, travel_m=0.5e-3, pushed_fraction=0.0):
    return _hysteretic(seed, amplitude_n, travel_m, pushed_fraction)


@cache
def _hysteretic(seed, *settings):
    rngs = np.random.default_rng(seed).spawn(2)
    masses = (MASS_KG, MASS_KG + CHANGE_KG)
    return study_of(*(hysteretic_run(mass, rng, *settings) for mass, rng in zip(masses, rngs, strict=True)))


@cache
def damper_for_memory(seed):
    """What is identified where friction with memory is taken for a damper."""
    return identify(hysteretic(seed, amplitude_n=1500.0, travel_m=2e-3), law="linear")


def evaluations(monkeypatch, study, **settings):
    """The result of an identification, and how often all runs were predicted for it, each run counted by its steps."""
    steps, real = [], Model.evaluate

    def counted(model, theta, **more):
        steps.append(sum(run.n_samples for run in model.runs))
        return real(model, theta, **more)

    monkeypatch.setattr(Model, "evaluate", counted)
    result = identify(study, **settings)
    return result, sum(steps) / sum(run.recording.n_samples for run in study.runs)


def says_nothing(result):
    return result.parameters == GearParameters()


def never_confidently_wrong(result, most=4.0):
    """Either no mass and stiffness at all, or a warning, and the truth within what is stated."""
    if result.not_determined is not None:
        return says_nothing(result)
    mass, stiffness = result.parameters.sprung_mass_kg, result.parameters.suspension_stiffness_n_per_m
    pairs = (mass, MASS_KG), (stiffness, 3.9e5)
    near = all(abs(estimate.value - true) < most * estimate.std for estimate, true in pairs)
    return near and any("times the noise of the sensors" in warning for warning in result.warnings)


@pytest.mark.parametrize("seed", [0, 1])
def test_one_gear_of_a_rolling_aircraft_gets_no_mass(seed):
    result = identify(rolling(seed), law="arctan_velocity")
    assert "the body also rolls and pitches on other gears" in result.not_determined
    assert "describe all of them in [[interfaces]]" in result.not_determined
    assert says_nothing(result)
    assert result.residual_over_noise > 20
    assert result.limited_by != "noise"
    # what it does on its own is told as roughly as it is known
    frequency = result.ratios.natural_frequency_hz
    assert frequency.std > 0.005 * frequency.value
    assert any("roll or pitch of a body on several gears" in warning for warning in result.warnings)
    # what it would have said: far off, and sure of it
    fit = result.evidence[0].fit
    place = fit.model.names.index("inverse_mass")
    assert abs(fit.theta[place] - 1 / MASS_KG) > 3 * fit.std[place]


@pytest.mark.usefixtures("few_figures")
def test_a_rolling_aircraft_ends_the_command_with_status_1(tmp_path):
    write_study(rolling(0), tmp_path / "study.toml")
    arguments = ["identify", str(tmp_path / "study.toml"), "--law", "arctan_velocity", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(cli.main, arguments, catch_exceptions=False)
    assert done.exit_code == 1
    assert "Not determined: no mass is reported, because an error of the model" in done.stdout
    assert done.stderr.endswith("Error: not determined, for the reason above\n")
    assert json.loads((tmp_path / "out" / "result.json").read_text())["parameters"]["sprung_mass_kg"]["value"] is None


def test_the_same_aircraft_on_one_road_under_both_wheels_is_identified():
    """It heaves only, and each gear carries half of it."""
    result = identify(rolling(0, coherent=True), law="arctan_velocity")
    assert result.not_determined is None
    for (_, estimate), true in zip(result.parameters.items(), (MASS_KG, 3.9e5, 6e3), strict=False):
        assert abs(estimate.value - true) < 4 * estimate.std
    assert result.parameters.sprung_mass_kg.std < 0.003 * MASS_KG
    assert result.evidence[0].whiteness.white
    assert result.warnings == ()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_an_unrecorded_leak_widens_the_interval_until_it_holds_the_mass(seed):
    leaking = Sensor(cross_axis=0.03)
    result = identify(taxi(seed, lower_sensor=leaking, upper_sensor=leaking), law="arctan_velocity")
    assert never_confidently_wrong(result)
    if result.limited_by == "unmeasured forces":
        assert result.parameters.sprung_mass_kg.holds(MASS_KG)
    assert not result.evidence[0].whiteness.white


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.03, 0.1])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_force_that_nobody_measured_widens_the_interval_and_bends_nothing(seed, fraction):
    result = identify(hysteretic(seed, amplitude_n=0.0, pushed_fraction=fraction), law="linear")
    assert result.residual_over_noise > 5
    assert result.limited_by == "unmeasured forces"
    error = result.evidence[0].error
    assert error.departure < 2
    for left in (*result.runs, *error.left_out):
        assert fraction / 2 < left.unexplained < 3 * fraction
    assert result.left_out == error.left_out
    for found, run in zip(error.left_out, result.study.runs, strict=True):
        assert 0.8 < found.inside <= 1.0
        (spectrum,) = found.spectra
        n_lines = np.rint(np.diff(spectrum.edges_hz) * DURATION_S)
        assert np.average(spectrum.inside, weights=n_lines) == pytest.approx(found.inside)
        assert found.unexplained == pytest.approx(
            np.linalg.norm(spectrum.error_m_per_s2) / np.linalg.norm(spectrum.measured_m_per_s2)
        )
        # what was read, from the log itself; what cannot be foretold is the push, which is white
        power = 2 * np.abs(np.fft.rfft(run.recording.channel("upper_z"))) ** 2 / run.recording.n_samples**2
        of_bands, _ = np.histogram(np.fft.rfftfreq(run.recording.n_samples, 1 / FS), spectrum.edges_hz, weights=power)
        np.testing.assert_allclose(spectrum.measured_m_per_s2, np.sqrt(of_bands), rtol=0.01)
        pushed = 2.0 * fraction * np.sqrt(np.diff(spectrum.edges_hz) / (FS / 2))
        stiff = (spectrum.edges_hz[:-1] > 10) & (n_lines > 60)
        assert stiff.sum() > 3
        np.testing.assert_allclose(spectrum.error_m_per_s2[stiff], pushed[stiff], rtol=0.3)
        assert np.all(spectrum.stated_m_per_s2[stiff] > spectrum.error_m_per_s2[stiff])
    pairs = (result.parameters.sprung_mass_kg, MASS_KG), (result.parameters.suspension_stiffness_n_per_m, 3.9e5)
    for estimate, true in pairs:
        assert abs(estimate.value - true) < 4 * estimate.std
        assert estimate.std < 2 * fraction * true
    for equivalent, mass_kg in zip(result.equivalents, (MASS_KG, MASS_KG + CHANGE_KG), strict=True):
        assert abs(equivalent.stiffness_per_mass.value - 3.9e5 / mass_kg) < 4 * equivalent.stiffness_per_mass.std
    assert any("limited by something that moves the body" in warning for warning in result.warnings)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_law_that_is_not_known_limits_the_answer_to_equivalents(seed):
    """Friction with memory, taken for a damper: what it leaves goes with the motion, and no mass is told."""
    result = damper_for_memory(seed)
    assert result.limited_by == "model"
    assert result.evidence[0].error.departure > 2
    assert "an error of the model biases the parameters" in result.not_determined
    assert "the given law is wrong (let it be searched)" in result.not_determined
    assert says_nothing(result)
    assert any("limited by the model" in warning for warning in result.warnings)
    # between a friction that slips and one that sticks
    low, high = (np.sqrt(stiffness / MASS_KG) / (2 * np.pi) for stiffness in (3.9e5, 3.9e5 + 1500.0 / 2e-3))
    assert low < result.equivalents[0].natural_frequency_hz.value < high


@pytest.mark.slow
@pytest.mark.parametrize("travel_m", [0.5e-3, 8e-3])
def test_the_damping_of_friction_that_remembers_is_what_it_dissipates_over_the_motion(travel_m):
    """Friction that bends much before it slides takes far less than its full force over all of the way."""
    result = identify(hysteretic(0, amplitude_n=1000.0, travel_m=travel_m), law="dahl_friction")
    damping = result.interfaces[0].at_rest[0].damping.value
    per_mass = damping if result.per_mass else damping / result.parameters.sprung_mass_kg.value
    # statistical linearisation is another way to the same number
    assert abs(per_mass / result.equivalents[0].damping_per_mass.value - 1) < 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_where_the_model_is_the_limit_the_free_motion_of_the_answer_leaves_less(monkeypatch, seed):
    """Readings that correct the motion hide what the model lacks; without them another damper follows it best."""
    followed = damper_for_memory(seed)
    monkeypatch.setattr(candidates, "follow_freely", lambda fit, error: (fit, error))
    corrected = identify(followed.study, law="linear")
    left, left_before = (np.array([run.unexplained for run in each.runs]) for each in (followed, corrected))
    assert np.sum(left**2) < np.sum(left_before**2)
    for after, before in zip(followed.equivalents, corrected.equivalents, strict=True):
        # the difference of both fits widens the interval, which then holds the other answer
        frequency = after.natural_frequency_hz
        assert abs(frequency.value - before.natural_frequency_hz.value) < 1.96 * frequency.std


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_each_run_has_an_interval_of_its_own_that_holds_where_only_one_hits_the_stop(seed):
    """A stop is a spring: over a motion it takes nothing, so the damping nearest to the strut is that of the damper.

    The lighter run rests 5.5 mm farther from the stop and hardly meets it.
    """
    gear = replace(GEAR, law=law("bump_stop", stiffness_n_per_m=1.2e6, gap_m=3e-3))
    result = identify(taxi(seed, gear), law="linear")
    assert result.limited_by == "model"
    heavy, light = (each.damping_per_mass for each in result.equivalents)
    for found, mass_kg in ((heavy, MASS_KG), (light, MASS_KG + CHANGE_KG)):
        assert found.holds(GEAR.suspension_damping_n_s_per_m / mass_kg)
    assert light.std / light.value < 0.5 * heavy.std / heavy.value


def one_run(study):
    """The study with its first run alone."""
    return study_of_gear("one", sprung=study.sprung, unsprung=study.unsprung, runs=study.runs[:1])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_short_run_under_a_wrong_law_is_cut_in_two_and_its_interval_holds(seed):
    study = one_run(hysteretic(seed, amplitude_n=1500.0, travel_m=2e-3))
    result = identify(study, law="linear")
    assert result.limited_by == "model"
    low, high = (np.sqrt(stiffness / MASS_KG) / (2 * np.pi) for stiffness in (3.9e5, 3.9e5 + 1500.0 / 2e-3))
    bottom, top = result.equivalents[0].natural_frequency_hz.interval95
    assert bottom < top
    assert bottom < high
    assert top > low


def test_no_interval_where_no_piece_of_a_run_can_be_fitted(monkeypatch):
    """A band that pieces are too short for."""

    def too_short(run, n_pieces):
        raise InputError("the band holds too few lines")

    monkeypatch.setattr(DrivenRun, "split", too_short)
    result = identify(one_run(hysteretic(0, amplitude_n=1500.0, travel_m=2e-3)), law="linear")
    assert result.limited_by == "model"
    assert result.equivalents[0].natural_frequency_hz.interval95 is None
    assert result.ratios.stiffness_per_mass.std >= result.ratios.stiffness_per_mass.value


def test_little_more_than_the_noise_of_one_gear_is_not_called_the_models():
    """Between what is explained and what is worth a warning nothing was looked into."""
    result = identify(hysteretic(0, amplitude_n=0.0, pushed_fraction=0.0), law="linear")
    for ratio in (1.0, 1.3):
        assert replace(result, residual_over_noise=ratio).limited_by == "noise"


@pytest.mark.parametrize(("amplitude_n", "travel_m"), [(400.0, 0.5e-3), (1500.0, 2e-3)])
def test_memory_in_the_strut_is_found(amplitude_n, travel_m):
    """Simulated here, step by step: Dahl's friction, or Bouc-Wen with exponent 1, which is the same."""
    result = identify(hysteretic(0, amplitude_n=amplitude_n, travel_m=travel_m))
    assert result.law.name in ("dahl_friction", "bouc_wen")
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)
    assert abs(result.parameters.sprung_mass_kg.value / MASS_KG - 1) < 0.004
    np.testing.assert_allclose(result.law.vector[:2], [amplitude_n, travel_m], rtol=0.01)


@pytest.mark.parametrize("amplitude_n", [100.0, 400.0])
def test_memory_in_the_strut_never_gives_a_confident_wrong_number(amplitude_n):
    result = identify(hysteretic(0, amplitude_n=amplitude_n), law="arctan_velocity")
    assert never_confidently_wrong(result)


NO_MODEL_OF_OURS = {
    "it rolls": lambda: rolling(0),
}


@pytest.mark.parametrize("world", NO_MODEL_OF_OURS)
def test_a_refusal_ends_soon(world, monkeypatch):
    """Laws are searched, and AC coupling is tried; a sound study of this size takes some 100 evaluations."""
    result, n = evaluations(monkeypatch, NO_MODEL_OF_OURS[world]())
    assert n < 200
    assert never_confidently_wrong(result)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_channels_that_share_nothing_get_no_number(seed):
    samples = np.random.default_rng(seed).standard_normal((2, 2, round(DURATION_S * FS)))
    runs = [recording_from_arrays(each, ["lower_z", "upper_z"], fs=FS) for each in samples]
    result = identify(study_of(*runs))
    assert "no number is reported" in result.not_determined
    # nobody is told to do what was done
    assert "searched" not in result.not_determined
    assert says_nothing(result)
    assert all(estimate.value is None for _, estimate in result.ratios.items())


@pytest.mark.parametrize("late", [-4, 5])
def test_a_delay_of_many_samples_is_found_before_a_law_is(late):
    """Left to the law, it is a strut that remembers."""
    delayed = []
    for run in taxi(0).runs:
        lower, upper = run.recording.channel("lower_z"), run.recording.channel("upper_z")
        first, last = max(late, 0), lower.size + min(late, 0)
        pair = [lower[first:last], upper[first - late : last - late]]
        delayed.append(recording_from_arrays(pair, ["lower_z", "upper_z"], fs=FS))
    plain = study_of(*delayed)
    facts = SensorPair(SensorFacts(), SensorFacts(lag_tolerance_s=0.02))
    result = identify(replace(plain, interfaces=(replace(plain.interfaces[0], facts=facts),)))
    fit = result.evidence[0].fit
    assert abs(fit.value("lag_s") - late / FS) < 2e-4
    # what was read before the record begins is not known, which a small term more may mend
    assert "arctan_velocity" in result.law.name.split("+")
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)


@pytest.mark.parametrize("channel", ["lower_z", "upper_z"])
def test_a_sensor_upside_down_gets_no_number(channel):
    sound, turned = taxi(0), []
    for run in sound.runs:
        columns = [run.recording.channel(name) * (-1 if name == channel else 1) for name in run.recording.names]
        turned.append(recording_from_arrays(columns, run.recording.names, fs=FS))
    result = identify(study_of(*turned), law="arctan_velocity")
    assert "upside down" in result.not_determined
    assert "let the law be searched" in result.not_determined
    assert says_nothing(result)


def test_one_run_alone_gives_ratios():
    result = identify(one_run(taxi(0)), law="arctan_velocity")
    assert "one run gives ratios to the mass alone" in result.not_determined
    assert says_nothing(result)
    ratios = result.ratios
    for estimate, true in ((ratios.stiffness_per_mass, 3.9e5 / MASS_KG), (ratios.damping_per_mass, 6e3 / MASS_KG)):
        assert abs(estimate.value - true) < 4 * estimate.std
        assert estimate.std < 0.01 * true


@pytest.mark.slow
def test_a_given_law_without_the_stop_that_one_run_hit_gets_no_mass():
    """What both weights leave alike is no force that nobody measured where a law of the library would explain it."""
    stop = law("bump_stop", stiffness_n_per_m=2e6, gap_m=0.012)
    gear = LandingGear(law=GEAR.law + stop)
    lifted_m = -CHANGE_KG * GRAVITY_M_PER_S2 / gear.suspension_stiffness_n_per_m
    light = replace(gear, sprung_mass_kg=MASS_KG + CHANGE_KG, law=gear.law.resting_at(lifted_m))
    rngs = np.random.default_rng([0, 7]).spawn(2)
    logs = [
        taxi_run(each, rng=rng, road_class=road, duration_s=40, fs=FS).recording
        for each, road, rng in zip((gear, light), "AC", rngs, strict=True)
    ]
    result = identify(study_of(*logs), law="arctan_velocity")
    assert result.limited_by == "model"
    assert result.parameters.sprung_mass_kg.value is None
    assert "the given law is wrong" in result.not_determined
    found = identify(study_of(*logs), law="arctan_velocity+bump_stop")
    assert found.limited_by == "noise"
    assert found.parameters.sprung_mass_kg.holds(MASS_KG)


def rubbing(friction_n_per_kg, seed=0, frequency_hz=3.0, damping_ratio=0.02):
    """A frame on columns, shaken from below, that sticks to a wall and slides along it: its base and its top."""
    step_s, rng, omega = 1 / (16 * FS), np.random.default_rng(seed), 2 * np.pi * frequency_hz
    t = np.arange(0.0, DURATION_S, step_s)
    tones = [(each, 8e-3 / each**2, rng.uniform(0, 2 * np.pi)) for each in (0.7, 1.3, 2.1)]
    base, rate, below = (
        sum(
            size * (2 * np.pi * hz) ** n * np.sin(2 * np.pi * hz * t + phase + n * np.pi / 2)
            for hz, size, phase in tones
        )
        for n in (0, 1, 2)
    )
    place, speed, above = 0.0, 0.0, np.zeros(t.size)
    for k in range(t.size):
        free = speed - step_s * (omega**2 * (place - base[k]) + 2 * damping_ratio * omega * (speed - rate[k]))
        slid = np.sign(free) * max(abs(free) - step_s * friction_n_per_kg, 0.0)
        above[k], speed = (slid - speed) / step_s, slid
        place += step_s * speed
    sides = [decimate(each, 16) for each in (below, above)]
    return [each + 1e-3 * rng.standard_normal(each.size) for each in sides]


@pytest.mark.parametrize(("friction_n_per_kg", "seed", "is_refused"), [(0.4, 0, False), (2.0, 1, True)])
def test_a_body_that_rubs_on_a_wall_is_told_so(friction_n_per_kg, seed, is_refused):
    recording = recording_from_arrays(rubbing(friction_n_per_kg, seed), ["base", "top"], fs=FS)
    study = study_of_gear("wall", sprung="top", unsprung="base", runs=(Run("run", recording),), axis="horizontal")
    result = identify(study, law="linear")
    assert result.is_refused == is_refused
    assert never_confidently_wrong(result)
    assert result.ratios.natural_frequency_hz.value is None or result.ratios.natural_frequency_hz.holds(3.0)
    told = re.compile(
        r"rubs on something that stands still: .* a friction of ([\d.]+) N per kg .* explains 9\d % .* natural "
        r"frequency of ([\d.]+) ± ([\d.]+) Hz"
    )
    said = told.search(result.not_determined if is_refused else " ".join(result.warnings))
    friction, frequency, std = (float(each) for each in said.groups())
    assert friction == pytest.approx(friction_n_per_kg, rel=0.2)
    assert abs(frequency - 3.0) < 3 * std
    assert std < 0.3


def test_exchanged_channels_are_not_said_to_rub_on_anything():
    swapped = [recording_from_arrays(run.recording.samples.T[::-1], run.recording.names, fs=FS) for run in taxi(0).runs]
    result = identify(study_of(*swapped), law="arctan_velocity")
    assert result.not_determined
    assert "stands still" not in result.not_determined


def test_friction_in_the_suspension_is_not_said_to_be_one_against_the_ground():
    gear = LandingGear(law=law("coulomb_friction", amplitude_n=2500.0, scale_m_per_s=0.002))
    recording = taxi_run(gear, rng=np.random.default_rng(3), road_class="A", **SHORT).recording
    study = study_of_gear("dry", sprung="upper_z", unsprung="lower_z", runs=(Run("run", recording),))
    result = identify(study, law="linear")
    assert "stands still" not in " ".join([result.not_determined or "", *result.warnings])
